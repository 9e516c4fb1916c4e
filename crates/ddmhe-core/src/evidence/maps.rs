//! How the answer of one depth depends on x̄ and on the outputs, and what stated noise adds to it.

use crate::evidence::replay::deleted;
use crate::reduction::Reduced;
use crate::weights::Weights;
use ddmhe_run::evidence::formulas::chi_square;
use ddmhe_run::layout::Layout;
use faer::Mat;

/// Standard deviations that a V of stated noise may be above its mean, by Wilson and Hilferty: once
/// in a million windows.
const RARE: f64 = 4.75;

/// How the answer of one depth depends on x̄ and on the outputs, in scaled units.
pub(crate) struct Maps {
    pub carry: Mat<f64>,    // Φ (n × n)
    pub deleted: Mat<f64>,  // (p × p)
    pub of_prior: Mat<f64>, // what an error of x̄ makes of the innovation (p × n)
    pub noise: Noise,
}

/// What stated noise adds.
pub(crate) struct Noise {
    pub error: Mat<f64>,      // to Q₀ (n × n)
    pub innovation: Vec<f64>, // to the variances of the innovations (p)
    pub V: [f64; 2],          // mean and variance of V of it alone
}

impl Maps {
    /// `noise`: variances of the outputs beyond what the recording has (p).
    pub fn new(layout: Layout, reduced: &Reduced, weights: &Weights, noise: &[f64]) -> Self {
        let (n, p, K) = (layout.n, layout.p, &reduced.K);
        let rows = |first: usize, count: usize| reduced.A.subrows(first, count);
        let (last, newest) = (layout.x(layout.depth).start, layout.y(layout.depth - 1).start);
        let carry = rows(last, n) * K.subcols(0, n);
        let deleted = deleted(reduced, layout);
        let of_prior = &deleted * (rows(newest, p) * K.subcols(0, n));
        let noise = Noise::new(layout, reduced, weights, (&deleted, noise));
        Maps { carry, deleted, of_prior, noise }
    }
}

impl Noise {
    fn new(
        layout: Layout,
        Reduced { K, A, .. }: &Reduced,
        weights: &Weights,
        (deleted, noise): (&Mat<f64>, &[f64]),
    ) -> Self {
        let (n, p, m) = (layout.n, layout.p, layout.depth);
        let none = Noise { error: Mat::zeros(n, n), innovation: vec![0.0; p], V: [0.0; 2] };
        if noise.iter().all(|variance| *variance == 0.0) {
            return none;
        }
        let (last, newest) = (layout.x(m).start, layout.y(m - 1).start);
        let K_y = K.subcols(n, m * p);
        let (gain, of_newest) = (A.subrows(last, n) * K_y, A.subrows(newest, p) * K_y);
        let of = |k: usize| noise[k % p];
        let sum = |a: &dyn Fn(usize) -> f64| (0..m * p).map(|k| of(k) * a(k)).sum::<f64>();
        let error = Mat::from_fn(n, n, |i, j| sum(&|k| gain[(i, k)] * gain[(j, k)]));
        let left = Mat::from_fn(p, m * p, |i, k| {
            f64::from(u8::from(k == (m - 1) * p + i)) - of_newest[(i, k)]
        });
        let own = deleted * left;
        let innovation = (0..p).map(|i| sum(&|k| own[(i, k)] * own[(i, k)])).collect();
        // V = yᵀW (I - H) y
        let (mut mean, mut variance) = (0.0, 0.0);
        for k in 0..m {
            let W = weights.noise(m - k, &vec![true; p]);
            let W = W.transpose() * &W;
            let y = layout.y(k).start;
            for i in 0..p {
                let column = K_y.col(k * p + i);
                let fitted = |l: usize| A.row(y + l) * column;
                let own = W[(i, i)] - (0..p).map(|l| W[(i, l)] * fitted(l)).sum::<f64>();
                mean += noise[i] * own;
                variance += 2.0 * (noise[i] * own).powi(2);
            }
        }
        let unit = weights.unit;
        Noise { error, innovation, V: [unit * mean, unit * unit * variance] }
    }

    /// What V of it is above once in a million windows, as if it were χ² (Wilson and Hilferty).
    pub fn rare(&self) -> f64 {
        let [mean, variance] = self.V;
        let degrees = 2.0 * mean * mean / variance;
        if mean > 0.0 { mean / degrees * chi_square(degrees, RARE) } else { 0.0 }
    }
}
