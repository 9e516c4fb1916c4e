//! The Rust programs in `examples` run; what they claim in words is asserted elsewhere.

#[path = "../../examples/1_first_estimate.rs"]
mod first_estimate;

#[path = "../../examples/2_bounds_and_missing_outputs.rs"]
mod bounds_and_missing_outputs;

#[test]
fn the_first_estimate() {
    first_estimate::main().unwrap();
}

#[test]
fn bounds_and_missing_outputs() {
    bounds_and_missing_outputs::main().unwrap();
}
