//! Time of one step of the interval observer: method, reduction, states and generators.
//!
//! `pendulum` is the paper's example (n = 2, q = 20); `euler` the tumbling target; `chain` n = 6
//! pendulums coupled in a row (q = 60) through an embedder's own dynamics.

use criterion::{Criterion, criterion_group, criterion_main};
use ddmhe_core::observer::{Dynamics, Euler, Gain, Method, Options, Pendulum, System};
use ddmhe_core::{Error, Interval, IntervalObserver, Reduction};
use std::hint::black_box;

const METHODS: [(&str, Method, Reduction); 4] = [
    ("paper", Method::Paper, Reduction::Paper),
    ("tight-girard", Method::Tight, Reduction::Girard),
    ("tight-combastel", Method::Tight, Reduction::Combastel),
    ("tight-pca", Method::Tight, Reduction::Pca),
];

fn identity(n: usize, value: f64) -> Vec<f64> {
    (0..n * n).map(|k| if k % (n + 1) == 0 { value } else { 0.0 }).collect()
}

/// No peak-to-peak bound: its cost is a few operations.
fn gain(L: Vec<f64>, n: usize) -> Gain {
    let none = f64::INFINITY;
    Gain {
        L,
        P: identity(n, 1.0),
        lambda: 0.5,
        gamma: none,
        mu_w: none,
        mu_v: none,
        weights: vec![],
    }
}

/// Steps along outputs that were simulated without disturbance, again from the start when they end.
fn time<D: Dynamics>(
    c: &mut Criterion,
    id: &str,
    mut observer: IntervalObserver<D>,
    outputs: &[f64],
) {
    let (p, steps) = (observer.p(), outputs.len() / observer.p());
    c.benchmark_group("interval").bench_function(id, |b| {
        b.iter(|| {
            if observer.steps() == steps {
                observer.reset();
            }
            let k = observer.steps();
            let estimate =
                observer.step(&outputs[k * p..(k + 1) * p], &[]).expect("inside its bounds");
            black_box(estimate.predicted[0].hi)
        });
    });
}

fn pendulum(c: &mut Criterion) {
    let mut x = [1.0_f64, 0.0];
    let outputs: Vec<f64> = (0..1000)
        .map(|_| {
            let y = x[0];
            x = [x[0] + 0.065 * x[1], x[1] - 0.065 * x[0].sin()];
            y
        })
        .collect();
    for (name, method, reduction) in METHODS {
        let system = System {
            A: vec![1.0, 0.065, 0.0, 1.0],
            C: vec![1.0, 0.0],
            D1: identity(2, 1.0),
            D2: vec![0.1],
            j_lo: vec![0.0, 0.0, -0.065, 0.0],
            j_hi: vec![0.0, 0.0, 0.065, 0.0],
            w_radius: vec![0.006; 2],
            v_radius: vec![0.01],
            ..System::default()
        };
        let gain = gain(vec![1.5029, 7.7372], 2);
        let options = Options { order: 20, method, reduction };
        let start = (&[0.98, 0.02], &[0.1, 1.0]);
        let observer = IntervalObserver::new(
            Pendulum { gain: 0.065 },
            system,
            gain,
            start.0,
            start.1,
            options,
        );
        time(c, &format!("pendulum n=2 q=20 {name}"), observer.expect("valid"), &outputs);
    }
}

fn euler(c: &mut Criterion) {
    let wide = |v: f64| Interval { lo: v - 0.02 * v.abs(), hi: v + 0.02 * v.abs() };
    let ratios = [0.019, -0.03, 0.011];
    let mut x = [0.25_f64, 0.02, 0.06];
    let outputs: Vec<f64> = (0..1000)
        .flat_map(|_| {
            let y = [20.0 * x[0], 20.0 * x[1], 20.0 * x[2]];
            x = [0, 1, 2].map(|i| x[i] + ratios[i] * x[(i + 1) % 3] * x[(i + 2) % 3]);
            y
        })
        .collect();
    for (name, method, reduction) in METHODS {
        let system = System {
            A: identity(3, 1.0),
            C: identity(3, 20.0),
            D1: identity(3, 1.0),
            D2: identity(3, 1.0),
            j_lo: vec![f64::NEG_INFINITY; 9],
            j_hi: vec![f64::INFINITY; 9],
            w_radius: vec![1e-6; 3],
            v_radius: vec![0.01; 3],
            ..System::default()
        };
        let dynamics = Euler {
            ratios: ratios.map(wide),
            linear: [Interval::ZERO; 9],
            output_radius: vec![1e-3; 9],
        };
        let options = Options { order: 30, method, reduction };
        let gain = gain(identity(3, 0.02), 3);
        let observer =
            IntervalObserver::new(dynamics, system, gain, &[0.25, 0.02, 0.06], &[1e-3; 3], options);
        time(c, &format!("euler n=3 q=30 {name}"), observer.expect("valid"), &outputs);
    }
}

/// Three pendulums in a row, coupled by springs: states (angle, rate) each.
struct Chain;

const H: f64 = 0.02;

impl Dynamics for Chain {
    fn value(&self, x: &[f64], out: &mut [Interval]) -> Result<(), Error> {
        for i in 0..3 {
            out[2 * i] = Interval::ZERO;
            out[2 * i + 1] = -H * Interval::point(x[2 * i]).sin();
        }
        Ok(())
    }

    fn jacobian(&self, x: &[Interval], out: &mut [Interval]) -> Result<(), Error> {
        out.fill(Interval::ZERO);
        for i in 0..3 {
            out[(2 * i + 1) * 6 + 2 * i] = -H * x[2 * i].cos();
        }
        Ok(())
    }
}

fn chain(c: &mut Criterion) {
    let mut A = identity(6, 1.0);
    for i in 0..3 {
        A[2 * i * 6 + 2 * i + 1] = H;
        for j in [i.wrapping_sub(1), i + 1] {
            if j < 3 {
                A[(2 * i + 1) * 6 + 2 * j] += 0.3 * H;
                A[(2 * i + 1) * 6 + 2 * i] -= 0.3 * H;
            }
        }
    }
    let mut x = [0.5, 0.0, -0.3, 0.0, 0.2, 0.0_f64];
    let mut outputs = Vec::new();
    for _ in 0..1000 {
        outputs.extend([x[0], x[2], x[4]]);
        let mut next: Vec<f64> =
            A.chunks_exact(6).map(|r| r.iter().zip(&x).map(|(a, b)| a * b).sum()).collect();
        (0..3).for_each(|i| next[2 * i + 1] -= H * x[2 * i].sin());
        x.copy_from_slice(&next);
    }
    let mut C = vec![0.0; 18];
    let mut L = vec![0.0; 18];
    for i in 0..3 {
        C[i * 6 + 2 * i] = 1.0;
        (L[2 * i * 3 + i], L[(2 * i + 1) * 3 + i]) = (0.6, 3.0);
    }
    for (name, method, reduction) in METHODS {
        let system = System {
            A: A.clone(),
            C: C.clone(),
            D1: identity(6, 1.0),
            D2: identity(3, 1.0),
            j_lo: vec![-H; 36],
            j_hi: vec![H; 36],
            w_radius: vec![1e-4; 6],
            v_radius: vec![1e-3; 3],
            ..System::default()
        };
        let options = Options { order: 60, method, reduction };
        let start = [0.5, 0.0, -0.3, 0.0, 0.2, 0.0];
        let observer =
            IntervalObserver::new(Chain, system, gain(L.clone(), 6), &start, &[0.05; 6], options);
        time(c, &format!("chain n=6 q=60 {name}"), observer.expect("valid"), &outputs);
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(50)
        .warm_up_time(std::time::Duration::from_millis(500))
        .measurement_time(std::time::Duration::from_secs(2));
    targets = pendulum, euler, chain
}
criterion_main!(benches);
