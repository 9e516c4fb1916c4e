//! The Rust programs in `examples` run; what they claim in words is asserted elsewhere.

#[path = "../../examples/1_first_estimate.rs"]
mod first_estimate;

#[path = "../../examples/2_bounds_and_missing_outputs.rs"]
mod bounds_and_missing_outputs;

#[path = "../../examples/3_plan_without_std.rs"]
mod plan_without_std;

#[test]
fn the_first_estimate() {
    first_estimate::main().unwrap();
}

#[test]
fn bounds_and_missing_outputs() {
    bounds_and_missing_outputs::main().unwrap();
}

#[test]
fn a_plan_without_std() {
    plan_without_std::main().unwrap();
}
