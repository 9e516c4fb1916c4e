//! A tumbling rigid body that is braked by eddy currents, estimated from a torque: Euler's equation
//! is all that is known beforehand, everything else is taken from the recording.
//!
//! # The motion
//! > J ω̇ = -g N S Nᵀ ω - ω × J ω,  y = g G Nᵀ ω + r,  N = N0 - b0 βᵀ
//!
//! Drag and torque share their kernel b = b0 + N0 β: Nᵀb = 0 for every β. g is 1, or with a cubic
//! part 1 + γ |ω|²/W². The scale of J cannot be seen: tr J = 3.
//!
//! | symbol | identifier | shape | unit |
//! |---|---|---|---|
//! | ω | `w` | 3 | rad/s |
//! | z = (ω, θ), θ = (j, β, S, γ, G, r, γ) | `z`, see [`layout`] | N = 15 + 3 p | |
//! | J = I + Σ j_k E_k | [`small::inertia`] | 3 × 3 | none |
//! | b0, N0 | [`Body`] | 3, 3 × 2 | none |
//! | sd: the prior of θ is N(0, sd²) | [`motion::Given::spread`] | N | |
//! | W: rms of the recorded ω | [`motion::Given::W`] | | rad/s |
//! | P | [`Filter::P`] | N × N | |
//! | χ of states, outputs, and of both in means over ten | [`Misfit`] | 4 | none |
//! | R, q: stacked whitened Jacobian and residual | [`factor::Factor`] | N × N, N | |
//!
//! # A tour
//! [`motion`] (samples, with their derivatives) ← [`body`], [`field`] (in a known field), [`lag`]
//! (seen by sensors that lag) ·
//! [`pass`] (the cost of z over all [`data`] or their [`means`], and its [`factor`]; `earlier`
//! recordings' own unknowns are eliminated) → [`fit`] (Levenberg and Marquardt) → [`posterior`] →
//! [`filter`] (one sample, from there on) → [`mixture`] (up to four of them) · [`anchoring`] (fits
//! to all data since) → [`stepper`] (both together).
//!
//! All of it has a fixed size, and nothing is allocated. There is room for P outputs, 1 to 6, and N
//! is the number of unknowns, [`layout::unknowns`]`(P)`. Fewer outputs p come first; the others are
//! never measured: they are NaN with infinite noise, see [`layout::outputs`]. Estimates are as with
//! P = p.

pub mod anchoring;
pub mod body;
pub mod data;
pub mod earlier;
pub mod factor;
pub mod field;
pub mod filter;
pub mod fit;
pub mod lag;
pub mod layout;
pub mod means;
pub mod mixture;
pub mod motion;
pub mod pass;
pub mod posterior;
pub mod small;
pub mod start;
pub mod stepper;

pub use anchoring::Anchoring;
pub use body::Body;
pub use data::Data;
pub use earlier::{Earlier, Firsts};
pub use field::{Field, FieldBody};
pub use filter::{Filter, Innovation, Limits};
pub use fit::Fit;
pub use lag::LaggedBody;
pub use means::{Mean, MeanRate, Means};
pub use mixture::{Member, Mixture};
pub use motion::Motion;
pub use posterior::{Misfit, Posterior};
pub use start::Start;
pub use stepper::{Refit, Stepper};
