//! Certificates without Python: x(t+1) = 0.9 x + 1 + w, y = 2 x + v, for which (L) can be checked
//! by hand.

use ddmhe_core::validation::{Fold, validate};
use ddmhe_core::{Certificate, Config, DdMhe, Disturbance, Error, History, Model, Space};

fn recorded(start: f64, steps: usize, w: f64) -> (Vec<f64>, Vec<f64>) {
    let x: Vec<f64> =
        std::iter::successors(Some(start), |x| Some(0.9 * x + 1.0 + w)).take(steps + 1).collect();
    let y = x[..steps].iter().map(|x| 2.0 * x).collect();
    (x, y)
}

fn history() -> History {
    let (x, y) = recorded(0.0, 30, 0.0);
    History::new(1, 1, &x, &y, 0.1).expect("a valid recording")
}

/// (0.9 d - w)² ≤ 0.5 d² + 2 w² + R (2 d)² holds when 0.81 + 0.81 ≤ 0.5 + 4 R: R = 0.28 by (a - b)²
/// ≤ 2a² + 2b².
fn certificate() -> Certificate {
    Certificate {
        P: vec![1.0],
        Q: vec![2.0],
        R: vec![0.28],
        eta: 0.5,
        growth: Some(0.9),
        model: None,
    }
}

/// An estimator over exact trajectories whose steps carry a bound.
fn bounded(x_prior: f64, certificate: Certificate, disturbance: Disturbance) -> DdMhe {
    let config = Config {
        x_prior: Some(vec![x_prior]),
        space: Space::Exact,
        certificate: Some(certificate),
        disturbance: Some(disturbance),
        ..Config::default()
    };
    DdMhe::new(&history(), config).expect("a valid configuration")
}

#[test]
fn the_smallest_horizon_makes_four_eta_to_the_m_less_than_one() {
    assert_eq!(certificate().minimum_horizon(), 3); // 4 · 0.5² = 1 is not enough
    assert_eq!(Certificate { eta: 0.95, ..certificate() }.minimum_horizon(), 28);
    assert_eq!(Certificate { eta: 0.2, ..certificate() }.minimum_horizon(), 1);
}

#[test]
fn errors_stay_below_the_bound_also_through_lost_outputs() {
    let mut mhe = bounded(6.0, certificate(), Disturbance { initial: 1.0, w: 0.1, v: 0.2 });
    let (truth, outputs) = recorded(5.0, 40, 0.1);
    for (t, y) in outputs.iter().enumerate() {
        let y = if (10..13).contains(&t) {
            f64::NAN
        } else {
            y + 0.2 * if t % 3 == 0 { 1.0 } else { -1.0 }
        };
        let estimate = mhe.step(&[y]).expect("a valid output");
        let error = (estimate.x[0] - truth[t + 1]).abs();
        let bound = estimate.bound.expect("a bound");
        assert!(error <= bound && bound.is_finite(), "step {t}: {error} > {bound}");
    }
}

#[test]
fn a_constant_output_error_is_in_the_bound() {
    // It can be fitted without any residual, so that nothing but the stated size tells of it.
    let blind = Certificate { growth: None, ..certificate() };
    let mut mhe = bounded(5.1, blind, Disturbance { initial: 0.1, w: 0.0, v: 0.2 });
    let (truth, outputs) = recorded(5.0, 40, 0.0);
    for (t, y) in outputs.iter().enumerate() {
        let estimate = mhe.step(&[y + 0.2]).expect("a valid output");
        let error = (estimate.x[0] - truth[t + 1]).abs();
        assert!(
            estimate.bound.is_some_and(|bound| error <= bound),
            "step {t}: {error} > {:?}",
            estimate.bound
        );
    }
}

#[test]
fn a_noisy_recording_without_a_model_leaves_no_bound() {
    let (x, mut y) = recorded(0.0, 30, 0.0);
    y[7] += 1e-9;
    let noisy = History::new(1, 1, &x, &y, 0.1).expect("a valid recording");
    let disturbance = Some(Disturbance { initial: 1.0, w: 0.1, v: 0.2 });
    let config = Config { certificate: Some(certificate()), disturbance, ..Config::default() };
    let mut mhe = DdMhe::new(&noisy, config.clone()).expect("a valid configuration");
    assert!(mhe.warnings().iter().any(|w| w.contains("no error bound is given")));
    assert_eq!(mhe.step(&[1.0]).expect("a step").bound, None);
    let model = |e: Vec<f64>, r: Vec<f64>| Model {
        B: Vec::new(),
        D: Vec::new(),
        A: vec![0.9],
        e,
        C: vec![2.0],
        r,
        identified: false,
        uncertainty: None,
    };
    for (model, bounded) in [(model(vec![1.0], vec![0.0]), true), (model(vec![], vec![]), false)] {
        let certificate = Some(Certificate { model: Some(model), ..certificate() });
        let mhe = DdMhe::new(&noisy, Config { certificate, ..config.clone() })
            .expect("a valid configuration");
        assert_eq!(mhe.is_bounded(), bounded);
    }
}

#[test]
fn without_growth_a_lost_output_leaves_no_bound_until_it_has_left_the_window() {
    let blind = Certificate { growth: None, ..certificate() };
    let last_recorded = history().last_state()[0];
    let mut mhe = bounded(last_recorded, blind, Disturbance { initial: 1.0, w: 0.0, v: 0.0 });
    let (_, outputs) = recorded(5.0, 4, 0.0);
    assert!(mhe.step(&outputs[..1]).expect("a step").bound.is_some_and(f64::is_finite));
    assert_eq!(mhe.step(&[f64::NAN]).expect("a step").bound, Some(f64::INFINITY));
}

#[test]
fn a_certificate_excludes_scalar_weights_and_short_horizons() {
    let with = |config: Config| DdMhe::new(&history(), config).err();
    let base = Config { certificate: Some(certificate()), ..Config::default() };
    assert!(matches!(
        with(Config { rho: Some(0.9), ..base.clone() }),
        Some(Error::Value { argument: "rho", .. })
    ));
    assert!(matches!(
        with(Config { horizon: Some(2), ..base.clone() }),
        Some(Error::Value { argument: "horizon", .. })
    ));
    let lopsided = Certificate { P: vec![1.0, 2.0], ..certificate() };
    let wrong = Config { certificate: Some(lopsided), ..Config::default() };
    assert!(matches!(with(wrong), Some(Error::Shape { argument: "certificate", .. })));
}

#[test]
fn validation_scores_what_run_gives() {
    let (truth, outputs) = recorded(5.0, 20, 0.0);
    let fold = Fold {
        history: history(),
        x_prior: vec![4.0],
        outputs: outputs.clone(),
        inputs: Vec::new(),
        truth: truth[1..].to_vec(),
        spans: vec![5, 20],
        spread: vec![0.5],
    };
    let config = Config { horizon: Some(4), mu: Some(1e-3), ..Config::default() };
    let jobs = [(0, config.clone()), (0, Config { horizon: Some(99), ..config.clone() })];
    let scores = validate(&[fold], &jobs, &mut |_| false).expect("valid folds");
    let scores: Vec<_> =
        scores.into_iter().map(|score| score.expect("nothing stopped it")).collect();
    let mut mhe = DdMhe::new(&history(), Config { x_prior: Some(vec![4.0]), ..config })
        .expect("a valid configuration");
    let log = mhe.run(&outputs).expect("valid outputs");
    let mean = |span: usize| {
        (0..span).map(|k| ((log.x[k] - truth[k + 1]) / 0.5).powi(2)).sum::<f64>() / span as f64
    };
    // the scores come from the linear map of the window, another order of the same sums
    for (score, span) in scores[0].errors.iter().zip([5, 20]) {
        assert!((score - mean(span)).abs() <= 1e-13 * mean(span), "{score} {}", mean(span));
    }
    assert!(scores[1].errors.iter().all(|e| e.is_infinite()));
}
