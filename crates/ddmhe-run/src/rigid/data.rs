//! What is fitted: recordings, and what was measured since.

use crate::rigid::earlier::Earlier;
use crate::rigid::means::{MeanRate, Means};
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
    /// Means, of which a fit may be in the place of the samples: see [`in_means`](Self::in_means).
    pub means: Option<Means<'a, P>>,
    /// How many samples the recording begins with that are of no mean, in data in means.
    pub singles: Option<usize>,
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
            Some((x, y)) => {
                let singles = self.singles.map(|_| self.singles_of(i));
                (Data { x, y, later: &[], rates: &[], singles, ..*self }, y.len())
            }
            None => (*self, self.instants(end)),
        }
    }

    /// The same in means, where there are such.
    #[must_use]
    pub fn in_means(&self) -> Self {
        let Some(Means { earlier, x, y, .. }) = self.means else { return Data { ..*self } };
        let singles = Some(self.singles_of(earlier.lengths.len()));
        Data { earlier, x, y, rates: &[], singles, ..*self }
    }

    /// How many samples recording i begins with that are of no mean.
    fn singles_of(&self, i: usize) -> usize {
        self.means.and_then(|means| means.singles.get(i).copied()).unwrap_or(1)
    }

    /// Means, where the data are in such.
    #[inline(always)]
    fn own_means(&self) -> Option<(&Means<'_, P>, usize)> {
        Some((self.means.as_ref()?, self.singles?))
    }

    /// The means, if an instant is in the middle of one.
    #[inline(always)]
    pub(super) fn mean_at(&self, k: usize) -> Option<&Means<'_, P>> {
        let (means, singles) = self.own_means()?;
        (k >= singles && k != self.y.len()).then_some(means)
    }

    /// How many instants there are before the end of so many outputs: each of an output, but means
    /// are of the instants in their middle, and the recording's end is then one by itself.
    fn instants(&self, outputs: usize) -> usize {
        match self.own_means() {
            None => outputs,
            Some((means, singles)) => {
                let recorded = singles + means.every * (self.y.len() - singles);
                self.y.len() + 1 + (outputs - recorded) / means.every
            }
        }
    }

    /// The output of an instant, if there is one, and its noise.
    #[inline(always)]
    pub(super) fn output(&self, k: usize) -> Option<(&[f64; P], &[f64; P])> {
        let mean = self.mean_at(k);
        if let Some(y) = self.y.get(k) {
            return Some((y, mean.map_or(&self.of_y, |means| &means.of_y)));
        }
        match (self.own_means(), mean) {
            (None, _) => Some((&self.later[k - self.y.len()], &self.of_later)),
            (_, Some(means)) => Some((means.outputs.get(k - self.y.len() - 1)?, &means.of_later)),
            (_, None) => None,
        }
    }

    /// The recorded rate of an instant, if there is one, and its noise.
    #[inline(always)]
    pub(super) fn recorded_rate(&self, k: usize) -> Option<(&Vector, &Vector)> {
        let noise = self.mean_at(k).map_or(&self.of_x, |means| &means.of_x);
        Some((self.x.get(k)?, noise))
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
        self.rates.get(k.wrapping_sub(self.y.len()))
    }

    /// Those that were measured with a mean's outputs.
    #[inline(always)]
    pub(super) fn mean_rate(&self, k: usize) -> Option<&MeanRate> {
        self.mean_at(k)?.rates.get(k.wrapping_sub(self.y.len() + 1))
    }

    /// Samples from instant k to the next, which may be the end.
    #[inline(always)]
    pub(super) fn span(&self, k: usize, end: usize) -> f64 {
        let Some((means, singles)) = self.own_means() else { return 1.0 };
        let half = 0.5 * (means.every as f64 - 1.0); // from either end of a mean to its middle
        let in_mean = |k: usize| k >= singles && k != self.y.len();
        let rest = match in_mean(k) {
            true => half + 1.0,
            false if k == self.y.len() => 0.0,
            false => 1.0,
        };
        rest + if k + 1 < end && in_mean(k + 1) { half } else { 0.0 }
    }

    /// What of an instant is measured where ω is w: the mean about it.
    #[inline(always)]
    pub(super) fn seen(
        &self,
        k: usize,
        (dt, samples): (f64, f64),
        w: &Vector,
        moved: &Moved,
    ) -> Vector {
        let Some(means) = self.mean_at(k) else { return *w };
        let by = means.bend(dt, samples);
        [0, 1, 2].map(|i| w[i] + by * moved.bent[i])
    }
}
