//! Data-driven moving horizon estimation: Algorithm 1 of Liu 2026.
//!
//! What is computed at construction is a [`Design`]; what changes from step to step is a [`Run`].

use crate::check::check_vector;
use crate::config::{Bounds, Config, Start};
use crate::config_checks::{check_beside, check_box, check_measured, check_output, check_start};
use crate::design::Design;
use crate::error::Error;
use crate::estimate::{Estimate, Log};
use crate::history::History;
use crate::interrupt::Interrupt;
use crate::magnitude::check_reach;
use crate::needs::Needs;
use crate::run::Run;
#[cfg(feature = "serde")]
use crate::saved::Saved;
use crate::tol;
use std::ops::Range;
use std::sync::Arc;

/// Steps that are made in a row at most before it is asked whether to stop.
const ROW: usize = 32;

/// One sample: what a step is given.
#[derive(Debug, Clone, Copy, Default)]
pub struct Step<'a> {
    /// y(t-1) (p); NaN: this entry was not measured.
    pub y: &'a [f64],
    /// u(t-1) (m), the known inputs at the same instant; empty for a recording without.
    pub u: &'a [f64],
    /// Bounds on the states for this step alone: lo and hi hold n numbers each, or one row per
    /// state of the window, (M_t+1)·n with M_t = [`next_depth`](DdMhe::next_depth).
    pub x_bounds: Option<&'a Bounds>,
}

/// A log: what a run is given.
#[derive(Debug, Clone, Copy, Default)]
pub struct Signals<'a> {
    /// Outputs (N·p, time-major); NaN: not measured.
    pub y: &'a [f64],
    /// Known inputs at the same instants (N·m); empty for a recording without.
    pub u: &'a [f64],
}

impl<'a> From<&'a [f64]> for Signals<'a> {
    fn from(y: &'a [f64]) -> Self {
        Signals { y, u: &[] }
    }
}

/// The estimator. A copy continues on its own from the same window and shares everything that was
/// computed at construction.
pub struct DdMhe {
    pub(crate) design: Arc<Design>,
    pub(crate) config: Config,
    pub(crate) run: Run,
}

impl Clone for DdMhe {
    fn clone(&self) -> Self {
        DdMhe {
            design: Arc::clone(&self.design),
            config: self.config.clone(),
            run: self.run.copy(&self.design),
        }
    }
}

impl DdMhe {
    /// Prepares the estimator: checks every argument, fills in the defaults and factors the
    /// problems of all depths.
    ///
    /// # Errors
    /// [`Error::Value`], [`Error::Shape`] or [`Error::NotFinite`] naming the setting at fault;
    /// [`Error::Rank`] when the recording is too short for the horizon or violates the rank
    /// condition (7).
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
    /// # let x: Vec<f64> =
    /// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
    /// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
    /// # let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?;
    /// let bounds = Bounds { lo: vec![0.0], hi: vec![20.0] };
    /// let config = Config { x_bounds: Some(bounds), ..Config::default() };
    /// let estimator = DdMhe::new(&history, config)?;
    /// assert!(estimator.spectral_radius() < 1.0);
    /// # Ok::<(), Error>(())
    /// ```
    pub fn new(history: &History, config: Config) -> Result<Self, Error> {
        let start = config.begins();
        let design = Design::new(history, &config, Needs::of(&config, start))?;
        let mut mhe = DdMhe { run: Run::new(&design, start), design: Arc::new(design), config };
        mhe.prepare(mhe.run.start)?;
        mhe.restart(None);
        Ok(mhe)
    }

    /// Consumes y(t-1) (p numbers, NaN = this entry was not measured) and returns the estimate
    /// x̂(t). Whatever its status, x and the window are finite and, unless the status is optimal,
    /// exactly inside the box on the states, if that is hard; see [`ddmhe_run::stepper`] for what
    /// they then are, and for what later steps take for x̄.
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::NotFinite`] (infinite entry); the estimator is then unchanged.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
    /// # let x: Vec<f64> =
    /// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
    /// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
    /// # let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?;
    /// let config = Config { start: Start::Recording, ..Config::default() };
    /// let mut estimator = DdMhe::new(&history, config)?;
    /// let estimate = estimator.step(&y[30..31])?; // x̂(31)
    /// assert!((estimate.x[0] - x[31]).abs() < 1e-9);
    /// assert_eq!(estimate.status, Status::Optimal);
    /// let lost = estimator.step(&[f64::NAN])?; // not measured
    /// assert!((lost.x[0] - x[32]).abs() < 1e-9);
    /// # Ok::<(), Error>(())
    /// ```
    pub fn step(&mut self, y: &[f64]) -> Result<&Estimate, Error> {
        check_output(y, self.design.history.p())?;
        self.check_inputs("u", &[], 1)?;
        Ok(self.advance(y, &[], None))
    }

    /// [`step`](Self::step) with what else belongs to it: the known inputs, and other state bounds
    /// for this step alone.
    ///
    /// # Errors
    /// As [`step`](Self::step), for inputs that are not all there, not finite or more than 1/ε
    /// deviations from the recording, and for bounds of the wrong size, NaN or crossed.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
    /// # let x: Vec<f64> =
    /// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
    /// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
    /// # let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?;
    /// let mut estimator = DdMhe::new(&history, Config::default())?;
    /// let box_now = Bounds { lo: vec![9.0], hi: vec![9.6] }; // of this step alone
    /// let step = Step { y: &y[30..31], u: &[], x_bounds: Some(&box_now) };
    /// let estimate = estimator.step_with(step)?;
    /// assert!((9.0..=9.6).contains(&estimate.x[0]));
    /// # Ok::<(), Error>(())
    /// ```
    pub fn step_with(&mut self, Step { y, u, x_bounds }: Step<'_>) -> Result<&Estimate, Error> {
        check_output(y, self.design.history.p())?;
        self.check_inputs("u", u, 1)?;
        if let Some(bounds) = x_bounds {
            let n = self.design.history.n();
            check_box("x_bounds", bounds, &[n, (self.next_depth() + 1) * n])?;
        }
        Ok(self.advance(y, u, x_bounds))
    }

    /// All steps of a log `ys` (N·p, time-major): the same numbers as N calls of
    /// [`step`](Self::step).
    ///
    /// # Errors
    /// As [`step`](Self::step); the whole log is checked first, so a bad row leaves the estimator
    /// unchanged. Nothing errs after that.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
    /// # let x: Vec<f64> =
    /// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
    /// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
    /// # let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?;
    /// let config = Config { start: Start::Recording, ..Config::default() };
    /// let log = DdMhe::new(&history, config)?.run(&y[30..60])?;
    /// assert!(log.x.iter().zip(&x[31..]).all(|(a, b)| (a - b).abs() < 1e-9));
    /// # Ok::<(), Error>(())
    /// ```
    pub fn run(&mut self, ys: &[f64]) -> Result<Log, Error> {
        self.run_until(ys.into(), &mut || false)
    }

    /// [`run`](Self::run) of a log of outputs and known inputs until `stop`, asked every 50 ms or
    /// so, is true: the log then ends with the last step made, where the estimator stands.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn run_until(
        &mut self,
        Signals { y: ys, u: us }: Signals<'_>,
        stop: &mut dyn FnMut() -> bool,
    ) -> Result<Log, Error> {
        let (p, m) = (self.design.history.p(), self.design.history.m());
        if !ys.len().is_multiple_of(p) {
            return Err(Error::shape("Y", format!("a multiple of p = {p} numbers"), ys.len()));
        }
        check_measured("Y", ys, p)?;
        self.check_inputs("U", us, ys.len() / p)?;
        let mut log = Log::default();
        let judged = self.design.ground.sizes().judged();
        log.reserve(ys.len() / p, (self.n(), p), judged);
        let mut interrupt = Interrupt::new(stop);
        let steps = ys.len() / p;
        let alone = self.run.may_be_alone(&self.design);
        let mut k = 0;
        while k < steps {
            let stopped = interrupt.stopped();
            if stopped && (k == 0 || !alone) {
                break;
            }
            // the window of the last step is there to be looked at
            let last = !alone || stopped || k + 1 == steps;
            let row = k..if last { k } else { (k + ROW).min(steps - 1) };
            let made = self.run_row(ys, us, row, &mut log);
            if made == 0 {
                let sample = (&ys[k * p..(k + 1) * p], &us[k * m..(k + 1) * m]);
                if last || !self.run.advance_alone(&self.design, sample) {
                    self.advance(sample.0, sample.1, None);
                }
                log.push(&self.run.estimate);
            }
            k += made.max(1);
            if stopped {
                break;
            }
        }
        Ok(log)
    }

    /// Back to t = 0 as a new estimator: from x̄(0) (n) if given, otherwise from where the
    /// configuration says.
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::NotFinite`] for `x_prior`.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
    /// # let x: Vec<f64> =
    /// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
    /// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
    /// # let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?;
    /// let mut estimator = DdMhe::new(&history, Config::default())?;
    /// estimator.step(&y[30..31])?;
    /// estimator.reset(Some(&[5.0]))?; // another run, from x = 5
    /// assert_eq!(estimator.t(), 0);
    /// assert!((estimator.step(&[10.0])?.x[0] - 5.5).abs() < 1e-9);
    /// # Ok::<(), Error>(())
    /// ```
    pub fn reset(&mut self, x_prior: Option<&[f64]>) -> Result<(), Error> {
        let start = if x_prior.is_some() { Start::State } else { self.config.begins() };
        self.reset_from(start, x_prior)
    }

    /// Back to t = 0 as an estimator that was made with this start, and with x̄(0) (n) if given.
    /// The first run from another start than before may have to factor the problems that it needs.
    ///
    /// # Errors
    /// [`Error::Shape`] or [`Error::NotFinite`] for `x_prior`; [`Error::Value`] for a start that
    /// contradicts it, or an unknown one beside a disturbance. The estimator is then unchanged.
    pub fn reset_from(&mut self, start: Start, x_prior: Option<&[f64]>) -> Result<(), Error> {
        if let Some(x) = x_prior {
            check_vector("x_prior", x, self.design.history.n())?;
            check_reach("x_prior", &self.design.scaling, x, &[])?;
            check_start(start)?;
        }
        check_beside(&self.config, start)?;
        let prior = x_prior.or(self.config.x_prior.as_deref()).is_some();
        self.prepare(self.config.resolved(start, prior))?;
        self.restart(x_prior);
        Ok(())
    }

    /// What a new run of this estimator needs in flight, as bytes for
    /// [`ddmhe_run::Plan::from_bytes`]: no recording, no solver, no standard library.
    ///
    /// # Errors
    /// [`Error::Value`] where estimates carry an error bound, which a plan has not.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
    /// # let x: Vec<f64> =
    /// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
    /// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
    /// # let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?;
    /// # use ddmhe_run::{Aligned, Plan, Stepper};
    /// let config = Config { horizon: Some(5), x_prior: Some(vec![5.0]), ..Config::default() };
    /// let bytes = DdMhe::new(&history, config)?.plan()?; // on the ground, for a file
    /// let mut flash = Aligned([0; 1 << 16]);
    /// flash.0[..bytes.len()].copy_from_slice(&bytes);
    /// // in flight
    /// let plan = Plan::from_bytes(&flash.0[..bytes.len()]).expect("a plan as it was made");
    /// let mut memory = vec![0.0; Stepper::room(&plan)];
    /// let mut stepper = Stepper::new(&plan, &mut memory).expect("enough room");
    /// let estimate = stepper.step(&[10.0]).expect("one output");
    /// assert!((estimate.x[0] - 5.5).abs() < 1e-9);
    /// # Ok::<(), Error>(())
    /// ```
    pub fn plan(&self) -> Result<Vec<u8>, Error> {
        if self.is_bounded() {
            let found = "an estimator with error bounds";
            return Err(Error::value("disturbance", "none, for a plan", found));
        }
        // of a new run, whatever this one is
        let needs = Needs::in_flight(&self.config, self.config.begins());
        if self.design.serves(needs) {
            return Ok(self.design.plan(needs));
        }
        Ok(Design::new(&self.design.history, &self.config, needs)?.plan(needs))
    }

    /// Everything that a run from this start needs.
    fn prepare(&mut self, start: Start) -> Result<(), Error> {
        let needs = Needs::of(&self.config, start);
        let grows = matches!(start, Start::State | Start::Unknown);
        let made = match grows && !self.design.reaches(1) {
            true => Some(Arc::new(Design::new(&self.design.history, &self.config, needs)?)),
            false => None,
        };
        if needs.opens {
            made.as_ref().unwrap_or(&self.design).open()?;
        }
        if let Some(design) = made {
            self.run = Run::new(&design, start);
            self.design = design;
        }
        self.run.start = start;
        Ok(())
    }

    /// What [`resume`](Self::resume) continues from.
    #[cfg(feature = "serde")]
    pub(crate) fn saved(&self) -> Saved {
        self.run.saved()
    }

    /// Continues a saved run.
    #[cfg(feature = "serde")]
    pub(crate) fn resume(&mut self, saved: Saved) -> Result<(), Error> {
        self.prepare(saved.start)?;
        self.run.resume(&self.design, saved)
    }

    /// From x̄(0) if given, else from where the configuration says.
    fn restart(&mut self, x_prior: Option<&[f64]>) {
        self.run.restart(&self.design, x_prior.or(self.config.x_prior.as_deref()));
    }

    /// As many steps of a log, from that of the first of these samples on, as are made in one go:
    /// how many.
    #[inline(always)]
    fn run_row(&mut self, ys: &[f64], us: &[f64], row: Range<usize>, log: &mut Log) -> usize {
        if row.is_empty() {
            return 0;
        }
        let (n, p, m) = (self.n(), self.p(), self.design.history.m());
        let samples = (&ys[row.start * p..row.end * p], &us[row.start * m..row.end * m]);
        log.row(row.len(), n, |out| self.run.advance_row(&self.design, samples, out))
    }

    /// One step on checked input.
    fn advance(&mut self, y: &[f64], u: &[f64], x_bounds: Option<&Bounds>) -> &Estimate {
        self.run.advance(&self.design, (y, u), x_bounds);
        if self.run.first.is_some() {
            self.find_start(y, u, x_bounds);
        }
        &self.run.estimate
    }

    /// Whether the run goes on from the recording's end; where not, it starts over from an unknown
    /// state with all outputs since.
    #[cold]
    fn find_start(&mut self, y: &[f64], u: &[f64], x_bounds: Option<&Bounds>) {
        let Some(first) = &mut self.run.first else { return };
        first.extend(y.iter().chain(u));
        if self.run.goes_on {
            if self.run.t >= self.design.settings.horizon {
                (self.run.first, self.run.start) = (None, Start::Recording);
            }
            return;
        }
        let (samples, t) = (self.run.first.take().unwrap_or_default(), self.run.t);
        if self.prepare(Start::Unknown).is_err() {
            (self.run.start, self.run.doubts.kept) = (Start::Recording, true);
        } else {
            self.restart(None);
            for (k, sample) in samples.chunks_exact(y.len() + u.len()).enumerate() {
                let bounds = x_bounds.filter(|_| k + 1 == t);
                self.run.advance(&self.design, sample.split_at(y.len()), bounds);
            }
        }
        self.run.doubts.elsewhere = Some(t);
    }

    /// Inputs of so many samples, all known.
    #[inline(always)]
    fn check_inputs(&self, argument: &'static str, u: &[f64], samples: usize) -> Result<(), Error> {
        if self.design.history.m() == 0 && u.is_empty() {
            return Ok(());
        }
        self.check_known(argument, u, samples)
    }

    #[cold]
    fn check_known(&self, argument: &'static str, u: &[f64], samples: usize) -> Result<(), Error> {
        let m = self.design.history.m();
        if u.len() != samples * m {
            let expected = match (m, samples) {
                (0, _) => "none, for a recording without inputs".to_string(),
                (m, 1) => format!("{m} numbers, the inputs at the instant of y"),
                (m, N) => format!("{N} samples of {m} inputs, as many as of Y"),
            };
            let found = if u.is_empty() { "none".into() } else { format!("{} numbers", u.len()) };
            return Err(Error::shape(argument, expected, found));
        }
        if m == 0 {
            return Ok(());
        }
        let shared = &self.design.problems[0].problem().shared;
        let far = u.chunks_exact(m).enumerate().find_map(|(row, u)| {
            let within = |(u, far): (&f64, f64)| u.is_finite() && far.abs() <= tol::MEASURABLE;
            let deviations = shared.input_deviations(u);
            let column = u.iter().zip(deviations).position(|entry| !within(entry))?;
            Some((row, column, u[column]))
        });
        match far {
            None => Ok(()),
            Some((row, column, value)) if !value.is_finite() => {
                Err(Error::NotFinite { argument, row, column, value })
            }
            Some((.., value)) => {
                let most = tol::MEASURABLE;
                let expected = format!(
                    "at most {most:.1e} standard deviations of the recording from its mean"
                );
                Err(Error::value(argument, expected, value))
            }
        }
    }
}
