//! Scores of settings are those of estimators run over the same outputs, whatever the units and the
//! weights.

use ddmhe_core::validation::{Fold, Score, validate};
use ddmhe_core::{Config, DdMhe, Equilibrium, History, Space, Start, Weighting};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const STEPS: usize = 120;
const RECORDED: usize = 90;

/// A damped oscillation in units 1e6 apart; two noisy outputs in units 1e3 apart and a constant.
fn signals() -> (Vec<f64>, Vec<f64>) {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut noise = |size: f64| size * rng.random_range(-1.0..1.0);
    let (mut a, mut b) = (1.0, 0.5);
    let (mut x, mut y) = (vec![], vec![]);
    for _ in 0..=STEPS {
        x.extend([1e3 * a + noise(1.0) + 40.0, 1e-3 * b + noise(1e-6)]);
        y.extend([a + b + noise(1e-2) - 3.0, 1e3 * (a - 2.0 * b) + noise(5.0), 7.5]);
        (a, b) = (0.98 * a + 0.15 * b, -0.15 * a + 0.98 * b);
    }
    y.truncate(3 * STEPS);
    (x, y)
}

/// Learnt from the first samples, with the others to be estimated.
fn fold(history: History, x: &[f64], y: &[f64]) -> Fold {
    let (n, p) = (history.n(), history.p());
    let at = history.T();
    Fold {
        x_prior: x[at * n..(at + 1) * n].to_vec(),
        outputs: y[at * p..].to_vec(),
        inputs: Vec::new(),
        truth: x[(at + 1) * n..].to_vec(),
        spans: vec![1, 7, y.len() / p - at],
        spread: (0..n).map(|i| [300.0, 3e-4][i]).collect(),
        history,
    }
}

/// The score of an estimator, by its own run.
fn by_run(fold: &Fold, config: &Config) -> Score {
    let x_prior = matches!(config.start, Start::State | Start::Auto).then(|| fold.x_prior.clone());
    let config = Config { x_prior, ..config.clone() };
    let mut mhe = DdMhe::new(&fold.history, config).unwrap();
    let spectral_radius = mhe.spectral_radius();
    let log = mhe.run(&fold.outputs).unwrap();
    let n = fold.history.n();
    let square = |k: usize| ((log.x[k] - fold.truth[k]) / fold.spread[k % n]).powi(2);
    let errors = fold
        .spans
        .iter()
        .map(|span| (0..span * n).map(square).sum::<f64>() / (span * n) as f64)
        .collect();
    Score { errors, spectral_radius }
}

fn agree(fold: &Fold, configs: &[Config]) {
    let jobs: Vec<(usize, Config)> = configs.iter().map(|config| (0, config.clone())).collect();
    let scores = validate(std::slice::from_ref(fold), &jobs, &mut |_| false).unwrap();
    assert_eq!(scores.len(), configs.len());
    for (config, score) in configs.iter().zip(scores) {
        let (score, expected) = (score.unwrap(), by_run(fold, config));
        // rounding times the condition of the least determined window: 1e8 at rank 4 of outputs of
        // one unit
        let tolerance = if matches!(config.space, Space::Truncated { .. }) { 1e-7 } else { 1e-9 };
        let pairs = score.errors.iter().zip(&expected.errors);
        for (found, expected) in pairs.chain([(&score.spectral_radius, &expected.spectral_radius)])
        {
            assert!(
                (found - expected).abs() <= tolerance * expected,
                "{found} for {expected}: {config:?}"
            );
        }
    }
}

/// Every kind of weight and of space.
fn settings() -> Vec<Config> {
    let base = |M: usize| Config { horizon: Some(M), rho: Some(0.9), ..Config::default() };
    let paper = |mu: f64| Config { mu: Some(mu), weights: Weighting::Paper, ..base(8) };
    let scaled = |mu: f64| Config { mu: Some(mu), weights: Weighting::Scaled, ..base(8) };
    let ridge = |weight: f64, normalised: bool| Space::Ridge { weight, normalised };
    vec![
        Config { space: ridge(1e-3, true), ..scaled(0.3) },
        Config { space: Space::Truncated { rank: Some(4), tol: None }, ..scaled(0.3) },
        scaled(1.0),
        Config { space: ridge(1e-3, true), ..paper(20.0) },
        Config { space: ridge(0.5, false), ..paper(2e-3) },
        Config { space: Space::Truncated { rank: None, tol: None }, ..paper(1e3) },
        paper(1.0),
        Config { mu: Some(1e-2), ..Config::default() },
        Config { horizon: Some(12), ..Config::default() },
        Config::default(), // which may take other scales
    ]
}

#[test]
fn units_and_weights_score_as_they_run() {
    let share = if cfg!(debug_assertions) { 3 } else { 1 }; // of the settings, unoptimised
    let (x, y) = signals();
    let (x_r, y_r) = (&x[..(RECORDED + 1) * 2], &y[..RECORDED * 3]);
    let history = History::new(2, 3, x_r, y_r, 0.1).unwrap();
    let named = history.clone().with_units(&["m"], &["V", "V", "K"]).unwrap();
    for history in [history, named] {
        let rest = Equilibrium { x: vec![40.0, 0.0], y: vec![-3.0, 0.0, 7.5], u: vec![] };
        let fold = fold(history, &x, &y);
        for start in [Start::State, Start::Recording, Start::Unknown] {
            for equilibrium in [None, Some(rest.clone())] {
                let vary = |config| Config { start, equilibrium: equilibrium.clone(), ..config };
                agree(&fold, &settings().into_iter().step_by(share).map(vary).collect::<Vec<_>>());
            }
        }
    }
}

#[test]
fn an_estimate_that_runs_away_scores_as_it_runs() {
    let x: Vec<f64> = (0..=20).map(|k| 1.8_f64.powi(k)).collect();
    let history = History::new(1, 1, &x, &x[..20], 0.1).unwrap();
    let outputs = [vec![1.0; 80], vec![1e300, 1.0]].concat();
    let fold = Fold {
        history,
        x_prior: vec![1.0],
        truth: vec![0.0; outputs.len()],
        spans: vec![outputs.len() - 2],
        spread: vec![1.0],
        outputs,
        inputs: Vec::new(),
    };
    agree(
        &fold,
        &[1e-12, 1.0].map(|mu| Config { horizon: Some(1), mu: Some(mu), ..Config::default() }),
    );
}
