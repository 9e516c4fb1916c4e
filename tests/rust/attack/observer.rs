//! Interval observers of any numbers: an error that changes nothing, or ordered sets; what was
//! saved goes on with the same bits.

use super::source::Source;
use ddmhe_core::observer::{Gain, Linear, Method, Options, System};
use ddmhe_core::{Error, Interval, IntervalEstimate, IntervalObserver, Reduction, Zonotope};
use proptest::prelude::*;

const METHODS: [(Method, Reduction); 4] = [
    (Method::Paper, Reduction::Paper),
    (Method::Tight, Reduction::Girard),
    (Method::Tight, Reduction::Pca),
    (Method::Tight, Reduction::Combastel),
];

/// A stable system of two states, of which up to four numbers are of any kind.
fn observer(source: &mut Source<'_>) -> Result<IntervalObserver<Linear>, Error> {
    let identity = vec![1.0, 0.0, 0.0, 1.0];
    let mut system = System {
        A: vec![0.9, 0.1, -0.1, 0.9],
        C: vec![1.0, 0.2],
        D1: identity.clone(),
        D2: vec![1.0],
        j_lo: vec![0.0; 4],
        j_hi: vec![0.0; 4],
        w_radius: vec![0.01; 2],
        v_radius: vec![0.05],
        ..System::default()
    };
    let mut gain = Gain {
        L: vec![0.4, 0.1],
        P: identity,
        lambda: 0.05,
        gamma: 30.0,
        mu_w: 30.0,
        mu_v: 30.0,
        ..Gain::default()
    };
    let (mut center, mut radius) = (vec![1.0, 0.0], vec![0.5, 0.5]);
    for _ in 0..source.below(5) {
        let value = source.number();
        match source.below(8) {
            0 => system.A[source.below(4)] = value,
            1 => system.C[source.below(2)] = value,
            2 => system.w_radius[source.below(2)] = value,
            3 => system.v_radius[0] = value,
            4 => gain.L[source.below(2)] = value,
            5 => gain.P[source.below(4)] = value,
            6 => center[source.below(2)] = value,
            _ => radius[source.below(2)] = value,
        }
    }
    let (method, reduction) = METHODS[source.below(METHODS.len())];
    let options = Options { order: 1 + source.below(12), method, reduction };
    IntervalObserver::new(Linear, system, gain, &center, &radius, options)
}

fn ordered(e: &IntervalEstimate) -> bool {
    let sets = [&e.predicted, &e.filtered, &e.ball, &e.ellipsoid];
    let ordered = |set: &Interval| set.lo <= set.hi;
    sets.iter().all(|set| set.iter().all(ordered))
}

/// Ordered sets or an error; a refused sample changes nothing; the rest goes on as saved.
fn watch(source: &mut Source<'_>) {
    let Ok(mut own) = observer(source) else { return };
    for k in 0..12 {
        let y = if source.once_in(3) { source.number() } else { 0.9_f64.powi(k) };
        let before = own.present();
        match own.step(&[y], &[]).map(ordered) {
            Ok(is_ordered) => assert!(is_ordered, "step {k}: {:?}", own.estimate()),
            Err(_) => assert_eq!(before, own.present(), "step {k}"),
        }
        // back to where it was, and the same step again; bytes, since a centre may be no number
        let after = own.present();
        own.resume(&before).unwrap();
        drop(own.step(&[y], &[]));
        assert_eq!(own.present(), after, "step {k} again");
    }
    assert!(own.step(&[], &[]).is_err() && own.step(&[0.0], &[1.0]).is_err());
}

/// Sets of any numbers: errors, or sets that hold their own centre.
fn sets(source: &mut Source<'_>) {
    let n = 1 + source.below(3);
    let (center, generators) = (source.numbers(n, true), source.below(6));
    let columns = source.numbers(n * generators, true);
    let Ok(set) = Zonotope::new(center.clone(), columns) else { return };
    let other = Zonotope::new(source.numbers(n, true), source.numbers(n, true));
    let images = [
        set.linear_map(&source.numbers(n * n, true)),
        set.translate(&source.numbers(n, true)),
        other.and_then(|other| set.minkowski_sum(&other)),
        set.reduce(n + source.below(4), Reduction::Girard),
        set.reduce(n + source.below(4), Reduction::Pca),
    ];
    for image in images.into_iter().flatten() {
        assert!(image.interval_hull().iter().all(|side| side.lo <= side.hi));
    }
    assert!(set.interval_hull().iter().zip(&center).all(|(side, c)| side.contains(*c)));
    drop((set.contains(&center), set.support(&source.numbers(n, true)), set.volume()));
}

proptest! {
    #![proptest_config(ProptestConfig {
        failure_persistence: None,
        ..ProptestConfig::with_cases(1000)
    })]

    #[test]
    fn observers_of_any_numbers(bytes in prop::collection::vec(any::<u8>(), 0..120)) {
        watch(&mut Source(&bytes));
    }

    #[test]
    fn sets_of_any_numbers(bytes in prop::collection::vec(any::<u8>(), 0..160)) {
        sets(&mut Source(&bytes));
    }
}
