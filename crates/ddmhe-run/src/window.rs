//! The optimisation (16), (17) over one window, reduced and laid out for speed.
//!
//! With the space w = c + B b that the recorded windows span, everything in scaled units, and F the
//! rows of B that the cost (17) sees (x(0) and all y), each times the square root of its weight,
//!
//! > minimise ‖F b - f‖² + λ‖b‖²,  f = weighted [x̄(t-m) - c_x(0);  y - c_y]
//! > subject to  lo ≤ c + B b ≤ hi  (x rows: X of (16c);  y rows: y - V of (16d)).
//!
//! [F; √λ I] = Q R and z = R b turn the cost into ‖z - z*‖² + const. with z* = Q_Fᵀ f, and the
//! window into c + A z with A = B R⁻¹. So a step is two products with matrices known beforehand,
//! z* = z_0 + K [x̄; y] and w = c + A z*: the answer, if w satisfies every bound. Otherwise the
//! least-distance problem from z* to the bounds is solved by [`active_set`](crate::active_set).
//!
//! *Units.* Inputs x̄ and y are deviations from the recording's channel means in units of s_x and
//! s_y, so that a large mean costs no digits. State rows of the window are deviations in the user's
//! units, output rows deviations like y. A tolerance on a row is in units of its channel's own
//! standard deviation: a channel that is small beside the others is bounded as sharply as they are.

use crate::active_set::problem::{LeastDistance, Trust, Windows};
use crate::active_set::working_set::WorkingSet;
use crate::fallback::{Fallback, decide};
use crate::kalman::Filtered;
use crate::panels::{WIDTH, each, margins, padded, scaled_difference, smaller, sum};
use crate::plan::common::{Limits, Shared};
use crate::prices::RowPrices;
use crate::problem::{Data, Fit, Scratch, Spared, WindowProblem, WindowSolution};
use crate::status::Status;
use crate::tol;

impl WindowProblem<'_> {
    /// [`solve`](Self::solve) on the fallback's vector units: once in a program for each kind of
    /// them, not in every caller.
    #[inline(never)]
    pub fn solve_vectorised(
        &self,
        fallback: &impl Fallback,
        data: &Data<'_>,
        room: (&mut WorkingSet<'_>, &mut Scratch<'_>),
        fit: &mut Fit<'_>,
    ) -> Option<WindowSolution> {
        fallback.vectorised(
            #[inline(always)]
            || self.solve(fallback, data, room, fit),
        )
    }

    /// (16), (17): the minimiser's window into the scratch, and in the user's units into the
    /// answer. None where too little is left of the cost without the missing outputs: the problem
    /// must then be made anew for what was measured.
    #[inline(always)]
    pub fn solve(
        &self,
        fallback: &impl Fallback,
        data: &Data<'_>,
        (working, scratch): (&mut WorkingSet<'_>, &mut Scratch<'_>),
        fit: &mut Fit<'_>,
    ) -> Option<WindowSolution> {
        let layout = self.depth.layout;
        working.predict(|row| layout.older(row));
        let found = self.minimise(fallback, data, (working, scratch), fit.v)?;
        working.adapt(|row| layout.older(row));
        let mut cost = self.hand_over(data, scratch, (fit, found.filtered));
        if self.shared.soft {
            cost += found.cost;
        }
        let sound = cost.is_finite() && self.within_reach(scratch.window);
        let status = if sound { found.status } else { Status::Failed };
        let mut found = WindowSolution { status, sound, cost, ..found };
        if self.depth.kind.judged {
            found.minimum = self.judge(data, scratch, fit.v, &found);
        }
        Some(found)
    }

    /// z* and its window: the answer where that is inside all bounds.
    #[inline(always)]
    fn minimise(
        &self,
        fallback: &impl Fallback,
        data: &Data<'_>,
        (working, s): (&mut WorkingSet<'_>, &mut Scratch<'_>),
        v: &mut [f64],
    ) -> Option<WindowSolution> {
        let x = self.box_in_force(data);
        let bounded = x.is_some() || self.shared.sizes.v_bounded || self.shared.sizes.w_bounded;
        if data.is_reweighted() {
            working.clear();
        }
        let mut changed = false;
        let filtered = data.filtered.is_some() && (working.sides.is_empty() || !bounded);
        if filtered {
            self.smoothed(data, s);
        } else if data.is_reweighted() {
            changed = self.without_missing(data, s)?;
        } else if !data.begun {
            self.minimiser(data.prior, data.outputs, s.unconstrained);
        }
        if working.sides.is_empty() || !bounded {
            if !filtered && !data.begun {
                self.window(&s.unconstrained[..self.depth.rank], s.window);
            }
            if !data.begun {
                self.residual(data.outputs, s.window, v);
            }
            if !bounded {
                return optimal(0, filtered, changed);
            }
        }
        let own = self.own_box(x, data, s);
        let mut margin = f64::NEG_INFINITY;
        if working.sides.is_empty() {
            let margins = self.margins(own, s, v);
            if margins.iter().fold(true, |inside, margin| inside & (*margin > tol::ACTIVE_SET)) {
                return optimal(0, filtered, changed);
            }
            margin = margins.into_iter().fold(f64::INFINITY, smaller);
        }
        self.limits(own, data, s);
        if margin >= -tol::FEASIBLE {
            return optimal(self.count_active(s), filtered, changed);
        }
        if filtered && data.is_reweighted() {
            changed = self.without_missing(data, s)?;
        } else if filtered {
            self.minimiser(data.prior, data.outputs, s.unconstrained);
        }
        if self.shared.soft {
            return self.nearest_at_a_price(fallback, data, changed, (working, s), v);
        }
        self.nearest((fallback, None), data, changed, (working, s), v)
    }

    /// The same where bounds may be left, with what that costs.
    #[cold]
    #[inline(never)]
    fn nearest_at_a_price(
        &self,
        fallback: &impl Fallback,
        data: &Data<'_>,
        changed: bool,
        (working, s): (&mut WorkingSet<'_>, &mut Scratch<'_>),
        v: &mut [f64],
    ) -> Option<WindowSolution> {
        let prices = self.shared.sizes.prices.of_rows(self.depth.layout);
        let found = self.nearest((fallback, prices), data, changed, (working, s), v)?;
        let (cost, active) = self.paid(prices?, s);
        Some(WindowSolution { cost, active, ..found })
    }

    /// The window nearest to z* that satisfies the bounds in the scratch.
    #[inline(always)]
    fn nearest(
        &self,
        (fallback, prices): (&impl Fallback, Option<RowPrices>),
        data: &Data<'_>,
        changed: bool,
        (working, s): (&mut WorkingSet<'_>, &mut Scratch<'_>),
        v: &mut [f64],
    ) -> Option<WindowSolution> {
        let len = self.depth.layout.apart();
        let Spared { z, lo, hi, hessian_factor, work, .. } = s.spare.parts();
        let problem = LeastDistance {
            rows: self.rows,
            lo: &lo[..len],
            hi: &hi[..len],
            unconstrained: s.unconstrained,
            hessian_factor: if changed { Some(&*hessian_factor) } else { None },
            windows: self,
            trust: Trust::CERTAIN,
            prices,
        };
        let (status, iterations) = if !self.depth.kind.surplus {
            decide(&problem, fallback, (working, work), z, s.window)
        } else if changed {
            return None; // its two stages are those of the full Hessian
        } else {
            fallback.two_stages(&problem.erased(), (working, work), z, s.window)
        };
        if data.is_reweighted() {
            working.forget_factor(); // of this Hessian, or of the problem made for this window
        }
        self.residual(data.outputs, s.window, v);
        let active = self.count_active(s);
        let (constrained, downdated) = (true, changed);
        let rest = WindowSolution::default();
        Some(WindowSolution { status, active, iterations, constrained, downdated, ..rest })
    }

    /// z* for outputs without NaN.
    #[inline(always)]
    pub(crate) fn minimiser(&self, prior: &[f64], outputs: &[f64], z: &mut [f64]) {
        self.gain.wide(self.z_0, prior, outputs, z);
    }

    /// The box on the states that holds at this step.
    #[inline(always)]
    fn box_in_force<'b>(&'b self, data: &Data<'b>) -> Option<Limits<'b>> {
        data.x_bounds.or(self.shared.x_limits)
    }

    /// Limits of the state rows that are this step's own, into the scratch; whether there are any.
    #[inline(always)]
    fn own_box(&self, x: Option<Limits<'_>>, data: &Data<'_>, s: &mut Scratch<'_>) -> bool {
        let split = self.depth.layout.split();
        match x {
            Some(bounds) if data.x_bounds.is_some() || self.moving_box() => {
                let Spared { lo, hi, outputs, z, .. } = s.spare.parts();
                let own = (&mut lo[..split], &mut hi[..split]);
                self.box_of_this_step(bounds, outputs, data, z, own);
                true
            }
            _ => false,
        }
    }

    /// Whether the box on the states is another at every step: about x_c(t), or moved by inputs.
    #[inline(always)]
    fn moving_box(&self) -> bool {
        self.depth.kind.centered || self.shared.sizes.m > 0
    }

    /// The smallest distances of z*'s window to its bounds, in units of the rows, or less, in eight
    /// groups.
    #[inline(always)]
    fn margins(&self, own: bool, s: &mut Scratch<'_>, v: &[f64]) -> [f64; WIDTH] {
        let split = self.depth.layout.split();
        let Limits { lo, hi } = self.x_limits;
        let (lo, hi) = if own {
            let Spared { lo, hi, .. } = s.spare.parts();
            (&lo[..split], &hi[..split])
        } else {
            (lo, hi)
        };
        let [of_x, of_v, of_w] = self.shared.margins;
        let mut states = margins(&s.window[..split], lo, hi).map(|margin| of_x.of(margin));
        if let Some(Limits { lo, hi }) = self.shared.w_limits {
            let w = self.disturbances(s.window);
            let own = margins(w, &lo[..w.len()], &hi[..w.len()]).map(|margin| of_w.of(margin));
            states = each(own, states, smaller);
        }
        let Some(Limits { lo, hi }) = self.shared.v_limits else { return states };
        let noise = margins(v, &lo[..v.len()], &hi[..v.len()]).map(|margin| of_v.of(margin));
        each(noise, states, smaller)
    }

    /// (16c), (16d): limits of all rows, into the scratch.
    #[inline(always)]
    fn limits(&self, own: bool, data: &Data<'_>, s: &mut Scratch<'_>) {
        let (split, len) = (self.depth.layout.split(), self.depth.layout.apart());
        let Spared { lo, hi, .. } = s.spare.parts();
        if !own {
            lo[..split].copy_from_slice(self.x_limits.lo); // (16c)
            hi[..split].copy_from_slice(self.x_limits.hi);
        }
        self.limits_of_outputs(data, (&mut lo[split..len], &mut hi[split..len]));
        if self.depth.layout.driven {
            let first = self.depth.layout.second_split();
            self.limits_of_disturbances((&mut lo[first..len], &mut hi[first..len]));
        }
    }

    /// The disturbances of a window (m·n), in the user's units.
    #[inline(always)]
    pub(crate) fn disturbances<'b>(&self, window: &'b [f64]) -> &'b [f64] {
        let layout = self.depth.layout;
        &window[layout.second_split()..][..layout.disturbances_len()]
    }

    /// The window in the scratch in the user's units, beside v, which is there; its cost.
    #[inline(always)]
    fn hand_over(
        &self,
        data: &Data<'_>,
        s: &mut Scratch<'_>,
        (fit, filtered): (&mut Fit<'_>, bool),
    ) -> f64 {
        self.in_user_units(s.window, data.means, fit.states);
        if let (true, Some(Filtered::Settled { next, .. })) = (filtered, data.filtered) {
            self.newest(next, fit.states);
        }
        if self.depth.layout.driven {
            fit.w.copy_from_slice(self.disturbances(s.window));
        }
        match &data.filtered {
            Some(own) if filtered => own.cost(),
            _ => self.cost(data, s, fit.v),
        }
    }

    /// The filter's window into the scratch: apart, for the registers of the steps that have none.
    #[inline(never)]
    fn smoothed(&self, data: &Data<'_>, s: &mut Scratch<'_>) {
        let (Some(kalman), Some(filtered)) = (&self.shared.kalman, data.filtered) else { return };
        let layout = self.depth.layout;
        let (n, p) = (layout.n, layout.p);
        let (first, second) = (layout.split(), layout.second_split());
        let Spared { smoothing, moved, .. } = s.spare.parts();
        let (room, fitted) = smoothing.split_at_mut(smoothing.len() - padded(p));
        let (window, shared) = (&mut *s.window, &self.shared);
        kalman.smooth(filtered, room, |k, x, w| {
            for i in 0..n {
                // with inputs the window is that of the free motion
                let forced = data.means[k * n + i] - shared.mean_x[i];
                window[k * n + i] = x[i] * shared.s_x[i] - forced;
                moved[i] = if forced == 0.0 { x[i] } else { x[i] - forced * shared.per_s_x[i] };
            }
            if k < layout.depth {
                kalman.output(&moved[..n], fitted);
                window[first + k * p..first + (k + 1) * p].copy_from_slice(&fitted[..p]);
            }
            if k > 0 {
                let at = second + (k - 1) * n;
                (0..n).for_each(|i| window[at + i] = w[i] * shared.s_x[i]);
            }
        });
        // the padding of each block: no row
        window[layout.states_len()..first].fill(0.0);
        window[first + layout.outputs_len()..second].fill(0.0);
        window[second + layout.disturbances_len()..layout.apart()].fill(0.0);
    }

    /// v = y - ŷ (m·p) in the user's units; NaN where not measured.
    #[inline(always)]
    fn residual(&self, outputs: &[f64], window: &[f64], v: &mut [f64]) {
        let (layout, s_y) = (self.depth.layout, self.shared.scales(self.depth.layout));
        let fitted = &window[layout.split()..][..outputs.len()];
        scaled_difference(outputs, fitted, s_y, v);
    }

    /// The states of a window, (m+1)·n, in the user's units.
    #[inline(always)]
    fn in_user_units(&self, window: &[f64], means: &[f64], states: &mut [f64]) {
        sum(&window[..means.len()], means, states);
    }

    /// x̂(t) as a step makes it that asks for nothing else: where there are inputs the forced
    /// motion was taken off the window and added again, which costs a last bit.
    #[inline(always)]
    fn newest(&self, next: &[f64], states: &mut [f64]) {
        let Shared { s_x, mean_x, sizes, .. } = self.shared;
        if sizes.m > 0 {
            let at = states.len() - sizes.n;
            let scaled = next.iter().zip(s_x).zip(mean_x).map(|((x, s), mean)| x * s + mean);
            states[at..].iter_mut().zip(scaled).for_each(|(to, x)| *to = x);
        }
    }

    /// Whether x̂(t) is a number of at most [`MEASURABLE`](tol::MEASURABLE). What is not finite in
    /// z is in every row, so in the cost and here; and from a finite z no row overflows, since x̄
    /// and y are within reach as well.
    #[inline(always)]
    pub(crate) fn within_reach(&self, window: &[f64]) -> bool {
        let last = &window[self.depth.layout.depth * self.depth.layout.n..];
        let per_s_x = self.shared.per_s_x;
        last.iter()
            .zip(per_s_x)
            .fold(true, |near, (x, per_s)| near & (x.abs() * per_s <= tol::MEASURABLE))
    }

    /// Number of bounds that the window in the scratch touches.
    #[inline(always)]
    fn count_active(&self, s: &mut Scratch<'_>) -> usize {
        let mut count = 0_u64;
        let Spared { lo, hi, .. } = s.spare.parts();
        for (((w, lo), hi), unit) in s.window.iter().zip(lo).zip(hi).zip(self.rows.unit) {
            let distance = smaller((w - *lo).abs(), (w - *hi).abs());
            count += u64::from(distance - tol::ACTIVE_SET * unit <= 0.0);
        }
        count as usize
    }

    /// The mean window in the place of one that cannot be computed.
    #[cold]
    pub fn rest(&self, data: &Data<'_>, s: &mut Scratch<'_>, mut fit: Fit<'_>) -> WindowSolution {
        let offset = self.rows.offset;
        s.window[..offset.len()].copy_from_slice(offset);
        self.residual(data.outputs, s.window, fit.v);
        let cost = self.hand_over(data, s, (&mut fit, false));
        WindowSolution { sound: true, cost, ..WindowSolution::default() }
    }
}

/// An answer in closed form.
#[inline(always)]
fn optimal(active: usize, filtered: bool, downdated: bool) -> Option<WindowSolution> {
    let (status, rest) = (Status::Optimal, WindowSolution::default());
    Some(WindowSolution { status, active, filtered, downdated, ..rest })
}
