//! The box of x: contracted with the outputs, backward and forward through the last transitions.

use crate::error::Error;
use crate::interval::{Interval, points};
use crate::observer::dynamics::Dynamics;
use crate::observer::mean_value::MeanValue;
use crate::observer::options::Method;
use crate::observer::plant::{Plant, Transition};
use crate::observer::sample::Sample;

/// The boxes of the last states, at one sample.
pub(super) struct StateBox<'a, D> {
    pub plant: &'a Plant<D>,
    pub sample: Sample,
    pub method: Method,
}

impl<D: Dynamics> StateBox<'_, D> {
    /// Contracts the boxes of the last transitions with their outputs, backward and forward;
    /// `Paper` only the last output.
    pub(super) fn contract(&self, past: &mut [Transition]) -> Result<(), Error> {
        let last = past.len() - 1;
        self.contract_output(&mut past[last])?;
        if self.method == Method::Paper {
            return Ok(());
        }
        // maps from x(k) to x(k+1) and, composed, to the newest state; what is composed keeps the
        // correlations that boxes in between would lose
        let mut maps: Vec<(MeanValue, MeanValue)> = Vec::with_capacity(last);
        for k in (0..last).rev() {
            let one = self.plant.linearised(&past[k])?;
            let whole = maps.last().map_or_else(|| one.clone(), |(_, later)| later.after(&one));
            let (before, after) = past.split_at_mut(k + 1);
            self.backward(&one, &mut before[k].x, &after[0].x)?;
            if k + 1 < last {
                self.backward(&whole, &mut before[k].x, &after[after.len() - 1].x)?;
            }
            self.contract_output(&mut before[k])?;
            maps.push((one, whole));
        }
        for (k, (one, whole)) in maps.iter().rev().enumerate() {
            let (next, newest) = (one.image(&past[k].x), whole.image(&past[k].x));
            self.narrow(&mut past[k + 1].x, &next)?;
            self.narrow(&mut past[last].x, &newest)?;
            self.contract_output(&mut past[k + 1])?;
        }
        self.contract_output(&mut past[last])
    }

    /// x within what the outputs say about C x.
    fn contract_output(&self, at: &mut Transition) -> Result<(), Error> {
        for (row, &output) in self.plant.system.C.chunks_exact(self.plant.n).zip(&at.output) {
            if output == Interval::ENTIRE {
                continue;
            }
            let x = at.x.clone();
            self.contract_row(&points(row), output, &x, &mut at.x)?;
        }
        Ok(())
    }

    /// x within what its image under the map allows, row by row.
    fn backward(
        &self,
        map: &MeanValue,
        x: &mut [Interval],
        image: &[Interval],
    ) -> Result<(), Error> {
        let shifted = map.shifted(x);
        let mut narrowed = shifted.clone();
        for (i, row) in map.slope.chunks_exact(x.len()).enumerate() {
            self.contract_row(row, image[i] - map.offset[i], &shifted, &mut narrowed)?;
        }
        let back: Vec<Interval> =
            narrowed.iter().zip(&map.c).map(|(x, &c)| *x + Interval::point(c)).collect();
        self.narrow(x, &back)
    }

    /// x within other, entry by entry.
    fn narrow(&self, x: &mut [Interval], other: &[Interval]) -> Result<(), Error> {
        for (i, (x, other)) in x.iter_mut().zip(other).enumerate() {
            *x = self.sample.meet(i, *x, *other)?;
        }
        Ok(())
    }

    /// Narrows x to what row·x = sum leaves of it, entry by entry.
    fn contract_row(
        &self,
        row: &[Interval],
        sum: Interval,
        x: &[Interval],
        out: &mut [Interval],
    ) -> Result<(), Error> {
        for (j, a) in row.iter().enumerate() {
            if a.contains(0.0) {
                continue;
            }
            let others =
                (0..row.len()).filter(|&l| l != j).fold(Interval::ZERO, |s, l| s + row[l] * x[l]);
            out[j] = self.sample.meet(j, out[j], (sum - others) / *a)?;
        }
        Ok(())
    }
}
