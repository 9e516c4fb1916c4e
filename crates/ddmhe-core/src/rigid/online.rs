//! A run of the rigid body's estimator with P outputs.

use crate::config::Bounds;
use crate::error::Error;
use crate::estimate::{Estimate, Evidence, EvidenceKind};
use crate::history::History;
use crate::rigid::affine::affine_unknowns;
use crate::rigid::choice::Choice;
use crate::rigid::config::{Refits, RigidConfig};
use crate::rigid::recording::Recording;
use crate::rigid::report::Report;
use crate::rigid::saved::Saved;
use ddmhe_run::rigid::filter::DISAGREE;
use ddmhe_run::rigid::layout::unknowns;
use ddmhe_run::rigid::stepper::last_fit;
use ddmhe_run::rigid::{Data, Innovation, Limits, Refit, Stepper};
use ddmhe_run::{Reasons, Status};
use std::sync::Arc;

/// A run whatever the number of outputs is, which is a constant of its type.
pub(crate) trait Online: Send + Sync {
    /// Consumes y(t-1); whether there is a motion that foretells x(t). `estimate` says what it is.
    fn advance(&mut self, y: &[f64], estimate: &mut Estimate) -> bool;
    /// The moving average of the squared innovations.
    fn score(&self) -> f64;
    /// Fits all data anew; whether a rigid body explains them.
    fn refit(&mut self) -> bool;
    /// Leaves the rest of the run to another estimator.
    fn give_up(&mut self);
    /// Back to the recording's end.
    fn restart(&mut self);
    /// Whether there is a motion.
    fn is_rigid(&self) -> bool;
    /// Whether a rigid body explains the recording.
    fn explained(&self) -> bool;
    /// What is known of the body; None where no fit came to an end.
    fn report(&self) -> Option<Report>;
    /// What changes from step to step.
    fn saved(&self) -> Saved;
    /// Continues a saved run.
    fn resume(&mut self, saved: &Saved) -> Result<(), Error>;
    /// A run of its own from here.
    fn copy(&self) -> Box<dyn Online>;
}

/// What the recording alone determines.
struct Ground<const P: usize, const N: usize> {
    recording: Recording<P>,
    choice: Choice<P, N>,
    noise: [f64; P],
    refit: Option<Refit>,
    limits: Option<Limits>,
    /// Of the recorded rates: half their deviations, and their ranges with a quarter more.
    half: [f64; 3],
    range: [[f64; 2]; 3],
}

#[derive(Clone)]
struct Run<const P: usize, const N: usize> {
    ground: Arc<Ground<P, N>>,
    stepper: Option<Stepper<P, N>>,
    later: Vec<[f64; P]>,
}

/// A new run.
///
/// # Errors
/// [`Error::Value`] for a recording of zeros.
pub(crate) fn online(history: &History, config: &RigidConfig) -> Result<Box<dyn Online>, Error> {
    fn of<const P: usize, const N: usize, const NA: usize>(
        history: &History,
        config: &RigidConfig,
    ) -> Result<Box<dyn Online>, Error> {
        Ok(Box::new(Run::<P, N>::new::<NA>(history, config)?))
    }
    match history.p() {
        1 => of::<1, { unknowns(1) }, { affine_unknowns(1) }>(history, config),
        2 => of::<2, { unknowns(2) }, { affine_unknowns(2) }>(history, config),
        3 => of::<3, { unknowns(3) }, { affine_unknowns(3) }>(history, config),
        4 => of::<4, { unknowns(4) }, { affine_unknowns(4) }>(history, config),
        5 => of::<5, { unknowns(5) }, { affine_unknowns(5) }>(history, config),
        _ => of::<6, { unknowns(6) }, { affine_unknowns(6) }>(history, config),
    }
}

impl<const P: usize, const N: usize> Ground<P, N> {
    fn new<const NA: usize>(history: &History, config: &RigidConfig) -> Result<Self, Error> {
        let recording = Recording::<P>::new(history, config)?;
        let choice = Choice::of::<NA>(&recording);
        let mut noise = recording.of_later;
        for (own, recorded) in noise.iter_mut().zip(&recording.of_y) {
            *own = own.max(if choice.explained { 0.0 } else { recorded * choice.inflation });
        }
        let refit = choice.explained.then_some(match config.refit {
            Refits::Sliced => Refit::Sliced,
            Refits::Now => Refit::Now,
            Refits::Manual => Refit::Manual,
        });
        let limits = config.x_bounds.as_ref().map(|Bounds { lo, hi }| Limits {
            lo: [lo[0], lo[1], lo[2]],
            hi: [hi[0], hi[1], hi[2]],
        });
        let (half, range) = spread(&recording.x);
        Ok(Ground { recording, choice, noise, refit, limits, half, range })
    }

    fn start(&self) -> Option<Stepper<P, N>> {
        let settings = (self.recording.size, self.recording.known);
        Stepper::new(self.choice.optima, &self.noise, self.refit, settings)
    }

    /// The recording and what came since.
    fn data<'a>(&'a self, later: &'a [[f64; P]]) -> Data<'a, P> {
        Data { later, of_later: self.noise, ..self.recording.data(0.0) }
    }
}

/// Half the deviations of recorded rates, and their ranges with a quarter more on either side.
fn spread(x: &[[f64; 3]]) -> ([f64; 3], [[f64; 2]; 3]) {
    let count = x.len() as f64;
    let column = |i: usize| x.iter().map(move |w| w[i]);
    let half = [0, 1, 2].map(|i| {
        let mean = column(i).sum::<f64>() / count;
        0.5 * (column(i).map(|v| (v - mean) * (v - mean)).sum::<f64>() / count).sqrt()
    });
    let range = [0, 1, 2].map(|i| {
        let (lo, hi) = (column(i).fold(f64::MAX, f64::min), column(i).fold(f64::MIN, f64::max));
        let more = 0.25 * (hi - lo);
        [lo - more, hi + more]
    });
    (half, range)
}

impl<const P: usize, const N: usize> Run<P, N> {
    fn new<const NA: usize>(history: &History, config: &RigidConfig) -> Result<Self, Error> {
        let ground = Ground::new::<NA>(history, config)?;
        // up to the last fit nothing is allocated
        let stepper = ground.start();
        let last = last_fit(ground.recording.y.len());
        let room = if stepper.is_some() { last + 1 } else { 0 };
        Ok(Run { ground: Arc::new(ground), stepper, later: Vec::with_capacity(room) })
    }

    /// What the step found.
    fn tell(&self, said: &Innovation<P>, to: &mut Estimate) {
        let (Some(stepper), ground) = (&self.stepper, &self.ground) else { return };
        let filter = &stepper.filter;
        let w = filter.w();
        to.x.copy_from_slice(&w);
        to.window.copy_from_slice(&w);
        to.status = if filter.adapts() { Status::Adapting } else { Status::Structured };
        let squares = (0..P).map(|i| said.value[i] * said.value[i] / said.variance[i]);
        to.cost = squares.filter(|v| v.is_finite()).sum();
        let Some(evidence) = &mut to.evidence else { return };
        for i in 0..3 {
            evidence.covariance[3 * i..3 * i + 3].copy_from_slice(&filter.P[i][..3]);
        }
        let uncertain = (0..3).any(|i| filter.P[i][i].sqrt() > ground.half[i]);
        let outside = (0..3).any(|i| w[i] < ground.range[i][0] || w[i] > ground.range[i][1]);
        let reasons = [
            (Reasons::NOVEL, filter.adapts()),
            (Reasons::UNCERTAIN, uncertain),
            (Reasons::OUTSIDE, outside),
        ];
        let bits = reasons.iter().filter(|(_, there)| *there).map(|(reason, _)| reason.bits());
        evidence.reasons = Reasons::from_bits(bits.sum());
        evidence.value = filter.score;
        evidence.innovation.copy_from_slice(&said.value);
        evidence.innovation_variance.copy_from_slice(&said.variance);
        evidence.gated.copy_from_slice(&said.gated);
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

impl<const P: usize, const N: usize> Online for Run<P, N> {
    fn advance(&mut self, y: &[f64], estimate: &mut Estimate) -> bool {
        let Some(stepper) = &mut self.stepper else { return false };
        let mut sample = [0.0; P];
        sample.copy_from_slice(y);
        let (said, foretold) = stepper.advance(&mut sample);
        if foretold {
            self.later.push(sample);
            stepper.anchor(&self.ground.data(&self.later), self.ground.limits.as_ref());
        }
        if !foretold || stepper.filter.w().iter().any(|v| !v.is_finite()) {
            return false;
        }
        self.tell(&said, estimate);
        true
    }

    fn score(&self) -> f64 {
        self.stepper.as_ref().map_or(0.0, |stepper| stepper.filter.score)
    }

    fn refit(&mut self) -> bool {
        let data = self.ground.data(&self.later);
        self.stepper.as_mut().is_some_and(|stepper| stepper.fit_anew(&data))
    }

    fn give_up(&mut self) {
        self.stepper = None;
    }

    fn restart(&mut self) {
        self.stepper = self.ground.start();
        self.later.clear();
    }

    fn is_rigid(&self) -> bool {
        self.stepper.is_some()
    }

    fn explained(&self) -> bool {
        self.ground.choice.explained
    }

    fn report(&self) -> Option<Report> {
        let known = self.ground.recording.known;
        match &self.stepper {
            Some(own) => Some(Report::of(own.best()?, Some(&own.filter), &own.optima, known)),
            None => Some(Report::of(self.ground.choice.closest.as_ref()?, None, &[], known)),
        }
    }

    fn saved(&self) -> Saved {
        Saved::of(self.stepper.as_ref(), &self.later)
    }

    fn resume(&mut self, saved: &Saved) -> Result<(), Error> {
        let new = self.ground.start();
        (self.stepper, self.later) = saved.resumed(new, &self.ground.recording)?;
        if let Some(stepper) = &mut self.stepper {
            let ground = &self.ground;
            saved.resume_work(stepper, &ground.recording, &ground.data(&self.later))?;
        }
        Ok(())
    }

    fn copy(&self) -> Box<dyn Online> {
        Box::new(self.clone())
    }
}
