//! Snapshots: as they were made, or refused with a sentence that says what happened to them.

use crate::systems::{modes, noise};
use ddmhe_core::{Bounds, Config, DdMhe, Error, History};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A small estimator with active bounds, nine steps on.
fn running() -> DdMhe {
    let system = modes(1);
    let history = system.record(&[1.0, 0.5], 24);
    let bounds = Some(Bounds { lo: vec![-0.3; 2], hi: vec![0.3; 2] });
    let config = Config { horizon: Some(5), x_bounds: bounds, ..Config::default() };
    let mut mhe = DdMhe::new(&history, config).unwrap();
    let outputs = noise(1, 9 * system.p(), 0.3);
    mhe.run(&outputs).unwrap();
    mhe
}

fn refused<T>(found: Result<T, Error>) -> String {
    match found {
        Err(error @ Error::Value { argument: "blob", .. }) => error.to_string(),
        Err(other) => panic!("another kind of error: {other}"),
        Ok(_) => panic!("restored"),
    }
}

/// The same bytes with the checksum that belongs to them.
fn sealed(mut blob: Vec<u8>) -> Vec<u8> {
    let length = (blob.len() - 20) as u64;
    blob[8..16].copy_from_slice(&length.to_le_bytes());
    let sum = crc32fast::hash(&[&blob[..16], &blob[20..]].concat());
    blob[16..20].copy_from_slice(&sum.to_le_bytes());
    blob
}

#[test]
fn no_flipped_bit_goes_unnoticed() {
    let blob = running().snapshot();
    assert!(blob.len() > 1000);
    for bit in 0..8 * blob.len() {
        let mut changed = blob.clone();
        changed[bit / 8] ^= 1 << (bit % 8);
        let words = refused(DdMhe::restore(&changed));
        assert!(bit < 160 || words.contains("changed"), "{bit}: {words}");
    }
    assert_eq!(DdMhe::restore(&blob).unwrap().snapshot(), blob);
}

#[test]
fn cut_longer_and_foreign_bytes_are_told_apart() {
    let mhe = running();
    let (blob, history) = (mhe.snapshot(), mhe.history().to_bytes());
    for length in 6..blob.len() {
        let words = refused(DdMhe::restore(&blob[..length]));
        assert!(words.contains("cut off"), "{length}: {words}");
    }
    for extra in [&b"\0"[..], b"more", &blob] {
        let words = refused(DdMhe::restore(&[&blob, extra].concat()));
        assert!(words.contains("longer"), "{words}");
    }
    for foreign in [&b""[..], b"ddmhe", b"hello", &[0; 4000], b"PK\x03\x04 and so on, and so on"] {
        let words = refused(DdMhe::restore(foreign));
        assert!(words.contains("did not write"), "{words}");
    }
    let mut old = blob.clone();
    old[6] -= 1;
    assert!(refused(DdMhe::restore(&sealed(old))).contains("format"));
    assert!(refused(DdMhe::restore(&history)).contains("recording"));
    assert!(refused(History::from_bytes(&blob)).contains("estimator"));
    assert_eq!(&History::from_bytes(&history).unwrap(), mhe.history());
}

/// With a checksum that fits: an error or an estimator that steps, never a panic, and no memory
/// that the bytes do not pay for.
#[test]
fn hostile_content_is_harmless() {
    let mhe = running();
    let y = vec![0.1; mhe.p()];
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    // a fifth without optimisation
    let share = if cfg!(debug_assertions) { 5 } else { 1 };
    for (blob, of_estimator) in [(mhe.snapshot(), true), (mhe.history().to_bytes(), false)] {
        let (mut restored, mut read) = (0, 0);
        for trial in 0..6000 / share {
            let mut hostile = blob.clone();
            let at = 20 + share * trial % (blob.len() - 20);
            match trial % 4 {
                0 => hostile[at] = rng.random(),
                1 => hostile[at] ^= 1 << rng.random_range(0..8),
                // a length or count of up to 2^64
                2 => {
                    drop(hostile.splice(
                        at..=at,
                        [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f, 0x01],
                    ));
                }
                _ => hostile.truncate(at),
            }
            let hostile = sealed(hostile);
            let used = allocation_counter::measure(|| {
                read += usize::from(History::from_bytes(&hostile).is_ok());
                let Ok(mut mhe) = DdMhe::restore(&hostile) else { return };
                restored += 1;
                for _ in 0..3 {
                    drop(mhe.step(&y));
                }
                assert!(mhe.snapshot().len() < 2 * hostile.len() + 1000);
            });
            assert!(
                used.bytes_max < 8 << 20,
                "{} bytes for a blob of {}",
                used.bytes_max,
                hostile.len()
            );
        }
        // many changes are harmless; bytes of the one are never taken for the other
        let (taken, foreign) = if of_estimator { (restored, read) } else { (read, restored) };
        assert!(share * taken > 500 && foreign == 0, "{taken} {foreign}");
    }
}
