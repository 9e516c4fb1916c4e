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

use crate::panels::{Panels, padded, panels_len};

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

    /// Numbers that [`Response::forced`] works in.
    pub fn room(self) -> usize {
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

    /// x_f (depth+1)·n and y_f depth·p from u (depth·m), scaled; `room` is for
    /// [`ResponseSizes::room`] numbers.
    #[inline(always)]
    pub fn forced(&self, u: &[f64], x: &mut [f64], y: &mut [f64], room: &mut [f64]) {
        let ResponseSizes { n, p, m, lag } = self.sizes;
        x[..n].fill(0.0);
        for k in 0..u.len() / m {
            room.fill(0.0);
            let mut column = self.sizes.regressors() - (m + n) - k.min(lag - 1) * (n + p + m);
            for before in (k - k.min(lag - 1))..k {
                for part in [at(x, before, n), at(y, before, p), at(u, before, m)] {
                    column = self.theta.add(column, part, room);
                }
            }
            column = self.theta.add(column, at(u, k, m), room);
            self.theta.add(column, at(x, k, n), room);
            x[(k + 1) * n..(k + 2) * n].copy_from_slice(&room[..n]);
            y[k * p..(k + 1) * p].copy_from_slice(&room[n..n + p]);
        }
    }
}

/// Sample k of a signal.
#[inline(always)]
fn at(signal: &[f64], k: usize, width: usize) -> &[f64] {
    &signal[k * width..(k + 1) * width]
}
