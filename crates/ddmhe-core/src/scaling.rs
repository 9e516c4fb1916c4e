//! The scale of every channel, from what the channel does in the recording.

use crate::error::Error;
use crate::history::History;
use crate::tol;
use crate::variation::{fifth_differences, one_step};

/// Smallest variance of noise, relative to the channel's own, in weighing challengers and states,
/// and in scaling outputs: a smooth recording has next to no fifth differences.
const LEAST: (f64, f64) = (1e-10, 1e-4);

/// A misfit below this is rounding (a relative error of 1e-12).
pub(crate) const EXACT: f64 = 1e-24;
/// The scale of every channel: what one unit of the estimator's own coordinates is in the user's
/// units.
#[derive(Debug, Clone, PartialEq)]
pub struct Scaling {
    /// Of the state channels (n).
    pub s_x: Vec<f64>,
    /// Of the output channels (p).
    pub s_y: Vec<f64>,
    pub(crate) mean_x: Vec<f64>,
    pub(crate) mean_y: Vec<f64>,
    /// What a tolerance on each state channel is in units of: its own deviation, in the user's
    /// units.
    pub(crate) unit_x: Vec<f64>,
    /// The same of the output channels.
    pub(crate) unit_y: Vec<f64>,
    /// Mean of each input channel, its own deviation, and whether it moved.
    pub(crate) mean_u: Vec<f64>,
    pub(crate) unit_u: Vec<f64>,
    pub(crate) moved_u: Vec<bool>,
    /// Variance of the noise on each output channel from fifth differences, at least 1e-10 of the
    /// channel's variance; with inputs, which may jump, at most what an affine step leaves.
    pub(crate) noise_y: Vec<f64>,
    /// What an affine step from the state before leaves of each channel of x and y, and its
    /// variance.
    pub(crate) one_step: Vec<[f64; 2]>,
    /// Numbers of the channels of each unit.
    pub(crate) groups_x: Vec<Vec<usize>>,
    pub(crate) groups_y: Vec<Vec<usize>>,
    /// Whether anything of each channel's unit moved.
    pub(crate) moved: [Vec<bool>; 2],
    /// Largest magnitude of each channel: what its rounding is measured by.
    reach_x: Vec<f64>,
    reach_y: Vec<f64>,
}

impl Scaling {
    /// Scales of the channels, those of one unit together. States: the geometric mean of the
    /// group's deviation and of what an affine step from the state before leaves of it. Outputs:
    /// the group's noise as its fifth differences show it, at least a hundredth of its deviation.
    /// Both are brought to the geometric mean of the deviations: a lone group has exactly its
    /// pooled deviation. A channel that never moved is scaled by its magnitude, which leaves its
    /// rounding what it is.
    ///
    /// # Errors
    /// [`Error::Rank`] when the state never moves: such a recording says nothing.
    pub fn new(history: &History) -> Result<Self, Error> {
        let (groups_x, groups_y) = (groups(history.x_units()), groups(history.y_units()));
        let x = Channels::new(history, History::states, history.n(), &groups_x);
        let y = Channels::new(history, History::outputs, history.p(), &groups_y);
        if !x.moved.contains(&true) {
            return Err(Error::rank(
                "history",
                "a state x that changes",
                "the same x in every sample",
            ));
        }
        let p = history.p();
        let alone: Vec<Vec<usize>> = (0..history.m()).map(|i| vec![i]).collect();
        let u = Channels::new(history, History::inputs, history.m(), &alone);
        // What is left of a channel when the state before is known, and its spread.
        let one_step = one_step(history, None);
        let left: Vec<f64> = one_step.iter().map(|[unexplained, _]| *unexplained).collect();
        let differences: Vec<f64> = (0..p)
            .map(|i| {
                let noise = fifth_differences(history, History::outputs, (i, p));
                if u.moved.contains(&true) { noise.min(left[history.n() + i]) } else { noise }
            })
            .collect();
        let noise = |floor: f64| -> Vec<f64> {
            differences
                .iter()
                .zip(&y.variance)
                .map(|(noise, variance)| noise.max(floor * variance))
                .collect()
        };
        // The prior is between what is left of a state and its spread.
        let left = shared(&left[..history.n()], &groups_x);
        let between = |(left, spread): (f64, f64)| (left.max(LEAST.0 * spread) * spread).sqrt();
        let squares: Vec<f64> =
            left.into_iter().zip(shared(&x.variance, &groups_x)).map(between).collect();
        Ok(Scaling {
            s_x: x.scales(&squares),
            s_y: y.scales(&shared(&noise(LEAST.1), &groups_y)),
            mean_u: u.mean,
            unit_u: u.unit,
            moved_u: u.moved,
            noise_y: noise(LEAST.0),
            one_step,
            mean_x: x.mean,
            mean_y: y.mean,
            unit_x: x.unit,
            unit_y: y.unit,
            groups_x,
            groups_y,
            moved: [x.moved, y.moved],
            reach_x: x.reach,
            reach_y: y.reach,
        })
    }

    /// Frobenius norm, at most, of the rounding in a stack of `windows` windows of `depth`, in
    /// scaled units.
    pub(crate) fn rounding(&self, windows: usize, depth: usize) -> f64 {
        let squares = |reach: &[f64], s: &[f64]| -> f64 {
            reach.iter().zip(s).map(|(reach, s)| (f64::EPSILON * reach / s).powi(2)).sum()
        };
        let (x, y, m) =
            (squares(&self.reach_x, &self.s_x), squares(&self.reach_y, &self.s_y), depth as f64);
        (windows as f64 * (m * (x + y) + x)).sqrt()
    }

    /// Shares of the variance of x(k+1) and of y(k) that an affine function of x(k) leaves
    /// unexplained: pooled over the channels of one unit, at most 1, then averaged over the
    /// channels that move. `channels`: of [`one_step`] (n + p).
    pub(crate) fn misfit(&self, channels: &[[f64; 2]]) -> [f64; 2] {
        let n = self.s_x.len();
        let [x, y] = &self.moved;
        [(0, &self.groups_x, x), (n, &self.groups_y, y)].map(|(first, groups, moved)| {
            let groups: Vec<&Vec<usize>> = groups.iter().filter(|group| moved[group[0]]).collect();
            let share = |group: &&Vec<usize>| {
                let sum =
                    |which: usize| group.iter().map(|&i| channels[first + i][which]).sum::<f64>();
                let share = if sum(1) > 0.0 { (sum(0) / sum(1)).min(1.0) } else { 0.0 };
                share * group.len() as f64
            };
            groups.iter().map(share).sum::<f64>()
                / groups.iter().map(|group| group.len()).sum::<usize>().max(1) as f64
        })
    }

    /// Mean squares of the scales of the states and of the outputs: what (17) as printed is
    /// measured by.
    pub(crate) fn mean_squares(&self) -> (f64, f64) {
        let mean = |s: &[f64]| s.iter().map(|s| s * s).sum::<f64>() / s.len() as f64;
        (mean(&self.s_x), mean(&self.s_y))
    }

    /// One sample (x, y), or x alone with an empty y, as scaled deviations from the channel means.
    #[inline]
    pub(crate) fn deviations(&self, x: &[f64], y: &[f64]) -> impl Iterator<Item = f64> {
        let x = x.iter().zip(&self.mean_x).zip(&self.s_x).map(|((v, m), s)| (v - m) / s);
        let y = y.iter().zip(&self.mean_y).zip(&self.s_y).map(|((v, m), s)| (v - m) / s);
        x.chain(y)
    }

    /// Inputs (a multiple of m) as scaled deviations.
    pub(crate) fn input_deviations<'a>(&'a self, u: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let m = self.mean_u.len();
        u.iter().enumerate().map(move |(k, u)| (u - self.mean_u[k % m]) / self.unit_u[k % m])
    }

    /// Entry k of an input window in the user's units, from a scaled deviation.
    pub(crate) fn input(&self, k: usize, deviation: f64) -> f64 {
        let i = k % self.mean_u.len();
        deviation * self.unit_u[i] + self.mean_u[i]
    }

    /// The state of channel i in the user's units, from a scaled deviation.
    pub(crate) fn state(&self, i: usize, deviation: f64) -> f64 {
        deviation * self.s_x[i] + self.mean_x[i]
    }

    /// Entry k of an output window in the user's units, from a scaled deviation.
    pub(crate) fn output(&self, k: usize, deviation: f64) -> f64 {
        let i = k % self.mean_y.len();
        deviation * self.s_y[i] + self.mean_y[i]
    }
}

/// Channels that share a unit, each by its number; a channel of unknown unit stands alone.
fn groups(units: &[String]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (i, unit) in units.iter().enumerate() {
        match groups.iter_mut().find(|group| !unit.is_empty() && units[group[0]] == *unit) {
            Some(group) => group.push(i),
            None => groups.push(vec![i]),
        }
    }
    groups
}

/// Each channel's mean over its group.
pub(crate) fn shared(values: &[f64], groups: &[Vec<usize>]) -> Vec<f64> {
    let mut shared = vec![0.0; values.len()];
    for group in groups {
        let mean = group.iter().map(|&i| values[i]).sum::<f64>() / group.len() as f64;
        group.iter().for_each(|&i| shared[i] = mean);
    }
    shared
}

/// What one signal does, channel by channel.
struct Channels {
    mean: Vec<f64>,
    variance: Vec<f64>,
    moved: Vec<bool>, // whether anything in its group did
    pooled: Vec<f64>, // standard deviation over its group
    unit: Vec<f64>,   // what tolerances are in units of
    reach: Vec<f64>,  // largest magnitude
}

impl Channels {
    fn new(
        history: &History,
        signal: fn(&History, usize) -> &[f64],
        width: usize,
        groups: &[Vec<usize>],
    ) -> Self {
        let channel = |i: usize| {
            (0..history.recordings())
                .flat_map(move |r| signal(history, r).iter().skip(i).step_by(width).copied())
        };
        let average = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = values.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
            sum / count
        };
        let mean: Vec<f64> = (0..width).map(|i| average(&mut channel(i))).collect();
        let variance: Vec<f64> =
            (0..width).map(|i| average(&mut channel(i).map(|v| (v - mean[i]).powi(2)))).collect();
        let pooled: Vec<f64> = shared(&variance, groups).iter().map(|v| v.sqrt()).collect();
        let reach: Vec<f64> =
            (0..width).map(|i| channel(i).fold(0.0, |most, v| v.abs().max(most))).collect();
        let moves = |i: usize| {
            let (lo, hi) = channel(i)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
            hi - lo > tol::UNMOVED * reach[i].max(pooled[i])
        };
        let own: Vec<bool> = (0..width).map(moves).collect();
        let unit = |i: usize| {
            let still = reach[i].max(tol::UNMOVED * pooled[i]);
            let unit = if own[i] { variance[i].sqrt() } else { still };
            if unit > 0.0 { unit } else { 1.0 }
        };
        let unit = (0..width).map(unit).collect();
        let mut moved = own.clone();
        groups
            .iter()
            .filter(|group| group.iter().any(|&i| own[i]))
            .flatten()
            .for_each(|&i| moved[i] = true);
        Channels { mean, variance, moved, pooled, unit, reach }
    }

    /// Roots of squared scales, brought to the geometric mean of the groups' deviations; a channel
    /// in whose group nothing moved has no scale but its magnitude.
    fn scales(&self, squares: &[f64]) -> Vec<f64> {
        let moved: Vec<usize> = (0..squares.len()).filter(|&i| self.moved[i]).collect();
        let level = moved.iter().map(|&i| self.pooled[i].ln() - 0.5 * squares[i].ln()).sum::<f64>();
        let level = (level / moved.len().max(1) as f64).exp();
        let scale = |i: usize| if self.moved[i] { level * squares[i].sqrt() } else { self.unit[i] };
        (0..squares.len()).map(scale).collect()
    }
}
