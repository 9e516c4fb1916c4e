//! The rigid body's estimator as an embedder uses it; its numbers are tested against the NumPy
//! reference in Python.

use crate::systems::noise;
use ddmhe_core::rigid::{KnownField, Measured, Refits, RigidConfig};
use ddmhe_core::{Bounds, Config, DdMhe, History, RigidBodyMhe, Status};

const DT: f64 = 0.1;

/// A tumbling body that is braked about two of its axes: rates and outputs of `count` samples, in
/// 50 small steps of Euler's rule a sample.
fn tumbling(count: usize) -> (Vec<f64>, Vec<f64>) {
    let J = [0.8, 1.0, 1.2];
    let (mut w, mut x, mut y) = ([0.2, 0.15, -0.1], Vec::new(), Vec::new());
    for _ in 0..count {
        x.extend(w);
        y.extend([3.0 * w[0] + w[1], w[1] - 2.0 * w[0], 0.5 * w[0]]);
        for _ in 0..50 {
            let drag = [-0.02 * w[0], -0.01 * w[1], 0.0];
            let rate =
                |i: usize, j: usize, k: usize| (drag[i] + (J[j] - J[k]) * w[j] * w[k]) / J[i];
            let f = [rate(0, 1, 2), rate(1, 2, 0), rate(2, 0, 1)];
            (0..3).for_each(|i| w[i] += DT / 50.0 * f[i]);
        }
    }
    (x, y)
}

/// An estimator of its first 150 samples, and the rates and outputs after them.
fn made(refit: Refits) -> (RigidBodyMhe, Vec<f64>, Vec<f64>) {
    let (mut x, mut y) = tumbling(1650);
    x.iter_mut().zip(noise(1, 3 * 151, 1e-4)).for_each(|(v, e)| *v += e);
    let count = y.len();
    y.iter_mut().zip(noise(2, count, 1e-3)).for_each(|(v, e)| *v += e);
    let history = History::new(3, 3, &x[..3 * 151], &y[..3 * 150], DT).unwrap();
    let config = RigidConfig { refit, ..RigidConfig::default() };
    let mhe = RigidBodyMhe::new(&history, config, None).unwrap();
    (mhe, x[3 * 151..].to_vec(), y[3 * 150..].to_vec())
}

#[test]
fn steps_with_slices_of_fits_allocate_nothing() {
    let (mut mhe, truth, y) = made(Refits::Sliced);
    assert!(mhe.explained());
    // the estimate's room is made by the first step
    mhe.step(&y[..3]).unwrap();
    let found = allocation_counter::measure(|| {
        for y in y[3..].chunks_exact(3) {
            mhe.step(y).unwrap();
        }
    });
    assert_eq!(found.count_total, 0);
    assert_eq!(mhe.estimate().status, Status::Structured);
    // fits were made on the way: the inertia is known better than from the recording alone
    let before = made(Refits::Manual).0.report().unwrap();
    let after = mhe.report().unwrap();
    assert!(after.evidence != before.evidence);
    let last = &truth[truth.len() - 3..];
    let off = mhe.estimate().x.iter().zip(last).map(|(x, w)| (x - w).abs()).fold(0.0, f64::max);
    assert!(off < 1e-3, "{off}");
}

#[test]
fn steps_beside_fits_of_several_recordings_allocate_nothing() {
    let (mut x, mut y) = tumbling(1200);
    x.iter_mut().zip(noise(1, 3 * 1200, 1e-4)).for_each(|(v, e)| *v += e);
    y.iter_mut().zip(noise(2, 3 * 1200, 1e-3)).for_each(|(v, e)| *v += e);
    // each is of a body that has turned on meanwhile
    let parts: Vec<History> = [0, 100, 200]
        .map(|k| {
            let (rates, outputs) = (&x[3 * k..3 * (k + 61)], &y[3 * k..3 * (k + 60)]);
            History::new(3, 3, rates, outputs, DT).unwrap()
        })
        .to_vec();
    let history = History::concat(&parts).unwrap();
    let config = RigidConfig { refit: Refits::Sliced, ..RigidConfig::default() };
    let mut mhe = RigidBodyMhe::new(&history, config, None).unwrap();
    assert!(mhe.explained());
    let before = mhe.report().unwrap();
    assert!(before.words[0].contains("3 recordings"));
    let later = &y[3 * 260..];
    mhe.step(&later[..3]).unwrap();
    let found = allocation_counter::measure(|| {
        for y in later[3..].chunks_exact(3) {
            mhe.step(y).unwrap();
        }
    });
    assert_eq!(found.count_total, 0);
    // fits of all recordings were made on the way
    let after = mhe.report().unwrap();
    assert!(after.evidence != before.evidence);
    assert!(after.words[0].contains("3 recordings"));
}

#[test]
fn slices_end_where_one_fit_would() {
    // after the last slice of a fit the filter stands where a fit at once would have let it go on
    let (mut sliced, _, y) = made(Refits::Sliced);
    let (mut now, ..) = made(Refits::Now);
    let (sliced, now) = (sliced.run(&y).unwrap(), now.run(&y).unwrap());
    let end = sliced.x.len() - 3;
    for (a, b) in sliced.x[end..].iter().zip(&now.x[end..]) {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
    assert_ne!(sliced.x, now.x);
}

#[test]
fn the_affine_estimator_rests_and_takes_over_where_outputs_are_no_body_s() {
    let (x, mut y) = tumbling(900);
    let later = y.split_off(3 * 150);
    let history = History::new(3, 3, &x[..3 * 151], &y, DT).unwrap();
    let x_bounds = Some(Bounds { lo: vec![-1e3; 3], hi: vec![1e3; 3] });
    let noise = Some(vec![1e-3; 3]);
    let config = RigidConfig {
        x_bounds: x_bounds.clone(),
        output_noise: noise.clone(),
        ..RigidConfig::default()
    };
    let mut mhe = RigidBodyMhe::new(&history, config, None).unwrap();
    assert!(mhe.explained());
    // the body goes on for a while, then every torque is turned about and so large that a body
    // would have to turn faster than any step could follow: a linear motion, but of no body
    let turned = 100;
    let outputs: Vec<Vec<f64>> = later
        .chunks_exact(3)
        .enumerate()
        .map(|(k, y)| y.iter().map(|v| if k < turned { *v } else { -200.0 * v }).collect())
        .collect();
    let mut last = 0;
    for (k, y) in outputs.iter().enumerate() {
        let status = mhe.step(y).unwrap().status;
        assert!(k > turned + 100 || status != Status::Affine, "{k}");
        if status == Status::Affine {
            last = k;
            break;
        }
    }
    assert!(last > turned);
    // it is a run of its own from a sample after the change on, not one of all samples
    let of_run = |from: usize| {
        let config =
            Config { x_bounds: x_bounds.clone(), output_noise: noise.clone(), ..Config::default() };
        let mut alone = DdMhe::new(&history, config).unwrap();
        outputs[from..=last].iter().for_each(|y| {
            alone.step(y).unwrap();
        });
        alone.estimate().x.clone()
    };
    let begun = (turned..turned + 20).find(|from| of_run(*from) == mhe.estimate().x);
    assert!(begun.is_some());
    assert_ne!(of_run(0), mhe.estimate().x);
}

/// The cross product.
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[test]
fn steps_in_a_known_field_allocate_nothing() {
    // braked by B × M (B × ω), B turned; outputs are what K = [B] + 1 shows of the moment
    let (J, M, recorded, count) = ([0.8, 1.0, 1.2], [0.01, 0.02, 0.015], 150, 1000);
    let of = |t: f64| [(0.3 * t).cos(), (0.3 * t).sin(), 0.4];
    let moment = |B: [f64; 3], w: [f64; 3]| {
        let u = cross(B, w);
        [0, 1, 2].map(|i| M[i] * u[i])
    };
    let (mut w, mut x, mut y) = ([0.2, 0.15, -0.1], Vec::new(), Vec::new());
    let (mut Bs, mut Ks) = (Vec::new(), Vec::new());
    for k in 0..count {
        let B = of(k as f64 * DT);
        let m = moment(B, w);
        let torque = cross(B, m);
        x.extend(w);
        y.extend([0, 1, 2].map(|i| -3.0 * (torque[i] + m[i])));
        Bs.extend(B);
        Ks.extend([1.0, -B[2], B[1], B[2], 1.0, -B[0], -B[1], B[0], 1.0]);
        for step in 0..50 {
            let B = of((k as f64 + f64::from(step) / 50.0) * DT);
            let drag = cross(B, moment(B, w));
            let gyro = cross(w, [0, 1, 2].map(|i| J[i] * w[i]));
            (0..3).for_each(|i| w[i] += DT / 50.0 * (drag[i] - gyro[i]) / J[i]);
        }
    }
    let (length, size) = (x.len(), y.len());
    x.iter_mut().zip(noise(1, length, 1e-4)).for_each(|(v, e)| *v += e);
    y.iter_mut().zip(noise(2, size, 1e-3)).for_each(|(v, e)| *v += e);
    let history = History::new(3, 3, &x[..3 * (recorded + 1)], &y[..3 * recorded], DT).unwrap();
    let field = KnownField { B: Bs[..3 * recorded].to_vec(), K: Ks[..9 * recorded].to_vec() };
    let config =
        RigidConfig { field: Some(field), refit: Refits::Sliced, ..RigidConfig::default() };
    let mut mhe = RigidBodyMhe::new(&history, config, None).unwrap();
    assert!(mhe.explained());
    assert!(mhe.step(&y[..3]).is_err());
    let mut step = |k: usize| {
        let field = Some((&Bs[3 * k..3 * k + 3], &Ks[9 * k..9 * k + 9]));
        let sample = Measured { y: &y[3 * k..3 * k + 3], x: None, field };
        assert_eq!(mhe.step_with(sample).unwrap().status, Status::Structured);
    };
    step(recorded); // makes the estimate's room
    let found = allocation_counter::measure(|| (recorded + 1..count - 1).for_each(&mut step));
    assert_eq!(found.count_total, 0);
    let off = |i: usize| (mhe.estimate().x[i] - x[3 * (count - 1) + i]).abs();
    assert!((0..3).all(|i| off(i) < 5e-4));
}
