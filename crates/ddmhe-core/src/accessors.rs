//! What an estimator says of itself.

use crate::config::{Config, Settings, Start};
use crate::estimate::Estimate;
use crate::history::History;
use crate::mhe::DdMhe;

impl DdMhe {
    /// Number of states n.
    pub fn n(&self) -> usize {
        self.design.history.n()
    }

    /// Number of outputs p.
    pub fn p(&self) -> usize {
        self.design.history.p()
    }

    /// The settings in force.
    pub fn settings(&self) -> &Settings {
        &self.design.settings
    }

    /// The configuration that was asked for.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Whether estimates carry an error bound; [`warnings`](Self::warnings) says why not, if one
    /// was asked for.
    pub fn is_bounded(&self) -> bool {
        self.run.bound.is_some()
    }

    /// Where this run started; [`Start::Auto`] as long as that is still to be found.
    pub fn start(&self) -> Start {
        self.run.start
    }

    /// Steps taken since the start or the last reset.
    pub fn t(&self) -> usize {
        self.run.t
    }

    /// Depth M_t of the next step's window.
    pub fn next_depth(&self) -> usize {
        let outputs = (self.run.memory.len() + 1).min(self.design.settings.horizon);
        self.design.problem(outputs).layout().depth
    }

    /// Spectral radius of the map x̄(t-M) → x̂(t) without new information: above 1 errors grow.
    pub fn spectral_radius(&self) -> f64 {
        self.design.spectral_radius
    }

    /// What a user should know, in words: about the recording and the settings, and since when
    /// outputs do what they never did in the recording (the list then grows).
    ///
    /// # Example
    /// ```
    /// # use ddmhe_core::*;
    /// # // x(t+1) = 0.9 x(t) + 1, y = 2 x
    /// # let x: Vec<f64> =
    /// #     std::iter::successors(Some(0.0), |x| Some(0.9 * x + 1.0)).take(61).collect();
    /// # let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x).collect();
    /// # let history = History::new(1, 1, &x[..31], &y[..30], 0.1)?;
    /// for sentence in DdMhe::new(&history, Config::default())?.warnings() {
    ///     eprintln!("{sentence}");
    /// }
    /// # Ok::<(), Error>(())
    /// ```
    pub fn warnings(&self) -> Vec<String> {
        let dt = self.design.history.dt();
        let online = self.design.watch.words(&self.run.seen, dt);
        let of_inputs = self.design.input_watch.words(&self.run.seen_inputs, dt);
        let doubts = self.run.doubts.words(dt);
        let all = self.design.warnings.iter().cloned().chain(online).chain(of_inputs);
        all.chain(doubts).collect()
    }

    /// What the recording promises: the root-mean-square error of each state in windows that were
    /// held out of it (n), NaN where nothing could be held out. None without evidence.
    pub fn promise(&self) -> Option<&[f64]> {
        self.design.evidence.as_ref().map(|own| &own.states.promise[..])
    }

    /// The latest estimate (empty before the first step).
    pub fn estimate(&self) -> &Estimate {
        &self.run.estimate
    }

    /// The recording behind the estimator.
    pub fn history(&self) -> &History {
        &self.design.history
    }
}
