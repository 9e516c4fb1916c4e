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

use crate::active_set::{
    ActiveBound, Combination, Outcome, Problem, Trust, Windows, WorkingSet, solve_lower,
    solve_transposed,
};
use crate::qp;
use crate::status::Status;
use crate::tol;
use faer::Mat;

/// The bounded rows, in coordinates t in which the Hessian is the identity.
struct Bounded<'a, 'b, W: Windows> {
    problem: &'a Problem<'b, W>,
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

/// The dual active-set method and, where that is not certain, the way out.
#[inline(always)]
pub(crate) fn decide<W: Windows>(
    problem: &Problem<'_, W>,
    (kept, work): (&mut WorkingSet, &mut [f64]),
    z: &mut [f64],
    w: &mut [f64],
) -> (Status, u32) {
    match problem.solve(kept, work, z, w) {
        Outcome::Optimal(changes) => (Status::Optimal, changes),
        Outcome::Infeasible(changes) => {
            problem.windows.window(&problem.free[..problem.rows.r()], w);
            (Status::Infeasible, changes)
        }
        Outcome::Uncertain => way_out(problem, z, w),
    }
}

/// Into z and its window w: the answer, or z* with its window if there is none.
#[cold]
pub(crate) fn way_out<W: Windows>(
    problem: &Problem<'_, W>,
    z: &mut [f64],
    w: &mut [f64],
) -> (Status, u32) {
    let rows = Bounded::new(problem, w);
    let known = |bounds: &[f64]| bounds.iter().all(|b| !b.is_nan());
    if !problem.free.iter().all(|z| z.is_finite()) || !known(&rows.lo) || !known(&rows.hi) {
        z[..rows.r].copy_from_slice(&problem.free[..rows.r]);
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
    z[..rows.r].copy_from_slice(if answered { &point } else { &problem.free[..rows.r] });
    problem.windows.window(&z[..rows.r], w);
    (if answered { problem.as_far_as_inside(w, status) } else { status }, iterations)
}

impl<'a, 'b, W: Windows> Bounded<'a, 'b, W> {
    fn new(problem: &'a Problem<'b, W>, w: &mut [f64]) -> Self {
        let (all, r) = (problem.rows, problem.rows.r());
        let stride = r.next_multiple_of(4);
        problem.windows.window(&problem.free[..r], w);
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
        let scale = |k: usize| all.inverse(rows[k]) / lengths[k];
        let distance = |bounds: &[f64]| {
            (0..rows.len()).map(|k| (bounds[rows[k]] - w[rows[k]]) * scale(k)).collect()
        };
        Bounded {
            lo: distance(problem.lo),
            hi: distance(problem.hi),
            units: (0..rows.len()).map(|k| all.unit()[rows[k]] * scale(k)).collect(),
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
        let trusting = Problem { trust: Trust::ANYTHING, ..*self.problem };
        let (outcome, sides, u) = trusting.anew(z, w);
        if let Outcome::Optimal(changes) | Outcome::Infeasible(changes) = outcome {
            *iterations += changes;
        }
        let place = |side: &ActiveBound| {
            self.rows.binary_search(&side.row).ok().map(|row| ActiveBound { row, ..*side })
        };
        let sides: Vec<ActiveBound> = sides.iter().filter_map(place).collect();
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

    fn proposed(&self, solve: qp::Programme, iterations: &mut u32) -> Proposed {
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
        let Problem { hessian_factor, windows, free, .. } = *self.problem;
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
        side.sign * (bound - w[row]) * self.problem.rows.inverse(row) / self.lengths[side.row]
    }

    /// ε of z with its window w.
    fn residual(&self, point: &Point, z: &[f64], w: &[f64]) -> Residual {
        let free = &self.problem.free[..self.r];
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
mod tests {
    use super::*;
    use crate::active_set::{Rows, work_len};
    use crate::panels::padded;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::collections::BTreeMap;

    const INF: f64 = f64::INFINITY;

    /// Rows in units up to 1e8 apart, some of them equal, opposite or parallel up to 1e-4 … 1e-14,
    /// with z* at up to 1e9.
    struct Hostile {
        A: Mat<f64>,
        unit: Vec<f64>,
        free: Vec<f64>,
        inside: Vec<f64>,
        lo: Vec<f64>,
        hi: Vec<f64>,
        excess: f64, // by which a pair of bounds contradict each other, in units; 0: `inside` satisfies all
    }

    fn along(A: &Mat<f64>, row: usize, z: &[f64]) -> f64 {
        (0..A.ncols()).map(|j| A[(row, j)] * z[j]).sum()
    }

    fn hostile(rng: &mut ChaCha8Rng) -> Hostile {
        let (rows, r): (usize, usize) = (rng.random_range(2..60), rng.random_range(1..16));
        let len = padded(rows);
        let mut unit = vec![0.0; len];
        let mut A = Mat::zeros(len, r);
        for i in 0..rows {
            let other = if i > 0 { rng.random_range(0..i) } else { 0 };
            let (sign, off) = match rng.random_range(0..12) {
                0 if i > 0 => (1.0, 0.0),
                1 if i > 0 => (-1.0, 0.0),
                2 if i > 0 => (
                    if rng.random_bool(0.5) { 1.0 } else { -1.0 },
                    10_f64.powi(-rng.random_range(2..15)),
                ),
                _ => (0.0, 1.0),
            };
            let scale =
                if rng.random_bool(0.5) { 1.0 } else { 10_f64.powf(rng.random_range(-8.0..0.0)) };
            let length = if unit[other] > 0.0 { unit[other] } else { 1.0 };
            for j in 0..r {
                A[(i, j)] =
                    scale * (sign * A[(other, j)] / length + off * rng.random_range(-1.0..1.0));
            }
            unit[i] = scale;
        }
        let inside: Vec<f64> = (0..r).map(|_| rng.random_range(-2.0..2.0)).collect();
        let far = if rng.random_bool(0.5) { 3.0 } else { 10_f64.powf(rng.random_range(0.0..9.0)) };
        let mut free = vec![0.0; padded(r)];
        (0..r).for_each(|j| free[j] = inside[j] + far * rng.random_range(-1.0..1.0));
        let (mut lo, mut hi) = (vec![-INF; len], vec![INF; len]);
        for i in 0..rows {
            let w = along(&A, i, &inside);
            let mut room =
                || if rng.random_bool(0.3) { 0.0 } else { unit[i] * rng.random_range(0.0..0.5) };
            let (below, above) = (room(), room());
            match rng.random_range(0..5) {
                0 => (lo[i], hi[i]) = (w, w),
                1 => lo[i] = w - below,
                2 => hi[i] = w + above,
                3 => {}
                _ => (lo[i], hi[i]) = (w - below, w + above),
            }
        }
        let mut excess = 0.0;
        if rng.random_bool(0.3) {
            // the last row is the first one, or a sum of others, with a bound that these exclude
            let many = rng.random_range(1..=(rows - 1).min(r));
            let weights: Vec<f64> = (0..many).map(|_| rng.random_range(0.1..1.0)).collect();
            excess = 10_f64.powf(rng.random_range(-8.0..1.0));
            let last = rows - 1;
            unit[last] = 1.0;
            (0..r).for_each(|j| {
                A[(last, j)] = (0..many).map(|i| weights[i] * A[(i, j)] / unit[i]).sum();
            });
            for i in 0..many {
                hi[i] = along(&A, i, &inside);
                lo[i] = lo[i].min(hi[i]);
            }
            lo[last] = (0..many).map(|i| weights[i] * hi[i] / unit[i]).sum::<f64>()
                + excess * (many as f64 + 1.0);
            hi[last] = INF;
        }
        Hostile { A, unit, free, inside, lo, hi, excess }
    }

    /// Status, and the largest violation in units and the distance from z*.
    fn solve(p: &Hostile) -> (Status, bool, Vec<f64>, Vec<f64>) {
        let (len, r) = (p.A.nrows(), p.A.ncols());
        let rows = Rows::new(p.A.as_ref(), vec![0.0; len], p.unit.clone());
        let problem = Problem {
            rows: &rows,
            lo: &p.lo,
            hi: &p.hi,
            free: &p.free,
            hessian_factor: None,
            windows: &p.A,
            trust: Trust::CERTAIN,
        };
        let (mut z, mut w) = (vec![0.0; padded(r)], vec![0.0; len]);
        let (status, quick) = match problem.solve(
            &mut WorkingSet::default(),
            &mut vec![0.0; work_len(r)],
            &mut z,
            &mut w,
        ) {
            Outcome::Optimal(_) => (Status::Optimal, true),
            Outcome::Infeasible(_) => (Status::Infeasible, true),
            Outcome::Uncertain => (way_out(&problem, &mut z, &mut w).0, false),
        };
        (status, quick, z, w)
    }

    #[test]
    fn every_status_is_true() {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let mut counts = BTreeMap::<(String, bool, &str), usize>::new();
        // a fifth without optimisation, which takes seven times as long
        let share = if cfg!(debug_assertions) { 5 } else { 1 };
        for k in 0..20_000 / share {
            let p = hostile(&mut rng);
            let (status, quick, z, w) = solve(&p);
            let kind = if p.excess > 0.0 { "contradicting" } else { "feasible" };
            *counts.entry((kind.to_string(), quick, status.as_str())).or_default() += 1;
            let tolerance = match status {
                Status::Optimal => 1e-9,
                Status::AlmostOptimal => 1e-6,
                Status::Infeasible => {
                    assert!(p.excess > 0.0, "{k}: a window is known that satisfies all bounds");
                    continue;
                }
                Status::Failed => continue,
            };
            // a row is summed from numbers of this size
            let size = |i: usize| {
                z[..p.A.ncols()]
                    .iter()
                    .zip(0..)
                    .map(|(z, j)| (p.A[(i, j)] * z).powi(2))
                    .sum::<f64>()
                    .sqrt()
            };
            let violation = |i: usize| {
                (p.lo[i] - w[i]).max(w[i] - p.hi[i]) / (p.unit[i] + 10.0 * tol::SUMMED * size(i))
            };
            let worst =
                (0..w.len()).filter(|i| p.unit[*i] > 0.0).map(violation).fold(0.0, f64::max);
            assert!(worst <= tolerance * 1.001, "{k}: {status:?} {worst:e}");
            assert!(
                p.excess < 1e-6,
                "{k}: {status:?} although bounds contradict each other by {:e}",
                p.excess
            );
            if p.excess == 0.0 {
                // no admissible direction leads down: (z - z*)ᵀ(q - z) ≥ 0 for every q inside
                let sum = |f: &dyn Fn(usize) -> f64| (0..p.inside.len()).map(f).sum::<f64>();
                let (t, q) = (|j: usize| z[j] - p.free[j], |j: usize| p.inside[j] - z[j]);
                let slope = sum(&|j| t(j) * q(j));
                let norm = |v: &dyn Fn(usize) -> f64| sum(&|j| v(j) * v(j)).sqrt();
                let scale = norm(&t).max(norm(&|j| p.free[j]));
                let size = scale * (scale + norm(&q));
                let tolerance = if status == Status::Optimal { 1e-8 } else { 1e-4 };
                assert!(slope >= -tolerance * size, "{k}: {status:?} {slope:e} of {size:e}");
            }
        }
        let of = |kind: &str, status: &str| -> usize {
            counts.iter().filter(|((k, _, s), _)| k == kind && *s == status).map(|(_, n)| n).sum()
        };
        // nearly all of them are decided, and only what is nearly dependent needs the way out
        assert!(of("feasible", "failed") < 28 && of("contradicting", "failed") < 12, "{counts:?}");
        assert!(
            share * of("feasible", "optimal") > 13_000
                && share * of("contradicting", "infeasible") > 5_500,
            "{counts:?}"
        );
    }
}
