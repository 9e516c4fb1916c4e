//! A prepared estimator as plain numbers: everything about a recording and its settings that a step
//! needs, and nothing that a step changes.
//!
//! A plan is one block of numbers for what all depths share ([`Common`]) and one for each depth
//! ([`Depth`]): where their arrays are follows from the sizes alone. As bytes these blocks stand
//! one behind the other, little-endian doubles throughout:
//!
//! | numbers | content |
//! |---|---|
//! | 32 | header: `ddmheplN`, format, length, CRC-32 of the rest, sizes, scalars |
//! | … | means and scales of the channels, weights, bounds, and the window of a new run |
//! | … | a block for each depth, ascending: its sizes, z_0, K, A, c, bounds, weight of the prior |
//! | … | the same for the first windows of a run from an unknown state, if it is to start there |
//!
//! so that they can be read where they are, in flash: [`Plan::from_bytes`] checks them and copies
//! nothing.

pub mod bytes;
pub mod common;
pub mod depth;
pub mod span;

pub use bytes::{Aligned, Plan, PlanError, seal};
pub use common::{Begin, Common, Limits, Margin, Shared, Sizes};
pub use depth::{Depth, Kind, kept_depths};
pub use span::Span;
