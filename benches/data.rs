//! The system behind the measurements of the step.

#![allow(dead_code)] // each of the measurements includes the file, and takes what it needs

use ddmhe_core::{Bounds, Config, History, Space};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Noisy recording (T samples) and online outputs of slowly decaying rotations (the last state of
/// an odd n decays alone) seen through n outputs.
pub fn recorded(n: usize, T: usize, steps: usize) -> (History, Vec<f64>) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut noise = |size: f64| rng.random_range(-size..size);
    let mut state: Vec<f64> = (0..n).map(|i| 1.0 + i as f64).collect();
    let (mut x, mut y) = (state.clone(), Vec::new());
    for _ in 0..T + steps {
        y.extend(state.iter().map(|v| v + noise(0.05)));
        for (i, pair) in state.chunks_mut(2).enumerate() {
            let (s, c) = (0.1 + 0.3 * i as f64).sin_cos();
            match pair {
                [a, b] => (*a, *b) = (0.999 * (c * *a - s * *b), 0.999 * (s * *a + c * *b)),
                [a] => *a *= 0.995,
                _ => {}
            }
        }
        x.extend(&state);
    }
    let history = History::new(n, n, &x[..(T + 1) * n], &y[..T * n], 0.1).expect("sizes fit");
    (history, y[T * n..].to_vec())
}

/// A log that goes on where its recording ends.
pub struct Pushed {
    /// The recording, with its inputs.
    pub history: History,
    /// Outputs (N·p).
    pub y: Vec<f64>,
    /// Inputs (N·m).
    pub u: Vec<f64>,
}

/// Three of `states` states, pushed by m = 2 inputs of noise and seen through p = 2 outputs. A
/// fourth one that is not recorded makes a response of two instants.
pub fn pushed(states: usize, steps: usize) -> Pushed {
    const T: usize = 400;
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut noise = |size: f64| rng.random_range(-size..size);
    let next = |x: &[f64], u: &[f64]| {
        let (s, c) = 0.3_f64.sin_cos();
        let slow = x.get(3).copied().unwrap_or(0.0);
        [
            0.97 * (c * x[0] - s * x[1]) + u[0] + slow,
            0.97 * (s * x[0] + c * x[1]) + 0.2 * x[2],
            0.9 * x[2] + u[1],
            0.8 * slow + u[0] - u[1],
        ]
    };
    let mut state = vec![1.0; states];
    let (mut x, mut y, mut u) = (state[..3].to_vec(), Vec::new(), Vec::new());
    for _ in 0..T + steps {
        let inputs = [noise(1.0), noise(1.0)];
        y.extend([state[0] + 0.3 * state[2] + noise(0.02), state[1] + inputs[1] + noise(0.02)]);
        let ahead = next(&state, &inputs);
        state.iter_mut().zip(ahead).for_each(|(x, ahead)| *x = ahead + noise(0.02));
        u.extend(inputs);
        x.extend(&state[..3]);
    }
    let history = History::new(3, 2, &x[..(T + 1) * 3], &y[..T * 2], 0.1).expect("sizes fit");
    let history = history.with_inputs(2, &u[..T * 2]).expect("sizes fit");
    Pushed { history, y: y.split_off(T * 2), u: u.split_off(T * 2) }
}

/// Settings of all measurements.
pub fn config(horizon: usize, space: Space) -> Config {
    let (rho, mu) = (Some(0.95), Some(0.1));
    Config { horizon: Some(horizon), rho, mu, space, evidence: false, ..Config::default() }
}

/// The box ± size.
pub fn within(size: f64, width: usize) -> Option<Bounds> {
    Some(Bounds { lo: vec![-size; width], hi: vec![size; width] })
}
