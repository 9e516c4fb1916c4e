//! A tumbling rigid body: what is prepared on the ground for [`ddmhe_run::rigid`].
//!
//! `config` (settings) → `recording` (its noise, and where fits begin) → `choice` (of a `family`,
//! which motion made it: a rigid body, one with cubic drag, or the `affine` one) → `ground` (all
//! that a recording determines) → `online` (a run with p outputs; `later` is what it has measured
//! since) → `mhe` ([`RigidBodyMhe`]). `report` says what is known of the body, `saved` is a run as
//! bytes.

mod affine;
mod choice;
mod config;
mod ends;
mod family;
mod field;
mod ground;
mod lag;
mod later;
mod made;
mod measured;
mod mhe;
mod online;
mod recorded_means;
mod recording;
mod report;
#[cfg(feature = "serde")]
mod saved;
mod suspicion;
mod warnings;
mod wide;

pub use config::{KnownField, Refits, RigidConfig};
pub use measured::Measured;
pub use mhe::RigidBodyMhe;
pub use report::{Optimum, Report};
