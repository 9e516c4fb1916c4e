//! Linear systems: recovery, bounds, growing window.

use crate::systems::{modes, noise};
use ddmhe_core::{Bounds, Config, DdMhe, Space, Start, Status, Step};

fn config(horizon: usize) -> Config {
    Config {
        horizon: Some(horizon),
        rho: Some(0.9),
        mu: Some(10.0),
        space: Space::Exact,
        ..Config::default()
    }
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn noise_free_states_are_recovered() {
    for blocks in 1..=3 {
        let system = modes(blocks);
        let n = system.n();
        let history = system.record(&noise(1, n, 2.0), 60);
        // longer than the memory that the window slides through
        let (truth, outputs) = system.simulate(&noise(2, n, 2.0), 200);
        let mut mhe =
            DdMhe::new(&history, Config { x_prior: Some(truth[..n].to_vec()), ..config(20) })
                .unwrap();
        assert_eq!(mhe.settings().rank, n);
        let log = mhe.run(&outputs).unwrap();
        assert!(distance(&log.x, &truth[n..]) < 1e-10);
        assert!(log.status.iter().all(|s| *s == Status::Optimal));
    }
}

#[test]
fn bounds_hold_and_the_active_set_changes_only_when_they_bind() {
    let system = modes(2);
    let (n, p) = (system.n(), system.p());
    let history = system.record(&noise(1, n, 2.0), 60);
    let (_, mut outputs) = system.simulate(&noise(2, n, 2.0), 40);
    outputs.iter_mut().zip(noise(3, 40 * p, 0.2)).for_each(|(y, v)| *y += v);
    let v_bounds = Some(Bounds { lo: vec![-0.2; p], hi: vec![0.2; p] });
    let mut boxed =
        DdMhe::new(&history, Config { v_bounds, start: Start::State, ..config(10) }).unwrap();
    let (mut bound, mut before) = (0, 0);
    for y in outputs.chunks(p) {
        let e = boxed.step(y).unwrap();
        assert_eq!(e.status, Status::Optimal);
        assert!(e.v.iter().all(|v| v.abs() <= 0.2 + 1e-9));
        // where no bound is active, at most those of the last step were dropped
        assert!(e.active > 0 || e.iterations as usize <= before, "{e:?}");
        before = e.active;
        bound += usize::from(e.active > 0);
    }
    assert!((5..40).contains(&bound), "{bound}");
}

#[test]
fn a_box_that_misses_the_answer_changes_it_and_raises_the_cost() {
    let system = modes(1);
    let history = system.record(&[1.0, 0.5], 40);
    let (truth, outputs) = system.simulate(&[1.0, 0.5], 10);
    let (mut free, mut boxed) =
        (DdMhe::new(&history, config(10)).unwrap(), DdMhe::new(&history, config(10)).unwrap());
    free.run(&outputs[..18]).unwrap();
    boxed.run(&outputs[..18]).unwrap();
    let hi = vec![truth[20] - 0.1, f64::INFINITY];
    let limits = Bounds {
        lo: [vec![f64::NEG_INFINITY; 20], vec![f64::NEG_INFINITY; 2]].concat(),
        hi: [vec![f64::INFINITY; 20], hi].concat(),
    };
    let free = free.step(&outputs[18..]).unwrap().clone();
    let boxed = boxed
        .step_with(Step { y: &outputs[18..], x_bounds: Some(&limits), ..Step::default() })
        .unwrap();
    assert!((boxed.x[0] - (truth[20] - 0.1)).abs() < 1e-9);
    assert!(boxed.cost > free.cost + 1e-3);
    assert_eq!(boxed.active, 1);
}

#[test]
fn a_snapshot_continues_with_the_same_numbers() {
    let system = modes(2);
    let (n, p) = (system.n(), system.p());
    let history = system.record(&noise(1, n, 2.0), 60);
    let (_, outputs) = system.simulate(&noise(2, n, 2.0), 40);
    let mut mhe = DdMhe::new(&history, Config::default()).unwrap();
    mhe.run(&outputs[..15 * p]).unwrap();
    let mut again = DdMhe::restore(&mhe.snapshot()).unwrap();
    assert_eq!(again.run(&outputs[15 * p..]).unwrap(), mhe.run(&outputs[15 * p..]).unwrap());
}

/// Also how the answer was reached: the active bounds that a step starts from are part of a
/// snapshot.
#[test]
fn every_step_of_a_restored_estimator_is_the_same_step() {
    let system = modes(2);
    let (n, p) = (system.n(), system.p());
    let history = system.record(&noise(1, n, 2.0), 60);
    let (_, mut outputs) = system.simulate(&noise(2, n, 2.0), 150);
    outputs.iter_mut().zip(noise(3, 150 * p, 0.2)).for_each(|(y, v)| *y += v);
    (0..outputs.len()).step_by(101).for_each(|k| outputs[k] = f64::NAN);
    let v_bounds = Some(Bounds { lo: vec![-0.19; p], hi: vec![0.19; p] });
    let mut mhe = DdMhe::new(&history, Config { v_bounds, ..config(10) }).unwrap();
    let (mut bound, mut unchanged) = (0, 0);
    for y in outputs.chunks(p) {
        let mut restored = DdMhe::restore(&mhe.snapshot()).unwrap();
        let (again, step) = (restored.step(y).unwrap(), mhe.step(y).unwrap());
        assert_eq!(format!("{again:?}"), format!("{step:?}"));
        bound += usize::from(step.active > 0);
        unchanged += usize::from(step.active > 0 && step.iterations == 0);
    }
    assert!(bound > 30 && unchanged > 3, "{bound} {unchanged}");
}

/// A window with a lost output has another Hessian, or is another problem: nothing of its factor
/// may reach the next window.
#[test]
fn a_lost_output_that_has_left_the_window_leaves_nothing_behind() {
    let system = modes(2);
    let (n, p) = (system.n(), system.p());
    let history = system.record(&noise(1, n, 2.0), 60);
    let (_, recorded) = system.simulate(&noise(2, n, 2.0), 1);
    // the same outputs for ever, so that the same rows are active in every window
    let mut outputs = recorded[..p].repeat(120);
    (40..44).for_each(|k| outputs[k * p] = f64::NAN);
    for size in [0.2, 0.5, 1.0, 2.0] {
        let bounds = |width: usize| Some(Bounds { lo: vec![-size; width], hi: vec![size; width] });
        let settings = Config {
            x_bounds: bounds(n),
            space: Space::Truncated { rank: Some(8), tol: None },
            ..config(10)
        };
        let mut mhe = DdMhe::new(&history, settings).unwrap();
        let mut active = 0;
        for (k, y) in outputs.chunks(p).enumerate() {
            // without optimisation only about the windows with lost outputs
            let compared = !cfg!(debug_assertions) || (38..60).contains(&k);
            let restored = compared.then(|| DdMhe::restore(&mhe.snapshot()).unwrap());
            let step = mhe.step(y).unwrap();
            if let Some(mut restored) = restored {
                let again = restored.step(y).unwrap();
                assert_eq!(format!("{again:?}"), format!("{step:?}"), "{k}");
            }
            active += usize::from(step.active > 0);
        }
        assert!(active > 30 || size < 0.5, "{size} {active}");
    }
}

/// A box that is given to a step keeps it from being made at once: the numbers are the same ones.
#[test]
fn a_window_that_is_looked_at_once_is_any_other_window() {
    let system = modes(2);
    let (n, p) = (system.n(), system.p());
    let history = system.record(&noise(1, n, 2.0), 80);
    let (_, mut outputs) = system.simulate(&noise(2, n, 2.0), 90);
    outputs.iter_mut().zip(noise(3, 90 * p, 0.2)).for_each(|(y, v)| *y += v);
    outputs[30 * p] = f64::NAN;
    outputs[70 * p..].iter_mut().for_each(|y| *y *= 1e3); // out of all boxes
    for horizon in [1, 2, 3, 4, 5, 8, 11, 20] {
        for size in [None, Some(4.0), Some(1e3)] {
            let bounds =
                |of: f64, width: usize| Bounds { lo: vec![-of; width], hi: vec![of; width] };
            let x_bounds = bounds(size.unwrap_or(f64::INFINITY), n);
            let settings = Config {
                x_bounds: size.map(|_| x_bounds.clone()),
                v_bounds: size.map(|size| bounds(0.1 * size, p)),
                space: Space::Truncated { rank: Some(7), tol: None },
                start: Start::State,
                ..config(horizon)
            };
            let mut mhe = DdMhe::new(&history, settings).unwrap();
            let mut other = mhe.clone();
            for y in outputs.chunks(p) {
                let step = Step { y, x_bounds: Some(&x_bounds), u: &[] };
                let (at_once, any) = (mhe.step(y).unwrap(), other.step_with(step).unwrap());
                assert_eq!(format!("{at_once:?}"), format!("{any:?}"), "{horizon} {size:?}");
            }
        }
    }
}
