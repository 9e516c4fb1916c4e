//! What runs ask of a design: where they may start, and what outputs are doubted by.

use crate::config::{Config, Gate, Start};
use crate::error::Error;
use crate::evidence::Calibration;
use crate::first_window::filled;
use crate::history::History;
use ddmhe_run::evidence::Rule;
use ddmhe_run::plan::Begin;

/// What problems are made for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Needs {
    /// Where a new run starts.
    pub start: Start,
    /// Whether a run may start from an unknown state, now or later: that takes the problems of all
    /// growing windows, and those of the first.
    pub opens: bool,
}

impl Needs {
    /// Of runs from this start on the ground, where a run that does not go on from the recording's
    /// end has its problems made when it does not.
    pub fn of(config: &Config, start: Start) -> Self {
        Needs { start, opens: start == Start::Unknown || config.gate != Gate::None }
    }

    /// Of runs in flight, where all is there from the beginning.
    pub fn in_flight(config: &Config, start: Start) -> Self {
        let opens = start == Start::Auto || Needs::of(config, start).opens;
        Needs { start, opens }
    }

    /// Outputs in the window before the first step of whatever run.
    pub fn filled(self, history: &History, horizon: usize) -> usize {
        if self.opens { 0 } else { filled(history, self.start, horizon) }
    }

    /// As a plan says it.
    pub fn begin(self) -> Begin {
        match self.start {
            Start::Auto => Begin::Auto,
            Start::Unknown => Begin::Unknown,
            Start::State | Start::Recording => Begin::Known,
        }
    }
}

/// From how many deviations on an output is rejected, 0 for none, and why none is that might be.
pub(crate) fn gate(
    config: &Config,
    evidence: Option<&Calibration>,
) -> Result<(f64, Option<String>), Error> {
    let unknown = evidence.is_none_or(|own| own.rule == Rule::Exact);
    match config.gate {
        Gate::None => Ok((0.0, None)),
        Gate::Auto if unknown => {
            let why = "gate: no output is rejected, since the recording shows no noise and none is \
                stated: output_noise says how much there is";
            Ok((0.0, Some(why.into())))
        }
        Gate::At(k) if unknown => {
            let expected = "output_noise beside it, for a recording that shows no noise";
            Err(Error::value("gate", expected, k))
        }
        Gate::Auto => Ok((Gate::AUTO, None)),
        Gate::At(k) => Ok((k, None)),
    }
}
