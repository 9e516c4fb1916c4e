//! Zonotopes ⟨p, M⟩ = {p + M ξ : ‖ξ‖∞ ≤ 1}: the sets that the interval observer carries.
//!
//! Equation numbers are those of the interval paper ("Interval Estimation for Bounded Jacobian Nonlinear Systems by
//! Zonotope Analysis"). Hulls and reductions round outward, so they enclose; linear maps and sums are exact up to the
//! rounding of their entries, which [`IntervalObserver`](crate::IntervalObserver) accounts for by a box of its own.

use crate::error::Error;
use crate::history::check_finite;
use crate::interval::Interval;
use crate::{qp, tol};
use faer::{Mat, Side};

/// How [`Zonotope::reduce`] encloses a zonotope by one of fewer generators.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reduction {
    /// ↓q of the interval paper's appendix, with the absolute values that it lacks in print: the q - n longest generators
    /// (Euclidean norm) stay, the others are boxed by their row sums.
    Paper,
    /// Girard 2005: the generators with the smallest ‖g‖₁ - ‖g‖∞ (nearly axis-parallel) are boxed.
    #[default]
    Girard,
    /// Combastel 2003: the shortest generators (Euclidean norm) are boxed. The same set as [`Paper`](Self::Paper).
    Combastel,
    /// As Girard, but boxed along the principal axes of the generators that go (Kopetzki, Schürmann, Althoff 2017).
    Pca,
}

/// A zonotope in n dimensions. Generators are stored one after another (column-major, n numbers each).
#[derive(Debug, Clone, PartialEq)]
pub struct Zonotope {
    center: Vec<f64>,
    generators: Vec<f64>,
}

/// Σ|v| of k numbers is at most this times its floating-point value.
pub(crate) fn inflation(k: usize) -> f64 {
    1.0 + (k as f64 + 4.0) * f64::EPSILON
}

/// Row sums of |M|, rounded upward: M (n × m) by columns.
pub(crate) fn row_sums(n: usize, columns: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; n];
    for g in columns.chunks_exact(n) {
        sums.iter_mut().zip(g).for_each(|(s, v)| *s += v.abs());
    }
    let factor = inflation(columns.len() / n);
    sums.iter_mut().for_each(|s| *s *= factor);
    sums
}

impl Zonotope {
    /// Center (n) and generators, n numbers each, one after another (none is a point).
    ///
    /// # Errors
    /// Shape or value: no dimension, lengths that do not fit, numbers that are not finite.
    pub fn new(center: Vec<f64>, generators: Vec<f64>) -> Result<Self, Error> {
        let n = center.len();
        if n == 0 {
            return Err(Error::shape("center", "at least one number", "none"));
        }
        if !generators.len().is_multiple_of(n) {
            let found = format!("{} numbers", generators.len());
            return Err(Error::shape("generators", format!("a multiple of {n} numbers"), found));
        }
        check_finite("center", &center, n)?;
        check_finite("generators", &generators, n)?;
        Ok(Zonotope { center, generators })
    }

    /// As [`new`](Self::new), of what is known to fit.
    pub(crate) fn from_parts(center: Vec<f64>, generators: Vec<f64>) -> Self {
        Zonotope { center, generators }
    }

    /// Dimension n.
    pub fn n(&self) -> usize {
        self.center.len()
    }

    /// Number of generators.
    pub fn count(&self) -> usize {
        self.generators.len() / self.n()
    }

    /// Generators per dimension.
    pub fn order(&self) -> f64 {
        self.count() as f64 / self.n() as f64
    }

    /// p (n).
    pub fn center(&self) -> &[f64] {
        &self.center
    }

    /// The columns of M, one after another.
    pub fn generators(&self) -> &[f64] {
        &self.generators
    }

    /// A ⊙ ⟨p, M⟩ = ⟨A p, A M⟩ (2), A row-major with n columns.
    ///
    /// # Errors
    /// Shape or value of A.
    pub fn linear_map(&self, A: &[f64]) -> Result<Self, Error> {
        let n = self.n();
        if A.is_empty() || !A.len().is_multiple_of(n) {
            return Err(Error::shape("A", format!("rows of {n} numbers"), format!("{} numbers", A.len())));
        }
        check_finite("A", A, n)?;
        let center = map(A, &self.center);
        let generators = self.generators.chunks_exact(n).flat_map(|g| map(A, g)).collect();
        Zonotope::new(center, generators)
    }

    /// ⟨p + v, M⟩.
    ///
    /// # Errors
    /// Shape or value of v.
    pub fn translate(&self, v: &[f64]) -> Result<Self, Error> {
        self.minkowski_sum(&Zonotope::new(v.to_vec(), Vec::new())?)
    }

    /// ⟨p₁, M₁⟩ ⊕ ⟨p₂, M₂⟩ = ⟨p₁ + p₂, \[M₁, M₂\]⟩ (5).
    ///
    /// # Errors
    /// The dimensions differ.
    pub fn minkowski_sum(&self, other: &Self) -> Result<Self, Error> {
        if self.n() != other.n() {
            return Err(Error::shape("other", format!("dimension {}", self.n()), other.n()));
        }
        let center = self.center.iter().zip(&other.center).map(|(a, b)| a + b).collect();
        Zonotope::new(center, [&self.generators[..], &other.generators].concat())
    }

    /// \[M\] Bᵐ ⊕ p ⊂ ⟨mid A p + …, \[D^c, D^s\]⟩, Lemma 2: an interval matrix (row-major, n columns) times this zonotope.
    ///
    /// # Errors
    /// Shape of A.
    pub fn interval_map(&self, A: &[Interval]) -> Result<Self, Error> {
        let n = self.n();
        let mid: Vec<f64> = A.iter().map(|a| a.mid()).collect();
        let rad: Vec<f64> = A.iter().map(|a| a.rad()).collect();
        let mut image = self.linear_map(&mid)?;
        let magnitude: Vec<f64> =
            row_sums(n, &self.generators).iter().zip(&self.center).map(|(r, c)| (r + c.abs()) * inflation(1)).collect();
        let D_s = map(&rad, &magnitude);
        image.generators.extend(diagonal(&D_s.iter().map(|r| r * inflation(n)).collect::<Vec<_>>()));
        Ok(image)
    }

    /// Half widths of the interval hull: row sums of |M| (6), rounded upward.
    pub fn half_widths(&self) -> Vec<f64> {
        row_sums(self.n(), &self.generators)
    }

    /// The smallest box around it (6), rounded outward: one interval a dimension.
    pub fn interval_hull(&self) -> Vec<Interval> {
        self.center.iter().zip(self.half_widths()).map(|(&c, r)| Interval::about(c, r)).collect()
    }

    /// max dᵀx over the set: dᵀp + Σ|dᵀg|.
    ///
    /// # Errors
    /// Shape or value of d.
    pub fn support(&self, d: &[f64]) -> Result<f64, Error> {
        crate::config::check_vector("d", d, self.n())?;
        Ok(map(d, &self.center)[0] + self.generators.chunks_exact(self.n()).map(|g| map(d, g)[0].abs()).sum::<f64>())
    }

    /// Is x in the set? Two cheap tests first (outside of the hull; least-norm ξ inside the unit box), then the linear
    /// programme min ‖ξ‖∞ subject to M ξ = x - p. Points within 1e-9 of the boundary, relative to the set, count as in.
    ///
    /// # Errors
    /// Shape or value of x.
    pub fn contains(&self, x: &[f64]) -> Result<bool, Error> {
        let n = self.n();
        crate::config::check_vector("x", x, n)?;
        let d: Vec<f64> = x.iter().zip(&self.center).map(|(x, c)| x - c).collect();
        let half = self.half_widths();
        let room = 1.0 + tol::MEMBER;
        if d.iter().zip(&half).zip(x).any(|((d, h), x)| d.abs() > h * room + 2.0 * f64::EPSILON * x.abs()) {
            return Ok(false);
        }
        // Flat directions and units of different size: work in units of the half widths.
        let kept: Vec<usize> = (0..n).filter(|&i| half[i] > 0.0).collect();
        if kept.is_empty() {
            return Ok(true);
        }
        let d: Vec<f64> = kept.iter().map(|&i| d[i] / half[i]).collect();
        let columns: Vec<f64> =
            self.generators.chunks_exact(n).flat_map(|g| kept.iter().map(|&i| g[i] / half[i])).collect();
        let rest = |xi: &[f64]| -> Vec<f64> {
            let image = |i: usize| (0..xi.len()).map(|j| columns[j * d.len() + i] * xi[j]).sum::<f64>();
            (0..d.len()).map(|i| d[i] - image(i)).collect()
        };
        // ξ moved onto M ξ = d: does it prove that x is in?
        let proves = |xi: &[f64]| {
            least_norm(&columns, &rest(xi)).is_some_and(|step| {
                let xi: Vec<f64> = xi.iter().zip(step).map(|(a, b)| a + b).collect();
                xi.iter().all(|v| v.abs() <= room) && rest(&xi).iter().all(|r| r.abs() <= tol::MEMBER)
            })
        };
        if proves(&vec![0.0; columns.len() / d.len()]) {
            return Ok(true);
        }
        let Some((xi, y)) = qp::least_max_norm(&columns, &d) else { return Ok(false) };
        if proves(&xi) {
            return Ok(true);
        }
        // a plane with normal y between the point and the set, however good y is
        let reach: f64 = columns.chunks_exact(d.len()).map(|g| map(&y, g)[0].abs()).sum();
        Ok(map(&y, &d)[0] <= reach * room)
    }

    /// Largest half width of the hull.
    pub fn radius(&self) -> f64 {
        self.half_widths().into_iter().fold(0.0, f64::max)
    }

    /// 2ⁿ Σ |det| over all choices of n generators: the exact volume (length, area), up to rounding.
    ///
    /// # Errors
    /// n above 3.
    pub fn volume(&self) -> Result<f64, Error> {
        let g: Vec<&[f64]> = self.generators.chunks_exact(self.n()).collect();
        let m = g.len();
        match self.n() {
            1 => Ok(2.0 * g.iter().map(|g| g[0].abs()).sum::<f64>()),
            2 => {
                let det = |a: &[f64], b: &[f64]| (a[0] * b[1] - a[1] * b[0]).abs();
                Ok(4.0 * (0..m).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| det(g[i], g[j])).sum::<f64>())
            }
            3 => {
                let mut sum = 0.0;
                for i in 0..m {
                    for j in 0..i {
                        let (a, b) = (g[i], g[j]);
                        let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
                        sum += (0..j).map(|k| map(&cross, g[k])[0].abs()).sum::<f64>();
                    }
                }
                Ok(8.0 * sum)
            }
            n => Err(Error::value("volume", "at most 3 dimensions", n)),
        }
    }

    /// A zonotope of at most q ≥ n generators that holds this one.
    ///
    /// # Errors
    /// q below n.
    pub fn reduce(&self, q: usize, method: Reduction) -> Result<Self, Error> {
        if q < self.n() {
            return Err(Error::value("q", format!("at least the dimension, {}", self.n()), q));
        }
        let mut generators = self.generators.clone();
        reduce(self.n(), &mut generators, q, method);
        Ok(Zonotope::from_parts(self.center.clone(), generators))
    }
}

/// ↓q in place: columns that are all zero go, then the q - n that `method` ranks first stay and a box holds the others.
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
    let gram = Mat::from_fn(n, n, |i, j| columns.chunks_exact(n).map(|g| g[i] * g[j]).sum::<f64>());
    let Ok(found) = gram.self_adjoint_eigen(Side::Lower) else { return boxed() };
    let V = found.U();
    // M = V Vᵀ M + (I - V Vᵀ) M: with |I - V Vᵀ| at most `skew` in every entry, s grows by what the rest can add.
    let mut skew = 0.0_f64;
    for i in 0..n {
        for j in 0..n {
            let product: f64 = (0..n).map(|k| V[(i, k)] * V[(j, k)]).sum();
            skew = skew.max((product - f64::from(u8::from(i == j))).abs());
        }
    }
    skew += 2.0 * n as f64 * f64::EPSILON;
    if !(skew < 1e-12) {
        return boxed();
    }
    let total: f64 = columns.iter().map(|v| v.abs()).sum::<f64>() * inflation(columns.len());
    // The rest is a vector of entries at most skew·total; Vᵀ and V⁻¹ agree to 1e-12 there, hence the factor 2.
    let extra = 2.0 * n as f64 * (skew + (n as f64 + 2.0) * f64::EPSILON) * total;
    let mut turned = vec![0.0; n * n];
    for i in 0..n {
        let axis: Vec<f64> = (0..n).map(|k| V[(k, i)]).collect();
        let sum: f64 = columns.chunks_exact(n).map(|g| map(&axis, g)[0].abs()).sum();
        let s = sum * inflation(columns.len()) + extra;
        (0..n).for_each(|k| turned[i * n + k] = axis[k] * s);
    }
    turned
}

/// Bounds of dᵀe over all e of ⟨0, M⟩ with aᵀe in `strip`; None if there is no such e.
///
/// One two-sided constraint leaves a linear programme whose dual has one variable: for every ν
/// dᵀe ≤ Σ|dᵀg - ν aᵀg| + max(ν strip), so whatever ν is found the bound holds; the best one is at a kink dᵀg/aᵀg or at 0.
/// `sums` are the [`row_sums`] of the columns.
pub(crate) fn strip_range(columns: &[f64], sums: &[f64], d: &[f64], a: &[f64], strip: Interval) -> Option<Interval> {
    let n = d.len();
    let inner = |x: &[f64], g: &[f64]| x.iter().zip(g).map(|(x, g)| x * g).sum::<f64>();
    let images: Vec<(f64, f64)> = columns.chunks_exact(n).map(|g| (inner(d, g), inner(a, g))).collect();
    // what rounding may have taken from the images, summed over the generators
    let lost = |x: &[f64]| (n as f64 + 2.0) * f64::EPSILON * x.iter().zip(sums).map(|(x, s)| x.abs() * s).sum::<f64>();
    let (lost_d, lost_a) = (lost(d), lost(a));
    let upper = |sign: f64| -> f64 {
        let bound = |nu: f64| {
            let sum: f64 = images.iter().map(|(d, a)| (sign * d - nu * a).abs()).sum();
            let size: f64 = images.iter().map(|(d, a)| d.abs() + (nu * a).abs()).sum();
            let strip = if nu == 0.0 { 0.0 } else { (Interval::point(nu) * strip).hi };
            let rounding = lost_d + nu.abs() * lost_a + 4.0 * f64::EPSILON * size;
            (sum + rounding + strip.max(0.0)) * inflation(images.len()) + strip.min(0.0)
        };
        if !(strip.lo.is_finite() && strip.hi.is_finite()) {
            return bound(0.0);
        }
        let mut kinks: Vec<(f64, f64)> = images
            .iter()
            .filter(|(_, a)| *a != 0.0)
            .map(|(d, a)| (sign * d / a, 2.0 * a.abs()))
            .filter(|(at, _)| at.is_finite())
            .collect();
        kinks.push((0.0, strip.hi - strip.lo));
        kinks.sort_unstable_by(|x, y| x.0.total_cmp(&y.0));
        let mut slope = strip.lo - kinks.iter().map(|k| k.1).sum::<f64>() / 2.0 + (strip.hi - strip.lo) / 2.0;
        let mut nu = 0.0;
        for (at, change) in kinks {
            slope += change;
            if slope >= 0.0 {
                nu = at;
                break;
            }
        }
        let found = bound(nu).min(bound(0.0));
        found + 4.0 * f64::EPSILON * found.abs()
    };
    let (lo, hi) = (-upper(-1.0), upper(1.0));
    // generators that have left all floats say nothing
    if lo.is_finite() && hi.is_finite() { Interval::new(lo, hi) } else { Some(Interval::ENTIRE) }
}

/// Generators of the box with half widths r.
pub(crate) fn diagonal(r: &[f64]) -> Vec<f64> {
    let n = r.len();
    let mut columns = vec![0.0; n * n];
    (0..n).for_each(|i| columns[i * n + i] = r[i]);
    columns
}

/// A x, A row-major with x.len() columns.
pub(crate) fn map(A: &[f64], x: &[f64]) -> Vec<f64> {
    A.chunks_exact(x.len()).map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum()).collect()
}

/// ξ = M† d.
fn least_norm(columns: &[f64], d: &[f64]) -> Option<Vec<f64>> {
    let (n, m) = (d.len(), columns.len() / d.len());
    let M = Mat::from_fn(n, m, |i, j| columns[j * n + i]);
    let svd = M.thin_svd().ok()?;
    let sigma = svd.S().column_vector();
    let rank = (0..sigma.nrows()).take_while(|&k| sigma[k] > 1e-12 * sigma[0]).count();
    let weight: Vec<f64> = (0..rank).map(|k| (0..n).map(|i| svd.U()[(i, k)] * d[i]).sum::<f64>() / sigma[k]).collect();
    Some((0..m).map(|j| (0..rank).map(|k| svd.V()[(j, k)] * weight[k]).sum()).collect())
}
