//! Bytes of a snapshot and of a recording, under a checksum that fits.
#![no_main]

use ddmhe_core::{DdMhe, History, Step};
use ddmhe_fuzz::{check, sealed};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    assert!(History::from_bytes(bytes).is_err() || !bytes.is_empty());
    if let Ok(history) = History::from_bytes(&sealed::blob(bytes, 2)) {
        assert!(History::from_bytes(&history.to_bytes()) == Ok(history));
    }
    let Ok(mut mhe) = DdMhe::restore(&sealed::blob(bytes, 1)) else { return };
    let again = DdMhe::restore(&mhe.snapshot());
    let mut again = again.unwrap_or_else(|error| panic!("what was restored is restored: {error}"));
    let u = vec![0.1; mhe.history().m()];
    for k in 0..12 {
        let y: Vec<f64> = (0..mhe.p()).map(|j| [0.1, f64::NAN, -2.0, 1e9][(k + j) % 4]).collect();
        let step = Step { y: &y, u: &u, x_bounds: None };
        let found = mhe.step_with(step).map(|e| (e.x.iter().all(|x| x.is_finite()), check::of(e)));
        assert!(found.as_ref().is_ok_and(|(finite, _)| *finite) || !u.is_empty(), "{found:?}");
        assert!(again.step_with(step).map(check::of) == found.map(|(_, bits)| bits), "step {k}");
    }
});
