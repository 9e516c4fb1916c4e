//! A run of the rigid body's estimator with at most P outputs.

#[cfg(feature = "serde")]
use crate::error::Error;
use crate::estimate::{Estimate, Evidence, EvidenceKind};
use crate::rigid::family::Fitted;
use crate::rigid::ground::Ground;
use crate::rigid::later::Later;
use crate::rigid::measured::Measured;
use crate::rigid::recording::widened;
use crate::rigid::report::Report;
#[cfg(feature = "serde")]
use crate::rigid::saved::{Saved, wrong};
use crate::rigid::suspicion::suspects;
use ddmhe_run::rigid::anchoring::OPTIMA;
use ddmhe_run::rigid::filter::DISAGREE;
use ddmhe_run::rigid::pass::Units;
use ddmhe_run::rigid::small::{Matrix, Vector};
use ddmhe_run::rigid::{Innovation, Limits, Refit, Stepper};
use ddmhe_run::{Reasons, Status};
use std::sync::Arc;

/// A run whatever the number of outputs is, for which its type has room.
pub(crate) trait Online: Send + Sync {
    /// Consumes what was measured at t-1; whether there is a motion that foretells x(t). `estimate`
    /// says what it is.
    fn advance(&mut self, sample: &Measured<'_>, estimate: &mut Estimate) -> bool;
    /// The box on ω.
    fn limits(&self) -> Option<Limits>;
    /// The moving average of the squared innovations.
    fn score(&self) -> f64;
    /// Fits all data anew; whether a rigid body explains them.
    fn refit(&mut self) -> bool;
    /// Goes on with that as long as there is time; None where it has not ended.
    fn refit_while(&mut self, time_left: &mut dyn FnMut() -> bool) -> Option<bool>;
    /// Leaves the rest of the run to another estimator.
    fn give_up(&mut self);
    /// Leaves every run to it.
    fn retire(&mut self);
    /// Back to the recording's end.
    fn restart(&mut self);
    /// Tells another run all that was measured, if that was kept; whether it foretells all of it.
    fn tell_all(&self, other: &mut dyn Online, estimate: &mut Estimate) -> bool;
    /// Whether there is a motion.
    fn is_rigid(&self) -> bool;
    /// Whether a rigid body explains the recording.
    fn explained(&self) -> bool;
    /// Whether outputs may be found to lag.
    fn seeks_lag(&self) -> bool;
    /// Whether the latest fit says that they do, if it is time to ask.
    fn suspects_lag(&mut self) -> bool;
    /// Whether it is credible where it explains all data.
    fn credible(&self) -> bool;
    /// Whether none explains the data of the latest fits, not even with as much noise as it leaves.
    fn doubted(&self) -> bool;
    /// [`Recording::second_spread`](crate::rigid::recording::Recording::second_spread), of a body
    /// that explains the recording and is seen by nothing but its own turns.
    fn second_spread(&self) -> Option<f64>;
    /// What is known of the body; None where no fit came to an end.
    fn report(&self) -> Option<Report>;
    /// What changes from step to step.
    #[cfg(feature = "serde")]
    fn saved(&self) -> Saved;
    /// Continues a saved run.
    #[cfg(feature = "serde")]
    fn resume(&mut self, saved: &Saved) -> Result<(), Error>;
    /// A run of its own from here.
    fn copy(&self) -> Box<dyn Online>;
}

/// A fit is asked whether outputs lag that is of so many times as many later outputs as the last
/// that was.
const AGAIN: usize = 2;

/// A run with at most P outputs.
#[derive(Clone)]
pub(crate) struct Run<M: Fitted<P, N>, const P: usize, const N: usize> {
    ground: Arc<Ground<M, P, N>>,
    stepper: Option<Stepper<M, P, N>>,
    later: Later<P>,
    /// What is known of all samples, and of the last two; nothing where nothing has to be.
    known: Vec<M::Known>,
    recent: Option<[M::Known; 2]>,
    /// How many later outputs the fit was of that was asked last whether outputs lag.
    asked: usize,
}

impl<M: Fitted<P, N>, const P: usize, const N: usize> Run<M, P, N> {
    pub fn on(ground: Ground<M, P, N>) -> Self {
        let stepper = ground.start();
        let room = if stepper.is_some() { ground.room() } else { 0 };
        let later = ground.nothing(room);
        let driven = if M::DRIVEN { ground.known.len() + room } else { 0 };
        let (known, recent) = (Vec::with_capacity(driven), None);
        let mut run = Run { ground: Arc::new(ground), stepper, later, known, recent, asked: 0 };
        run.know_the_recording();
        run
    }

    /// Forgets what was known of later samples.
    fn know_the_recording(&mut self) {
        self.known.clear();
        self.known.extend_from_slice(&self.ground.known);
        self.recent = self.known.last_chunk().copied();
    }

    /// Takes a driven motion to the sample of which this is known; false where it runs away.
    fn arrive(&mut self, known: M::Known) -> bool {
        let (Some(stepper), Some(recent)) = (&mut self.stepper, &mut self.recent) else {
            return true;
        };
        let recording = &self.ground.recording;
        let before = stepper.t > 0 || recording.x.len() == recording.y.len();
        if before {
            recent[0] = recent[1];
        }
        recent[1] = known;
        let limits = self.ground.limits.as_ref();
        !before || stepper.mixture.arrive((&recent[0], &recent[1]), limits)
    }

    /// Keeps what was measured as long as there may be a fit of it.
    fn keep(&mut self, y: [f64; P], rates: Option<[f64; 3]>, known: M::Known) {
        let Some(stepper) = &mut self.stepper else { return };
        let room = self.ground.room();
        let kept = self.later.outputs.len();
        let gap = stepper.t > kept + 1;
        if stepper.refit != Some(Refit::Manual) && (gap || kept >= room) {
            stepper.work = None;
            return;
        }
        if M::DRIVEN {
            self.known.truncate(self.ground.recording.y.len() + kept);
            self.known.push(known);
        }
        self.later.push(y, rates);
    }

    /// What a saved run knew of later samples.
    #[cfg(feature = "serde")]
    fn know_again(&mut self, saved: &Saved) -> Result<(), Error> {
        self.know_the_recording();
        if !M::DRIVEN || self.stepper.is_none() {
            return Ok(());
        }
        let whole = saved.known.len().is_multiple_of(M::NUMBERS);
        if !whole || saved.known.iter().any(|v| !v.is_finite()) {
            return Err(wrong());
        }
        let numbers = saved.known.chunks(M::NUMBERS);
        let read = numbers.map(|numbers| M::known(&numbers[..3], &numbers[3..]));
        let read = read.collect::<Vec<_>>();
        let (later, recent) = read.split_last_chunk().ok_or_else(wrong)?;
        let recorded = self.ground.recording.y.len();
        let all = later.len() == self.later.outputs.len()
            || (self.later.outputs.is_empty() && recorded + later.len() == self.known.len());
        if !all {
            return Err(wrong());
        }
        self.known.truncate(recorded);
        self.known.extend_from_slice(later);
        self.recent = Some(*recent);
        Ok(())
    }

    /// What the step found.
    fn tell(&self, said: &Innovation<P>, (w, covariance): (Vector, Matrix), to: &mut Estimate) {
        let (Some(stepper), ground) = (&self.stepper, &self.ground) else { return };
        let Some(filter) = stepper.leading().map(|leading| &leading.filter) else { return };
        to.x.copy_from_slice(&w);
        to.window.copy_from_slice(&w);
        to.status = if filter.adapts() { Status::Adapting } else { Status::Structured };
        let squares = (0..P).map(|i| said.value[i] * said.value[i] / said.variance[i]);
        to.cost = squares.filter(|v| v.is_finite()).sum();
        let Some(evidence) = &mut to.evidence else { return };
        evidence.covariance.copy_from_slice(covariance.as_flattened());
        let uncertain = (0..3).any(|i| covariance[i][i].sqrt() > ground.half[i]);
        let outside = (0..3).any(|i| w[i] < ground.range[i][0] || w[i] > ground.range[i][1]);
        let reasons = [
            (Reasons::NOVEL, filter.adapts() || stepper.unexplained),
            (Reasons::UNCERTAIN, uncertain),
            (Reasons::OUTSIDE, outside),
        ];
        let bits = reasons.iter().filter(|(_, there)| *there).map(|(reason, _)| reason.bits());
        evidence.reasons = Reasons::from_bits(bits.sum());
        evidence.value = filter.score;
        let p = ground.recording.p;
        evidence.innovation.copy_from_slice(&said.value[..p]);
        evidence.innovation_variance.copy_from_slice(&said.variance[..p]);
        evidence.gated.copy_from_slice(&said.gated[..p]);
    }
}

/// An estimate with room for P outputs' evidence.
pub(crate) fn blank(p: usize) -> Estimate {
    Estimate {
        x: vec![0.0; 3],
        window: vec![0.0; 3],
        evidence: Some(Evidence {
            covariance: vec![0.0; 9],
            kind: EvidenceKind::Nis,
            limit: DISAGREE,
            innovation: vec![f64::NAN; p],
            innovation_variance: vec![0.0; p],
            stuck: vec![false; p],
            gated: vec![false; p],
            ..Evidence::default()
        }),
        ..Estimate::default()
    }
}

impl<M: Fitted<P, N>, const P: usize, const N: usize> Online for Run<M, P, N> {
    fn advance(&mut self, given: &Measured<'_>, estimate: &mut Estimate) -> bool {
        let (B, K) = given.field.unwrap_or_default();
        let known = M::known(B, K);
        let arrived = !M::DRIVEN || self.arrive(known);
        let Some(stepper) = &mut self.stepper else { return false };
        let mut sample = widened(given.y);
        let mut rates = given.x.map(|x| [x[0], x[1], x[2]]);
        let noise = self.ground.recording.of_rates;
        let (said, foretold) = self.ground.units.run(
            #[inline(always)]
            || stepper.advance(&mut sample, &known, rates.as_mut().map(|x| (x, &noise))),
        );
        let foretold = foretold && arrived;
        if foretold {
            self.keep(sample, rates, known);
        }
        let Some(stepper) = &mut self.stepper else { return false };
        if foretold {
            let data = self.ground.data(&self.later, &self.known);
            stepper.anchor(&data, self.ground.limits.as_ref(), &self.ground.units);
        }
        let now = match &self.recent {
            Some([before, last]) => {
                let next = M::ahead(before, last);
                stepper.mixture.mean_ahead((last, &next), self.ground.limits.as_ref())
            }
            None => stepper.mixture.mean(),
        };
        if !foretold || now.0.iter().any(|v| !v.is_finite()) {
            return false;
        }
        self.tell(&said, now, estimate);
        true
    }

    fn limits(&self) -> Option<Limits> {
        self.ground.limits
    }

    fn score(&self) -> f64 {
        let leading = self.stepper.as_ref().and_then(|stepper| stepper.leading());
        leading.map_or(0.0, |leading| leading.filter.score)
    }

    fn refit(&mut self) -> bool {
        let data = self.ground.data(&self.later, &self.known);
        self.stepper.as_mut().is_some_and(|stepper| stepper.fit_anew(&data, &self.ground.units))
    }

    fn refit_while(&mut self, time_left: &mut dyn FnMut() -> bool) -> Option<bool> {
        let ground = &self.ground;
        let data = ground.data(&self.later, &self.known);
        let Some(stepper) = &mut self.stepper else { return Some(false) };
        stepper.fit_while(&data, ground.limits.as_ref(), &ground.units, time_left)
    }

    fn give_up(&mut self) {
        self.stepper = None;
    }

    fn retire(&mut self) {
        self.stepper = None;
        if let Some(ground) = Arc::get_mut(&mut self.ground) {
            ground.choice.optima = [const { None }; OPTIMA];
        }
    }

    fn restart(&mut self) {
        self.stepper = self.ground.start();
        self.later.clear();
        self.know_the_recording();
        self.asked = 0;
    }

    fn tell_all(&self, other: &mut dyn Online, estimate: &mut Estimate) -> bool {
        let Later { outputs, rates, .. } = &self.later;
        let all = self.stepper.as_ref().is_some_and(|stepper| stepper.t == outputs.len());
        let mut samples = outputs.iter().enumerate().map(|(k, y)| {
            let x = rates.get(k).map(|x| &x[..]);
            Measured { y: &y[..self.ground.recording.p], x, field: None }
        });
        all && !M::DRIVEN && samples.all(|sample| other.advance(&sample, estimate))
    }

    fn is_rigid(&self) -> bool {
        self.stepper.is_some()
    }

    fn explained(&self) -> bool {
        self.ground.choice.explained
    }

    fn second_spread(&self) -> Option<f64> {
        let alone = self.is_rigid() && self.explained() && !M::DRIVEN;
        alone.then(|| self.ground.recording.second_spread())
    }

    fn seeks_lag(&self) -> bool {
        self.ground.seeks_lag
    }

    fn suspects_lag(&mut self) -> bool {
        let Some(stepper) = self.stepper.as_ref().filter(|_| self.ground.asks()) else {
            return false;
        };
        let of = stepper.mixture.of;
        if stepper.work.is_some() || of == 0 || of < AGAIN * self.asked {
            return false;
        }
        let data = self.ground.data(&self.later, &self.known);
        let (end, units) = (data.y.len() + of, &self.ground.units);
        let fit = stepper.leading().map(|leading| leading.found.start());
        let found = fit.and_then(|fit| suspects(&fit, &data, end, units));
        if found.is_some() {
            self.asked = of;
        }
        found == Some(true)
    }

    fn credible(&self) -> bool {
        let leading = self.stepper.as_ref().and_then(|stepper| stepper.leading());
        leading.is_some_and(|leading| {
            let found = &leading.found;
            found.motion.is_credible(&found.z, &found.P)
        })
    }

    fn doubted(&self) -> bool {
        self.stepper.as_ref().is_some_and(|stepper| stepper.unexplained)
    }

    fn report(&self) -> Option<Report> {
        let known = self.ground.recording.known;
        match &self.stepper {
            Some(own) => Report::of_run(&own.mixture, known),
            None => Some(Report::of_fit(self.ground.choice.closest.as_ref()?, known)),
        }
    }

    #[cfg(feature = "serde")]
    fn saved(&self) -> Saved {
        let known = self.known.get(self.ground.recording.y.len()..).unwrap_or(&[]);
        let known = known.iter().chain(self.recent.iter().flatten()).flat_map(M::numbers);
        let mut saved = Saved::of(self.stepper.as_ref(), &self.later, known.collect());
        saved.asked = self.asked;
        saved
    }

    #[cfg(feature = "serde")]
    fn resume(&mut self, saved: &Saved) -> Result<(), Error> {
        let new = self.ground.start();
        let nothing = self.ground.nothing(self.ground.room());
        (self.stepper, self.later) = saved.resumed(new, &self.ground.recording, nothing)?;
        self.asked = saved.asked;
        self.know_again(saved)?;
        if let Some(stepper) = &mut self.stepper {
            let ground = &self.ground;
            let data = ground.data(&self.later, &self.known);
            saved.resume_work(stepper, &ground.recording, (&data, &ground.units))?;
        }
        Ok(())
    }

    fn copy(&self) -> Box<dyn Online> {
        Box::new(self.clone())
    }
}
