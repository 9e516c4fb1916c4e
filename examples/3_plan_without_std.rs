//! A plan without the standard library: the ground prepares an estimator, and a control loop steps
//! it from flash, in memory of its own, without allocation.
//!
//! Prints the angle and the rate, true and estimated, every second.
#![allow(clippy::print_stdout)]

use core::cell::Cell;
use ddmhe_core::{Config, DdMhe, History};
use ddmhe_run::{Aligned, Plan, PlanError, Stepper};

/// Angle (rad) and rate (rad/s) of a pendulum of 1 s⁻², every 50 ms, and its measured angle.
fn swing(angle: f64, samples: usize) -> (Vec<f64>, Vec<f64>) {
    let (dt, mut x) = (0.05, [angle, 0.0]);
    let (mut states, mut angles) = (x.to_vec(), Vec::new());
    for _ in 0..samples {
        angles.push(x[0]);
        x = [x[0] + dt * x[1], x[1] - dt * x[0].sin()];
        states.extend(x);
    }
    (states, angles)
}

/// In flight: only `core` and `ddmhe_run`. `measure` is the sensor, `act` takes x̂(t).
fn control_loop(
    flash: &[u8],
    measure: impl Fn() -> Option<f64>,
    mut act: impl FnMut(&[f64]),
) -> Result<(), PlanError> {
    let plan = Plan::from_bytes(flash)?; // checked where it is, not copied
    let mut memory = [0.0; 2000]; // at least Stepper::room(&plan) numbers
    let mut stepper = Stepper::new(&plan, &mut memory)?;
    while let Some(y) = measure() {
        stepper.step(&[y]).iter().for_each(|estimate| act(estimate.x));
    }
    Ok(())
}

/// Runs the example; errors name the argument at fault.
pub fn main() -> Result<(), Box<dyn core::error::Error>> {
    let (states, angles) = swing(0.3, 200);
    let history = History::new(2, 1, &states, &angles, 0.05)?;
    let config = Config { horizon: Some(10), x_prior: Some(vec![-0.2, 0.0]), ..Config::default() };
    let bytes = DdMhe::new(&history, config)?.plan()?; // for a file
    // in firmware: static PLAN: Aligned<[u8; LEN]> = Aligned(*include_bytes!("plan"))
    let mut flash = Aligned([0; 1 << 16]);
    flash.0[..bytes.len()].copy_from_slice(&bytes);

    let ((truth, outputs), k) = (swing(-0.2, 100), Cell::new(0));
    let measure = || outputs.get(k.replace(k.get() + 1)).copied();
    println!("time s   angle rad  estimated   rate rad/s  estimated");
    control_loop(&flash.0[..bytes.len()], measure, |x| {
        let (k, t) = (k.get(), 2 * k.get());
        if k % 20 == 0 {
            let (time, angle, rate) = (0.05 * k as f64, truth[t], truth[t + 1]);
            println!("{time:6.2} {angle:11.4} {:10.4} {rate:12.4} {:10.4}", x[0], x[1]);
        }
    })?;
    Ok(())
}
