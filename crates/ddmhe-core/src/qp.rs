//! Small dense programmes, the only file of the crate that names Clarabel: what it proposes where
//! the dual active-set method of `active_set` is not certain. Nothing that it says is believed:
//! `way_out` checks the points and the multipliers.
//!
//! The estimator hands over a least-distance problem: with t the deviation from the unconstrained
//! minimiser, in coordinates where the cost's Hessian is the identity,
//!
//! > minimise ½‖t‖²  subject to  lo ≤ A t ≤ hi,
//!
//! with rows of unit length.

use crate::tol;
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SupportedConeT, ZeroConeT,
};
use ddmhe_run::active_set::ActiveBound;
use faer::{Mat, MatRef};

/// What the solver proposes: a point, and multipliers of at least 0.
pub(crate) struct Proposal {
    pub t: Vec<f64>,
    pub multipliers: Vec<(ActiveBound, f64)>,
    pub iterations: u32,
}

/// One of the programmes below.
pub(crate) type Programme = fn(MatRef<'_, f64>, &[f64], &[f64]) -> Option<Proposal>;

/// Minimises ½‖t‖² subject to lo ≤ A t ≤ hi, A (rows × r); infinite entries are no bounds. None if
/// the data are rejected. Where there is no such t, the multipliers are those of a proof of it.
pub(crate) fn least_distance(A: MatRef<'_, f64>, lo: &[f64], hi: &[f64]) -> Option<Proposal> {
    let r = A.ncols();
    let bounds = || lo.iter().zip(hi).enumerate();
    // equalities first, as the cones want them
    let fixed =
        bounds().filter(|(_, (l, h))| l == h).map(|(row, _)| ActiveBound { row, sign: 1.0 });
    let open = bounds().filter(|(_, (l, h))| l != h).flat_map(|(row, (l, h))| {
        let side = |sign: f64, bound: &f64| bound.is_finite().then_some(ActiveBound { row, sign });
        [side(1.0, l), side(-1.0, h)].into_iter().flatten()
    });
    let equalities = fixed.clone().count();
    let sides: Vec<ActiveBound> = fixed.chain(open).collect();
    // -sign aᵀt ≤ -sign bound
    let rows = Mat::from_fn(sides.len(), r, |i, j| -sides[i].sign * A[(sides[i].row, j)]);
    let b: Vec<f64> =
        sides.iter().map(|s| if s.sign > 0.0 { -lo[s.row] } else { hi[s.row] }).collect();
    let cones: [SupportedConeT<f64>; 2] =
        [ZeroConeT(equalities), NonnegativeConeT(sides.len() - equalities)];
    let sparse = dense_to_csc(rows.as_ref());
    let mut solver =
        DefaultSolver::new(&CscMatrix::identity(r), &vec![0.0; r], &sparse, &b, &cones, settings())
            .ok()?;
    solver.solve();
    let outward = |(side, z): (&ActiveBound, &f64)| {
        (ActiveBound { sign: side.sign * z.signum(), ..*side }, z.abs())
    };
    Some(Proposal {
        t: solver.solution.x.clone(),
        multipliers: sides.iter().zip(&solver.solution.z).map(outward).collect(),
        iterations: solver.solution.iterations,
    })
}

/// The smallest s ≥ -1 by which all bounds must be loosened to leave a t: lo - s ≤ A t ≤ hi + s.
/// Its multipliers are those of a proof if s is positive.
pub(crate) fn least_excess(A: MatRef<'_, f64>, lo: &[f64], hi: &[f64]) -> Option<Proposal> {
    let r = A.ncols();
    let bounds = || lo.iter().zip(hi).enumerate();
    let sides: Vec<ActiveBound> = bounds()
        .flat_map(|(row, (l, h))| {
            let side =
                |sign: f64, bound: &f64| bound.is_finite().then_some(ActiveBound { row, sign });
            [side(1.0, l), side(-1.0, h)].into_iter().flatten()
        })
        .collect();
    // variables (t, s): -sign aᵀt - s ≤ -sign bound; -s ≤ 1
    let rows = Mat::from_fn(sides.len() + 1, r + 1, |i, j| match (sides.get(i), j == r) {
        (Some(side), false) => -side.sign * A[(side.row, j)],
        (None, false) => 0.0,
        (_, true) => -1.0,
    });
    let mut b: Vec<f64> =
        sides.iter().map(|s| if s.sign > 0.0 { -lo[s.row] } else { hi[s.row] }).collect();
    b.push(1.0);
    let mut cost = vec![0.0; r];
    cost.push(1.0);
    let cones = [NonnegativeConeT(sides.len() + 1)];
    let sparse = dense_to_csc(rows.as_ref());
    let mut solver = DefaultSolver::new(
        &CscMatrix::zeros((r + 1, r + 1)),
        &cost,
        &sparse,
        &b,
        &cones,
        settings(),
    )
    .ok()?;
    solver.solve();
    Some(Proposal {
        t: solver.solution.x[..r].to_vec(),
        multipliers: sides
            .iter()
            .zip(&solver.solution.z)
            .map(|(side, z)| (*side, z.max(0.0)))
            .collect(),
        iterations: solver.solution.iterations,
    })
}

fn dense_to_csc(A: MatRef<'_, f64>) -> CscMatrix<f64> {
    let (m, r) = (A.nrows(), A.ncols());
    let values = (0..r).flat_map(|j| (0..m).map(move |i| A[(i, j)])).collect();
    CscMatrix::new(
        m,
        r,
        (0..=r).map(|j| j * m).collect(),
        (0..r).flat_map(|_| 0..m).collect(),
        values,
    )
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
