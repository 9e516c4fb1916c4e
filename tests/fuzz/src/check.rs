//! What must hold whatever an estimator is given; each function panics where it does not.

use super::case::{Case, Sample};
use ddmhe_core::{DdMhe, Estimate, History, Signals, Status, Step};
use ddmhe_run::{Plan, Stepper};

/// How often what came out.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct Outcomes {
    /// Recordings or settings that were refused.
    pub refused: usize,
    /// Estimators that were made.
    pub made: usize,
    /// Steps by status: optimal, almost optimal, infeasible, failed.
    pub steps: [usize; 4],
    /// Samples that were refused.
    pub rejected: usize,
    /// Steps of a plan that were compared with the estimator's.
    pub flown: usize,
}

impl Outcomes {
    /// The sum of both.
    pub fn plus(self, other: Self) -> Self {
        Outcomes {
            refused: self.refused + other.refused,
            made: self.made + other.made,
            steps: std::array::from_fn(|k| self.steps[k] + other.steps[k]),
            rejected: self.rejected + other.rejected,
            flown: self.flown + other.flown,
        }
    }
}

/// An estimate as it can be compared: bits of every number, one for all NaN.
pub type Bits = (Vec<u64>, Option<u64>, Status, usize);

/// These numbers' bits.
pub fn bits<'a>(numbers: impl IntoIterator<Item = &'a f64>) -> Vec<u64> {
    let bits = |x: &f64| if x.is_nan() { f64::NAN } else { *x }.to_bits();
    numbers.into_iter().map(bits).collect()
}

/// This estimate's bits.
pub fn of(e: &Estimate) -> Bits {
    let mut numbers = [&e.x, &e.window, &e.v, &e.w, &vec![e.cost]].map(bits).concat();
    if let Some(own) = &e.evidence {
        let parts = [&own.covariance, &own.innovation, &own.innovation_variance, &vec![own.value]];
        numbers.extend(parts.map(bits).concat());
        numbers.push(u64::from(own.reasons.bits()));
    }
    (numbers, e.bound.map(f64::to_bits), e.status, e.active)
}

fn step_of(sample: &Sample) -> Step<'_> {
    Step { y: &sample.y, u: &sample.u, x_bounds: sample.x_bounds.as_ref() }
}

/// Finite numbers, whatever the status.
fn is_sound(e: &Estimate) {
    let finite = |numbers: &[f64]| numbers.iter().all(|x| x.is_finite());
    assert!(finite(&e.x) && finite(&e.window), "{:?}: {:?} {:?}", e.status, e.x, e.window);
    if let Some(own) = &e.evidence {
        assert!(finite(&own.covariance), "{:?}", own.covariance);
        let n = e.x.len();
        assert!((0..n).all(|i| own.covariance[i * n + i] >= 0.0), "{:?}", own.covariance);
    }
    if e.status == Status::Optimal {
        assert!(e.cost.is_finite() && finite(&e.w), "cost {} w {:?}", e.cost, e.w);
        assert!(!e.v.iter().any(|v| v.is_infinite()), "{:?}", e.v);
        assert!(e.bound.is_none_or(|bound| !bound.is_nan()), "{:?}", e.bound);
    }
}

/// Everything below, of one case.
pub fn everything(case: &Case) -> Outcomes {
    let mut outcomes = Outcomes::default();
    let refused = Outcomes { refused: 1, ..outcomes };
    let Ok(history) = case.history() else { return refused };
    let again = History::from_bytes(&history.to_bytes());
    assert_eq!(again.as_ref().ok(), Some(&history), "a recording is what was saved");
    let Ok(new) = DdMhe::new(&history, case.config.clone()) else { return refused };
    outcomes.made = 1;
    let (taken, found) = step_by_step(&new, &case.samples, &mut outcomes);
    continues(&new, &taken, &found);
    runs(&new, &taken, &found);
    outcomes.flown = flies(&new, &taken, &found);
    resets(&new, &taken, &found);
    outcomes
}

/// Sound estimates, and an estimator that a refused sample does not change; the samples that were
/// taken and what was made of them.
fn step_by_step(
    new: &DdMhe,
    samples: &[Sample],
    outcomes: &mut Outcomes,
) -> (Vec<Sample>, Vec<Bits>) {
    let (mut taken, mut found, mut mhe) = (Vec::new(), Vec::new(), new.clone());
    for sample in samples {
        let before = (mhe.t() < 8).then(|| mhe.snapshot());
        match mhe.step_with(step_of(sample)) {
            Ok(estimate) => {
                is_sound(estimate);
                outcomes.steps[estimate.status.code() as usize] += 1;
                found.push(of(estimate));
                taken.push(sample.clone());
            }
            Err(error) => {
                assert!(!error.to_string().is_empty());
                assert!(before.is_none_or(|before| before == mhe.snapshot()), "{error}");
                outcomes.rejected += 1;
            }
        }
    }
    (taken, found)
}

/// A restored snapshot, and a copy, go on with the same bits.
fn continues(new: &DdMhe, taken: &[Sample], found: &[Bits]) {
    let mut mhe = new.clone();
    let cut = taken.len() / 2;
    for sample in &taken[..cut] {
        assert!(mhe.step_with(step_of(sample)).is_ok());
    }
    let restored = DdMhe::restore(&mhe.snapshot());
    let mut restored = restored.unwrap_or_else(|error| panic!("after {cut} steps: {error}"));
    let mut copy = mhe.clone();
    drop(mhe);
    for (k, sample) in taken.iter().enumerate().skip(cut) {
        let [a, b] = [&mut restored, &mut copy].map(|mhe| mhe.step_with(step_of(sample)).map(of));
        assert!(
            a.as_ref() == Ok(&found[k]),
            "restored after {cut}, step {k}: {a:?} {:?}",
            found[k]
        );
        assert!(b.as_ref() == Ok(&found[k]), "copied after {cut}, step {k}");
    }
}

/// A log is run as it is stepped, however it is split; samples with bounds of their own are
/// stepped.
fn runs(new: &DdMhe, taken: &[Sample], found: &[Bits]) {
    let mut mhe = new.clone();
    let mut k = 0;
    while k < taken.len() {
        let length = taken[k..].iter().take_while(|sample| sample.x_bounds.is_none()).count();
        let length = length.min(5 + k);
        if length == 0 {
            let step = mhe.step_with(step_of(&taken[k])).map(of);
            assert!(step.as_ref() == Ok(&found[k]), "stepped after a run, step {k}");
            k += 1;
            continue;
        }
        let part = &taken[k..k + length];
        let y: Vec<f64> = part.iter().flat_map(|sample| sample.y.clone()).collect();
        let u: Vec<f64> = part.iter().flat_map(|sample| sample.u.clone()).collect();
        let log = mhe.run_until(Signals { y: &y, u: &u }, &mut || false);
        let log = log.unwrap_or_else(|error| panic!("run from {k}: {error}"));
        let n = mhe.n();
        for (i, x) in log.x.chunks_exact(n).enumerate() {
            let (numbers, _, status, active) = &found[k + i];
            let stepped: Vec<f64> = numbers[..n].iter().map(|bits| f64::from_bits(*bits)).collect();
            assert!(bits(x) == numbers[..n], "run from {k}, step {}: {x:?} {stepped:?}", k + i);
            assert!((log.status[i], log.active[i]) == (*status, *active), "status {}", k + i);
        }
        assert!(of(mhe.estimate()) == found[k + length - 1], "the end of a run from {k}");
        k += length;
    }
}

/// A plan's stepper makes the estimator's numbers as long as it has no need of a solver.
fn flies(new: &DdMhe, taken: &[Sample], found: &[Bits]) -> usize {
    let Ok(bytes) = new.plan() else {
        assert!(new.is_bounded());
        return 0;
    };
    let mut room = vec![0_u8; bytes.len() + 8];
    let first = room.as_ptr().align_offset(8);
    room[first..first + bytes.len()].copy_from_slice(&bytes);
    let plan = Plan::from_bytes(&room[first..first + bytes.len()]);
    let plan = plan.unwrap_or_else(|error| panic!("its own plan: {error}"));
    let mut memory = vec![f64::NAN; Stepper::room(&plan)];
    let Ok(mut stepper) = Stepper::new(&plan, &mut memory) else { panic!("no room") };
    for (k, sample) in taken.iter().enumerate() {
        if sample.x_bounds.is_some() {
            return k; // bounds of one step are the ground's alone
        }
        let Some(e) = stepper.step_with(&sample.y, &sample.u) else { panic!("step {k} refused") };
        let sound = e.x.iter().chain(e.window).all(|x| x.is_finite());
        assert!(sound, "in flight: {:?} {:?}", e.status, e.x);
        let mut parts = [bits(e.x), bits(e.window), bits(e.v), bits(e.w), bits([&e.cost])].concat();
        if let Some(own) = e.evidence {
            let value = [own.value];
            let of = [own.covariance, own.innovation, own.innovation_variance, &value[..]];
            parts.extend(of.map(bits).concat());
            parts.push(u64::from(own.reasons.bits()));
        }
        let (own_status, own_active) = (e.status, e.active);
        if !stepper.is_certain() {
            return k; // in flight there is no solver to ask
        }
        let (numbers, _, status, active) = &found[k];
        let same = (parts, own_status, own_active) == (numbers.clone(), *status, *active);
        assert!(same, "in flight, step {k}");
    }
    taken.len()
}

/// After a reset everything is as at first.
fn resets(new: &DdMhe, taken: &[Sample], found: &[Bits]) {
    let mut mhe = new.clone();
    for sample in taken.iter().rev().filter(|sample| sample.x_bounds.is_none()) {
        assert!(mhe.step_with(step_of(sample)).is_ok());
    }
    assert!(mhe.reset(None).is_ok());
    for (k, sample) in taken.iter().enumerate() {
        let found_again = mhe.step_with(step_of(sample)).map(of);
        assert!(found_again.as_ref() == Ok(&found[k]), "after a reset, step {k}");
    }
}
