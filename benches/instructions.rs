//! Steps to be counted by callgrind, which collects inside of [`steps`] alone: see instructions.py.

#![allow(clippy::print_stdout)]

mod data;

use data::{config, recorded, within};
use ddmhe_core::{Config, DdMhe, Space};

const STEPS: usize = 500;

/// The steps that are counted.
#[inline(never)]
fn steps(mhe: &mut DdMhe, outputs: &[f64]) -> f64 {
    outputs.chunks_exact(3).map(|y| mhe.step(y).map_or(f64::NAN, |estimate| estimate.x[0])).sum()
}

fn main() {
    let regime = std::env::args().nth(1).unwrap_or_default();
    let (history, mut outputs) = recorded(3, 200, 100 + STEPS);
    let case = |M: usize, r: usize| config(M, Space::Truncated { rank: Some(r), tol: None });
    let wide =
        |config: Config| Config { x_bounds: within(1e3, 3), v_bounds: within(1e3, 3), ..config };
    // of one unit, so on one scale: the active bounds are then those that the baseline was counted
    // with
    let history = history.with_units(&["m"; 3], &["m"; 3]).expect("units fit");
    let config = match regime.as_str() {
        "free-10-5" => wide(case(10, 5)),
        "free-50-20" => wide(case(50, 20)),
        "judged-10-5" => Config { evidence: true, ..wide(case(10, 5)) },
        "judged-50-20" => Config { evidence: true, ..wide(case(50, 20)) },
        "active-20-20" => Config { v_bounds: within(0.055, 3), ..case(20, 20) },
        "missing-20-5" => {
            (0..outputs.len()).step_by(29).for_each(|k| outputs[k] = f64::NAN);
            wide(case(20, 5))
        }
        _ => unreachable!("a regime of instructions.json is the argument"),
    };
    let mut mhe = DdMhe::new(&history, config).expect("valid settings");
    mhe.run(&outputs[..300]).expect("outputs fit");
    println!("{STEPS} steps, sum {}", steps(&mut mhe, &outputs[300..]));
}
