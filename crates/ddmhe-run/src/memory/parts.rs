//! What a step reads and works in.

use crate::active_set::working_set::WorkingSet;
use crate::kalman::Filtered;
use crate::problem::Scratch;

/// A memory, part by part.
#[derive(Debug)]
pub struct Parts<'a> {
    /// x̄(t-m) (n), as scaled deviations.
    pub prior: &'a [f64],
    /// y(t-m) … y(t-1) (m·p), NaN where not measured; without their forced motion.
    pub outputs: &'a [f64],
    /// Means of the states with the forced motion, where there are inputs.
    pub means: Option<&'a [f64]>,
    /// Whether there is a NaN among them.
    pub missing: bool,
    /// The window as a filter has it, with the weights of the recording.
    pub filtered: Option<Filtered<'a>>,
    /// What the weight of the prior lacks.
    pub lacking: Option<&'a [f64]>,
    /// Room for a step.
    pub scratch: Scratch<'a>,
    /// The active bounds of the last step.
    pub working: WorkingSet<'a>,
}
