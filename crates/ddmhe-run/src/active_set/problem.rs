//! The least-distance problem, and what the method says of it.

use crate::active_set::rows::Rows;
use crate::active_set::working_set::ActiveBound;
use crate::prices::RowPrices;
use crate::tol;

/// What the method is certain of, with the number of rows that were taken in or dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The minimiser.
    Optimal(u32),
    /// No z satisfies all bounds: a combination of rows proves it.
    Infeasible(u32),
    /// None of these could be shown.
    Uncertain,
}

/// What reconstructs windows.
pub trait Windows {
    /// c + A z (padded) from z.
    fn window(&self, z: &[f64], window: &mut [f64]);

    /// Itself, whatever it is.
    fn erased(&self) -> &dyn Windows;
}

/// What the method trusts.
#[derive(Debug, Clone, Copy)]
pub struct Trust {
    /// See [`tol::DEPENDENT`].
    pub dependent: (f64, f64),
    /// See [`tol::MULTIPLIERS`].
    pub multipliers: f64,
    /// Whether z is moved back onto the active bounds before others are looked at: where z* is so
    /// far away that its digits end above the tolerance.
    pub far: bool,
}

impl Trust {
    /// Enough for an answer without a second look.
    pub const CERTAIN: Trust =
        Trust { dependent: tol::DEPENDENT, multipliers: tol::MULTIPLIERS, far: false };
    /// Whatever can be computed at all: the answer is then checked from the outside.
    pub const ANYTHING: Trust =
        Trust { dependent: (tol::PARALLEL, tol::PARALLEL), multipliers: f64::INFINITY, far: true };
}

/// One problem. Its window is c + A z for z = z* + t, or z* + L⁻ᵀt for a Hessian L Lᵀ.
#[derive(Clone, Copy)]
pub struct LeastDistance<'a, W: Windows + ?Sized> {
    /// The rows c + A z.
    pub rows: Rows<'a>,
    /// Smallest values of the rows, padded.
    pub lo: &'a [f64],
    /// Largest values.
    pub hi: &'a [f64],
    /// z*, padded.
    pub unconstrained: &'a [f64],
    /// L by rows of [`Rows::stride`] numbers.
    pub hessian_factor: Option<&'a [f64]>,
    /// What reconstructs the window.
    pub windows: &'a W,
    /// What the method trusts.
    pub trust: Trust,
    /// Of leaving bounds; None: they are hard.
    pub prices: Option<RowPrices>,
}

/// A problem for what is rarely done, and so compiled once for all windows.
pub type Erased<'a> = LeastDistance<'a, dyn Windows + 'a>;

impl<'a, W: Windows + ?Sized> LeastDistance<'a, W> {
    /// The same problem, whatever its windows are.
    pub fn erased(&self) -> Erased<'a> {
        let LeastDistance { rows, lo, hi, unconstrained, hessian_factor, windows, trust, prices } =
            *self;
        let windows = windows.erased();
        LeastDistance { rows, lo, hi, unconstrained, hessian_factor, windows, trust, prices }
    }

    /// The bound of a side.
    #[inline(always)]
    pub fn bound(&self, side: ActiveBound) -> f64 {
        if side.sign > 0.0 { self.lo[side.row] } else { self.hi[side.row] }
    }
}
