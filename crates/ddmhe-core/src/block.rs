//! Numbers where the machine's vector units read them soonest.

use ddmhe_run::plan::Span;

/// Numbers that begin on a cache line: products read whole lines.
pub(crate) struct Block {
    numbers: Vec<f64>,
    start: usize,
    end: usize,
}

impl Block {
    const LINE: usize = 64;

    pub fn new(len: usize) -> Self {
        let numbers = vec![0.0_f64; len + Self::LINE / size_of::<f64>()];
        let start = numbers.as_ptr().align_offset(Self::LINE);
        let start = if start <= numbers.len() - len { start } else { 0 };
        Block { start, end: start + len, numbers }
    }

    #[inline(always)]
    pub fn numbers(&self) -> &[f64] {
        &self.numbers[self.start..self.end]
    }

    #[inline(always)]
    pub fn numbers_mut(&mut self) -> &mut [f64] {
        &mut self.numbers[self.start..self.end]
    }

    pub fn write(&mut self, span: Span, values: impl IntoIterator<Item = f64>) {
        span.of_mut(self.numbers_mut()).iter_mut().zip(values).for_each(|(at, value)| *at = value);
    }
}

impl Clone for Block {
    fn clone(&self) -> Self {
        let mut copy = Block::new(self.end - self.start); // which begins elsewhere
        copy.numbers_mut().copy_from_slice(self.numbers());
        copy
    }
}

impl AsRef<[f64]> for Block {
    #[inline(always)]
    fn as_ref(&self) -> &[f64] {
        self.numbers()
    }
}

impl AsMut<[f64]> for Block {
    #[inline(always)]
    fn as_mut(&mut self) -> &mut [f64] {
        self.numbers_mut()
    }
}
