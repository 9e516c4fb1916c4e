//! The covariance of an estimate from that of its prior: small matrices by rows.

use crate::evidence::rule::Rule;
use crate::panels::{Root, dot};

/// Largest Σ_i (standard deviation / recorded spread)² that is handed out: beyond it every state is
/// anywhere.
pub const ANYWHERE: f64 = 1e12;

/// The standard normal distribution's .9999.
pub const RARE: f64 = 3.719016485455709;

/// Of an unknown state: the variance of its prior in units of the recorded one.
pub const WIDE: f64 = 10.0;

/// s(v) of the [rules](Rule): what Q₀ is multiplied with. `limit` is what v is novel above.
#[inline(always)]
pub fn inflation(rule: Rule, v: f64, limit: f64) -> f64 {
    match rule {
        Rule::Curved | Rule::Louder if v > 1.0 => v * v.root(),
        Rule::Louder => 1.0,
        Rule::Stated if v <= limit => 1.0,
        _ => v,
    }
}

/// G = max(1, (d/(.1 T))^2q): what errors of curved recordings grow by with the number d of samples
/// since the recording's end, at most T, where held-out ones grew; 1 for q = 0.
#[inline(always)]
pub fn growth([power, tenth, all, _]: [f64; 4], samples: f64) -> f64 {
    let far = if samples < all { samples } else { all };
    if power == 0.0 || far <= tenth { 1.0 } else { libm::pow(far / tenth, power) }
}

/// The quantile of a χ² of these degrees that belongs to one of a normal variable, by Wilson and
/// Hilferty.
#[inline(always)]
pub fn chi_square(degrees: f64, normal: f64) -> f64 {
    let part = 2.0 / (9.0 * degrees);
    let root = 1.0 - part + normal * part.root();
    degrees * root * root * root
}

/// L Σ Lᵀ for Σ (n × n, symmetric) and L of n rows, into `out`; `work` is for n × n numbers.
#[inline(always)]
pub fn sandwich(L: &[f64], sigma: &[f64], n: usize, work: &mut [f64], out: &mut [f64]) {
    // the loops of small systems are unrolled
    match n {
        1 => fixed::<1>(L, sigma, out),
        2 => fixed::<2>(L, sigma, out),
        3 => fixed::<3>(L, sigma, out),
        4 => fixed::<4>(L, sigma, out),
        _ => {
            for (row, work) in L.chunks_exact(n).zip(work.chunks_exact_mut(n)) {
                for (entry, column) in work.iter_mut().zip(sigma.chunks_exact(n)) {
                    *entry = dot(row, column);
                }
            }
            for (out, row) in out.chunks_exact_mut(n).zip(work.chunks_exact(n)) {
                for (entry, column) in out.iter_mut().zip(L.chunks_exact(n)) {
                    *entry = dot(row, column);
                }
            }
        }
    }
}

/// The same for N states.
#[inline(always)]
fn fixed<const N: usize>(L: &[f64], sigma: &[f64], out: &mut [f64]) {
    let (rows, columns) = (L.as_chunks::<N>().0, sigma.as_chunks::<N>().0);
    let (Ok(rows), Ok(columns)) =
        (<&[[f64; N]; N]>::try_from(rows), <&[[f64; N]; N]>::try_from(columns))
    else {
        return;
    };
    for (out, row) in out.as_chunks_mut::<N>().0.iter_mut().zip(rows) {
        let along: [f64; N] = columns.each_ref().map(|column| product(row, column));
        *out = rows.each_ref().map(|row| product(&along, row));
    }
}

/// aᵀΣ a for Σ (n × n, symmetric).
#[inline(always)]
pub fn form(a: &[f64], sigma: &[f64]) -> f64 {
    match a.len() {
        2 => fixed_form::<2>(a, sigma),
        3 => fixed_form::<3>(a, sigma),
        4 => fixed_form::<4>(a, sigma),
        n => sigma.chunks_exact(n).zip(a).map(|(row, a_i)| a_i * dot(row, a)).sum(),
    }
}

#[inline(always)]
fn fixed_form<const N: usize>(a: &[f64], sigma: &[f64]) -> f64 {
    let Ok(a) = <&[f64; N]>::try_from(a) else { return 0.0 };
    let rows = sigma.as_chunks::<N>().0;
    rows.iter().zip(a).map(|(row, a_i)| a_i * product(row, a)).sum()
}

#[inline(always)]
fn product<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    let mut sum = 0.0;
    for i in 0..N {
        sum += a[i] * b[i];
    }
    sum
}

/// Σ_i M_ii w_i.
#[inline(always)]
pub fn weighted_trace(M: &[f64], weights: &[f64]) -> f64 {
    let n = weights.len();
    weights.iter().enumerate().map(|(i, w)| w * M[i * n + i]).sum()
}

/// Σ = A (1 + 1/κ) + Q (1 + κ) in the place of A, for Q = s Q₀; A + Q where the two errors are
/// independent.
#[inline(always)]
pub fn join(A: &mut [f64], Q_0: &[f64], s: f64, per_spread: &[f64], independent: bool) {
    let (a, q) = (weighted_trace(A, per_spread), s * weighted_trace(Q_0, per_spread));
    let kappa = if independent || !(a > 0.0 && q > 0.0) { None } else { Some((a / q).root()) };
    let (of_a, of_q) = kappa.map_or((1.0, s), |kappa| (1.0 + 1.0 / kappa, s * (1.0 + kappa)));
    A.iter_mut().zip(Q_0).for_each(|(a, q)| *a = *a * of_a + q * of_q);
}

/// Σ, no larger than [`ANYWHERE`], which is also what becomes of one that is no number.
#[inline(always)]
pub fn limited(sigma: &mut [f64], per_spread: &[f64]) {
    let n = per_spread.len();
    if (0..n).any(|i| sigma[i * n + i] < 0.0) {
        rounded(sigma, n);
    }
    let size = weighted_trace(sigma, per_spread);
    if size <= ANYWHERE {
        return;
    }
    anywhere(sigma, per_spread);
}

/// A variance below 0 is rounding of larger ones: its size is what is known of that state.
#[cold]
fn rounded(sigma: &mut [f64], n: usize) {
    for i in 0..n {
        let own = sigma[i * n + i];
        if own < 0.0 {
            (0..n).for_each(|j| (sigma[i * n + j], sigma[j * n + i]) = (0.0, 0.0));
            sigma[i * n + i] = -own;
        }
    }
}

/// The covariance of a state that may be anywhere.
#[cold]
pub fn anywhere(sigma: &mut [f64], per_spread: &[f64]) {
    wide(sigma, per_spread, ANYWHERE / per_spread.len() as f64);
}

/// That of one whose states deviate by √`times` recorded spreads.
#[cold]
pub fn wide(sigma: &mut [f64], per_spread: &[f64], times: f64) {
    let n = per_spread.len();
    sigma.fill(0.0);
    (0..n).for_each(|i| sigma[i * n + i] = times / per_spread[i]);
}
