//! Means over samples that follow each other, of which fits in slices are: a motion that hardly
//! turns from one sample to the next is fitted to a few of them in a fraction of the time, and its
//! integrals over each are as good as the samples.

use crate::rigid::earlier::Earlier;
use crate::rigid::motion::Moved;
use crate::rigid::small::Vector;

/// Means of one channel that may be lacking: of more, fits are of each output by itself.
const LACKING: f64 = 0.1;

/// Means of recordings and of later outputs, NaN where one of them was not measured.
#[derive(Debug, Clone, Copy)]
pub struct Means<'a, const P: usize> {
    /// Over how many samples each is, at least 2.
    pub every: usize,
    /// How many samples each recording begins with that are of none, at least 1; the last one's
    /// last.
    pub singles: &'a [usize],
    /// Rates of the recordings before the last one: these samples, the means, and the last rate;
    /// and their outputs.
    pub earlier: Earlier<'a, P>,
    /// The same of the last recording.
    pub x: &'a [Vector],
    /// And its outputs.
    pub y: &'a [[f64; P]],
    /// Of the first later outputs, the next, …
    pub outputs: &'a [[f64; P]],
    /// Of rates that were measured with them; none as long as none was.
    pub rates: &'a [MeanRate],
    /// Noise of recorded rates' means.
    pub of_x: Vector,
    /// Of recorded outputs'.
    pub of_y: [f64; P],
    /// Of later outputs'.
    pub of_later: [f64; P],
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
        let mut there = (0..P).filter(|&i| self.of_later[i].is_finite());
        !first.is_empty() && there.all(|i| lacking(i) <= LACKING * first.len() as f64)
    }

    /// What ω at the middle of a mean is to be moved by to be the mean, by the change of dω/dt over
    /// so many samples: (e² - 1) dt²/24 ω̈.
    #[inline(always)]
    pub fn bend(&self, dt: f64, samples: f64) -> f64 {
        let e = self.every as f64;
        (e * e - 1.0) / 24.0 * dt / samples
    }
}

/// Mean of the rates that were measured while outputs came in that one mean is of, entry by entry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanRate {
    /// The mean; NaN of none.
    pub x: Vector,
    /// How many.
    pub count: Vector,
    /// Means of their instants and of the squares of these, in samples from the middle.
    pub at: [Vector; 2],
}

impl MeanRate {
    /// Of none.
    pub const NONE: Self = MeanRate { x: [f64::NAN; 3], count: [0.0; 3], at: [[0.0; 3]; 2] };

    /// With rates of the instant so many samples from the middle; NaN = not measured.
    #[must_use]
    pub fn and(mut self, rates: &Vector, from_middle: f64) -> Self {
        for (i, rate) in rates.iter().enumerate().filter(|(_, rate)| rate.is_finite()) {
            let before = self.count[i];
            let mean = |old: f64, new: f64| (old * before + new) / (before + 1.0);
            self.x[i] = if before > 0.0 { mean(self.x[i], *rate) } else { *rate };
            self.at[0][i] = mean(self.at[0][i], from_middle);
            self.at[1][i] = mean(self.at[1][i], from_middle * from_middle);
            self.count[i] += 1.0;
        }
        self
    }

    /// What entry i is where ω, w in the middle, moves on over so many samples of dt:
    /// w + δ ω̇ + δ² ω̈ / 2 in the mean.
    #[inline(always)]
    pub fn expected(&self, i: usize, w: &Vector, moved: &Moved, (dt, samples): (f64, f64)) -> f64 {
        let (first, second) = (dt * moved.rate[i], dt * moved.bent[i] / samples);
        w[i] + self.at[0][i] * first + 0.5 * self.at[1][i] * second
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

    /// Takes in a sample: the mean, where it is of so many by now.
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
