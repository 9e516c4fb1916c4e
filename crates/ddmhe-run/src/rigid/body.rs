//! The rigid body: its parameters, and what they determine.

use crate::panels::Root;
use crate::rigid::layout::{DRAG, DRAG_CUBIC, GAIN, INERTIA, TILT, offset, output_cubic, unknowns};
use crate::rigid::motion::{Entry, Family, Given, MOVING, Motion, Slopes};
use crate::rigid::small::{Matrix, Vector, along_basis, cross, dot, inertia, inverse, times};
use core::ops::Range;

/// Unknowns that one output depends on.
const SEEN: usize = 9;

/// A body with P outputs and N = [`unknowns`]`(P)` unknowns, in coordinates about a first guess of
/// its unseen direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body<const P: usize, const N: usize> {
    /// First guess of the unseen direction, of length 1.
    pub b0: Vector,
    /// N0 (3 × 2): orthonormal, N0ᵀ b0 = 0.
    pub N0: [[f64; 2]; 3],
    /// What its fits are told.
    pub given: Given<N>,
}

/// What the unknowns determine.
#[derive(Debug, Clone, Copy)]
pub struct BodyParts<const P: usize> {
    J: Matrix,
    Ji: Matrix,
    N: [[f64; 2]; 3],
    NS: [[f64; 2]; 3], // N S
    S: [f64; 3],
    G: [[f64; 2]; P],
    L: Matrix, // J⁻¹ D, D = -N S Nᵀ
    C: [Vector; P],
    r: [f64; P],
    drag: f64, // γ / W² of the drag
    seen: f64, // of the output
}

impl<const P: usize, const N: usize> Body<P, N> {
    /// b = b0 + N0 β.
    fn along(&self, z: &[f64; N]) -> Vector {
        [0, 1, 2].map(|i| self.b0[i] + self.N0[i][0] * z[TILT] + self.N0[i][1] * z[TILT + 1])
    }

    /// N = N0 - b0 βᵀ.
    #[inline(always)]
    fn seen_plane(&self, z: &[f64; N]) -> [[f64; 2]; 3] {
        [0, 1, 2].map(|i| [0, 1].map(|k| self.N0[i][k] - self.b0[i] * z[TILT + k]))
    }
}

/// N = Q U, Q orthonormal and U upper triangular (Gram and Schmidt).
fn orthonormal(plane: &[[f64; 2]; 3]) -> ([[f64; 2]; 3], [[f64; 2]; 2]) {
    let (a, c) = ([0, 1, 2].map(|i| plane[i][0]), [0, 1, 2].map(|i| plane[i][1]));
    let first = dot(&a, &a).root();
    let a = a.map(|v| v / first);
    let along = dot(&a, &c);
    let c = [0, 1, 2].map(|i| c[i] - along * a[i]);
    let second = dot(&c, &c).root();
    ([0, 1, 2].map(|i| [a[i], c[i] / second]), [[first, along], [0.0, second]])
}

/// A B of order two.
fn product(A: &[[f64; 2]; 2], B: &[[f64; 2]; 2]) -> [[f64; 2]; 2] {
    [0, 1].map(|i| [0, 1].map(|k| A[i][0] * B[0][k] + A[i][1] * B[1][k]))
}

impl<const P: usize, const N: usize> Motion<P, N> for Body<P, N> {
    type Parts = BodyParts<P>;
    type Known = ();
    type Drive = ();
    type Row = [Entry; SEEN];

    const EVERYWHERE: &'static [()] = &[(); usize::MAX];

    #[inline(always)]
    fn between((): &(), (): &(), _: f64) {}

    fn given(&self) -> &Given<N> {
        &self.given
    }

    #[inline(always)]
    fn parts(&self, z: &[f64; N]) -> BodyParts<P> {
        const { assert!(N == unknowns(P), "N unknowns of P outputs") };
        let J = inertia(&z[INERTIA..TILT]);
        let Ji = inverse(&J);
        let plane = self.seen_plane(z);
        let S = [z[DRAG], z[DRAG + 1], z[DRAG + 2]];
        let NS = plane.map(|n| [n[0] * S[0] + n[1] * S[1], n[0] * S[1] + n[1] * S[2]]);
        let D: Matrix = NS.map(|s| [0, 1, 2].map(|k| -(s[0] * plane[k][0] + s[1] * plane[k][1])));
        let L = Ji.map(|i| [0, 1, 2].map(|k| i[0] * D[0][k] + i[1] * D[1][k] + i[2] * D[2][k]));
        let mut G = [[0.0; 2]; P];
        (0..P).for_each(|i| G[i] = [z[GAIN + 2 * i], z[GAIN + 2 * i + 1]]);
        let C = G.map(|g| plane.map(|n| g[0] * n[0] + g[1] * n[1]));
        let mut r = [0.0; P];
        r.copy_from_slice(&z[offset(P)..offset(P) + P]);
        let gamma = |i: usize| self.given.of_cubic(z[i]);
        let (drag, seen) = (gamma(DRAG_CUBIC), gamma(output_cubic(P)));
        BodyParts { J, Ji, N: plane, NS, S, G, L, C, r, drag, seen }
    }

    /// J ω̇ = g D ω - ω × J ω,  g = 1 + γ |ω|²/W²
    #[inline(always)]
    fn rate(&self, c: &BodyParts<P>, (): &(), w: &Vector) -> Vector {
        let g = 1.0 + c.drag * dot(w, w);
        let (drag, gyro) = (times(&c.L, w), times(&c.Ji, &cross(w, &times(&c.J, w))));
        [0, 1, 2].map(|i| g * drag[i] - gyro[i])
    }

    #[inline(always)]
    fn slope(&self, c: &BodyParts<P>, (): &(), w: &Vector, slopes: &mut Slopes) -> Vector {
        let (h, drag, n2) = (times(&c.J, w), times(&c.L, w), dot(w, w));
        let (g, gyro) = (1.0 + c.drag * n2, times(&c.Ji, &cross(w, &h)));
        let f = [0, 1, 2].map(|i| g * drag[i] - gyro[i]);
        let mut put = |k: usize, column: Vector| (0..3).for_each(|i| slopes[i][k] = column[i]);
        // ∂f/∂ω = g L + 2 γ/W² L ω ωᵀ - J⁻¹ ([ω] J - [J ω])
        for k in 0..3 {
            let mut unit = [0.0; 3];
            unit[k] = 1.0;
            let (moved, own) = (cross(w, &[0, 1, 2].map(|i| c.J[i][k])), cross(&unit, &h));
            let gyro = times(&c.Ji, &[0, 1, 2].map(|i| moved[i] + own[i]));
            let cubic = 2.0 * c.drag * w[k];
            put(k, [0, 1, 2].map(|i| g * c.L[i][k] + cubic * drag[i] - gyro[i]));
        }
        // ∂f/∂j_k = J⁻¹ (-ω × E_k ω - E_k f)
        let (of_w, of_f) = (along_basis(w), along_basis(&f));
        for k in 0..5 {
            let gyro = cross(w, &of_w[k]);
            put(INERTIA + k, times(&c.Ji, &[0, 1, 2].map(|i| -gyro[i] - of_f[k][i])));
        }
        // ∂f/∂θ_D = g J⁻¹ (∂D/∂θ) ω, D = -N S Nᵀ
        let n = &c.N;
        let v = [0, 1].map(|k| n[0][k] * w[0] + n[1][k] * w[1] + n[2][k] * w[2]);
        let s = [c.S[0] * v[0] + c.S[1] * v[1], c.S[1] * v[0] + c.S[2] * v[1]];
        let bw = dot(&self.b0, w);
        for (k, s) in s.iter().enumerate() {
            let column = [0, 1, 2].map(|i| g * (self.b0[i] * s + c.NS[i][k] * bw));
            put(TILT + k, times(&c.Ji, &column));
        }
        put(DRAG, times(&c.Ji, &[0, 1, 2].map(|i| -g * n[i][0] * v[0])));
        put(DRAG + 1, times(&c.Ji, &[0, 1, 2].map(|i| -g * (n[i][0] * v[1] + n[i][1] * v[0]))));
        put(DRAG + 2, times(&c.Ji, &[0, 1, 2].map(|i| -g * n[i][1] * v[1])));
        let cubic = self.given.of_cubic(n2);
        put(DRAG_CUBIC, drag.map(|v| v * cubic));
        slopes.iter_mut().for_each(|row| row[DRAG_CUBIC + 1..MOVING].fill(0.0));
        f
    }

    /// y = g G Nᵀ ω + r
    #[inline(always)]
    fn output(&self, c: &BodyParts<P>, (): &(), w: &Vector) -> [f64; P] {
        let g = 1.0 + c.seen * dot(w, w);
        let mut y = c.r;
        y.iter_mut().zip(&c.C).for_each(|(y, row)| *y += g * dot(row, w));
        y
    }

    #[inline(always)]
    fn rows(&self, c: &BodyParts<P>, (): &(), w: &Vector) -> [[Entry; SEEN]; P] {
        let (n, n2) = (&c.N, dot(w, w));
        let g = 1.0 + c.seen * n2;
        let v = [0, 1].map(|k| n[0][k] * w[0] + n[1][k] * w[1] + n[2][k] * w[2]);
        let bw = dot(&self.b0, w);
        let cubic = self.given.of_cubic(n2);
        let mut rows = [[(0, 0.0); SEEN]; P];
        for (i, row) in rows.iter_mut().enumerate() {
            let along = dot(&c.C[i], w);
            for k in 0..3 {
                row[k] = (k, g * c.C[i][k] + 2.0 * c.seen * along * w[k]);
            }
            for k in 0..2 {
                row[3 + k] = (TILT + k, -g * c.G[i][k] * bw);
                row[5 + k] = (GAIN + 2 * i + k, g * v[k]);
            }
            row[7] = (offset(P) + i, 1.0);
            row[8] = (output_cubic(P), along * cubic);
        }
        rows
    }
}

impl<const P: usize, const N: usize> Family<P, N> for Body<P, N> {
    const OFFSETS: usize = offset(P);

    fn sized(p: usize) -> impl Iterator<Item = Range<usize>> {
        [DRAG..DRAG_CUBIC, GAIN..GAIN + 2 * p].into_iter()
    }

    fn given_mut(&mut self) -> &mut Given<N> {
        &mut self.given
    }

    /// The same body about its own unseen direction, β = 0: with N = N0' U by QR, S and G become
    /// U S Uᵀ and G Uᵀ. The prior on the direction is then flat on the sphere.
    fn rebased(&self, z: &[f64; N]) -> (Self, [f64; N]) {
        let (mut body, mut moved) = (*self, *z);
        let b = self.along(z);
        let length = dot(&b, &b).root();
        body.b0 = b.map(|v| v / length);
        let (plane, U) = orthonormal(&self.seen_plane(z));
        body.N0 = plane;
        let S = [[z[DRAG], z[DRAG + 1]], [z[DRAG + 1], z[DRAG + 2]]];
        let US = product(&U, &S);
        let entry = |i: usize, k: usize| US[i][0] * U[k][0] + US[i][1] * U[k][1];
        moved[TILT..DRAG_CUBIC].copy_from_slice(&[0.0, 0.0, entry(0, 0), entry(0, 1), entry(1, 1)]);
        for i in 0..P {
            let G = [z[GAIN + 2 * i], z[GAIN + 2 * i + 1]];
            (0..2).for_each(|k| moved[GAIN + 2 * i + k] = G[0] * U[k][0] + G[1] * U[k][1]);
        }
        (body, moved)
    }

    fn frame(&self) -> [f64; 9] {
        let mut frame = [0.0; 9];
        frame[..3].copy_from_slice(&self.b0);
        frame[3..].copy_from_slice(self.N0.as_flattened());
        frame
    }

    fn in_frame(&self, frame: &[f64; 9]) -> Self {
        let mut body = *self;
        body.b0.copy_from_slice(&frame[..3]);
        body.N0.as_flattened_mut().copy_from_slice(&frame[3..]);
        body
    }

    fn unseen(&self, z: &[f64; N]) -> Option<Vector> {
        let b = self.along(z);
        let length = dot(&b, &b).root();
        Some(b.map(|v| v / length))
    }
    fn ahead((): &(), (): &()) {}
}
