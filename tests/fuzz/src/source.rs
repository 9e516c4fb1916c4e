//! Choices and numbers out of bytes; what is missing at the end is 0, the plainest choice.

/// Doubles at which arithmetic breaks.
const ODD: [f64; 16] = [
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN,
    f64::MIN_POSITIVE,
    5e-324,
    -5e-324,
    f64::EPSILON,
    -0.0,
    1e300,
    -1e154,
    1e-154,
    4503599627370497.0,
    1e15,
    -1e8,
];

/// Bytes that are used up from the front.
pub struct Source<'a>(pub &'a [u8]);

impl Source<'_> {
    /// The next byte.
    pub fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    /// One of 0 … count - 1.
    pub fn below(&mut self, count: usize) -> usize {
        usize::from(self.byte()) % count
    }

    /// True once in so many.
    pub fn once_in(&mut self, count: usize) -> bool {
        self.below(count) == count - 1
    }

    /// A number near 1 in most cases.
    pub fn sane(&mut self) -> f64 {
        f64::from(self.byte() as i8) / 32.0
    }

    /// A number of any kind; sane in three of four cases.
    pub fn number(&mut self) -> f64 {
        match self.byte() % 16 {
            12 => ODD[self.below(ODD.len())],
            13 => f64::from_bits(u64::from_le_bytes(std::array::from_fn(|_| self.byte()))),
            14 => self.sane() * 10_f64.powi(i32::from(self.byte() as i8) * 5 / 2),
            15 => 0.0,
            _ => self.sane(),
        }
    }

    /// So many of them; `odd`: of any kind.
    pub fn numbers(&mut self, count: usize, odd: bool) -> Vec<f64> {
        (0..count).map(|_| if odd { self.number() } else { self.sane() }).collect()
    }

    /// None in most cases.
    pub fn maybe<T>(&mut self, count: usize, make: impl FnOnce(&mut Self) -> T) -> Option<T> {
        if self.once_in(count) { Some(make(self)) } else { None }
    }
}
