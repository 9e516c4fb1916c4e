//! What is fitted: recordings, and what was measured since.

use crate::rigid::earlier::Earlier;
use crate::rigid::means::Means;
use crate::rigid::motion::Moved;
use crate::rigid::small::Vector;

/// What is fitted: recordings, and the outputs since the last of them, NaN = not measured. Noise is
/// infinite of outputs that there are none of.
#[derive(Debug, Clone, Copy)]
pub struct Data<'a, const P: usize, K = ()> {
    /// Recordings before the last one, of a motion that goes on by itself.
    pub earlier: Earlier<'a, P>,
    /// Recorded rates (T+1).
    pub x: &'a [Vector],
    /// Recorded outputs (T).
    pub y: &'a [[f64; P]],
    /// Later outputs.
    pub later: &'a [[f64; P]],
    /// Later rates, as many as there are later outputs, or none of all.
    pub rates: &'a [Vector],
    /// Means of later outputs, of which the fit is in their place; there are no later rates then.
    pub means: Option<Means<'a, P>>,
    /// What is known of each sample: of the motion [`EVERYWHERE`] where nothing has to be. One
    /// that is driven stands still after the last of them.
    ///
    /// [`EVERYWHERE`]: crate::rigid::Motion::EVERYWHERE
    pub known: &'a [K],
    /// Noise of recorded rates.
    pub of_x: Vector,
    /// Of recorded outputs.
    pub of_y: [f64; P],
    /// Of later ones.
    pub of_later: [f64; P],
    /// Of later rates.
    pub of_rates: Vector,
}

impl<const P: usize, K> Data<'_, P, K> {
    /// How many outputs were recorded, in all recordings.
    pub fn recorded(&self) -> usize {
        self.earlier.y.len() + self.y.len()
    }

    /// Recording i alone and how many instants it has, if it is an earlier one; else the last
    /// recording and what came since, of which a fit has the outputs before `end`.
    #[inline(always)]
    pub(super) fn part(&self, i: usize, end: usize) -> (Self, usize)
    where
        K: Copy,
    {
        match self.earlier.part(i) {
            Some((x, y)) => (Data { x, y, later: &[], rates: &[], means: None, ..*self }, y.len()),
            None => (*self, self.instants(end)),
        }
    }

    /// The same of later outputs, not of their means.
    #[must_use]
    pub fn singly(&self) -> Self {
        Data { means: None, ..*self }
    }

    /// How many instants there are before the end of so many outputs: each of an output, but means
    /// are of the instants in their middle, and the recording's end is then one by itself.
    fn instants(&self, outputs: usize) -> usize {
        match &self.means {
            None => outputs,
            Some(means) => self.y.len() + 1 + (outputs - self.y.len()) / means.every,
        }
    }

    /// The output of an instant, if there is one, and its noise.
    #[inline(always)]
    pub(super) fn output(&self, k: usize) -> Option<(&[f64; P], &[f64; P])> {
        if k < self.y.len() {
            return Some((&self.y[k], &self.of_y));
        }
        let since = k - self.y.len();
        match &self.means {
            None => Some((&self.later[since], &self.of_later)),
            Some(means) => Some((means.outputs.get(since.wrapping_sub(1))?, &means.noise)),
        }
    }

    /// What is known of the samples from k on, of those that a fit to `end` outputs is of.
    #[inline(always)]
    pub(super) fn known_from(&self, k: usize, end: usize, driven: bool) -> &[K] {
        let until = if driven { end.max(self.x.len()) } else { usize::MAX };
        self.known.get(k..until.min(self.known.len())).unwrap_or(&[])
    }

    /// The rates that were measured with later output k.
    #[inline(always)]
    pub(super) fn rate(&self, k: usize) -> Option<&Vector> {
        match self.means {
            None => self.rates.get(k.wrapping_sub(self.y.len())),
            Some(_) => None,
        }
    }

    /// Samples from instant k to the next, which may be the end.
    #[inline(always)]
    pub(super) fn span(&self, k: usize, end: usize) -> f64 {
        let Some(means) = self.means.as_ref().filter(|_| k >= self.y.len()) else { return 1.0 };
        let every = means.every as f64;
        match (k == self.y.len(), k + 1 == end) {
            (true, _) => 0.5 * (every - 1.0),
            (_, true) => 0.5 * (every + 1.0),
            _ => every,
        }
    }

    /// ω whose output is what was measured at instant k, where ω is w.
    #[inline(always)]
    pub(super) fn seen(
        &self,
        k: usize,
        (dt, samples): (f64, f64),
        w: &Vector,
        moved: &Moved,
    ) -> Vector {
        let Some(means) = self.means.as_ref().filter(|_| k > self.y.len()) else { return *w };
        let by = means.bend(dt, samples);
        [0, 1, 2].map(|i| w[i] + by * moved.bent[i])
    }
}
