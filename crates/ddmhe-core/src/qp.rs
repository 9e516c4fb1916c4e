//! The small dense quadratic programme, the only file that names Clarabel: the way out where the dual active-set method of
//! `active_set` is not certain, and the reference that it is tested against.
//!
//! The estimator hands over a least-distance problem: with t the deviation from the unconstrained minimiser, in
//! coordinates where the cost's Hessian is the identity,
//!
//! > minimise ½‖t‖²  subject to  lo ≤ A t ≤ hi,  A (rows × r) fixed, lo and hi new at every step.
//!
//! Only the right-hand side changes from step to step, so the solver is set up once for each pattern of
//! bounds and then updated in place (`update_b`).

use crate::active_set::{self, Outcome};
use crate::tol;
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, SupportedConeT, ZeroConeT,
};
use faer::{Mat, MatRef};

/// What the optimisation found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
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

/// How a row lo ≤ aᵀt ≤ hi enters the solver; the order of the solver's rows depends on nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Row {
    Free,
    Below, // aᵀt ≤ hi
    Above, // aᵀt ≥ lo
    Both,
    Fixed, // lo = hi
}

impl Row {
    fn of(lo: f64, hi: f64) -> Row {
        match (lo.is_finite(), hi.is_finite()) {
            (false, false) => Row::Free,
            (false, true) => Row::Below,
            (true, false) => Row::Above,
            (true, true) if lo == hi => Row::Fixed,
            (true, true) => Row::Both,
        }
    }
}

/// The answer to one least-distance problem.
pub(crate) struct Solution {
    pub t: Vec<f64>,
    pub status: Status,
    pub iterations: u32,
}

/// The least-distance problem of one window length, with the solver kept between steps.
pub(crate) struct LeastDistance {
    A: Mat<f64>, // rows × r
    norms: Vec<f64>,
    prepared: Option<Prepared>,
}

/// One solver row: sign · aᵀt ≤ bound (or = for a fixed row).
struct Side {
    row: usize,
    sign: f64,
    fixed: bool,
}

struct Prepared {
    pattern: Vec<Row>,
    sides: Vec<Side>,
    solver: DefaultSolver<f64>,
}

impl LeastDistance {
    pub fn new(A: Mat<f64>) -> Self {
        LeastDistance { norms: active_set::norms(&A), A, prepared: None }
    }

    /// A (rows × r).
    pub fn matrix(&self) -> &Mat<f64> {
        &self.A
    }

    /// Solves for the given bounds; infinite entries are no bounds.
    pub fn solve(&mut self, lo: &[f64], hi: &[f64]) -> Solution {
        match active_set::solve(self.A.as_ref(), &self.norms, lo, hi) {
            Some(Outcome::Optimal(t, iterations)) => Solution { t, status: Status::Optimal, iterations },
            Some(Outcome::Infeasible(iterations)) => {
                Solution { t: vec![0.0; self.A.ncols()], status: Status::Infeasible, iterations }
            }
            None => self.interior_point(lo, hi),
        }
    }

    /// Clarabel: the reference, and the way out where the active-set method is not certain.
    fn interior_point(&mut self, lo: &[f64], hi: &[f64]) -> Solution {
        let pattern: Vec<Row> = lo.iter().zip(hi).map(|(&l, &h)| Row::of(l, h)).collect();
        if self.prepared.as_ref().is_none_or(|q| q.pattern != pattern) {
            self.prepared = prepare(self.A.as_ref(), pattern);
        }
        let failed = Solution { t: vec![0.0; self.A.ncols()], status: Status::Failed, iterations: 0 };
        let Some(Prepared { sides, solver, .. }) = &mut self.prepared else { return failed };
        let b: Vec<f64> = sides.iter().map(|s| if s.sign > 0.0 { hi[s.row] } else { -lo[s.row] }).collect();
        if solver.update_b(&b).is_err() {
            return failed;
        }
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
        if let Some(t) = on_active_set(self.A.as_ref(), &self.norms, sides, &b, &solver.solution.z, &solver.solution.s)
        {
            return Solution { t, status: Status::Optimal, iterations };
        }
        match status {
            Status::Failed => Solution { iterations, ..failed },
            _ => Solution { t: solver.solution.x.clone(), status, iterations },
        }
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
        // both would drop or reorder rows and so forbid update_b
        presolve_enable: false,
        input_sparse_dropzeros: false,
        tol_gap_abs: tol::SOLVER,
        tol_gap_rel: tol::SOLVER,
        tol_feas: tol::SOLVER,
        ..DefaultSettings::default()
    }
}

/// Sets up the solver for one pattern of bounds. None only if Clarabel rejects the data.
fn prepare(A: MatRef<'_, f64>, pattern: Vec<Row>) -> Option<Prepared> {
    let mut sides: Vec<Side> = Vec::new();
    let fixed = pattern.iter().enumerate().filter(|(_, k)| **k == Row::Fixed);
    sides.extend(fixed.map(|(row, _)| Side { row, sign: 1.0, fixed: true }));
    for (row, kind) in pattern.iter().enumerate() {
        if matches!(kind, Row::Below | Row::Both) {
            sides.push(Side { row, sign: 1.0, fixed: false });
        }
        if matches!(kind, Row::Above | Row::Both) {
            sides.push(Side { row, sign: -1.0, fixed: false });
        }
    }
    let r = A.ncols();
    let equalities = sides.iter().filter(|s| s.fixed).count();
    let cones: Vec<SupportedConeT<f64>> = [ZeroConeT(equalities), NonnegativeConeT(sides.len() - equalities)].into();
    let m = sides.len();
    let signed = Mat::from_fn(m, r, |i, j| sides[i].sign * A[(sides[i].row, j)]);
    let dense = dense_to_csc(signed.as_ref());
    let identity = CscMatrix::identity(r);
    let solver = DefaultSolver::new(&identity, &vec![0.0; r], &dense, &vec![0.0; m], &cones, settings()).ok()?;
    Some(Prepared { pattern, sides, solver })
}

/// The exact minimiser, from the solver's last point.
///
/// Starting from the active set that multipliers z and slacks s suggest, rows that the least-norm point violates are
/// added and rows with a multiplier of the wrong sign dropped, one at a time, until the point is optimal: every row
/// satisfied and ν ≥ 0 on inequalities. None when that does not happen within a bounded number of changes.
fn on_active_set(
    A: MatRef<'_, f64>,
    norms: &[f64],
    sides: &[Side],
    b: &[f64],
    z: &[f64],
    s: &[f64],
) -> Option<Vec<f64>> {
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
        let moved = |a: usize| nu[a] * norms[sides[active[a]].row];
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const INF: f64 = f64::INFINITY;

    fn solve(rows: &[[f64; 2]], lo: &[f64], hi: &[f64]) -> Solution {
        LeastDistance::new(Mat::from_fn(rows.len(), 2, |i, j| rows[i][j])).solve(lo, hi)
    }

    fn close(t: &[f64], expected: [f64; 2]) -> bool {
        t.iter().zip(expected).all(|(t, e)| (t - e).abs() < 1e-12)
    }

    #[test]
    fn the_origin_is_the_answer_when_it_is_inside() {
        let s = solve(&[[1.0, 0.0], [1.0, 2.0]], &[-1.0, -INF], &[1.0, 3.0]);
        assert!(s.status == Status::Optimal && close(&s.t, [0.0, 0.0]), "{:?}", s.t);
    }

    #[test]
    fn projections_that_can_be_done_by_hand() {
        // onto x ≥ 1; onto the line x + y = 2; onto the corner of x ≥ 1, y ≥ 2
        assert!(close(&solve(&[[1.0, 0.0]], &[1.0], &[INF]).t, [1.0, 0.0]));
        assert!(close(&solve(&[[1.0, 1.0]], &[2.0], &[2.0]).t, [1.0, 1.0]));
        assert!(close(&solve(&[[1.0, 0.0], [0.0, 1.0]], &[1.0, 2.0], &[INF, INF]).t, [1.0, 2.0]));
    }

    #[test]
    fn redundant_and_repeated_rows_do_no_harm() {
        let s = solve(&[[1.0, 0.0], [1.0, 0.0], [2.0, 0.0]], &[1.0, 1.0, 2.0], &[INF, 3.0, INF]);
        assert!(s.status == Status::Optimal && close(&s.t, [1.0, 0.0]), "{:?}", s.t);
    }

    #[test]
    fn contradicting_bounds_are_infeasible() {
        assert_eq!(solve(&[[1.0, 0.0], [1.0, 0.0]], &[1.0, -INF], &[INF, 0.0]).status, Status::Infeasible);
    }

    #[test]
    fn a_kept_solver_gives_the_answer_of_a_new_one() {
        let A = Mat::from_fn(3, 2, |i, j| [[1.0, 0.2], [0.3, 1.0], [-1.0, 1.0]][i][j]);
        let mut kept = LeastDistance::new(A.clone());
        for k in 1..20 {
            let v = 0.1 * f64::from(k);
            let (lo, hi) = ([v, -1.0, -INF], [2.0 * v, 1.0, if k % 3 == 0 { INF } else { 0.5 - v }]);
            let (a, b) = (kept.solve(&lo, &hi), LeastDistance::new(A.clone()).solve(&lo, &hi));
            assert_eq!(a.status, b.status);
            assert!(close(&a.t, [b.t[0], b.t[1]]));
        }
    }

    /// Random windows with redundant, equal, opposite and nearly parallel rows, bounds that touch, and contradictions.
    /// The last number is the closest that two rows come to being parallel without being so: rounding of the data moves the
    /// answer by its inverse.
    fn random_problem(rng: &mut ChaCha8Rng) -> (Mat<f64>, Vec<f64>, Vec<f64>, f64) {
        let mut closest = 1.0_f64;
        let (rows, r) = (rng.random_range(1..40), rng.random_range(1..12));
        let mut A = Mat::from_fn(rows, r, |_, _| rng.random_range(-1.0..1.0_f64));
        let inside: Vec<f64> = (0..r).map(|_| rng.random_range(-2.0..2.0)).collect();
        for i in 1..rows {
            let other = rng.random_range(0..i);
            let (scale, off): (f64, f64) = match rng.random_range(0..16) {
                0 => (1.0, 0.0),
                1 => (-2.0, 0.0),
                2 if rng.random_bool(0.2) => (1.0, 1e-8),
                2 => (1.0, 1e-4),
                3 => (0.0, 0.0),
                _ => continue,
            };
            closest = closest.min(if off > 0.0 { off } else { 1.0 });
            (0..r).for_each(|j| A[(i, j)] = scale * A[(other, j)] + off * rng.random_range(-1.0..1.0));
        }
        let (mut lo, mut hi) = (vec![-INF; rows], vec![INF; rows]);
        let contradiction = rng.random_bool(0.1);
        for i in 0..rows {
            let w: f64 = (0..r).map(|j| A[(i, j)] * inside[j]).sum();
            let shift = if contradiction && rng.random_bool(0.2) { 1.5 } else { 0.0 };
            match rng.random_range(0..6) {
                0 => (lo[i], hi[i]) = (w + shift, w + shift), // touch
                1 => lo[i] = w + shift - rng.random_range(0.0..0.3),
                2 => hi[i] = w - shift + rng.random_range(0.0..0.3),
                3 => {}
                _ => (lo[i], hi[i]) = (w + shift - rng.random_range(0.0..0.5), w + shift + rng.random_range(0.0..0.5)),
            }
        }
        (A, lo, hi, closest)
    }

    #[test]
    fn the_active_set_method_gives_the_interior_point_s_answer() {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let (mut optimal, mut infeasible, mut left) = (0, 0, 0);
        for k in 0..20_000 {
            let (A, lo, hi, closest) = random_problem(&mut rng);
            let mut problem = LeastDistance::new(A.clone());
            let reference = problem.interior_point(&lo, &hi);
            match active_set::solve(A.as_ref(), &problem.norms, &lo, &hi) {
                Some(Outcome::Optimal(t, _)) => {
                    // one that the reference calls infeasible may only be so by its tolerance
                    assert_ne!(reference.status, Status::Infeasible, "{k}");
                    if reference.status == Status::Optimal {
                        let excess = |i: usize| {
                            let w: f64 = (0..t.len()).map(|j| A[(i, j)] * t[j]).sum();
                            (lo[i] - w).max(w - hi[i])
                        };
                        assert!((0..A.nrows()).all(|i| excess(i) < 1e-9), "{k}");
                        let size = t.iter().fold(1.0_f64, |m, v| m.max(v.abs()));
                        let off = t.iter().zip(&reference.t).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
                        assert!(closest < 1e-6 || off <= 1e-9 * size, "{k}: {off:e}");
                    }
                    optimal += 1;
                }
                Some(Outcome::Infeasible(_)) => {
                    // "almost optimal" is what the reference calls points that miss such bounds by 1 and more
                    assert_ne!(reference.status, Status::Optimal, "{k}");
                    infeasible += 1;
                }
                None => left += 1,
            }
        }
        // it must do nearly all of the work, and see contradictions
        assert!(optimal > 15_000 && infeasible > 500 && left < 1000, "{optimal} {infeasible} {left}");
    }
}
