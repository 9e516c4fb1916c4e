//! Data-driven moving horizon estimation (Dd-MHE): the state of a system from its outputs and one
//! recording, with no model.
//!
//! # The problem
//! A system x(t+1) = A x(t) + e + w(t), y(t) = C x(t) + r + v(t) with A, e, C, r unknown was once
//! recorded: states x\[-T..0\] and outputs y\[-T..-1\]. From then on only outputs are measured. By
//! Willems' fundamental lemma every window of the noise-free system is a combination α of recorded
//! windows with 1ᵀα = 1, so at each time t the estimator solves, over α, x̂ and v̂ and with M_t =
//! min(t, M),
//!
//! > minimise 2 ρ^{M_t} ‖x̂(t-M_t) - x̄(t-M_t)‖² + Σ_{j=1..M_t} ρ^{j-1} μ ‖v̂(t-j)‖²    (17)
//! >
//! > subject to \[H_{M_t}(y); H_{M_t+1}(x); 1ᵀ\] α = \[y_window - v̂; x̂_window; 1\]    (16b)
//! >
//! > x̂ ∈ X, v̂ ∈ V    (16c, 16d)
//!
//! and returns x̂(t). The prior x̄ is the estimate made M_t steps ago. Equation numbers are those
//! of X. Liu, H. Chang, F. Hui, Z. Lu, Y. Zhang, P. Huang, "Data-driven Moving Horizon Estimation
//! for Angular Velocity of Space Noncooperative Target in Electromagnetic De-tumbling Mission",
//! arXiv 2301.05351v3, cited as Liu 2026.
//!
//! # A tour
//! Data flow from the recording to the estimate, one noun a module: `history` ([`History`]) →
//! `hankel` ([`BlockHankel`]), `excitation` (rank condition (7)) → [`space`] ([`TrajectorySpace`]:
//! (16b) as mean + basis) → `reduction` (one QR: a least-distance problem) → `plan_builder` (the
//! numbers of one depth, as a step reads them) → `mhe` ([`DdMhe`]: Algorithm 1) → `estimate`
//! ([`Estimate`]). What is computed at construction is a `design`, which copies of an estimator
//! share, and what changes from step to step a `run`; `many` runs them on all cores. A step itself
//! is the crate [`ddmhe_run`], which needs neither this one nor the standard library:
//! [`DdMhe::plan`] makes bytes for it.
//!
//! [`Certificate`] replaces the scalar weights by matrices for which the error is known to shrink,
//! and `error_bound` bounds it step by step. What [`ddmhe_run`] is not certain of, `way_out`
//! decides: it checks what the solver of `qp` proposes. `watch` looks at single
//! channels: at rest in the recording, or an angle that jumps by a turn. [`defaults`] is the rule
//! for settings that are not given; [`tol`] holds every tolerance with its reason.
//!
//! The second method, a guaranteed interval around a state, is the crate `ddmhe-interval`, whose
//! names are re-exported here: [`interval`], [`Zonotope`], [`observer`] ([`IntervalObserver`]).
//!
//! # Notation
//! m = M_t outputs in the window, N windows of the recording, d = (m+1) n + m p rows of a window, r
//! directions kept. "Scaled": in units of each channel's [scale](Scaling), deviations from the
//! recording's mean.
//!
//! | symbol | identifier | shape | unit | equation |
//! |---|---|---|---|---|
//! | x̂(t-m) … x̂(t) | [`Estimate::window`], its end [`Estimate::x`] | (m+1)·n | of x | (16c) |
//! | v̂(t-m) … v̂(t-1) | [`Estimate::v`] | m·p | of y | (16d) |
//! | x̄(t-m) | [`Data::prior`] | n | scaled | (17) |
//! | ρ, μ | [`Config::rho`], [`Config::mu`] | | none, (of x / of y)² | (17) |
//! | P, R, η: in the place of I, μ I, ρ | [`Certificate`] | n × n, p × p | | (17) |
//! | stacked Hankel matrices | `WindowStack::rows`, transposed | N × (1+d) | scaled | (16b) |
//! | c, B: w = c + B b for every window w | [`TrajectorySpace`] | d, d × r | scaled | (16b) |
//! | λ on ‖a‖² | [`TrajectorySpace`]: lambda | | none | none |
//! | F, G: weighted rows that the cost sees | `reduction` | (n+m p) × r, r × r | | (17) |
//! | K: z* = K (\[x̄; y\] - c) | `reduction::Reduced` | r × (n+m p) | | (16), (17) |
//! | A: w = c + A z | `reduction::Reduced` | d × r | | (16b) |
//! | z*, z: without and with bounds | [`Scratch`]: unconstrained, z | r | | (16) |
//!
//! [`Data::prior`]: ddmhe_run::problem::Data::prior
//! [`Scratch`]: ddmhe_run::problem::Scratch
//!
//! # Features
//! All are on by default. What is lost without each:
//!
//! - `clarabel`: the last opinion where the active-set method is not certain: of windows whose
//!   bounds almost contradict each other, some are then [`Status::Failed`] for which Clarabel finds
//!   the point, or the proof that there is none. [`Zonotope`] has no `contains`.
//! - `rayon`: cores. [`run_many`], [`run_copies`], [`run_recordings`] and [`validation`] do one
//!   after the other, with the same numbers.
//! - `serde`: `Serialize` and `Deserialize` of [`Config`], [`History`], [`Estimate`] and their
//!   parts; the module `snapshot`, all objects as bytes. Plans ([`DdMhe::plan`]) stay.
//!
//! A [`Config`] that is read has the defaults for what is left out, and an error for a name that it
//! does not know; a [`History`] is checked like one that is made. Estimates hold NaN where nothing
//! was measured, which JSON has not.
//!
//! # Example
//! ```
//! use ddmhe_core::{Config, DdMhe, History};
//! // x(t+1) = 0.9 x(t) + 1, y = 2 x: recorded from x = 0, then watched from x = 5 through y alone
//! let simulate = |start: f64, steps: usize| {
//!     let next = |x: &f64| Some(0.9 * x + 1.0);
//!     let x: Vec<f64> = std::iter::successors(Some(start), next).take(steps + 1).collect();
//!     let y: Vec<f64> = x[..steps].iter().map(|x| 2.0 * x).collect();
//!     (x, y)
//! };
//! let (x, y) = simulate(0.0, 30);
//! let history = History::new(1, 1, &x, &y, 0.1)?;
//! let (truth, outputs) = simulate(5.0, 20);
//! let mut mhe = DdMhe::new(&history, Config { x_prior: Some(vec![5.0]), ..Config::default() })?;
//! for (t, y) in outputs.iter().enumerate() {
//!     let estimate = mhe.step(&[*y])?; // x̂(t+1)
//!     assert!((estimate.x[0] - truth[t + 1]).abs() < 1e-9);
//! }
//! # Ok::<(), ddmhe_core::Error>(())
//! ```
//!
//! `Err` means that an input was wrong; what the optimisation found is [`Estimate::status`].

mod accessors;
mod block;
mod certificate;
mod challenge;
mod choices;
mod config;
mod config_checks;
mod covariance;
pub mod defaults;
mod depths;
mod design;
mod doubts;
mod driving;
mod error_bound;
mod estimate;
mod evidence;
mod excitation;
mod extended;
mod fallback;
mod filter;
mod first_window;
mod hankel;
mod history;
mod inputs;
mod interrupt;
mod linear_model;
mod magnitude;
mod many;
mod mhe;
mod needs;
mod own;
mod plan_builder;
mod process_noise;
mod qp;
mod recorded_default;
mod recorded_noise;
mod reduction;
mod remarks;
mod response;
mod riccati;
pub mod rigid;
mod row;
mod run;
#[cfg(feature = "serde")]
mod saved;
mod scaling;
#[cfg(feature = "serde")]
pub mod snapshot;
mod soft;
pub mod space;
mod start;
mod surplus;
pub mod tol;
mod units;
pub mod validation;
mod variation;
mod watch;
mod way_out;
mod weights;
mod why;

use ddmhe_interval::{check, error};

pub use ddmhe_interval::{
    Error, Interval, IntervalEstimate, IntervalObserver, Reduction, Zonotope, interval, observer,
};
pub use ddmhe_run::{Reasons, Status};

pub use certificate::{Certificate, Disturbance, Model, Uncertainty, minimum_horizon};
pub use config::{
    Bounds, Center, Config, Equilibrium, Gate, ProcessNoise, Settings, Start, Stuck, Weighting,
};
pub use estimate::{Estimate, Evidence, EvidenceKind, EvidenceLog, Log};
pub use excitation::RankReport;
pub use hankel::BlockHankel;
pub use history::History;
pub use interrupt::Interrupt;
pub use many::{run_copies, run_many, run_recordings};
pub use mhe::{DdMhe, Signals, Step};
pub use rigid::RigidBodyMhe;
pub use scaling::Scaling;
pub use soft::Soft;
pub use space::{Space, TrajectorySpace};
pub use variation::noise_levels;
pub use watch::wrapped_angle;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
