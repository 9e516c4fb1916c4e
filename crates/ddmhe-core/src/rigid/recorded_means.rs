//! Means over a recording, for fits in slices.

use crate::rigid::later::Later;
use crate::rigid::recording::Recording;
use ddmhe_run::rigid::{Earlier, Mean, Means};

/// Rates and outputs of each recording: its first samples, means over all others, and its last
/// rate.
#[derive(Debug, Clone)]
pub(crate) struct RecordedMeans<const P: usize> {
    every: usize,
    /// How many samples each begins with that are of no mean.
    singles: Vec<usize>,
    x: Vec<[f64; 3]>,
    y: Vec<[f64; P]>,
    /// Number of outputs of each before the last, means and first samples.
    lengths: Vec<usize>,
    of_x: [f64; 3],
    of_y: [f64; P],
}

impl<const P: usize> RecordedMeans<P> {
    /// Over as many samples as the recording's motion allows; None where that is one.
    pub fn of(recording: &Recording<P>) -> Option<Self> {
        let every = recording.every();
        if every == 1 {
            return None;
        }
        let by = (every as f64).sqrt();
        let mut own = RecordedMeans {
            every,
            singles: vec![],
            x: vec![],
            y: vec![],
            lengths: vec![],
            of_x: recording.of_x.map(|noise| noise / by),
            of_y: recording.of_y.map(|noise| noise / by),
        };
        for (x, y) in recording.parts() {
            own.take(x, y);
        }
        own.lengths.pop(); // of the last
        Some(own)
    }

    /// Over how many samples each is.
    pub fn every(&self) -> usize {
        self.every
    }

    /// Those, and those of later outputs.
    pub fn with<'a>(&'a self, later: &'a Later<P>) -> Means<'a, P> {
        let before: usize = self.lengths.iter().sum();
        let (x, last_x) = self.x.split_at(before + self.lengths.len());
        let (y, last_y) = self.y.split_at(before);
        Means {
            every: self.every,
            singles: &self.singles,
            earlier: Earlier { x, y, lengths: &self.lengths },
            x: last_x,
            y: last_y,
            outputs: later.means(),
            rates: later.mean_rates(),
            of_x: self.of_x,
            of_y: self.of_y,
            of_later: *later.of_means(),
        }
    }

    /// One more recording.
    fn take(&mut self, x: &[[f64; 3]], y: &[[f64; P]]) {
        let (e, before) = (self.every, self.y.len());
        let singles = y.len() - e * ((y.len() - 1) / e);
        self.x.extend(&x[..singles]);
        self.y.extend(&y[..singles]);
        let (mut of_x, mut of_y) = (Mean::EMPTY, Mean::EMPTY);
        for (x, y) in x.iter().zip(y).skip(singles) {
            self.x.extend(of_x.take(x, e));
            self.y.extend(of_y.take(y, e));
        }
        self.x.extend(x.last());
        self.singles.push(singles);
        self.lengths.push(self.y.len() - before);
    }
}
