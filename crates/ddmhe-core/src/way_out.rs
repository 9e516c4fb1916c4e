//! What is done where the dual active-set method is not certain: nearly dependent rows, bounds far
//! away from z*, contradictions.
//!
//! Active bounds are proposed by the same method trusting everything and by Clarabel; the minimiser
//! on them is computed anew. The best point is the answer if the optimality conditions hold there,
//! which is checked on the window itself. For no window there must be a combination of bounds that
//! proves it. What is left is [`Status::Failed`].
//!
//! *The check.* A point z with window w, multipliers u ≥ 0 on sides with normals n and t = z - z*
//! has the residual ε if every row is inside its bounds to ε of its unit, every row with a
//! multiplier is at its bound to ε of its unit, ‖t - Σ u n‖ is at most ε times the larger of ‖t‖
//! and ‖z*‖, and Σ u |distance to the bound|, the duality gap, ε times its square. Then z is *the*
//! minimiser of a problem whose bounds and z* are moved by so much, and its distance to z* is the
//! smallest up to so much.

use crate::own::OwnSet;
use crate::qp;
use crate::tol;
use ddmhe_run::Status;
use ddmhe_run::active_set::{
    ActiveBound, Combination, Erased, Outcome, Trust, solve_lower, solve_transposed, work_len,
};
use faer::Mat;

/// The bounded rows, in coordinates t in which the Hessian is the identity.
struct Bounded<'a, 'b> {
    problem: &'a Erased<'b>,
    rows: Vec<usize>,
    normals: Mat<f64>, // rows × r, of unit length
    lengths: Vec<f64>, // that the normals of the problem have in these coordinates
    lo: Vec<f64>,      // distances from z*
    hi: Vec<f64>,
    units: Vec<f64>,
    stride: usize,
    r: usize,
}

/// Sides that may be those of the minimiser, by their place among the bounded rows, and whether it
/// is proved that there is none.
#[derive(Default)]
struct Proposed {
    point: Point,
    infeasible: bool,
}

/// How far a point is from what the optimality conditions ask for.
#[derive(Debug, Clone, Copy)]
struct Residual {
    bounds: f64,
    minimiser: f64,
}

impl Residual {
    const NONE: Residual = Residual { bounds: f64::INFINITY, minimiser: f64::INFINITY };
    const OPTIMAL: Residual = Residual { bounds: tol::ACTIVE_SET, minimiser: tol::ACTIVE_SET };
    const ALMOST: Residual = Residual { bounds: tol::ALMOST.0, minimiser: tol::ALMOST.1 };

    fn within(self, limit: Residual) -> bool {
        self.bounds <= limit.bounds && self.minimiser <= limit.minimiser
    }

    /// To compare points with.
    fn worst(self) -> f64 {
        (self.bounds / tol::ALMOST.0).max(self.minimiser / tol::ALMOST.1)
    }
}

/// The best point that was found.
struct Answer {
    residual: Residual,
    z: Vec<f64>,
    infeasible: bool,
    iterations: u32,
}

/// A minimiser on active sides.
#[derive(Clone, Default)]
struct Point {
    sides: Vec<ActiveBound>,
    multipliers: Vec<f64>,
    t: Vec<f64>,
}

/// Into z and its window w: the answer, or z* with its window if there is none.
#[cold]
pub(crate) fn way_out(problem: &Erased<'_>, z: &mut [f64], w: &mut [f64]) -> (Status, u32) {
    let rows = Bounded::new(problem, w);
    let known = |bounds: &[f64]| bounds.iter().all(|b| !b.is_nan());
    if !problem.unconstrained.iter().all(|z| z.is_finite()) || !known(&rows.lo) || !known(&rows.hi)
    {
        z[..rows.r].copy_from_slice(&problem.unconstrained[..rows.r]);
        return (Status::Failed, 0);
    }
    let Answer { residual, z: point, infeasible, iterations } = rows.answer(z, w);
    let status = match residual {
        _ if infeasible => Status::Infeasible,
        residual if residual.within(Residual::OPTIMAL) => Status::Optimal,
        residual if residual.within(Residual::ALMOST) => Status::AlmostOptimal,
        _ => Status::Failed,
    };
    let answered = matches!(status, Status::Optimal | Status::AlmostOptimal);
    z[..rows.r].copy_from_slice(if answered { &point } else { &problem.unconstrained[..rows.r] });
    problem.windows.window(&z[..rows.r], w);
    (if answered { problem.as_far_as_inside(w, status) } else { status }, iterations)
}

impl<'a, 'b> Bounded<'a, 'b> {
    fn new(problem: &'a Erased<'b>, w: &mut [f64]) -> Self {
        let (all, r) = (problem.rows, problem.rows.r);
        let stride = r.next_multiple_of(4);
        problem.windows.window(&problem.unconstrained[..r], w);
        let bounded = |i: &usize| problem.lo[*i].is_finite() || problem.hi[*i].is_finite();
        let rows: Vec<usize> = (0..all.len()).filter(bounded).collect();
        let mut normals = Mat::zeros(rows.len(), r);
        let mut lengths = vec![1.0; rows.len()];
        for (k, &i) in rows.iter().enumerate() {
            let mut normal = all.normal(i)[..r].to_vec();
            if let Some(L) = problem.hessian_factor {
                solve_lower(L, &mut normal, stride);
            }
            let length = norm(&normal);
            if length > 0.0 {
                lengths[k] = length;
                (0..r).for_each(|j| normals[(k, j)] = normal[j] / length);
            }
        }
        let scale = |k: usize| all.inverse[rows[k]] / lengths[k];
        let distance = |bounds: &[f64]| {
            (0..rows.len()).map(|k| (bounds[rows[k]] - w[rows[k]]) * scale(k)).collect()
        };
        Bounded {
            lo: distance(problem.lo),
            hi: distance(problem.hi),
            units: (0..rows.len()).map(|k| all.unit[rows[k]] * scale(k)).collect(),
            problem,
            rows,
            normals,
            lengths,
            stride,
            r,
        }
    }

    /// The best of all proposals; z and w are what they are tried in.
    fn answer(&self, z: &mut [f64], w: &mut [f64]) -> Answer {
        let none = Residual::NONE;
        let mut best =
            Answer { residual: none, z: Vec::new(), infeasible: self.none_moves(), iterations: 0 };
        for propose in [Bounded::trusting, Bounded::least_distance, Bounded::least_excess] {
            if best.residual.within(Residual::OPTIMAL) || best.infeasible {
                break;
            }
            let Proposed { point, infeasible } = propose(self, &mut best.iterations, z, w);
            best.infeasible = infeasible;
            let exact = tol::CUTS.iter().map(|&cut| self.minimiser(point.sides.clone(), cut));
            for point in exact.flatten().chain([point.clone()]) {
                self.settle(&point, z, w);
                let residual = self.residual(&point, z, w);
                if residual.worst() < best.residual.worst() {
                    (best.residual, best.z) = (residual, z[..self.r].to_vec());
                }
                if residual.within(Residual::OPTIMAL) {
                    break;
                }
            }
        }
        best.infeasible &= !best.residual.within(Residual::OPTIMAL);
        best
    }

    /// Whether a row that does not move at all is outside of its bounds.
    fn none_moves(&self) -> bool {
        let still = |k: usize| self.normals.row(k).norm_max() == 0.0;
        let outside = |k: usize| self.lo[k].max(-self.hi[k]) > tol::ACTIVE_SET * self.units[k];
        (0..self.rows.len()).any(|k| still(k) && outside(k))
    }

    /// The dual active-set method, trusting everything.
    fn trusting(&self, iterations: &mut u32, z: &mut [f64], w: &mut [f64]) -> Proposed {
        let trusting = Erased { trust: Trust::ANYTHING, ..*self.problem };
        let mut set = OwnSet::new(self.r);
        let mut working = set.working();
        let mut memory = vec![0.0; work_len(self.r)];
        let (outcome, u) = trusting.anew(&mut working, &mut memory, z, w);
        let sides = working.sides.iter();
        if let Outcome::Optimal(changes) | Outcome::Infeasible(changes) = outcome {
            *iterations += changes;
        }
        let place = |side: &ActiveBound| {
            self.rows.binary_search(&side.row).ok().map(|row| ActiveBound { row, ..*side })
        };
        let sides: Vec<ActiveBound> = sides.filter_map(|side| place(&side)).collect();
        let multipliers = sides.iter().zip(u).map(|(side, u)| u * self.lengths[side.row]).collect();
        let infeasible = matches!(outcome, Outcome::Infeasible(_));
        Proposed { point: self.point(sides, multipliers), infeasible }
    }

    /// Clarabel on the problem itself.
    fn least_distance(&self, iterations: &mut u32, _: &mut [f64], _: &mut [f64]) -> Proposed {
        self.proposed(qp::least_distance, iterations)
    }

    /// Clarabel on the smallest violation that all bounds have in common.
    fn least_excess(&self, iterations: &mut u32, _: &mut [f64], _: &mut [f64]) -> Proposed {
        self.proposed(qp::least_excess, iterations)
    }

    fn proposed(&self, solve: qp::Propose, iterations: &mut u32) -> Proposed {
        // distances of about 1, whatever the problem's
        let far = (0..self.rows.len())
            .map(|k| self.lo[k].max(-self.hi[k]))
            .fold(f64::MIN_POSITIVE, f64::max);
        let scaled = |bounds: &[f64]| bounds.iter().map(|b| b / far).collect::<Vec<f64>>();
        let (lo, hi) = (scaled(&self.lo), scaled(&self.hi));
        let Some(proposal) = solve(self.normals.as_ref(), &lo, &hi) else {
            return Proposed::default();
        };
        *iterations += proposal.iterations;
        // active: a multiplier that is larger than the distance to the bound
        let slack = |side: &ActiveBound| {
            let along: f64 = (0..self.r).map(|j| self.normals[(side.row, j)] * proposal.t[j]).sum();
            side.sign * (along - if side.sign > 0.0 { lo[side.row] } else { hi[side.row] })
        };
        let active = proposal.multipliers.iter().filter(|(side, u)| *u > slack(side));
        let (sides, multipliers) = active.map(|(side, u)| (*side, u * far)).unzip();
        Proposed {
            point: self.point(sides, multipliers),
            infeasible: self.proves(&proposal.multipliers),
        }
    }

    /// t = Σ u n.
    fn point(&self, sides: Vec<ActiveBound>, multipliers: Vec<f64>) -> Point {
        let mut t = vec![0.0; self.r];
        for (side, u) in sides.iter().zip(&multipliers) {
            (0..self.r).for_each(|j| t[j] += side.sign * u * self.normals[(side.row, j)]);
        }
        Point { sides, multipliers, t }
    }

    fn bound(&self, side: ActiveBound) -> f64 {
        if side.sign > 0.0 { self.lo[side.row] } else { self.hi[side.row] }
    }

    /// The minimiser, from sides that may be active: those that it violates are added and those
    /// with a multiplier of the wrong sign dropped, one at a time. None if that does not end within
    /// a bounded number of changes.
    fn minimiser(&self, mut sides: Vec<ActiveBound>, cut: f64) -> Option<Point> {
        for _ in 0..tol::ACTIVE_SET_CHANGES {
            let (t, multipliers) =
                self.least_norm(&sides, cut, |side| side.sign * self.bound(side))?;
            let size = norm(&t);
            let excess = |side: ActiveBound| {
                let along: f64 = (0..self.r).map(|j| self.normals[(side.row, j)] * t[j]).sum();
                side.sign * (self.bound(side) - along)
                    / (self.units[side.row] + tol::RELATIVE * size)
            };
            let both = (0..self.rows.len())
                .flat_map(|row| [1.0, -1.0].map(|sign| ActiveBound { row, sign }));
            let worst = both
                .filter(|s| self.bound(*s).is_finite())
                .max_by(|a, b| excess(*a).total_cmp(&excess(*b)))?;
            if excess(worst) > tol::ACTIVE_SET {
                if sides.contains(&worst) {
                    return None; // dependent rows that contradict each other
                }
                sides.retain(|side| side.row != worst.row);
                sides.push(worst);
                continue;
            }
            let least = (0..sides.len()).min_by(|&a, &b| multipliers[a].total_cmp(&multipliers[b]));
            match least {
                Some(a) if multipliers[a] < -tol::WRONG_SIGN * size => {
                    sides.remove(a);
                }
                _ => return Some(Point { sides, multipliers, t }),
            }
        }
        None
    }

    /// The shortest t with given components along the outward normals of sides, and its
    /// multipliers: t = N u.
    fn least_norm(
        &self,
        sides: &[ActiveBound],
        cut: f64,
        along: impl Fn(ActiveBound) -> f64,
    ) -> Option<(Vec<f64>, Vec<f64>)> {
        let (mut t, mut u) = (vec![0.0; self.r], vec![0.0; sides.len()]);
        if sides.is_empty() {
            return Some((t, u));
        }
        let N = Mat::from_fn(sides.len(), self.r, |i, j| {
            sides[i].sign * self.normals[(sides[i].row, j)]
        });
        let svd = N.thin_svd().ok()?;
        let sigma = svd.S().column_vector();
        for i in (0..sigma.nrows()).take_while(|&i| sigma[i] > cut * sigma[0]) {
            let part =
                (0..sides.len()).map(|a| svd.U()[(a, i)] * along(sides[a])).sum::<f64>() / sigma[i];
            (0..self.r).for_each(|j| t[j] += part * svd.V()[(j, i)]);
            (0..sides.len()).for_each(|a| u[a] += part / sigma[i] * svd.U()[(a, i)]);
        }
        Some((t, u))
    }

    /// The point in z, moved back onto its sides as often as its distance to z* takes their digits,
    /// and its window in w.
    fn settle(&self, point: &Point, z: &mut [f64], w: &mut [f64]) {
        let Erased { hessian_factor, windows, unconstrained: free, .. } = *self.problem;
        let (r, mut step) = (self.r, point.t.clone());
        z[..r].copy_from_slice(&free[..r]);
        for _ in 0..=tol::REFINEMENTS {
            if let Some(L) = hessian_factor {
                solve_transposed(L, &mut step, self.stride);
            }
            z.iter_mut().zip(&step).for_each(|(z, step)| *z += step);
            windows.window(&z[..r], w);
            let off = |side: &ActiveBound| {
                self.missing(*side, w).abs() > tol::VIOLATED * self.units[side.row]
            };
            if !point.sides.iter().any(off) {
                break;
            }
            let Some((back, _)) =
                self.least_norm(&point.sides, tol::SETTLE, |side| self.missing(side, w))
            else {
                break;
            };
            step = back;
        }
    }

    /// What is missing of the window to a side's bound, along its normal.
    fn missing(&self, side: ActiveBound, w: &[f64]) -> f64 {
        let row = self.rows[side.row];
        let bound = self.problem.bound(ActiveBound { row, ..side });
        side.sign * (bound - w[row]) * self.problem.rows.inverse[row] / self.lengths[side.row]
    }

    /// ε of z with its window w.
    fn residual(&self, point: &Point, z: &[f64], w: &[f64]) -> Residual {
        let free = &self.problem.unconstrained[..self.r];
        let moved: Vec<f64> = z.iter().zip(free).map(|(z, free)| z - free).collect();
        let (mut rest, scale) = (self.transformed(&moved), norm(&self.transformed(free)));
        let scale = norm(&rest).max(scale);
        // a row is summed from numbers of this size
        let rounding = tol::SUMMED * norm(&self.transformed(&z[..self.r]));
        let units = |k: usize| self.units[k] + rounding;
        let (mut bounds, mut gap) = (0.0_f64, 0.0);
        for (side, &u) in point.sides.iter().zip(&point.multipliers).filter(|(_, u)| **u > 0.0) {
            (0..self.r).for_each(|j| rest[j] -= side.sign * u * self.normals[(side.row, j)]);
            let off = self.missing(*side, w).abs();
            bounds = bounds.max(off / units(side.row));
            gap += u * off;
        }
        for k in 0..self.rows.len() {
            for side in [1.0, -1.0]
                .map(|sign| ActiveBound { row: k, sign })
                .into_iter()
                .filter(|s| self.bound(*s).is_finite())
            {
                bounds = bounds.max(self.missing(side, w) / units(k));
            }
        }
        let minimiser = (norm(&rest) / scale).max(gap / (scale * scale));
        let finite = bounds.is_finite()
            && minimiser.is_finite()
            && z[..self.r].iter().all(|z| z.is_finite());
        if finite { Residual { bounds, minimiser } } else { Residual::NONE }
    }

    /// Lᵀ x for a Hessian L Lᵀ.
    fn transformed(&self, x: &[f64]) -> Vec<f64> {
        let Some(L) = self.problem.hessian_factor else { return x.to_vec() };
        (0..self.r).map(|j| (j..self.r).map(|i| L[i * self.stride + j] * x[i]).sum()).collect()
    }

    /// Whether the multipliers, once what is left of their normals is taken out of them, prove that
    /// there is no window.
    fn proves(&self, multipliers: &[(ActiveBound, f64)]) -> bool {
        let largest = multipliers.iter().map(|(_, u)| *u).fold(0.0, f64::max);
        let (sides, mut u): (Vec<ActiveBound>, Vec<f64>) =
            multipliers.iter().filter(|(_, u)| *u > tol::SUPPORT * largest).copied().unzip();
        if sides.is_empty() {
            return false;
        }
        let N = Mat::from_fn(sides.len(), self.r, |i, j| {
            sides[i].sign * self.normals[(sides[i].row, j)]
        });
        let Ok(svd) = N.thin_svd() else { return false };
        let sigma = svd.S().column_vector();
        let mut sum = Combination::default();
        for _ in 0..tol::REFINEMENTS {
            let rest: Vec<f64> =
                (0..self.r).map(|j| (0..u.len()).map(|a| N[(a, j)] * u[a]).sum()).collect();
            sum = Combination::new(norm(&rest));
            let weigh = |(side, u): (&ActiveBound, &f64)| {
                let outside = ActiveBound { row: self.rows[side.row], ..*side };
                self.problem.weigh(outside, u / self.lengths[side.row], &mut sum);
            };
            sides.iter().zip(&u).for_each(weigh);
            for i in (0..sigma.nrows()).take_while(|&i| sigma[i] > tol::PARALLEL * sigma[0]) {
                let part = (0..self.r).map(|j| svd.V()[(j, i)] * rest[j]).sum::<f64>() / sigma[i];
                (0..u.len()).for_each(|a| u[a] = (u[a] - part * svd.U()[(a, i)]).max(0.0));
            }
        }
        sum.proves()
    }
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>().sqrt()
}

#[cfg(test)]
pub(crate) mod tests;
