//! Time of one step against horizon M, number of states n, rank r and regime, and of construction.
//!
//! Regimes: `free` (no bounds), `slack` (a box on every state that never binds: the closed form plus the check), `binding`
//! (a box on the fitted noise that cuts at almost every step: the solver runs), `missing` (one output entry absent
//! in the window: the step's problem is factored anew). Ratios within one run are what to compare.

use criterion::{Criterion, criterion_group, criterion_main};
use ddmhe_core::{Bounds, Config, DdMhe, History, Space};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::hint::black_box;

/// Noisy recording (T = 200) and online outputs of n/2 decaying rotations seen through n outputs.
fn data(n: usize, T: usize, steps: usize) -> (History, Vec<f64>) {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut noise = |size: f64| rng.random_range(-size..size);
    let mut state: Vec<f64> = (0..n).map(|i| 1.0 + i as f64).collect();
    let (mut x, mut y) = (state.clone(), Vec::new());
    for _ in 0..T + steps {
        y.extend(state.iter().map(|v| v + noise(0.05)));
        for i in 0..n / 2 {
            let (s, c) = (0.1 + 0.3 * i as f64).sin_cos();
            let (a, b) = (state[2 * i], state[2 * i + 1]);
            (state[2 * i], state[2 * i + 1]) = (0.999 * (c * a - s * b), 0.999 * (s * a + c * b));
        }
        x.extend(&state);
    }
    let history = History::new(n, n, &x[..(T + 1) * n], &y[..T * n], 0.1).expect("sizes fit");
    (history, y[T * n..].to_vec())
}

fn config(horizon: usize, space: Space) -> Config {
    Config { horizon: Some(horizon), rho: Some(0.95), mu: Some(0.1), space, ..Config::default() }
}

/// Runs until the window is full, then times steps over the outputs again and again.
fn time(c: &mut Criterion, regime: &str, mut mhe: DdMhe, outputs: &[f64]) {
    let id = format!("n={},M={},r={}", mhe.n(), mhe.settings().horizon, mhe.settings().rank);
    let p = mhe.p();
    mhe.run(outputs).expect("outputs fit");
    let mut samples = outputs.chunks_exact(p).cycle();
    c.benchmark_group(format!("step/{regime}")).bench_function(id, |b| {
        b.iter(|| {
            let estimate = mhe.step(samples.next().expect("cycle never ends")).expect("outputs fit");
            black_box(estimate.x[0])
        });
    });
}

fn step(c: &mut Criterion) {
    let rank = |r| Space::Truncated { rank: Some(r), tol: None };
    for (n, M, space) in [
        (2, 10, rank(2)),
        (2, 20, rank(2)),
        (2, 50, rank(2)),
        (4, 20, rank(4)),
        (4, 20, rank(20)),
        (4, 50, rank(20)),
        (2, 20, Space::Auto),
    ] {
        let (history, outputs) = data(n, 200, 300);
        let regimes = [
            ("free", config(M, space)),
            ("slack", Config { x_bounds: Some(Bounds { lo: vec![-1e3; n], hi: vec![1e3; n] }), ..config(M, space) }),
            (
                "binding",
                Config { v_bounds: Some(Bounds { lo: vec![-0.045; n], hi: vec![0.045; n] }), ..config(M, space) },
            ),
        ];
        for (regime, config) in regimes {
            let mhe = DdMhe::new(&history, config).expect("valid settings");
            time(c, regime, mhe, &outputs);
        }
        let mut holes = outputs.clone();
        (0..holes.len()).step_by(M * n / 2).for_each(|k| holes[k] = f64::NAN);
        let mhe = DdMhe::new(&history, config(M, space)).expect("valid settings");
        time(c, "missing", mhe, &holes);
    }
}

fn construction(c: &mut Criterion) {
    let mut group = c.benchmark_group("construction");
    group.sample_size(10);
    for (n, T, M) in [(2, 200, 20), (2, 200, 50), (4, 200, 20), (2, 2000, 20)] {
        let (history, _) = data(n, T, 1);
        group.bench_function(format!("n={n},T={T},M={M}"), |b| {
            b.iter(|| {
                DdMhe::new(black_box(&history), config(M, Space::Auto)).expect("valid settings").spectral_radius()
            });
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(50).warm_up_time(std::time::Duration::from_millis(500)).measurement_time(std::time::Duration::from_secs(2));
    targets = step, construction
}
criterion_main!(benches);
