//! What the attacks found, each fault as the plainest case of it.

use super::check::{bits, of};
use crate::systems::{modes, noise};
use ddmhe_core::{
    Config, DdMhe, Equilibrium, Error, History, ProcessNoise, Signals, Start, Step, Weighting,
};

/// A noisy recording with known inputs, and the outputs and inputs that follow it.
fn driven() -> (History, Vec<f64>, Vec<f64>) {
    let (system, T) = (modes(1), 40);
    let u = noise(1, 2 * (T + 60), 1.0);
    let (mut x, mut y) = system.driven(&[1.0, 0.5], &u);
    x.iter_mut().zip(noise(3, 2 * (T + 61), 0.05)).for_each(|(x, v)| *x += v);
    y.iter_mut().zip(noise(2, 2 * (T + 60), 0.05)).for_each(|(y, v)| *y += v);
    let history = History::new(2, 2, &x[..2 * (T + 1)], &y[..2 * T], 0.1).unwrap();
    (history.with_inputs(2, &u[..2 * T]).unwrap(), y[2 * T..].to_vec(), u[2 * T..].to_vec())
}

fn recorded(start: Start) -> Config {
    let (weights, process_noise) = (Weighting::Recorded, ProcessNoise::Residual);
    Config { horizon: Some(5), weights, process_noise, start, ..Config::default() }
}

/// x̂(t) of a run without windows differed from a step's in its last bit where inputs are known.
#[test]
fn a_run_with_known_inputs_is_its_steps_bit_for_bit() {
    let (history, y, u) = driven();
    for start in [Start::State, Start::Recording, Start::Unknown] {
        let mut stepped = DdMhe::new(&history, recorded(start)).unwrap();
        let mut run = stepped.clone();
        let log = run.run_until(Signals { y: &y, u: &u }, &mut || false).unwrap();
        let samples = y.chunks_exact(2).zip(u.chunks_exact(2)).zip(log.x.chunks_exact(2));
        for (k, ((y, u), x)) in samples.enumerate() {
            let e = stepped.step_with(Step { y, u, x_bounds: None }).unwrap();
            assert_eq!(bits(&e.x), bits(x), "{start:?} {k}");
        }
    }
}

/// A snapshot from before the first step took the recording's last states for a filter's.
#[test]
fn a_snapshot_before_the_first_step_goes_on_as_the_estimator() {
    let (history, y, u) = driven();
    let free = history.without_inputs();
    for start in [Start::State, Start::Recording, Start::Unknown] {
        for (history, m) in [(&history, 2), (&free, 0)] {
            let mut mhe = DdMhe::new(history, recorded(start)).unwrap();
            let mut restored = DdMhe::restore(&mhe.snapshot()).unwrap();
            for (k, y) in y.chunks_exact(2).enumerate() {
                let step = Step { y, u: &u[k * m..(k + 1) * m], x_bounds: None };
                let [a, b] = [&mut mhe, &mut restored].map(|mhe| of(mhe.step_with(step).unwrap()));
                assert!(a == b, "{start:?} m {m} step {k}");
            }
        }
    }
}

/// Inputs of a rest that cannot be computed with made windows of NaN.
#[test]
fn a_rest_beyond_reach_is_refused() {
    let (history, ..) = driven();
    for value in [f64::MAX, -1e300, 1e40] {
        let rest = Equilibrium { x: vec![0.0; 2], y: vec![0.0; 2], u: vec![0.0, value] };
        let config = Config { equilibrium: Some(rest), ..recorded(Start::State) };
        let found = DdMhe::new(&history, config).err();
        assert!(matches!(found, Some(Error::Value { argument: "equilibrium", .. })), "{found:?}");
    }
}

/// Recorded inputs that cannot be computed with did, too.
#[test]
fn recorded_inputs_beyond_computing_are_refused() {
    let (history, ..) = driven();
    let u: Vec<f64> = noise(4, 80, 1e200);
    let found = DdMhe::new(&history.with_inputs(2, &u).unwrap(), Config::default()).err();
    assert!(found.is_some_and(|e| e.to_string().contains("u1 of magnitudes")));
}

/// A saved estimate with evidence of other sizes is none of this recording: its next step panicked.
#[test]
fn evidence_of_other_sizes_fits_no_estimate() {
    let history = modes(1).record(&[1.0, 0.5], 40);
    let (n, p) = (history.n(), history.p());
    let mut mhe = DdMhe::new(&history, Config::default()).unwrap();
    let estimate = mhe.step(&vec![0.1; p]).unwrap();
    assert!(estimate.fits(n, p));
    let spoilt = |change: fn(&mut ddmhe_core::Evidence)| {
        let mut other = estimate.clone();
        change(other.evidence.as_mut().unwrap());
        other.fits(n, p)
    };
    assert!(!spoilt(|own| own.covariance.push(0.0)));
    assert!(!spoilt(|own| own.innovation.clear()));
    assert!(!spoilt(|own| own.innovation_variance.push(0.0)));
    assert!(!spoilt(|own| own.stuck.clear()));
    assert!(!spoilt(|own| own.gated.push(true)));
}
