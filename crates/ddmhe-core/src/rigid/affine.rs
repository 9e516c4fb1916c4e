//! The affine motion ω̇ = A ω + e, y = C ω + r: the yardstick for whether a rigid body explains a
//! recording.

use ddmhe_run::rigid::motion::{Entry, Given, MOVING, Motion, Slopes};

/// Unknowns before those of the output: ω, and [A e] by rows.
pub(crate) const OUTPUT: usize = 15;

/// Unknowns that one output depends on.
const SEEN: usize = 9;

/// Unknowns of an affine motion with p outputs: ω, [A e] and C by rows, r.
pub(crate) const fn affine_unknowns(p: usize) -> usize {
    OUTPUT + 4 * p
}

/// An affine motion with P outputs and N = [`affine_unknowns`]`(P)` unknowns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Affine<const P: usize, const N: usize> {
    pub given: Given<N>,
}

/// aᵀ(ω, 1) of the four numbers from `at` on.
fn with_one(z: &[f64], w: &[f64; 3]) -> f64 {
    z[0] * w[0] + z[1] * w[1] + z[2] * w[2] + z[3]
}

impl<const P: usize, const N: usize> Motion<P, N> for Affine<P, N> {
    type Parts = [f64; N];
    type Known = ();
    type Drive = ();
    type Row = [Entry; SEEN];

    const EVERYWHERE: &'static [()] = &[(); usize::MAX];

    fn between((): &(), (): &(), _: f64) {}

    fn given(&self) -> &Given<N> {
        &self.given
    }

    fn parts(&self, z: &[f64; N]) -> [f64; N] {
        const { assert!(N == affine_unknowns(P), "N unknowns of P outputs") };
        *z
    }

    fn rate(&self, z: &[f64; N], (): &(), w: &[f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|i| with_one(&z[3 + 4 * i..], w))
    }

    fn slope(&self, z: &[f64; N], (): &(), w: &[f64; 3], slopes: &mut Slopes) -> [f64; 3] {
        *slopes = [[0.0; MOVING]; 3];
        for (i, row) in slopes.iter_mut().enumerate() {
            row[..3].copy_from_slice(&z[3 + 4 * i..6 + 4 * i]);
            row[3 + 4 * i..6 + 4 * i].copy_from_slice(w);
            row[6 + 4 * i] = 1.0;
        }
        self.rate(z, &(), w)
    }

    fn output(&self, z: &[f64; N], (): &(), w: &[f64; 3]) -> [f64; P] {
        let mut y = [0.0; P];
        for (i, y) in y.iter_mut().enumerate() {
            let row = &z[OUTPUT + 3 * i..];
            *y = row[0] * w[0] + row[1] * w[1] + row[2] * w[2] + z[OUTPUT + 3 * P + i];
        }
        y
    }

    fn rows(&self, z: &[f64; N], (): &(), w: &[f64; 3]) -> [[Entry; SEEN]; P] {
        let mut rows = [[(0, 0.0); SEEN]; P];
        for (i, row) in rows.iter_mut().enumerate() {
            for (k, w) in w.iter().enumerate() {
                row[k] = (k, z[OUTPUT + 3 * i + k]);
                row[3 + k] = (OUTPUT + 3 * i + k, *w);
            }
            row[6] = (OUTPUT + 3 * P + i, 1.0);
        }
        rows
    }
}
