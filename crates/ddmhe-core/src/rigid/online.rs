//! A run of the rigid body's estimator with at most P outputs.

use crate::config::Bounds;
use crate::error::Error;
use crate::estimate::{Estimate, Evidence, EvidenceKind};
use crate::history::History;
use crate::rigid::affine::affine_unknowns;
use crate::rigid::choice::Choice;
use crate::rigid::config::{Refits, RigidConfig, is_of_rates};
use crate::rigid::family::Fitted;
use crate::rigid::recording::{Recording, widened};
use crate::rigid::report::Report;
#[cfg(feature = "serde")]
use crate::rigid::saved::Saved;
use ddmhe_run::rigid::anchoring::{OPTIMA, Optima};
use ddmhe_run::rigid::filter::DISAGREE;
use ddmhe_run::rigid::layout::{INERTIA, TILT, unknowns};
use ddmhe_run::rigid::pass::Units;
use ddmhe_run::rigid::small::{Matrix, Vector, inertia};
use ddmhe_run::rigid::stepper::last_fit;
use ddmhe_run::rigid::{Body, Data, Innovation, Limits, Posterior, Refit, Stepper};
use ddmhe_run::{Reasons, Status};
use faer::{Mat, Side};
use std::sync::Arc;

/// No body's smallest moment of inertia is less, its mean being 1.
const LEAST_MOMENT: f64 = 0.02;

/// A run whatever the number of outputs is, for which its type has room.
pub(crate) trait Online: Send + Sync {
    /// Consumes y(t-1), and rates of the same instant where they were measured; whether there is a
    /// motion that foretells x(t). `estimate` says what it is.
    fn advance(&mut self, y: &[f64], rates: Option<&[f64]>, estimate: &mut Estimate) -> bool;
    /// The box on ω.
    fn limits(&self) -> Option<Limits>;
    /// The moving average of the squared innovations.
    fn score(&self) -> f64;
    /// Fits all data anew; whether a rigid body explains them.
    fn refit(&mut self) -> bool;
    /// Leaves the rest of the run to another estimator.
    fn give_up(&mut self);
    /// Leaves every run to it.
    fn retire(&mut self);
    /// Back to the recording's end.
    fn restart(&mut self);
    /// Whether there is a motion.
    fn is_rigid(&self) -> bool;
    /// Whether a rigid body explains the recording.
    fn explained(&self) -> bool;
    /// Whether none explains the data of the latest fits, not even with as much noise as it leaves.
    fn doubted(&self) -> bool;
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

/// What the recording alone determines.
struct Ground<M, const P: usize, const N: usize> {
    recording: Recording<P>,
    choice: Choice<M, N>,
    noise: [f64; P],
    refit: Option<Refit>,
    most: usize,
    limits: Option<Limits>,
    /// Of the recorded rates: half their deviations, and their ranges with a quarter more.
    half: [f64; 3],
    range: [[f64; 2]; 3],
    /// The machine's vector units.
    units: Wide,
}

#[derive(Clone)]
struct Run<M, const P: usize, const N: usize> {
    ground: Arc<Ground<M, P, N>>,
    stepper: Option<Stepper<M, P, N>>,
    later: Vec<[f64; P]>,
    /// Rates that were measured with them; empty as long as none was.
    rates: Vec<[f64; 3]>,
}

/// What a recording of other than three rates leaves.
#[derive(Clone, Copy)]
struct NoBody;

impl Online for NoBody {
    fn advance(&mut self, _: &[f64], _: Option<&[f64]>, _: &mut Estimate) -> bool {
        false
    }

    fn limits(&self) -> Option<Limits> {
        None
    }

    fn score(&self) -> f64 {
        0.0
    }

    fn refit(&mut self) -> bool {
        false
    }

    fn give_up(&mut self) {}

    fn retire(&mut self) {}

    fn restart(&mut self) {}

    fn is_rigid(&self) -> bool {
        false
    }

    fn explained(&self) -> bool {
        false
    }

    fn doubted(&self) -> bool {
        false
    }

    fn report(&self) -> Option<Report> {
        None
    }

    #[cfg(feature = "serde")]
    fn saved(&self) -> Saved {
        Saved::default()
    }

    #[cfg(feature = "serde")]
    fn resume(&mut self, _: &Saved) -> Result<(), Error> {
        Ok(())
    }

    fn copy(&self) -> Box<dyn Online> {
        Box::new(*self)
    }
}

/// A new run, in the narrowest of three types that has room for the outputs: each is a quarter of a
/// megabyte of machine code.
///
/// # Errors
/// [`Error::Value`] for a recording of zeros.
pub(crate) fn online(history: &History, config: &RigidConfig) -> Result<Box<dyn Online>, Error> {
    fn of<const P: usize, const N: usize, const NA: usize>(
        history: &History,
        config: &RigidConfig,
    ) -> Result<Box<dyn Online>, Error> {
        Ok(Box::new(Run::<Body<P, N>, P, N>::new::<NA>(history, config)?))
    }
    if !is_of_rates(history) {
        return Ok(Box::new(NoBody));
    }
    match history.p() {
        1 => of::<1, { unknowns(1) }, { affine_unknowns(1) }>(history, config),
        2 | 3 => of::<3, { unknowns(3) }, { affine_unknowns(3) }>(history, config),
        _ => of::<6, { unknowns(6) }, { affine_unknowns(6) }>(history, config),
    }
}

/// The widest that the machine has.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wide(pulp::Arch);

impl Units for Wide {
    #[inline(always)]
    fn run<R>(&self, work: impl FnOnce() -> R) -> R {
        self.0.dispatch(work)
    }
}

impl<M: Fitted<P, N>, const P: usize, const N: usize> Ground<M, P, N> {
    fn new<const NA: usize>(history: &History, config: &RigidConfig) -> Result<Self, Error> {
        let recording = Recording::<P>::new(history, config)?;
        let choice = Choice::of::<P, NA>(&recording, M::EVERYWHERE);
        let mut noise = recording.of_later;
        for (own, recorded) in noise.iter_mut().zip(&recording.of_y) {
            *own = own.max(if choice.explained { 0.0 } else { recorded * choice.inflation });
        }
        let refit = choice.explained.then_some(match config.refit {
            Refits::Sliced => Refit::Sliced,
            Refits::Now => Refit::Now,
            Refits::Manual => Refit::Manual,
        });
        let limits = match &config.x_bounds {
            Some(Bounds { lo, hi }) => {
                Some(Limits { lo: [lo[0], lo[1], lo[2]], hi: [hi[0], hi[1], hi[2]] })
            }
            None if choice.explained => {
                let most = fastest(&choice.optima) * (recording.fastest + 3.0 * recording.of_x[0]);
                Some(Limits { lo: [-most; 3], hi: [most; 3] })
            }
            None => None,
        };
        let (half, range) = spread(&recording.x);
        let most = config.optima;
        let units = Wide(pulp::Arch::new());
        Ok(Ground { recording, choice, noise, refit, most, limits, half, range, units })
    }

    fn start(&self) -> Option<Stepper<M, P, N>> {
        let settings = (self.recording.size, self.recording.known, self.most);
        Stepper::new(&self.choice.optima, &self.noise, self.refit, settings)
    }

    /// The recording and what came since.
    fn data<'a>(&'a self, later: &'a [[f64; P]], rates: &'a [[f64; 3]]) -> Data<'a, P, M::Known> {
        Data { later, rates, of_later: self.noise, ..self.recording.data(M::EVERYWHERE, 0.0) }
    }

    /// How many later outputs are kept.
    fn room(&self) -> usize {
        let last = last_fit(self.recording.y.len()) + 1;
        // slices of the last fits, and what is replayed after them
        if self.refit == Some(Refit::Sliced) { 2 * last } else { last }
    }
}

/// By what factor a braked body may turn faster than it has turned: √(largest / smallest moment of
/// inertia), with three deviations on either, of the optimum that allows most. Energy is not gained.
fn fastest<M, const N: usize>(optima: &Optima<M, N>) -> f64 {
    let of = |found: &Posterior<M, N>| {
        let J = inertia(&found.z[INERTIA..TILT]);
        let spread: f64 = (INERTIA..TILT).map(|i| found.P[i][i]).sum::<f64>().sqrt();
        let moments = Mat::from_fn(3, 3, |i, k| J[i][k]).self_adjoint_eigenvalues(Side::Lower);
        let Ok(moments) = moments else { return f64::INFINITY };
        let (least, most) = (moments[0] - 3.0 * spread, moments[2] + 3.0 * spread);
        // two moments exceed the third
        (most.min(1.5) / least.max(LEAST_MOMENT)).sqrt()
    };
    optima.iter().flatten().map(of).fold(1.0, f64::max)
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

impl<M: Fitted<P, N>, const P: usize, const N: usize> Run<M, P, N> {
    fn new<const NA: usize>(history: &History, config: &RigidConfig) -> Result<Self, Error> {
        let ground = Ground::new::<NA>(history, config)?;
        let stepper = ground.start();
        // nothing is allocated later
        let room = if stepper.is_some() { ground.room() } else { 0 };
        let (later, rates) = (Vec::with_capacity(room), Vec::with_capacity(room));
        Ok(Run { ground: Arc::new(ground), stepper, later, rates })
    }

    /// Keeps what was measured as long as there may be a fit of it.
    fn keep(&mut self, y: [f64; P], rates: Option<[f64; 3]>) {
        let Some(stepper) = &mut self.stepper else { return };
        let room = self.ground.room();
        let gap = stepper.t > self.later.len() + 1;
        if stepper.refit != Some(Refit::Manual) && (gap || self.later.len() >= room) {
            stepper.work = None;
            return;
        }
        self.later.push(y);
        if let (Some(x), true) = (rates, self.rates.is_empty()) {
            self.rates.resize(self.later.len() - 1, [f64::NAN; 3]);
            self.rates.push(x);
        } else if !self.rates.is_empty() {
            self.rates.push(rates.unwrap_or([f64::NAN; 3]));
        }
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
    fn advance(&mut self, y: &[f64], rates: Option<&[f64]>, estimate: &mut Estimate) -> bool {
        let Some(stepper) = &mut self.stepper else { return false };
        let mut sample = widened(y);
        let mut rates = rates.map(|x| [x[0], x[1], x[2]]);
        let noise = self.ground.recording.of_rates;
        let (said, foretold) = self.ground.units.run(
            #[inline(always)]
            || stepper.advance(&mut sample, &M::EVERYWHERE[0], rates.as_mut().map(|x| (x, &noise))),
        );
        if foretold {
            self.keep(sample, rates);
        }
        let Some(stepper) = &mut self.stepper else { return false };
        if foretold {
            let data = self.ground.data(&self.later, &self.rates);
            stepper.anchor(&data, self.ground.limits.as_ref(), &self.ground.units);
        }
        let now = stepper.mixture.mean();
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
        let data = self.ground.data(&self.later, &self.rates);
        self.stepper.as_mut().is_some_and(|stepper| stepper.fit_anew(&data, &self.ground.units))
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
        self.rates.clear();
    }

    fn is_rigid(&self) -> bool {
        self.stepper.is_some()
    }

    fn explained(&self) -> bool {
        self.ground.choice.explained
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
        Saved::of(self.stepper.as_ref(), &self.later, &self.rates)
    }

    #[cfg(feature = "serde")]
    fn resume(&mut self, saved: &Saved) -> Result<(), Error> {
        let new = self.ground.start();
        let room = self.ground.room();
        (self.stepper, self.later, self.rates) =
            saved.resumed(new, &self.ground.recording, room)?;
        if let Some(stepper) = &mut self.stepper {
            let ground = &self.ground;
            let data = ground.data(&self.later, &self.rates);
            saved.resume_work(stepper, &ground.recording, (&data, &ground.units))?;
        }
        Ok(())
    }

    fn copy(&self) -> Box<dyn Online> {
        Box::new(self.clone())
    }
}
