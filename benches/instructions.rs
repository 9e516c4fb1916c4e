//! Steps to be counted by callgrind, which collects inside of [`steps`] and [`log`] alone: see
//! instructions.py.

#![allow(clippy::print_stdout)]

mod data;
mod floor;

use data::{config, pushed, recorded, within};
use ddmhe_core::{Config, DdMhe, Signals, Space, Step, Weighting};
use floor::Floor;

const STEPS: usize = 500;

/// The steps that are counted.
#[inline(never)]
fn steps(mhe: &mut DdMhe, Signals { y, u }: Signals<'_>) -> f64 {
    let (p, m) = (mhe.p(), u.len() / STEPS);
    let estimates = y.chunks_exact(p).enumerate().map(|(k, y)| {
        let u = &u[k * m..(k + 1) * m];
        mhe.step_with(Step { y, u, x_bounds: None }).map_or(f64::NAN, |estimate| estimate.x[0])
    });
    estimates.sum()
}

/// The same as a log.
#[inline(never)]
fn log(mhe: &mut DdMhe, signals: Signals<'_>) -> f64 {
    mhe.run_until(signals, &mut || false).map_or(f64::NAN, |log| log.cost.iter().sum())
}

/// What these cannot spare.
#[inline(never)]
fn floors(floor: &mut Floor, y: &[f64], p: usize) -> f64 {
    y.chunks_exact(p).map(|y| floor.step(y).unwrap_or(f64::NAN)).sum()
}

/// An estimator and its log.
struct Case {
    mhe: DdMhe,
    y: Vec<f64>,
    u: Vec<f64>,
}

fn space(rank: usize) -> Space {
    Space::Truncated { rank: Some(rank), tol: None }
}

/// Without inputs.
fn free(regime: &str) -> Case {
    let n = if regime == "free-20-3" { 1 } else { 3 };
    let (history, mut y) = recorded(n, 200, 100 + STEPS);
    let case = |M: usize, r: usize| config(M, space(r));
    let wide =
        |config: Config| Config { x_bounds: within(1e3, n), v_bounds: within(1e3, n), ..config };
    // of one unit, so on one scale: the active bounds are then those that the baseline was counted
    // with
    let history = history.with_units(&["m"; 3][..n], &["m"; 3][..n]).expect("units fit");
    let config = match regime {
        "free-10-5" => wide(case(10, 5)),
        "free-20-3" => wide(case(20, 3)), // n = p = 1
        "free-50-20" => wide(case(50, 20)),
        "judged-10-5" => Config { evidence: true, ..wide(case(10, 5)) },
        "judged-50-20" => Config { evidence: true, ..wide(case(50, 20)) },
        "active-20-20" => Config { v_bounds: within(0.055, 3), ..case(20, 20) },
        "missing-20-5" => {
            (0..y.len()).step_by(29).for_each(|k| y[k] = f64::NAN);
            wide(case(20, 5))
        }
        _ => unreachable!("a regime of instructions.json is the argument"),
    };
    Case { mhe: DdMhe::new(&history, config).expect("valid settings"), y, u: Vec::new() }
}

/// n = 3, p = 2, m = 2, M = 20: with the weights of the recording, or with known inputs whose
/// response takes one instant or two, beside the same outputs without inputs.
fn driven(regime: &str) -> Case {
    let hidden = regime.starts_with("two-instants");
    let data::Pushed { history, y, u } = pushed(if hidden { 4 } else { 3 }, 100 + STEPS);
    let free = regime.starts_with("no-input");
    let history = if free { history.without_inputs() } else { history };
    let rank = regime.rsplit('-').next().and_then(|rank| rank.parse().ok());
    let given = Config { horizon: Some(20), evidence: false, ..Config::default() };
    let config = match rank {
        None => Config { weights: Weighting::Recorded, ..given },
        Some(rank) => Config { space: space(rank), ..given },
    };
    let mhe = DdMhe::new(&history, config).expect("valid settings");
    Case { mhe, y, u: if free { Vec::new() } else { u } }
}

/// The floor of a regime without inputs.
fn count_floor(regime: &str) {
    let (n, M, r) = match regime {
        "floor-20-3" => (1, 20, 3),
        "floor-10-5" => (3, 10, 5),
        _ => (3, 50, 20),
    };
    let (mut floor, (_, y)) = (Floor::new(n, M, r), recorded(n, 200, STEPS));
    println!("{STEPS} floors, sum {}", floors(&mut floor, &y, n));
}

fn main() {
    let regime = std::env::args().nth(1).unwrap_or_default();
    if regime.starts_with("floor") {
        return count_floor(&regime);
    }
    let as_log = regime.ends_with("alone");
    let inputs = ["no-input", "one-instant", "two-instants"];
    let of_inputs = inputs.iter().any(|kind| regime.starts_with(kind));
    let Case { mut mhe, y, u } = if of_inputs { driven(&regime) } else { free(&regime) };
    let (p, m) = (mhe.p(), mhe.history().m());
    let warm = y.len() / p - STEPS;
    let (first, y) = y.split_at(warm * p);
    let (before, u) = u.split_at(warm * m);
    let whole = Signals { y: first, u: before };
    mhe.run_until(whole, &mut || false).expect("a log fits");
    let counted = Signals { y, u };
    let sum = if as_log { log(&mut mhe, counted) } else { steps(&mut mhe, counted) };
    println!("{STEPS} steps, sum {sum}");
}
