//! (16c), (16d): boxes on the states, on the fitted noise and on the fitted disturbance, as limits
//! of the window's rows.

use crate::plan::common::Limits;
use crate::problem::{Data, Scratch, Spared, WindowProblem};

impl WindowProblem<'_> {
    /// (16c): the box on the states that holds for this step alone, about x_c(t) if the bounds are
    /// relative to it, into lo and hi.
    #[inline(always)]
    pub(crate) fn box_of_this_step(
        &self,
        bounds: Limits<'_>,
        filled: &[f64],
        data: &Data<'_>,
        z: &mut [f64],
        (lo, hi): (&mut [f64], &mut [f64]),
    ) {
        let depth = &self.depth;
        lo.fill(0.0);
        if depth.kind.centered {
            let y = if data.missing { &filled[..data.outputs.len()] } else { data.outputs };
            self.center_gain.wide(self.center, &[], y, z);
            let offset = &self.rows.offset[..depth.layout.split()];
            self.window.tall(offset, &z[..depth.rank], lo);
        }
        hi.copy_from_slice(lo);
        self.add_box(bounds, data.means, lo, hi);
        let used = depth.layout.states_len();
        lo[used..].fill(f64::NEG_INFINITY);
        hi[used..].fill(f64::INFINITY);
    }

    /// Adds the bounds on all states to what is in lo and hi: the distance of a box from the means,
    /// or from x_c(t).
    #[inline(always)]
    fn add_box(&self, bounds: Limits<'_>, means: &[f64], lo: &mut [f64], hi: &mut [f64]) {
        let len = bounds.lo.len();
        for (i, mean) in means.iter().enumerate() {
            let mean = if self.depth.kind.centered { 0.0 } else { *mean };
            lo[i] += bounds.lo[i % len] - mean;
            hi[i] += bounds.hi[i % len] - mean;
        }
    }

    /// (16d): v = y - ŷ in [lo, hi]  ⇔  ŷ in [y - hi, y - lo], into lo and hi, in deviations.
    #[inline(always)]
    pub(crate) fn limits_of_outputs(&self, data: &Data<'_>, (lo, hi): (&mut [f64], &mut [f64])) {
        let v = self.shared.v_limits;
        let used = if v.is_some() { data.outputs.len() } else { 0 };
        lo[used..].fill(f64::NEG_INFINITY);
        hi[used..].fill(f64::INFINITY);
        let Some(v) = v else { return };
        let per_s_y = self.shared.per_scales(self.depth.layout);
        for (((lo, y), v), scale) in lo.iter_mut().zip(data.outputs).zip(v.hi).zip(per_s_y) {
            *lo = y - v * scale;
        }
        for (((hi, y), v), scale) in hi.iter_mut().zip(data.outputs).zip(v.lo).zip(per_s_y) {
            *hi = y - v * scale;
        }
        if data.missing {
            lo[..used].iter_mut().filter(|lo| lo.is_nan()).for_each(|lo| *lo = f64::NEG_INFINITY);
            hi[..used].iter_mut().filter(|hi| hi.is_nan()).for_each(|hi| *hi = f64::INFINITY);
        }
    }

    /// Bounds on the disturbances, in the user's units, into lo and hi.
    #[inline(always)]
    pub(crate) fn limits_of_disturbances(&self, (lo, hi): (&mut [f64], &mut [f64])) {
        let used = self.depth.layout.disturbances_len();
        let used = if let Some(w) = self.shared.w_limits {
            lo[..used].copy_from_slice(&w.lo[..used]);
            hi[..used].copy_from_slice(&w.hi[..used]);
            used
        } else {
            0
        };
        lo[used..].fill(f64::NEG_INFINITY);
        hi[used..].fill(f64::INFINITY);
    }

    /// Moves the states of a window, in the user's units, into the box in force.
    #[cold]
    pub fn confine(&self, data: &Data<'_>, s: &mut Scratch<'_>, window: &mut [f64]) {
        let Some(bounds) = data.x_bounds.or(self.shared.x_limits) else { return };
        let (split, len) = (self.depth.layout.split(), bounds.lo.len());
        if !self.depth.kind.centered {
            for (i, x) in window.iter_mut().enumerate() {
                *x = x.max(bounds.lo[i % len]).min(bounds.hi[i % len]);
            }
            return;
        }
        let Spared { lo, hi, outputs, z, .. } = s.spare.parts();
        let own = (&mut lo[..split], &mut hi[..split]);
        self.box_of_this_step(bounds, outputs, data, z, own);
        for (((x, mean), lo), hi) in window.iter_mut().zip(data.means).zip(lo).zip(hi) {
            *x = x.max(*lo + mean).min(*hi + mean);
        }
    }
}
