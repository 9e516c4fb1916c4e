//! Guaranteed intervals around the state of a system: arithmetic that rounds outward, zonotopes,
//! and an observer that carries them from sample to sample.
//!
//! # The problem
//! Of the system
//!
//! > x(k+1) = A x(k) + B u + f(x) + D1 w,  y = C x + r + D2 v,  Df(x) in \[J̲, J̄\]    (13), (14)
//!
//! the outputs y and inputs u are measured, and |w| ≤ w̄, |v| ≤ v̄, |x(0) - p₀| ≤ x̄₀ (17) is all
//! that is known of disturbance, noise and start. Wanted is a small box that holds x(k) whatever
//! these were. Equation numbers are those of "Interval Estimation for Bounded Jacobian Nonlinear
//! Systems by Zonotope Analysis", cited as the interval paper.
//!
//! # A tour
//! [`interval`] (arithmetic whose results hold the exact ones) → `rounding` (what sums and products
//! of floats lose) → [`Zonotope`] with `reduce` (fewer generators, [`Reduction`]), `membership` (is
//! a point in it?) and `strip` (what one output leaves of it) → [`observer`] ([`IntervalObserver`]:
//! a zonotope of the error, a level of its ellipsoid and a box of the state side by side).
//! [`tol`] holds every tolerance with its reason. [`blob`] is how objects become bytes, here and in
//! `ddmhe-core`, and [`Error`] what both say of a wrong input.
//!
//! | symbol | identifier | shape | equation |
//! |---|---|---|---|
//! | x̂ | `ErrorSet::center` | n | (19) |
//! | M: e in ⟨0, M⟩ | `ErrorSet::generators`, by columns | n × q | (45)-(50) |
//! | Ã = A - L C | `error_map` | n × n | (20) |
//! | √V̄ | `LevelSet::distance` | | (41) |
//! | P, L, λ, γ, μ_w, μ_v | [`observer::Gain`] | n × n, n × p | (41), (23) |
//!
//! # Example
//! ```
//! use ddmhe_interval::{IntervalObserver, Zonotope};
//! use ddmhe_interval::observer::{Gain, Options, Pendulum, System};
//! // the pendulum (60), its angle measured to ±0.001
//! let (h, none) = (0.065, f64::INFINITY);
//! let system = System {
//!     A: vec![1.0, h, 0.0, 1.0],
//!     C: vec![1.0, 0.0],
//!     D1: vec![1.0, 0.0, 0.0, 1.0],
//!     D2: vec![0.1],
//!     j_lo: vec![0.0, 0.0, -h, 0.0],
//!     j_hi: vec![0.0, 0.0, h, 0.0],
//!     w_radius: vec![0.006; 2],
//!     v_radius: vec![0.01],
//!     ..System::default()
//! };
//! let gain = Gain {
//!     L: vec![1.5029, 7.7372],
//!     P: vec![1.0, 0.0, 0.0, 1.0],
//!     lambda: 0.5,
//!     gamma: none, // no peak-to-peak bound: zonotope and box need none
//!     mu_w: none,
//!     mu_v: none,
//!     ..Gain::default()
//! };
//! let start = (&[0.98, 0.02], &[0.1, 1.0]);
//! let plant = Pendulum { gain: h };
//! let mut observer =
//!     IntervalObserver::new(plant, system, gain, start.0, start.1, Options::default())?;
//! let mut x = [1.0_f64, 0.0];
//! for _ in 0..50 {
//!     let y = x[0];
//!     x = [x[0] + h * x[1], x[1] - h * x[0].sin()];
//!     let bounds = observer.step(&[y], &[])?;
//!     assert!(bounds.predicted[0].contains(x[0]) && bounds.predicted[1].contains(x[1]));
//! }
//! # Ok::<(), ddmhe_interval::Error>(())
//! ```

#[cfg(feature = "serde")]
pub mod blob;
pub mod check;
pub mod error;
pub mod interval;
#[cfg(feature = "clarabel")]
mod membership;
pub mod observer;
pub mod programme;
mod reduce;
mod rounding;
mod strip;
pub mod tol;
mod zonotope;

pub use error::Error;
pub use interval::Interval;
pub use observer::{IntervalEstimate, IntervalObserver};
pub use reduce::Reduction;
pub use zonotope::Zonotope;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
