//! Objects as bytes, and back: estimators, recordings, estimates.
//!
//! Every blob says what it is before it says anything else:
//!
//! | bytes | content |
//! |---|---|
//! | 6 | `ddmhe\0` |
//! | 1 | format of what follows |
//! | 1 | [`Kind`]: what was saved |
//! | 8 | length of the body, little-endian |
//! | 4 | CRC-32 of all bytes before it and of the body, little-endian |
//! | … | the body, in postcard's format |
//!
//! so that nothing is read that was not written by [`to_bytes`], as it was written: CRC-32 finds
//! every change within 32 consecutive bits, and any other but for one in four billion. It is no
//! signature: who wants to deceive can compute it, and therefore what comes out is checked like any
//! argument.

use crate::error::Error;
use serde::Serialize;
use serde::de::DeserializeOwned;

const MAGIC: &[u8; 6] = b"ddmhe\0";
/// Goes up with every change of what is saved.
const FORMAT: u8 = 18;
/// Bytes before the checksum, and before the body.
const HEAD: usize = 16;
const BODY: usize = HEAD + 4;

/// What a blob holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// A `DdMhe`.
    Estimator = 1,
    /// A `History`.
    History = 2,
    /// An `Estimate`.
    Estimate = 3,
    /// A `RankReport`.
    RankReport = 4,
    /// Where an [`IntervalObserver`](crate::IntervalObserver) stands.
    Observer = 5,
    /// An [`IntervalEstimate`](crate::IntervalEstimate).
    IntervalEstimate = 6,
    /// All sets of a run of an interval observer.
    IntervalLog = 7,
    /// A `RigidBodyMhe`.
    RigidBody = 8,
}

impl Kind {
    const ALL: [Kind; 8] = [
        Kind::Estimator,
        Kind::History,
        Kind::Estimate,
        Kind::RankReport,
        Kind::Observer,
        Kind::IntervalEstimate,
        Kind::IntervalLog,
        Kind::RigidBody,
    ];

    fn name(self) -> &'static str {
        match self {
            Kind::Estimator => "an estimator's snapshot",
            Kind::History => "a saved recording",
            Kind::Estimate => "a saved estimate",
            Kind::RankReport => "a saved rank report",
            Kind::Observer => "an interval observer's state",
            Kind::IntervalEstimate => "a saved interval estimate",
            Kind::IntervalLog => "a saved interval log",
            Kind::RigidBody => "a snapshot of a rigid body's estimator",
        }
    }
}

/// `value` as a blob of this kind, for [`from_bytes`].
pub fn to_bytes<T: Serialize>(kind: Kind, value: &T) -> Vec<u8> {
    let mut blob = MAGIC.to_vec();
    blob.extend([FORMAT, kind as u8]);
    blob.extend([0; BODY - MAGIC.len() - 2]);
    // Writing plain numbers to memory cannot fail.
    let mut blob = postcard::to_extend(value, blob).unwrap_or_default();
    let length = blob.len().saturating_sub(BODY) as u64;
    blob[MAGIC.len() + 2..HEAD].copy_from_slice(&length.to_le_bytes());
    let sum = checksum(&blob);
    blob[HEAD..BODY].copy_from_slice(&sum.to_le_bytes());
    blob
}

/// What [`to_bytes`] saved under this kind. Its numbers are the caller's to check.
///
/// # Errors
/// [`Error::Value`] that says whether the bytes are foreign, of another format or kind, cut off,
/// too long or changed.
pub fn from_bytes<T: DeserializeOwned>(kind: Kind, blob: &[u8]) -> Result<T, Error> {
    let wrong =
        |found: String| Error::value("blob", format!("{} as it was made", kind.name()), found);
    if !blob.starts_with(MAGIC) {
        return Err(wrong(format!("{} bytes that this package did not write", blob.len())));
    }
    if blob.len() < BODY {
        return Err(wrong(format!("one that was cut off after {} bytes", blob.len())));
    }
    let (format, stated) = (blob[MAGIC.len()], blob[MAGIC.len() + 1]);
    if format != FORMAT {
        return Err(wrong(format!(
            "one of format {format}, and this version of the package reads format {FORMAT}"
        )));
    }
    let mut length = [0; 8];
    length.copy_from_slice(&blob[MAGIC.len() + 2..HEAD]);
    let (length, found) = (u64::from_le_bytes(length), (blob.len() - BODY) as u64);
    if found < length {
        return Err(wrong(format!("one that was cut off: {found} bytes of {length}")));
    }
    if found > length {
        return Err(wrong(format!("one that is longer: {found} bytes in the place of {length}")));
    }
    if checksum(blob).to_le_bytes() != blob[HEAD..BODY] {
        return Err(wrong("one with bytes that were changed: its checksum is another".into()));
    }
    if stated != kind as u8 {
        let name =
            Kind::ALL.iter().find(|k| **k as u8 == stated).map_or("something else", |k| k.name());
        return Err(wrong(name.into()));
    }
    match postcard::take_from_bytes(&blob[BODY..]) {
        Ok((value, [])) => Ok(value),
        _ => Err(wrong("one whose content cannot be read".into())),
    }
}

/// Of everything but the checksum itself.
fn checksum(blob: &[u8]) -> u32 {
    let mut sum = crc32fast::Hasher::new();
    sum.update(&blob[..HEAD]);
    sum.update(&blob[BODY..]);
    sum.finalize()
}
