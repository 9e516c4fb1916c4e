//! What the fits are made of: recordings with p outputs, their noise, and where fits begin. In
//! types with room for more the other outputs are never measured, and their unknowns have a prior
//! alone.

use crate::error::Error;
use crate::history::History;
use crate::rigid::affine::{Affine, OUTPUT};
use crate::rigid::config::RigidConfig;
use crate::variation::{least_squares, noise_levels};
use ddmhe_run::rigid::layout::{DRAG, DRAG_CUBIC, GAIN, INERTIA, TILT, offset, output_cubic};
use ddmhe_run::rigid::motion::{Given, Steps};
use ddmhe_run::rigid::{Body, Data, Earlier, Firsts, Start};
use faer::{Mat, Side};

/// Largest angle that a substep turns by (rad).
const TURN: f64 = 0.08;
/// Outputs of a mean, at most.
const MEAN: f64 = 10.0;
/// One in so many samples of a recording is of its beginning.
const BEGINNING: usize = 4;
/// Faster than so many times the recording's W a motion runs away.
const RUNS_AWAY: f64 = 30.0;
/// Least noise, relative to a signal's size: it stands in for a recording without any.
const LEAST_NOISE: f64 = 1e-6;
/// Prior standard deviation of j.
pub(crate) const INERTIAS: f64 = 0.35;
/// Of r, in units of the size of y.
pub(crate) const OFFSETS: f64 = 0.1;
/// Of γ.
pub(crate) const GAMMA: f64 = 0.5;
/// Of β; of S, in units of W; of G and C, of (size of y)/W.
const SPREAD: [f64; 3] = [1.0, 0.3, 10.0];
/// Two draws of j from a standard normal distribution, from which fits begin, too.
const DRAWS: [[f64; 5]; 2] = [
    [
        -0.623_274_462_537_352_2,
        0.041_325_979_347_243_6,
        -2.325_030_774_638_834_3,
        -0.218_791_663_932_545_73,
        -1.245_910_947_253_065_2,
    ],
    [
        -0.128_534_662_944_034_26,
        1.366_463_470_549_685_9,
        -0.665_194_673_486_613_5,
        0.351_510_070_093_019_7,
        0.903_470_181_651_808_6,
    ],
];

/// One recording, or several of one body, the last of which the run goes on from.
#[derive(Debug, Clone)]
pub(crate) struct Recording<const P: usize> {
    /// How many outputs there are.
    pub p: usize,
    /// Rates and outputs of all, one recording after the other.
    pub x: Vec<[f64; 3]>,
    pub y: Vec<[f64; P]>,
    /// Number of outputs of each before the last.
    lengths: Vec<usize>,
    /// Root-mean-square rate W, and size of the outputs.
    pub W: f64,
    pub size: f64,
    /// Largest |ω| of the last recording: the energy that the run begins with is no more.
    pub fastest: f64,
    /// Of all.
    quickest: f64,
    steps: Steps,
    pub of_x: [f64; 3],
    pub of_y: [f64; P],
    pub of_later: [f64; P],
    pub of_rates: [f64; 3],
    pub known: bool,
    /// Affine least squares: y = C ω + r (p × 4, with r as the last column), ω̇ (3 × 4).
    seen: Mat<f64>,
    moved: Mat<f64>,
}

impl<const P: usize> Recording<P> {
    /// Of a checked history of three rates and at most P outputs.
    pub fn new(history: &History, config: &RigidConfig) -> Result<Self, Error> {
        let (p, all) = (history.p(), || 0..history.recordings());
        let rates = |i: usize| history.states(i).as_chunks::<3>().0;
        let outputs = |i: usize| history.outputs(i).chunks_exact(p).map(widened);
        let x: Vec<_> = all().flat_map(rates).copied().collect();
        let y: Vec<[f64; P]> = all().flat_map(outputs).collect();
        let lengths: Vec<_> = all().skip(1).map(|i| outputs(i - 1).len()).collect();
        let W = turn(&x);
        let own = fastest(rates(lengths.len()));
        let squares = all().flat_map(|i| history.outputs(i)).map(|v| v * v);
        let size = (squares.sum::<f64>() / (p * y.len()) as f64).sqrt();
        for (argument, size) in [("x", W), ("y", size)] {
            if !(size.is_finite() && size > 0.0) {
                return Err(Error::value(argument, "a body that turns", "nothing but zeros"));
            }
        }
        let (recorded_x, recorded_y) = noise_levels(history);
        let mut of_x = [0.0; 3];
        fill(&mut of_x, config.x_noise.as_deref(), &recorded_x, LEAST_NOISE * W);
        let (mut of_y, mut of_later) = ([f64::INFINITY; P], [f64::INFINITY; P]);
        fill(&mut of_y[..p], config.y_noise.as_deref(), &recorded_y, LEAST_NOISE * size);
        fill(&mut of_later[..p], config.output_noise.as_deref(), &of_y, LEAST_NOISE * size);
        let mut of_rates = [0.0; 3];
        fill(&mut of_rates, config.rate_noise.as_deref(), &of_x, LEAST_NOISE * W);
        let dt = history.dt();
        let pairs = |i: usize| rates(i).windows(2).map(|pair| (pair[0], pair[1]));
        let pairs: Vec<_> = all().flat_map(pairs).collect(); // as many as there are outputs
        let T = pairs.len();
        let regressors = Mat::from_fn(T, 4, |k, i| if i < 3 { pairs[k].0[i] } else { 1.0 });
        let shown = Mat::from_fn(T, p, |k, i| y[k][i]);
        let change = Mat::from_fn(T, 3, |k, i| (pairs[k].1[i] - pairs[k].0[i]) / dt);
        let seen = least_squares(&regressors, &shown, 0.0).transpose().to_owned();
        let moved = least_squares(&regressors, &change, 0.0).transpose().to_owned();
        let mut x = x;
        if config.field.as_ref().is_some_and(|field| field.count() == T) {
            x.truncate(T); // of the one recording: what leads to the last rate is not known
        }
        let known = config.x_noise.is_some() && config.y_noise.is_some();
        let (quickest, limit) = all().map(rates).fold((0.0, 0.0), |(most, limit), x| {
            (f64::max(most, fastest(x)), f64::max(limit, RUNS_AWAY * turn(x)))
        });
        let substeps = (dt * quickest / TURN).ceil().max(1.0) as usize;
        Ok(Recording {
            p,
            x,
            y,
            lengths,
            W,
            size,
            fastest: own,
            quickest,
            steps: Steps { dt, substeps, limit },
            of_x,
            of_y,
            of_later,
            of_rates,
            known,
            seen,
            moved,
        })
    }

    /// Without the outputs of the first quarter of each: sensors that lag may have been switched on
    /// with the recording, and still forget how they began.
    pub fn lose_beginnings(&mut self) {
        let (mut rest, all) = (&mut self.y[..], self.lengths.clone());
        for length in all {
            let (own, later) = rest.split_at_mut(length);
            own[..length / BEGINNING].fill([f64::NAN; P]);
            rest = later;
        }
        let beginning = rest.len() / BEGINNING;
        rest[..beginning].fill([f64::NAN; P]);
    }

    /// Rates and outputs of the last recording.
    fn last(&self) -> (&[[f64; 3]], &[[f64; P]]) {
        let before: usize = self.lengths.iter().sum();
        (&self.x[before + self.lengths.len()..], &self.y[before..])
    }

    /// The recordings before it.
    fn earlier(&self) -> Earlier<'_, P> {
        let before = self.y.len() - self.last().1.len();
        let x = &self.x[..before + self.lengths.len()];
        Earlier { x, y: &self.y[..before], lengths: &self.lengths }
    }

    /// Rates and outputs of each recording.
    pub fn parts(&self) -> impl Iterator<Item = (&[[f64; 3]], &[[f64; P]])> {
        let earlier = self.earlier();
        let before = (0..self.lengths.len()).filter_map(move |i| earlier.part(i));
        before.chain(core::iter::once(self.last()))
    }

    /// Their first rates, as they were recorded.
    fn firsts(&self) -> Firsts {
        let earlier = self.earlier();
        Firsts::of((0..self.lengths.len()).filter_map(|i| earlier.part(i)).map(|(x, _)| x[0]))
    }

    /// The recordings alone with what is known of their samples, their noise at least so many times
    /// their signals.
    pub fn data<'a, K>(&'a self, known: &'a [K], blurred: f64) -> Data<'a, P, K> {
        let (x, y) = self.last();
        Data {
            earlier: self.earlier(),
            x,
            y,
            later: &[],
            rates: &[],
            means: None,
            singles: None,
            known,
            of_x: self.of_x.map(|v| v.max(blurred * self.W)),
            of_y: self.of_y.map(|v| v.max(blurred * self.size)),
            of_later: self.of_later,
            of_rates: self.of_rates,
        }
    }

    /// Runge and Kutta's rule, in substeps.
    pub fn steps(&self) -> Steps {
        self.steps
    }

    /// How far recorded rates spread in the second of their principal directions, in units of their
    /// noise: near 1 they lie along a line.
    pub fn second_spread(&self) -> f64 {
        let count = self.x.len() as f64;
        let scaled = |i: usize| self.x.iter().map(move |w| w[i] / self.of_x[i]);
        let means = [0, 1, 2].map(|i| scaled(i).sum::<f64>() / count);
        let covariance = Mat::from_fn(3, 3, |i, k| {
            let both = scaled(i).zip(scaled(k));
            both.map(|(a, b)| (a - means[i]) * (b - means[k])).sum::<f64>() / count
        });
        let spreads = covariance.self_adjoint_eigenvalues(Side::Lower);
        spreads.map_or(f64::NAN, |spreads| spreads[1].max(0.0).sqrt())
    }

    /// Over how many outputs means may be for fits in slices: a motion turns by no more meanwhile
    /// than in a substep.
    pub fn every(&self) -> usize {
        (TURN / (self.steps.dt * self.quickest)).floor().clamp(1.0, MEAN) as usize
    }

    /// A body and where its fit begins: the unseen direction is one that the least-squares C shows
    /// little of, J the sphere's or drawn.
    pub fn body<const N: usize>(&self, trial: usize, cubic: bool) -> Start<Body<P, N>, N> {
        let C = self.seen.as_ref().subcols(0, 3);
        let b0 = self.little_seen(trial % 4);
        let N0 = complement(&b0);
        let (p, W, size) = (self.p, self.W, self.size);
        let [beta, S, G] = SPREAD;
        let mut spread = [1.0; N];
        spread[INERTIA..TILT].fill(INERTIAS);
        spread[TILT..DRAG].fill(beta);
        spread[DRAG..DRAG_CUBIC].fill(S * W);
        spread[DRAG_CUBIC] = GAMMA;
        spread[GAIN..GAIN + 2 * p].fill(G * size / W);
        spread[offset(P)..offset(P) + p].fill(OFFSETS * size);
        spread[output_cubic(P)] = GAMMA;
        let mut z = [0.0; N];
        z[..3].copy_from_slice(&self.last().0[0]);
        z[INERTIA..TILT].copy_from_slice(&drawn(trial));
        for i in 0..p {
            for k in 0..2 {
                z[GAIN + 2 * i + k] = (0..3).map(|l| C[(i, l)] * N0[l][k]).sum();
            }
        }
        let motion = Body { b0, N0, given: Given { W, steps: self.steps(), cubic, spread } };
        Start { motion, z, firsts: self.firsts() }
    }

    /// Of C's right singular vectors the last, the second, and the two between them.
    fn little_seen(&self, choice: usize) -> [f64; 3] {
        let C = self.seen.as_ref().subcols(0, 3);
        let Ok(svd) = C.svd() else { return [0.0, 0.0, 1.0] };
        let of = |k: usize| [0, 1, 2].map(|i| svd.V()[(i, k)]);
        let (second, last) = (of(1), of(2));
        let [a, b] = [[0.0, 1.0], [1.0, 0.0], [1.0, 1.0], [-1.0, 1.0]][choice];
        let length = f64::hypot(a, b);
        [0, 1, 2].map(|i| (a * second[i] + b * last[i]) / length)
    }

    /// The affine motion and where its fit begins.
    pub fn affine<const N: usize>(&self) -> Start<Affine<P, N>, N> {
        let (mut spread, mut z) = ([1.0; N], [0.0; N]);
        z[..3].copy_from_slice(&self.last().0[0]);
        for i in 0..3 {
            for k in 0..4 {
                z[3 + 4 * i + k] = self.moved[(i, k)];
                spread[3 + 4 * i + k] = if k < 3 { self.W } else { self.W * self.W };
            }
        }
        let (gains, offsets) = (OUTPUT, OUTPUT + 3 * P);
        for i in 0..self.p {
            (0..3).for_each(|k| z[gains + 3 * i + k] = self.seen[(i, k)]);
            z[offsets + i] = self.seen[(i, 3)];
        }
        spread[gains..gains + 3 * self.p].fill(SPREAD[2] * self.size / self.W);
        spread[offsets..offsets + self.p].fill(self.size);
        let given = Given { W: self.W, steps: self.steps(), cubic: false, spread };
        let motion = Affine { given };
        Start { motion, z, firsts: self.firsts() }
    }
}

/// Outputs of a sample; NaN is what there is room for beside them.
pub(crate) fn widened<const P: usize>(y: &[f64]) -> [f64; P] {
    let mut wide = [f64::NAN; P];
    wide[..y.len()].copy_from_slice(y);
    wide
}

/// Largest |ω|.
fn fastest(x: &[[f64; 3]]) -> f64 {
    x.iter().map(squared).fold(0.0, f64::max).sqrt()
}

/// Root-mean-square |ω|.
fn turn(x: &[[f64; 3]]) -> f64 {
    (x.iter().map(squared).sum::<f64>() / x.len() as f64).sqrt()
}

fn squared(w: &[f64; 3]) -> f64 {
    w.iter().map(|v| v * v).sum()
}

/// j where the fit of a trial begins: the sphere's, or drawn.
pub(crate) fn drawn(trial: usize) -> [f64; 5] {
    match trial {
        2 | 4 => DRAWS[trial / 2 - 1].map(|v| INERTIAS * v),
        _ => [0.0; 5],
    }
}

/// What was stated of each channel, else what was recorded; at least so much.
fn fill(to: &mut [f64], stated: Option<&[f64]>, recorded: &[f64], least: f64) {
    for (i, to) in to.iter_mut().enumerate() {
        let level = match stated {
            Some([one]) => *one,
            Some(each) => each[i],
            None => recorded[i],
        };
        *to = level.max(least);
    }
}

/// Two directions that make an orthonormal basis with b, by the reflection that takes b to an axis.
fn complement(b: &[f64; 3]) -> [[f64; 2]; 3] {
    let beta = if b[0] > 0.0 { -1.0 } else { 1.0 };
    let v = [1.0, b[1] / (b[0] - beta), b[2] / (b[0] - beta)];
    let tau = 2.0 / (1.0 + v[1] * v[1] + v[2] * v[2]);
    [0, 1, 2].map(|i| [1, 2].map(|k| f64::from(u8::from(i == k)) - tau * v[i] * v[k]))
}
