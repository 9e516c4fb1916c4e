//! Since when estimates are in doubt, and why, in words.

use crate::error::Error;
use crate::estimate::Evidence;
use crate::history::History;
use crate::watch::since;
use ddmhe_run::Reasons;
use ddmhe_run::evidence::OfPlan;
use serde::{Deserialize, Serialize};

/// The step at which each doubt arose first.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Doubts {
    novel: Option<usize>,
    uncertain: Vec<Option<usize>>, // by state
    stuck: Vec<Option<usize>>,     // by output
    outside: Vec<Option<usize>>,   // by state: of inputs the watch tells
}

impl Doubts {
    /// None yet.
    pub fn new(history: &History) -> Self {
        let none = |channels: usize| vec![None; channels];
        let (n, p) = (history.n(), history.p());
        Doubts { novel: None, uncertain: none(n), stuck: none(p), outside: none(n) }
    }

    /// Takes note of the evidence on x̂(t).
    #[inline(always)]
    pub fn note(&mut self, of: &Evidence, known: &OfPlan<'_>, x: &[f64], t: usize) {
        if !of.reasons.is_empty() {
            self.look(of, known, x, t);
        }
    }

    #[cold]
    fn look(&mut self, of: &Evidence, known: &OfPlan<'_>, x: &[f64], t: usize) {
        if of.reasons.contains(Reasons::NOVEL) {
            self.novel.get_or_insert(t);
        }
        let n = x.len();
        for (i, first) in self.uncertain.iter_mut().enumerate() {
            if known.is_uncertain(i, of.covariance[i * n + i]) {
                first.get_or_insert(t);
            }
        }
        for (first, stuck) in self.stuck.iter_mut().zip(&of.stuck) {
            if *stuck {
                first.get_or_insert(t);
            }
        }
        for (i, first) in self.outside.iter_mut().enumerate() {
            if known.is_state_outside(i, x[i]) {
                first.get_or_insert(t);
            }
        }
    }

    /// In words; `dt` in seconds.
    pub fn words(&self, dt: f64) -> Vec<String> {
        let mut words: Vec<String> = self
            .novel
            .iter()
            .map(|t| {
                format!("{} the motion is unlike the recording; errors grow with it", since(*t, dt))
            })
            .collect();
        let told = |firsts: &[Option<usize>], sentence: &dyn Fn(usize) -> String| {
            let all = firsts.iter().enumerate();
            let known = all.filter_map(|(i, first)| first.map(|t| (i, t)));
            known.map(|(i, t)| format!("{} {}", since(t, dt), sentence(i))).collect::<Vec<_>>()
        };
        words.extend(told(&self.uncertain, &|i| {
            format!(
                "state {i} (counted from 0) is uncertain: by half of its recorded spread or more"
            )
        }));
        words.extend(told(&self.stuck, &|i| {
            format!(
                "output {i} (counted from 0) repeats one value longer than it ever did recorded"
            )
        }));
        words.extend(told(&self.outside, &|i| {
            format!(
                "state {i} (counted from 0) is outside of its recorded range by a quarter of it"
            )
        }));
        words
    }

    /// Whether saved ones belong to this recording.
    pub fn check(&self, history: &History) -> Result<(), Error> {
        let own = Doubts::new(history);
        let sizes = |d: &Doubts| (d.uncertain.len(), d.stuck.len(), d.outside.len());
        match sizes(self) == sizes(&own) {
            true => Ok(()),
            false => Err(Error::value("blob", "doubts on the channels of its recording", "others")),
        }
    }
}
