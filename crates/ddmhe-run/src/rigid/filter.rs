//! The Kalman filter over (ω, θ): one sample. About the motion of a fit it is the fit's own
//! linearisation, taken on to what was measured since; about its own estimate it is the extended
//! one.

use crate::panels::Root;
use crate::rigid::layout::outputs;
use crate::rigid::motion::{Entry, Family, MOVING, Motion, flow_with_slopes};
use crate::rigid::posterior::Posterior;
use crate::rigid::small::{Matrix, Vector};

/// An entry whose squared innovation is more than so many of its variances counts as not measured.
const GATE: f64 = 36.0;
/// As long as samples with such an entry are less than this share: many mean that the filter is
/// wrong.
const MANY: f64 = 0.3;
/// Weight of the newest sample in moving averages.
const RATE: f64 = 0.03;
/// Largest mean square of innovations that counts for the score.
const MOST: f64 = 10.0;
/// Score above which model and data disagree.
pub const DISAGREE: f64 = 1.6;
/// What parameters then wander by at a sample, relative: the first per unit of the score, at most
/// the second.
const WANDER: (f64, f64) = (3e-4, 1e-2);
/// What nothing is more certain than after no member of the family explained all data, relative.
const DOUBT: f64 = 0.02;
/// Smallest variance: rounding.
const LEAST: f64 = 1e-24;
/// A bound that is left by less holds.
const TOUCHED: f64 = 1e-12;
/// How often ω is moved onto its most violated bound: each twice.
const MOVES: usize = 6;

/// What a sample said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation<const P: usize> {
    /// y less what was expected; NaN where not measured.
    pub value: [f64; P],
    /// Its variance.
    pub variance: [f64; P],
    /// Whether it was too wild to be true.
    pub gated: [bool; P],
}

/// Where the filter stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filter<const P: usize, const N: usize> {
    /// (ω, θ).
    pub z: [f64; N],
    /// Covariance of its error.
    pub P: [[f64; N]; N],
    /// What outputs and motion are linear about: the fit, and where its motion is by now. None: z.
    /// An extended filter takes every derivative at another estimate and so finds information that
    /// is not there: in seconds its bars are half as wide as a fit's to the same data.
    pub nominal: Option<[f64; N]>,
    /// Noise of the outputs.
    pub noise: [f64; P],
    /// How far rate and parameters wander, relative, where the score is bad.
    walk: [f64; N],
    /// The variance above which they do not.
    cap: [f64; N],
    /// Mean square of the innovations in units of their variance, a moving average.
    pub score: f64,
    /// Share of samples with a wild entry, a moving average.
    pub wild: f64,
    /// Share of measured rates with a wild entry, a moving average.
    pub wild_rates: f64,
}

/// Box on ω.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Lower bounds (rad/s).
    pub lo: Vector,
    /// Upper bounds (rad/s).
    pub hi: Vector,
}

impl<const P: usize, const N: usize> Filter<P, N> {
    /// From the end of a fit's data on.
    pub fn new<M: Family<P, N>>(found: &Posterior<M, N>, noise: &[f64; P]) -> Self {
        let (motion, mut z) = (&found.motion, found.z);
        z[..3].copy_from_slice(&found.w);
        let mut walk = motion.given().spread;
        walk[..3].fill(motion.given().W);
        let cap = walk.map(|v| v * v);
        let p = outputs(noise);
        for part in M::sized(p) {
            let size = z[part.clone()].iter().map(|v| v * v).sum::<f64>() / part.len() as f64;
            walk[part].fill(size.root());
        }
        walk[M::OFFSETS..M::OFFSETS + p].copy_from_slice(&noise[..p]);
        let (nominal, noise, score) = (None, *noise, 1.0);
        Filter { z, P: found.P, nominal, noise, walk, cap, score, wild: 0.0, wild_rates: 0.0 }
    }

    /// Is linear about where it stands, from now on.
    pub fn hold(&mut self) {
        self.nominal = Some(self.z);
    }

    /// Goes on where another stood: with its averages.
    pub fn inherit(&mut self, before: &Self) {
        self.score = before.score.min(1.0);
        (self.wild, self.wild_rates) = (before.wild, before.wild_rates);
    }

    /// ω.
    pub fn w(&self) -> Vector {
        [self.z[0], self.z[1], self.z[2]]
    }

    /// Whether the motion ran away.
    pub fn ran_away(&self) -> bool {
        !self.z[0].is_finite()
    }

    /// Covariance of the error of ω.
    pub fn of_w(&self) -> Matrix {
        [0, 1, 2].map(|i| [self.P[i][0], self.P[i][1], self.P[i][2]])
    }

    /// Whether model and data disagree.
    pub fn adapts(&self) -> bool {
        self.score > DISAGREE
    }

    /// Consumes y of the instant of ω: what it said. Wild entries of it become NaN.
    #[inline(always)]
    pub fn update<M: Motion<P, N>>(
        &mut self,
        motion: &M,
        known: &M::Known,
        y: &mut [f64; P],
    ) -> Innovation<P> {
        let (at, off) = self.about();
        let (parts, w) = (motion.parts(&at), [at[0], at[1], at[2]]);
        let mut expected = motion.output(&parts, known, &w);
        let rows = motion.rows(&parts, known, &w);
        if let Some(off) = &off {
            expected.iter_mut().zip(&rows).for_each(|(y, row)| *y += inner(row.as_ref(), off));
        }
        let (mut PH, mut said) = ([[0.0; N]; P], Innovation::NONE);
        let mut measured = false;
        for i in 0..P {
            if !y[i].is_finite() {
                continue;
            }
            measured = true;
            PH[i] = self.along(rows[i].as_ref());
            said.value[i] = y[i] - expected[i];
            said.variance[i] = inner(rows[i].as_ref(), &PH[i]) + self.noise[i] * self.noise[i];
            said.gated[i] = said.value[i] * said.value[i] > GATE * said.variance[i];
        }
        if measured {
            let any = said.gated.contains(&true);
            self.wild += RATE * (f64::from(u8::from(any)) - self.wild);
            if self.wild < MANY {
                (0..P).filter(|&i| said.gated[i]).for_each(|i| y[i] = f64::NAN);
            } else {
                said.gated = [false; P];
            }
            self.correct(&rows, &PH, &said, y);
        }
        if self.adapts() {
            self.nominal = None;
            let rate = (WANDER.0 * (self.score - 1.0)).min(WANDER.1);
            for i in 0..N {
                if self.P[i][i] < self.cap[i] {
                    self.P[i][i] += (rate * self.walk[i]) * (rate * self.walk[i]);
                }
            }
        }
        said
    }

    /// Consumes rates x that were measured at the instant of ω, NaN = not measured, and their
    /// noise. Wild entries of x become NaN.
    pub fn see(&mut self, x: &mut Vector, noise: &Vector) {
        let squared = |own: &Self, i: usize| {
            let (v, variance) = (x[i] - own.z[i], own.P[i][i] + noise[i] * noise[i]);
            (v * v, variance)
        };
        let wild = [0, 1, 2].map(|i| {
            let (square, variance) = squared(self, i);
            square > GATE * variance // false for NaN
        });
        if x.iter().all(|v| v.is_nan()) {
            return;
        }
        self.wild_rates += RATE * (f64::from(u8::from(wild.contains(&true))) - self.wild_rates);
        for i in 0..3 {
            if wild[i] && self.wild_rates < MANY {
                x[i] = f64::NAN;
            }
        }
        let (mut count, mut squares) = (0.0, 0.0);
        for i in (0..3).filter(|&i| x[i].is_finite()) {
            let (v, variance) = (x[i] - self.z[i], self.P[i][i] + noise[i] * noise[i]);
            let (gain, column) = (v / variance, self.P[i]);
            self.z.iter_mut().zip(&column).for_each(|(z, along)| *z += gain * along);
            for (row, by) in self.P.iter_mut().zip(column) {
                row.iter_mut().zip(&column).for_each(|(own, c)| *own -= by / variance * c);
            }
            (0..N).for_each(|k| self.P[k][k] = self.P[k][k].max(LEAST));
            (count, squares) = (count + 1.0, squares + v * v / variance);
        }
        if count > 0.0 {
            self.score += RATE * ((squares / count).min(MOST) - self.score);
        }
    }

    /// What derivatives are taken at, and how far z is off.
    #[inline(always)]
    fn about(&self) -> ([f64; N], Option<[f64; N]>) {
        let Some(at) = self.nominal else { return (self.z, None) };
        let mut off = self.z;
        off.iter_mut().zip(&at).for_each(|(z, at)| *z -= at);
        (at, Some(off))
    }

    /// P h
    #[inline(always)]
    fn along(&self, row: &[Entry]) -> [f64; N] {
        let mut sum = [0.0; N];
        for (at, v) in row {
            sum.iter_mut().zip(&self.P[*at]).for_each(|(sum, own)| *sum += v * own);
        }
        sum
    }

    /// The update by all entries that are left.
    #[inline(always)]
    fn correct<R: AsRef<[Entry]>>(
        &mut self,
        rows: &[R; P],
        PH: &[[f64; N]; P],
        said: &Innovation<P>,
        y: &[f64; P],
    ) {
        // V = L Lᵀ, u = L⁻¹ ν, K = L⁻¹ H P: z += Kᵀ u, P -= Kᵀ K
        let (mut L, mut u, mut K) = ([[0.0; P]; P], [0.0; P], [[0.0; N]; P]);
        let (mut count, mut squares) = (0.0, 0.0);
        for a in (0..P).filter(|&a| y[a].is_finite()) {
            count += 1.0;
            (u[a], K[a]) = (said.value[a], PH[a]);
            for b in (0..a).filter(|&b| y[b].is_finite()) {
                let known: f64 = (0..b).map(|q| L[a][q] * L[b][q]).sum();
                let l = (inner(rows[a].as_ref(), &PH[b]) - known) / L[b][b];
                L[a][b] = l;
                u[a] -= l * u[b];
                let (done, rest) = K.split_at_mut(a);
                rest[0].iter_mut().zip(&done[b]).for_each(|(v, b)| *v -= l * b);
            }
            let known: f64 = (0..a).map(|q| L[a][q] * L[a][q]).sum();
            let pivot = (said.variance[a] - known).max(f64::MIN_POSITIVE).root();
            L[a][a] = pivot;
            let by = 1.0 / pivot;
            u[a] *= by;
            K[a].iter_mut().for_each(|v| *v *= by);
            squares += u[a] * u[a];
        }
        if count == 0.0 {
            return;
        }
        self.score += RATE * ((squares / count).min(MOST) - self.score);
        for (K, u) in K.iter().zip(u) {
            self.z.iter_mut().zip(K).for_each(|(z, K)| *z += u * K);
        }
        for (i, row) in self.P.iter_mut().enumerate() {
            for K in &K {
                let by = K[i];
                row.iter_mut().zip(K).for_each(|(own, K)| *own -= by * K);
            }
            row[i] = row[i].max(LEAST);
        }
    }

    /// A sample ahead; false where the motion runs away.
    #[inline(always)]
    pub fn predict<M: Motion<P, N>>(&mut self, motion: &M, known: (&M::Known, &M::Known)) -> bool {
        let ((at, off), mut F) = (self.about(), [[0.0; MOVING]; 3]);
        let (parts, w) = (motion.parts(&at), [at[0], at[1], at[2]]);
        let Some(moved) = flow_with_slopes(motion, &parts, known, 1.0, w, &mut F) else {
            self.z[0] = f64::NAN;
            return false;
        };
        let mut w = moved.w;
        if let (Some(nominal), Some(off)) = (&mut self.nominal, off) {
            nominal[..3].copy_from_slice(&w);
            for (w, F) in w.iter_mut().zip(&F) {
                *w += F.iter().zip(&off).map(|(F, off)| F * off).sum::<f64>();
            }
        }
        self.z[..3].copy_from_slice(&w);
        let mut moved = [[0.0; N]; 3];
        for (row, F) in moved.iter_mut().zip(&F) {
            for (by, own) in F.iter().zip(&self.P) {
                row.iter_mut().zip(own).for_each(|(sum, v)| *sum += by * v);
            }
        }
        for (i, moved) in moved.iter().enumerate() {
            for (k, F) in F.iter().enumerate().skip(i) {
                let own: f64 = F.iter().zip(moved).map(|(F, v)| F * v).sum();
                (self.P[i][k], self.P[k][i]) = (own, own);
            }
            for (k, v) in moved.iter().enumerate().skip(3) {
                (self.P[i][k], self.P[k][i]) = (*v, *v);
            }
        }
        true
    }

    /// ω into its box along the metric of P, the parameters with it; what rounding leaves is cut.
    pub fn confine(&mut self, limits: &Limits) {
        for _ in 0..MOVES {
            let into = |i: usize| self.z[i].max(limits.lo[i]).min(limits.hi[i]) - self.z[i];
            let out = [into(0), into(1), into(2)];
            let mut i = usize::from(out[1].abs() > out[0].abs());
            if out[2].abs() > out[i].abs() {
                i = 2;
            }
            if !(out[i].abs() >= TOUCHED) {
                break;
            }
            let by = out[i] / self.P[i][i];
            let column = self.P[i];
            self.z.iter_mut().zip(column).for_each(|(z, along)| *z += along * by);
        }
        (0..3).for_each(|i| self.z[i] = self.z[i].max(limits.lo[i]).min(limits.hi[i]));
    }

    /// Nothing stays certain: no member of the family explains all data.
    pub fn doubt(&mut self) {
        (0..N).for_each(|i| self.P[i][i] += (DOUBT * self.walk[i]) * (DOUBT * self.walk[i]));
    }
}

impl<const P: usize> Innovation<P> {
    /// Of a sample without a measurement.
    pub const NONE: Self =
        Innovation { value: [f64::NAN; P], variance: [0.0; P], gated: [false; P] };
}

/// hᵀ v
#[inline(always)]
fn inner<const N: usize>(row: &[Entry], v: &[f64; N]) -> f64 {
    let mut sum = 0.0;
    row.iter().for_each(|(at, entry)| sum += entry * v[*at]);
    sum
}
