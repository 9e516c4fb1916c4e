//! What was measured after the recording's end, as fits need it.

use ddmhe_run::rigid::{Mean, MeanRate};

/// Outputs, rates beside them, and means of both.
#[derive(Debug, Clone)]
pub(crate) struct Later<const P: usize> {
    pub outputs: Vec<[f64; P]>,
    /// Rates that were measured with them; empty as long as none was.
    pub rates: Vec<[f64; 3]>,
    means: Vec<[f64; P]>,
    mean: Mean<P>,
    /// Rates in means; empty as long as none was measured.
    mean_rates: Vec<MeanRate>,
    mean_rate: MeanRate,
    every: usize,
    /// Of means.
    noise: [f64; P],
}

impl<const P: usize> Later<P> {
    /// Nothing, with room for so many outputs of such noise; means are over so many, and there are
    /// none over one.
    pub fn with_room(room: usize, noise: &[f64; P], every: usize) -> Self {
        let (by, means) = ((every as f64).sqrt(), if every > 1 { room / every } else { 0 });
        Later {
            outputs: Vec::with_capacity(room),
            rates: Vec::with_capacity(room),
            means: Vec::with_capacity(means),
            mean: Mean::EMPTY,
            mean_rates: Vec::with_capacity(means),
            mean_rate: MeanRate::NONE,
            every,
            noise: noise.map(|noise| noise / by),
        }
    }

    /// Takes in an output, and the rates of its instant.
    pub fn push(&mut self, y: [f64; P], rates: Option<[f64; 3]>) {
        let before = self.outputs.len();
        self.outputs.push(y);
        if let (Some(_), true) = (rates, self.rates.is_empty()) {
            self.rates.resize(before, [f64::NAN; 3]);
            self.mean_rates.resize(self.means.len(), MeanRate::NONE);
        }
        if let Some(x) = rates.or((!self.rates.is_empty()).then_some([f64::NAN; 3])) {
            self.rates.push(x);
            let from_middle = (before % self.every) as f64 - 0.5 * (self.every as f64 - 1.0);
            self.mean_rate = self.mean_rate.and(&x, from_middle);
        }
        if self.every > 1
            && let Some(mean) = self.mean.take(&y, self.every)
        {
            self.means.push(mean);
            let rates = std::mem::replace(&mut self.mean_rate, MeanRate::NONE);
            if !self.rates.is_empty() {
                self.mean_rates.push(rates);
            }
        }
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.outputs.clear();
        self.rates.clear();
        self.means.clear();
        self.mean = Mean::EMPTY;
        self.mean_rates.clear();
        self.mean_rate = MeanRate::NONE;
    }

    /// Means of the outputs.
    pub fn means(&self) -> &[[f64; P]] {
        &self.means
    }

    /// Means of the rates beside them.
    pub fn mean_rates(&self) -> &[MeanRate] {
        &self.mean_rates
    }

    /// Noise of outputs' means.
    pub fn of_means(&self) -> &[f64; P] {
        &self.noise
    }
}
