//! What all depths of a plan are measured by: see [`ddmhe_run::evidence::OfPlan`].

use crate::config::Config;
use crate::driving::Driving;
use crate::evidence::model::ModelNumbers;
use crate::history::History;
use crate::scaling::Scaling;
use ddmhe_run::evidence::Rule;
use faer::Mat;

/// An estimate is uncertain above this share of the recorded spread …
pub(crate) const SPREAD: f64 = 0.5;
/// … and so many times what held-out windows were off.
const PROMISE: f64 = 3.0;
/// An output is stuck after so many equal values, or so many times the longest run recorded.
const PATIENCE: (f64, f64) = (10.0, 3.0);
/// Of its range, how far a channel may leave it.
const BEYOND: f64 = 0.25;
/// A channel that never moved may be off by this share of its magnitude.
const ROUNDING: f64 = 1e-9;

/// What all depths are measured by, in the user's units.
pub(crate) struct PlanNumbers {
    pub start: Vec<f64>,
    pub per_spread: Vec<f64>,
    pub away: Vec<f64>,
    pub uncertain: Vec<f64>,
    pub x_range: [Vec<f64>; 2],
    pub u_range: [Vec<f64>; 2],
    pub patience: Vec<f64>,
    pub drift: Vec<f64>,
    pub growth: Vec<f64>,
    pub model: Option<ModelNumbers>, // with the weights of the recording
}

/// What the recording says of its states.
#[derive(Debug, Clone)]
pub(crate) struct Recorded {
    /// Root-mean-square error of held-out windows of the horizon (n), in the user's units; NaN
    /// where nothing could be held out.
    pub promise: Vec<f64>,
    /// Variance of the reading noise of the states, in the user's units (n): by fifth differences,
    /// or what an affine step leaves, whichever is less.
    pub start: Vec<f64>,
    /// Σ_x⁻¹ / (.7 D_most) (n × n), scaled.
    pub away: Mat<f64>,
    /// 2q, .1 T and T.
    pub growth: [f64; 3],
}

impl Recorded {
    /// Of all depths: see [`ddmhe_run::evidence::OfPlan`].
    pub fn of_plan(
        &self,
        rule: Rule,
        history: &History,
        config: &Config,
        (scaling, driving): (&Scaling, Option<&Driving>),
    ) -> PlanNumbers {
        let (n, p, m) = (history.n(), history.p(), history.m());
        let promise = |i: usize| if self.promise[i].is_nan() { 0.0 } else { self.promise[i] };
        let spread = &scaling.unit_x;
        let uncertain = |i: usize| (SPREAD * spread[i]).max(PROMISE * promise(i)).powi(2);
        let stationary = driving.and_then(|driving| driving.stationary.as_ref());
        let start = |i: usize, j: usize| match stationary {
            Some(P) => P[(i, j)] * scaling.s_x[i] * scaling.s_x[j],
            None if i == j => self.start[i],
            None => 0.0,
        };
        let range = |signal: fn(&History, usize) -> &[f64], width: usize, i: usize| {
            let values = (0..history.recordings())
                .flat_map(|r| signal(history, r).iter().skip(i).step_by(width));
            let (lo, hi) = values
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(*v), hi.max(*v)));
            (lo, hi, BEYOND * (hi - lo) + ROUNDING * lo.abs().max(hi.abs()))
        };
        let x: Vec<(f64, f64, f64)> = (0..n).map(|i| range(History::states, n, i)).collect();
        let scaled = |i: usize, u: f64| (u - scaling.mean_u[i]) / scaling.unit_u[i];
        let u: Vec<(f64, f64)> = (0..m)
            .map(|i| {
                let (lo, hi, more) = range(History::inputs, m, i);
                (scaled(i, lo - more), scaled(i, hi + more))
            })
            .collect();
        let patience = |i: usize| PATIENCE.0.max(PATIENCE.1 * longest_run(history, i) as f64);
        PlanNumbers {
            start: (0..n * n).map(|k| start(k / n, k % n)).collect(),
            away: (0..n * n)
                .map(|k| self.away[(k / n, k % n)] / (scaling.s_x[k / n] * scaling.s_x[k % n]))
                .collect(),
            per_spread: spread.iter().map(|s| 1.0 / (s * s)).collect(),
            uncertain: (0..n).map(uncertain).collect(),
            x_range: [
                x.iter().map(|(lo, _, more)| lo - more).collect(),
                x.iter().map(|(_, hi, more)| hi + more).collect(),
            ],
            u_range: [u.iter().map(|(lo, _)| *lo).collect(), u.iter().map(|(_, hi)| *hi).collect()],
            patience: (0..p).map(patience).collect(),
            drift: config.drift.clone().unwrap_or_default(),
            growth: self.growth.into_iter().chain([f64::from(config.x_prior.is_some())]).collect(),
            model: driving
                .filter(|_| rule == Rule::Filter)
                .and_then(|driving| ModelNumbers::new(history, scaling, driving)),
        }
    }
}

/// The longest run of equal values of an output.
fn longest_run(history: &History, i: usize) -> usize {
    let p = history.p();
    let of = |r: usize| {
        let values: Vec<f64> = history.outputs(r).iter().skip(i).step_by(p).copied().collect();
        values.chunk_by(|a, b| a == b).map(<[f64]>::len).max().unwrap_or(0)
    };
    (0..history.recordings()).map(of).max().unwrap_or(0)
}
