//! `ddmhe.Zonotope` and what `ddmhe.interval.IntervalObserver` is made of.

mod dynamics;
mod ends;
mod estimate;
mod log;
mod observer;
mod operation;
mod zonotope;

pub use dynamics::Dynamics;
pub use estimate::IntervalEstimate;
pub use log::IntervalLog;
pub use observer::ObserverCore;
pub use operation::interval_operation;
pub use zonotope::Zonotope;
