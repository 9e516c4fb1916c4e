//! What was measured after the recording's end, as fits need it.

use ddmhe_run::rigid::{Mean, Means};

/// Outputs, rates beside them, and means of outputs.
#[derive(Debug, Clone)]
pub(crate) struct Later<const P: usize> {
    pub outputs: Vec<[f64; P]>,
    /// Rates that were measured with them; empty as long as none was.
    pub rates: Vec<[f64; 3]>,
    means: Vec<[f64; P]>,
    mean: Mean<P>,
    every: usize,
    /// Of means.
    noise: [f64; P],
}

impl<const P: usize> Later<P> {
    /// Nothing, with room for so many outputs of such noise; means are over so many, and there are
    /// none over one.
    pub fn with_room(room: usize, noise: &[f64; P], every: usize) -> Self {
        let by = (every as f64).sqrt();
        Later {
            outputs: Vec::with_capacity(room),
            rates: Vec::with_capacity(room),
            means: Vec::with_capacity(if every > 1 { room / every } else { 0 }),
            mean: Mean::EMPTY,
            every,
            noise: noise.map(|noise| noise / by),
        }
    }

    /// Takes in an output, and the rates of its instant.
    pub fn push(&mut self, y: [f64; P], rates: Option<[f64; 3]>) {
        self.outputs.push(y);
        if self.every > 1 {
            self.means.extend(self.mean.take(&y, self.every));
        }
        if let (Some(x), true) = (rates, self.rates.is_empty()) {
            self.rates.resize(self.outputs.len() - 1, [f64::NAN; 3]);
            self.rates.push(x);
        } else if !self.rates.is_empty() {
            self.rates.push(rates.unwrap_or([f64::NAN; 3]));
        }
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.outputs.clear();
        self.rates.clear();
        self.means.clear();
        self.mean = Mean::EMPTY;
    }

    /// Means of the outputs.
    pub fn means(&self) -> Option<Means<'_, P>> {
        let Later { means: outputs, every, noise, .. } = self;
        (*every > 1).then_some(Means { outputs, every: *every, noise: *noise })
    }
}
