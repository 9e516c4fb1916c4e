//! With the weights of the recording: what the recording leaves open of its own model.
//!
//! Least squares on T samples have found A, e, C, r (and B, D) with errors Δ. With F = A - L C, the
//! Kalman filter's error follows
//!
//! > ε(t+1) = F ε(t) + \[I, -L\] Δ \[x(t); u(t); 1\] - w(t) + L v(t)
//!
//! so that beside its stationary covariance P it has
//!
//! > Σ(t) = c_T (P + Σ_j K_j G K_jᵀ + b bᵀ),  K_j ← F K_j + z_j I,  b ← F b + B \[x̂ - x̄; u - ū\]
//!
//! z the regressors \[x; u; 1\] as the recording's moments whiten them, G = \[I, -L\] Γ \[I, -L\]ᵀ
//! the covariance of a row of Δ that matters, b what noise N on the recorded states biases the
//! model by, and c_T = (T+q+1)/(T-q-1) for q regressors: Q and R are known from T samples as well.
//! V is Σ νᵀS⁻¹ν over the window with S = C Σ Cᵀ + c_T R: χ², where the model is the system's.

use crate::panels::{axpy, dot};
use crate::plan::span::{Cursor, Span};

/// Where the numbers are. All in scaled units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ModelSpans {
    /// F (n × n).
    pub carry: Span,
    /// G (n × n).
    pub error: Span,
    /// W, lower triangular (q × q, by rows): z = W \[x - x̄; u - ū\].
    pub whiten: Span,
    /// B (n × q).
    pub bias: Span,
    /// \[x̄; ū\] (q).
    pub mean: Span,
    /// 1/√T and c_T.
    pub samples: Span,
}

impl ModelSpans {
    pub(crate) fn new([n, m]: [usize; 2], filter: bool, next: &mut Cursor) -> Self {
        let q = n + m;
        let kept = |len: usize| if filter { len } else { 0 };
        ModelSpans {
            carry: next.take(kept(n * n)),
            error: next.take(kept(n * n)),
            whiten: next.take(kept(q * q)),
            bias: next.take(kept(n * q)),
            mean: next.take(kept(q)),
            samples: next.take(kept(2)),
        }
    }
}

/// The numbers, to be read.
#[derive(Debug, Clone, Copy)]
pub struct OfModel<'a> {
    carry: &'a [f64],
    error: &'a [f64],
    whiten: &'a [f64],
    bias: &'a [f64],
    mean: &'a [f64],
    samples: &'a [f64],
}

impl<'a> OfModel<'a> {
    pub(crate) fn new(spans: ModelSpans, numbers: &'a [f64]) -> Self {
        let of = |span: Span| span.of(numbers);
        OfModel {
            carry: of(spans.carry),
            error: of(spans.error),
            whiten: of(spans.whiten),
            bias: of(spans.bias),
            mean: of(spans.mean),
            samples: of(spans.samples),
        }
    }

    /// c_T.
    #[inline(always)]
    pub fn few(&self) -> f64 {
        self.samples[1]
    }

    /// K (q+1 n × n) and b (n) over an instant with this state and these inputs; `work` is for
    /// n × n + n + 2 q numbers.
    pub fn move_on(
        &self,
        x: &[f64],
        u: &[f64],
        (K, b): (&mut [f64], &mut [f64]),
        work: &mut [f64],
    ) {
        let (n, q) = (x.len(), self.mean.len());
        let (next, work) = work.split_at_mut(n * n);
        let (next_b, work) = work.split_at_mut(n);
        let (deviation, z) = work.split_at_mut(q);
        let regressors = x.iter().chain(u).zip(self.mean);
        deviation.iter_mut().zip(regressors).for_each(|(to, (v, mean))| *to = v - mean);
        for (i, z) in z[..q].iter_mut().enumerate() {
            *z = dot(&self.whiten[i * q..i * q + i + 1], &deviation[..i + 1]);
        }
        for (j, K) in K.chunks_exact_mut(n * n).enumerate() {
            let z = if j < q { z[j] } else { self.samples[0] };
            self.times_carry(K, n, next);
            (0..n).for_each(|i| next[i * n + i] += z);
            K.copy_from_slice(next);
        }
        for (i, to) in next_b.iter_mut().enumerate() {
            *to = dot(&self.carry[i * n..(i + 1) * n], b)
                + dot(&self.bias[i * q..(i + 1) * q], deviation);
        }
        b.copy_from_slice(next_b);
    }

    /// F M (n × n each).
    fn times_carry(&self, M: &[f64], n: usize, out: &mut [f64]) {
        out.fill(0.0);
        for (row, out) in self.carry.chunks_exact(n).zip(out.chunks_exact_mut(n)) {
            row.iter().zip(M.chunks_exact(n)).for_each(|(f, M)| axpy(*f, M, out));
        }
    }

    /// Σ = c_T (P + Σ_j K_j G K_jᵀ + b bᵀ); `work` is for n numbers.
    pub fn covariance(
        &self,
        P: &[f64],
        (K, b): (&[f64], &[f64]),
        sigma: &mut [f64],
        work: &mut [f64],
    ) {
        let n = b.len();
        for i in 0..n {
            for j in 0..n {
                sigma[i * n + j] = P[i * n + j] + b[i] * b[j];
            }
        }
        for K in K.chunks_exact(n * n) {
            for i in 0..n {
                let row = &K[i * n..(i + 1) * n];
                for (to, column) in work[..n].iter_mut().zip(self.error.chunks_exact(n)) {
                    *to = dot(row, column);
                }
                for j in 0..n {
                    sigma[i * n + j] += dot(&work[..n], &K[j * n..(j + 1) * n]);
                }
            }
        }
        sigma.iter_mut().for_each(|entry| *entry *= self.few());
    }
}
