//! What a recording alone determines of a run.

use crate::config::Bounds;
use crate::error::Error;
use crate::history::History;
use crate::rigid::choice::Choice;
use crate::rigid::config::{Refits, RigidConfig};
use crate::rigid::family::Fitted;
use crate::rigid::later::Later;
use crate::rigid::recorded_means::RecordedMeans;
use crate::rigid::recording::Recording;
use crate::rigid::wide::Wide;
use ddmhe_run::rigid::anchoring::Optima;
use ddmhe_run::rigid::layout::{INERTIA, TILT};
use ddmhe_run::rigid::small::inertia;
use ddmhe_run::rigid::stepper::last_fit;
use ddmhe_run::rigid::{Data, Limits, Posterior, Refit, Stepper};
use faer::{Mat, Side};

/// No body's smallest moment of inertia is less, its mean being 1.
const LEAST_MOMENT: f64 = 0.02;

/// What the recording alone determines.
pub(crate) struct Ground<M: Fitted<P, N>, const P: usize, const N: usize> {
    pub recording: Recording<P>,
    /// What is known of its samples; nothing where nothing has to be.
    pub known: Vec<M::Known>,
    /// Means over them, for fits in slices.
    means: Option<RecordedMeans<P>>,
    pub choice: Choice<M, N>,
    pub noise: [f64; P],
    pub refit: Option<Refit>,
    pub most: usize,
    pub limits: Option<Limits>,
    /// Of the recorded rates: half their deviations, and their ranges with a quarter more.
    pub half: [f64; 3],
    pub range: [[f64; 2]; 3],
    /// The machine's vector units.
    pub units: Wide,
    /// Whether it is looked for whether outputs lag.
    pub seeks_lag: bool,
}

impl<M: Fitted<P, N>, const P: usize, const N: usize> Ground<M, P, N> {
    pub fn new<const NA: usize>(history: &History, config: &RigidConfig) -> Result<Self, Error> {
        let recording = Recording::<P>::new(history, config)?;
        let p = history.p();
        let field = config.field.iter();
        let samples = field.flat_map(|field| (0..field.count()).map(move |k| field.at(k, p)));
        let known: Vec<_> = samples.map(|(B, K)| M::known(B, K)).collect();
        let choice = Choice::of::<P, NA>(&recording, of_all::<M, P, N>(&known));
        Ok(Self::on((recording, known), choice, config))
    }

    /// Where a choice has been made.
    pub fn on(
        (recording, known): (Recording<P>, Vec<M::Known>),
        choice: Choice<M, N>,
        config: &RigidConfig,
    ) -> Self {
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
        let in_means = refit == Some(Refit::Sliced) && !M::DRIVEN;
        let means = if in_means { RecordedMeans::of(&recording) } else { None };
        let (half, range) = spread(&recording.x);
        let most = config.optima;
        let units = Wide::new();
        let seeks_lag = M::SEEKS_LAG && config.output_lag.is_none() && choice.explained;
        Ground {
            recording,
            known,
            means,
            choice,
            noise,
            refit,
            most,
            limits,
            half,
            range,
            units,
            seeks_lag,
        }
    }

    /// Whether fits are asked what a lag would gain: not beside slices, which have no time.
    pub fn asks(&self) -> bool {
        self.seeks_lag && self.refit != Some(Refit::Sliced)
    }

    pub fn start(&self) -> Option<Stepper<M, P, N>> {
        let settings = (self.recording.size, self.recording.known, self.most);
        Stepper::new(&self.choice.optima, &self.noise, self.refit, settings)
    }

    /// The recording and what came since.
    pub fn data<'a>(&'a self, later: &'a Later<P>, known: &'a [M::Known]) -> Data<'a, P, M::Known> {
        Data {
            later: &later.outputs,
            rates: &later.rates,
            means: self.means.as_ref().map(|means| means.with(later)),
            of_later: self.noise,
            ..self.recording.data(of_all::<M, P, N>(known), 0.0)
        }
    }

    /// Nothing yet, with room for so many outputs: nothing is allocated later.
    pub fn nothing(&self, room: usize) -> Later<P> {
        Later::with_room(room, &self.noise, self.means.as_ref().map_or(1, RecordedMeans::every))
    }

    /// How many later outputs are kept.
    pub fn room(&self) -> usize {
        let last = last_fit(self.recording.y.len()) + 1;
        // slices of the last fits, and what is replayed after them
        if self.refit == Some(Refit::Sliced) { 2 * last } else { last }
    }
}

/// What is known of all samples, of which nothing may have to be.
fn of_all<M: Fitted<P, N>, const P: usize, const N: usize>(known: &[M::Known]) -> &[M::Known] {
    if M::DRIVEN { known } else { M::EVERYWHERE }
}

/// By what factor a braked body may turn faster than it has turned: √(largest / smallest moment of
/// inertia), with three deviations on either, of the optimum that allows most. Energy is not
/// gained.
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
