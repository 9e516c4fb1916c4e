//! What an interior-point solver proposes where the dual active-set method of `active_set` is not
//! certain. Nothing that it says is believed: `way_out` checks the points and the multipliers.
//!
//! The estimator hands over a least-distance problem: with t the deviation from the unconstrained
//! minimiser, in coordinates where the cost's Hessian is the identity,
//!
//! > minimise ½‖t‖²  subject to  lo ≤ A t ≤ hi,
//!
//! with rows of unit length.

use crate::tol;
use ddmhe_interval::programme::Programme;
use ddmhe_run::active_set::ActiveBound;
use faer::MatRef;

/// What the solver proposes: a point, and multipliers of at least 0.
pub(crate) struct Proposal {
    pub t: Vec<f64>,
    pub multipliers: Vec<(ActiveBound, f64)>,
    pub iterations: u32,
}

/// One of the two below.
pub(crate) type Propose = fn(MatRef<'_, f64>, &[f64], &[f64]) -> Option<Proposal>;

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
    let programme = Programme {
        quadratic: true,
        cost: vec![0.0; r],
        columns: (0..r).flat_map(|j| inward(A, &sides, j)).collect(),
        b: limits(&sides, lo, hi).collect(),
        equations: equalities,
    };
    let found = programme.propose(tol::SOLVER)?;
    let outward = |(side, z): (&ActiveBound, &f64)| {
        (ActiveBound { sign: side.sign * z.signum(), ..*side }, z.abs())
    };
    Some(Proposal {
        multipliers: sides.iter().zip(&found.z).map(outward).collect(),
        t: found.x,
        iterations: found.iterations,
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
    let columns = (0..r).flat_map(|j| inward(A, &sides, j).chain([0.0]));
    let programme = Programme {
        quadratic: false,
        cost: (0..=r).map(|j| f64::from(u8::from(j == r))).collect(),
        columns: columns.chain(sides.iter().map(|_| -1.0)).chain([-1.0]).collect(),
        b: limits(&sides, lo, hi).chain([1.0]).collect(),
        equations: 0,
    };
    let found = programme.propose(tol::SOLVER)?;
    Some(Proposal {
        t: found.x[..r].to_vec(),
        multipliers: sides.iter().zip(&found.z).map(|(side, z)| (*side, z.max(0.0))).collect(),
        iterations: found.iterations,
    })
}

/// Column j of the rows -sign aᵀ …
fn inward<'a>(
    A: MatRef<'a, f64>,
    sides: &'a [ActiveBound],
    j: usize,
) -> impl Iterator<Item = f64> + 'a {
    sides.iter().map(move |side| -side.sign * A[(side.row, j)])
}

/// … ≤ -sign bound.
fn limits<'a>(
    sides: &'a [ActiveBound],
    lo: &'a [f64],
    hi: &'a [f64],
) -> impl Iterator<Item = f64> + 'a {
    sides.iter().map(|s| if s.sign > 0.0 { -lo[s.row] } else { hi[s.row] })
}
