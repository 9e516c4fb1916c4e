//! Steps allocate nothing after construction, on every path but the interior-point solver's.

use crate::systems::{modes, noise, unit_certificate};
use ddmhe_core::{
    Bounds, Center, Config, DdMhe, Disturbance, Gate, History, Soft, Space, Start, Step,
};

/// What 340 steps allocate from the first on, and in how many of them bounds were active.
fn allocations(config: Config, lost: impl Fn(usize) -> bool) -> (u64, usize) {
    let system = modes(2);
    let p = system.p();
    let history = system.record(&[1.0, 0.5, -0.3, 0.8], 120);
    let mut mhe = DdMhe::new(&history, config).unwrap();
    let (_, mut outputs) = system.simulate(&[0.5, 1.0, 0.2, -0.4], 400);
    outputs.iter_mut().zip(noise(3, 400 * p, 1e-2)).for_each(|(y, e)| *y += e);
    (0..outputs.len()).filter(|&k| lost(k)).for_each(|k| outputs[k] = f64::NAN);
    let mut bound = 0;
    let found = allocation_counter::measure(|| {
        for y in outputs.chunks_exact(p) {
            bound += usize::from(mhe.step(y).unwrap().active > 0);
        }
    });
    (found.count_total, bound)
}

fn config() -> Config {
    let space = Space::Truncated { rank: Some(4), tol: None };
    let start = Start::State;
    Config { horizon: Some(20), rho: Some(0.95), mu: Some(0.1), space, start, ..Config::default() }
}

fn within(size: f64, width: usize) -> Option<Bounds> {
    Some(Bounds { lo: vec![-size; width], hi: vec![size; width] })
}

#[test]
fn no_path_of_a_step_allocates() {
    let none = |_: usize| false;
    assert_eq!(allocations(config(), none), (0, 0));
    assert_eq!(
        allocations(
            Config { x_bounds: within(1e3, 4), v_bounds: within(1e3, 3), ..config() },
            none
        ),
        (0, 0)
    );
    // active bounds
    let tight = Config { x_bounds: within(1e3, 4), v_bounds: within(9.5e-3, 3), ..config() };
    let (count, bound) = allocations(tight.clone(), none);
    assert!(count == 0 && bound > 50, "{count} {bound}");
    // about a centre, and with lost outputs
    let centred = Config { x_bounds: within(5e-4, 4), x_center: Center::History, ..config() };
    let (count, bound) = allocations(centred, none);
    assert!(count == 0 && bound > 50, "{count} {bound}");
    let (count, bound) = allocations(tight.clone(), |k| k % 17 == 0);
    assert!(count == 0 && bound > 50, "{count} {bound}");
    // bounds that are left
    for price in [1e-3, 1.0, 1e3] {
        let soft =
            Config { soft: Some(Soft::all(price)), v_bounds: within(1e-3, 3), ..tight.clone() };
        let (count, bound) = allocations(soft, |k| k % 17 == 0);
        assert!(count == 0 && bound > 50, "{count} {bound}");
    }
    // outputs that are rejected, and a run that starts again
    let doubting = Config { gate: Gate::At(2.0), output_noise: Some(vec![3e-3]), ..config() };
    assert_eq!(allocations(doubting.clone(), |k| k % 17 == 0), (0, 0));
    assert_eq!(allocations(Config { start: Start::Recording, ..doubting }, none), (0, 0));
    // no window inside of the box
    assert_eq!(allocations(Config { x_bounds: within(1e-3, 4), ..config() }, none).0, 0);
}

#[test]
fn no_step_with_an_error_bound_allocates() {
    let certificate = unit_certificate(4, 3, 0.9);
    let disturbance = Disturbance { initial: 1.0, w: 0.01, v: 0.02 };
    let settings = Config {
        rho: None,
        mu: None,
        certificate: Some(certificate),
        disturbance: Some(disturbance),
        v_bounds: within(1e3, 3),
        ..config()
    };
    assert_eq!(allocations(settings.clone(), |_| false), (0, 0));
    assert_eq!(allocations(settings, |k| k % 31 == 0), (0, 0));
}

#[test]
fn no_step_with_known_inputs_allocates() {
    let system = modes(2);
    let u = noise(5, 2 * 520, 1.0);
    let (x, y) = system.driven(&[1.0, 0.5, -0.3, 0.8], &u);
    let (n, p, T) = (system.n(), system.p(), 120);
    let history = History::new(n, p, &x[..(T + 1) * n], &y[..T * p], 0.1).unwrap();
    let history = history.with_inputs(2, &u[..2 * T]).unwrap();
    let boxed = Config { x_bounds: within(3.0, 4), v_bounds: within(0.2, 3), ..config() };
    for config in [config(), boxed] {
        let mut mhe = DdMhe::new(&history, config).unwrap();
        let mut bound = 0;
        let found = allocation_counter::measure(|| {
            for k in T..T + 400 {
                let (y, u) = (&y[k * p..(k + 1) * p], &u[2 * k..2 * k + 2]);
                let step = Step { y, u, x_bounds: None };
                bound += usize::from(mhe.step_with(step).unwrap().active > 0);
            }
        });
        assert_eq!(found.count_total, 0, "{bound}");
    }
}
