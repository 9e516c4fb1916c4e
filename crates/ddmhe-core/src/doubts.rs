//! Since when estimates are in doubt, and why, in words.

#[cfg(feature = "serde")]
use crate::error::Error;
use crate::estimate::Evidence;
use crate::history::History;
use crate::watch::since;
use ddmhe_run::Reasons;
use ddmhe_run::evidence::OfPlan;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};

/// The step at which each doubt arose first.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub(crate) struct Doubts {
    novel: Option<usize>,
    uncertain: Vec<Option<usize>>, // by state
    stuck: Vec<Option<usize>>,     // by output
    outside: Vec<Option<usize>>,   // by state: of inputs the watch tells
    gated: Vec<Times>,             // by output
    jumps: Times,
    /// When the run turned out not to go on from the recording's end.
    pub elsewhere: Option<usize>,
    /// Whether it went on all the same, for want of problems of an unknown start.
    pub kept: bool,
}

/// When something happened first, and how often.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
struct Times {
    first: usize,
    count: usize,
}

impl Times {
    fn note(&mut self, t: usize) {
        self.first = if self.count == 0 { t } else { self.first };
        self.count += 1;
    }
}

impl Doubts {
    /// None yet.
    pub fn new(history: &History) -> Self {
        let none = |channels: usize| vec![None; channels];
        let (n, p) = (history.n(), history.p());
        let gated = vec![Times::default(); p];
        let (uncertain, stuck, outside) = (none(n), none(p), none(n));
        Doubts { uncertain, stuck, outside, gated, ..Doubts::default() }
    }

    /// Takes note of the evidence on x̂(t).
    #[inline(always)]
    pub fn note(&mut self, of: &Evidence, known: &OfPlan<'_>, x: &[f64], t: usize) {
        if !of.reasons.is_empty() {
            self.look(of, known, x, t);
        }
        if of.restarted || of.gated.contains(&true) {
            self.count(of, t);
        }
    }

    #[cold]
    fn count(&mut self, of: &Evidence, t: usize) {
        if of.restarted {
            self.jumps.note(t);
        }
        let gated = self.gated.iter_mut().zip(&of.gated).filter(|(_, gated)| **gated);
        gated.for_each(|(times, _)| times.note(t));
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
        let mut words: Vec<String> = self.of_doubted(dt);
        words.extend(self.novel.iter().map(|t| {
            format!("{} the motion is unlike the recording; errors grow with it", since(*t, dt))
        }));
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

    /// Of where the run started, of outputs that were rejected, and of jumps.
    fn of_doubted(&self, dt: f64) -> Vec<String> {
        let mut words = Vec::new();
        words.extend(self.elsewhere.map(|t| {
            let taken = match self.kept {
                false => "its first state is taken to be unknown",
                true => {
                    "nor can this recording start from an unknown state: errors of the first \
                    estimates are not known"
                }
            };
            format!("the log does not go on from the recording's end, as seen at step {t}: {taken}")
        }));
        for (i, times) in self.gated.iter().enumerate().filter(|(_, times)| times.count > 0) {
            words.push(format!(
                "{} output {i} (counted from 0) was rejected {}: far from what all others say it \
                is",
                since(times.first, dt),
                often(times.count)
            ));
        }
        if self.jumps.count > 0 {
            words.push(format!(
                "{} the run started again from an unknown state {}: outputs were rejected to one \
                side, which is what a jump of the state makes",
                since(self.jumps.first, dt),
                often(self.jumps.count)
            ));
        }
        words
    }

    /// Whether saved ones belong to this recording.
    #[cfg(feature = "serde")]
    pub fn check(&self, history: &History) -> Result<(), Error> {
        let own = Doubts::new(history);
        let sizes = |d: &Doubts| (d.uncertain.len(), d.stuck.len(), d.outside.len(), d.gated.len());
        match sizes(self) == sizes(&own) {
            true => Ok(()),
            false => Err(Error::value("blob", "doubts on the channels of its recording", "others")),
        }
    }
}

/// In words.
fn often(count: usize) -> String {
    if count == 1 { "once".into() } else { format!("{count} times") }
}
