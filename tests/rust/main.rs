//! Tests of the public Rust interface, as an embedder uses it. One file a topic.
#![allow(clippy::unwrap_used, clippy::panic)]

mod allocation;
mod attack;
mod certificate;
mod examples;
mod hostile_plans;
mod inputs;
mod intervals;
mod linear;
mod no_std;
mod plan;
mod reset;
mod rigid;
mod snapshots;
mod space;
mod systems;
mod texts;
mod validation;
