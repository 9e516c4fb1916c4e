//! A reset estimator is a new one, bit for bit, whatever came before; a copy and a restored one go
//! on as the original does.

use crate::systems::{modes, noise, unit_certificate};
use ddmhe_core::{
    Bounds, Center, Config, DdMhe, Disturbance, Gate, History, Soft, Space, Start, Step, Stuck,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const DEPTH: usize = 9;

fn within(size: f64, width: usize) -> Option<Bounds> {
    Some(Bounds { lo: vec![-size; width], hi: vec![size; width] })
}

/// Every kind of state that a running estimator has.
fn configs() -> Vec<Config> {
    let plain =
        Config { horizon: Some(DEPTH), rho: Some(0.9), mu: Some(10.0), ..Config::default() };
    let certificate = unit_certificate(4, 3, 0.8);
    let disturbance = Some(Disturbance { initial: 1.0, w: 0.01, v: 0.1 });
    vec![
        plain.clone(),
        Config { x_bounds: within(2.0, 4), v_bounds: within(0.1, 3), ..plain.clone() },
        Config { x_bounds: within(0.05, 4), x_center: Center::History, ..plain.clone() },
        Config { soft: Some(Soft::all(1.0)), x_bounds: within(0.3, 4), ..plain.clone() },
        Config { v_bounds: within(0.05, 3), start: Start::Recording, ..plain.clone() },
        Config {
            v_bounds: within(0.05, 3),
            x_bounds: within(2.0, 4),
            start: Start::Unknown,
            ..plain.clone()
        },
        Config {
            space: Space::Truncated { rank: Some(6), tol: None },
            v_bounds: within(0.08, 3),
            ..plain.clone()
        },
        Config {
            rho: None,
            mu: None,
            certificate: Some(certificate),
            disturbance,
            v_bounds: within(0.1, 3),
            ..plain.clone()
        },
        Config {
            gate: Gate::At(3.0),
            stuck: Stuck::Missing,
            start: Start::Recording,
            ..plain.clone()
        },
        Config { gate: Gate::At(3.0), start: Start::Auto, ..plain },
    ]
}

/// One thing that a user may do with an estimator.
fn use_it(mhe: &mut DdMhe, y: &[f64], rng: &mut ChaCha8Rng) {
    let mut y = y.to_vec();
    let channel = rng.random_range(0..y.len());
    match rng.random_range(0..13) {
        0 => y[channel] = f64::NAN,
        1 => y.fill(f64::NAN),
        2 => y[channel] = f64::MAX,
        3 => y[channel] = -1e9,
        4 => y[channel] = f64::INFINITY, // an error
        5 => mhe.reset(Some(&noise(rng.random_range(0..99), 4, 3.0))).unwrap(),
        9 => {
            let starts = [Start::State, Start::Recording, Start::Unknown, Start::Auto];
            let start = starts[rng.random_range(0..4)];
            assert_eq!(
                mhe.reset_from(start, None).is_ok(),
                start != Start::Unknown || mhe.config().disturbance.is_none()
            );
        }
        6 => *mhe = mhe.clone(),
        7 => *mhe = DdMhe::restore(&mhe.snapshot()).unwrap(),
        8 => {
            let size = rng.random_range(0.0..2.0);
            let _estimate = mhe.step_with(Step {
                y: &y,
                x_bounds: within(size, 4).as_ref(),
                ..Step::default()
            });
            return;
        }
        _ => {}
    }
    let _estimate = mhe.step(&y);
}

fn recorded() -> (History, Vec<f64>) {
    let system = modes(2);
    let (x, mut y) = system.simulate(&noise(1, 4, 2.0), 70);
    y.iter_mut().zip(noise(4, 210, 0.05)).for_each(|(y, v)| *y += v);
    let (_, mut outputs) = system.simulate(&noise(2, 4, 2.0), 60);
    outputs.iter_mut().zip(noise(3, 180, 0.12)).for_each(|(y, v)| *y += v);
    (0..180).step_by(37).for_each(|k| outputs[k] = f64::NAN);
    (History::new(4, 3, &x, &y, 0.1).unwrap(), outputs)
}

/// Everything that can be seen of the next steps.
fn seen(mhe: &mut DdMhe, outputs: &[f64]) -> Vec<String> {
    let mut seen = vec![format!("{:?} {:?} {}", mhe.estimate(), mhe.warnings(), mhe.t())];
    for y in outputs.chunks(3) {
        seen.push(format!("{:?}", mhe.step(y).unwrap()));
        seen.push(format!("{:?} {} {}", mhe.warnings(), mhe.t(), mhe.next_depth()));
    }
    seen.push(format!("{:?}", mhe.snapshot()));
    seen
}

/// After `rounds` of use for each configuration.
fn resets(rounds: usize, seed: u64) {
    let (history, outputs) = recorded();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for config in configs() {
        let fresh = DdMhe::new(&history, config.clone()).unwrap();
        let expected = seen(&mut fresh.clone(), &outputs);
        let elsewhere = noise(7, 4, 2.0);
        let from_elsewhere =
            Config { x_prior: Some(elsewhere.clone()), start: Start::State, ..config };
        let expected_elsewhere = seen(&mut DdMhe::new(&history, from_elsewhere).unwrap(), &outputs);
        let mut mhe = fresh.clone();
        for round in 0..rounds {
            for _ in 0..rng.random_range(1..60) {
                let k = 3 * rng.random_range(0..60);
                use_it(&mut mhe, &outputs[k..k + 3], &mut rng);
            }
            if round % 4 == 0 {
                mhe.reset(Some(&elsewhere)).unwrap();
                let found = seen(&mut mhe, &outputs);
                let differing = found.iter().zip(&expected_elsewhere).position(|(a, b)| a != b);
                // all but the snapshot, which carries the configuration
                assert!(differing.is_none_or(|k| k == found.len() - 1), "{round} {differing:?}");
            } else {
                mhe.reset(None).unwrap();
                let found = seen(&mut mhe, &outputs);
                assert_eq!(found.iter().zip(&expected).position(|(a, b)| a != b), None, "{round}");
            }
        }
    }
}

#[test]
fn a_reset_estimator_is_a_new_one() {
    resets(if cfg!(debug_assertions) { 4 } else { 12 }, 0);
}

#[test]
#[ignore = "long"]
fn long_a_reset_estimator_is_a_new_one() {
    resets(120, 2);
}

/// After `rounds` of use for each configuration.
fn copies(rounds: usize, seed: u64) {
    let (history, outputs) = recorded();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for config in configs() {
        let mut mhe = DdMhe::new(&history, config).unwrap();
        for round in 0..rounds {
            for _ in 0..rng.random_range(1..25) {
                let k = 3 * rng.random_range(0..60);
                use_it(&mut mhe, &outputs[k..k + 3], &mut rng);
            }
            let expected = seen(&mut mhe.clone(), &outputs[..90]);
            let restored = seen(&mut DdMhe::restore(&mhe.snapshot()).unwrap(), &outputs[..90]);
            // a restored estimator has no latest estimate
            assert_eq!(
                restored[1..].iter().zip(&expected[1..]).position(|(a, b)| a != b),
                None,
                "{round}"
            );
            assert_eq!(seen(&mut mhe, &outputs[..90]), expected);
        }
    }
}

#[test]
fn a_copy_and_a_restored_estimator_go_on_as_the_original_does() {
    copies(if cfg!(debug_assertions) { 3 } else { 9 }, 1);
}

#[test]
#[ignore = "long"]
fn long_a_copy_and_a_restored_estimator_go_on_as_the_original_does() {
    copies(90, 3);
}
