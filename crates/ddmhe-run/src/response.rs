//! The response of states and outputs to known inputs.
//!
//! By superposition the motion of a window is its *free* motion, which the recorded windows span,
//! plus its *forced* motion: what the inputs u of the window alone make of a system that rests at
//! its beginning,
//!
//! > x_f(0) = 0,  \[x_f(k+1); y_f(k)\] = Θᵀ s_f(k),  s_f(k) = \[x_f(k); u(k); x_f(k-1); y_f(k-1);
//! > u(k-1); …\]
//!
//! with the L latest instants in s_f and nothing before the window. Θ comes from the recording
//! (`ddmhe-core`). A step takes the forced motion off its outputs, estimates the free one as if
//! there were no input, and adds x_f to the states. x_f(0) = 0: the prior is that of the free
//! motion.

use crate::panels::{Panels, WIDTH, padded, panels_len};

/// Sizes of a response.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ResponseSizes {
    /// States n.
    pub n: usize,
    /// Outputs p.
    pub p: usize,
    /// Inputs m; 0: there is no response.
    pub m: usize,
    /// Instants L that the next one depends on.
    pub lag: usize,
}

impl ResponseSizes {
    /// Entries of s_f: n + m of this instant and n + p + m of each before.
    pub fn regressors(self) -> usize {
        self.lag * (self.n + self.p + self.m) - self.p
    }

    /// Numbers in Θᵀ in panels, (n + p) × [`regressors`](Self::regressors).
    pub fn panels_len(self) -> usize {
        if self.m == 0 { 0 } else { panels_len(self.n + self.p, self.regressors()) }
    }

    /// Numbers from one instant of a forced motion to the next.
    #[inline(always)]
    pub fn stride(self) -> usize {
        padded(self.n + self.p)
    }
}

/// Θ, all in scaled units.
#[derive(Debug, Clone, Copy)]
pub struct Response<'a> {
    sizes: ResponseSizes,
    theta: Panels<'a>,
}

impl<'a> Response<'a> {
    /// Θᵀ in panels. Its columns are in the order of [`forced`](Self::forced): the oldest instant's
    /// \[x; y; u\] first, of the newest u, then x.
    pub fn new(sizes: ResponseSizes, theta: &'a [f64]) -> Self {
        Response { sizes, theta: Panels::new(sizes.regressors(), theta) }
    }

    /// The forced motion of scaled inputs u (depth·m): for each instant k in turn \[x_f(k+1);
    /// y_f(k)\], [`ResponseSizes::stride`] numbers apart. x_f(0) = 0 is not written.
    #[inline(always)]
    pub fn forced(&self, u: &[f64], motion: &mut [f64]) {
        let ResponseSizes { n, p, m, lag } = self.sizes;
        let stride = self.sizes.stride();
        if lag == 1 && stride == WIDTH {
            return self.theta.recursion(m, u, motion);
        }
        for (k, inputs) in u.chunks_exact(m).enumerate() {
            let (before, now) = motion.split_at_mut(k * stride);
            let oldest = k.min(lag - 1);
            let first = self.sizes.regressors() - (m + n) - oldest * (n + p + m);
            self.theta.sums(first, &mut now[..stride], |sum| {
                for j in k - oldest..k {
                    sum.skip(if j == 0 { n } else { 0 });
                    sum.add(state(before, stride, j, n));
                    sum.add(&before[j * stride + n..j * stride + n + p]);
                    sum.add(&u[j * m..(j + 1) * m]);
                }
                sum.add(inputs);
                sum.add(state(before, stride, k, n));
            });
        }
    }
}

/// x_f(k), or nothing for x_f(0) = 0.
#[inline(always)]
fn state(motion: &[f64], stride: usize, k: usize, n: usize) -> &[f64] {
    match k.checked_sub(1) {
        Some(before) => &motion[before * stride..before * stride + n],
        None => &[],
    }
}
