//! Hostile problems: whatever the status says must be true.

mod active_set;
pub(crate) mod dense;
mod lost_outputs;

use super::*;
use crate::own::{OwnRows, OwnSet};
use ddmhe_run::panels::padded;
use dense::Dense;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;

const INF: f64 = f64::INFINITY;

/// Rows in units up to 1e8 apart, some of them equal, opposite or parallel up to 1e-4 … 1e-14,
/// with z* at up to 1e9.
struct Hostile {
    A: Mat<f64>,
    unit: Vec<f64>,
    free: Vec<f64>,
    inside: Vec<f64>,
    lo: Vec<f64>,
    hi: Vec<f64>,
    // by which a pair of bounds contradict each other, in units; 0: `inside` satisfies all
    excess: f64,
}

fn along(A: &Mat<f64>, row: usize, z: &[f64]) -> f64 {
    (0..A.ncols()).map(|j| A[(row, j)] * z[j]).sum()
}

fn hostile(rng: &mut ChaCha8Rng) -> Hostile {
    let (rows, r): (usize, usize) = (rng.random_range(2..60), rng.random_range(1..16));
    let len = padded(rows);
    let mut unit = vec![0.0; len];
    let mut A = Mat::zeros(len, r);
    for i in 0..rows {
        let other = if i > 0 { rng.random_range(0..i) } else { 0 };
        let (sign, off) = match rng.random_range(0..12) {
            0 if i > 0 => (1.0, 0.0),
            1 if i > 0 => (-1.0, 0.0),
            2 if i > 0 => (
                if rng.random_bool(0.5) { 1.0 } else { -1.0 },
                10_f64.powi(-rng.random_range(2..15)),
            ),
            _ => (0.0, 1.0),
        };
        let scale =
            if rng.random_bool(0.5) { 1.0 } else { 10_f64.powf(rng.random_range(-8.0..0.0)) };
        let length = if unit[other] > 0.0 { unit[other] } else { 1.0 };
        for j in 0..r {
            A[(i, j)] = scale * (sign * A[(other, j)] / length + off * rng.random_range(-1.0..1.0));
        }
        unit[i] = scale;
    }
    let inside: Vec<f64> = (0..r).map(|_| rng.random_range(-2.0..2.0)).collect();
    let far = if rng.random_bool(0.5) { 3.0 } else { 10_f64.powf(rng.random_range(0.0..9.0)) };
    let mut free = vec![0.0; padded(r)];
    (0..r).for_each(|j| free[j] = inside[j] + far * rng.random_range(-1.0..1.0));
    let (mut lo, mut hi) = (vec![-INF; len], vec![INF; len]);
    for i in 0..rows {
        let w = along(&A, i, &inside);
        let mut room =
            || if rng.random_bool(0.3) { 0.0 } else { unit[i] * rng.random_range(0.0..0.5) };
        let (below, above) = (room(), room());
        match rng.random_range(0..5) {
            0 => (lo[i], hi[i]) = (w, w),
            1 => lo[i] = w - below,
            2 => hi[i] = w + above,
            3 => {}
            _ => (lo[i], hi[i]) = (w - below, w + above),
        }
    }
    let mut excess = 0.0;
    if rng.random_bool(0.3) {
        // the last row is the first one, or a sum of others, with a bound that these exclude
        let many = rng.random_range(1..=(rows - 1).min(r));
        let weights: Vec<f64> = (0..many).map(|_| rng.random_range(0.1..1.0)).collect();
        excess = 10_f64.powf(rng.random_range(-8.0..1.0));
        let last = rows - 1;
        unit[last] = 1.0;
        (0..r)
            .for_each(|j| A[(last, j)] = (0..many).map(|i| weights[i] * A[(i, j)] / unit[i]).sum());
        for i in 0..many {
            hi[i] = along(&A, i, &inside);
            lo[i] = lo[i].min(hi[i]);
        }
        lo[last] = (0..many).map(|i| weights[i] * hi[i] / unit[i]).sum::<f64>()
            + excess * (many as f64 + 1.0);
        hi[last] = INF;
    }
    Hostile { A, unit, free, inside, lo, hi, excess }
}

/// Status, and the largest violation in units and the distance from z*.
fn solve(p: &Hostile) -> (Status, bool, Vec<f64>, Vec<f64>) {
    let (len, r) = (p.A.nrows(), p.A.ncols());
    let rows = OwnRows::new(p.A.as_ref(), vec![0.0; len], p.unit.clone());
    let windows = Dense(p.A.clone());
    let problem = windows.problem(&rows, &p.lo, &p.hi, &p.free);
    let (mut z, mut w) = (vec![0.0; padded(r)], vec![0.0; len]);
    let (status, quick) = match problem.solve(
        &mut OwnSet::new(r).working(),
        &mut vec![0.0; work_len(r)],
        &mut z,
        &mut w,
    ) {
        Outcome::Optimal(_) => (Status::Optimal, true),
        Outcome::Infeasible(_) => (Status::Infeasible, true),
        Outcome::Uncertain => (way_out(&problem, &mut z, &mut w).0, false),
    };
    (status, quick, z, w)
}

#[test]
fn every_status_is_true() {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut counts = BTreeMap::<(String, bool, &str), usize>::new();
    // a tenth without optimisation, which takes seven times as long
    let share = if cfg!(debug_assertions) { 10 } else { 1 };
    for k in 0..20_000 / share {
        let p = hostile(&mut rng);
        let (status, quick, z, w) = solve(&p);
        let kind = if p.excess > 0.0 { "contradicting" } else { "feasible" };
        *counts.entry((kind.to_string(), quick, status.as_str())).or_default() += 1;
        let tolerance = match status {
            Status::Optimal => 1e-9,
            Status::AlmostOptimal => 1e-6,
            Status::Infeasible => {
                assert!(p.excess > 0.0, "{k}: a window is known that satisfies all bounds");
                continue;
            }
            _ => continue,
        };
        // a row is summed from numbers of this size
        let size = |i: usize| {
            z[..p.A.ncols()]
                .iter()
                .zip(0..)
                .map(|(z, j)| (p.A[(i, j)] * z).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        let violation = |i: usize| {
            (p.lo[i] - w[i]).max(w[i] - p.hi[i]) / (p.unit[i] + 10.0 * tol::SUMMED * size(i))
        };
        let worst = (0..w.len()).filter(|i| p.unit[*i] > 0.0).map(violation).fold(0.0, f64::max);
        assert!(worst <= tolerance * 1.001, "{k}: {status:?} {worst:e}");
        assert!(
            p.excess < 1e-6,
            "{k}: {status:?} although bounds contradict each other by {:e}",
            p.excess
        );
        if p.excess == 0.0 {
            // no admissible direction leads down: (z - z*)ᵀ(q - z) ≥ 0 for every q inside
            let sum = |f: &dyn Fn(usize) -> f64| (0..p.inside.len()).map(f).sum::<f64>();
            let (t, q) = (|j: usize| z[j] - p.free[j], |j: usize| p.inside[j] - z[j]);
            let slope = sum(&|j| t(j) * q(j));
            let norm = |v: &dyn Fn(usize) -> f64| sum(&|j| v(j) * v(j)).sqrt();
            let scale = norm(&t).max(norm(&|j| p.free[j]));
            let size = scale * (scale + norm(&q));
            let tolerance = if status == Status::Optimal { 1e-8 } else { 1e-4 };
            assert!(slope >= -tolerance * size, "{k}: {status:?} {slope:e} of {size:e}");
        }
    }
    let of = |kind: &str, status: &str| -> usize {
        counts.iter().filter(|((k, _, s), _)| k == kind && *s == status).map(|(_, n)| n).sum()
    };
    // nearly all of them are decided, and only what is nearly dependent needs the way out
    assert!(of("feasible", "failed") < 28 && of("contradicting", "failed") < 12, "{counts:?}");
    assert!(
        share * of("feasible", "optimal") > 13_000
            && share * of("contradicting", "infeasible") > 5_500,
        "{counts:?}"
    );
}
