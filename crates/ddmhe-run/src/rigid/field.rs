//! The rigid body in a magnetic field that is known: what brakes it has turned or changed its
//! magnet.

use crate::rigid::layout::INERTIA;
use crate::rigid::motion::{Entry, Family, Given, MOVING, Motion, Slopes};
use crate::rigid::small::{Matrix, Vector, along_basis, cross, dot, inertia, inverse, times};
use core::ops::Range;

/// Place of M: entries 11, 12, 13, 22, 23, 33.
pub const MAGNETIC: usize = 8;
/// Of the drag's γ.
pub const DRAG_CUBIC: usize = 14;
/// Of log κ, less that of [`FieldBody::scale`].
pub const GAIN: usize = 15;
/// Of r; behind it lies the output's γ.
pub const OFFSET: usize = 16;
/// Unknowns that one output depends on.
const SEEN: usize = 12;

/// How many unknowns there are with p outputs.
pub const fn field_unknowns(p: usize) -> usize {
    OFFSET + p + 1
}

/// What is known of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field<const P: usize> {
    /// B at the body.
    pub B: Vector,
    /// K (P × 3): what the outputs show of the moment that B induces.
    pub K: [Vector; P],
}

/// A body with P outputs and N = [`field_unknowns`]`(P)` unknowns, which a known field brakes:
/// D = \[B\] M \[B\], C = -κ K M \[B\], M symmetric.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldBody<const P: usize, const N: usize> {
    /// κ where its unknown is 0.
    pub scale: f64,
    /// What its fits are told.
    pub given: Given<N>,
}

/// What the unknowns determine.
#[derive(Debug, Clone, Copy)]
pub struct FieldParts<const P: usize> {
    J: Matrix,
    Ji: Matrix,
    M: Matrix,
    kappa: f64,
    r: [f64; P],
    drag: f64, // γ / W² of the drag
    seen: f64, // of the output
}

/// M of its six entries.
#[inline(always)]
fn symmetric(m: &[f64]) -> Matrix {
    [[m[0], m[1], m[2]], [m[1], m[3], m[4]], [m[2], m[4], m[5]]]
}

/// ∂(M u)/∂(entries of M)
#[inline(always)]
fn along_entries(u: &Vector) -> [Vector; 6] {
    let [a, b, c] = *u;
    [[a, 0.0, 0.0], [b, a, 0.0], [c, 0.0, a], [0.0, b, 0.0], [0.0, c, b], [0.0, 0.0, c]]
}

impl<const P: usize, const N: usize> Motion<P, N> for FieldBody<P, N> {
    type Parts = FieldParts<P>;
    type Known = Field<P>;
    type Drive = Vector;
    type Row = [Entry; SEEN];

    const EVERYWHERE: &'static [Field<P>] = &[];

    /// B, linear between samples.
    #[inline(always)]
    fn between(from: &Field<P>, to: &Field<P>, share: f64) -> Vector {
        [0, 1, 2].map(|i| from.B[i] * (1.0 - share) + to.B[i] * share)
    }

    fn given(&self) -> &Given<N> {
        &self.given
    }

    #[inline(always)]
    fn parts(&self, z: &[f64; N]) -> FieldParts<P> {
        const { assert!(N == field_unknowns(P), "N unknowns of P outputs") };
        let J = inertia(&z[INERTIA..MAGNETIC]);
        let mut r = [0.0; P];
        r.copy_from_slice(&z[OFFSET..OFFSET + P]);
        FieldParts {
            J,
            Ji: inverse(&J),
            M: symmetric(&z[MAGNETIC..DRAG_CUBIC]),
            kappa: self.scale * libm::exp(z[GAIN]),
            r,
            drag: self.given.of_cubic(z[DRAG_CUBIC]),
            seen: self.given.of_cubic(z[OFFSET + P]),
        }
    }

    /// J ω̇ = g D ω - ω × J ω,  D ω = B × M (B × ω),  g = 1 + γ |ω|²/W²
    #[inline(always)]
    fn rate(&self, c: &FieldParts<P>, B: &Vector, w: &Vector) -> Vector {
        let g = 1.0 + c.drag * dot(w, w);
        let drag = cross(B, &times(&c.M, &cross(B, w)));
        let gyro = cross(w, &times(&c.J, w));
        times(&c.Ji, &[0, 1, 2].map(|i| g * drag[i] - gyro[i]))
    }

    #[inline(always)]
    fn slope(&self, c: &FieldParts<P>, B: &Vector, w: &Vector, slopes: &mut Slopes) -> Vector {
        let (h, n2, u) = (times(&c.J, w), dot(w, w), cross(B, w));
        let (g, drag, gyro) = (1.0 + c.drag * n2, cross(B, &times(&c.M, &u)), cross(w, &h));
        let f = times(&c.Ji, &[0, 1, 2].map(|i| g * drag[i] - gyro[i]));
        let mut put = |k: usize, column: Vector| {
            let column = times(&c.Ji, &column);
            (0..3).for_each(|i| slopes[i][k] = column[i]);
        };
        // J ∂f/∂ω = g D + 2 γ/W² D ω ωᵀ - ([ω] J - [J ω])
        for k in 0..3 {
            let mut unit = [0.0; 3];
            unit[k] = 1.0;
            let own = cross(B, &times(&c.M, &cross(B, &unit)));
            let (moved, turned) = (cross(w, &[0, 1, 2].map(|i| c.J[i][k])), cross(&unit, &h));
            let cubic = 2.0 * c.drag * w[k];
            put(k, [0, 1, 2].map(|i| g * own[i] + cubic * drag[i] - moved[i] - turned[i]));
        }
        // J ∂f/∂j_k = -ω × E_k ω - E_k f
        let (of_w, of_f) = (along_basis(w), along_basis(&f));
        for k in 0..5 {
            let gyro = cross(w, &of_w[k]);
            put(INERTIA + k, [0, 1, 2].map(|i| -gyro[i] - of_f[k][i]));
        }
        // J ∂f/∂M_ab = g B × S_ab (B × ω)
        for (k, of_u) in along_entries(&u).iter().enumerate() {
            put(MAGNETIC + k, cross(B, of_u).map(|v| g * v));
        }
        let cubic = self.given.of_cubic(n2);
        put(DRAG_CUBIC, drag.map(|v| v * cubic));
        slopes.iter_mut().for_each(|row| row[DRAG_CUBIC + 1..MOVING].fill(0.0));
        f
    }

    /// y = -g κ K M (B × ω) + r
    #[inline(always)]
    fn output(&self, c: &FieldParts<P>, known: &Field<P>, w: &Vector) -> [f64; P] {
        let g = 1.0 + c.seen * dot(w, w);
        let moment = times(&c.M, &cross(&known.B, w));
        let mut y = c.r;
        y.iter_mut().zip(&known.K).for_each(|(y, K)| *y -= g * c.kappa * dot(K, &moment));
        y
    }

    #[inline(always)]
    fn rows(&self, c: &FieldParts<P>, known: &Field<P>, w: &Vector) -> [[Entry; SEEN]; P] {
        let (u, n2) = (cross(&known.B, w), dot(w, w));
        let (g, cubic) = (1.0 + c.seen * n2, self.given.of_cubic(n2));
        let (of_u, moment) = (along_entries(&u), times(&c.M, &u));
        let mut rows = [[(0, 0.0); SEEN]; P];
        for (i, (row, K)) in rows.iter_mut().zip(&known.K).enumerate() {
            let along = -c.kappa * dot(K, &moment);
            let of_w = cross(&times(&c.M, K), &known.B);
            for k in 0..3 {
                row[k] = (k, -g * c.kappa * of_w[k] + 2.0 * c.seen * along * w[k]);
            }
            for k in 0..6 {
                row[3 + k] = (MAGNETIC + k, -g * c.kappa * dot(K, &of_u[k]));
            }
            row[9] = (GAIN, g * along);
            row[10] = (OFFSET + i, 1.0);
            row[11] = (OFFSET + P, along * cubic);
        }
        rows
    }
}

impl<const P: usize, const N: usize> Family<P, N> for FieldBody<P, N> {
    const OFFSETS: usize = OFFSET;

    fn sized(_: usize) -> impl Iterator<Item = Range<usize>> {
        core::iter::once(MAGNETIC..DRAG_CUBIC)
    }

    fn given_mut(&mut self) -> &mut Given<N> {
        &mut self.given
    }

    fn rebased(&self, z: &[f64; N]) -> (Self, [f64; N]) {
        (*self, *z)
    }

    fn frame(&self) -> [f64; 9] {
        let mut frame = [0.0; 9];
        frame[0] = self.scale;
        frame
    }

    fn in_frame(&self, frame: &[f64; 9]) -> Self {
        FieldBody { scale: frame[0], ..*self }
    }

    /// None stays so where the field moves.
    fn unseen(&self, _: &[f64; N]) -> Option<Vector> {
        None
    }

    /// B as it would go on, linearly; K stays.
    fn ahead(before: &Field<P>, last: &Field<P>) -> Field<P> {
        Field { B: [0, 1, 2].map(|i| 2.0 * last.B[i] - before.B[i]), K: last.K }
    }
}
