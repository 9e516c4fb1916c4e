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

use crate::panels::{Panels, panels_len};

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

    /// The forced motion of scaled inputs u (depth·m): x_f(1) … x_f(depth) and y_f(0) …
    /// y_f(depth-1), time-major. `room` is for n + p numbers, padded.
    #[inline(always)]
    pub fn forced(&self, u: &[f64], x: &mut [f64], y: &mut [f64], room: &mut [f64]) {
        let ResponseSizes { n, p, m, lag } = self.sizes;
        for (k, now) in u.chunks_exact(m).enumerate() {
            let oldest = k.min(lag - 1);
            let first = self.sizes.regressors() - (m + n) - oldest * (n + p + m);
            self.theta.sums(
                first,
                room,
                #[inline(always)]
                |sum| {
                    for j in k - oldest..k {
                        sum.skip(if j == 0 { n } else { 0 });
                        sum.add(state(x, j, n));
                        sum.add(&y[j * p..(j + 1) * p]);
                        sum.add(&u[j * m..(j + 1) * m]);
                    }
                    sum.add(now);
                    sum.add(state(x, k, n));
                },
            );
            x[k * n..(k + 1) * n].copy_from_slice(&room[..n]);
            y[k * p..(k + 1) * p].copy_from_slice(&room[n..n + p]);
        }
    }

    /// One instant after others: \[x; y\] into `out` (padded), of L-1 instants \[x; y; u\], oldest
    /// first, and of the newest u and x.
    pub(crate) fn next(&self, before: &[f64], u: &[f64], x: &[f64], out: &mut [f64]) {
        self.theta.sums(0, out, |sum| {
            sum.add(before);
            sum.add(u);
            sum.add(x);
        });
    }
}

/// x_f(k), or nothing for x_f(0) = 0.
#[inline(always)]
fn state(x: &[f64], k: usize, n: usize) -> &[f64] {
    match k.checked_sub(1) {
        Some(before) => &x[before * n..k * n],
        None => &[],
    }
}
