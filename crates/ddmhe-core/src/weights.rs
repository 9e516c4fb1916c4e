//! The weights of the cost (17), scalar or of a certificate, in scaled units.

use crate::certificate::{Certificate, factor, norm};
use crate::config::Config;
use crate::defaults::Defaults;
use crate::error::Error;
use faer::linalg::solvers::DenseSolveCore;
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

    /// U with UᵀU the weight of one sample. A channel that was not measured is free to be anything: what is left for the others
    /// is the Schur complement of its block.
    fn factor(&self, measured: &[bool]) -> Cow<'_, Mat<f64>> {
        if measured.iter().all(|&m| m) {
            return Cow::Borrowed(&self.noise);
        }
        let p = measured.len();
        let seen: Vec<usize> = (0..p).filter(|&i| measured[i]).collect();
        // The inverse of a Schur complement is a block of the inverse.
        let block = |M: &Mat<f64>| Mat::from_fn(seen.len(), seen.len(), |i, j| M[(seen[i], seen[j])]);
        let marginal = self.R.llt(Side::Lower).and_then(|R| block(&R.inverse()).llt(Side::Lower)).map(|S| S.inverse());
        let mut U = Mat::zeros(p, p);
        // R was factored at construction, so that no factorisation fails here.
        if let Ok(S) = marginal.and_then(|S| S.llt(Side::Lower)) {
            for j in 0..seen.len() {
                (0..=j).for_each(|i| U[(seen[i], seen[j])] = S.L()[(j, i)]);
            }
        }
        Cow::Owned(U)
    }

    /// The cost (17), in units of s_x², of a window's first state against its prior and of its fitted noise (m·p, time-major,
    /// NaN where not measured).
    pub fn cost(&self, x_0: impl Iterator<Item = f64>, prior: &[f64], v: impl Iterator<Item = f64>) -> f64 {
        let p = self.R.nrows();
        if self.plain {
            // P = I, R = μI: what was not measured counts nothing
            let moved: f64 = x_0.zip(prior).map(|(x, x_bar)| (x - x_bar).powi(2)).sum();
            let (mut noise, mut sample, mut seen, mut discount) = (0.0, 0.0, 0, 2.0);
            for value in v {
                sample += if value.is_finite() { value * value } else { 0.0 };
                seen += 1;
                if seen == p {
                    noise = self.rho * noise + sample;
                    discount *= self.rho;
                    (sample, seen) = (0.0, 0);
                }
            }
            return discount * moved + self.R[(0, 0)] * noise;
        }
        let moved: Vec<f64> = x_0.zip(prior).map(|(x, x_bar)| x - x_bar).collect();
        let mut sample = Vec::with_capacity(p);
        let (mut noise, mut depth) = (0.0, 0);
        for value in v {
            sample.push(value);
            if sample.len() == p {
                noise = self.rho * noise + self.squared(&mut sample);
                sample.clear();
                depth += 1;
            }
        }
        2.0 * self.rho.powi(depth) * norm(&self.prior, &moved).powi(2) + noise
    }

    /// ‖v‖²_R of one sample; overwrites what was not measured.
    fn squared(&self, v: &mut [f64]) -> f64 {
        if v.iter().all(|v| v.is_finite()) {
            return norm(&self.noise, v).powi(2);
        }
        let measured: Vec<bool> = v.iter().map(|v| v.is_finite()).collect();
        v.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = 0.0);
        norm(&self.factor(&measured), v).powi(2)
    }
}
