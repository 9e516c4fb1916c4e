//! The dual active-set method against the way out and by hand.

use super::dense::Dense;
use crate::own::{OwnRows, OwnSet};
use crate::way_out::way_out;
use ddmhe_run::Status;
use ddmhe_run::active_set::{ActiveBound, Outcome, work_len};
use ddmhe_run::panels::padded;
use faer::Mat;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const INF: f64 = f64::INFINITY;

/// The method with its memory, about z* = 0 and with windows A z.
struct Solver {
    A: Dense,
    rows: OwnRows,
    set: OwnSet,
    memory: Vec<f64>,
}

impl Solver {
    fn new(A: &Mat<f64>) -> Self {
        let (len, r) = (padded(A.nrows()), A.ncols());
        let all = Mat::from_fn(len, r, |i, j| if i < A.nrows() { A[(i, j)] } else { 0.0 });
        Solver {
            rows: OwnRows::new(all.as_ref(), vec![0.0; len], vec![1.0; len]),
            set: OwnSet::new(r),
            memory: vec![0.0; work_len(r)],
            A: Dense(all),
        }
    }

    fn kept(&mut self) -> Vec<ActiveBound> {
        self.set.working().sides.iter().collect()
    }

    /// Padded bounds, z* = 0, and room for z and its window.
    fn room(&self, lo: &[f64], hi: &[f64]) -> [Vec<f64>; 5] {
        let (len, r) = (self.A.0.nrows(), padded(self.A.0.ncols()));
        let (mut lo, mut hi) = (lo.to_vec(), hi.to_vec());
        lo.resize(len, -INF);
        hi.resize(len, INF);
        [lo, hi, vec![0.0; r], vec![0.0; r], vec![0.0; len]]
    }

    fn solve(&mut self, lo: &[f64], hi: &[f64]) -> (Outcome, Vec<f64>) {
        let r = self.A.0.ncols();
        let [lo, hi, free, mut z, mut w] = self.room(lo, hi);
        let problem = self.A.problem(&self.rows, &lo, &hi, &free);
        let outcome = problem.solve(&mut self.set.working(), &mut self.memory, &mut z, &mut w);
        z.truncate(r);
        (outcome, z)
    }

    /// What the way out finds.
    fn way_out(&self, lo: &[f64], hi: &[f64]) -> (Status, Vec<f64>) {
        let r = self.A.0.ncols();
        let [lo, hi, free, mut z, mut w] = self.room(lo, hi);
        let problem = self.A.problem(&self.rows, &lo, &hi, &free);
        let (status, _) = way_out(&problem, &mut z, &mut w);
        z.truncate(r);
        (status, z)
    }
}

fn solve(rows: &[[f64; 2]], lo: &[f64], hi: &[f64]) -> (Outcome, Vec<f64>) {
    Solver::new(&Mat::from_fn(rows.len(), 2, |i, j| rows[i][j])).solve(lo, hi)
}

fn close((outcome, z): (Outcome, Vec<f64>), expected: [f64; 2]) -> bool {
    matches!(outcome, Outcome::Optimal(_))
        && z.iter().zip(expected).all(|(z, e)| (z - e).abs() < 1e-12)
}

#[test]
fn the_origin_is_the_answer_when_it_is_inside() {
    assert!(close(solve(&[[1.0, 0.0], [1.0, 2.0]], &[-1.0, -INF], &[1.0, 3.0]), [0.0, 0.0]));
}

#[test]
fn projections_that_can_be_done_by_hand() {
    // onto x ≥ 1; onto the line x + y = 2; onto the corner of x ≥ 1, y ≥ 2
    assert!(close(solve(&[[1.0, 0.0]], &[1.0], &[INF]), [1.0, 0.0]));
    assert!(close(solve(&[[1.0, 1.0]], &[2.0], &[2.0]), [1.0, 1.0]));
    assert!(close(solve(&[[1.0, 0.0], [0.0, 1.0]], &[1.0, 2.0], &[INF, INF]), [1.0, 2.0]));
}

#[test]
fn redundant_and_repeated_rows_do_no_harm() {
    assert!(close(
        solve(&[[1.0, 0.0], [1.0, 0.0], [2.0, 0.0]], &[1.0, 1.0, 2.0], &[INF, 3.0, INF]),
        [1.0, 0.0]
    ));
}

#[test]
fn contradicting_bounds_are_infeasible() {
    let (outcome, _) = solve(&[[1.0, 0.0], [1.0, 0.0]], &[1.0, -INF], &[INF, 0.0]);
    assert!(matches!(outcome, Outcome::Infeasible(_)));
}

/// Random windows with redundant, equal, opposite and nearly parallel rows, bounds that touch,
/// and contradictions. The last number is the closest that two rows come to being parallel
/// without being so: rounding of the data moves the answer by its inverse.
fn random_problem(rng: &mut ChaCha8Rng) -> (Mat<f64>, Vec<f64>, f64) {
    let mut closest = 1.0_f64;
    let (rows, r) = (rng.random_range(1..40), rng.random_range(1..12));
    let mut A = Mat::from_fn(rows, r, |_, _| rng.random_range(-1.0..1.0_f64));
    let inside: Vec<f64> = (0..r).map(|_| rng.random_range(-2.0..2.0)).collect();
    for i in 1..rows {
        let other = rng.random_range(0..i);
        let (scale, off): (f64, f64) = match rng.random_range(0..16) {
            0 => (1.0, 0.0),
            1 => (-2.0, 0.0),
            2 if rng.random_bool(0.2) => (1.0, 1e-8),
            2 => (1.0, 1e-4),
            3 => (0.0, 0.0),
            _ => continue,
        };
        closest = closest.min(if off > 0.0 { off } else { 1.0 });
        (0..r).for_each(|j| A[(i, j)] = scale * A[(other, j)] + off * rng.random_range(-1.0..1.0));
    }
    (A, inside, closest)
}

/// Bounds about a point: some touch, and sometimes they contradict each other.
fn random_bounds(rng: &mut ChaCha8Rng, A: &Mat<f64>, inside: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let rows = A.nrows();
    let (mut lo, mut hi) = (vec![-INF; rows], vec![INF; rows]);
    let contradiction = rng.random_bool(0.1);
    for i in 0..rows {
        let w: f64 = (0..A.ncols()).map(|j| A[(i, j)] * inside[j]).sum();
        let shift = if contradiction && rng.random_bool(0.2) { 1.5 } else { 0.0 };
        match rng.random_range(0..6) {
            0 => (lo[i], hi[i]) = (w + shift, w + shift), // touch
            1 => lo[i] = w + shift - rng.random_range(0.0..0.3),
            2 => hi[i] = w - shift + rng.random_range(0.0..0.3),
            3 => {}
            _ => {
                lo[i] = w + shift - rng.random_range(0.0..0.5);
                hi[i] = w + shift + rng.random_range(0.0..0.5);
            }
        }
    }
    (lo, hi)
}

#[test]
fn warm_or_cold_it_gives_the_interior_point_s_answer() {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let (mut optimal, mut infeasible, mut left, mut kept, mut refuted) = (0, 0, 0, 0, 0);
    // a tenth without optimisation, which takes seven times as long
    let share = if cfg!(debug_assertions) { 10 } else { 1 };
    for k in 0..25_000 / share {
        let (A, mut inside, closest) = random_problem(&mut rng);
        let mut warm = Solver::new(&A);
        for _ in 0..4 {
            let (lo, hi) = random_bounds(&mut rng, &A, &inside);
            inside.iter_mut().for_each(|v| *v += rng.random_range(-0.1..0.1));
            let reference = warm.way_out(&lo, &hi);
            kept += usize::from(!warm.kept().is_empty());
            for (outcome, z) in [warm.solve(&lo, &hi), Solver::new(&A).solve(&lo, &hi)] {
                match outcome {
                    Outcome::Optimal(_) => {
                        let excess = |i: usize| {
                            let w: f64 = (0..z.len()).map(|j| A[(i, j)] * z[j]).sum();
                            (lo[i] - w).max(w - hi[i])
                        };
                        assert!((0..A.nrows()).all(|i| excess(i) < 1e-9), "{k}");
                        if reference.0 == Status::Optimal {
                            let size = z.iter().fold(1.0_f64, |m, v| m.max(v.abs()));
                            let off = z
                                .iter()
                                .zip(&reference.1)
                                .fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
                            assert!(closest < 1e-6 || off <= 1e-9 * size, "{k}: {off:e}");
                        }
                        // with a point in hand that satisfies all bounds, the reference is
                        // wrong: seen far from z*
                        refuted += usize::from(reference.0 == Status::Infeasible);
                        optimal += 1;
                    }
                    Outcome::Infeasible(_) => {
                        // proved of windows within a million times the bounds' size
                        let size = reference.1.iter().map(|z| z.abs()).fold(0.0, f64::max);
                        assert!(reference.0 != Status::Optimal || size > 1e6, "{k}: {size:e}");
                        infeasible += 1;
                    }
                    Outcome::Uncertain => left += 1,
                }
            }
        }
    }
    // it must do nearly all of the work, from kept bounds as well, and see contradictions
    assert!(
        share * optimal > 180_000 && share * infeasible > 10_000 && share * kept > 50_000,
        "{optimal} {infeasible} {kept}"
    );
    assert!(share * left < 2000 && refuted < 5, "{left} {refuted}");
}

#[test]
fn an_answer_depends_on_the_kept_list_alone() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for k in 0..300 {
        let (A, mut inside, _) = random_problem(&mut rng);
        let mut running = Solver::new(&A);
        for _ in 0..20 {
            let (lo, hi) = random_bounds(&mut rng, &A, &inside);
            inside.iter_mut().for_each(|v| *v += rng.random_range(-0.05..0.05));
            let mut restored = Solver::new(&A);
            running.kept().iter().for_each(|side| restored.set.working().sides.push(*side));
            let (found, again) = (running.solve(&lo, &hi), restored.solve(&lo, &hi));
            assert!(
                found.0 == again.0
                    && (found.1 == again.1 || !matches!(found.0, Outcome::Optimal(_))),
                "{k}"
            );
            assert_eq!(running.kept(), restored.kept());
        }
    }
}
