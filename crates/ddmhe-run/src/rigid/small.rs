//! Vectors and matrices of three, and the basis of inertias.

use core::f64::consts::FRAC_1_SQRT_2 as R2;

/// 1/√6
const R6: f64 = 0.408_248_290_463_863;

/// A vector of three.
pub type Vector = [f64; 3];
/// A matrix of three rows.
pub type Matrix = [[f64; 3]; 3];

/// aᵀb
#[inline(always)]
pub fn dot(a: &Vector, b: &Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// A x
#[inline(always)]
pub fn times(A: &Matrix, x: &Vector) -> Vector {
    [dot(&A[0], x), dot(&A[1], x), dot(&A[2], x)]
}

/// a × b
#[inline(always)]
pub fn cross(a: &Vector, b: &Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A⁻¹ of a symmetric matrix.
#[inline(always)]
pub fn inverse(A: &Matrix) -> Matrix {
    let (c0, c1, c2) = (cross(&A[1], &A[2]), cross(&A[2], &A[0]), cross(&A[0], &A[1]));
    let of = 1.0 / dot(&A[0], &c0);
    [0, 1, 2].map(|i| [c0[i] * of, c1[i] * of, c2[i] * of])
}

/// J = I + Σ j_k E_k, E_k orthonormal, symmetric and without trace.
#[inline(always)]
pub fn inertia(j: &[f64]) -> Matrix {
    let (xy, xz, yz) = (R2 * j[2], R2 * j[3], R2 * j[4]);
    let (a, b) = (R2 * j[0], R6 * j[1]);
    [[1.0 + a + b, xy, xz], [xy, 1.0 - a + b, yz], [xz, yz, 1.0 - 2.0 * b]]
}

/// E_k x of all five k.
#[inline(always)]
pub fn along_basis(x: &Vector) -> [Vector; 5] {
    let [a, b, c] = *x;
    [
        [R2 * a, -R2 * b, 0.0],
        [R6 * a, R6 * b, -2.0 * R6 * c],
        [R2 * b, R2 * a, 0.0],
        [R2 * c, 0.0, R2 * a],
        [0.0, R2 * c, R2 * b],
    ]
}
