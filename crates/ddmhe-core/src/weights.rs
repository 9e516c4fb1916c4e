//! The weights of the cost (17), scalar or of a certificate, in scaled units.

use crate::certificate::{Certificate, factor};
use crate::config::{Config, Weighting};
use crate::covariance::inverse_factor;
use crate::defaults::Defaults;
use crate::driving::Driving;
use crate::error::Error;
use crate::scaling::Scaling;
use ddmhe_run::layout::Layout;
use ddmhe_run::reweight::reduced;
use faer::{Mat, Side};
use std::borrow::Cow;

/// Square roots of weights with their first rows in \[x̄; y\].
pub(crate) type Blocks = Vec<(usize, Mat<f64>)>;

/// 2ρ^m ‖x̂(t-m) - x̄‖²_P + Σ_j ρ^{j-1} ‖v̂(t-j)‖²_R in scaled units; with the weights of the
/// recording ‖x̂(t-m) - x̄‖²_{P⁻¹} + Σ_j ‖v̂(t-j)‖²_{R⁻¹}, of a stationary covariance P.
#[derive(Debug, Clone)]
pub(crate) struct Weights {
    pub rho: f64,
    /// What the cost in scaled units is to be multiplied with: 1, or for weights in the user's
    /// units the mean of the s_x².
    pub unit: f64,
    prior: Mat<f64>, // U with P = UᵀU: n × n
    noise: Mat<f64>, // U with R = UᵀU: p × p
    R: Mat<f64>,
    plain: bool,        // R is diagonal
    plain_prior: bool,  // P is
    undiscounted: bool, // the prior has one weight at every depth
    settled: bool,      // P is that of a Kalman filter
    of_noise: bool,     // R is the inverse of the noise's own covariance
    /// What a scaled output is multiplied with where all outputs are to count alike: 1, or to the
    /// user's units.
    pub alike: Vec<f64>,
}

impl Weights {
    /// A certificate's weights, those of (17) as printed, or those of scaled units.
    pub fn new(
        config: &Config,
        rule: &Defaults,
        (scaling, driving): (&Scaling, Option<&Driving>),
    ) -> Result<Self, Error> {
        if let Some(weights) = driving.and_then(Weights::recorded) {
            return Ok(weights);
        }
        let (unit, unit_y) = scaling.mean_squares();
        let rho = config.rho.unwrap_or(rule.rho);
        let alike: Vec<f64> = scaling.s_y.iter().map(|s| s / unit_y.sqrt()).collect();
        match (&config.certificate, config.weighting()) {
            (Some(c), _) => Weights::certified(c, unit, scaling, alike)
                .ok_or_else(|| Error::value("certificate", "positive definite P and R", "others")),
            (None, Weighting::Scaled) => {
                let mu = config.mu.unwrap_or(rule.mu);
                let alike = vec![1.0; scaling.s_y.len()];
                Ok(Weights::diagonal(
                    rho,
                    1.0,
                    &vec![1.0; scaling.s_x.len()],
                    &vec![mu.sqrt(); scaling.s_y.len()],
                    alike,
                ))
            }
            (None, _) => {
                let mu = config.mu.unwrap_or(rule.mu * unit / unit_y);
                let of = |s: &[f64], weight: f64| {
                    s.iter().map(|s| s * (weight / unit).sqrt()).collect::<Vec<_>>()
                };
                Ok(Weights::diagonal(
                    rho,
                    unit,
                    &of(&scaling.s_x, 1.0),
                    &of(&scaling.s_y, mu),
                    alike,
                ))
            }
        }
    }

    /// Those of a recording; None for a disturbance beside others.
    fn recorded(driving: &Driving) -> Option<Self> {
        let U = inverse_factor(driving.stationary.as_ref()?)?;
        let noise: Vec<f64> = driving.R.iter().map(|R| R.sqrt().recip()).collect();
        let ones = vec![1.0; noise.len()];
        let plain = Weights::diagonal(1.0, 1.0, &vec![1.0; U.nrows()], &noise, ones);
        let own = Weights { prior: U, plain_prior: false, of_noise: true, settled: true, ..plain };
        Some(Weights { undiscounted: true, ..own })
    }

    /// From the roots of the diagonals of P and R.
    fn diagonal(rho: f64, unit: f64, prior: &[f64], noise: &[f64], alike: Vec<f64>) -> Self {
        let matrix = |d: &[f64], power: i32| {
            Mat::from_fn(d.len(), d.len(), |i, j| if i == j { d[i].powi(power) } else { 0.0 })
        };
        Weights {
            rho,
            unit,
            prior: matrix(prior, 1),
            noise: matrix(noise, 1),
            R: matrix(noise, 2),
            plain: true,
            plain_prior: true,
            undiscounted: false,
            settled: false,
            of_noise: false,
            alike,
        }
    }

    /// A certificate's P and R, in cost units of `unit`. None unless both are positive definite.
    fn certified(
        certificate: &Certificate,
        unit: f64,
        scaling: &Scaling,
        alike: Vec<f64>,
    ) -> Option<Self> {
        let scaled = |matrix: &[f64], s: &[f64]| -> Vec<f64> {
            matrix
                .iter()
                .enumerate()
                .map(|(k, m)| m * s[k / s.len()] * s[k % s.len()] / unit)
                .collect()
        };
        let (P, R) = (scaled(&certificate.P, &scaling.s_x), scaled(&certificate.R, &scaling.s_y));
        let p = scaling.s_y.len();
        Some(Weights {
            rho: certificate.eta,
            unit,
            prior: factor(&P, scaling.s_x.len())?,
            noise: factor(&R, p)?,
            R: Mat::from_fn(p, p, |i, j| R[i * p + j]),
            plain: false,
            plain_prior: false,
            undiscounted: false,
            settled: false,
            of_noise: false,
            alike,
        })
    }

    /// μ, or what comes nearest: the mean weight of an output channel.
    pub fn mu(&self) -> f64 {
        self.R.diagonal().column_vector().iter().sum::<f64>() / self.R.nrows() as f64
    }

    /// [`mu`](Self::mu) in the user's units.
    pub fn mu_as_printed(&self, scaling: &Scaling) -> f64 {
        let channel = |(i, s): (usize, &f64)| self.R[(i, i)] * self.unit / (s * s);
        scaling.s_y.iter().enumerate().map(channel).sum::<f64>() / scaling.s_y.len() as f64
    }

    /// Smallest and largest weight of a state, and of an output.
    pub fn ranges(&self) -> [(f64, f64); 2] {
        [&self.prior, &self.noise].map(|U| {
            let weights = U.diagonal().column_vector().iter().map(|u| u * u);
            weights.fold((f64::INFINITY, 0.0_f64), |(least, most), w| (least.min(w), most.max(w)))
        })
    }

    /// Mean over the output channels of their weight times these variances.
    pub fn mean_cost(&self, variances: &[f64]) -> f64 {
        let costs = variances.iter().enumerate().map(|(i, variance)| self.R[(i, i)] * variance);
        let told = costs.filter(|cost| !cost.is_nan());
        let (sum, count) = told.fold((0.0, 0.0), |(sum, count), cost| (sum + cost, count + 1.0));
        sum / f64::max(count, 1.0)
    }

    /// Cost of a fitted disturbance of its own deviation: that of a fitted noise of its own, of
    /// these variances; NaN for an output at rest, which has none.
    pub fn price(&self, variances: &[f64]) -> f64 {
        if self.of_noise { 1.0 } else { self.mean_cost(variances) }
    }

    /// The same for a run from an unknown state: UᵀU is the weight of its first prior, at every
    /// depth.
    pub fn opening(&self, U: Mat<f64>) -> Self {
        let own = Weights { prior: U, plain_prior: false, settled: false, ..self.clone() };
        Weights { undiscounted: true, ..own }
    }

    /// With a prior whose weight (n × n) lacks this (by rows), where outputs before the window were
    /// lost. None where nothing is left of it.
    pub fn lacking(&self, lost: &[f64]) -> Option<Self> {
        let n = self.prior.nrows();
        let whole = self.prior.transpose() * &self.prior;
        let rest: Vec<f64> = (0..n * n).map(|k| whole[(k / n, k % n)] - lost[k]).collect();
        Some(Weights { prior: factor(&rest, n)?, settled: false, ..self.clone() })
    }

    /// Whether P is the covariance that a Kalman filter with these weights settles to.
    pub fn settled(&self) -> bool {
        self.settled
    }

    /// 2ρ^m; 1 for the prior of an unknown start.
    pub fn discount(&self, depth: usize) -> f64 {
        if self.undiscounted { 1.0 } else { 2.0 * self.rho.powi(depth as i32) }
    }

    /// √ of the prior's weight in a window of depth m (n × n).
    pub fn prior(&self, depth: usize) -> Mat<f64> {
        &self.prior * faer::Scale(self.discount(depth).sqrt())
    }

    /// √ of the weight of y(t-j), j = `age` (p × p).
    pub fn noise(&self, age: usize, measured: &[bool]) -> Mat<f64> {
        self.factor(measured).as_ref() * faer::Scale(self.age(age).sqrt())
    }

    /// U with UᵀU the weight of one sample, [`reduced`] to what was measured.
    fn factor(&self, measured: &[bool]) -> Cow<'_, Mat<f64>> {
        if measured.iter().all(|&m| m) {
            return Cow::Borrowed(&self.noise);
        }
        let p = measured.len();
        let mut R = vec![0.0; p * p];
        reduced(&self.output_weight(), p, |i| measured[i], &mut R);
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

    /// Weight of the square of each entry of a fitted noise in the user's units (m·p, oldest first)
    /// in the cost; None with a certificate's matrices.
    pub fn diagonal_noise(&self, depth: usize, s_y: &[f64]) -> Option<Vec<f64>> {
        let p = s_y.len();
        let weight = |row: usize| {
            let i = row % p;
            self.R[(i, i)] * self.rho.powi((depth - 1 - row / p) as i32) * self.unit
                / s_y[i].powi(2)
        };
        self.plain.then(|| (0..depth * p).map(weight).collect())
    }

    /// √ of 2ρ^m P on the prior, of ρ^{j-1} R on y(t-j), of what was `measured` (m·p): the block of
    /// each sample with its first row in \[x̄; y\].
    pub fn blocks(&self, layout: Layout, measured: &[bool]) -> Blocks {
        let Layout { n, p, depth, .. } = layout;
        let noise = |k: usize| self.noise(depth - k, &measured[k * p..(k + 1) * p]);
        let outputs = (0..depth).map(|k| (n + k * p, noise(k)));
        std::iter::once((0, self.prior(depth))).chain(outputs).collect()
    }

    /// Of f = \[x̄; y\] - c and what is left of it, as weighed by [`blocks`](Self::blocks): their
    /// product, and J, the square of the latter.
    pub fn products(&self, blocks: &Blocks, f: &[f64], left: &[f64]) -> [f64; 2] {
        let along = |U: &Mat<f64>, v: &[f64], i: usize| -> f64 {
            v.iter().enumerate().map(|(j, v)| U[(i, j)] * v).sum()
        };
        let (mut inner, mut J) = (0.0, 0.0);
        for (first, U) in blocks {
            let rows = *first..first + U.nrows();
            let (f, left) = (&f[rows.clone()], &left[rows]);
            for i in 0..U.nrows() {
                let (of_f, of_left) = (along(U, f, i), along(U, left, i));
                inner += of_f * of_left;
                J += of_left * of_left;
            }
        }
        [self.unit * inner, self.unit * J]
    }

    /// Whether P is diagonal.
    pub fn plain_prior(&self) -> bool {
        self.plain_prior
    }

    /// √ of P: its diagonal (n) if it has no more, else U with P = UᵀU, by rows (n × n).
    pub fn prior_factor(&self) -> Vec<f64> {
        let n = self.prior.nrows();
        let entry = |k: usize| self.prior[(k / n, k % n)];
        if self.plain_prior {
            return (0..n).map(|i| self.prior[(i, i)]).collect();
        }
        (0..n * n).map(entry).collect()
    }

    /// R by rows (p × p).
    pub fn output_weight(&self) -> Vec<f64> {
        let p = self.R.nrows();
        (0..p * p).map(|k| self.R[(k / p, k % p)]).collect()
    }

    /// ρ^{j-1} of y(t-j), j = `age`.
    pub fn age(&self, age: usize) -> f64 {
        self.rho.powi(age as i32 - 1)
    }
}
