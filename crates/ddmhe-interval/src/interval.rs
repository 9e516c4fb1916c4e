//! Interval arithmetic that rounds outward: the exact result of every operation lies in the
//! interval that it returns.
//!
//! The basic operations of IEEE 754 are exact to half a unit in the last place, so one step of
//! `next_down`/`next_up` encloses them. sin, cos and exp come from the crate `libm`, the same on
//! every platform, whose error is below one unit; two steps enclose them. (The crate inari has
//! directed rounding but builds its elementary functions only with MPFR and needs AVX at compile
//! time, so it does not serve ordinary targets.)

use crate::tol;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A closed interval \[lo, hi\], lo ≤ hi; an end may be infinite, never NaN. Never empty: what can
/// be is an `Option`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct Interval {
    /// Lower end.
    pub lo: f64,
    /// Upper end.
    pub hi: f64,
}

fn down(value: f64) -> f64 {
    if value.is_nan() { f64::NEG_INFINITY } else { value.next_down() }
}

fn up(value: f64) -> f64 {
    if value.is_nan() { f64::INFINITY } else { value.next_up() }
}

/// x·y with 0·∞ = 0, the convention for ends of intervals.
fn times(x: f64, y: f64) -> f64 {
    if x == 0.0 || y == 0.0 { 0.0 } else { x * y }
}

impl Interval {
    /// All real numbers.
    pub const ENTIRE: Interval = Interval { lo: f64::NEG_INFINITY, hi: f64::INFINITY };
    /// Zero.
    pub const ZERO: Interval = Interval { lo: 0.0, hi: 0.0 };

    /// \[lo, hi\]; None unless lo ≤ hi (so none for NaN).
    pub fn new(lo: f64, hi: f64) -> Option<Self> {
        (lo <= hi && lo < f64::INFINITY && hi > f64::NEG_INFINITY).then_some(Interval { lo, hi })
    }

    /// The single number x; all numbers if x is not finite.
    pub const fn point(x: f64) -> Self {
        if x.is_finite() { Interval { lo: x, hi: x } } else { Interval::ENTIRE }
    }

    /// x ± |radius|, rounded outward; all numbers if the radius is not finite.
    pub fn about(x: f64, radius: f64) -> Self {
        if !radius.is_finite() {
            return Interval::ENTIRE;
        }
        Interval::point(x) + Interval { lo: -radius.abs(), hi: radius.abs() }
    }

    /// A float near the middle.
    pub fn mid(self) -> f64 {
        match (self.lo.is_finite(), self.hi.is_finite()) {
            (true, true) => 0.5 * self.lo + 0.5 * self.hi,
            (true, false) => f64::MAX,
            (false, true) => f64::MIN,
            (false, false) => 0.0,
        }
    }

    /// Upper bound of the distance from [`mid`](Self::mid) to either end.
    pub fn rad(self) -> f64 {
        if self.lo == self.hi {
            return if self.mid() == self.lo { 0.0 } else { up((self.mid() - self.lo).abs()) };
        }
        up((self.hi - self.mid()).max(self.mid() - self.lo))
    }

    /// Upper bound of hi - lo.
    pub fn width(self) -> f64 {
        up(self.hi - self.lo)
    }

    /// Largest absolute value.
    pub fn mag(self) -> f64 {
        self.hi.max(-self.lo)
    }

    /// Does it hold x?
    pub fn contains(self, x: f64) -> bool {
        self.lo <= x && x <= self.hi
    }

    /// What both hold; None if nothing.
    pub fn intersect(self, other: Self) -> Option<Self> {
        Interval::new(self.lo.max(other.lo), self.hi.min(other.hi))
    }

    /// Smallest interval that holds both.
    pub fn hull(self, other: Self) -> Self {
        Interval { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi) }
    }

    /// {x² : x in self}.
    pub fn sqr(self) -> Self {
        let (a, b) = (self.lo.abs().min(self.hi.abs()), self.mag());
        let lo = if self.contains(0.0) { 0.0 } else { down(a * a).max(0.0) };
        Interval { lo, hi: if b == 0.0 { 0.0 } else { up(b * b) } }
    }

    /// {√x : x in self, x ≥ 0}; None if there is no such x.
    pub fn sqrt(self) -> Option<Self> {
        let root = |x: f64| if x > 0.0 { x.sqrt() } else { 0.0 };
        (self.hi >= 0.0).then(|| Interval {
            lo: down(root(self.lo)).max(0.0),
            hi: if self.hi == 0.0 { 0.0 } else { up(root(self.hi)) },
        })
    }

    /// {eˣ : x in self}.
    pub fn exp(self) -> Self {
        Interval { lo: down(down(libm::exp(self.lo))).max(0.0), hi: up(up(libm::exp(self.hi))) }
    }

    /// {sin x : x in self}, with the extrema inside.
    pub fn sin(self) -> Self {
        // sin has its extrema where x/π - 1/2 is whole.
        self.wave(libm::sin, Interval::point(0.5))
    }

    /// {cos x : x in self}, with the extrema inside.
    pub fn cos(self) -> Self {
        self.wave(libm::cos, Interval::ZERO)
    }

    /// A function that is 1 where x/π - shift is an even whole number, -1 where it is odd, and
    /// monotone between.
    fn wave(self, f: fn(f64) -> f64, shift: Interval) -> Self {
        const WHOLE: Interval = Interval { lo: -1.0, hi: 1.0 };
        if self.mag() > tol::PHASE || self.width() > tol::PERIOD {
            return WHOLE;
        }
        let pi = Interval { lo: PI, hi: PI.next_up() }; // the float PI is below π
        let phase = self / pi - shift;
        let holds = |parity: f64| 2.0 * ((phase.lo - parity) / 2.0).ceil() + parity <= phase.hi;
        let (a, b) = (f(self.lo), f(self.hi));
        let lo = if holds(1.0) { -1.0 } else { down(down(a.min(b))) };
        let hi = if holds(0.0) { 1.0 } else { up(up(a.max(b))) };
        Interval { lo: lo.max(-1.0), hi: hi.min(1.0) }
    }
}

impl Add for Interval {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        match (self == Interval::ZERO, other == Interval::ZERO) {
            (true, _) => other,
            (_, true) => self,
            _ => Interval { lo: down(self.lo + other.lo), hi: up(self.hi + other.hi) },
        }
    }
}

impl Neg for Interval {
    type Output = Self;
    fn neg(self) -> Self {
        Interval { lo: -self.hi, hi: -self.lo }
    }
}

impl Sub for Interval {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Interval {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        if self == Interval::ZERO || other == Interval::ZERO {
            return Interval::ZERO;
        }
        let (a, b) = (times(self.lo, other.lo), times(self.lo, other.hi));
        let (c, d) = (times(self.hi, other.lo), times(self.hi, other.hi));
        Interval { lo: down(a.min(b).min(c.min(d))), hi: up(a.max(b).max(c.max(d))) }
    }
}

impl Mul<Interval> for f64 {
    type Output = Interval;
    fn mul(self, other: Interval) -> Interval {
        Interval::point(self) * other
    }
}

impl Div for Interval {
    type Output = Self;
    /// {x / y : x in self, y in other, y ≠ 0}; all numbers if other holds nothing but zero.
    fn div(self, other: Self) -> Self {
        let reach = |y: f64, x: f64| if y.is_infinite() { 0.0 } else { x / y };
        if other.lo > 0.0 || other.hi < 0.0 {
            let ends = [
                reach(other.lo, self.lo),
                reach(other.lo, self.hi),
                reach(other.hi, self.lo),
                reach(other.hi, self.hi),
            ];
            if self == Interval::ZERO {
                return Interval::ZERO;
            }
            let lo = ends.iter().copied().fold(f64::INFINITY, f64::min);
            let hi = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            // An end that is infinite divided by a finite one stays infinite; 0 stands for "towards
            // infinity".
            return Interval { lo: down(lo), hi: up(hi) };
        }
        match (other.lo == 0.0, other.hi == 0.0) {
            _ if self.contains(0.0) => Interval::ENTIRE,
            (true, true) | (false, false) => Interval::ENTIRE,
            (true, false) if self.lo > 0.0 => {
                Interval { lo: down(reach(other.hi, self.lo)), hi: f64::INFINITY }
            }
            (true, false) => Interval { lo: f64::NEG_INFINITY, hi: up(reach(other.hi, self.hi)) },
            (false, true) if self.lo > 0.0 => {
                Interval { lo: f64::NEG_INFINITY, hi: up(reach(other.lo, self.lo)) }
            }
            (false, true) => Interval { lo: down(reach(other.lo, self.hi)), hi: f64::INFINITY },
        }
    }
}

/// Σ_j a_j x_j, a row of a matrix times a vector.
pub fn dot(a: &[Interval], x: &[Interval]) -> Interval {
    a.iter().zip(x).fold(Interval::ZERO, |sum, (&a, &x)| sum + a * x)
}

/// Σ_j a_j x_j with numbers a_j.
pub fn weighted(a: &[f64], x: &[Interval]) -> Interval {
    a.iter().zip(x).fold(Interval::ZERO, |sum, (&a, &x)| sum + a * x)
}

/// Matrix (row-major, columns = x.len()) times vector.
pub fn mat_vec(matrix: &[Interval], x: &[Interval]) -> Vec<Interval> {
    matrix.chunks_exact(x.len()).map(|row| dot(row, x)).collect()
}

/// The intervals that hold single numbers.
pub fn points(values: &[f64]) -> Vec<Interval> {
    values.iter().map(|&v| Interval::point(v)).collect()
}
