//! A plan's bytes as an enemy would write them, under a checksum that fits: an error or a stepper
//! that steps, never a panic.

use crate::plan::{Flash, configs, recorded, refused, sealed, small};
use crate::systems::modes;
use ddmhe_core::{Config, DdMhe, Start};
use ddmhe_run::evidence::Rule;
use ddmhe_run::memory::memory_len;
use ddmhe_run::plan::{Begin, Common, Depth, Kind, Sizes};
use ddmhe_run::{PlanError, Prices, Status, Stepper};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Steps through what was read, if anything: whether it was. A plan that was read makes no step
/// fail and no estimate optimal that is not finite, whatever its numbers and outputs are.
fn survived(plan: Vec<u8>) -> bool {
    let flash = Flash::new(&sealed(plan));
    let plan = match flash.read() {
        Ok(plan) => plan,
        Err(found) => {
            assert!([PlanError::Sizes, PlanError::Format, PlanError::Length].contains(&found));
            return false;
        }
    };
    let mut memory = vec![0.0; Stepper::room(&plan)];
    let mut stepper = Stepper::new(&plan, &mut memory).unwrap();
    let outputs = [0.1, f64::NAN, -0.7, 3.0, 1e300, 0.0, -1e14].into_iter().cycle();
    let u = vec![0.0; plan.m()];
    for k in 0..2 * plan.horizon() + 3 {
        let y: Vec<f64> = outputs.clone().skip(k).take(plan.p()).collect();
        // an input may be beyond the deviations of a forged plan
        let Some(estimate) = stepper.step_with(&y, &u) else {
            assert!(plan.m() > 0, "{k}");
            continue;
        };
        let finite = estimate.x.iter().all(|x| x.is_finite());
        assert!(finite || estimate.status != Status::Optimal, "{k}: {:?}", estimate.x);
    }
    true
}

/// Number `at` of a plan replaced.
fn with(plan: &[u8], at: usize, value: f64) -> Vec<u8> {
    let mut plan = plan.to_vec();
    plan[8 * at..8 * at + 8].copy_from_slice(&value.to_le_bytes());
    plan
}

#[test]
fn hostile_content_is_harmless() {
    let plan = small();
    let values = [0.0, 1.0, 2.0, 3.0, 4.0, 7.0, 31.0, 1e6, 1e7, -1.0, 0.5, 1e300, f64::NAN];
    let (mut stepped, mut refused) = (0, 0);
    for at in 4..plan.len() / 8 {
        for value in values {
            let survived = survived(with(&plan, at, value));
            (stepped, refused) =
                (stepped + usize::from(survived), refused + usize::from(!survived));
        }
    }
    assert!(stepped > 500 && refused > 50, "{stepped} {refused}");
}

/// Plans that once broke a promise.
#[test]
fn what_was_found_stays_mended() {
    let plan = include_bytes!("attack/found/plan-whose-units-are-forged.bin");
    assert!(survived(plan.to_vec()));
}

/// Small plans of every kind of problem and start.
fn small_plans() -> Vec<Vec<u8>> {
    let (history, _) = recorded();
    // with a certificate of η = .8 no horizon below 7
    let short = |config: Config| {
        let least = if config.certificate.is_some() { 7 } else { 3 };
        Config { horizon: config.horizon.map(|M| M.min(least)), ..config }
    };
    let open = |config: &Config| config.horizon.is_some();
    let plan = |config| DdMhe::new(&history, config).unwrap().plan().unwrap();
    configs().into_iter().filter(open).map(short).map(plan).collect()
}

/// Bits flipped and sizes changed at random, more often where sizes are, under a checksum that
/// fits.
fn fuzz(rounds: usize, seed: u64) {
    let plans = small_plans();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut stepped, mut refused) = (0, 0);
    for round in 0..rounds {
        let mut plan = plans[round % plans.len()].clone();
        for _ in 0..rng.random_range(1..6) {
            let header = rng.random_bool(0.3);
            let at = rng.random_range(1..if header { 32 } else { plan.len() / 8 });
            if rng.random_bool(0.5) {
                plan = with(&plan, at, f64::from(rng.random_range(0..9)));
            } else {
                plan[8 * at + rng.random_range(0..8)] ^= 1 << rng.random_range(0..8);
            }
        }
        let survived = survived(plan);
        (stepped, refused) = (stepped + usize::from(survived), refused + usize::from(!survived));
    }
    assert!(stepped > rounds / 20 && refused > rounds / 20, "{stepped} {refused}");
}

#[test]
fn damage_at_random_is_harmless() {
    fuzz(2000, 1);
}

#[test]
#[ignore = "long"]
fn long_damage_at_random_is_harmless() {
    fuzz(500_000, 2);
}

/// Sizes that would leave a step without its block are refused when the plan is read.
#[test]
fn a_run_that_would_lack_a_block_is_refused() {
    let grown = small(); // every depth up to the horizon 3
    let found = |at: usize| f64::from_le_bytes(grown[8 * at..8 * at + 8].try_into().unwrap());
    assert_eq!((found(6), found(9), found(10)), (3.0, 3.0, 0.0));
    // the deepest is one of an unknown start's
    let opening = with(&with(&grown, 9, 2.0), 10, 1.0);
    assert_eq!(refused(&sealed(opening)), PlanError::Sizes);
    // a window that is full from the start, then with fewer outputs than its one block takes
    let history = modes(1).record(&[1.0, 0.5], 24);
    let config = Config { horizon: Some(3), start: Start::Recording, ..Config::default() };
    let full = DdMhe::new(&history, config).unwrap().plan().unwrap();
    assert!(survived(full.clone()) && survived(with(&full, 8, 2.0)));
    assert_eq!(refused(&sealed(with(&full, 8, 1.0))), PlanError::Sizes);
    // more directions than any block has, and flags that nobody knows
    assert_eq!(refused(&sealed(with(&grown, 7, found(7) + 1.0))), PlanError::Sizes);
    assert_eq!(refused(&sealed(with(&grown, 11, found(11) + 4096.0))), PlanError::Sizes);
}

/// No length of a plan, nor the room for a step, exceeds 32 bits where the sizes are called
/// countable there; and the sizes of a microcontroller are.
#[test]
fn lengths_can_be_counted_in_32_bits() {
    let largest = u64::from(u32::MAX);
    let sizes = |[n, p, m, horizon, rank]: [usize; 5], bits: usize| {
        let flag = |bit: usize| bits >> bit & 1 == 1;
        Sizes {
            n,
            p,
            m,
            lag: 1 + bits % 2,
            horizon,
            rank,
            filled: horizon,
            x_bounded: flag(0),
            v_bounded: flag(1),
            centered: flag(2),
            plain_noise: flag(3),
            recorded: flag(6) && flag(5),
            w_bounded: flag(4) && flag(5),
            driven: flag(5),
            prices: Prices { x: f64::from(u8::from(flag(7))), ..Prices::default() },
            rule: match (flag(8), flag(6) && flag(5)) {
                (false, _) => Rule::Off,
                (true, true) => Rule::Filter,
                (true, false) => Rule::Curved,
            },
            drifts: flag(8),
            gate: if flag(8) { 4.0 } else { 0.0 },
            stuck_missing: flag(8),
            start: Begin::Unknown,
        }
    };
    assert!(sizes([20, 20, 5, 100, 40], 127).countable(largest));
    let huge = [[1, 1, 0, 1, 65_536], [1 << 17, 1, 0, 1, 1], [1, 1 << 17, 0, 1, 1]];
    for huge in huge.into_iter().chain([[1 << 20; 5], [1, 1, 1 << 17, 1, 1]]) {
        assert!(!sizes(huge, 0).countable(largest), "{huge:?}");
    }
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut countable, mut most) = (0, 0);
    for _ in 0..60_000 {
        // of every magnitude up to what a header may say
        let five = std::array::from_fn(|_| 2_f64.powf(rng.random_range(0.0..19.9)) as usize);
        let sizes = sizes(five, rng.random_range(0..512));
        if !sizes.countable(largest) {
            continue;
        }
        let Sizes { n, p, horizon, rank, centered, .. } = sizes;
        let layout = sizes.layout(horizon);
        let kind = Kind { centered, judged: sizes.judged(), ..Kind::default() };
        let block = Depth::new(layout, rank, kind).len;
        let answer = (horizon + 2) * n + horizon * p + layout.disturbances_len();
        let room = memory_len(sizes) + answer;
        let found = Common::new(sizes).len.max(block).max(room) as u64;
        assert!(found <= largest, "{sizes:?}: {found}");
        (countable, most) = (countable + 1, most.max(found));
    }
    // the bound is no wider than it must be by far
    assert!(countable > 1000 && most > largest / 10, "{countable} {most}");
}
