//! Zonotopes ⟨p, M⟩ = {p + M ξ : ‖ξ‖∞ ≤ 1}: the sets that the interval observer carries.
//!
//! Equation numbers are those of the interval paper ("Interval Estimation for Bounded Jacobian
//! Nonlinear Systems by Zonotope Analysis"). Maps, sums, reductions, hulls and supports enclose:
//! the exact set lies in what they return. Where no operation rounds they are exact, otherwise
//! larger by what was rounded away. Membership is to 1e-9 of the set's size and never refuses a
//! point of the set; the volume is rounded like any other number.

use crate::check::check_vector;
use crate::error::Error;
use crate::history::check_finite;
use crate::interval::Interval;
use crate::rounding::{add_up, diagonal, dot, inflation, row_sums, sum, widen};
use crate::{qp, tol};
use faer::Mat;

mod reduce;

pub use reduce::Reduction;
pub(crate) use reduce::reduce;

/// A zonotope in n dimensions. Generators are stored one after another (column-major, n numbers
/// each).
#[derive(Debug, Clone, PartialEq)]
pub struct Zonotope {
    center: Vec<f64>,
    generators: Vec<f64>,
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

    /// Holds A ⊙ ⟨p, M⟩ = ⟨A p, A M⟩ (2), A row-major with n columns, and is that set where nothing
    /// rounds.
    ///
    /// Otherwise the generators are longer by what was lost, less than 1e-9 of each; where they do
    /// not span all directions well, up to one axis-parallel generator a row is added.
    ///
    /// # Errors
    /// Shape or value of A; an image beyond the range of floats.
    pub fn linear_map(&self, A: &[f64]) -> Result<Self, Error> {
        self.image(A, &[])
    }

    /// ⟨A p, A M⟩ with the columns of `box_`, and with what was rounded.
    fn image(&self, A: &[f64], box_: &[f64]) -> Result<Self, Error> {
        let n = self.n();
        if A.is_empty() || !A.len().is_multiple_of(n) {
            return Err(Error::shape(
                "A",
                format!("rows of {n} numbers"),
                format!("{} numbers", A.len()),
            ));
        }
        check_finite("A", A, n)?;
        let mut lost = vec![0.0; A.len() / n];
        let mut image = Vec::with_capacity((self.count() + 1) * lost.len());
        for x in std::iter::once(&self.center[..]).chain(self.generators.chunks_exact(n)) {
            for (row, lost) in A.chunks_exact(n).zip(&mut lost) {
                let (value, error) = dot(row, x);
                image.push(value);
                *lost = add_up(*lost, error);
            }
        }
        let mut generators = image.split_off(lost.len());
        generators.extend(box_);
        Zonotope::widened("A", image, generators, &lost)
    }

    /// ⟨center, generators⟩ ⊕ the box of half widths `lost`; `argument` is to blame if floats do
    /// not hold it.
    fn widened(
        argument: &'static str,
        center: Vec<f64>,
        mut generators: Vec<f64>,
        lost: &[f64],
    ) -> Result<Self, Error> {
        if lost.iter().any(|l| *l != 0.0) {
            widen(center.len(), &mut generators, lost);
        }
        finite(argument, &center)?;
        finite(argument, &generators)?;
        Ok(Zonotope { center, generators })
    }

    /// Holds ⟨p + v, M⟩.
    ///
    /// # Errors
    /// Shape or value of v; a sum beyond the range of floats.
    pub fn translate(&self, v: &[f64]) -> Result<Self, Error> {
        check_vector("v", v, self.n())?;
        self.plus("v", v, &[])
    }

    /// Holds ⟨p₁, M₁⟩ ⊕ ⟨p₂, M₂⟩ = ⟨p₁ + p₂, \[M₁, M₂\]⟩ (5); what the centers' sum rounds widens
    /// as in
    /// [`linear_map`](Self::linear_map).
    ///
    /// # Errors
    /// The dimensions differ; a sum beyond the range of floats.
    pub fn minkowski_sum(&self, other: &Self) -> Result<Self, Error> {
        if self.n() != other.n() {
            return Err(Error::shape("other", format!("dimension {}", self.n()), other.n()));
        }
        self.plus("other", &other.center, &other.generators)
    }

    fn plus(
        &self,
        argument: &'static str,
        center: &[f64],
        generators: &[f64],
    ) -> Result<Self, Error> {
        let (center, lost): (Vec<f64>, Vec<f64>) =
            self.center.iter().zip(center).map(|(&a, &b)| sum(a, b)).unzip();
        Zonotope::widened(argument, center, [&self.generators[..], generators].concat(), &lost)
    }

    /// \[M\] Bᵐ ⊕ p ⊂ ⟨mid A p + …, \[D^c, D^s\]⟩, Lemma 2: an interval matrix (row-major, n
    /// columns) times this zonotope.
    ///
    /// # Errors
    /// Shape or value of A; an image beyond the range of floats.
    pub fn interval_map(&self, A: &[Interval]) -> Result<Self, Error> {
        let n = self.n();
        if let Some(a) = A.iter().find(|a| !(a.lo.is_finite() && a.hi.is_finite())) {
            return Err(Error::value("A", "finite bounds", format!("[{}, {}]", a.lo, a.hi)));
        }
        let mid: Vec<f64> = A.iter().map(|a| a.mid()).collect();
        let magnitude: Vec<f64> =
            self.half_widths().iter().zip(&self.center).map(|(r, c)| add_up(*r, c.abs())).collect();
        let reach = |row: &[Interval]| {
            let sum = row.iter().zip(&magnitude).map(|(a, &m)| match a.rad() {
                0.0 => 0.0,
                rad => (Interval::point(rad) * Interval::point(m)).hi,
            });
            sum.fold(0.0, add_up)
        };
        let D_s: Vec<f64> = A.chunks_exact(n).map(reach).collect();
        self.image(&mid, &diagonal(&D_s))
    }

    /// Half widths of the interval hull: row sums of |M| (6), rounded upward.
    pub fn half_widths(&self) -> Vec<f64> {
        row_sums(self.n(), &self.generators)
    }

    /// The smallest box around it (6), rounded outward: one interval a dimension.
    pub fn interval_hull(&self) -> Vec<Interval> {
        self.center.iter().zip(self.half_widths()).map(|(&c, r)| Interval::about(c, r)).collect()
    }

    /// max dᵀx over the set, dᵀp + Σ|dᵀg|, rounded upward; infinite if floats do not reach.
    ///
    /// # Errors
    /// Shape or value of d.
    pub fn support(&self, d: &[f64]) -> Result<f64, Error> {
        check_vector("d", d, self.n())?;
        let (center, lost) = dot(d, &self.center);
        let reach = self.generators.chunks_exact(self.n()).fold(lost, |reach, g| {
            let (value, lost) = dot(d, g);
            add_up(reach, add_up(value.abs(), lost))
        });
        let support = add_up(center, reach);
        Ok(if support.is_nan() { f64::INFINITY } else { support })
    }

    /// Is x in the set? Two cheap tests first (outside of the hull; least-norm ξ inside the unit
    /// box), then the linear programme min ‖ξ‖∞ subject to M ξ = x - p. Points within 1e-9 of the
    /// boundary, relative to the set, count as in.
    ///
    /// # Errors
    /// Shape or value of x.
    pub fn contains(&self, x: &[f64]) -> Result<bool, Error> {
        let n = self.n();
        check_vector("x", x, n)?;
        // every row in a unit, a power of two, in which its numbers are below one: sums cannot
        // leave the floats
        let units = self.units(x);
        let scaled = |v: &[f64]| -> Vec<f64> {
            v.iter().zip(units.iter().cycle()).map(|(v, u)| libm::scalbn(*v, -u)).collect()
        };
        let (x, generators) = (&scaled(x)[..], &scaled(&self.generators)[..]);
        let d: Vec<f64> = x.iter().zip(scaled(&self.center)).map(|(x, c)| x - c).collect();
        let half = row_sums(n, generators);
        let room = 1.0 + tol::MEMBER;
        if d.iter()
            .zip(&half)
            .zip(x)
            .any(|((d, h), x)| d.abs() > h * room + 2.0 * f64::EPSILON * x.abs())
        {
            return Ok(false);
        }
        // Flat directions and units of different size: work in units of the half widths.
        let kept: Vec<usize> = (0..n).filter(|&i| half[i] > 0.0).collect();
        if kept.is_empty() {
            return Ok(true);
        }
        let d: Vec<f64> = kept.iter().map(|&i| d[i] / half[i]).collect();
        let columns: Vec<f64> =
            generators.chunks_exact(n).flat_map(|g| kept.iter().map(|&i| g[i] / half[i])).collect();
        let rest = |xi: &[f64]| -> Vec<f64> {
            let image =
                |i: usize| (0..xi.len()).map(|j| columns[j * d.len() + i] * xi[j]).sum::<f64>();
            (0..d.len()).map(|i| d[i] - image(i)).collect()
        };
        // ξ moved onto M ξ = d: does it prove that x is in?
        let proves = |xi: &[f64]| {
            least_norm(&columns, &rest(xi)).is_some_and(|step| {
                let xi: Vec<f64> = xi.iter().zip(step).map(|(a, b)| a + b).collect();
                xi.iter().all(|v| v.abs() <= room)
                    && rest(&xi).iter().all(|r| r.abs() <= tol::MEMBER)
            })
        };
        if proves(&vec![0.0; columns.len() / d.len()]) {
            return Ok(true);
        }
        let Some((xi, y)) = qp::least_max_norm(&columns, &d) else { return Ok(true) };
        if proves(&xi) {
            return Ok(true);
        }
        // only a plane between the point and the set refuses it, its normal y however good; in
        // units of the half widths the products and the divisions round by this much
        let reach: f64 = columns.chunks_exact(d.len()).map(|g| map(&y, g)[0].abs()).sum();
        let size: f64 = y.iter().zip(&d).map(|(y, d)| y.abs() * (1.0 + d.abs())).sum();
        let apart = map(&y, &d)[0] > reach * room + (n as f64 + 6.0) * f64::EPSILON * size;
        Ok(!apart)
    }

    /// Exponents of two of each row's largest number, those of x (n) among them.
    fn units(&self, x: &[f64]) -> Vec<i32> {
        let mut largest: Vec<f64> = x.iter().map(|v| v.abs()).collect();
        for column in
            std::iter::once(&self.center[..]).chain(self.generators.chunks_exact(self.n()))
        {
            largest.iter_mut().zip(column).for_each(|(l, v)| *l = l.max(v.abs()));
        }
        largest.iter().map(|l| if *l > 0.0 { libm::ilogb(*l) + 1 } else { 0 }).collect()
    }

    /// Largest half width of the hull, rounded upward.
    pub fn radius(&self) -> f64 {
        self.half_widths().into_iter().fold(0.0, f64::max)
    }

    /// 2ⁿ Σ |det| over all choices of n generators: the exact volume (length, area), up to
    /// rounding.
    ///
    /// # Errors
    /// n above 3; a volume beyond the range of floats.
    pub fn volume(&self) -> Result<f64, Error> {
        let n = self.n();
        if n > 3 {
            return Err(Error::value("volume", "at most 3 dimensions", n));
        }
        let spread = Zonotope { center: vec![0.0; n], generators: self.generators.clone() };
        let units = spread.units(&vec![0.0; n]);
        let scaled: Vec<f64> = self
            .generators
            .iter()
            .zip(units.iter().cycle())
            .map(|(v, u)| libm::scalbn(*v, -u))
            .collect();
        let volume = libm::scalbn(small_volume(n, &scaled), units.iter().sum());
        finite("volume", &[volume])?;
        Ok(volume)
    }

    /// A zonotope of at most q ≥ n generators that holds this one.
    ///
    /// # Errors
    /// q below n; generators whose sums leave the range of floats.
    pub fn reduce(&self, q: usize, method: Reduction) -> Result<Self, Error> {
        if q < self.n() {
            return Err(Error::value("q", format!("at least the dimension, {}", self.n()), q));
        }
        let mut generators = self.generators.clone();
        reduce(self.n(), &mut generators, q, method);
        finite("generators", &generators)?;
        Ok(Zonotope::from_parts(self.center.clone(), generators))
    }
}

/// Value error of `argument` unless every result is a number.
fn finite(argument: &'static str, results: &[f64]) -> Result<(), Error> {
    match results.iter().find(|v| !v.is_finite()) {
        None => Ok(()),
        Some(v) => Err(Error::value(argument, "a result within the range of floats, 1.8e308", v)),
    }
}

/// 2ⁿ Σ |det| for n = 1, 2, 3, of generators that are at most about 1.
fn small_volume(n: usize, generators: &[f64]) -> f64 {
    let g: Vec<&[f64]> = generators.chunks_exact(n).collect();
    let pairs = (0..g.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    match n {
        1 => 2.0 * g.iter().map(|g| g[0].abs()).sum::<f64>(),
        2 => 4.0 * pairs.map(|(i, j)| (g[i][0] * g[j][1] - g[i][1] * g[j][0]).abs()).sum::<f64>(),
        _ => {
            let triples = pairs.map(|(i, j)| {
                let (a, b) = (g[i], g[j]);
                let cross = [
                    a[1] * b[2] - a[2] * b[1],
                    a[2] * b[0] - a[0] * b[2],
                    a[0] * b[1] - a[1] * b[0],
                ];
                (0..j).map(|k| map(&cross, g[k])[0].abs()).sum::<f64>()
            });
            8.0 * triples.sum::<f64>()
        }
    }
}

/// Bounds of dᵀe over all e of ⟨0, M⟩ with aᵀe in `strip`; None if there is no such e.
///
/// One two-sided constraint leaves a linear programme whose dual has one variable: for every ν dᵀe
/// ≤ Σ|dᵀg - ν aᵀg| + max(ν strip), so whatever ν is found the bound holds; the best one is at a
/// kink dᵀg/aᵀg or at 0. `sums` are the [`row_sums`] of the columns.
pub(crate) fn strip_range(
    columns: &[f64],
    sums: &[f64],
    d: &[f64],
    a: &[f64],
    strip: Interval,
) -> Option<Interval> {
    let n = d.len();
    let inner = |x: &[f64], g: &[f64]| x.iter().zip(g).map(|(x, g)| x * g).sum::<f64>();
    let images: Vec<(f64, f64)> =
        columns.chunks_exact(n).map(|g| (inner(d, g), inner(a, g))).collect();
    // what rounding may have taken from the images, summed over the generators; MIN_POSITIVE: below
    // the normal numbers
    let lost = |x: &[f64]| {
        let size: f64 = x.iter().zip(sums).map(|(x, s)| x.abs() * s).sum();
        (n as f64 + 2.0) * f64::EPSILON * size + f64::MIN_POSITIVE
    };
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
        let mut slope =
            strip.lo - kinks.iter().map(|k| k.1).sum::<f64>() / 2.0 + (strip.hi - strip.lo) / 2.0;
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
    let weight: Vec<f64> =
        (0..rank).map(|k| (0..n).map(|i| svd.U()[(i, k)] * d[i]).sum::<f64>() / sigma[k]).collect();
    Some((0..m).map(|j| (0..rank).map(|k| svd.V()[(j, k)] * weight[k]).sum()).collect())
}
