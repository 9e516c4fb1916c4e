//! Hankel matrices, the rank condition and the documented identities of the trajectory space.

use crate::systems::{modes, noise};
use ddmhe_core::{BlockHankel, Config, DdMhe, Equilibrium, Error, History, Space};

#[test]
fn block_hankel_columns_are_slices_of_the_signal() {
    let signal: Vec<f64> = (0..10).map(f64::from).collect(); // 5 samples of 2 channels
    let H = BlockHankel::new(&signal, 2, 3).unwrap();
    assert_eq!((H.nrows(), H.ncols()), (6, 3));
    assert_eq!(H.col(1).unwrap(), [2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    assert_eq!(H.to_mat()[(5, 2)], 9.0);
    assert!(std::ptr::eq(H.col(0).unwrap().as_ptr(), signal.as_ptr()));
    assert_eq!(BlockHankel::new(&signal, 2, 6).unwrap().ncols(), 0);
}

#[test]
fn windows_never_cross_a_seam() {
    let system = modes(1);
    let (a, b) = (system.record(&[1.0, 0.0], 10), system.record(&[0.0, -2.0], 7));
    let joined = History::concat(&[a.clone(), b.clone()]).unwrap();
    for depth in 1..=12 {
        assert_eq!(joined.windows(depth), a.windows(depth) + b.windows(depth));
        let columns: usize = joined
            .hankel(depth)
            .map(|(H_x, H_y)| {
                assert_eq!(H_x.ncols(), H_y.ncols());
                H_x.ncols()
            })
            .sum();
        assert_eq!(columns, joined.windows(depth));
    }
    assert_eq!(joined.windows(8), 3);
    assert_eq!(joined.windows(11), 0);
}

#[test]
fn rank_of_a_noise_free_recording_is_n_at_every_horizon() {
    let system = modes(3);
    let history = system.record(&noise(4, 6, 2.0), 120);
    for horizon in [1, 2, 5, 20, 60] {
        let config = Config { horizon: Some(horizon), space: Space::Exact, ..Config::default() };
        assert_eq!(DdMhe::new(&history, config).unwrap().settings().rank, 6);
    }
}

#[test]
fn a_state_at_rest_violates_the_rank_condition() {
    let system = modes(2);
    let mut start = vec![1.0, 0.5, 0.0, 0.0];
    // the second block at its own rest
    let (radius, angle) = system.blocks[1];
    let (s, c) = (radius * angle.sin(), radius * angle.cos());
    let det = (1.0 - c) * (1.0 - c) + s * s;
    (start[2], start[3]) = (system.offset * (1.0 - c) / det, system.offset * s / det);
    let history = system.record(&start, 40);
    let report = history.rank(5).unwrap();
    assert_eq!((report.rank, report.required, report.satisfied()), (3, 5, false));
    assert!(matches!(
        DdMhe::new(&history, Config { horizon: Some(5), ..Config::default() }),
        Err(Error::Rank { .. })
    ));
}

#[test]
fn the_equilibrium_joins_the_data_only_when_they_are_noisy() {
    let system = modes(1);
    let (x, y) = system.simulate(&[1.0, 0.5], 60);
    let rest = Some(Equilibrium { x: vec![0.1, 0.1], y: vec![0.4, 0.0], u: vec![] });
    let config = Config { equilibrium: rest, horizon: Some(8), ..Config::default() };
    let clean = DdMhe::new(&History::new(2, 2, &x, &y, 0.1).unwrap(), config.clone()).unwrap();
    assert!(!clean.settings().equilibrium_used);
    let noisy: Vec<f64> = x.iter().zip(noise(5, x.len(), 0.01)).map(|(x, v)| x + v).collect();
    let noisy = DdMhe::new(&History::new(2, 2, &noisy, &y, 0.1).unwrap(), config).unwrap();
    assert!(noisy.settings().equilibrium_used);
}
