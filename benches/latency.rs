//! Ten million steps in a row: median, 99th and 99.9th percentile, the longest, and allocations.
//!
//! `cargo bench --bench latency`, about a minute. Each step is timed alone, so that the time of
//! reading the clock (printed first) is in every figure; the longest step is the machine's as much
//! as the estimator's.

#![allow(clippy::print_stdout)]

mod data;

use data::{config, recorded, within};
use ddmhe_core::{Config, DdMhe, Space};
use std::time::Instant;

const STEPS: usize = 10_000_000;

/// Counts of nanoseconds: exact below 2^16, what is longer by itself.
struct Times {
    counts: Vec<u32>,
    longer: Vec<u64>,
}

impl Times {
    fn new() -> Self {
        Times { counts: vec![0; 1 << 16], longer: Vec::with_capacity(1 << 20) }
    }

    fn add(&mut self, nanoseconds: u64) {
        match self.counts.get_mut(nanoseconds as usize) {
            Some(count) => *count += 1,
            None => self.longer.push(nanoseconds),
        }
    }

    fn percentile(&mut self, share: f64) -> u64 {
        self.longer.sort_unstable();
        let mut left = (share * (STEPS - 1) as f64) as usize;
        for (nanoseconds, &count) in self.counts.iter().enumerate() {
            if left < count as usize {
                return nanoseconds as u64;
            }
            left -= count as usize;
        }
        self.longer[left]
    }
}

fn report(name: &str, times: &mut Times, allocations: u64) {
    let [median, p99, p999, longest] = [0.5, 0.99, 0.999, 1.0].map(|share| times.percentile(share));
    let ratio = p999 as f64 / median as f64;
    println!(
        "{name:<36} {median:>7} {p99:>7} {p999:>7} {longest:>10} {ratio:>8.2} {allocations:>6}"
    );
}

fn run(name: &str, mut mhe: DdMhe, outputs: &[f64]) {
    let p = mhe.p();
    let mut times = Times::new();
    let found = allocation_counter::measure(|| {
        for y in outputs.chunks_exact(p).cycle().take(STEPS) {
            let start = Instant::now();
            mhe.step(y).expect("outputs fit");
            times.add(start.elapsed().as_nanos() as u64);
        }
    });
    report(name, &mut times, found.count_total);
}

fn main() {
    println!(
        "{:<36} {:>7} {:>7} {:>7} {:>10} {:>8} {:>6}",
        "ns", "median", "p99", "p99.9", "longest", "p99.9/50", "alloc"
    );
    let mut clock = Times::new();
    for _ in 0..STEPS {
        let start = Instant::now();
        clock.add(start.elapsed().as_nanos() as u64);
    }
    report("the clock alone", &mut clock, 0);
    for (M, r) in [(10, 5), (20, 5), (50, 20)] {
        let (history, mut outputs) = recorded(3, 200, 100_000);
        let space = Space::Truncated { rank: Some(r), tol: None };
        let build = |config: Config| DdMhe::new(&history, config).expect("valid settings");
        let free =
            Config { x_bounds: within(1e3, 3), v_bounds: within(1e3, 3), ..config(M, space) };
        run(&format!("M={M} r={r}, nothing active"), build(free), &outputs);
        let cut = Config { v_bounds: within(0.055, 3), ..config(M, space) };
        run(&format!("M={M} r={r}, noise cut"), build(cut), &outputs[..300 * 3]);
        (0..outputs.len()).step_by(7).for_each(|k| outputs[k] = f64::NAN);
        run(
            &format!("M={M} r={r}, one entry in seven lost"),
            build(Config { v_bounds: within(1e3, 3), ..config(M, space) }),
            &outputs,
        );
    }
}
