//! Time of one step of the rigid body's estimator: its filter, with fits in slices beside it, and
//! the affine estimator that stands by.

use criterion::{Criterion, criterion_group, criterion_main};
use ddmhe_core::rigid::{Refits, RigidConfig};
use ddmhe_core::{Config, DdMhe, History, RigidBodyMhe};
use std::hint::black_box;

const DT: f64 = 0.1;
/// Outputs of the recording, and after it.
const COUNTS: (usize, usize) = (200, 6000);

/// A number between -1 and 1 that looks random: enough noise for a fit to stop.
fn noise(k: usize) -> f64 {
    let v = (k as f64 * 12.989_8).sin() * 43_758.545_3;
    2.0 * (v - v.floor()) - 1.0
}

/// A tumbling body that is braked about two of its axes, in 50 small steps of Euler's rule a
/// sample: rates and outputs.
fn tumbling() -> (Vec<f64>, Vec<f64>) {
    let J = [0.8, 1.0, 1.2];
    let (mut w, mut x, mut y) = ([0.2, 0.15, -0.1], Vec::new(), Vec::new());
    for _ in 0..=COUNTS.0 + COUNTS.1 {
        let k = x.len();
        x.extend([0, 1, 2].map(|i| w[i] + 1e-4 * noise(k + i)));
        let output = [3.0 * w[0] + w[1], w[1] - 2.0 * w[0], 0.5 * w[0]];
        y.extend([0, 1, 2].map(|i| output[i] + 1e-3 * noise(k + i + 100_000)));
        for _ in 0..50 {
            let drag = [-0.002 * w[0], -0.001 * w[1], 0.0];
            let rate =
                |i: usize, j: usize, k: usize| (drag[i] + (J[j] - J[k]) * w[j] * w[k]) / J[i];
            let f = [rate(0, 1, 2), rate(1, 2, 0), rate(2, 0, 1)];
            (0..3).for_each(|i| w[i] += DT / 50.0 * f[i]);
        }
    }
    (x, y)
}

fn steps(c: &mut Criterion) {
    let (x, y) = tumbling();
    let (T, N) = COUNTS;
    let history = History::new(3, 3, &x[..3 * (T + 1)], &y[..3 * T], DT).expect("a recording");
    let later = &y[3 * T..];
    let mut group = c.benchmark_group("rigid");
    for (name, refit) in [("filter", Refits::Manual), ("sliced", Refits::Sliced)] {
        let config = RigidConfig { refit, ..RigidConfig::default() };
        let mut mhe = RigidBodyMhe::new(&history, config, None).expect("an estimator");
        assert!(mhe.explained());
        group.bench_function(name, |b| {
            b.iter(|| {
                if mhe.t() == N {
                    mhe.reset().expect("a new run");
                }
                let k = mhe.t();
                black_box(mhe.step(&later[3 * k..3 * k + 3]).expect("a step").x[0])
            });
        });
    }
    let mut affine = DdMhe::new(&history, Config::default()).expect("an estimator");
    let mut k = 0;
    group.bench_function("affine", |b| {
        b.iter(|| {
            k = (k + 1) % N;
            black_box(affine.step(&later[3 * k..3 * k + 3]).expect("a step").x[0])
        });
    });
}

criterion_group!(benches, steps);
criterion_main!(benches);
