//! The set of windows that the data allow: mean + basis (+ regularisation weight).
//!
//! # Derivation from (16b)
//! A window of depth m stacks w = [x(0); y(0); …; x(m-1); y(m-1); x(m)] ∈ R^d, d = m(n+p) + n. The N windows
//! of the recording are the columns of W (d × N), the two block Hankel matrices of (16b) interleaved in time, so
//! that a shorter window is the head of a longer one. (16b) asks for w = W α with 1ᵀα = 1.
//!
//! *Centring.* Write α = 1/N + δ with 1ᵀδ = 0. Then W α = c + (W - c 1ᵀ) δ with the mean window c = W 1/N: the
//! row of ones in (16b) is exactly the centring, and it need not be carried further.
//!
//! *Orthonormal basis.* With the thin singular value decomposition W - c 1ᵀ = U S Vᵀ every such δ acts only through
//! z = Vᵀδ, and
//!
//! > w = c + U S z,  ‖α‖² = 1/N + ‖z‖² for the shortest α with that window
//!
//! (Vᵀ1 = 0 because the deviations sum to zero, so 1/N and V z are orthogonal). The N unknowns α become r = rank.
//!
//! *Scaling.* State rows are divided by s_x and output rows by s_y, the standard deviations pooled over the channels
//! of each group. For the exact space this changes nothing but the numerics; for a truncated or regularised one it
//! defines what "small" means. Everything inside this crate's estimator is in these units.
//!
//! *Rounding.* W is recorded in double precision, so it is off by a matrix E with |E_ij| ≤ ε_j = eps·max|channel|/s: by a
//! multiple of eps where channels are centred, by a thousand times that where they stand a thousand deviations from zero.
//! Singular values move by at most ‖E‖₂ ≤ ‖E‖_F ≤ √(N Σ ε_j²) (Weyl), so a direction below that may be nothing but rounding.
//! A recording that was computed step by step carries the rounding of each step along its window as well;
//! [`tol::DATA_ROUNDING`] makes room for that.
//!
//! *Coordinates.* Without a weight the coordinates are b = S z and the basis is U, orthonormal: directions that the
//! recording hardly excited are not ill-conditioned. With a weight they are a = √N z, of unit variance over the
//! recording, the basis is U S/√N and ‖α‖² = (1 + ‖a‖²)/N.

use crate::error::Error;
use crate::history::History;
use crate::tol;
use faer::{Mat, MatRef};
use serde::{Deserialize, Serialize};

/// Which windows count as trajectories of the system.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub enum Space {
    /// The documented default rule: see [`defaults`](crate::defaults).
    #[default]
    Auto,
    /// Every direction above rounding level: the equality (16b) as printed, with the least-norm α where the
    /// cost leaves a choice. Right for noise-free recordings of (locally) linear systems.
    Exact,
    /// The strongest directions only: at most `rank`, and none below `tol`·σ₁. With neither given,
    /// rank n, the dimension that noise-free linear data have.
    Truncated {
        /// Largest number of directions; windows too short for it keep what they have.
        rank: Option<usize>,
        /// Relative singular value below which a direction is dropped.
        tol: Option<f64>,
    },
    /// Every direction above rounding level, and `weight`·‖α‖² added to the cost (17), in its units.
    Ridge {
        /// Weight, > 0.
        weight: f64,
        /// Whether it is on ‖a‖² = N‖α‖² - 1 in units of s_x² instead: the same for every recording length, horizon and unit.
        normalised: bool,
    },
}

/// A choice of space in normalised units, the same for every depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Selection {
    pub rank: Option<usize>,
    pub tol: Option<f64>,
    /// λ, weight on ‖a‖² = N‖α‖² - 1 in units of s_x².
    pub penalty: Penalty,
}

impl Selection {
    /// The same with ten times the default rule's weight; None where the rule set none.
    pub fn heavier(self) -> Option<Self> {
        match self.penalty {
            Penalty::Normalised(weight) => Some(Selection { penalty: Penalty::Normalised(10.0 * weight), ..self }),
            Penalty::None | Penalty::Alpha(_) => None,
        }
    }
}

/// The two ways to state a weight on ‖α‖².
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Penalty {
    None,
    /// On ‖a‖², normalised: independent of N and of units.
    Normalised(f64),
    /// On ‖α‖² in the units of (17).
    Alpha(f64),
}

/// Pooled standard deviations and channel means of the recordings.
#[derive(Debug, Clone, PartialEq)]
pub struct Scaling {
    /// Pooled standard deviation of the state channels.
    pub s_x: f64,
    /// Pooled standard deviation of the output channels (1 when the output never moved).
    pub s_y: f64,
    pub(crate) mean_x: Vec<f64>,
    pub(crate) mean_y: Vec<f64>,
    /// What a tolerance on each state channel is in units of: its own deviation, in the user's units.
    pub(crate) unit_x: Vec<f64>,
    /// The same of the output channels.
    pub(crate) unit_y: Vec<f64>,
    /// Σ ε² over the channels of x and of y, ε the rounding of a recorded number in scaled units.
    rounding: [f64; 2],
}

impl Scaling {
    /// Means and pooled deviations over all samples of all recordings.
    ///
    /// # Errors
    /// [`Error::Rank`] when the state never moves: such a recording says nothing.
    pub fn new(history: &History) -> Result<Self, Error> {
        let all = |signal: fn(&History, usize) -> &[f64]| {
            (0..history.recordings()).flat_map(move |i| signal(history, i).iter().copied())
        };
        let (mean_x, s_x, unit_x) = pooled(all(History::x), history.n());
        let (mean_y, s_y, unit_y) = pooled(all(History::y), history.p());
        if s_x == 0.0 {
            return Err(Error::rank("history", "a state x that changes", "the same x in every sample"));
        }
        let s_y = if s_y > 0.0 { s_y } else { 1.0 };
        let squares = |size: Vec<f64>, s: f64| size.iter().map(|m| (f64::EPSILON * m / s).powi(2)).sum();
        let rounding =
            [squares(largest(all(History::x), history.n()), s_x), squares(largest(all(History::y), history.p()), s_y)];
        Ok(Scaling { s_x, s_y, mean_x, mean_y, unit_x, unit_y, rounding })
    }

    /// Frobenius norm, at most, of the rounding in a stack of `windows` windows of `depth`, in scaled units.
    fn rounding(&self, windows: usize, depth: usize) -> f64 {
        let ([x, y], m) = (self.rounding, depth as f64);
        (windows as f64 * (m * (x + y) + x)).sqrt()
    }

    /// One sample (x, y), or x alone with an empty y, as scaled deviations from the channel means.
    #[inline]
    pub(crate) fn deviations(&self, x: &[f64], y: &[f64]) -> impl Iterator<Item = f64> {
        let x = x.iter().zip(&self.mean_x).map(|(v, m)| (v - m) / self.s_x);
        let y = y.iter().zip(&self.mean_y).map(|(v, m)| (v - m) / self.s_y);
        x.chain(y)
    }

    /// The state of channel i in the user's units, from a scaled deviation.
    pub(crate) fn state(&self, i: usize, deviation: f64) -> f64 {
        deviation * self.s_x + self.mean_x[i]
    }

    /// Entry k of an output window in the user's units, from a scaled deviation.
    pub(crate) fn output(&self, k: usize, deviation: f64) -> f64 {
        deviation * self.s_y + self.mean_y[k % self.mean_y.len()]
    }

    /// The channel means of one sample (x, y), scaled.
    fn means(&self) -> Vec<f64> {
        let x = self.mean_x.iter().map(|m| m / self.s_x);
        x.chain(self.mean_y.iter().map(|m| m / self.s_y)).collect()
    }
}

/// Channel means, the standard deviation pooled over channels, and each channel's unit of tolerances.
fn pooled(values: impl Iterator<Item = f64> + Clone, width: usize) -> (Vec<f64>, f64, Vec<f64>) {
    let mut mean = vec![0.0; width];
    let mut count = 0.0;
    for (k, v) in values.clone().enumerate() {
        mean[k % width] += v;
        count += 1.0;
    }
    mean.iter_mut().for_each(|m| *m *= width as f64 / count);
    let squares: f64 = values.clone().enumerate().map(|(k, v)| (v - mean[k % width]).powi(2)).sum();
    let s = (squares / count).sqrt();
    let units = (0..width).map(|i| unit(values.clone().skip(i).step_by(width), mean[i], s)).collect();
    (mean, s, units)
}

/// The standard deviation of one channel. One that never moved has none: its value is known to rounding, its own or, at 0,
/// that of the numbers beside it.
fn unit(values: impl Iterator<Item = f64>, mean: f64, pooled: f64) -> f64 {
    let (mut lo, mut hi, mut squares, mut count) = (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0.0);
    for v in values {
        (lo, hi) = (lo.min(v), hi.max(v));
        squares += (v - mean).powi(2);
        count += 1.0;
    }
    let beside = tol::UNMOVED * pooled;
    let moved = hi - lo > tol::UNMOVED * lo.abs().max(hi.abs()).max(pooled);
    let own = if moved { (squares / count).sqrt() } else { mean.abs().max(beside) };
    if own > 0.0 { own } else { 1.0 }
}

/// Largest magnitude of each channel.
fn largest(values: impl Iterator<Item = f64>, width: usize) -> Vec<f64> {
    let mut largest = vec![0.0_f64; width];
    values.enumerate().for_each(|(k, v)| largest[k % width] = largest[k % width].max(v.abs()));
    largest
}

/// The windows of one depth that the data allow.
#[derive(Debug, Clone)]
pub struct TrajectorySpace {
    /// Depth m: outputs in the window.
    pub depth: usize,
    /// Number N of recorded windows behind it.
    pub windows: usize,
    /// Mean window c (d), in scaled units.
    pub mean: Vec<f64>,
    /// Basis (d × r), in scaled units.
    pub basis: Mat<f64>,
    /// The r singular values kept, of the centred and scaled stack.
    pub singular_values: Vec<f64>,
    /// Weight λ on ‖a‖² (cost in units of s_x²); 0 when there is none.
    pub lambda: f64,
}

impl TrajectorySpace {
    /// Number of directions r.
    pub fn rank(&self) -> usize {
        self.basis.ncols()
    }
}

/// All recorded windows up to one depth, factored once so that every depth's space is cheap.
///
/// With the windows as rows, [1 Wᵀ] = Q R. Because windows are ordered in time, the leading columns of R are the
/// factor of every shorter window over the same starts; a shorter depth only appends the few windows that start
/// too late for the deepest. The first column of R is the centring. One QR of all data serves all depths; what is left
/// for each is an SVD of at most d × d.
pub(crate) struct WindowStack<'a> {
    history: &'a History,
    scaling: &'a Scaling,
    equilibrium: Option<Vec<f64>>, // scaled x_e, then scaled y_e
    depth: usize,
    R: Mat<f64>, // of the windows of `depth`: min(N, 1+d) × (1+d)
}

impl<'a> WindowStack<'a> {
    /// Factors the windows of `depth`; `equilibrium` is a rest (x_e, y_e) in the user's units.
    pub fn new(
        history: &'a History,
        scaling: &'a Scaling,
        depth: usize,
        equilibrium: Option<(&[f64], &[f64])>,
    ) -> Self {
        let equilibrium = equilibrium.map(|(x, y)| scaling.deviations(x, y).collect());
        let mut stack = WindowStack { history, scaling, equilibrium, depth, R: Mat::zeros(0, 0) };
        let rows = stack.rows(depth, 0);
        stack.R = upper(rows.as_ref(), rows.ncols());
        stack
    }

    /// [1 Wᵀ] for windows of `depth`, leaving out those of each recording that also start a window of depth `covered`.
    fn rows(&self, depth: usize, covered: usize) -> Mat<f64> {
        let (n, p) = (self.history.n(), self.history.p());
        let mut starts = Vec::new();
        for i in 0..self.history.recordings() {
            let T = self.history.y(i).len() / p;
            let first = if covered == 0 { 0 } else { (T + 1).saturating_sub(covered) };
            starts.extend((first..(T + 1).saturating_sub(depth)).map(|k| (i, k)));
        }
        let mut rows = Mat::zeros(starts.len(), 1 + depth * (n + p) + n);
        for (row, &(i, k)) in starts.iter().enumerate() {
            rows[(row, 0)] = 1.0;
            let (x, y) = (&self.history.x(i)[k * n..], &self.history.y(i)[k * p..]);
            for j in 0..=depth {
                let y_j = if j < depth { &y[j * p..(j + 1) * p] } else { &[] };
                for (a, v) in self.scaling.deviations(&x[j * n..(j + 1) * n], y_j).enumerate() {
                    rows[(row, 1 + j * (n + p) + a)] = v;
                }
            }
        }
        rows
    }

    /// The space of windows of `depth`.
    pub fn space(&self, depth: usize, selection: &Selection) -> TrajectorySpace {
        let (n, p) = (self.history.n(), self.history.p());
        let d = depth * (n + p) + n;
        let recorded = self.history.windows(depth);
        let late = self.rows(depth, self.depth);
        let shared = self.R.nrows().min(1 + d);
        let copies = if self.equilibrium.is_some() { copies(recorded) } else { 0 };

        let mut stacked = Mat::zeros(shared + late.nrows() + usize::from(copies > 0), 1 + d);
        for j in 0..=d {
            for i in 0..shared.min(j + 1) {
                stacked[(i, j)] = self.R[(i, j)];
            }
            for i in 0..late.nrows() {
                stacked[(shared + i, j)] = late[(i, j)];
            }
        }
        if let Some(rest) = &self.equilibrium {
            // `copies` equal rows have the same factor as one row times √copies.
            let (row, weight) = (shared + late.nrows(), (copies as f64).sqrt());
            stacked[(row, 0)] = weight;
            for j in 0..d {
                stacked[(row, 1 + j)] = weight * rest[j % (n + p)];
            }
        }
        let windows = recorded + copies;
        let R = upper(stacked.as_ref(), 1 + d);
        let mut space = select(R.as_ref(), depth, windows, self.scaling, selection);
        // back from deviations about the channel means to scaled units
        let means = self.scaling.means();
        space.mean.iter_mut().enumerate().for_each(|(row, m)| *m += means[row % (n + p)]);
        space
    }
}

/// How often a known rest counts beside `recorded` windows.
pub(crate) fn copies(recorded: usize) -> usize {
    (3 * recorded / 10).max(2)
}

/// The triangular factor of a QR decomposition, min(rows, columns) × columns, zeros below the diagonal.
fn upper(rows: MatRef<'_, f64>, columns: usize) -> Mat<f64> {
    let qr = rows.qr();
    let R = qr.thin_R();
    Mat::from_fn(R.nrows(), columns, |i, j| if i <= j { R[(i, j)] } else { 0.0 })
}

/// Mean, basis and weight from the factor R of [1 Wᵀ].
fn select(
    R: MatRef<'_, f64>,
    depth: usize,
    windows: usize,
    scaling: &Scaling,
    selection: &Selection,
) -> TrajectorySpace {
    let d = R.ncols() - 1;
    let mean: Vec<f64> = (0..d).map(|j| R[(0, 1 + j)] / R[(0, 0)]).collect();
    let (U, sigma) = right_singular(R.submatrix(1, 1, R.nrows() - 1, d));
    let sigma_1 = sigma.first().copied().unwrap_or(0.0);
    let floor = (sigma_1 * (tol::RANK_EPS * windows.max(d) as f64).max(selection.tol.unwrap_or(0.0)))
        .max(tol::DATA_ROUNDING * scaling.rounding(windows, depth));
    let above = sigma.iter().take_while(|&&s| s > floor).count();
    let rank = above.min(selection.rank.unwrap_or(usize::MAX));
    let N = windows as f64;
    let lambda = match selection.penalty {
        Penalty::None => 0.0,
        Penalty::Normalised(weight) => weight,
        Penalty::Alpha(weight) => weight / (N * scaling.s_x * scaling.s_x),
    };
    let length = |i: usize| if lambda > 0.0 { sigma[i] / N.sqrt() } else { 1.0 };
    let basis = Mat::from_fn(d, rank, |i, j| U[(i, j)] * length(j));
    TrajectorySpace { depth, windows, mean, basis, singular_values: sigma[..rank].to_vec(), lambda }
}

/// Right singular vectors (as columns) and singular values, largest first.
fn right_singular(A: MatRef<'_, f64>) -> (Mat<f64>, Vec<f64>) {
    if A.nrows() == 0 {
        return (Mat::zeros(A.ncols(), 0), Vec::new());
    }
    match A.thin_svd() {
        Ok(svd) => (svd.V().to_owned(), svd.S().column_vector().iter().copied().collect()),
        // The iteration has no known failure on finite data; an empty space is reported by the caller as a rank error.
        Err(_) => (Mat::zeros(A.ncols(), 0), Vec::new()),
    }
}
