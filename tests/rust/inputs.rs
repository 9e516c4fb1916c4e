//! One test per kind of wrong input at the Rust border; the Python tests go through all arguments.

use crate::systems::modes;
use ddmhe_core::{BlockHankel, Bounds, Config, DdMhe, Error, History};

fn history() -> History {
    modes(1).record(&[1.0, 0.5], 30)
}

fn rejected(config: Config) -> Error {
    match DdMhe::new(&history(), config) {
        Err(error) => error,
        Ok(_) => panic!("accepted"),
    }
}

#[test]
fn sizes_that_do_not_fit() {
    assert!(matches!(
        History::new(2, 1, &[0.0; 7], &[0.0; 3], 0.1),
        Err(Error::Shape { argument: "x", .. })
    ));
    assert!(matches!(
        History::new(2, 1, &[0.0; 6], &[0.0; 3], 0.1),
        Err(Error::Shape { argument: "x", .. })
    ));
    assert!(matches!(
        History::new(0, 1, &[], &[0.0; 3], 0.1),
        Err(Error::Shape { argument: "x", .. })
    ));
    assert!(matches!(
        DdMhe::new(&history(), Config::default()).unwrap().step(&[1.0]),
        Err(Error::Shape { argument: "y", .. })
    ));
    assert!(matches!(
        rejected(Config { x_prior: Some(vec![0.0]), ..Config::default() }),
        Error::Shape { argument: "x_prior", .. }
    ));
    let bounds = Some(Bounds { lo: vec![0.0; 2], hi: vec![0.0; 3] });
    assert!(matches!(
        rejected(Config { x_bounds: bounds, ..Config::default() }),
        Error::Shape { argument: "x_bounds", .. }
    ));
}

#[test]
fn numbers_that_are_not_finite() {
    let found = History::new(1, 1, &[0.0, f64::NAN, 1.0], &[0.0, 1.0], 0.1);
    assert!(matches!(found, Err(Error::NotFinite { argument: "x", row: 1, column: 0, .. })));
    let mut mhe = DdMhe::new(&history(), Config::default()).unwrap();
    assert!(matches!(mhe.step(&[f64::INFINITY, 0.0]), Err(Error::NotFinite { argument: "y", .. })));
    assert_eq!(mhe.t(), 0);
    assert!(mhe.step(&[f64::NAN, 0.0]).is_ok());
}

#[test]
fn settings_out_of_range() {
    for rho in [0.0, 1.0, f64::NAN] {
        assert!(matches!(
            rejected(Config { rho: Some(rho), ..Config::default() }),
            Error::Value { argument: "rho", .. }
        ));
    }
    assert!(matches!(
        rejected(Config { mu: Some(-1.0), ..Config::default() }),
        Error::Value { argument: "mu", .. }
    ));
    assert!(matches!(
        rejected(Config { horizon: Some(0), ..Config::default() }),
        Error::Value { argument: "horizon", .. }
    ));
    assert!(matches!(
        rejected(Config { horizon: Some(29), ..Config::default() }),
        Error::Value { argument: "horizon", .. }
    ));
    assert!(DdMhe::new(&history(), Config { horizon: Some(28), ..Config::default() }).is_ok());
}

#[test]
fn a_message_names_argument_expectation_and_finding() {
    let error = rejected(Config { rho: Some(1.5), ..Config::default() });
    assert_eq!(error.to_string(), "rho: expected a number in (0, 1), found 1.5");
}

#[test]
fn what_is_not_there_is_an_error() {
    let history = history();
    assert_eq!((history.x(0).unwrap().len(), history.y(0).unwrap().len()), (62, 60));
    for i in [1, usize::MAX] {
        assert!(matches!(history.x(i), Err(Error::Value { argument: "i", .. })));
        assert!(matches!(history.y(i), Err(Error::Value { argument: "i", .. })));
    }
    assert_eq!(history.hankel(0).count(), 0);
    let signal = [0.0; 6];
    assert!(matches!(BlockHankel::new(&signal, 0, 2), Err(Error::Value { argument: "width", .. })));
    assert!(matches!(BlockHankel::new(&signal, 2, 0), Err(Error::Value { argument: "depth", .. })));
    assert!(matches!(
        BlockHankel::new(&signal, 4, 1),
        Err(Error::Shape { argument: "signal", .. })
    ));
    let H = BlockHankel::new(&signal, 2, 2).unwrap();
    assert!(H.col(1).is_ok());
    for k in [2, usize::MAX] {
        assert!(matches!(H.col(k), Err(Error::Value { argument: "k", .. })));
    }
    let endless = BlockHankel::new(&signal, 2, usize::MAX).unwrap();
    assert_eq!((endless.ncols(), endless.to_mat().ncols()), (0, 0));
}
