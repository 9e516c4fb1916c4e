//! What the fuzz targets and the property tests share: an estimator with its recording and outputs
//! made of bytes, and what must hold of it whatever they are.

pub mod case;
pub mod check;
pub mod flight;
pub mod sealed;
pub mod source;
