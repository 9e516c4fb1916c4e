//! The small dense quadratic programme, the only file that names Clarabel: the way out where the dual active-set method of
//! `active_set` is not certain, and the reference that it is tested against.
//!
//! The estimator hands over a least-distance problem: with t the deviation from the unconstrained minimiser, in
//! coordinates where the cost's Hessian is the identity,
//!
//! > minimise ½‖t‖²  subject to  lo ≤ A t ≤ hi,
//!
//! with a row scaled to standard deviations.

use crate::tol;
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, SupportedConeT, ZeroConeT,
};
use faer::{Mat, MatRef};
use serde::{Deserialize, Serialize};

/// What the optimisation found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Status {
    /// The minimiser: closed form, or checked against the optimality conditions, or within the solver's tolerance.
    #[default]
    Optimal,
    /// The solver stopped early, at a point that it calls nearly optimal.
    AlmostOptimal,
    /// No window satisfies all bounds; the estimate is the unconstrained minimiser.
    Infeasible,
    /// The solver stopped without an answer; the estimate is the unconstrained minimiser.
    Failed,
}

impl Status {
    /// The status as the word that users see.
    pub fn as_str(self) -> &'static str {
        match self {
            Status::Optimal => "optimal",
            Status::AlmostOptimal => "almost_optimal",
            Status::Infeasible => "infeasible",
            Status::Failed => "failed",
        }
    }
}

/// The answer to one least-distance problem.
pub(crate) struct Solution {
    pub t: Vec<f64>,
    pub status: Status,
    pub iterations: u32,
}

/// One solver row: sign · aᵀt ≤ bound (or = for a fixed row).
struct Side {
    row: usize,
    sign: f64,
    fixed: bool,
}

/// Minimises ½‖t‖² subject to lo ≤ A t ≤ hi, A (rows × r); infinite entries are no bounds.
pub(crate) fn interior_point(A: MatRef<'_, f64>, lo: &[f64], hi: &[f64]) -> Solution {
    let failed = Solution { t: vec![0.0; A.ncols()], status: Status::Failed, iterations: 0 };
    let sides = sides(lo, hi);
    let b: Vec<f64> = sides.iter().map(|s| if s.sign > 0.0 { hi[s.row] } else { -lo[s.row] }).collect();
    let Some(mut solver) = prepare(A, &sides, &b) else { return failed };
    solver.solve();
    let iterations = solver.solution.iterations;
    let status = match solver.solution.status {
        SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => Status::Infeasible,
        SolverStatus::Solved => Status::Optimal,
        SolverStatus::AlmostSolved => Status::AlmostOptimal,
        _ => Status::Failed,
    };
    if status == Status::Infeasible {
        return Solution { iterations, status, ..failed };
    }
    // Whatever the solver calls its last point: an active set near it that satisfies the optimality conditions
    // gives the answer, to rounding.
    if let Some(t) = on_active_set(A, &sides, &b, &solver.solution.z, &solver.solution.s) {
        return Solution { t, status: Status::Optimal, iterations };
    }
    match status {
        Status::Failed => Solution { iterations, ..failed },
        _ => Solution { t: solver.solution.x.clone(), status, iterations },
    }
}

/// min ‖ξ‖∞ subject to M ξ = d, M (n × m) given by columns: a primal and a dual point near the optimum, ξ (m) and y (n) of
/// max dᵀy subject to ‖Mᵀy‖₁ ≤ 1. What they prove is for the caller to check; None if the solver rejects the data.
pub(crate) fn least_max_norm(columns: &[f64], d: &[f64]) -> Option<(Vec<f64>, Vec<f64>)> {
    let (n, m) = (d.len(), columns.len() / d.len());
    // Variables (ξ, t): M ξ = d; ξ - t ≤ 0; -ξ - t ≤ 0.
    let mut A = Mat::zeros(n + 2 * m, m + 1);
    for j in 0..m {
        (0..n).for_each(|i| A[(i, j)] = columns[j * n + i]);
        for (row, sign) in [(n + j, 1.0), (n + m + j, -1.0)] {
            A[(row, j)] = sign;
            A[(row, m)] = -1.0;
        }
    }
    let mut b = d.to_vec();
    b.resize(n + 2 * m, 0.0);
    let mut cost = vec![0.0; m];
    cost.push(1.0);
    let cones = [ZeroConeT(n), NonnegativeConeT(2 * m)];
    let sparse = dense_to_csc(A.as_ref());
    let mut solver =
        DefaultSolver::new(&CscMatrix::zeros((m + 1, m + 1)), &cost, &sparse, &b, &cones, settings()).ok()?;
    solver.solve();
    Some((solver.solution.x[..m].to_vec(), solver.solution.z[..n].iter().map(|z| -z).collect()))
}

fn dense_to_csc(A: MatRef<'_, f64>) -> CscMatrix<f64> {
    let (m, r) = (A.nrows(), A.ncols());
    let values = (0..r).flat_map(|j| (0..m).map(move |i| A[(i, j)])).collect();
    CscMatrix::new(m, r, (0..=r).map(|j| j * m).collect(), (0..r).flat_map(|_| 0..m).collect(), values)
}

fn settings() -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_threads: 1,
        // z and s are read by row
        presolve_enable: false,
        input_sparse_dropzeros: false,
        tol_gap_abs: tol::SOLVER,
        tol_gap_rel: tol::SOLVER,
        tol_feas: tol::SOLVER,
        ..DefaultSettings::default()
    }
}

/// The solver's rows: equalities first, as its cones want them.
fn sides(lo: &[f64], hi: &[f64]) -> Vec<Side> {
    let bounds = || lo.iter().zip(hi).enumerate();
    let fixed = bounds().filter(|(_, (l, h))| l == h).map(|(row, _)| Side { row, sign: 1.0, fixed: true });
    let open = bounds().filter(|(_, (l, h))| l != h).flat_map(|(row, (l, h))| {
        let side = |sign: f64, bound: &f64| bound.is_finite().then_some(Side { row, sign, fixed: false });
        [side(1.0, h), side(-1.0, l)].into_iter().flatten()
    });
    fixed.chain(open).collect()
}

/// The solver for these rows. None only if Clarabel rejects the data.
fn prepare(A: MatRef<'_, f64>, sides: &[Side], b: &[f64]) -> Option<DefaultSolver<f64>> {
    let (m, r) = (sides.len(), A.ncols());
    let equalities = sides.iter().filter(|s| s.fixed).count();
    let cones: Vec<SupportedConeT<f64>> = [ZeroConeT(equalities), NonnegativeConeT(m - equalities)].into();
    let signed = Mat::from_fn(m, r, |i, j| sides[i].sign * A[(sides[i].row, j)]);
    let dense = dense_to_csc(signed.as_ref());
    DefaultSolver::new(&CscMatrix::identity(r), &vec![0.0; r], &dense, b, &cones, settings()).ok()
}

/// The exact minimiser, from the solver's last point.
///
/// Starting from the active set that multipliers z and slacks s suggest, rows that the least-norm point violates are
/// added and rows with a multiplier of the wrong sign dropped, one at a time, until the point is optimal: every row
/// satisfied and ν ≥ 0 on inequalities. None when that does not happen within a bounded number of changes.
fn on_active_set(A: MatRef<'_, f64>, sides: &[Side], b: &[f64], z: &[f64], s: &[f64]) -> Option<Vec<f64>> {
    let mut active: Vec<usize> = (0..sides.len()).filter(|&i| sides[i].fixed || z[i] > s[i]).collect();
    for _ in 0..tol::ACTIVE_SET_CHANGES {
        let (t, nu) = least_norm_point(A, sides, b, &active)?;
        let excess = |i: usize| {
            let e = sides[i].sign * (0..t.len()).map(|j| A[(sides[i].row, j)] * t[j]).sum::<f64>() - b[i];
            if sides[i].fixed { e.abs() } else { e }
        };
        let worst = (0..sides.len()).map(|i| (i, excess(i))).max_by(|a, b| a.1.total_cmp(&b.1))?;
        if worst.1 > tol::ACTIVE_SET {
            if active.contains(&worst.0) {
                return None; // dependent rows that contradict each other
            }
            active.push(worst.0);
            continue;
        }
        let size = t.iter().map(|v| v * v).sum::<f64>().sqrt().max(1.0);
        let free = (0..active.len()).filter(|&a| !sides[active[a]].fixed);
        let moved = |a: usize| nu[a] * A.row(sides[active[a]].row).norm_l2();
        match free.min_by(|&a, &b| moved(a).total_cmp(&moved(b))) {
            Some(a) if moved(a) < -tol::WRONG_SIGN * size => active.remove(a),
            _ => return Some(t),
        };
    }
    None
}

/// t = A_a† b_a on the active rows A_a (outward signs), and multipliers ν with A_aᵀ ν = -t.
fn least_norm_point(A: MatRef<'_, f64>, sides: &[Side], b: &[f64], active: &[usize]) -> Option<(Vec<f64>, Vec<f64>)> {
    let r = A.ncols();
    let mut t = vec![0.0; r];
    let mut nu = vec![0.0; active.len()];
    if active.is_empty() {
        return Some((t, nu));
    }
    let A_a = Mat::from_fn(active.len(), r, |i, j| sides[active[i]].sign * A[(sides[active[i]].row, j)]);
    let svd = A_a.thin_svd().ok()?;
    let sigma = svd.S().column_vector();
    let k = (0..sigma.nrows()).take_while(|&i| sigma[i] > tol::ACTIVE_SET * sigma[0]).count();
    for i in 0..k {
        let component: f64 = (0..active.len()).map(|a| svd.U()[(a, i)] * b[active[a]]).sum::<f64>() / sigma[i];
        (0..r).for_each(|j| t[j] += component * svd.V()[(j, i)]);
        (0..active.len()).for_each(|a| nu[a] -= component / sigma[i] * svd.U()[(a, i)]);
    }
    Some((t, nu))
}
