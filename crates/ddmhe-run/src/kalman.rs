//! The window without active bounds where the weights are those of the recording: what a Kalman
//! filter and the smoother behind it make of it.
//!
//! With x(k+1) = A x + B u + e + w, y = C x + D u + r + v, cov w = Q, cov v = R and the stationary
//! covariance P of x̂ the minimum of (17) over a window from the prior (x̄, P) is the filter that
//! starts there:
//!
//! > ν(k) = S^{-½}(y(k) - C x̂(k) - D u(k) - r),  S = C P Cᵀ + R,
//! > x̂(k+1) = A x̂(k) + B u(k) + e + L S^{½} ν(k),  L = A P Cᵀ S⁻¹,  cost Σ‖ν(k)‖²
//!
//! and the window's states are smoothed backwards from λ(t) = 0 without an inverse of P (Bryson and
//! Frazier 1963):
//!
//! > λ(k) = (A - L C)ᵀ λ(k+1) + Cᵀ S^{-½ᵀ} ν(k),  x(k|t) = x̂(k) + P λ(k),  ŵ(k) = Q λ(k+1).
//!
//! As long as no estimate of the window was made otherwise x̂(t-m) … x̂(t-1) *are* that filter, and
//! a step is one product with n + p rows. All in scaled deviations.

use crate::panels::{Panels, dot, padded, panels_len};
use crate::plan::common::{Common, Cursor, Sizes, Span};

/// Where the matrices are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KalmanSpans {
    /// \[x̂(k+1); ν(k)\] of \[x̂(k); y(k); u(k)\], in panels.
    pub filter: Span,
    /// What is added to it (n + p, padded).
    pub offset: Span,
    /// \[P λ(k); Q λ(k); λ(k-1)\] of \[λ(k); ν(k-1)\], in panels.
    pub smoother: Span,
    /// C in panels.
    pub output: Span,
    /// r (p, padded).
    pub output_offset: Span,
}

impl KalmanSpans {
    pub(crate) fn new(sizes: Sizes, next: &mut Cursor) -> Self {
        let Sizes { n, p, m, .. } = sizes;
        let kept = |len: usize| if sizes.recorded { len } else { 0 };
        KalmanSpans {
            filter: next.take(kept(panels_len(n + p, n + p + m))),
            offset: next.take(kept(padded(n + p))),
            smoother: next.take(kept(panels_len(3 * n, n + p))),
            output: next.take(kept(panels_len(p, n))),
            output_offset: next.take(kept(padded(p))),
        }
    }
}

/// The matrices of a plan.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kalman<'a> {
    n: usize,
    p: usize,
    filter: Panels<'a>,
    offset: &'a [f64],
    smoother: Panels<'a>,
    output: Panels<'a>,
    output_offset: &'a [f64],
}

/// Where the estimates of a window are that no bound holds.
#[derive(Debug, Clone, Copy)]
pub struct Filtered<'a> {
    /// x̂(t-m) … x̂(t-1) (m·n), one filter's.
    pub past: &'a [f64],
    /// ν(t-m) … ν(t-1) (m·p).
    pub innovations: &'a [f64],
    /// x̂(t) (n).
    pub next: &'a [f64],
}

impl Filtered<'_> {
    /// (17) at the minimiser: Σ‖ν(k)‖².
    #[inline(always)]
    pub fn cost(&self) -> f64 {
        dot(self.innovations, self.innovations)
    }
}

impl<'a> Kalman<'a> {
    pub fn new(common: &Common, numbers: &'a [f64]) -> Self {
        let Sizes { n, p, m, .. } = common.sizes;
        let KalmanSpans { filter, offset, smoother, output, output_offset } = common.kalman;
        Kalman {
            n,
            p,
            filter: Panels::new(n + p + m, filter.of(numbers)),
            offset: offset.of(numbers),
            smoother: Panels::new(n + p, smoother.of(numbers)),
            output: Panels::new(n, output.of(numbers)),
            output_offset: output_offset.of(numbers),
        }
    }

    /// \[x̂(k+1); ν(k)\] into `out` (padded).
    #[inline(always)]
    pub fn ahead(&self, x: &[f64], y: &[f64], u: &[f64], out: &mut [f64]) {
        self.filter.sums(0, out, |sum| {
            sum.add(x);
            sum.add(y);
            sum.add(u);
        });
        out.iter_mut().zip(self.offset).for_each(|(out, offset)| *out += offset);
    }

    /// The states, oldest last, the disturbances and the fitted outputs of a window to `tell`,
    /// instant by instant from k = m down to 0: (k, x(k|t), ŵ(k-1)); `room` is for
    /// [`room`](Self::room) numbers.
    #[inline(always)]
    pub fn smooth(
        &self,
        Filtered { past, innovations, next }: Filtered<'_>,
        room: &mut [f64],
        mut tell: impl FnMut(usize, &[f64], &[f64]),
    ) {
        let (n, p, m) = (self.n, self.p, innovations.len() / self.p);
        let (found, rest) = room.split_at_mut(padded(3 * n));
        let lambda = &mut rest[..n];
        lambda.fill(0.0);
        for k in (0..=m).rev() {
            let predicted = if k == m { next } else { &past[k * n..(k + 1) * n] };
            let before = if k > 0 { &innovations[(k - 1) * p..k * p] } else { &[] };
            self.smoother.sums(0, found, |sum| {
                sum.add(lambda);
                sum.add(before);
            });
            found.iter_mut().zip(predicted).for_each(|(x, predicted)| *x += predicted);
            tell(k, &found[..n], &found[n..2 * n]);
            lambda.copy_from_slice(&found[2 * n..3 * n]);
        }
    }

    /// C x + r into `out` (padded).
    #[inline(always)]
    pub fn output(&self, x: &[f64], out: &mut [f64]) {
        self.output.tall(self.output_offset, x, out);
    }
}

/// Numbers that a window takes to be smoothed in, on whole panels, with a fitted output.
pub(crate) fn room(sizes: Sizes) -> usize {
    padded(sizes.n) + padded(3 * sizes.n) + padded(sizes.p)
}
