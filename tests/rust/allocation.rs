//! Steps that need no solver allocate nothing once the window is full.

use crate::systems::{modes, noise};
use ddmhe_core::{Bounds, Config, DdMhe, Space};

fn allocations(config: Config) -> u64 {
    let system = modes(2);
    let history = system.record(&[1.0, 0.5, -0.3, 0.8], 120);
    let mut mhe = DdMhe::new(&history, config).unwrap();
    let (_, mut outputs) = system.simulate(&[0.5, 1.0, 0.2, -0.4], 400);
    outputs.iter_mut().zip(noise(3, 400 * system.p(), 1e-3)).for_each(|(y, e)| *y += e);
    let (warm, rest) = outputs.split_at(60 * system.p());
    mhe.run(warm).unwrap();
    let found = allocation_counter::measure(|| {
        for y in rest.chunks_exact(system.p()) {
            assert_eq!(mhe.step(y).unwrap().iterations, 0);
        }
    });
    found.count_total
}

fn config() -> Config {
    let space = Space::Truncated { rank: Some(4), tol: None };
    Config { horizon: Some(20), rho: Some(0.95), mu: Some(0.1), space, ..Config::default() }
}

#[test]
fn a_step_without_active_bounds_allocates_nothing() {
    assert_eq!(allocations(config()), 0);
    let wide = |width: usize| Some(Bounds { lo: vec![-1e3; width], hi: vec![1e3; width] });
    assert_eq!(allocations(Config { x_bounds: wide(4), v_bounds: wide(3), ..config() }), 0);
}
