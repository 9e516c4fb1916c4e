//! The affine model that least squares find in a recording, in scaled deviations:
//!
//! > x(k+1) = A x(k) + B u(k) + e + ε(k),  y(k) = C x(k) + D u(k) + r + s(k)
//!
//! It says how a disturbance moves a window, and what the residuals ε and s are like. Estimates do
//! not depend on it where neither is asked for.

use crate::history::History;
use crate::scaling::Scaling;
use crate::variation::{Steps, centred, least_squares};
use faer::{Mat, MatRef};

/// Outputs in the windows of [`LinearModel::of_windows`]: 5 to 14 do.
const DEPTH: usize = 7;

/// The model and what it leaves.
#[derive(Debug, Clone)]
pub(crate) struct LinearModel {
    pub A: Mat<f64>, // n × n
    pub B: Mat<f64>, // n × m, of inputs as scaled deviations
    pub e: Vec<f64>,
    pub C: Mat<f64>, // p × n
    pub D: Mat<f64>,
    pub r: Vec<f64>,
    /// [ε s], a row for each step of the recording (N × (n+p)).
    pub residuals: Mat<f64>,
    /// N less the unknowns of a row, at least 1.
    pub freedom: usize,
}

impl LinearModel {
    /// Of a recording. Inputs that never moved have no effect.
    pub fn new(history: &History, scaling: &Scaling) -> Self {
        let (n, p, m) = (history.n(), history.p(), history.m());
        let Steps { regressors, targets } = scaled_steps(history, scaling);
        let (before, after) = (means(&regressors), means(&targets));
        let (mut X, Y) = (centred(regressors), centred(targets));
        // columns of one length: what is small beside the others is no rounding of theirs
        let still: Vec<bool> = (0..n + m).map(|j| j >= n && !scaling.moved_u[j - n]).collect();
        let lengths: Vec<f64> = (0..n + m).map(|j| X.col(j).norm_l2()).collect();
        let kept = |j: usize| if still[j] || lengths[j] == 0.0 { 0.0 } else { 1.0 / lengths[j] };
        for j in 0..n + m {
            let scale = kept(j);
            X.col_mut(j).iter_mut().for_each(|v| *v *= scale);
        }
        let theta = least_squares(&X, &Y, 0.0);
        let residuals = &Y - &X * &theta;
        let entry = |row: usize, j: usize| theta[(j, row)] * kept(j);
        let rows = Mat::from_fn(n + p, n + m, entry);
        let unknowns = n + 1 + still[n..].iter().filter(|still| !**still).count();
        LinearModel::of(&rows, [n, p, m], [&before, &after], (residuals, unknowns))
    }

    /// The same of a recording without inputs whose states carry much reading noise: least squares
    /// on noisy states damp every mode. Here the model is what takes the n strongest directions of
    /// the recorded windows from each of their instants to the next, in which the noise is
    /// averaged.
    pub fn of_windows(&self, history: &History, scaling: &Scaling) -> Self {
        let (n, p) = (history.n(), history.p());
        let step = n + p;
        let units = scaling.unit_x.iter().chain(&scaling.unit_y);
        let own: Vec<f64> =
            units.zip(scaling.s_x.iter().chain(&scaling.s_y)).map(|(unit, s)| unit / s).collect();
        let Some(directions) = strongest(&windows(history, scaling, &own), n) else {
            return self.clone();
        };
        // [x(k+1); y(k)] from x(k), at every instant of every direction
        let column = |k: usize, l: usize| (k / n, k % n, l);
        let regressors = Mat::from_fn(DEPTH * n, n, |row, i| {
            let (k, direction, i) = column(row, i);
            directions[(k * step + i, direction)]
        });
        let targets = Mat::from_fn(DEPTH * n, n + p, |row, i| {
            let (k, direction, i) = column(row, i);
            let at = if i < n { (k + 1) * step + i } else { k * step + i };
            directions[(at, direction)]
        });
        let theta = least_squares(&regressors, &targets, 0.0);
        let rows = Mat::from_fn(n + p, n, |i, j| theta[(j, i)] * own[i] / own[j]);
        let Steps { regressors, targets } = scaled_steps(history, scaling);
        let (before, after) = (means(&regressors), means(&targets));
        let residuals = centred(targets) - centred(regressors) * rows.transpose();
        LinearModel::of(&rows, [n, p, 0], [&before, &after], (residuals, n + 1))
    }

    /// From \[A B; C D\], what is left, and how many unknowns a row has; e and r from the means.
    fn of(
        rows: &Mat<f64>,
        [n, p, m]: [usize; 3],
        [before, after]: [&[f64]; 2],
        (residuals, unknowns): (Mat<f64>, usize),
    ) -> Self {
        let offset =
            |row: usize| after[row] - (0..n + m).map(|j| rows[(row, j)] * before[j]).sum::<f64>();
        LinearModel {
            A: rows.submatrix(0, 0, n, n).to_owned(),
            B: rows.submatrix(0, n, n, m).to_owned(),
            e: (0..n).map(offset).collect(),
            C: rows.submatrix(n, 0, p, n).to_owned(),
            D: rows.submatrix(n, n, p, m).to_owned(),
            r: (n..n + p).map(offset).collect(),
            freedom: residuals.nrows().saturating_sub(unknowns).max(1),
            residuals,
        }
    }

    /// Γ, covariance of ε (n × n).
    pub fn of_states(&self) -> Mat<f64> {
        self.covariance(0, self.e.len())
    }

    /// Γ_s, covariance of s (p × p).
    pub fn of_outputs(&self) -> Mat<f64> {
        self.covariance(self.e.len(), self.r.len())
    }

    /// Covariance of ε and s (n × p).
    pub fn of_both(&self) -> Mat<f64> {
        let (n, p) = (self.e.len(), self.r.len());
        self.product(self.residuals.subcols(0, n), self.residuals.subcols(n, p))
    }

    fn covariance(&self, first: usize, width: usize) -> Mat<f64> {
        let E = self.residuals.subcols(first, width);
        self.product(E, E)
    }

    fn product(&self, E: MatRef<'_, f64>, other: MatRef<'_, f64>) -> Mat<f64> {
        let mut S = E.transpose() * other;
        S *= faer::Scale(1.0 / self.freedom as f64);
        S
    }
}

/// The steps of a recording, as scaled deviations.
fn scaled_steps(history: &History, scaling: &Scaling) -> Steps {
    let (n, p, m) = (history.n(), history.p(), history.m());
    let Steps { mut regressors, mut targets } = Steps::new(history, 1);
    let scaled = |M: &mut Mat<f64>, j: usize, mean: f64, s: f64| {
        M.col_mut(j).iter_mut().for_each(|v| *v = (*v - mean) / s);
    };
    for i in 0..n {
        scaled(&mut regressors, i, scaling.mean_x[i], scaling.s_x[i]);
        scaled(&mut targets, i, scaling.mean_x[i], scaling.s_x[i]);
    }
    for i in 0..p {
        scaled(&mut targets, n + i, scaling.mean_y[i], scaling.s_y[i]);
    }
    for i in 0..m {
        scaled(&mut regressors, n + i, scaling.mean_u[i], scaling.unit_u[i]);
    }
    Steps { regressors, targets }
}

/// The recorded windows of [`DEPTH`], a row each, centred, in units of each channel's own
/// deviation.
fn windows(history: &History, scaling: &Scaling, own: &[f64]) -> Mat<f64> {
    let (n, p) = (history.n(), history.p());
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for i in 0..history.recordings() {
        let (x, y) = (history.states(i), history.outputs(i));
        for k in 0..(y.len() / p + 1).saturating_sub(DEPTH) {
            let ys = y[k * p..(k + DEPTH) * p].chunks_exact(p).chain([&[][..]]);
            let window = x[k * n..(k + DEPTH + 1) * n].chunks_exact(n).zip(ys);
            let deviations = window.flat_map(|(x, y)| scaling.deviations(x, y).collect::<Vec<_>>());
            rows.push(deviations.zip(own.iter().cycle()).map(|(v, own)| v / own).collect());
        }
    }
    let columns = DEPTH * (n + p) + n;
    centred(Mat::from_fn(rows.len(), columns, |i, j| rows[i][j]))
}

/// The n strongest directions of rows, as columns, each as long as its singular value.
fn strongest(rows: &Mat<f64>, n: usize) -> Option<Mat<f64>> {
    let svd = rows.thin_svd().ok()?;
    let (V, S) = (svd.V(), svd.S().column_vector());
    (S.nrows() >= n).then(|| Mat::from_fn(V.nrows(), n, |i, j| V[(i, j)] * S[j]))
}

fn means(M: &Mat<f64>) -> Vec<f64> {
    let rows = M.nrows() as f64;
    (0..M.ncols()).map(|j| M.col(j).iter().sum::<f64>() / rows).collect()
}
