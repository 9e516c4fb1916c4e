//! A downdate against a problem made for the outputs that are left.

use crate::design::Design;
use crate::fallback::Fallbacks;
use crate::needs::Needs;
use crate::plan_builder::Prepared;
use crate::{Bounds, Certificate, Config, History, Space};
use ddmhe_run::memory::{Memory, Parts, memory_len};
use ddmhe_run::problem::{Data, Fit};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const STEPS: usize = 80;

/// Two coupled oscillations seen through two outputs.
fn history(rng: &mut ChaCha8Rng) -> History {
    let (mut x, mut y, mut state) = (vec![1.0, 0.0, 0.5, -0.5], Vec::new(), [1.0, 0.0, 0.5, -0.5]);
    for _ in 0..STEPS {
        y.extend(
            [state[0] + state[3], state[1] - 0.5 * state[2]]
                .map(|v| v + rng.random_range(-0.01..0.01)),
        );
        let [a, b, c, d] = state;
        state = [
            0.95 * a - 0.3 * b,
            0.3 * a + 0.95 * b + 0.02 * c,
            0.8 * c - 0.6 * d,
            0.6 * c + 0.8 * d,
        ];
        x.extend(state);
    }
    History::new(4, 2, &x, &y, 0.1).unwrap()
}

fn configs() -> Vec<Config> {
    let plain = Config { horizon: Some(12), rho: Some(0.9), mu: Some(5.0), ..Config::default() };
    let identity = |n: usize| {
        (0..n * n).map(|k| if k % (n + 1) == 0 { 1.0 } else { 0.0 }).collect::<Vec<f64>>()
    };
    let coupled = Certificate {
        P: identity(4),
        Q: identity(4),
        R: vec![3.0, 1.0, 1.0, 2.0],
        eta: 0.8,
        growth: None,
        model: None,
    };
    let bounds = Some(Bounds { lo: vec![-0.9; 2], hi: vec![0.9; 2] });
    vec![
        plain.clone(),
        Config {
            v_bounds: bounds,
            space: Space::Truncated { rank: Some(6), tol: None },
            ..plain.clone()
        },
        Config { rho: None, mu: None, certificate: Some(coupled), ..plain },
    ]
}

#[test]
fn a_downdate_gives_what_a_new_factorisation_gives() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let history = history(&mut rng);
    for config in configs() {
        let design = Design::new(&history, &config, Needs::of(&config, config.begins())).unwrap();
        let full = design.problem(12);
        let (mut compared, mut bound) = (0, 0);
        for _ in 0..300 {
            let lost = rng.random_range(0.05..0.5);
            let mut y: Vec<f64> = (0..24).map(|_| rng.random_range(-1.0..1.0)).collect();
            y.iter_mut().for_each(|y| *y = if rng.random_bool(lost) { f64::NAN } else { *y });
            let prior: Vec<f64> = (0..4).map(|_| rng.random_range(-1.0..1.0)).collect();
            let means = full.problem().means(None);
            let data = Data {
                prior: &prior,
                outputs: &y,
                missing: true,
                filtered: None,
                lacking: None,
                means,
                x_bounds: None,
                begun: false,
            };
            let solve = |prepared: &Prepared| {
                let sizes = design.ground.sizes();
                let mut memory = Memory::new(sizes, vec![0.0; memory_len(sizes)]);
                let Parts { mut scratch, mut working, .. } = memory.parts();
                let (mut states, mut v) = (vec![0.0; 52], vec![0.0; 24]);
                let fallback = Fallbacks { design: &design, weights: &design.weights, prepared };
                let room = (&mut working, &mut scratch);
                let mut out = Fit { states: &mut states, v: &mut v, w: &mut [] };
                let found = prepared.problem().solve(&fallback, &data, room, &mut out)?;
                Some((found, states, v))
            };
            let anew = solve(&design.without_missing(full, &design.weights, &y).unwrap()).unwrap();
            let Some(quick) = solve(full) else { continue };
            compared += 1;
            bound += usize::from(quick.0.active > 0);
            assert_eq!(quick.0.status, anew.0.status);
            let close = |a: f64, b: f64| {
                (a - b).abs() < 1e-9 * (1.0 + b.abs()) || (a.is_nan() && b.is_nan())
            };
            assert!(quick.1.iter().zip(&anew.1).all(|(a, b)| close(*a, *b)));
            assert!(quick.2.iter().zip(&anew.2).all(|(a, b)| close(*a, *b)));
            assert!(close(quick.0.cost, anew.0.cost), "{} {}", quick.0.cost, anew.0.cost);
        }
        assert!(compared > 250 && (bound > 20 || config.v_bounds.is_none()), "{compared} {bound}");
    }
}
