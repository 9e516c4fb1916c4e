//! A motion dω/dt = f(ω, θ) that an output y = h(ω, θ) shows, sample by sample, with the
//! derivatives of both with respect to z = (ω, θ).

use crate::rigid::small::Vector;
use core::ops::Range;

/// Unknowns that move the body come first in z, and are at most so many.
pub const MOVING: usize = 16;
/// The derivative of three numbers by the unknowns that move them.
pub type Slopes = [[f64; MOVING]; 3];

/// An entry of the derivative of one output: its place in z and its value; of one not used it is 0.
pub type Entry = (usize, f64);

/// How a step of one sample is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// Sample period (s).
    pub dt: f64,
    /// Substeps of the Runge-Kutta rule a sample; 0: one step of Euler's forward rule.
    pub substeps: usize,
    /// A motion faster than this runs away (rad/s, in the sum of the absolute values).
    pub limit: f64,
}

/// What fits of a motion are told beside its own numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Given<const N: usize> {
    /// Root-mean-square rate W of the recording (rad/s).
    pub W: f64,
    /// How steps are made.
    pub steps: Steps,
    /// Whether drag and output have a cubic part; without one its two γ are 0 and nothing depends
    /// on them.
    pub cubic: bool,
    /// Standard deviations of the prior of θ, mean 0; those of ω are not used: it has none.
    pub spread: [f64; N],
}

impl<const N: usize> Given<N> {
    /// n / W² of a cubic part, if there is one.
    #[inline(always)]
    pub fn of_cubic(&self, n: f64) -> f64 {
        if self.cubic { n / (self.W * self.W) } else { 0.0 }
    }
}

/// A family of motions of N unknowns with P outputs.
pub trait Motion<const P: usize, const N: usize> {
    /// What the unknowns determine.
    type Parts;
    /// What is known of a sample beside what was measured; nothing where a motion goes on by
    /// itself.
    type Known: Copy + 'static;
    /// What of it moves the body between two samples.
    type Drive;
    /// The derivative of one output, ω first.
    type Row: Copy + AsRef<[Entry]>;

    /// What is known of all samples where nothing has to be; none where something has.
    const EVERYWHERE: &'static [Self::Known];
    /// Whether something has to be known of every sample.
    const DRIVEN: bool = Self::EVERYWHERE.is_empty();

    /// What moves the body that share of the way between two samples.
    fn between(from: &Self::Known, to: &Self::Known, share: f64) -> Self::Drive;

    /// What its fits are told.
    fn given(&self) -> &Given<N>;

    /// Everything that z determines.
    fn parts(&self, z: &[f64; N]) -> Self::Parts;

    /// dω/dt.
    fn rate(&self, parts: &Self::Parts, drive: &Self::Drive, w: &Vector) -> Vector;

    /// dω/dt, and its derivative.
    fn slope(
        &self,
        parts: &Self::Parts,
        drive: &Self::Drive,
        w: &Vector,
        slopes: &mut Slopes,
    ) -> Vector;

    /// y.
    fn output(&self, parts: &Self::Parts, known: &Self::Known, w: &Vector) -> [f64; P];

    /// The derivative of y.
    fn rows(&self, parts: &Self::Parts, known: &Self::Known, w: &Vector) -> [Self::Row; P];
}

/// A family that a body's motion may be of: ω comes first in z, then the five numbers of its
/// inertia.
pub trait Family<const P: usize, const N: usize>: Motion<P, N> + Copy {
    /// Place of the P offsets of the outputs.
    const OFFSETS: usize;

    /// Places of parameters that wander by a share of their common size, of p outputs.
    fn sized(p: usize) -> impl Iterator<Item = Range<usize>>;

    /// Whether its drag and output may have a cubic part.
    const MAY_BE_CUBIC: bool = true;

    /// What its fits are told.
    fn given_mut(&mut self) -> &mut Given<N>;

    /// The same motion in coordinates of its own.
    fn rebased(&self, z: &[f64; N]) -> (Self, [f64; N]);

    /// Those coordinates.
    fn frame(&self) -> [f64; 9];

    /// In other coordinates.
    fn in_frame(&self, frame: &[f64; 9]) -> Self;

    /// The direction about which no turn is braked or shows, of length 1, if there is one.
    fn unseen(&self, z: &[f64; N]) -> Option<Vector>;

    /// By how long the outputs lag behind the motion, with its standard deviation (s), if they may.
    fn lag(&self, _: &[f64; N], _: &[[f64; N]; N]) -> Option<[f64; 2]> {
        None
    }

    /// Whether a motion is to be believed that explains all data.
    fn is_credible(&self, _: &[f64; N], _: &[[f64; N]; N]) -> bool {
        true
    }

    /// What would be known of the sample after the last two, if it went on as before.
    fn ahead(before: &Self::Known, last: &Self::Known) -> Self::Known;

    /// Whether offsets of the outputs are free; else they are within a tenth of the noise.
    fn has_offset(&self, noise: &[f64; P]) -> bool {
        self.given().spread[Self::OFFSETS] > noise[0]
    }

    /// Whether it is made by Euler's forward rule: a simulation, not a body.
    fn is_simulated(&self) -> bool {
        self.given().steps.substeps == 0
    }
}

/// Where a motion has come to.
#[derive(Debug, Clone, Copy)]
pub struct Moved {
    /// ω.
    pub w: Vector,
    /// dω/dt where it came from, of several substeps in the last.
    pub rate: Vector,
    /// By how much that would have changed on the way, had it gone on to change as it did there.
    pub bent: Vector,
}

impl Moved {
    /// Nowhere.
    pub fn still(w: Vector) -> Self {
        Moved { w, rate: [0.0; 3], bent: [0.0; 3] }
    }
}

/// ω so many samples later; None where it runs away.
#[inline(always)]
pub fn flow<const P: usize, const N: usize, M: Motion<P, N>>(
    motion: &M,
    parts: &M::Parts,
    (from, to): (&M::Known, &M::Known),
    samples: f64,
    mut w: Vector,
) -> Option<Moved> {
    let Steps { dt, substeps, limit } = motion.given().steps;
    if substeps == 0 {
        let rate = motion.rate(parts, &M::between(from, to, 0.0), &w);
        return Some(Moved { w: ahead(&w, dt, &rate, limit)?, rate, bent: [0.0; 3] });
    }
    let (h, mut rate, mut bent) = (dt * samples / substeps as f64, [0.0; 3], [0.0; 3]);
    for step in 0..substeps {
        let drive = |c: f64| M::between(from, to, (step as f64 + c) / substeps as f64);
        let at = |c: f64, k: &Vector| [0, 1, 2].map(|i| w[i] + c * k[i]);
        let k1 = motion.rate(parts, &drive(0.0), &w);
        let k2 = motion.rate(parts, &drive(0.5), &at(h / 2.0, &k1));
        let k3 = motion.rate(parts, &drive(0.5), &at(h / 2.0, &k2));
        let k4 = motion.rate(parts, &drive(1.0), &at(h, &k3));
        w = ahead(&w, h / 6.0, &combined(&k1, &k2, &k3, &k4), limit)?;
        (rate, bent) = (k1, change(&k1, &k3, &k4));
    }
    Some(Moved { w, rate, bent })
}

/// The same with dω(after)/d(ω, θ), in which the derivative by ω itself is that by ω before.
#[inline(always)]
pub fn flow_with_slopes<const P: usize, const N: usize, M: Motion<P, N>>(
    motion: &M,
    parts: &M::Parts,
    (from, to): (&M::Known, &M::Known),
    samples: f64,
    mut w: Vector,
    out: &mut Slopes,
) -> Option<Moved> {
    let Steps { dt, substeps, limit } = motion.given().steps;
    if substeps == 0 {
        let f = motion.slope(parts, &M::between(from, to, 0.0), &w, out);
        *out = from_identity(dt, out);
        return Some(Moved { w: ahead(&w, dt, &f, limit)?, rate: f, bent: [0.0; 3] });
    }
    let (h, mut rate, mut bent) = (dt * samples / substeps as f64, [0.0; 3], [0.0; 3]);
    for step in 0..substeps {
        let drive = |c: f64| M::between(from, to, (step as f64 + c) / substeps as f64);
        let (mut k, mut B) = ([[0.0; 3]; 4], [[[0.0; MOVING]; 3]; 4]);
        k[0] = motion.slope(parts, &drive(0.0), &w, &mut B[0]);
        for (stage, share, c) in [(1, 0.5, h / 2.0), (2, 0.5, h / 2.0), (3, 1.0, h)] {
            let z = [0, 1, 2].map(|i| w[i] + c * k[stage - 1][i]);
            let (before, now) = B.split_at_mut(stage);
            k[stage] = motion.slope(parts, &drive(share), &z, &mut now[0]);
            chain(c, &mut now[0], &before[stage - 1]);
        }
        w = ahead(&w, h / 6.0, &combined(&k[0], &k[1], &k[2], &k[3]), limit)?;
        (rate, bent) = (k[0], change(&k[0], &k[2], &k[3]));
        let mut sum = [[0.0; MOVING]; 3];
        for (i, row) in sum.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry = B[0][i][j] + 2.0 * (B[1][i][j] + B[2][i][j]) + B[3][i][j];
            }
        }
        let own = from_identity(h / 6.0, &sum);
        *out = if step == 0 { own } else { after(&own, out) };
    }
    Some(Moved { w, rate, bent })
}

/// h f'(0) of f(0), f(h/2) and f(h).
#[inline(always)]
fn change(k1: &Vector, k3: &Vector, k4: &Vector) -> Vector {
    [0, 1, 2].map(|i| 4.0 * (k3[i] - k1[i]) - (k4[i] - k1[i]))
}

/// k₁ + 2 (k₂ + k₃) + k₄
#[inline(always)]
fn combined(k1: &Vector, k2: &Vector, k3: &Vector, k4: &Vector) -> Vector {
    [0, 1, 2].map(|i| k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
}

/// w + h f, unless it runs away.
#[inline(always)]
fn ahead(w: &Vector, h: f64, f: &Vector, limit: f64) -> Option<Vector> {
    let next = [0, 1, 2].map(|i| w[i] + h * f[i]);
    (next[0].abs() + next[1].abs() + next[2].abs() < limit).then_some(next)
}

/// I + h A
#[inline(always)]
fn from_identity(h: f64, A: &Slopes) -> Slopes {
    let mut out = A.map(|row| row.map(|v| h * v));
    (0..3).for_each(|i| out[i][i] += 1.0);
    out
}

/// A + c A_ω B: the derivative of a stage at w + c k.
#[inline(always)]
fn chain(c: f64, A: &mut Slopes, B: &Slopes) {
    for row in A {
        let by = [c * row[0], c * row[1], c * row[2]];
        for (j, entry) in row.iter_mut().enumerate() {
            *entry += by[0] * B[0][j] + by[1] * B[1][j] + by[2] * B[2][j];
        }
    }
}

/// The derivative of a step that follows another.
#[inline(always)]
pub(super) fn after(own: &Slopes, before: &Slopes) -> Slopes {
    let mut out = *own;
    for (row, own) in out.iter_mut().zip(own) {
        row[..3].fill(0.0);
        for (j, entry) in row.iter_mut().enumerate() {
            *entry += own[0] * before[0][j] + own[1] * before[1][j] + own[2] * before[2][j];
        }
    }
    out
}
