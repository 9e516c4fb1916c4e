//! What flies: a plan in flash, stepped over the outputs of a log beside it, with `core` and
//! `ddmhe_run` alone. The test that builds this names both files.

#![no_std]

use ddmhe_run::{Aligned, Estimate, Plan, PlanError, Stepper};

static PLAN: Aligned<[u8; include_bytes!(env!("DDMHE_PLAN")).len()]> =
    Aligned(*include_bytes!(env!("DDMHE_PLAN")));

/// y(0), y(1), … as little-endian doubles, NaN where not measured.
static OUTPUTS: &[u8] = include_bytes!(env!("DDMHE_OUTPUTS"));

const DOUBLE: usize = size_of::<f64>();

/// Most outputs of a sample.
const CHANNELS: usize = 8;

/// Steps through the whole log in `memory`; every estimate is sent, number by number.
///
/// # Errors
/// What is wrong with the plan, or with the room for it.
pub fn fly(memory: &mut [f64], mut send: impl FnMut([u8; DOUBLE])) -> Result<(), PlanError> {
    let plan = Plan::from_bytes(&PLAN.0)?;
    let mut stepper = Stepper::new(&plan, memory)?;
    for sample in OUTPUTS.chunks_exact(DOUBLE * plan.p()) {
        let mut y = [0.0; CHANNELS];
        for (y, bytes) in y.iter_mut().zip(sample.as_chunks::<DOUBLE>().0) {
            *y = f64::from_le_bytes(*bytes);
        }
        let Some(y) = y.get(..plan.p()) else { return Err(PlanError::Sizes) };
        stepper.step(y).iter().for_each(|estimate| tell(estimate, &mut send));
    }
    Ok(())
}

/// x, window, v, cost, status, active bounds.
fn tell(estimate: &Estimate<'_>, send: &mut impl FnMut([u8; DOUBLE])) {
    let Estimate { x, window, v, cost, status, active, .. } = *estimate;
    let evidence = [cost, f64::from(status.code()), active as f64];
    [x, window, v, &evidence].into_iter().flatten().for_each(|number| send(number.to_le_bytes()));
}
