//! Time of one step against horizon M, number of states n, rank r and regime, beside the floor of
//! its arithmetic; and of construction.
//!
//! Regimes: `floor` (what no step can spare, in plain loops: see floor.rs), `free` (bounds that
//! never bind), `few` (a box on the states that binds at a few of them, warm-started from the last
//! step's active set), `cold` (one such step without an active set to start from), `still` (a box
//! that binds at the same states at every step), `many` (a box on the fitted noise, the narrowest
//! that all windows of the log have room in), `missing` (one output entry in a half of the window
//! absent). Ratios within one run are what to compare.

mod data;
mod floor;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use data::{Pushed, config, pushed, recorded, within};
use ddmhe_core::{Bounds, Config, DdMhe, Signals, Space, Status, Step, Weighting};
use floor::Floor;
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Times the steps of a log once the window is full, log after log. What leads to the first of
/// them is not timed: no window reaches from one log's end into the next one's beginning.
fn time(c: &mut Criterion, regime: &str, id: &str, mut mhe: DdMhe, outputs: &[f64]) {
    let p = mhe.p();
    let (first, timed) = outputs.split_at(mhe.settings().horizon * p);
    let (mut active, mut without) = (0, 0);
    mhe.reset(None).expect("a start that it had before");
    mhe.run(first).expect("outputs fit");
    for y in timed.chunks_exact(p) {
        let estimate = mhe.step(y).expect("outputs fit");
        active += estimate.active;
        without += usize::from(estimate.status != Status::Optimal);
    }
    let steps = timed.len() / p;
    if active + without > 0 {
        let mean = active as f64 / steps as f64;
        eprintln!(
            "{regime}/{id}: {mean:.1} bounds active in the mean, {without} without minimiser"
        );
    }
    c.benchmark_group(format!("step/{regime}")).bench_function(id, |b| {
        b.iter_custom(|mut left| {
            let mut spent = Duration::ZERO;
            while left > 0 {
                mhe.reset(None).expect("a start that it had before");
                mhe.run(first).expect("outputs fit");
                let now = left.min(steps as u64);
                let start = Instant::now();
                for y in timed.chunks_exact(p).take(now as usize) {
                    black_box(mhe.step(y).expect("outputs fit").x[0]);
                }
                spent += start.elapsed();
                left -= now;
            }
            spent
        });
    });
}

/// The narrowest box on the noise, in steps of .005 from .055 on (it is ±.05 in the data), that all
/// windows of a log have room in: its estimator. A narrower one leaves out outputs, step by step.
fn narrowest(outputs: &[f64], n: usize, build: impl Fn(Option<Bounds>) -> DdMhe) -> DdMhe {
    let has_room = |mhe: &mut DdMhe| {
        mhe.run(outputs).expect("outputs fit").status.iter().all(|s| *s == Status::Optimal)
    };
    (11..)
        .map(|size| build(within(0.005 * f64::from(size), n)))
        .find_map(|mut mhe| has_room(&mut mhe).then_some(mhe))
        .expect("a wide box has room")
}

/// Steps without an active set to start from: copies of an estimator that has met no bounds yet, at
/// the first step where the box cuts two states or more.
fn cold(c: &mut Criterion, id: &str, mut mhe: DdMhe, bounds: &Bounds, outputs: &[f64]) {
    let p = mhe.p();
    let cuts = |mhe: &DdMhe, y: &[f64]| {
        mhe.clone()
            .step_with(Step { y, x_bounds: Some(bounds), u: &[] })
            .is_ok_and(|e| e.active > 1)
    };
    for y in outputs.chunks_exact(p).skip(60) {
        if mhe.t() > 60 && cuts(&mhe, y) {
            c.benchmark_group("step/cold").bench_function(id, |b| {
                let step = |mhe: &mut DdMhe| {
                    mhe.step_with(Step { y, x_bounds: Some(bounds), u: &[] })
                        .map_or(0, |e| e.active)
                };
                b.iter_batched_ref(|| mhe.clone(), step, BatchSize::SmallInput);
            });
            return;
        }
        mhe.step(y).expect("outputs fit");
    }
}

fn step(c: &mut Criterion) {
    let rank = |r| Space::Truncated { rank: Some(r), tol: None };
    for (n, M, space) in [
        (1, 20, rank(3)),
        (3, 10, rank(5)),
        (3, 20, rank(5)),
        (3, 20, rank(20)),
        (3, 50, rank(5)),
        (3, 50, rank(20)),
        (6, 50, rank(20)),
        (3, 20, Space::Auto),
    ] {
        let (history, outputs) = recorded(n, 200, 600);
        let build = |config: Config| DdMhe::new(&history, config).expect("valid settings");
        let free = build(Config {
            x_bounds: within(1e3, n),
            v_bounds: within(1e3, n),
            ..config(M, space)
        });
        let id = format!("n={n},M={M},r={}", free.settings().rank);
        let mut floor = Floor::new(n, M, free.settings().rank);
        let mut samples = outputs.chunks_exact(n).cycle();
        c.benchmark_group("step/floor").bench_function(&id, |b| {
            b.iter(|| black_box(floor.step(samples.next().expect("cycle never ends"))));
        });
        time(c, "free", &id, free, &outputs);
        let few =
            Bounds { lo: vec![-1e3; n], hi: (0..n).map(|i| 0.97 * (1.0 + i as f64)).collect() };
        time(
            c,
            "few",
            &id,
            build(Config { x_bounds: Some(few.clone()), ..config(M, space) }),
            &outputs,
        );
        cold(c, &id, build(config(M, space)), &few, &outputs);
        let judged = Config {
            x_bounds: within(1e3, n),
            v_bounds: within(1e3, n),
            evidence: true,
            ..config(M, space)
        };
        time(c, "judged", &id, build(judged), &outputs);
        // the same outputs for ever: the same window and the same active set at every step
        let still = outputs[..n].repeat(600);
        let cap =
            Bounds { lo: vec![-1e3; n], hi: outputs[..n].iter().map(|y| 0.5 * y.abs()).collect() };
        time(c, "still", &id, build(Config { x_bounds: Some(cap), ..config(M, space) }), &still);
        let many =
            narrowest(&outputs, n, |v_bounds| build(Config { v_bounds, ..config(M, space) }));
        time(c, "many", &id, many, &outputs);
        let mut holes = outputs.clone();
        (0..holes.len()).step_by(M * n / 2 + 1).for_each(|k| holes[k] = f64::NAN);
        time(c, "missing", &id, build(config(M, space)), &holes);
    }
}

/// Logs of known inputs (n = 3, p = 2, m = 2, M = 20), a response of one instant and of two, beside
/// the same outputs without; and x̂ alone with the weights of the recording. A time is that of 600
/// steps.
fn inputs(c: &mut Criterion) {
    let given = Config { horizon: Some(20), evidence: false, ..Config::default() };
    let rank_3 = Space::Truncated { rank: Some(3), tol: None };
    let settings = [
        ("r=3", Config { space: rank_3, ..given.clone() }),
        ("default", given.clone()),
        ("recorded", Config { weights: Weighting::Recorded, ..given }),
    ];
    for (states, instants) in [(3, "one instant"), (4, "two instants")] {
        let Pushed { history, y, u } = pushed(states, 600);
        for (name, config) in &settings {
            for (kind, history) in [(instants, history.clone()), ("none", history.without_inputs())]
            {
                let mut mhe = DdMhe::new(&history, config.clone()).expect("valid settings");
                let u = if history.m() > 0 { &u[..] } else { &[] };
                c.benchmark_group("run/600 steps").bench_function(
                    format!("{name}, inputs: {kind} ({states} states)"),
                    |b| {
                        b.iter(|| {
                            mhe.run_until(Signals { y: &y, u }, &mut || false)
                                .map_or(0, |l| l.x.len())
                        });
                    },
                );
            }
        }
    }
}

/// The step must not depend on how long the recording was.
fn recording(c: &mut Criterion) {
    let space = Space::Truncated { rank: Some(5), tol: None };
    for T in [200, 2000] {
        let (history, outputs) = recorded(3, T, 600);
        let mhe = DdMhe::new(&history, Config { x_bounds: within(1e3, 3), ..config(20, space) })
            .expect("valid settings");
        time(c, "recording", &format!("T={T}"), mhe, &outputs);
    }
}

fn construction(c: &mut Criterion) {
    let mut group = c.benchmark_group("construction");
    group.sample_size(10);
    let full = [(2, 200, 20), (2, 200, 50), (4, 200, 20), (2, 2000, 20), (3, 2000, 50)]
        .map(|case| (case, Space::Auto));
    let truncated = ((3, 2000, 50), Space::Truncated { rank: Some(20), tol: None });
    for ((n, T, M), space) in full.into_iter().chain([truncated]) {
        let (history, _) = recorded(n, T, 1);
        group.bench_function(format!("n={n},T={T},M={M},{space:?}"), |b| {
            b.iter(|| {
                DdMhe::new(black_box(&history), config(M, space))
                    .expect("valid settings")
                    .spectral_radius()
            });
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(50)
        .warm_up_time(std::time::Duration::from_millis(300))
        .measurement_time(std::time::Duration::from_secs(1));
    targets = step, inputs, recording, construction
}
criterion_main!(benches);
