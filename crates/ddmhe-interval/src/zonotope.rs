//! Zonotopes ⟨p, M⟩ = {p + M ξ : ‖ξ‖∞ ≤ 1}: the sets that the interval observer carries.
//!
//! Equation numbers are those of the interval paper ("Interval Estimation for Bounded Jacobian
//! Nonlinear Systems by Zonotope Analysis"). Maps, sums, reductions, hulls and supports enclose:
//! the exact set lies in what they return. Where no operation rounds they are exact, otherwise
//! larger by what was rounded away. Membership is to 1e-9 of the set's size and never refuses a
//! point of the set; the volume is rounded like any other number.

use crate::check::{check_finite, check_vector};
use crate::error::Error;
use crate::interval::Interval;
#[cfg(feature = "clarabel")]
use crate::membership::holds;
use crate::reduce::{Reduction, reduce};
use crate::rounding::{add_up, diagonal, dot, map, row_sums, sum, widen};

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
    ///
    /// # Example
    /// ```
    /// # use ddmhe_interval::*;
    /// let z = Zonotope::new(vec![0.0, 0.0], vec![1.0, 0.0, 0.5, 1.0])?; // two generators
    /// assert_eq!((z.n(), z.count()), (2, 2));
    /// # Ok::<(), Error>(())
    /// ```
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
    ///
    /// # Example
    /// ```
    /// # use ddmhe_interval::*;
    /// let square = Zonotope::new(vec![1.0, 0.0], vec![1.0, 0.0, 0.0, 1.0])?;
    /// let turned = square.linear_map(&[0.0, -1.0, 1.0, 0.0])?; // A row by row
    /// assert_eq!(turned.center(), [0.0, 1.0]);
    /// # Ok::<(), Error>(())
    /// ```
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
    ///
    /// # Example
    /// ```
    /// # use ddmhe_interval::*;
    /// let z = Zonotope::new(vec![1.0], vec![0.5])?;
    /// let hull = z.minkowski_sum(&z)?.interval_hull()[0];
    /// assert!(hull.lo <= 1.0 && 3.0 <= hull.hi && hull.hi < 3.0 + 1e-12);
    /// # Ok::<(), Error>(())
    /// ```
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
    /// boundary, relative to the set, count as in. With the feature `clarabel` only.
    ///
    /// # Errors
    /// Shape or value of x.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_interval::*;
    /// let z = Zonotope::new(vec![0.0, 0.0], vec![1.0, 0.0, 0.5, 1.0])?;
    /// assert!(z.contains(&[1.5, 1.0])?);
    /// assert!(!z.contains(&[1.5, -1.0])?);
    /// # Ok::<(), Error>(())
    /// ```
    #[cfg(feature = "clarabel")]
    pub fn contains(&self, x: &[f64]) -> Result<bool, Error> {
        check_vector("x", x, self.n())?;
        // every row in a unit, a power of two, in which its numbers are below one: sums cannot
        // leave the floats
        let units = self.units(x);
        let (x, center) = (in_units(x, &units), in_units(&self.center, &units));
        Ok(holds(&center, &in_units(&self.generators, &units), &x))
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
        let volume =
            libm::scalbn(small_volume(n, &in_units(&self.generators, &units)), units.iter().sum());
        finite("volume", &[volume])?;
        Ok(volume)
    }

    /// A zonotope of at most q ≥ n generators that holds this one.
    ///
    /// # Errors
    /// q below n; generators whose sums leave the range of floats.
    ///
    /// # Example
    /// ```
    /// # use ddmhe_interval::*;
    /// let z = Zonotope::new(vec![0.0], vec![1.0, 0.5, 0.25])?;
    /// let fewer = z.reduce(1, Reduction::Girard)?;
    /// assert!(fewer.count() == 1 && fewer.contains(&[1.75])?);
    /// # Ok::<(), Error>(())
    /// ```
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

/// Rows (n each) in units of 2^`units`.
fn in_units(rows: &[f64], units: &[i32]) -> Vec<f64> {
    rows.iter().zip(units.iter().cycle()).map(|(v, u)| libm::scalbn(*v, -u)).collect()
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
