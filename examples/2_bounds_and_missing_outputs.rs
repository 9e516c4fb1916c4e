//! Bounds on the states, and outputs that are lost: the window carries the estimate through, and
//! the status says what it is.
//!
//! Prints the estimates around a loss of ten samples and a wild output.

#![allow(clippy::print_stdout)]

use ddmhe_core::{Bounds, Config, DdMhe, Error, History, Start};

/// Two masses on springs, lightly damped: positions and speeds, and the first position as it is
/// measured.
fn swing(start: [f64; 4], samples: usize) -> (Vec<f64>, Vec<f64>) {
    let (dt, mut x) = (0.02, start);
    let (mut states, mut positions) = (x.to_vec(), Vec::new());
    for k in 0..samples {
        positions.push(x[0] + 1e-3 * (1.7 * k as f64).sin()); // a little noise
        let [a, b, u, v] = x;
        x = [
            a + dt * u,
            b + dt * v,
            u + dt * (-4.0 * a + 2.0 * b - 0.1 * u),
            v + dt * (2.0 * a - 2.0 * b - 0.1 * v),
        ];
        states.extend(x);
    }
    (states, positions)
}

/// Runs the example; errors name the argument at fault.
pub fn main() -> Result<(), Error> {
    let (states, positions) = swing([1.0, -0.5, 0.0, 0.3], 400);
    let history = History::new(4, 1, &states, &positions, 0.02)?;
    let config = Config {
        x_bounds: Some(Bounds { lo: vec![-2.5; 4], hi: vec![2.5; 4] }),
        start: Start::Recording, // the run goes on where the recording ends
        ..Config::default()
    };
    let mut mhe = DdMhe::new(&history, config)?;

    let last: [f64; 4] = [states[1600], states[1601], states[1602], states[1603]];
    let (truth, mut outputs) = swing(last, 80);
    outputs[30..40].fill(f64::NAN); // not measured
    // cannot be computed with: counts as not measured, and its step says "failed"
    outputs[60] = 1e300;
    println!("step  second position  estimated  status");
    for (k, y) in outputs.iter().enumerate() {
        let estimate = mhe.step(&[*y])?;
        if [29, 39, 59, 60, 61].contains(&k) {
            let t = 4 * (k + 1) + 1;
            println!(
                "{:4} {:16.4} {:10.4}  {}",
                k + 1,
                truth[t],
                estimate.x[1],
                estimate.status.as_str()
            );
        }
    }
    Ok(())
}
