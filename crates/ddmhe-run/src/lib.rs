//! A prepared data-driven moving horizon estimator, step by step: no standard library, no
//! allocation, no solver.
//!
//! # The problem
//! At each time t, over the windows w = c + B b that a recording allows and with M_t outputs in the
//! window,
//!
//! > minimise 2 ρ^{M_t} ‖x̂(t-M_t) - x̄(t-M_t)‖² + Σ_{j=1..M_t} ρ^{j-1} μ ‖v̂(t-j)‖²    (17)
//! >
//! > subject to w a combination of recorded windows    (16b)
//! >
//! > x̂ ∈ X, v̂ ∈ V    (16c, 16d)
//!
//! (bounds may also be left, at a [price](prices)), and return x̂(t). Equation numbers are those of
//! X. Liu et al., "Data-driven Moving Horizon Estimation for Angular Velocity of Space
//! Noncooperative Target in Electromagnetic De-tumbling Mission", arXiv 2301.05351v3, cited as Liu
//! 2026. What depends on the recording and the settings alone is computed on the ground, by
//!       `ddmhe-core`, and comes here as a [`Plan`]: plain numbers,
//! which may lie in flash. A [`Stepper`] runs it.
//!
//! # Notation
//! m = M_t outputs in the window, r directions. "Scaled": in units of each channel's scale,
//! deviations from the recording's mean.
//!
//! | symbol | identifier | shape | unit | equation |
//! |---|---|---|---|---|
//! | x̂(t-m) … x̂(t) | [`Estimate::window`] | (m+1)·n | of x | (16c) |
//! | v̂(t-m) … v̂(t-1) | [`Estimate::v`] | m·p | of y | (16d) |
//! | x̄(t-m) | [`problem::Data::prior`] | n | scaled | (17) |
//! | z_0, K: z* = z_0 + K \[x̄; y\] | [`plan::Depth`]: z_0, gain | r, r × (n+m p) | scaled | (17) |
//! | c, A: w = c + A z | [`plan::Depth`]: offset, window | rows, rows × r | | (16b) |
//! | z*, z | [`problem::Scratch`]: unconstrained, z | r | | (16) |
//! | 2ρ^m P, R | [`plan::Depth`]: prior; [`plan::Common`]: R | n × n, p × p | scaled | (17) |
//!
//! # Embedding
//! The ground writes `DdMhe::plan()` of `ddmhe-core` to a file. The firmware depends on this crate
//! with default features (without `std`), and holds the plan where doubles can be read, and as many
//! numbers as [`Stepper::room`] says of it:
//!
//! ```ignore
//! static PLAN: Aligned<[u8; include_bytes!("plan").len()]> = Aligned(*include_bytes!("plan"));
//!
//! let plan = Plan::from_bytes(&PLAN.0)?; // checked once, never copied
//! let mut memory = [0.0; ROOM]; // on the stack, or wherever it may lie
//! let mut stepper = Stepper::new(&plan, &mut memory)?;
//! loop {
//!     let estimate = stepper.step(&measure()); // NaN: not measured
//! }
//! ```
//!
//! Estimates are those of the estimator on the ground, bit for bit, wherever this crate alone finds
//! them: see [`Stepper`]. `tests/no_std` of the repository is such a program, linked without std
//! and run by the tests, and `tests/rust/no_std.rs` shows by its symbols that it asks for no
//! allocator. It depends on three crates, all without std: bytemuck, crc32fast and libm.
//!
//! # A tour
//! [`layout`] (where a row is) → [`plan`] (the numbers) → [`problem`] (one window's) → `at_once`
//! (Eq. (16) for it where nothing is lost and no bound was active) → `window` (for any, with
//! `bounds`, `cost` and [`reweight`]: outputs that are lost) → [`active_set`] (active bounds, and
//! those that are left) → [`memory`] (the sliding window) →
//! [`stepper`] (Algorithm 1). [`panels`] are the products, [`tol`] every tolerance. [`fallback`] is
//! where a ground station's solver comes in.

#![no_std]

#[cfg(feature = "std")]
extern crate std;

pub mod active_set;
pub mod alone;
mod at_once;
mod beginning;
mod bounds;
mod cost;
mod estimate;
pub mod evidence;
pub mod fallback;
pub mod flight;
pub mod gating;
pub mod judging;
pub mod kalman;
pub mod layout;
mod look_ahead;
pub mod memory;
pub mod panels;
mod plain;
pub mod plan;
pub mod prices;
pub mod problem;
pub mod response;
pub mod reweight;
pub mod rigid;
mod sensitivity;
mod sliding;
mod soft;
mod status;
pub mod stepper;
pub mod tol;
mod window;

pub use estimate::Estimate;
pub use evidence::{Evidence, Reasons};
pub use fallback::{Alone, Fallback};
pub use flight::Stepper;
pub use layout::Layout;
pub use memory::Memory;
pub use plan::{Aligned, Plan, PlanError};
pub use prices::Prices;
pub use status::Status;
