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

use crate::active_set::factor::{cholesky, solve_lower, solve_transposed};
use crate::panels::{Panels, axpy, dot, padded, panels_len, square};
use crate::plan::span::{Cursor, Span};

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
    /// A (n × n, by rows), and so on.
    pub A: Span,
    /// (n × m)
    pub B: Span,
    /// (n)
    pub e: Span,
    /// (p × n)
    pub C: Span,
    /// (p × m)
    pub D: Span,
    /// (n × n)
    pub Q: Span,
    /// Diagonal (p).
    pub R: Span,
    /// (n × n)
    pub P: Span,
    /// P⁻¹ (n × n).
    pub information: Span,
}

impl KalmanSpans {
    pub(crate) fn new([n, p, m]: [usize; 3], recorded: bool, next: &mut Cursor) -> Self {
        let kept = |len: usize| if recorded { len } else { 0 };
        KalmanSpans {
            filter: next.take(kept(panels_len(n + p, n + p + m))),
            offset: next.take(kept(padded(n + p))),
            smoother: next.take(kept(panels_len(3 * n, n + p))),
            output: next.take(kept(panels_len(p, n))),
            output_offset: next.take(kept(padded(p))),
            A: next.take(kept(n * n)),
            B: next.take(kept(n * m)),
            e: next.take(kept(n)),
            C: next.take(kept(p * n)),
            D: next.take(kept(p * m)),
            Q: next.take(kept(n * n)),
            R: next.take(kept(p)),
            P: next.take(kept(n * n)),
            information: next.take(kept(n * n)),
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
    pub model: Model<'a>,
}

/// The model by rows, for windows with covariances of their own.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Model<'a> {
    n: usize,
    m: usize,
    A: &'a [f64],
    B: &'a [f64],
    e: &'a [f64],
    C: &'a [f64],
    D: &'a [f64],
    r: &'a [f64],
    Q: &'a [f64],
    pub R: &'a [f64],
    pub P: &'a [f64],
    information: &'a [f64],
}

/// The estimates of a window that no bound holds.
#[derive(Debug, Clone, Copy)]
pub enum Filtered<'a> {
    /// With the stationary covariance: to be smoothed.
    Settled {
        /// x̂(t-m) … x̂(t-1) (m·n), one filter's.
        past: &'a [f64],
        /// ν(t-m) … ν(t-1) (m·p).
        innovations: &'a [f64],
        /// x̂(t) (n).
        next: &'a [f64],
    },
    /// With covariances of their own, smoothed.
    Losses {
        /// ((m+1)·n)
        states: &'a [f64],
        /// (m·n)
        disturbances: &'a [f64],
        /// (17)
        cost: f64,
    },
}

impl Filtered<'_> {
    /// (17) at the minimiser: Σ‖ν(k)‖².
    #[inline(always)]
    pub fn cost(&self) -> f64 {
        match self {
            Filtered::Settled { innovations, .. } => square(innovations),
            Filtered::Losses { cost, .. } => *cost,
        }
    }
}

impl<'a> Kalman<'a> {
    pub fn new([n, p, m]: [usize; 3], spans: KalmanSpans, numbers: &'a [f64]) -> Self {
        let KalmanSpans { filter, offset, smoother, output, output_offset, .. } = spans;
        let of = |span: Span| span.of(numbers);
        let model = Model {
            n,
            m,
            A: of(spans.A),
            B: of(spans.B),
            e: of(spans.e),
            C: of(spans.C),
            D: of(spans.D),
            r: of(output_offset),
            Q: of(spans.Q),
            R: of(spans.R),
            P: of(spans.P),
            information: of(spans.information),
        };
        Kalman {
            n,
            p,
            filter: Panels::new(n + p + m, filter.of(numbers)),
            offset: offset.of(numbers),
            smoother: Panels::new(n + p, smoother.of(numbers)),
            output: Panels::new(n, output.of(numbers)),
            output_offset: output_offset.of(numbers),
            model,
        }
    }

    /// \[x̂(k+1); ν(k)\] into `out` (padded).
    #[inline(always)]
    pub fn ahead(&self, x: &[f64], y: &[f64], u: &[f64], out: &mut [f64]) {
        self.filter.sums(
            0,
            out,
            #[inline(always)]
            |sum| {
                sum.add(x);
                sum.add(y);
                sum.add(u);
            },
        );
        out.iter_mut().zip(self.offset).for_each(|(out, offset)| *out += offset);
    }

    /// The states, oldest last, the disturbances and the fitted outputs of a window to `tell`,
    /// instant by instant from k = m down to 0: (k, x(k|t), ŵ(k-1)); `room` is for
    /// [`room`](Self::room) numbers.
    #[inline(always)]
    pub fn smooth(
        &self,
        filtered: Filtered<'_>,
        room: &mut [f64],
        mut tell: impl FnMut(usize, &[f64], &[f64]),
    ) {
        let (n, p) = (self.n, self.p);
        let (past, innovations, next) = match filtered {
            Filtered::Settled { past, innovations, next } => (past, innovations, next),
            Filtered::Losses { states, disturbances, .. } => {
                for (k, x) in states.chunks_exact(n).enumerate().rev() {
                    let w = if k > 0 { &disturbances[(k - 1) * n..k * n] } else { x };
                    tell(k, x, w);
                }
                return;
            }
        };
        let m = innovations.len() / p;
        let (found, rest) = room.split_at_mut(padded(3 * n));
        let lambda = &mut rest[..n];
        lambda.fill(0.0);
        for k in (0..=m).rev() {
            let predicted = if k == m { next } else { &past[k * n..(k + 1) * n] };
            let before = if k > 0 { &innovations[(k - 1) * p..k * p] } else { &[] };
            self.smoother.sums(
                0,
                found,
                #[inline(always)]
                |sum| {
                    sum.add(lambda);
                    sum.add(before);
                },
            );
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
pub(crate) fn room(n: usize, p: usize) -> usize {
    padded(n) + padded(3 * n) + padded(p)
}

impl<'a> Model<'a> {
    /// Row i of C.
    #[inline]
    pub fn c(&self, i: usize) -> &'a [f64] {
        &self.C[i * self.n..(i + 1) * self.n]
    }

    /// What u makes of output i, with its offset.
    pub fn pushed_output(&self, i: usize, u: &[f64]) -> f64 {
        self.r[i] + dot(&self.D[i * self.m..(i + 1) * self.m], u)
    }

    /// What x and u make of output i.
    #[inline(always)]
    pub fn expected_output(&self, i: usize, x: &[f64], u: &[f64]) -> f64 {
        dot(self.c(i), x) + self.pushed_output(i, u)
    }

    /// Entry (i, j) of C Σ Cᵀ, Σ (n × n).
    #[inline(always)]
    pub fn output_covariance(&self, [i, j]: [usize; 2], sigma: &[f64]) -> f64 {
        let along = |(a, row): (&f64, &[f64])| a * dot(row, self.c(j));
        self.c(i).iter().zip(sigma.chunks_exact(self.n)).map(along).sum()
    }

    /// P without the outputs y of an instant to P with those that were measured (n × n); `tell` is
    /// told of each its number, K and s. `work` is for n numbers.
    pub fn measure(
        &self,
        y: &[f64],
        P: &mut [f64],
        work: &mut [f64],
        mut tell: impl FnMut(usize, &[f64], f64),
    ) {
        let n = self.n;
        for i in (0..y.len()).filter(|&i| !y[i].is_nan()) {
            let (c, gain) = (self.c(i), &mut work[..n]);
            gain.iter_mut().zip(P.chunks_exact(n)).for_each(|(g, row)| *g = dot(row, c));
            let s = dot(c, gain) + self.R[i];
            gain.iter_mut().for_each(|g| *g /= s);
            for (row, g) in P.chunks_exact_mut(n).zip(&*gain) {
                axpy(-g * s, gain, row);
            }
            tell(i, gain, s);
        }
    }

    /// A P Aᵀ + Q in the place of P; `work` is for n × n numbers.
    pub fn predict(&self, P: &mut [f64], work: &mut [f64]) {
        let n = self.n;
        let rows = |i: usize| &self.A[i * n..(i + 1) * n];
        let AP = &mut work[..n * n];
        for k in 0..n * n {
            // P is symmetric: its column is its row
            AP[k] = dot(rows(k / n), &P[k % n * n..(k % n + 1) * n]);
        }
        for i in 0..n {
            for j in 0..=i {
                let entry = dot(&AP[i * n..(i + 1) * n], rows(j)) + self.Q[i * n + j];
                (P[i * n + j], P[j * n + i]) = (entry, entry);
            }
        }
    }

    /// P over one instant.
    pub fn follow(&self, y: &[f64], P: &mut [f64], work: &mut [f64]) {
        self.measure(y, P, work, |_, _, _| {});
        self.predict(P, work);
    }

    /// A x + B u + e in the place of x; `work` is for n numbers.
    pub fn move_on(&self, x: &mut [f64], u: &[f64], work: &mut [f64]) {
        let (n, m) = (self.n, self.m);
        for (i, next) in work[..n].iter_mut().enumerate() {
            let own = dot(&self.A[i * n..(i + 1) * n], x) + self.e[i];
            *next = own + dot(&self.B[i * m..(i + 1) * m], u);
        }
        x.copy_from_slice(&work[..n]);
    }

    /// Q λ.
    pub fn times_Q(&self, lambda: &[f64], out: &mut [f64]) {
        let rows = self.Q.chunks_exact(self.n);
        out.iter_mut().zip(rows).for_each(|(out, row)| *out = dot(row, lambda));
    }

    /// Aᵀ λ.
    pub fn times_A_transposed(&self, lambda: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (row, lambda) in self.A.chunks_exact(self.n).zip(lambda) {
            axpy(*lambda, row, out);
        }
    }

    /// What the inverse of another covariance lacks of that of P; `work` is for n × n numbers.
    /// Nothing where it cannot be factored.
    pub fn lacking(&self, other: &[f64], out: &mut [f64], work: &mut [f64]) {
        let n = self.n;
        let L = &mut work[..n * n];
        L.copy_from_slice(other);
        out.fill(0.0);
        if cholesky(L, n, n, 0.0).is_none() {
            return;
        }
        // column by column of the identity
        for j in 0..n {
            let column = &mut out[j * n..(j + 1) * n];
            column[j] = 1.0;
            solve_lower(L, column, n);
            solve_transposed(L, column, n);
        }
        out.iter_mut().zip(self.information).for_each(|(out, own)| *out = own - *out);
    }
}
