//! Whatever an estimator or an interval observer is given: an error or numbers, and the same
//! numbers on every way to them. The estimator's cases are those of `tests/fuzz`, made of bytes.

mod faults;
mod observer;
mod soak;

#[path = "../../fuzz/src/case.rs"]
mod case;
#[path = "../../fuzz/src/check.rs"]
mod check;
#[path = "../../fuzz/src/source.rs"]
mod source;

use case::Case;
use check::{Outcomes, everything};
use ddmhe_core::DdMhe;
use ddmhe_run::Plan;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;
use std::time::{Duration, Instant};

/// No case is given more: one takes a hundredth of a second, some a hundred steps of a solver.
const ENDLESS: Duration = Duration::from_secs(600);

fn timed(case: &Case) -> Outcomes {
    let begun = Instant::now();
    let found = everything(case);
    assert!(begun.elapsed() < ENDLESS, "{:?}", begun.elapsed());
    found
}

proptest! {
    #![proptest_config(ProptestConfig {
        failure_persistence: None,
        ..ProptestConfig::with_cases(200)
    })]

    /// No panic, no hang, finite estimates; a log is run as it is stepped, a snapshot and a copy go
    /// on with the same bits, a plan flies with them, and a reset estimator is a new one.
    #[test]
    fn estimators_keep_their_promises(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        timed(&Case::new(&bytes));
    }
}

/// Cases that once broke a promise.
#[test]
fn what_was_found_stays_mended() {
    timed(&Case::new(include_bytes!("found/start-after-a-failed-window.bin")));
    timed(&Case::new(include_bytes!("found/replay-of-a-lost-output.bin")));
    timed(&Case::new(include_bytes!("found/saved-before-the-window-was-new.bin")));
}

/// `CASE=FILE cargo test --release one_case -- --ignored --nocapture`: what a fuzzer left.
#[test]
#[ignore = "of a file"]
#[allow(clippy::print_stdout)]
fn one_case() {
    let bytes = std::fs::read(std::env::var("CASE").unwrap()).unwrap();
    let case = Case::new(&bytes);
    println!("{case:#?}");
    println!("{:?}", timed(&case));
}

/// The same at random until so many steps were asked for, with the counts of what came of them.
fn hostile_calls(least: usize, seed: u64) -> (usize, Outcomes) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut calls, mut sum) = (0, Outcomes::default());
    while calls < least {
        let bytes: Vec<u8> = (0..rng.random_range(40..400)).map(|_| rng.random()).collect();
        let case = Case::new(&bytes);
        let found = std::panic::catch_unwind(|| timed(&case));
        let Ok(found) = found else { panic!("these bytes: {bytes:?}") };
        // a recording's round trip and the estimator; then each sample is stepped on five ways
        let taken: usize = found.steps.iter().sum();
        calls += 3 + 5 * taken + found.rejected + found.flown;
        sum = sum.plus(found);
    }
    (calls, sum)
}

#[test]
#[ignore = "long"]
#[allow(clippy::print_stdout)]
fn long_a_million_hostile_calls() {
    let (calls, sum) = hostile_calls(1_000_000, 1);
    let [optimal, almost, infeasible, failed] = sum.steps;
    println!(
        "{calls} calls: {} estimators made, {} refused; steps: {optimal} optimal, {almost} almost \
         optimal, {infeasible} infeasible, {failed} failed, {} refused; {} of them flown from a \
         plan; no panic, nothing that is not finite",
        sum.made, sum.refused, sum.rejected, sum.flown
    );
    assert!(optimal > 10_000 && infeasible > 100 && failed > 100 && sum.rejected > 1000);
    assert!(sum.refused > 1000 && sum.made > 1000 && sum.flown > 10_000);
}

const CORPUS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/fuzz/corpus");

fn corpus(folder: &str) -> Vec<Vec<u8>> {
    let files = std::fs::read_dir(Path::new(CORPUS).join(folder)).unwrap();
    files.map(|file| std::fs::read(file.unwrap().path()).unwrap()).collect()
}

/// A fuzzer that starts from bytes of an earlier format tries refusals alone; if this fails, write
/// the corpus anew: `cargo test --release write_the_corpus -- --ignored`.
#[test]
fn what_the_fuzzers_start_from_is_read() {
    let (snapshots, plans) = (corpus("snapshot"), corpus("plan"));
    assert!(snapshots.len() > 8 && plans.len() > 8);
    for bytes in snapshots {
        assert!(DdMhe::restore(&bytes).is_ok());
    }
    for bytes in plans {
        let mut room = vec![0_u8; bytes.len() + 8];
        let first = room.as_ptr().align_offset(8);
        room[first..first + bytes.len()].copy_from_slice(&bytes);
        assert!(Plan::from_bytes(&room[first..first + bytes.len()]).is_ok());
    }
}

/// Writes `tests/fuzz/corpus`: one case of each kind of problem, with its snapshot and its plan.
#[test]
#[ignore = "writes"]
fn write_the_corpus() {
    let to = Path::new(CORPUS);
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut seen = Vec::new();
    for folder in ["history", "snapshot", "plan"] {
        std::fs::remove_dir_all(to.join(folder)).unwrap(); // of an earlier format
    }
    for _ in 0..4000 {
        let bytes: Vec<u8> = (0..96).map(|_| rng.random()).collect();
        let case = Case::new(&bytes);
        let c = &case.config;
        let Ok(mhe) = case.history().and_then(|h| DdMhe::new(&h, c.clone())) else {
            continue;
        };
        let bounded = [&c.x_bounds, &c.v_bounds, &c.w_bounds].map(Option::is_some);
        let driven = mhe.settings().process_noise != ddmhe_core::ProcessNoise::None;
        let gated = c.gate != ddmhe_core::Gate::None;
        let kind =
            (bounded, driven, c.certificate.is_some(), c.soft.is_some(), gated, case.sizes[2]);
        let (snapshot, plan) = (mhe.snapshot(), mhe.plan().unwrap_or_default());
        if seen.contains(&kind) || snapshot.len() > 2000 || plan.len() > 16_000 {
            continue;
        }
        seen.push(kind);
        let name = format!("{:02}", seen.len());
        let files = [("history", bytes), ("snapshot", snapshot), ("plan", plan)];
        for (folder, bytes) in files.into_iter().filter(|(_, bytes)| !bytes.is_empty()) {
            std::fs::create_dir_all(to.join(folder)).unwrap();
            std::fs::write(to.join(folder).join(&name), bytes).unwrap();
        }
    }
    assert!(seen.len() > 8);
}
