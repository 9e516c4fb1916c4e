//! Ten million steps: nothing is allocated, and the process is no larger afterwards.

use crate::systems::{modes, noise};
use ddmhe_core::{Bounds, Config, DdMhe, Status};

/// Resident memory of this process in bytes, where the system tells.
fn resident() -> Option<usize> {
    let said = std::fs::read_to_string("/proc/self/statm").ok()?;
    said.split_whitespace().nth(1)?.parse::<usize>().ok().map(|pages| pages * 4096)
}

#[test]
#[ignore = "long"]
#[allow(clippy::print_stdout)]
fn long_ten_million_steps() {
    let (system, steps) = (modes(1), 10_000_000);
    let history = system.record(&[1.0, 0.5], 60);
    let bounds = Some(Bounds { lo: vec![-0.8; 2], hi: vec![0.8; 2] });
    let config = Config { horizon: Some(5), x_bounds: bounds, ..Config::default() };
    let mut mhe = DdMhe::new(&history, config).unwrap();
    // now and then one is lost, or one that cannot be computed with
    let mut outputs = noise(1, 2 * 1009, 0.4);
    (outputs[100], outputs[777], outputs[1500]) = (f64::NAN, 1e300, -1e9);
    let mut statuses = [0_u64; 4];
    drop(mhe.run(&outputs).unwrap());
    let before = resident();
    let used = allocation_counter::measure(|| {
        for y in outputs.chunks_exact(2).cycle().take(steps) {
            let e = mhe.step(y).unwrap();
            assert!(e.status != Status::Optimal || e.x.iter().all(|x| x.is_finite()));
            statuses[e.status.code() as usize] += 1;
        }
    });
    let grown = before.zip(resident()).map_or(0, |(a, b)| b.saturating_sub(a));
    println!(
        "{steps} steps ({statuses:?} optimal, almost, infeasible, failed): {} allocations, {} \
         bytes at most, resident memory grown by {grown} bytes",
        used.count_total, used.bytes_max
    );
    assert!(grown < 1 << 20 && mhe.t() == steps + 1009);
    // a spike that no method in flight decides is the solver's, which allocates
    assert!(used.bytes_current == 0 && used.count_total < steps as u64);
    assert!(statuses[0] > 1_000_000 && statuses[3] > 1000);
}
