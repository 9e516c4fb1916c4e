//! The estimator of a tumbling rigid body, beside [`DdMhe`].

use crate::config::{Bounds, Start};
use crate::config_checks::{check_measured, check_output};
use crate::error::Error;
use crate::estimate::{Estimate, Log};
use crate::history::History;
use crate::interrupt::Interrupt;
use crate::mhe::DdMhe;
use crate::rigid::config::RigidConfig;
use crate::rigid::ends::foretells;
use crate::rigid::made::{lagging, online};
use crate::rigid::measured::Measured;
use crate::rigid::online::{Online, blank};
use crate::rigid::report::Report;
#[cfg(feature = "serde")]
use crate::rigid::saved::{Saved, wrong};
use crate::rigid::warnings::warnings;
#[cfg(feature = "serde")]
use crate::snapshot::{Kind, from_bytes, to_bytes};
use ddmhe_run::Status;
use ddmhe_run::rigid::Limits;
use ddmhe_run::rigid::filter::DISAGREE;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// Score above which the affine estimator takes over, if its own is less than half, for so many
/// samples in a row.
const LOST: (f64, usize) = (8.0, 100);
/// Weight of the newest sample in the affine estimator's score, and its most: the filter's.
const AVERAGE: (f64, f64) = (0.03, 10.0);
/// A lag is certain that is so many of its deviations.
const CERTAIN: f64 = 5.0;
/// Score above which the affine estimator stands by, and below which it rests again.
const STANDS_BY: (f64, f64) = (DISAGREE, 1.0);

/// Estimates ω of a tumbling body that eddy currents brake, from a torque: Euler's equation is all
/// that is known beforehand; inertia, drag and the map to the outputs are taken from the recording.
/// Where no rigid body explains the recording, or does not any more, a [`DdMhe`] takes over.
pub struct RigidBodyMhe {
    history: History,
    config: RigidConfig,
    rigid: Box<dyn Online>,
    /// The run that a body whose outputs lag has taken the place of.
    plain: Option<Box<dyn Online>>,
    fallback: DdMhe,
    /// Whether the fallback can begin anywhere, so that it may rest as long as the body explains
    /// all.
    may_rest: bool,
    estimate: Estimate,
    run: Judged,
}

/// How the two compare, and how far the run has come.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
struct Judged {
    t: usize,
    /// Mean square of the affine estimator's innovations, a moving average.
    score: f64,
    /// Samples in a row for which it was better.
    worse: usize,
    /// Whether it consumes what is measured.
    stands_by: bool,
    /// When a lag was tried last.
    tried: usize,
}

impl Judged {
    const NEW: Self = Judged { t: 0, score: 1.0, worse: 0, stands_by: true, tried: 0 };
}

impl Clone for RigidBodyMhe {
    fn clone(&self) -> Self {
        RigidBodyMhe {
            history: self.history.clone(),
            config: self.config.clone(),
            rigid: self.rigid.copy(),
            plain: self.plain.as_ref().map(|own| own.copy()),
            fallback: self.fallback.clone(),
            may_rest: self.may_rest,
            estimate: self.estimate.clone(),
            run: self.run,
        }
    }
}

#[cfg(feature = "serde")]
#[derive(Serialize, Deserialize)]
struct Snapshot {
    history: History,
    config: RigidConfig,
    rigid: Saved,
    lags: bool, // found on the way
    fallback: Vec<u8>,
    estimate: Estimate,
    run: Judged,
}

impl RigidBodyMhe {
    /// Fits the recording from several starts: one, or up to eight of one body, each at a spin of
    /// its own, and the run goes on from the end of the last. `fallback`: what takes over; None: a
    /// [`DdMhe`] with its defaults, this box and this noise.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::Value`] or [`Error::NotFinite`] naming the setting at fault, or
    /// for a recording of three rates in another unit than rad/s; as [`DdMhe::new`]. A recording of
    /// other than three states and one to six outputs is no body's: the affine estimator stands in.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::rigid::RigidConfig;
    /// # use ddmhe_core::*;
    /// # // a body that a torque -D ω brakes about two of its axes, in small steps of Euler's rule
    /// # let (J, d) = ([0.8, 1.0, 1.2], [0.002, 0.001, 0.0]);
    /// # let (mut w, mut x, mut y) = ([0.2, 0.15, -0.1], Vec::new(), Vec::new());
    /// # for _ in 0..=1200 {
    /// #     x.extend(w);
    /// #     y.extend([3.0 * w[0] + w[1], w[1] - 2.0 * w[0], 0.5 * w[0]]);
    /// #     for _ in 0..100 {
    /// #         let f = |i: usize, j: usize, k: usize| {
    /// #             ((J[j] - J[k]) * w[j] * w[k] - d[i] * w[i]) / J[i]
    /// #         };
    /// #         let f: [f64; 3] = [f(0, 1, 2), f(1, 2, 0), f(2, 0, 1)];
    /// #         (0..3).for_each(|i| w[i] += 0.001 * f[i]);
    /// #     }
    /// # }
    /// // rates x and torques y of a tumbling body: 20 s were recorded, then torques alone
    /// let history = History::new(3, 3, &x[..603], &y[..600], 0.1)?;
    /// let mut estimator = RigidBodyMhe::new(&history, RigidConfig::default(), None)?;
    /// assert!(estimator.explained());
    /// for y in y[600..3600].chunks(3) {
    ///     estimator.step(y)?;
    /// }
    /// // a hundred seconds later
    /// let estimate = estimator.estimate();
    /// assert_eq!(estimate.status, Status::Structured);
    /// let off = |i: usize| (estimate.x[i] - x[3600 + i]).abs();
    /// assert!((0..3).all(|i| off(i) < 1e-3));
    /// # Ok::<(), Error>(())
    /// ```
    pub fn new(
        history: &History,
        config: RigidConfig,
        fallback: Option<DdMhe>,
    ) -> Result<Self, Error> {
        config.check(history)?;
        let mut rigid = online(history, &config)?;
        if rigid.doubted() && !foretells(history, &config)? {
            rigid.retire();
        }
        let fallback = match fallback {
            Some(own)
                if (own.n(), own.p()) != (history.n(), history.p()) || own.history().m() > 0 =>
            {
                let (n, p) = (history.n(), history.p());
                let expected = format!("a DdMhe of n = {n} and p = {p} without inputs");
                let found = format!("n = {}, p = {}", own.n(), own.p());
                return Err(Error::shape("fallback", expected, found));
            }
            Some(own) => own,
            None => {
                let energy = |Limits { lo, hi }| Bounds { lo: lo.to_vec(), hi: hi.to_vec() };
                let x_bounds = config.x_bounds.clone().or(rigid.limits().map(energy));
                DdMhe::new(history, config.of_affine(x_bounds))?
            }
        };
        let anywhere = matches!(fallback.config().begins(), Start::Auto | Start::Unknown);
        let may_rest = anywhere && rigid.explained();
        let (history, estimate, run) = (history.clone(), Estimate::default(), Judged::NEW);
        Ok(RigidBodyMhe { history, config, rigid, plain: None, fallback, may_rest, estimate, run })
    }

    /// Consumes y(t-1) (p numbers, NaN = this entry was not measured) and returns the estimate of
    /// ω(t). Its window is that one state; its cost is the squared innovation in units of its
    /// variance.
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::NotFinite`] (infinite entry); the estimator is then unchanged.
    pub fn step(&mut self, y: &[f64]) -> Result<&Estimate, Error> {
        self.step_with(Measured { y, ..Measured::default() })
    }

    /// [`step`](Self::step) with rates `x` (3, NaN = not measured) that a sensor read at the
    /// instant of y, with the noise [`RigidConfig::rate_noise`].
    ///
    /// # Errors
    /// As [`step`](Self::step), of either.
    pub fn step_with_rates(&mut self, y: &[f64], x: &[f64]) -> Result<&Estimate, Error> {
        self.step_with(Measured { y, x: Some(x), field: None })
    }

    /// [`step`](Self::step) with what else was measured or is known of the instant of y: rates as
    /// in [`step_with_rates`](Self::step_with_rates), and the field, for an estimator that was made
    /// with one ([`RigidConfig::field`]). ω(t) is foretold with the field as it would go on from
    /// the last two samples, linearly; the next step puts what it then is in the place of that.
    ///
    /// # Errors
    /// As [`step`](Self::step), of each; [`Error::Shape`] for a field that is missing or not
    /// expected.
    pub fn step_with(&mut self, sample: Measured<'_>) -> Result<&Estimate, Error> {
        let p = self.history.p();
        check_output(sample.y, p)?;
        sample.check("x", (self.n(), p, self.config.field.is_some()), 1)?;
        self.advance(&sample)?;
        Ok(&self.estimate)
    }

    /// All steps of a log `ys` (N·p, time-major): the same numbers as N calls of
    /// [`step`](Self::step).
    ///
    /// # Errors
    /// As [`step`](Self::step); the whole log is checked first, so a bad row leaves the estimator
    /// unchanged.
    pub fn run(&mut self, ys: &[f64]) -> Result<Log, Error> {
        self.run_until(&Measured { y: ys, ..Measured::default() }, &mut || false)
    }

    /// [`run`](Self::run) over a log of all that [`step_with`](Self::step_with) takes, until
    /// `stop`, asked every 50 ms or so, is true: the log then ends with the last step made.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn run_until(
        &mut self,
        samples: &Measured<'_>,
        stop: &mut dyn FnMut() -> bool,
    ) -> Result<Log, Error> {
        let (p, ys) = (self.history.p(), samples.y);
        if !ys.len().is_multiple_of(p) {
            return Err(Error::shape("Y", format!("a multiple of p = {p} numbers"), ys.len()));
        }
        check_measured("Y", ys, p)?;
        samples.check("X", (self.n(), p, self.config.field.is_some()), ys.len() / p)?;
        let mut log = Log::default();
        log.reserve(ys.len() / p, (self.n(), p), true);
        let mut interrupt = Interrupt::new(stop);
        for k in 0..ys.len() / p {
            if interrupt.stopped() {
                break;
            }
            self.advance(&samples.at(k, p))?;
            log.push(&self.estimate);
        }
        Ok(log)
    }

    /// Fits recording and all outputs since anew; whether a rigid body explains them. False, too,
    /// where fits are not manual and more has passed than outputs are kept.
    pub fn refit(&mut self) -> bool {
        self.rigid.refit()
    }

    /// [`refit`](Self::refit) as long as `time_left`, asked after each slice of some 20 µs: None
    /// where that was not enough. Steps may be made in between; the next call goes on where this
    /// one stopped, and at the end the filters go on from the fits, with what came since. Where
    /// several motions are followed some 100 µs are needed at once.
    ///
    /// # Example
    /// ```no_run
    /// # use ddmhe_core::{RigidBodyMhe, Error};
    /// # fn idle(estimator: &mut RigidBodyMhe) {
    /// let end = std::time::Instant::now() + std::time::Duration::from_millis(2);
    /// let explained = estimator.refit_while(&mut || std::time::Instant::now() < end);
    /// # }
    /// ```
    pub fn refit_while(&mut self, time_left: &mut dyn FnMut() -> bool) -> Option<bool> {
        self.rigid.refit_while(time_left)
    }

    /// Back to the recording's end, as a new estimator.
    ///
    /// # Errors
    /// As [`DdMhe::reset`].
    pub fn reset(&mut self) -> Result<(), Error> {
        self.fallback.reset(None)?;
        if let Some(plain) = self.plain.take() {
            self.rigid = plain;
        }
        self.rigid.restart();
        (self.estimate, self.run) = (Estimate::default(), Judged::NEW);
        Ok(())
    }

    /// Number of states n; 3 of a body.
    pub fn n(&self) -> usize {
        self.history.n()
    }

    /// Number of outputs p.
    pub fn p(&self) -> usize {
        self.history.p()
    }

    /// Steps since the start or the last reset.
    pub fn t(&self) -> usize {
        self.run.t
    }

    /// The recording behind the estimator.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// The settings that were asked for.
    pub fn config(&self) -> &RigidConfig {
        &self.config
    }

    /// The latest estimate (empty before the first step).
    pub fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    /// Whether a rigid body explains the recording.
    pub fn explained(&self) -> bool {
        self.rigid.explained()
    }

    /// What is known of the body; None where no fit of the recording came to an end.
    pub fn report(&self) -> Option<Report> {
        self.rigid.report()
    }

    /// What a user should know, in words; grows while it runs.
    pub fn warnings(&self) -> Vec<String> {
        let mut words = warnings(&*self.rigid, self.n());
        if self.plain.is_some() {
            words.push(
                "later outputs showed that they lag behind the motion: estimates before did not \
                 know"
                    .into(),
            );
        }
        if !self.rigid.is_rigid() {
            words.extend(self.fallback.warnings());
        }
        words
    }

    /// The estimator as bytes, for [`restore`](Self::restore).
    #[cfg(feature = "serde")]
    pub fn snapshot(&self) -> Vec<u8> {
        let snapshot = Snapshot {
            history: self.history.clone(),
            config: self.config.clone(),
            rigid: self.rigid.saved(),
            lags: self.plain.is_some(),
            fallback: self.fallback.snapshot(),
            estimate: self.estimate.clone(),
            run: self.run,
        };
        to_bytes(Kind::RigidBody, &snapshot)
    }

    /// The estimator that [`snapshot`](Self::snapshot) saved; its next steps give the same numbers.
    /// The recording is fitted again.
    ///
    /// # Errors
    /// As [`from_bytes`], and for content that no estimator has.
    #[cfg(feature = "serde")]
    pub fn restore(blob: &[u8]) -> Result<Self, Error> {
        let snapshot: Snapshot = from_bytes(Kind::RigidBody, blob)?;
        let fallback = DdMhe::restore(&snapshot.fallback)?;
        let mut own = RigidBodyMhe::new(&snapshot.history, snapshot.config, Some(fallback))?;
        if snapshot.lags {
            let lagging = lagging(&own.history, &own.config)?.ok_or_else(wrong)?;
            own.plain = Some(std::mem::replace(&mut own.rigid, lagging));
        }
        own.rigid.resume(&snapshot.rigid)?;
        if !snapshot.estimate.fits(own.n(), own.p()) {
            return Err(Error::value("blob", "an estimate of its sizes", "one of others"));
        }
        (own.estimate, own.run) = (snapshot.estimate, snapshot.run);
        Ok(own)
    }

    /// One step on checked input.
    fn advance(&mut self, sample: &Measured<'_>) -> Result<(), Error> {
        let y = sample.y;
        self.run.t += 1;
        let mut told = false; // whether the affine estimator has this sample
        if self.rigid.is_rigid() {
            if self.estimate.x.is_empty() {
                self.estimate = blank(self.history.p());
            }
            let own = self.rigid.score();
            let (wakes, rests) = (own > STANDS_BY.0, self.may_rest && own < STANDS_BY.1);
            if wakes || (self.run.stands_by && !rests) {
                self.tell_affine(y)?;
                told = true;
            } else {
                self.run.stands_by = false;
            }
            let worse = own > LOST.0 && own > 2.0 * self.run.score;
            self.run.worse = if worse { self.run.worse + 1 } else { 0 };
            if self.run.worse <= LOST.1 && self.rigid.advance(sample, &mut self.estimate) {
                return self.look_for_lag();
            }
            self.rigid.give_up();
        }
        if !told {
            self.tell_affine(y)?;
        }
        self.estimate.clone_from(self.fallback.estimate());
        if self.estimate.status != Status::Failed {
            self.estimate.status = Status::Affine;
        }
        Ok(())
    }

    /// Where no body explains all data any more: one whose outputs lag, if that does. It is made
    /// and told all in this one step.
    fn look_for_lag(&mut self) -> Result<(), Error> {
        let (doubted, suspected) = (self.rigid.doubted(), self.rigid.suspects_lag());
        let due = self.run.t >= 2 * self.run.tried && self.rigid.seeks_lag();
        if !(due && (doubted || suspected)) {
            return Ok(());
        }
        self.run.tried = self.run.t;
        let Some(mut other) = lagging(&self.history, &self.config)? else { return Ok(()) };
        let mut estimate = self.estimate.clone();
        let explains = self.rigid.tell_all(&mut *other, &mut estimate) && other.refit();
        let lag = other.report().and_then(|report| report.lag);
        let is_sure = lag.is_some_and(|[lag, sd]| lag > CERTAIN * sd);
        if explains && other.credible() && (doubted || is_sure) {
            self.plain = Some(std::mem::replace(&mut self.rigid, other));
            self.estimate = estimate;
        }
        Ok(())
    }

    /// The affine estimator consumes y; where it rested it begins anywhere.
    fn tell_affine(&mut self, y: &[f64]) -> Result<(), Error> {
        if !self.run.stands_by {
            self.fallback.reset(None)?;
            (self.run.stands_by, self.run.score) = (true, Judged::NEW.score);
        }
        let affine = self.fallback.step(y)?;
        let squares = affine.evidence.iter().flat_map(|own| {
            let variances = own.innovation.iter().zip(&own.innovation_variance);
            variances.map(|(v, variance)| v * v / variance).filter(|v| v.is_finite())
        });
        let (sum, count) = squares.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
        if count > 0.0 {
            self.run.score += AVERAGE.0 * (f64::min(sum / count, AVERAGE.1) - self.run.score);
        }
        Ok(())
    }
}
