//! The optimisation (16), (17) over the windows of one depth, reduced, factored and laid out for
//! speed.
//!
//! With the space w = c + B b of [`space`](crate::space), everything in scaled units, and F the
//! rows of B that the cost (17) sees (x(0) and all y), each times the square root of its weight,
//!
//! > minimise ‖F b - f‖² + λ‖b‖²,  f = weighted [x̄(t-m) - c_x(0);  y - c_y]
//! > subject to  lo ≤ c + B b ≤ hi  (x rows: X of (16c);  y rows: y - V of (16d)).
//!
//! [F; √λ I] = Q R and z = R b turn the cost into ‖z - z*‖² + const. with z* = Q_Fᵀ f, and the
//! window into c + A z with A = B R⁻¹. So a step is two products with matrices known at
//! construction, z* = z_0 + K [x̄; y] and w = c + A z*: the answer, if w satisfies every bound.
//! Otherwise the least-distance problem from z* to the bounds is solved by
//! [`active_set`](crate::active_set).
//!
//! *Units.* Inputs x̄ and y are deviations from the recording's channel means in units of s_x and
//! s_y, so that a large mean costs no digits. State rows of the window are deviations in the user's
//! units, output rows deviations like y. A tolerance on a row is in units of its channel's own
//! standard deviation: a channel that is small beside the others is bounded as sharply as they are.
//!
//! *Missing outputs.* Without the rows J of the cost the Hessian is I - Σ A_kᵀ D_k A_k over the
//! samples k with a missing entry, D_k what their weight loses: an r × r matrix, factored at the
//! step instead of the whole problem.

use crate::active_set::{ActiveBound, Problem, Rows, Trust, Windows, WorkingSet, solve_transposed};
use crate::config::Bounds;
use crate::panels::{
    Panels, WIDTH, dot, each, halve, margin, padded, smaller, vectorised, weighted_square,
};
use crate::reduction::{Reduced, Shape, reduce};
use crate::space::{Scaling, TrajectorySpace};
use crate::status::Status;
use crate::surplus::Surplus;
use crate::tol;
use crate::way_out::decide;
use crate::weights::Weights;
use faer::linalg::solvers::SvdError;
use faer::{Mat, MatRef};

/// What is bounded at every step, in the user's units.
#[derive(Debug, Clone, Default)]
pub(crate) struct Limits {
    pub x: Option<Bounds>,
    pub v: Option<Bounds>, // repeated for every sample of the deepest window
}

/// One window's data.
pub(crate) struct Data<'a> {
    pub prior: &'a [f64],             // x̄ (n), deviations
    pub outputs: &'a [f64],           // y (m·p), deviations, NaN where not measured
    pub missing: bool,                // whether there is a NaN
    pub x_bounds: Option<&'a Bounds>, // for this step alone
}

/// Numbers that a step works with, each for the deepest window and the highest rank.
pub(crate) struct Scratch<'a> {
    pub free: &'a mut [f64], // z*
    pub z: &'a mut [f64],
    pub window: &'a mut [f64], // the answer: states, padded, then outputs, padded
    pub lo: &'a mut [f64],     // bounds in the same order
    pub hi: &'a mut [f64],
    pub outputs: &'a mut [f64], // y with numbers in the place of NaN
    pub hessian_factor: &'a mut [f64], // L with Hessian L Lᵀ, by rows
    pub block: &'a mut [f64],   // p × p
    pub moved: &'a mut [f64],   // n
    pub work: &'a mut [f64],    // of the active-set method
}

/// How the answer of one window was found.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct WindowSolution {
    pub status: Status,
    pub sound: bool, // whether what is in the scratch are numbers within reach, whatever the status
    pub cost: f64,   // (17)
    pub active: usize,
    pub iterations: u32,
}

/// Everything about one depth that depends only on the data.
pub(crate) struct WindowProblem {
    pub shape: Shape,
    pub space: TrajectorySpace,
    prior_map: Mat<f64>,
    made_for_pattern: bool, // of the outputs that one window has
    z_0: Vec<f64>,
    gain: Panels,                       // z* = z_0 + K [x̄; y]
    states: Panels,                     // w = c + A z: state rows …
    outputs: Panels,                    // … and output rows
    rows: Rows,                         // c and A again, by rows
    surplus: Option<Surplus>,           // where the cost leaves a choice
    center: Option<(Vec<f64>, Panels)>, // z_c = z_c0 + K_c y
    x_lo: Vec<f64>,
    x_hi: Vec<f64>,
    prior_weight: f64, // 2ρ^m of (17), of a distance in scaled units (1 at an unknown start)
    noise: Option<Vec<f64>>, // weights on the square of each v in the user's units, but for a certificate's R
    s_y: Vec<f64>,           // of each output of the window
    per_s_x: Vec<f64>,       // 1 / s_x
    per_s_y: Vec<f64>,       // 1 / s_y of each output of the window
    mean: Vec<f64>,          // of each state of the window, in the user's units
    room: [Room; 2],         // of the state rows and of the noise, in the user's units
}

/// The largest and the smallest unit of a group of rows: what a distance to their bounds is at
/// least worth in units.
#[derive(Debug, Clone, Copy)]
struct Room {
    per_largest: f64,
    per_smallest: f64,
}

impl Room {
    fn new(units: &[f64]) -> Self {
        let largest = units.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let smallest = units.iter().copied().fold(f64::MAX, f64::min);
        Room { per_largest: 1.0 / largest, per_smallest: 1.0 / smallest }
    }

    /// A lower bound on the distance in units of each row, from one in the user's units.
    #[inline(always)]
    fn of(self, margin: f64) -> f64 {
        margin * if margin > 0.0 { self.per_largest } else { self.per_smallest }
    }
}

impl WindowProblem {
    /// Factors the problem. `measured` (m·p, time-major) says which outputs exist; None: all of
    /// them.
    pub fn new(
        shape: Shape,
        space: TrajectorySpace,
        scaling: &Scaling,
        weights: &Weights,
        (x_bounds, centered): (Option<&Bounds>, bool),
        measured: Option<&[bool]>,
    ) -> Result<Self, SvdError> {
        let Shape { n, p, depth } = shape;
        let (s_x, s_y) = (&scaling.s_x, &scaling.s_y);
        let Reduced { K, A, K_c, unseen } = reduce(shape, &space, weights, centered, measured)?;
        let (x, y): (Vec<usize>, Vec<usize>) =
            (shape.states().collect(), shape.outputs().collect());

        let c: Vec<f64> = shape.seen().map(|row| space.mean[row]).collect();
        let start = |K: MatRef<'_, f64>, c: &[f64]| {
            let mut z = vec![0.0; padded(K.nrows())];
            (0..K.nrows()).for_each(|i| {
                z[i] = -c.iter().enumerate().map(|(j, c)| K[(i, j)] * c).sum::<f64>();
            });
            z
        };

        // window rows: states in the user's units, outputs as deviations, each group padded
        let r = A.ncols();
        let (first, len) = (padded(x.len()), padded(x.len()) + padded(y.len()));
        let mut rows = Mat::zeros(len, r);
        let (mut offset, mut unit) = (vec![0.0; len], vec![0.0; len]);
        let moves = moving(&space);
        for i in 0..x.len() {
            (0..r).filter(|_| moves[x[i]]).for_each(|j| rows[(i, j)] = A[(x[i], j)] * s_x[i % n]);
            (offset[i], unit[i]) = (space.mean[x[i]] * s_x[i % n], scaling.unit_x[i % n]);
        }
        for i in 0..y.len() {
            (0..r).filter(|_| moves[y[i]]).for_each(|j| rows[(first + i, j)] = A[(y[i], j)]);
            (offset[first + i], unit[first + i]) =
                (space.mean[y[i]], scaling.unit_y[i % p] / s_y[i % p]);
        }
        let unbounded = |value: f64| {
            (0..first)
                .map(|i| if i < x.len() && x_bounds.is_some() { 0.0 } else { value })
                .collect()
        };
        let last: Vec<usize> = shape.x(depth).collect();
        let mut problem = WindowProblem {
            prior_map: Mat::from_fn(n, n, |i, j| (0..r).map(|k| A[(last[i], k)] * K[(k, j)]).sum()),
            made_for_pattern: measured.is_some(),
            z_0: start(K.as_ref(), &c),
            gain: Panels::new(K.as_ref()),
            center: K_c.map(|K_c| (start(K_c.as_ref(), &c[n..]), Panels::new(K_c.as_ref()))),
            states: Panels::new(rows.subrows(0, first)),
            outputs: Panels::new(rows.subrows(first, len - first)),
            surplus: None,
            rows: Rows::new(rows.as_ref(), offset, unit),
            x_lo: unbounded(f64::NEG_INFINITY),
            x_hi: unbounded(f64::INFINITY),
            prior_weight: weights.discount(depth) * weights.unit,
            noise: weights.diagonal_noise(depth, s_y),
            s_y: s_y.repeat(depth),
            per_s_x: s_x.iter().map(|s| 1.0 / s).collect(),
            per_s_y: s_y.iter().map(|s| 1.0 / s).collect::<Vec<_>>().repeat(depth),
            mean: scaling.mean_x.repeat(depth + 1),
            room: [Room::new(&scaling.unit_x), Room::new(&scaling.unit_y)],
            shape,
            space,
        };
        problem.surplus = unseen.map(|K| Surplus::new(&problem.rows, K));
        if let Some(bounds) = x_bounds {
            let (mut lo, mut hi) =
                (std::mem::take(&mut problem.x_lo), std::mem::take(&mut problem.x_hi));
            problem.add_box(bounds, &mut lo, &mut hi);
            (problem.x_lo, problem.x_hi) = (lo, hi);
        }
        Ok(problem)
    }

    /// Whether these can be active bounds of this problem.
    pub fn allows(&self, sides: &[ActiveBound]) -> bool {
        let known = |side: &ActiveBound| {
            side.row < self.rows.len() && (side.sign == 1.0 || side.sign == -1.0)
        };
        sides.len() <= self.rank() && sides.iter().all(known)
    }

    /// Number of directions r.
    pub fn rank(&self) -> usize {
        self.rows.r()
    }

    /// The map x̄(t-m) → x̂(t) with y = 0 (n × n).
    pub fn prior_to_estimate(&self) -> &Mat<f64> {
        &self.prior_map
    }

    /// The states of a window, (m+1)·n, in the user's units.
    #[inline(always)]
    fn in_user_units(&self, window: &[f64], states: &mut [f64]) {
        for ((x, w), mean) in states.iter_mut().zip(window).zip(&self.mean) {
            *x = w + mean;
        }
    }

    /// Adds the bounds on all states to what is in lo and hi: the distance of a box from the means,
    /// or from x_c(t).
    #[inline(always)]
    fn add_box(&self, bounds: &Bounds, lo: &mut [f64], hi: &mut [f64]) {
        let len = bounds.lo.len();
        for (i, mean) in self.mean.iter().enumerate() {
            let mean = if self.center.is_some() { 0.0 } else { *mean };
            lo[i] += bounds.lo[i % len] - mean;
            hi[i] += bounds.hi[i % len] - mean;
        }
    }

    /// Where a row is when the window has moved on by a sample; None if it has left it.
    #[inline(always)]
    fn older(&self, row: usize) -> Option<usize> {
        let (Shape { n, p, .. }, split) = (self.shape, self.split());
        if row < split {
            row.checked_sub(n)
        } else {
            (row - split).checked_sub(p).map(|row| split + row)
        }
    }

    /// Rows of the states, padded; the outputs follow.
    #[inline(always)]
    fn split(&self) -> usize {
        self.x_lo.len()
    }

    /// z* for outputs without NaN.
    #[inline(always)]
    fn minimiser(&self, prior: &[f64], outputs: &[f64], z: &mut [f64]) {
        self.gain.wide(&self.z_0, prior, outputs, z);
    }

    /// The minimiser's window into the scratch, and in the user's units its states ((m+1)·n) and
    /// its fitted noise v (m·p). None where too little is left of the cost without the missing
    /// outputs: the problem must then be made anew for what was measured.
    #[inline(always)]
    pub fn solve(
        &self,
        weights: &Weights,
        limits: &Limits,
        data: &Data<'_>,
        (kept, scratch): (&mut WorkingSet, &mut Scratch<'_>),
        (states, v): (&mut [f64], &mut [f64]),
    ) -> Option<WindowSolution> {
        vectorised(
            #[inline(always)]
            || {
                kept.predict(|row| self.older(row));
                let found = self.minimise(weights, limits, data, (kept, scratch), v)?;
                kept.adapt(|row| self.older(row));
                self.in_user_units(scratch.window, states);
                let cost = self.cost(weights, data, scratch, v);
                let sound = cost.is_finite() && self.within_reach(scratch.window);
                let status = if sound { found.status } else { Status::Failed };
                Some(WindowSolution { status, sound, cost, ..found })
            },
        )
    }

    /// Whether x̂(t) is a number of at most [`MEASURABLE`](tol::MEASURABLE). What is not finite in
    /// z is in every row, so in the cost and here; and from a finite z no row overflows, since x̄
    /// and y are within reach as well.
    #[inline(always)]
    fn within_reach(&self, window: &[f64]) -> bool {
        let last = &window[self.shape.depth * self.shape.n..];
        last.iter()
            .zip(&self.per_s_x)
            .fold(true, |near, (x, per_s)| near & (x.abs() * per_s <= tol::MEASURABLE))
    }

    /// The mean window in the place of one that cannot be computed.
    #[cold]
    pub fn rest(
        &self,
        weights: &Weights,
        data: &Data<'_>,
        s: &mut Scratch<'_>,
        (states, v): (&mut [f64], &mut [f64]),
    ) -> WindowSolution {
        s.window[..self.rows.len()].copy_from_slice(self.rows.offset());
        self.in_user_units(s.window, states);
        self.residual(data.outputs, s.window, v);
        WindowSolution {
            sound: true,
            cost: self.cost(weights, data, s, v),
            ..WindowSolution::default()
        }
    }

    /// Moves the states of a window, in the user's units, into the box in force.
    #[cold]
    pub fn confine(
        &self,
        limits: &Limits,
        data: &Data<'_>,
        s: &mut Scratch<'_>,
        window: &mut [f64],
    ) {
        let Some(bounds) = data.x_bounds.or(limits.x.as_ref()) else { return };
        let (split, len) = (self.split(), bounds.lo.len());
        if self.center.is_none() {
            window
                .iter_mut()
                .enumerate()
                .for_each(|(i, x)| *x = x.max(bounds.lo[i % len]).min(bounds.hi[i % len]));
            return;
        }
        self.box_of_this_step(
            bounds,
            s.outputs,
            data,
            s.z,
            (&mut s.lo[..split], &mut s.hi[..split]),
        );
        for (((x, mean), lo), hi) in window.iter_mut().zip(&self.mean).zip(&*s.lo).zip(&*s.hi) {
            *x = x.max(lo + mean).min(hi + mean);
        }
    }

    #[inline(always)]
    fn minimise(
        &self,
        weights: &Weights,
        limits: &Limits,
        data: &Data<'_>,
        (kept, s): (&mut WorkingSet, &mut Scratch<'_>),
        v: &mut [f64],
    ) -> Option<WindowSolution> {
        let mut changed = false;
        if data.missing {
            kept.clear();
            changed = self.without_missing(weights, data, s)?;
        } else {
            self.minimiser(data.prior, data.outputs, s.free);
        }
        let hessian_factor = if changed { Some(&*s.hessian_factor) } else { None };
        let (free, rank) = (&*s.free, self.rank());
        let found = |active: usize| {
            Some(WindowSolution { status: Status::Optimal, active, ..WindowSolution::default() })
        };

        let box_x = data.x_bounds.or(limits.x.as_ref());
        if kept.sides.is_empty() || (box_x.is_none() && limits.v.is_none()) {
            self.window(&free[..rank], s.window);
            self.residual(data.outputs, s.window, v);
            if box_x.is_none() && limits.v.is_none() {
                return found(0);
            }
        }
        let split = self.split();
        let own = match box_x {
            Some(bounds) if data.x_bounds.is_some() || self.center.is_some() => {
                self.box_of_this_step(
                    bounds,
                    s.outputs,
                    data,
                    s.z,
                    (&mut s.lo[..split], &mut s.hi[..split]),
                );
                true
            }
            _ => false,
        };
        let mut room = f64::NEG_INFINITY;
        if kept.sides.is_empty() {
            let (lo, hi) = if own {
                (&s.lo[..split], &s.hi[..split])
            } else {
                (&self.x_lo[..], &self.x_hi[..])
            };
            room = self.room[0].of(margin(&s.window[..split], lo, hi));
            if let Some(Bounds { lo, hi }) = &limits.v {
                let noise = self.room[1].of(margin(v, &lo[..v.len()], &hi[..v.len()]));
                room = if noise < room { noise } else { room };
            }
            if room > tol::ACTIVE_SET {
                return found(0);
            }
        }
        if !own {
            s.lo[..split].copy_from_slice(&self.x_lo); // (16c)
            s.hi[..split].copy_from_slice(&self.x_hi);
        }
        let len = self.rows.len();
        self.limits_of_outputs(limits, data, (&mut s.lo[split..len], &mut s.hi[split..len]));
        let (lo, hi) = (&s.lo[..len], &s.hi[..len]);
        if room >= -tol::FEASIBLE {
            return found(self.count_active(s.window, lo, hi));
        }
        let problem = Problem {
            rows: &self.rows,
            lo,
            hi,
            free,
            hessian_factor,
            windows: self,
            trust: Trust::CERTAIN,
        };
        let (status, iterations) = match &self.surplus {
            None => decide(&problem, (kept, s.work), s.z, s.window),
            Some(_) if changed => return None, // its two stages are those of the full Hessian
            Some(surplus) => surplus.solve(&problem, (kept, s.work), s.z, s.window),
        };
        if data.missing {
            kept.forget_factor(); // of this Hessian, or of the problem made for this window
        }
        self.residual(data.outputs, s.window, v);
        Some(WindowSolution {
            status,
            active: self.count_active(s.window, lo, hi),
            iterations,
            ..WindowSolution::default()
        })
    }

    /// The cost (17) in the user's units.
    #[inline(always)]
    fn cost(&self, weights: &Weights, data: &Data<'_>, s: &mut Scratch<'_>, v: &[f64]) -> f64 {
        let moved = s
            .window
            .iter()
            .zip(&self.per_s_x)
            .zip(data.prior)
            .map(|((x, per_s), prior)| x * per_s - prior);
        let prior = self.prior_weight * weights.prior_size(moved, &mut s.moved[..data.prior.len()]);
        prior
            + match &self.noise {
                Some(scalar) if data.missing => {
                    let known = &mut s.outputs[..v.len()];
                    known
                        .iter_mut()
                        .zip(v)
                        .for_each(|(known, v)| *known = if v.is_nan() { 0.0 } else { *v });
                    weighted_square(scalar, known)
                }
                Some(scalar) => weighted_square(scalar, v),
                None => {
                    weights.unit
                        * weights.noise_cost(
                            v,
                            &self.s_y,
                            &mut s.block[..self.shape.p * self.shape.p],
                        )
                }
            }
    }

    /// v = y - ŷ (m·p) in the user's units; NaN where not measured.
    #[inline(always)]
    fn residual(&self, outputs: &[f64], window: &[f64], v: &mut [f64]) {
        for (((v, y), w), s) in
            v.iter_mut().zip(outputs).zip(&window[self.split()..]).zip(&self.s_y)
        {
            *v = (y - w) * s;
        }
    }

    /// (16c): the box on the states that holds for this step alone, about x_c(t) if the bounds are
    /// relative to it, into lo and hi.
    #[inline(always)]
    fn box_of_this_step(
        &self,
        bounds: &Bounds,
        filled: &[f64],
        data: &Data<'_>,
        z: &mut [f64],
        (lo, hi): (&mut [f64], &mut [f64]),
    ) {
        lo.fill(0.0);
        if let Some((z_0, K_c)) = &self.center {
            let y = if data.missing { &filled[..data.outputs.len()] } else { data.outputs };
            K_c.wide(z_0, &[], y, z);
            self.states.tall(&self.rows.offset()[..self.split()], &z[..self.rank()], lo);
        }
        hi.copy_from_slice(lo);
        self.add_box(bounds, lo, hi);
        let used = (self.shape.depth + 1) * self.shape.n;
        lo[used..].fill(f64::NEG_INFINITY);
        hi[used..].fill(f64::INFINITY);
    }

    /// (16d): v = y - ŷ in [lo, hi]  ⇔  ŷ in [y - hi, y - lo], into lo and hi, in deviations.
    #[inline(always)]
    fn limits_of_outputs(
        &self,
        limits: &Limits,
        data: &Data<'_>,
        (lo, hi): (&mut [f64], &mut [f64]),
    ) {
        let used = if limits.v.is_some() { data.outputs.len() } else { 0 };
        lo[used..].fill(f64::NEG_INFINITY);
        hi[used..].fill(f64::INFINITY);
        let Some(v) = &limits.v else { return };
        for (((lo, y), v), scale) in lo.iter_mut().zip(data.outputs).zip(&v.hi).zip(&self.per_s_y) {
            *lo = y - v * scale;
        }
        for (((hi, y), v), scale) in hi.iter_mut().zip(data.outputs).zip(&v.lo).zip(&self.per_s_y) {
            *hi = y - v * scale;
        }
        if data.missing {
            lo[..used].iter_mut().filter(|lo| lo.is_nan()).for_each(|lo| *lo = f64::NEG_INFINITY);
            hi[..used].iter_mut().filter(|hi| hi.is_nan()).for_each(|hi| *hi = f64::INFINITY);
        }
    }

    /// Number of bounds that the window touches.
    #[inline(always)]
    fn count_active(&self, window: &[f64], lo: &[f64], hi: &[f64]) -> usize {
        let mut count = [0.0; WIDTH];
        let chunks = window
            .as_chunks::<WIDTH>()
            .0
            .iter()
            .zip(lo.as_chunks::<WIDTH>().0)
            .zip(hi.as_chunks::<WIDTH>().0);
        for (((w, lo), hi), unit) in chunks.zip(self.rows.unit().as_chunks::<WIDTH>().0) {
            let (below, above) =
                (each(*w, *lo, |w, l| (w - l).abs()), each(*w, *hi, |w, h| (w - h).abs()));
            let near =
                each(each(below, above, smaller), *unit, |d, unit| d - tol::ACTIVE_SET * unit);
            count = each(count, near, |count, near| if near <= 0.0 { count + 1.0 } else { count });
        }
        halve(count, |a, b| a + b) as usize
    }

    /// z* without the outputs that were not measured: true with the factor of the Hessian in the
    /// scratch, false where the problem was made for these outputs. None where the downdate would
    /// lose too many digits.
    #[inline(always)]
    fn without_missing(
        &self,
        weights: &Weights,
        data: &Data<'_>,
        s: &mut Scratch<'_>,
    ) -> Option<bool> {
        let (Shape { p, depth, .. }, r, first) = (self.shape, self.rank(), self.split());
        let stride = r.next_multiple_of(4);
        let y = &mut s.outputs[..depth * p];
        // the mean window in the place of what is missing: it adds nothing to K ([x̄; y] - c)
        for ((y, measured), c) in y.iter_mut().zip(data.outputs).zip(&self.rows.offset()[first..]) {
            *y = if measured.is_finite() { *measured } else { *c };
        }
        self.minimiser(data.prior, y, s.free);
        if self.made_for_pattern {
            return Some(false);
        }
        if self.center.is_some() {
            return None;
        }
        let L = &mut s.hessian_factor[..r * stride];
        L.fill(0.0);
        (0..r).for_each(|i| L[i * stride + i] = 1.0);
        for k in (0..depth).filter(|k| data.outputs[k * p..(k + 1) * p].iter().any(|y| y.is_nan()))
        {
            weights.lost(depth - k, |i| data.outputs[k * p + i].is_finite(), &mut s.block[..p * p]);
            for (i, j) in (0..p * p).map(|e| (e / p, e % p)) {
                let (lost, a, b) = (s.block[i * p + j], first + k * p + i, first + k * p + j);
                if lost == 0.0 {
                    continue;
                }
                let known = lost * (y[k * p + j] - self.rows.offset()[b]);
                for row in 0..r {
                    let a_row = self.rows.entry(a, row);
                    s.free[row] -= a_row * known;
                    (0..=row).for_each(|column| {
                        L[row * stride + column] -= lost * a_row * self.rows.entry(b, column);
                    });
                }
            }
        }
        cholesky(L, r, stride)?;
        // z* = L⁻ᵀ L⁻¹ (K ([x̄; y] - c) - …)
        let z = &mut s.free[..r];
        for i in 0..r {
            let row = &L[i * stride..i * stride + i + 1];
            z[i] = (z[i] - dot(&row[..i], &z[..i])) / row[i];
        }
        solve_transposed(L, z, stride);
        Some(true)
    }
}

impl Windows for WindowProblem {
    #[inline(always)]
    fn window(&self, z: &[f64], window: &mut [f64]) {
        let (x, y) = window.split_at_mut(self.split());
        let (c_x, c_y) = self.rows.offset().split_at(self.split());
        self.states.tall(c_x, z, x);
        self.outputs.tall(c_y, z, y);
    }
}

/// Which rows of the window move at all: what is left of one that does not is rounding of the
/// decomposition, and bounds on it would send the minimiser far away for nothing.
fn moving(space: &TrajectorySpace) -> Vec<bool> {
    let lengths: Vec<f64> = space.basis.row_iter().map(|row| row.norm_l2()).collect();
    let largest = lengths.iter().copied().fold(0.0, f64::max);
    lengths.iter().map(|&length| length > tol::UNMOVED * largest).collect()
}

/// L of H = L Lᵀ in place (lower triangles by rows of `stride`); None when a pivot is too small to
/// trust.
#[inline(always)]
fn cholesky(H: &mut [f64], r: usize, stride: usize) -> Option<()> {
    for i in 0..r {
        let (above, row) = H.split_at_mut(i * stride);
        for (j, other) in above.chunks_exact(stride).enumerate() {
            row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let pivot = row[i] - dot(&row[..i], &row[..i]);
        if pivot < tol::DOWNDATE {
            return None;
        }
        row[i] = pivot.sqrt();
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::Design;
    use crate::memory::Memory;
    use crate::{Bounds, Certificate, Config, History, Space};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const STEPS: usize = 80;

    /// Two coupled oscillations seen through two outputs.
    fn history(rng: &mut ChaCha8Rng) -> History {
        let (mut x, mut y, mut state) =
            (vec![1.0, 0.0, 0.5, -0.5], Vec::new(), [1.0, 0.0, 0.5, -0.5]);
        for _ in 0..STEPS {
            y.extend(
                [state[0] + state[3], state[1] - 0.5 * state[2]]
                    .map(|v| v + rng.random_range(-0.01..0.01)),
            );
            let [a, b, c, d] = state;
            state = [
                0.95 * a - 0.3 * b,
                0.3 * a + 0.95 * b + 0.02 * c,
                0.8 * c - 0.6 * d,
                0.6 * c + 0.8 * d,
            ];
            x.extend(state);
        }
        History::new(4, 2, &x, &y, 0.1).unwrap()
    }

    fn configs() -> Vec<Config> {
        let plain =
            Config { horizon: Some(12), rho: Some(0.9), mu: Some(5.0), ..Config::default() };
        let identity = |n: usize| {
            (0..n * n).map(|k| if k % (n + 1) == 0 { 1.0 } else { 0.0 }).collect::<Vec<f64>>()
        };
        let coupled = Certificate {
            P: identity(4),
            Q: identity(4),
            R: vec![3.0, 1.0, 1.0, 2.0],
            eta: 0.8,
            growth: None,
            model: None,
        };
        let bounds = Some(Bounds { lo: vec![-0.9; 2], hi: vec![0.9; 2] });
        vec![
            plain.clone(),
            Config {
                v_bounds: bounds,
                space: Space::Truncated { rank: Some(6), tol: None },
                ..plain.clone()
            },
            Config { rho: None, mu: None, certificate: Some(coupled), ..plain },
        ]
    }

    #[test]
    fn a_downdate_gives_what_a_new_factorisation_gives() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let history = history(&mut rng);
        for config in configs() {
            let design = Design::new(&history, &config, config.start).unwrap();
            let full = design.problem(12).unwrap();
            let (mut compared, mut bound) = (0, 0);
            for _ in 0..300 {
                let lost = rng.random_range(0.05..0.5);
                let mut y: Vec<f64> = (0..24).map(|_| rng.random_range(-1.0..1.0)).collect();
                y.iter_mut().for_each(|y| *y = if rng.random_bool(lost) { f64::NAN } else { *y });
                let prior: Vec<f64> = (0..4).map(|_| rng.random_range(-1.0..1.0)).collect();
                let data = Data { prior: &prior, outputs: &y, missing: true, x_bounds: None };
                let solve = |problem: &WindowProblem| {
                    let mut memory = Memory::new(4, 2, 12, design.rank);
                    let (_, _, mut scratch) = memory.parts();
                    let (mut kept, mut states, mut v) =
                        (WorkingSet::default(), vec![0.0; 52], vec![0.0; 24]);
                    let (room, out) = ((&mut kept, &mut scratch), (&mut states[..], &mut v[..]));
                    let found = problem.solve(&design.weights, &design.limits, &data, room, out)?;
                    Some((found, states, v))
                };
                let anew =
                    solve(&design.without_missing(full, &design.weights, &y).unwrap()).unwrap();
                let Some(quick) = solve(full) else { continue };
                compared += 1;
                bound += usize::from(quick.0.active > 0);
                assert_eq!(quick.0.status, anew.0.status);
                let close = |a: f64, b: f64| {
                    (a - b).abs() < 1e-9 * (1.0 + b.abs()) || (a.is_nan() && b.is_nan())
                };
                assert!(quick.1.iter().zip(&anew.1).all(|(a, b)| close(*a, *b)));
                assert!(quick.2.iter().zip(&anew.2).all(|(a, b)| close(*a, *b)));
                assert!(close(quick.0.cost, anew.0.cost), "{} {}", quick.0.cost, anew.0.cost);
            }
            assert!(
                compared > 250 && (bound > 20 || config.v_bounds.is_none()),
                "{compared} {bound}"
            );
        }
    }
}
