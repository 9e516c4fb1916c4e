//! Order reduction: a zonotope of fewer generators that holds the one given, with outward rounding.

use crate::rounding::{diagonal, inflation, map, row_sums};
use crate::tol;
use faer::{Mat, Side};
use std::borrow::Cow;

/// How [`Zonotope::reduce`](crate::Zonotope::reduce) encloses a zonotope by one of fewer
/// generators.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reduction {
    /// ↓q of the interval paper's appendix, with the absolute values that it lacks in print: the q
    /// - n longest generators (Euclidean norm) stay, the others are boxed by their row sums.
    Paper,
    /// Girard 2005: the generators with the smallest ‖g‖₁ - ‖g‖∞ (nearly axis-parallel) are boxed.
    #[default]
    Girard,
    /// Combastel 2003: the shortest generators (Euclidean norm) are boxed. The same set as
    /// [`Paper`](Self::Paper).
    Combastel,
    /// As Girard, but boxed along the principal axes of the generators that go (Kopetzki,
    /// Schürmann, Althoff 2017).
    Pca,
}

impl Reduction {
    /// All of them.
    pub const ALL: [Reduction; 4] =
        [Reduction::Girard, Reduction::Combastel, Reduction::Pca, Reduction::Paper];

    /// The reduction as the word that users write.
    pub fn as_str(self) -> &'static str {
        match self {
            Reduction::Paper => "paper",
            Reduction::Girard => "girard",
            Reduction::Combastel => "combastel",
            Reduction::Pca => "pca",
        }
    }
}

/// ↓q in place: columns that are all zero go, then the q - n that `method` ranks first stay and a
/// box holds the others.
pub(crate) fn reduce(n: usize, columns: &mut Vec<f64>, q: usize, method: Reduction) {
    let mut kept = 0;
    for j in 0..columns.len() / n {
        if columns[j * n..(j + 1) * n].iter().any(|v| *v != 0.0) {
            columns.copy_within(j * n..(j + 1) * n, kept * n);
            kept += 1;
        }
    }
    columns.truncate(kept * n);
    if kept <= q {
        return;
    }
    let size = |g: &[f64]| match method {
        Reduction::Paper | Reduction::Combastel => g.iter().map(|v| v * v).sum::<f64>(),
        Reduction::Girard | Reduction::Pca => {
            g.iter().map(|v| v.abs()).sum::<f64>() - g.iter().fold(0.0, |m: f64, v| m.max(v.abs()))
        }
    };
    let mut ranked: Vec<(f64, usize)> = columns.chunks_exact(n).map(size).zip(0..).collect();
    if q > n {
        ranked.select_nth_unstable_by(q - n - 1, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    }
    let mut sorted = Vec::with_capacity(columns.len());
    ranked.iter().for_each(|&(_, j)| sorted.extend_from_slice(&columns[j * n..(j + 1) * n]));
    let (stay, go) = sorted.split_at((q - n) * n);
    columns.clear();
    columns.extend_from_slice(stay);
    match method {
        Reduction::Pca => columns.extend(oriented_box(n, go)),
        _ => columns.extend(diagonal(&row_sums(n, go))),
    }
}

/// Columns of V diag(s) that hold M Bᵐ, V the principal axes of M.
fn oriented_box(n: usize, columns: &[f64]) -> Vec<f64> {
    let boxed = || diagonal(&row_sums(n, columns));
    let total: f64 = columns.iter().map(|v| v.abs()).sum::<f64>() * inflation(columns.len());
    if !total.is_finite() {
        return boxed();
    }
    // squares of very large or small numbers leave the floats: the axes are those of the set in
    // another unit
    let sized: Cow<'_, [f64]> = match tol::SQUARED.contains(&total) {
        true => columns.into(),
        false => columns.iter().map(|v| libm::scalbn(*v, -libm::ilogb(total))).collect(),
    };
    let gram = Mat::from_fn(n, n, |i, j| sized.chunks_exact(n).map(|g| g[i] * g[j]).sum::<f64>());
    let Ok(found) = gram.self_adjoint_eigen(Side::Lower) else { return boxed() };
    let V = found.U();
    // M = V Vᵀ M + (I - V Vᵀ) M: with |I - V Vᵀ| at most `skew` in every entry, s grows by what the
    // rest can add.
    let mut skew = 0.0_f64;
    for i in 0..n {
        for j in 0..n {
            let product: f64 = (0..n).map(|k| V[(i, k)] * V[(j, k)]).sum();
            skew = skew.max((product - f64::from(u8::from(i == j))).abs());
        }
    }
    skew += 2.0 * n as f64 * f64::EPSILON;
    if !(skew < tol::SKEW) {
        return boxed();
    }
    // The rest is a vector of entries at most skew·total; Vᵀ and V⁻¹ agree to SKEW there, hence
    // the factor 2. MIN_POSITIVE: what products may lose where they fall below the normal numbers.
    let extra =
        2.0 * n as f64 * (skew + (n as f64 + 2.0) * f64::EPSILON) * total + f64::MIN_POSITIVE;
    let mut turned = vec![0.0; n * n];
    for i in 0..n {
        let axis: Vec<f64> = (0..n).map(|k| V[(k, i)]).collect();
        let sum: f64 = columns.chunks_exact(n).map(|g| map(&axis, g)[0].abs()).sum();
        let s = sum * inflation(columns.len()) + extra;
        if !s.is_finite() {
            return boxed();
        }
        (0..n).for_each(|k| turned[i * n + k] = axis[k] * s);
    }
    turned
}
