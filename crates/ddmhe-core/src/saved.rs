//! A run as it is continued in another process: see [`snapshot`](crate::snapshot).

use crate::block::Block;
use crate::config::Start;
use crate::config_checks::check_measured;
use crate::design::Design;
use crate::doubts::Doubts;
use crate::error::Error;
use crate::error_bound::ErrorBound;
use crate::estimate::Estimate;
use crate::first_window::Samples;
use crate::history::check_finite;
use crate::inputs::SeenInputs;
use crate::run::Run;
use crate::watch::Seen;
use ddmhe_run::Reasons;
use ddmhe_run::active_set::ActiveBound;
use ddmhe_run::memory::{Judged, Memory};
use serde::{Deserialize, Serialize};

/// What a run is continued from in another process.
#[derive(Serialize, Deserialize)]
pub(crate) struct Saved {
    window: Samples,
    bounds: Vec<f64>,
    active: Vec<(usize, f64)>, // rows and sides of the active bounds
    moves: bool,
    chain: bool,           // whether the estimates are one filter's
    innovations: Vec<f64>, // then those of the outputs
    tail: Vec<f64>,        // covariance of the oldest, unless it is the stationary one
    seen: Seen,
    seen_inputs: SeenInputs,
    doubts: Doubts,
    evidence: Option<SavedEvidence>,
    gate: Vec<f64>,
    since: usize, // outputs since an unknown state
    first: Option<Vec<f64>>,
    pub start: Start, // of the run, which reset may have changed
    t: usize,
    estimate: Estimate,
}

/// Of it, what evidence is made from.
#[derive(Serialize, Deserialize)]
struct SavedEvidence {
    kept: Vec<f64>,
    covariances: Vec<f64>,
    scores: Vec<f64>,
    since: usize,
    inflation: f64,
    steps: f64,
    samples: f64,
    value: f64,
    limit: f64,
    reasons: u8,
}

impl SavedEvidence {
    fn of(memory: &Memory<Block>) -> Option<Self> {
        let ([kept, covariances, scores], judged) = memory.saved_evidence()?;
        Some(SavedEvidence {
            kept: kept.to_vec(),
            covariances: covariances.to_vec(),
            scores: scores.to_vec(),
            since: judged.since,
            inflation: judged.inflation,
            steps: judged.steps,
            samples: judged.samples,
            value: judged.value,
            limit: judged.limit,
            reasons: judged.reasons.bits(),
        })
    }

    /// Whether it is of so many states.
    fn fits(&self, memory: &Memory<Block>, n: usize, states: usize) -> bool {
        let [kept, steps] = memory.saved_evidence_len();
        self.kept.len() == kept
            && self.covariances.len() == states * n * n
            && self.covariances.iter().all(|v| v.is_finite())
            && self.scores.len() <= 2 * steps
            && self.scores.len().is_multiple_of(2)
            && self.inflation >= 0.0
    }

    fn resume(&self, memory: &mut Memory<Block>) {
        let SavedEvidence { since, inflation, steps, samples, value, limit, .. } = *self;
        let reasons = Reasons::from_bits(self.reasons);
        let judged = Judged { since, inflation, steps, samples, value, limit, reasons };
        memory.resume_evidence([&self.kept, &self.covariances, &self.scores], judged);
    }
}

impl Run {
    /// What [`resume`](Self::resume) continues from.
    pub fn saved(&self) -> Saved {
        Saved {
            window: Samples {
                states: self.memory.states().to_vec(),
                outputs: self.memory.outputs().to_vec(),
                inputs: self.memory.inputs().to_vec(),
            },
            bounds: self.bound.as_ref().map_or(&[][..], ErrorBound::errors).to_vec(),
            active: self.memory.active().map(|side| (side.row, side.sign)).collect(),
            moves: self.memory.moves(),
            chain: self.memory.is_chain(),
            innovations: self.memory.innovations().to_vec(),
            tail: self.memory.tail().map_or_else(Vec::new, <[f64]>::to_vec),
            seen: self.seen.clone(),
            seen_inputs: self.seen_inputs.clone(),
            doubts: self.doubts.clone(),
            evidence: SavedEvidence::of(&self.memory),
            gate: self.memory.saved_gate().to_vec(),
            since: self.memory.since(),
            first: self.first.clone(),
            start: self.start,
            t: self.t,
            estimate: self.estimate.clone(),
        }
    }

    /// Continues a saved run from the same start.
    pub fn resume(&mut self, design: &Design, saved: Saved) -> Result<(), Error> {
        let Saved { window, bounds, moves, chain, innovations, tail, .. } = saved;
        let Saved { seen, seen_inputs, doubts, evidence, t, estimate, .. } = saved;
        let Saved { gate, since, first, .. } = saved;
        let Samples { states, outputs, inputs } = &window;
        let (n, p, m) = (design.history.n(), design.history.p(), design.history.m());
        let samples = outputs.len() / p;
        let horizon = design.settings.horizon;
        let begun = first.as_deref().unwrap_or_default();
        let active = saved.active.iter().map(|&(row, sign)| ActiveBound { row, sign });
        let active: Vec<ActiveBound> = active.collect();
        let fits = samples <= design.settings.horizon
            && outputs.len() == samples * p
            && states.len() == (samples + 1) * n
            && inputs.len() == samples * m
            && bounds.len() == if self.bound.is_some() { samples + 1 } else { 0 }
            && bounds.iter().all(|e| *e >= 0.0)
            && t < usize::MAX / 2
            && gate.len() == self.memory.saved_gate().len()
            && gate.iter().all(|v| v.is_finite() || v.is_nan())
            && (since == usize::MAX || since <= t && since.min(horizon) == samples)
            && first.is_some() == (self.start == Start::Auto)
            && begun.len().is_multiple_of(p + m)
            && begun.len() <= horizon * (p + m)
            && estimate.fits(n, p)
            && evidence.is_some() == design.ground.sizes().judged()
            && evidence.as_ref().is_none_or(|own| own.fits(&self.memory, n, samples + 1))
            && estimate.evidence.is_some() == evidence.is_some()
            && (estimate.w.is_empty() || design.driving.is_some())
            && (tail.is_empty() || design.ground.sizes().recorded && tail.len() == n * n)
            && (!chain || design.ground.sizes().recorded)
            && innovations.len() == if chain { samples * p } else { 0 }
            && design.input_watch.allows(&seen_inputs)
            && estimate.v.len() <= design.settings.horizon * p
            && (active.is_empty() || design.problem(samples).allows(&active));
        if !fits || !design.reaches(samples + 1) {
            return Err(Error::value(
                "blob",
                "a window that fits the horizon",
                format!("{samples} samples"),
            ));
        }
        check_measured("blob", outputs, p)?;
        check_finite("blob", states, n)?;
        check_finite("blob", inputs, m)?;
        check_finite("blob", &tail, n)?;
        check_finite("blob", &innovations, p)?;
        check_measured("blob", begun, p + m)?;
        design.watch.check(&seen)?;
        doubts.check(&design.history)?;
        self.refill(design, &window, false);
        self.memory.resume(design.problem(samples).layout().depth, &active, moves);
        self.memory.resume_filter(chain, [&innovations, &tail]);
        if let Some(evidence) = evidence {
            evidence.resume(&mut self.memory);
        }
        self.memory.resume_gate(&gate);
        self.memory.resume_since(since);
        self.first = first;
        (self.seen, self.t, self.estimate) = (seen, t, estimate);
        (self.seen_inputs, self.doubts) = (seen_inputs, doubts);
        self.reserve(design);
        if let Some(bound) = &mut self.bound {
            bound.resume(&bounds);
        }
        Ok(())
    }
}
