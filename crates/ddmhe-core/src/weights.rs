//! The weights of the cost (17), scalar or of a certificate, in scaled units.

use crate::certificate::{Certificate, factor, norm};
use crate::config::Config;
use crate::defaults::Defaults;
use crate::error::Error;
use crate::panels::dot;
use faer::{Mat, Side};
use std::borrow::Cow;

/// 2ρ^m ‖x̂(t-m) - x̄‖²_P + Σ_j ρ^{j-1} ‖v̂(t-j)‖²_R in scaled units, cost in units of s_x².
#[derive(Debug, Clone)]
pub(crate) struct Weights {
    pub rho: f64,
    prior: Mat<f64>, // U with P = UᵀU: n × n
    noise: Mat<f64>, // U with R = UᵀU: p × p
    R: Mat<f64>,
    plain: bool, // P = I, R = μI
}

impl Weights {
    /// A certificate's weights, or scalar ones; `unit` is s_y² / s_x².
    pub fn new(config: &Config, rule: &Defaults, unit: f64, n: usize, p: usize) -> Result<Self, Error> {
        match &config.certificate {
            Some(c) => Weights::certified(c, unit, n, p)
                .ok_or_else(|| Error::value("certificate", "positive definite P and R", "others")),
            None => {
                let mu = config.mu.map_or(rule.mu, |mu| mu * unit);
                Ok(Weights::scalar(config.rho.unwrap_or(rule.rho), mu, n, p))
            }
        }
    }

    /// P = I, R = μI: (17) as printed.
    fn scalar(rho: f64, mu: f64, n: usize, p: usize) -> Self {
        let diagonal = |size: usize, value: f64| Mat::from_fn(size, size, |i, j| if i == j { value } else { 0.0 });
        Weights { rho, prior: diagonal(n, 1.0), noise: diagonal(p, mu.sqrt()), R: diagonal(p, mu), plain: true }
    }

    /// A certificate's P and R; `unit` is s_y² / s_x². None unless both are positive definite.
    fn certified(certificate: &Certificate, unit: f64, n: usize, p: usize) -> Option<Self> {
        let R = Mat::from_fn(p, p, |i, j| certificate.R[i * p + j] * unit);
        let noise = factor(&certificate.R, p)? * faer::Scale(unit.sqrt());
        Some(Weights { rho: certificate.eta, prior: factor(&certificate.P, n)?, noise, R, plain: false })
    }

    /// μ, or what comes nearest: the mean weight of an output channel.
    pub fn mu(&self) -> f64 {
        self.R.diagonal().column_vector().iter().sum::<f64>() / self.R.nrows() as f64
    }

    /// √ of the prior's weight in a window of depth m (n × n).
    pub fn prior(&self, depth: usize) -> Mat<f64> {
        &self.prior * faer::Scale((2.0 * self.rho.powi(depth as i32)).sqrt())
    }

    /// √ of the weight of y(t-j), j = `age` (p × p).
    pub fn noise(&self, age: usize, measured: &[bool]) -> Mat<f64> {
        self.factor(measured).as_ref() * faer::Scale(self.rho.powi(age as i32 - 1).sqrt())
    }

    /// The weight R of one sample (p × p, by rows, into `out`) without the channels that were not measured: these are free to be
    /// anything, so what is left for the others is the Schur complement of their block, and zeros.
    pub fn reduced(&self, measured: impl Fn(usize) -> bool, out: &mut [f64]) {
        let p = self.R.nrows();
        out.iter_mut().enumerate().for_each(|(k, r)| *r = self.R[(k / p, k % p)]);
        for q in (0..p).filter(|&q| !measured(q)) {
            let pivot = out[q * p + q];
            for i in (0..p).filter(|&i| i != q) {
                let part = out[i * p + q] / pivot;
                (0..p).for_each(|j| out[i * p + j] -= part * out[q * p + j]);
            }
            (0..p).for_each(|i| (out[i * p + q], out[q * p + i]) = (0.0, 0.0));
        }
    }

    /// What the weight of y(t-j), j = `age`, loses (p × p, by rows, into `out`) with the channels that were not measured.
    pub fn lost(&self, age: usize, measured: impl Fn(usize) -> bool, out: &mut [f64]) {
        let (p, discount) = (self.R.nrows(), self.rho.powi(age as i32 - 1));
        self.reduced(measured, out);
        out.iter_mut().enumerate().for_each(|(k, r)| *r = discount * (self.R[(k / p, k % p)] - *r));
    }

    /// U with UᵀU the weight of one sample, [`reduced`](Self::reduced) to what was measured.
    fn factor(&self, measured: &[bool]) -> Cow<'_, Mat<f64>> {
        if measured.iter().all(|&m| m) {
            return Cow::Borrowed(&self.noise);
        }
        let p = measured.len();
        let mut R = vec![0.0; p * p];
        self.reduced(|i| measured[i], &mut R);
        let seen: Vec<usize> = (0..p).filter(|&i| measured[i]).collect();
        let block = Mat::from_fn(seen.len(), seen.len(), |i, j| R[seen[i] * p + seen[j]]);
        let mut U = Mat::zeros(p, p);
        // R was factored at construction, so that no factorisation fails here.
        if let Ok(S) = block.llt(Side::Lower) {
            for j in 0..seen.len() {
                (0..=j).for_each(|i| U[(seen[i], seen[j])] = S.L()[(j, i)]);
            }
        }
        Cow::Owned(U)
    }

    /// μ ρ^{j-1} of (17) times a unit for each entry of an output window, oldest first; None with a certificate's matrices.
    pub fn scalar_noise(&self, depth: usize, unit: f64) -> Option<Vec<f64>> {
        let p = self.R.nrows();
        let weight = |row: usize| self.R[(0, 0)] * self.rho.powi((depth - 1 - row / p) as i32) * unit;
        self.plain.then(|| (0..depth * p).map(weight).collect())
    }

    /// ‖moved‖²_P.
    #[inline(always)]
    pub fn prior_size(&self, moved: &[f64]) -> f64 {
        if self.plain { dot(moved, moved) } else { norm(&self.prior, moved).powi(2) }
    }

    /// The second term of (17) for a certificate's R, of the fitted noise v (m·p, time-major, NaN where not measured), in units of
    /// s_x²; `block` is room for p × p numbers.
    pub fn noise_cost(&self, v: &[f64], block: &mut [f64]) -> f64 {
        let p = self.R.nrows();
        v.chunks_exact(p).fold(0.0, |sum, v| {
            self.reduced(|i| v[i].is_finite(), block);
            let known = |i: usize| if v[i].is_finite() { v[i] } else { 0.0 };
            let row = |i: usize| (0..p).map(|j| block[i * p + j] * known(j)).sum::<f64>();
            self.rho * sum + (0..p).map(|i| known(i) * row(i)).sum::<f64>()
        })
    }
}
