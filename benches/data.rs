//! The system behind the measurements of the step.

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

/// Settings of all measurements.
pub fn config(horizon: usize, space: Space) -> Config {
    let (rho, mu) = (Some(0.95), Some(0.1));
    Config { horizon: Some(horizon), rho, mu, space, evidence: false, ..Config::default() }
}

/// The box ± size.
pub fn within(size: f64, width: usize) -> Option<Bounds> {
    Some(Bounds { lo: vec![-size; width], hi: vec![size; width] })
}
