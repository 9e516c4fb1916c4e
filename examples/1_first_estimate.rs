//! The first estimate: a short recording of a pendulum near its rest, then its state from the
//! measured angle alone.
//!
//! Prints the angle and the rate, true and estimated, every second.

#![allow(clippy::print_stdout)]

use ddmhe_core::{Config, DdMhe, Error, History};

/// Angle (rad) and rate (rad/s) of a pendulum of 1 s⁻², every 50 ms, and its angle as it is
/// measured.
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

/// Runs the example; errors name the argument at fault.
pub fn main() -> Result<(), Error> {
    let (states, angles) = swing(0.3, 200); // T + 1 states and T outputs
    let history = History::new(2, 1, &states, &angles, 0.05)?;

    let (truth, outputs) = swing(-0.2, 100); // another swing, of which only the angle is measured
    let mut mhe =
        DdMhe::new(&history, Config { x_prior: Some(vec![-0.2, 0.0]), ..Config::default() })?;
    println!("time s   angle rad  estimated   rate rad/s  estimated");
    for (k, y) in outputs.iter().enumerate() {
        let x = &mhe.step(&[*y])?.x; // one output in, the next state out
        if (k + 1) % 20 == 0 {
            let t = 2 * (k + 1);
            println!(
                "{:6.2} {:11.4} {:10.4} {:12.4} {:10.4}",
                0.05 * (k + 1) as f64,
                truth[t],
                x[0],
                truth[t + 1],
                x[1]
            );
        }
    }
    Ok(())
}
