//! Checksums that fit, so that damage gets past them.

const BLOB_HEAD: usize = 20;

/// A blob of this kind (see `ddmhe_interval::blob`) whose head belongs to its body.
pub fn blob(bytes: &[u8], kind: u8) -> Vec<u8> {
    let body = bytes.get(BLOB_HEAD..).unwrap_or_default();
    let mut blob = vec![0; BLOB_HEAD];
    blob[..8].copy_from_slice(b"ddmhe\0\x07\x01");
    if let (Some(format), true) = (bytes.get(6), bytes.len() > BLOB_HEAD) {
        blob[6] = *format;
    }
    blob[7] = kind;
    blob[8..16].copy_from_slice(&(body.len() as u64).to_le_bytes());
    let sum = crc32fast::hash(&[&blob[..16], body].concat());
    blob[16..].copy_from_slice(&sum.to_le_bytes());
    blob.extend_from_slice(body);
    blob
}

/// A plan whose length and checksum belong to its numbers, and nothing where there are too few.
pub fn plan(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut plan = bytes[..bytes.len() / 8 * 8].to_vec();
    let numbers = plan.len() / 8;
    if numbers < 4 {
        return None;
    }
    plan[16..24].copy_from_slice(&(numbers as f64).to_le_bytes());
    let sum = f64::from(crc32fast::hash(&[&plan[..24], &plan[32..]].concat()));
    plan[24..32].copy_from_slice(&sum.to_le_bytes());
    Some(plan)
}
