//! Means over later outputs that follow each other, of which fits in slices are: a motion that
//! hardly turns from one sample to the next is fitted to a few of them in a fraction of the time,
//! and its integrals over each are as good as the samples.

/// Means of one channel that may be lacking: of more, fits are of each output by itself.
const LACKING: f64 = 0.1;

/// Means of later outputs, NaN where one of them was not measured.
#[derive(Debug, Clone, Copy)]
pub struct Means<'a, const P: usize> {
    /// Of the first outputs, the next, …
    pub outputs: &'a [[f64; P]],
    /// Over how many each is, at least 2.
    pub every: usize,
    /// Their noise.
    pub noise: [f64; P],
}

impl<const P: usize> Means<'_, P> {
    /// How many of the first so many later outputs they are of.
    pub fn reach(&self, later: usize) -> usize {
        later - later % self.every
    }

    /// Whether hardly any of them lacks.
    pub fn are_whole(&self, later: usize) -> bool {
        let first = &self.outputs[..self.outputs.len().min(later / self.every)];
        let lacking = |i: usize| first.iter().filter(|y| y[i].is_nan()).count() as f64;
        let mut there = (0..P).filter(|&i| self.noise[i].is_finite());
        !first.is_empty() && there.all(|i| lacking(i) <= LACKING * first.len() as f64)
    }

    /// What ω at the middle of a mean is to be moved by for its output to be the mean, by the
    /// change of dω/dt over so many samples: (e² - 1) dt²/24 ω̈.
    #[inline(always)]
    pub fn bend(&self, dt: f64, samples: f64) -> f64 {
        let e = self.every as f64;
        (e * e - 1.0) / 24.0 * dt / samples
    }
}

/// A mean as far as it has come.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mean<const P: usize> {
    sum: [f64; P],
    count: usize,
}

impl<const P: usize> Mean<P> {
    /// Of nothing.
    pub const EMPTY: Self = Mean { sum: [0.0; P], count: 0 };

    /// Takes in an output: the mean, where it is of so many by now.
    pub fn take(&mut self, y: &[f64; P], every: usize) -> Option<[f64; P]> {
        self.sum.iter_mut().zip(y).for_each(|(sum, y)| *sum += y);
        self.count += 1;
        if self.count < every {
            return None;
        }
        let whole = core::mem::replace(self, Self::EMPTY);
        Some(whole.sum.map(|sum| sum / every as f64))
    }
}
