//! Two methods agree on bounds that may be left, and no other point is better.

use super::*;
use crate::own::OwnSet;
use crate::way_out::tests::dense::Dense;
use ddmhe_run::Prices;
use ddmhe_run::active_set::{Outcome, priced_len};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const INF: f64 = f64::INFINITY;

/// Rows of different units, some of them parallel; bounds anywhere. Those of the first `split` rows
/// may be left.
struct Random {
    dense: Dense,
    own: OwnRows,
    unit: Vec<f64>,
    free: Vec<f64>,
    lo: Vec<f64>,
    hi: Vec<f64>,
    factor: Option<Vec<f64>>,
    split: usize,
    price: f64,
}

fn random(rng: &mut ChaCha8Rng) -> Random {
    let (split, hard, r) =
        (8 * rng.random_range(1..4), 8 * rng.random_range(0..2), rng.random_range(1..9));
    let len = split + hard;
    let mut A = Mat::from_fn(len, r, |_, _| rng.random_range(-1.0..1.0));
    let mut unit = vec![1.0; len];
    for i in 1..len {
        if rng.random_bool(0.3) {
            let (other, turn) =
                (rng.random_range(0..i), if rng.random_bool(0.5) { 1.0 } else { -1.0 });
            (0..r).for_each(|j| A[(i, j)] = turn * A[(other, j)] / unit[other]);
        }
        unit[i] = 10_f64.powf(rng.random_range(-3.0..0.0));
        (0..r).for_each(|j| A[(i, j)] *= unit[i]);
    }
    if rng.random_bool(0.3) {
        (0..r).for_each(|j| A[(0, j)] = 0.0); // no z moves it
    }
    let mut free = vec![0.0; padded(r)];
    (0..r).for_each(|j| free[j] = rng.random_range(-3.0..3.0));
    let (mut lo, mut hi) = (vec![-INF; len], vec![INF; len]);
    for i in 0..len {
        // hard bounds hold at 0
        let middle = if i < split { unit[i] * rng.random_range(-2.0..2.0) } else { 0.0 };
        let room = unit[i] * if rng.random_bool(0.3) { 0.0 } else { rng.random_range(0.0..1.0) };
        match rng.random_range(0..4) {
            0 => lo[i] = middle - room,
            1 => hi[i] = middle + room,
            2 => {}
            _ => (lo[i], hi[i]) = (middle - room, middle + room),
        }
    }
    let stride = Rows::stride_of(r);
    let mut L = vec![0.0; r * stride];
    for i in 0..r {
        (0..i).for_each(|j| L[i * stride + j] = rng.random_range(-0.3..0.3));
        L[i * stride + i] = rng.random_range(0.3..1.0);
    }
    let factor = rng.random_bool(0.5).then_some(L);
    let own = OwnRows::new(A.as_ref(), vec![0.0; len], unit.clone());
    let price = 10_f64.powf(rng.random_range(-3.0..5.0));
    Random { dense: Dense(A), own, unit, free, lo, hi, factor, split, price }
}

impl Random {
    fn problem(&self) -> Erased<'_> {
        let prices = Prices { x: self.price, ..Prices::default() };
        let prices = prices.of_blocks([self.split, self.unit.len()]);
        let plain = self.dense.problem(&self.own, &self.lo, &self.hi, &self.free);
        Erased { hessian_factor: self.factor.as_deref(), prices, ..plain }
    }

    /// Twice the cost that is halved there, infinite where a hard bound does not hold.
    fn cost(&self, z: &[f64]) -> f64 {
        let mut w = vec![0.0; self.unit.len()];
        self.dense.window(z, &mut w);
        let (r, stride) = (z.len(), Rows::stride_of(z.len()));
        let moved: Vec<f64> = z.iter().zip(&self.free).map(|(z, free)| z - free).collect();
        let along = |j: usize| match &self.factor {
            Some(L) => (j..r).map(|i| L[i * stride + j] * moved[i]).sum(),
            None => moved[j],
        };
        let distance: f64 = (0..r).map(|j| f64::powi(along(j), 2)).sum();
        let price = |i: usize| {
            let e = (self.lo[i] - w[i]).max(w[i] - self.hi[i]).max(0.0) / self.unit[i];
            match i < self.split {
                true => self.price * (e + e * e),
                false if e > 1e-9 => INF,
                false => 0.0,
            }
        };
        distance + (0..w.len()).map(price).sum::<f64>()
    }
}

#[test]
fn two_methods_agree_and_no_other_point_is_better() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let (mut left, mut uncertain) = (0, 0);
    for number in 0..3000 {
        let random = random(&mut rng);
        let problem = random.problem();
        let (r, len) = (problem.rows.r, random.unit.len());
        let (mut z, mut w) = (vec![0.0; padded(r)], vec![0.0; len]);
        let mut set = OwnSet::new(padded(r));
        let mut memory = vec![f64::NAN; priced_len(r, len, random.split)];
        let outcome = problem.priced(&mut set.working(), &mut memory, &mut z, &mut w);
        let (mut other, mut window) = (z.clone(), w.clone());
        let (status, _) = way_out_priced(&problem, &mut other, &mut window);
        assert_eq!(status, Status::Optimal, "{number}");
        if !matches!(outcome, Outcome::Optimal(_)) {
            uncertain += 1;
            continue;
        }
        let outside = |i: usize| (random.lo[i] - w[i]).max(w[i] - random.hi[i]) / random.unit[i];
        left += (0..random.split).filter(|i| outside(*i) > 1e-6).count();
        for i in 0..len {
            let off = (w[i] - window[i]).abs() / random.unit[i];
            assert!(off < 1e-7, "{number}: row {i} {off:e}");
        }
        let (z, least) = (&z[..r], random.cost(&z[..r]));
        for _ in 0..20 {
            let size = 10_f64.powf(rng.random_range(-4.0..0.0));
            let near: Vec<f64> = z.iter().map(|z| z + size * rng.random_range(-1.0..1.0)).collect();
            assert!(random.cost(&near) > least - 1e-9 * least.max(1.0), "{number}");
        }
    }
    assert!(left > 3000 && uncertain < 10, "{left} {uncertain}");
}
