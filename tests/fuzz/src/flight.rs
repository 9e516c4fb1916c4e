//! A plan of any bytes, read and stepped as flight software does it.

use crate::sealed;
use ddmhe_run::{Plan, Status, Stepper};

const OUTPUTS: [f64; 7] = [0.1, f64::NAN, -0.7, 3.0, 1e300, 0.0, -1e14];

/// How many steps a plan made of these bytes, under a length and a checksum that fit, is given;
/// none if it is refused.
///
/// # Panics
///
/// If a plan that was read makes a step fail, or an optimal estimate is not finite.
pub fn fly(bytes: &[u8], most: usize) -> usize {
    let Some(sealed) = sealed::plan(bytes) else { return 0 };
    let mut room = vec![0_u8; sealed.len() + 8];
    let first = room.as_ptr().align_offset(8);
    room[first..first + sealed.len()].copy_from_slice(&sealed);
    let Ok(plan) = Plan::from_bytes(&room[first..first + sealed.len()]) else { return 0 };
    let mut memory = vec![0.0; Stepper::room(&plan)];
    let Ok(mut stepper) = Stepper::new(&plan, &mut memory) else { panic!("no room") };
    let u = vec![0.0; plan.m()];
    let steps = (2 * plan.horizon() + 3).min(most);
    for k in 0..steps {
        let y: Vec<f64> = OUTPUTS.iter().cycle().skip(k).take(plan.p()).copied().collect();
        match stepper.step_with(&y, &u) {
            None => assert!(!u.is_empty(), "a plan that was read makes no step fail"),
            Some(e) if e.status == Status::Optimal => {
                assert!(e.x.iter().all(|x| x.is_finite()), "{:?}", e.x);
            }
            Some(_) => {}
        }
    }
    steps
}
