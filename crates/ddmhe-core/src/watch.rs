//! What single channels give away: one that never moved in the recording, and angles that jump by a
//! full turn.
//!
//! A channel at rest tells the estimator nothing, and nothing of what it does when it moves online:
//! its output is then fitted noise. A wrapped angle jumps by 2π or 360 where the motion is smooth.
//! No linear system does that, and the squares of (17) take it for an error of a full turn. Neither
//! can be mended here; both are said in words, the recording's at construction, the outputs' when
//! they occur.
//!
//! *When is a jump a turn?* The channel stays within one of the usual ranges \[-½, ½\] or \[0, 1\]
//! of a turn, or comes within a step of both ends of another; its ordinary steps are below a
//! quarter of a turn, and the jump, unwrapped, is a step like those beside it. A square wave of
//! about a turn has no steps beside it.

#[cfg(feature = "serde")]
use crate::error::Error;
use crate::history::History;
use crate::tol;
#[cfg(feature = "serde")]
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// A full turn and the lower end of the range that it is wrapped to.
const RANGES: [(f64, f64); 4] = [(TAU, -PI), (TAU, 0.0), (360.0, -180.0), (360.0, 0.0)];
/// Values may leave the range by this share of a turn (printed digits), and an online step may
/// differ from a turn by ten times that.
const SLACK: f64 = 2e-3;
/// Largest ordinary step, as a share of a turn.
const STEP: f64 = 0.25;
/// Fewest ordinary steps of a channel that is said to jump.
const LEAST: usize = 8;

/// What is watched online; empty for a recording whose outputs all moved and cannot be angles.
#[derive(Debug, Clone, Default)]
pub(crate) struct Watch {
    still: Vec<(usize, f64, f64)>, // output, its recorded value, how far from it is rounding
    // by output: a step below this is none by a turn; infinite if it cannot be an angle
    jump: Vec<f64>,
    ranges: Vec<Vec<(f64, f64)>>, // by output: what it may be wrapped to
    usual: Vec<f64>,              // by output: the largest ordinary step
}

/// What was seen online: the step at which each output first did what it never did in the
/// recording.
#[derive(Debug, Clone, Default)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub(crate) struct Seen {
    last: Vec<f64>,
    moved: Vec<Option<usize>>,  // by entry of `Watch::still`
    turned: Vec<Option<usize>>, // by output
}

/// One channel of all recordings.
struct Channel<'a> {
    parts: Vec<&'a [f64]>,
    width: usize,
    index: usize,
}

impl Watch {
    /// What to watch, and what the recording itself shows, in words.
    pub fn new(history: &History) -> (Self, Vec<String>) {
        let (mut watch, mut words) = (Watch::default(), Vec::new());
        for index in 0..history.n() {
            let parts = (0..history.recordings()).map(|i| history.states(i)).collect();
            words.extend(Channel { parts, width: history.n(), index }.wrapped("state"));
        }
        for index in 0..history.p() {
            let parts = (0..history.recordings()).map(|i| history.outputs(i)).collect();
            let channel = Channel { parts, width: history.p(), index };
            if let Some((value, rounding)) = channel.still() {
                watch.still.push((index, value, rounding));
                words.push(format!(
                    "output {index} (counted from 0) never moved in the recording, it is {value} \
                    throughout: it tells nothing of \
                     the states"
                ));
            }
            words.extend(channel.wrapped("output"));
            let usual = channel.usual(f64::INFINITY);
            // a channel that leapt as far in the recording may do so again
            let mut ranges = channel.ranges();
            ranges.retain(|(turn, _)| usual <= STEP * turn);
            let least = |&(turn, _): &(f64, f64)| turn - margin(usual, turn);
            watch.jump.push(ranges.iter().map(least).fold(f64::INFINITY, f64::min));
            watch.ranges.push(ranges);
            watch.usual.push(usual);
        }
        (watch, words)
    }

    /// Nothing seen yet.
    pub fn start(&self) -> Seen {
        let outputs = self.jump.len();
        Seen {
            last: vec![f64::NAN; outputs],
            moved: vec![None; self.still.len()],
            turned: vec![None; outputs],
        }
    }

    /// Takes note of y(t-1) (p numbers, NaN where not measured) at step t.
    #[inline]
    pub fn note(&self, seen: &mut Seen, y: &[f64], t: usize) {
        for (i, ((&y, last), jump)) in y.iter().zip(&mut seen.last).zip(&self.jump).enumerate() {
            if (y - *last).abs() >= *jump && self.is_turn(i, *last, y) {
                seen.turned[i].get_or_insert(t);
            }
            if !y.is_nan() {
                *last = y;
            }
        }
        if !self.still.is_empty() {
            self.look(seen, y, t);
        }
    }

    /// Takes note of outputs that never moved in the recording and do so now.
    #[cold]
    fn look(&self, seen: &mut Seen, y: &[f64], t: usize) {
        for (&(i, value, rounding), moved) in self.still.iter().zip(&mut seen.moved) {
            if (y[i] - value).abs() > rounding {
                moved.get_or_insert(t);
            }
        }
    }

    /// Whether an output went from one end of a range that it may be wrapped to to the other.
    #[cold]
    fn is_turn(&self, i: usize, from: f64, to: f64) -> bool {
        let step = (to - from).abs();
        self.ranges[i].iter().any(|&(turn, lo)| {
            let inside = |v: f64| v >= lo - SLACK * turn && v <= lo + turn + SLACK * turn;
            inside(from) && inside(to) && (step - turn).abs() <= margin(self.usual[i], turn)
        })
    }

    /// What was seen, in words; `dt` in seconds.
    pub fn words(&self, seen: &Seen, dt: f64) -> Vec<String> {
        let moved = self.still.iter().zip(&seen.moved).filter_map(|(&(i, value, _), t)| {
            let since = since((*t)?, dt);
            Some(format!(
                "output {i} (counted from 0) moves {since}, which it never did in the recording, \
                where it is {value}: no estimate uses it"
            ))
        });
        let turned = seen.turned.iter().enumerate().filter_map(|(i, t)| {
            let since = since((*t)?, dt);
            Some(format!("output {i} (counted from 0) jumps by a full turn {since}: {ADVICE}"))
        });
        moved.chain(turned).collect()
    }

    /// Whether saved notes belong to this recording.
    #[cfg(feature = "serde")]
    pub fn check(&self, seen: &Seen) -> Result<(), Error> {
        let start = self.start();
        let sizes = |s: &Seen| (s.last.len(), s.moved.len(), s.turned.len());
        if sizes(seen) == sizes(&start) && seen.last.iter().all(|v| !v.is_infinite()) {
            return Ok(());
        }
        Err(Error::value("blob", "notes on the outputs of its recording", "others"))
    }
}

const ADVICE: &str = "a wrapped angle follows no linear motion; give its cosine and sine as two \
channels, or unwrap it";

impl Channel<'_> {
    /// Values of each part, in time.
    fn values(&self) -> impl Iterator<Item = impl Iterator<Item = f64> + Clone> {
        self.parts.iter().map(|part| part.iter().copied().skip(self.index).step_by(self.width))
    }

    fn extent(&self) -> (f64, f64) {
        self.values()
            .flatten()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
    }

    /// The one value of a channel that never moved, and how far from it is rounding.
    fn still(&self) -> Option<(f64, f64)> {
        let (lo, hi) = self.extent();
        let rounding = tol::UNMOVED * lo.abs().max(hi.abs());
        (hi - lo <= rounding).then_some((lo, rounding))
    }

    /// Steps from sample to sample of each part.
    fn steps(&self) -> impl Iterator<Item = Vec<f64>> {
        self.values().map(|v| v.clone().skip(1).zip(v).map(|(next, v)| next - v).collect())
    }

    /// The largest step of at most `limit`.
    fn usual(&self, limit: f64) -> f64 {
        self.steps().flatten().map(f64::abs).filter(|s| *s <= limit).fold(0.0, f64::max)
    }

    /// Ranges that the channel may be wrapped to.
    fn ranges(&self) -> Vec<(f64, f64)> {
        let (low, high) = self.extent();
        let fits = |&(turn, lo): &(f64, f64)| {
            let usual = self.usual(0.5 * turn);
            low >= lo - SLACK * turn
                && high <= lo + turn + SLACK * turn
                && usual > 0.0
                && usual <= STEP * turn
        };
        // an angle that has jumped comes within a step of both ends of its range, wherever that
        // begins
        let between = |turn: f64| {
            let (extent, ends) = (high - low, 2.0 * self.usual(0.5 * turn));
            (extent >= turn - ends).then_some((turn, 0.5 * (low + high - turn)))
        };
        RANGES
            .into_iter()
            .chain([TAU, 360.0].into_iter().filter_map(between))
            .filter(fits)
            .collect()
    }

    /// What to say of a channel that jumps by full turns.
    fn wrapped(&self, name: &str) -> Option<String> {
        let Turns { turn, count, part, sample } = self.turns()?;
        let place =
            if self.parts.len() > 1 { format!(" of recording {part}") } else { String::new() };
        let turn = if turn == TAU { "2 pi" } else { "360" };
        let index = self.index;
        Some(format!(
            "{name} {index} (counted from 0) jumps by about {turn} in the recording, {count} \
            times, first at sample {sample}{place}: \
             {ADVICE}"
        ))
    }

    /// The full turns that the channel jumps by, if it does.
    fn turns(&self) -> Option<Turns> {
        self.ranges().into_iter().find_map(|(turn, _)| {
            let mut found = Vec::new();
            let (mut others, mut ordinary_steps) = (0, 0);
            for (part, steps) in self.steps().enumerate() {
                let ordinary = |k: usize| steps.get(k).map_or(0.0, |s| s.abs()).min(STEP * turn);
                for k in (0..steps.len()).filter(|&k| steps[k].abs() > 0.5 * turn) {
                    let beside =
                        if k > 0 { ordinary(k - 1).max(ordinary(k + 1)) } else { ordinary(k + 1) };
                    let is_turn = (steps[k].abs() - turn).abs() <= 2.0 * beside;
                    if is_turn { found.push((part, k + 1)) } else { others += 1 }
                }
                ordinary_steps += steps.len();
            }
            ordinary_steps -= found.len() + others;
            // a turn takes four ordinary steps at least
            let enough = found.len() > others && ordinary_steps >= (4 * found.len()).max(LEAST);
            let &(part, sample) = found.first().filter(|_| enough)?;
            Some(Turns { turn, count: found.len(), part, sample })
        })
    }
}

/// Jumps of a channel by full turns: how far, how many, and the first sample after one.
struct Turns {
    turn: f64,
    count: usize,
    part: usize,
    sample: usize,
}

/// The full turn (2π or 360) that a wrapped angle jumps by and the first entry after such a jump;
/// None for any other signal. Entries that are not finite were not measured: those beside them
/// count as neighbours.
pub fn wrapped_angle(values: &[f64]) -> Option<(f64, usize)> {
    let entries: Vec<usize> = (0..values.len()).filter(|&k| values[k].is_finite()).collect();
    let known: Vec<f64> = entries.iter().map(|&k| values[k]).collect();
    let channel = Channel { parts: vec![&known], width: 1, index: 0 };
    channel.turns().map(|found| (found.turn, entries[found.sample]))
}

/// States that never moved in the recording.
pub(crate) fn still_states(history: &History) -> impl Iterator<Item = usize> {
    still(history, History::states, history.n())
}

/// Inputs that never moved in the recording.
pub(crate) fn still_inputs(history: &History) -> impl Iterator<Item = usize> {
    still(history, History::inputs, history.m())
}

/// Channels of a signal that never moved.
fn still(
    history: &History,
    signal: fn(&History, usize) -> &[f64],
    width: usize,
) -> impl Iterator<Item = usize> {
    let parts = move || (0..history.recordings()).map(|i| signal(history, i)).collect();
    let channel = move |index: usize| Channel { parts: parts(), width, index };
    (0..width).filter(move |&i| channel(i).still().is_some())
}

/// How far from a full turn a jump by one may be: by ordinary steps on both sides of it, or by
/// printed digits.
fn margin(usual: f64, turn: f64) -> f64 {
    (2.0 * usual).max(10.0 * SLACK * turn)
}

/// Since when, in words; `dt` in seconds.
pub(crate) fn since(t: usize, dt: f64) -> String {
    format!("from {} s on (step {t})", significant(t as f64 * dt))
}

/// A number without the digits that only rounding puts there.
fn significant(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}
