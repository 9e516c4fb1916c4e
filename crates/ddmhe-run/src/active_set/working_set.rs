//! Active bounds, and which of them are likely to be active next.
//!
//! They lie in the same memory as everything else of a step, as the bits of their row's number with
//! the sign of the side: a list that is copied and compared as bits, without an allocation.

/// An active bound: its row, and +1 for the lower one, -1 for the upper one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActiveBound {
    /// Row of the window, apart.
    pub row: usize,
    /// +1 for the lower bound, -1 for the upper one.
    pub sign: f64,
}

const SIGN: u64 = 1 << 63;

impl ActiveBound {
    #[inline(always)]
    fn code(self) -> f64 {
        f64::from_bits(self.row as u64 | (self.sign.to_bits() & SIGN))
    }

    #[inline(always)]
    pub(crate) fn decode(code: f64) -> Self {
        let bits = code.to_bits();
        ActiveBound {
            row: (bits & !SIGN) as usize,
            sign: f64::from_bits(1.0_f64.to_bits() | (bits & SIGN)),
        }
    }
}

/// A list of active bounds in memory of its own.
#[derive(Debug)]
pub struct Sides<'a> {
    codes: &'a mut [f64],
    len: &'a mut usize,
}

impl<'a> Sides<'a> {
    /// The first `len` of what `codes` holds, and room for as many as fit.
    #[inline(always)]
    pub fn new(codes: &'a mut [f64], len: &'a mut usize) -> Self {
        Sides { codes, len }
    }

    /// How many.
    #[inline(always)]
    pub fn len(&self) -> usize {
        *self.len
    }

    /// Whether there is none.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        *self.len == 0
    }

    /// All of them, in the order in which they were taken in.
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = ActiveBound> + '_ {
        self.codes[..*self.len].iter().map(|code| ActiveBound::decode(*code))
    }

    /// Number j.
    #[inline(always)]
    pub fn at(&self, j: usize) -> ActiveBound {
        ActiveBound::decode(self.codes[..*self.len][j])
    }

    /// Whether a bound is one of them.
    #[inline(always)]
    pub fn contains(&self, side: ActiveBound) -> bool {
        let code = side.code().to_bits();
        self.codes[..*self.len].iter().any(|other| other.to_bits() == code)
    }

    /// Appends one; with more than fit, nothing.
    #[inline(always)]
    pub fn push(&mut self, side: ActiveBound) {
        if let Some(code) = self.codes.get_mut(*self.len) {
            *code = side.code();
            *self.len += 1;
        }
    }

    /// Takes number j out.
    #[inline(always)]
    pub fn remove(&mut self, j: usize) {
        self.codes.copy_within(j + 1..*self.len, j);
        *self.len -= 1;
    }

    /// Leaves none.
    #[inline(always)]
    pub fn clear(&mut self) {
        *self.len = 0;
    }

    /// Maps each to another, or out of the list.
    #[inline(always)]
    pub fn filter_map(&mut self, map: impl Fn(ActiveBound) -> Option<ActiveBound>) {
        let mut kept = 0;
        for k in 0..*self.len {
            if let Some(side) = map(ActiveBound::decode(self.codes[k])) {
                self.codes[kept] = side.code();
                kept += 1;
            }
        }
        *self.len = kept;
    }

    /// The same as another list.
    #[inline(always)]
    fn copy_from(&mut self, other: &Sides<'_>) {
        self.codes[..*other.len].copy_from_slice(&other.codes[..*other.len]);
        *self.len = *other.len;
    }
}

/// What is kept of a working set beside its sides.
#[derive(Debug, Clone, Copy, Default)]
pub struct Kept {
    /// Whether the last call's active bounds were better foretold by those before moved on with the
    /// window (a bound that was active at a certain time) than by the same rows again (one that is
    /// active at a certain age).
    pub moves: bool,
    /// Whether Q and R in memory are of these sides.
    pub factored: bool,
}

/// The active bounds of the last call, and how they move from call to call.
#[derive(Debug)]
pub struct WorkingSet<'a> {
    /// The active bounds.
    pub sides: Sides<'a>,
    /// Those before, while a call lasts.
    pub before: Sides<'a>,
    /// What is kept beside them.
    pub kept: &'a mut Kept,
}

impl WorkingSet<'_> {
    /// No active bound.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.sides.clear();
        self.kept.factored = false;
    }

    /// The next call is about another problem: the rows may serve again, their factor not.
    pub fn forget_factor(&mut self) {
        self.kept.factored = false;
    }

    /// To the bounds that are likely to be active next; `older` is where a row is when the window
    /// has moved on by a sample.
    #[inline(always)]
    pub fn predict(&mut self, older: impl Fn(usize) -> Option<usize>) {
        self.before.clear();
        if self.sides.is_empty() {
            return;
        }
        self.before.copy_from(&self.sides);
        if self.kept.moves {
            self.sides.filter_map(|side| older(side.row).map(|row| ActiveBound { row, ..side }));
            self.kept.factored = false;
        }
    }

    /// Learns from what the active bounds became.
    #[inline(always)]
    pub fn adapt(&mut self, older: impl Fn(usize) -> Option<usize>) {
        if self.before.is_empty() {
            return;
        }
        let stayed = self.before.iter().filter(|side| self.sides.contains(*side)).count();
        let moved = |side: &ActiveBound| {
            older(side.row).is_some_and(|row| self.sides.contains(ActiveBound { row, ..*side }))
        };
        let moved = self.before.iter().filter(moved).count();
        if stayed != moved {
            self.kept.moves = moved > stayed;
        }
    }
}
