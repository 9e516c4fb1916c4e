//! A plan's steps are its estimator's, bit for bit, and bytes that are no plan are told apart.

use crate::systems::{modes, noise, unit_certificate};
use ddmhe_core::{
    Bounds, Center, Certificate, Config, DdMhe, Disturbance, Gate, History, ProcessNoise, Soft,
    Start, Status, Stuck, Weighting,
};
use ddmhe_run::{Plan, PlanError, Stepper};

/// A plan's bytes where doubles can be, `shift` bytes further on.
pub struct Flash {
    bytes: Vec<u8>,
    first: usize,
    len: usize,
}

impl Flash {
    fn shifted(plan: &[u8], shift: usize) -> Self {
        let mut bytes = vec![0; plan.len() + 16];
        let first = bytes.as_ptr().align_offset(8) + shift;
        bytes[first..first + plan.len()].copy_from_slice(plan);
        Flash { bytes, first, len: plan.len() }
    }

    pub fn new(plan: &[u8]) -> Self {
        Self::shifted(plan, 0)
    }

    pub fn read(&self) -> Result<Plan<'_>, PlanError> {
        Plan::from_bytes(&self.bytes[self.first..self.first + self.len])
    }

    fn flip(&mut self, bit: usize) {
        self.bytes[self.first + bit / 8] ^= 1 << (bit % 8);
    }
}

/// A step as it can be compared: the bits of x, window, v and cost; status and active bounds; the
/// bits of covariance, innovation, its variance and value, and reasons.
type Step = ([Vec<u64>; 3], u64, Status, usize, Option<([Vec<u64>; 4], u8)>);

fn bits(numbers: &[f64]) -> Vec<u64> {
    // which NaN stands for "not measured" says nothing
    numbers.iter().map(|x| if x.is_nan() { f64::NAN } else { *x }.to_bits()).collect()
}

fn flown(stepper: &mut Stepper<'_, '_>, outputs: &[f64]) -> Vec<Step> {
    let step = |y| {
        let e = stepper.step(y).unwrap();
        let evidence = e.evidence.map(|own| {
            let value = &[own.value];
            let numbers = [own.covariance, own.innovation, own.innovation_variance, &value[..]];
            (numbers.map(bits), own.reasons.bits())
        });
        ([bits(e.x), bits(e.window), bits(e.v)], e.cost.to_bits(), e.status, e.active, evidence)
    };
    outputs.chunks_exact(3).map(step).collect()
}

fn on_the_ground(mhe: &mut DdMhe, outputs: &[f64]) -> Vec<Step> {
    let step = |y| {
        let e = mhe.step(y).unwrap();
        let evidence = e.evidence.as_ref().map(|own| {
            let value = &[own.value];
            let numbers = [&own.covariance, &own.innovation, &own.innovation_variance, &value[..]];
            (numbers.map(bits), own.reasons.bits())
        });
        ([bits(&e.x), bits(&e.window), bits(&e.v)], e.cost.to_bits(), e.status, e.active, evidence)
    };
    outputs.chunks_exact(3).map(step).collect()
}

pub fn recorded() -> (History, Vec<f64>) {
    let system = modes(2);
    let (x, mut y) = system.simulate(&noise(1, 4, 2.0), 90);
    y.iter_mut().zip(noise(4, 270, 0.05)).for_each(|(y, v)| *y += v);
    let (_, mut outputs) = system.simulate(&noise(2, 4, 2.0), 90);
    outputs.iter_mut().zip(noise(3, 270, 0.12)).for_each(|(y, v)| *y += v);
    (History::new(4, 3, &x, &y, 0.1).unwrap(), outputs)
}

fn within(size: f64, width: usize) -> Option<Bounds> {
    Some(Bounds { lo: vec![-size; width], hi: vec![size; width] })
}

fn plain() -> Config {
    Config { horizon: Some(9), rho: Some(0.9), mu: Some(10.0), ..Config::default() }
}

fn soft(soft: Soft) -> Config {
    let (x_bounds, v_bounds) = (within(0.2, 4), within(0.01, 3));
    Config { x_bounds, v_bounds, soft: Some(soft), ..plain() }
}

fn certified() -> Config {
    let diagonal = |size: usize, first: f64| {
        let entry =
            |k: usize| if k.is_multiple_of(size + 1) { first + k as f64 / 9.0 } else { 0.0 };
        (0..size * size).map(entry).collect::<Vec<_>>()
    };
    let mut P = diagonal(4, 1.0);
    (P[1], P[4]) = (0.2, 0.2);
    let (Q, R) = (diagonal(4, 1.0), diagonal(3, 2.0));
    let certificate = Certificate { P, Q, R, eta: 0.8, growth: Some(1.2), model: None };
    Config { rho: None, mu: None, certificate: Some(certificate), ..plain() }
}

/// With outputs that are rejected, or not measured where they are stuck.
fn doubting(config: Config) -> Config {
    Config { gate: Gate::At(4.0), stuck: Stuck::Missing, ..config }
}

/// Every kind of problem, from every start.
pub fn configs() -> Vec<Config> {
    let bounded = Config { x_bounds: within(2.0, 4), v_bounds: within(0.1, 3), ..plain() };
    let problems = [
        Config::default(),
        plain(),
        bounded.clone(),
        Config { x_bounds: within(0.05, 4), x_center: Center::History, ..plain() },
        certified(),
        Config { v_bounds: within(0.1, 3), ..certified() },
        Config { horizon: Some(1), ..plain() },
        // no window inside of the box
        Config { x_bounds: within(0.2, 4), v_bounds: within(0.01, 3), ..plain() },
        // the same at a price, or at one for the noise alone
        soft(Soft::all(3.0)),
        soft(Soft { v: Some(100.0), ..Soft::default() }),
        Config { x_center: Center::History, ..soft(Soft::all(0.1)) },
        // outputs that are doubted
        doubting(plain()),
        doubting(Config::default()),
        doubting(bounded.clone()),
    ];
    let starts = [Start::Auto, Start::State, Start::Recording, Start::Unknown];
    let all = problems.into_iter().flat_map(|problem| {
        starts.into_iter().map(move |start| Config { start, ..problem.clone() })
    });
    all.chain([Config { x_prior: Some(noise(7, 4, 2.0)), ..bounded }]).collect()
}

#[test]
fn a_plan_steps_as_its_estimator_does() {
    let (history, outputs) = recorded();
    let (mut touched, mut infeasible) = (0, 0);
    for (number, config) in configs().into_iter().enumerate() {
        let mut lossy = outputs.clone();
        // bounds about a centre with lost outputs are the ground's alone
        if config.x_center == Center::Absolute {
            (0..270).step_by(37).for_each(|k| lossy[k] = f64::NAN);
            lossy[120..123].fill(f64::NAN);
            lossy[200] = 1e300;
        }
        let mut mhe = DdMhe::new(&history, config).unwrap();
        let flash = Flash::new(&mhe.plan().unwrap());
        let plan = flash.read().unwrap();
        assert_eq!((plan.n(), plan.p(), plan.horizon()), (4, 3, mhe.settings().horizon));
        let mut memory = vec![f64::NAN; Stepper::room(&plan)];
        let mut stepper = Stepper::new(&plan, &mut memory).unwrap();
        for log in [&lossy, &outputs] {
            let (found, expected) = (flown(&mut stepper, log), on_the_ground(&mut mhe, log));
            let differing = found.iter().zip(&expected).position(|(a, b)| a != b);
            assert_eq!(differing, None, "configuration {number}");
            assert_eq!(stepper.t(), mhe.t());
            touched += expected.iter().filter(|step| step.3 > 0).count();
            infeasible += expected.iter().filter(|step| step.2 == Status::Infeasible).count();
            stepper.reset();
            mhe.reset(None).unwrap();
        }
    }
    assert!(touched > 100 && infeasible > 100, "{touched} {infeasible}");
}

/// Spikes, a jump and a stuck output; and where the log begins is found out.
#[test]
fn a_plan_doubts_as_its_estimator_does() {
    let (history, mut outputs) = recorded();
    let jump = noise(3, 3, 40.0);
    (0..270).step_by(47).for_each(|k| outputs[k] += 30.0);
    (180..270).for_each(|k| outputs[k] += jump[k % 3]);
    (93..150).filter(|k| k % 3 == 0).for_each(|k| outputs[k] = 0.25);
    let diagonal = |k: usize| if k.is_multiple_of(5) { 1e-4 } else { 0.0 };
    let process_noise = ProcessNoise::Given((0..16).map(diagonal).collect());
    let recorded = Config { weights: Weighting::Recorded, process_noise, ..Config::default() };
    let starts = [Start::Auto, Start::State, Start::Recording, Start::Unknown];
    let (mut gated, mut restarted, mut elsewhere) = (0, 0, 0);
    for config in [doubting(plain()), doubting(Config::default()), doubting(recorded)] {
        for start in starts {
            let mut mhe = DdMhe::new(&history, Config { start, ..config.clone() }).unwrap();
            let flash = Flash::new(&mhe.plan().unwrap());
            let plan = flash.read().unwrap();
            assert_eq!(plan.finds_start(), start == Start::Auto);
            let mut memory = vec![f64::NAN; Stepper::room(&plan)];
            let mut stepper = Stepper::new(&plan, &mut memory).unwrap();
            for (k, y) in outputs.chunks_exact(3).enumerate() {
                let found = stepper.step(y).unwrap();
                let found = (bits(found.x), bits(found.evidence.unwrap().covariance));
                let expected = mhe.step(y).unwrap();
                let own = expected.evidence.as_ref().unwrap();
                assert_eq!(found, (bits(&expected.x), bits(&own.covariance)), "{k} {start}");
                gated += own.gated.iter().filter(|gated| **gated).count();
                restarted += usize::from(own.restarted);
            }
            elsewhere += usize::from(start == Start::Auto && mhe.start() == Start::Unknown);
        }
    }
    assert!(gated > 20 && restarted > 3 && elsewhere > 0, "{gated} {restarted} {elsewhere}");
}

#[test]
fn a_plan_with_known_inputs_steps_as_its_estimator_does() {
    let system = modes(2);
    let (n, p, T) = (4, 3, 90);
    let u = noise(8, 2 * 180, 1.0);
    let (x, mut y) = system.driven(&noise(1, n, 2.0), &u);
    y.iter_mut().zip(noise(9, p * 180, 0.02)).for_each(|(y, v)| *y += v);
    let history = History::new(n, p, &x[..(T + 1) * n], &y[..T * p], 0.1).unwrap();
    let history = history.with_inputs(2, &u[..2 * T]).unwrap();
    (T * p..).step_by(41).take(6).for_each(|k| y[k] = f64::NAN);
    let (mut touched, mut compared) = (0, 0);
    for config in configs() {
        let mut mhe = DdMhe::new(&history, config.clone()).unwrap();
        if config.x_center != Center::Absolute {
            continue; // with lost outputs they are the ground's alone
        }
        let flash = Flash::new(&mhe.plan().unwrap());
        let plan = flash.read().unwrap();
        assert_eq!(plan.m(), 2);
        let mut memory = vec![f64::NAN; Stepper::room(&plan)];
        let mut stepper = Stepper::new(&plan, &mut memory).unwrap();
        assert!(stepper.step(&y[..p]).is_none() && stepper.step_with(&y[..p], &[0.1]).is_none());
        assert!(stepper.step_with(&y[..p], &[0.1, f64::NAN]).is_none());
        assert!(stepper.step_with(&y[..p], &[0.1, 1e300]).is_none() && stepper.t() == 0);
        for k in T..180 {
            let (y, u) = (&y[k * p..(k + 1) * p], &u[2 * k..2 * k + 2]);
            let e = stepper.step_with(y, u).unwrap();
            let found = ([bits(e.x), bits(e.window), bits(e.v)], e.cost.to_bits(), e.status);
            let e = mhe.step_with(ddmhe_core::Step { y, u, x_bounds: None }).unwrap();
            let expected = ([bits(&e.x), bits(&e.window), bits(&e.v)], e.cost.to_bits(), e.status);
            if found.2 != Status::Optimal {
                break; // in flight there is no solver to ask
            }
            assert!(found == expected, "{k} {config:?}");
            (touched, compared) = (touched + usize::from(e.active > 0), compared + 1);
        }
    }
    assert!(touched > 100 && compared > 1000, "{touched} {compared}");
}

#[test]
fn a_reset_run_is_a_new_one() {
    let (history, outputs) = recorded();
    for config in configs() {
        let mhe = DdMhe::new(&history, config).unwrap();
        let flash = Flash::new(&mhe.plan().unwrap());
        let plan = flash.read().unwrap();
        let mut memory = vec![0.0; Stepper::room(&plan)];
        let mut stepper = Stepper::new(&plan, &mut memory).unwrap();
        let expected = flown(&mut stepper, &outputs);
        for steps in [1, 8, 9, 40] {
            stepper.reset();
            flown(&mut stepper, &noise(5, 3 * steps, 9.0));
            stepper.reset();
            assert!(stepper.t() == 0 && flown(&mut stepper, &outputs) == expected);
        }
    }
}

/// A plan is one of a new run, from the configured start, whatever start the present run has.
#[test]
fn a_plan_starts_where_a_new_run_does() {
    let (history, _) = recorded();
    let starts = [Start::Auto, Start::State, Start::Recording, Start::Unknown];
    for start in starts {
        let mut mhe = DdMhe::new(&history, Config { start, ..plain() }).unwrap();
        let outputs = noise(6, 120, 1.0);
        for other in starts {
            mhe.reset_from(other, None).unwrap();
            let flash = Flash::new(&mhe.plan().unwrap());
            let plan = flash.read().unwrap();
            assert_eq!(plan.starts_unknown(), start == Start::Unknown);
            let mut memory = vec![0.0; Stepper::room(&plan)];
            let mut stepper = Stepper::new(&plan, &mut memory).unwrap();
            mhe.reset(None).unwrap();
            assert!(flown(&mut stepper, &outputs) == on_the_ground(&mut mhe, &outputs));
        }
    }
}

#[test]
fn an_output_of_another_size_changes_nothing() {
    let flash = Flash::new(&small());
    let plan = flash.read().unwrap();
    let mut memory = vec![0.0; Stepper::room(&plan)];
    let mut stepper = Stepper::new(&plan, &mut memory).unwrap();
    stepper.step(&[0.1, 0.2]).unwrap();
    assert!(stepper.step(&[]).is_none() && stepper.step(&[0.1; 3]).is_none());
    assert_eq!(stepper.t(), 1);
}

#[test]
fn an_error_bound_has_no_plan() {
    let certificate = Some(unit_certificate(4, 3, 0.8));
    let disturbance = Some(Disturbance { initial: 1.0, w: 0.01, v: 0.1 });
    let config = Config { certificate, disturbance, ..certified() };
    let exact = modes(2).record(&[1.0, 0.5, -0.3, 0.8], 120);
    let mhe = DdMhe::new(&exact, config).unwrap();
    assert!(mhe.is_bounded(), "{:?}", mhe.warnings());
    assert!(mhe.plan().err().unwrap().to_string().contains("disturbance"));
}

/// A small plan with bounds.
pub fn small() -> Vec<u8> {
    let history = modes(1).record(&[1.0, 0.5], 24);
    let start = Start::State;
    let config = Config { horizon: Some(3), x_bounds: within(0.3, 2), start, ..Config::default() };
    DdMhe::new(&history, config).unwrap().plan().unwrap()
}

pub fn refused(bytes: &[u8]) -> PlanError {
    Flash::new(bytes).read().unwrap_err()
}

#[test]
fn no_flipped_bit_goes_unnoticed() {
    let mut flash = Flash::new(&small());
    for bit in 0..8 * flash.len {
        flash.flip(bit);
        let expected = match bit / 64 {
            0 => PlanError::Foreign,
            1 => PlanError::Format,
            2 => PlanError::Length,
            _ => PlanError::Checksum,
        };
        assert_eq!(flash.read().unwrap_err(), expected, "{bit}");
        flash.flip(bit);
    }
    assert!(flash.read().is_ok());
}

#[test]
fn other_bytes_are_told_apart() {
    let plan = small();
    for length in 8..plan.len() {
        assert_eq!(refused(&plan[..length]), PlanError::Length, "{length}");
    }
    for extra in [&b"\0"[..], &[0; 8], &plan] {
        assert_eq!(refused(&[&plan, extra].concat()), PlanError::Length);
    }
    let snapshot = DdMhe::new(&recorded().0, plain()).unwrap().snapshot();
    for foreign in [&b""[..], b"ddmhe", &[0; 4000], &snapshot, &plan[8..]] {
        assert_eq!(refused(foreign), PlanError::Foreign);
    }
    for shift in 1..8 {
        assert_eq!(Flash::shifted(&plan, shift).read().unwrap_err(), PlanError::Alignment);
    }
    let mut other = plan.clone();
    other[8..16].copy_from_slice(&99.0_f64.to_le_bytes());
    assert_eq!(refused(&sealed(other)), PlanError::Format);
}

#[test]
fn too_little_room_is_refused() {
    let flash = Flash::new(&small());
    let plan = flash.read().unwrap();
    let room = Stepper::room(&plan);
    let mut memory = vec![0.0; room + 3];
    for numbers in [0, 1, room - 1] {
        let found = Stepper::new(&plan, &mut memory[..numbers]).unwrap_err();
        assert_eq!(found, PlanError::Room);
    }
    assert!(Stepper::new(&plan, &mut memory).is_ok());
}

/// The same bytes with the checksum that belongs to them.
pub fn sealed(mut plan: Vec<u8>) -> Vec<u8> {
    let sum = f64::from(crc32fast::hash(&[&plan[..24], &plan[32..]].concat()));
    plan[24..32].copy_from_slice(&sum.to_le_bytes());
    plan
}

#[test]
fn no_step_allocates() {
    let (history, mut outputs) = recorded();
    (0..270).step_by(31).for_each(|k| outputs[k] = f64::NAN);
    for config in configs() {
        let flash = Flash::new(&DdMhe::new(&history, config).unwrap().plan().unwrap());
        let plan = flash.read().unwrap();
        let mut memory = vec![0.0; Stepper::room(&plan)];
        let found = allocation_counter::measure(|| {
            let plan = flash.read().unwrap();
            let mut stepper = Stepper::new(&plan, &mut memory).unwrap();
            for y in outputs.chunks_exact(3) {
                assert!(stepper.step(y).is_some());
            }
            stepper.reset();
        });
        assert_eq!(found.count_total, 0);
    }
}
