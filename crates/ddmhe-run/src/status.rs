//! What a step says of its own answer.

/// What the optimisation found. Each is a statement about the numbers that were handed out, checked
/// whichever solver they came from; a deviation is the channel's own standard deviation over the
/// recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Status {
    /// The minimiser: every bound holds to 1e-9 deviations, and so do the optimality conditions,
    /// relative to the distance from the unconstrained minimiser (or from the recording's mean
    /// window, if that is larger). A soft bound holds up to what is paid for.
    Optimal,
    /// Every bound holds to 1e-6 deviations, and the optimality conditions to 1e-4 on the same
    /// scale.
    AlmostOptimal,
    /// No window satisfies all bounds, not even if each is exceeded by 1e-9 deviations: a
    /// combination of bounds proves it of all windows up to a million times as far from the mean as
    /// these bounds, with rows known to 1e-12.
    Infeasible,
    /// None of these could be shown, or an output was one that cannot be computed with. Also what
    /// nothing has been found for yet. What is handed out then, and after `Infeasible`, is
    /// described at [`Stepper::step`](crate::Stepper::step).
    #[default]
    Failed,
    /// Of a rigid body: its motion explains the data.
    Structured,
    /// Of a rigid body: its motion and the data disagree, and its parameters wander.
    Adapting,
    /// Of a rigid body: no such motion explains the data, and the affine estimator took over.
    Affine,
}

impl Status {
    /// All of them, each at the place of its [`code`](Self::code).
    const ALL: [Status; 7] = [
        Status::Optimal,
        Status::AlmostOptimal,
        Status::Infeasible,
        Status::Failed,
        Status::Structured,
        Status::Adapting,
        Status::Affine,
    ];

    /// A number for what is saved or sent.
    pub fn code(self) -> u32 {
        self as u32
    }

    /// The status of a [`code`](Self::code).
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.get(code as usize).copied()
    }

    /// The status as the word that users see.
    pub fn as_str(self) -> &'static str {
        match self {
            Status::Optimal => "optimal",
            Status::AlmostOptimal => "almost_optimal",
            Status::Infeasible => "infeasible",
            Status::Failed => "failed",
            Status::Structured => "structured",
            Status::Adapting => "adapting",
            Status::Affine => "affine",
        }
    }
}
