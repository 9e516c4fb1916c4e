//! From a trajectory space and the weights to the least-distance form of one depth: z* = K f, w = c
//! + A z.
//!
//! See [`ddmhe_run`] for the derivation. Rows of the window are interleaved here as in
//! [`space`](crate::space): x(0), y(0), …, x(m-1), y(m-1), x(m).

use crate::error::Error;
use crate::space::TrajectorySpace;
use crate::tol;
use crate::weights::{Blocks, Weights};
use ddmhe_run::layout::Layout;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::householder::{
    apply_block_householder_sequence_on_the_left_in_place_scratch,
    apply_block_householder_sequence_on_the_left_in_place_with_conj,
};
use faer::linalg::solvers::{Qr, SvdError};
use faer::{Conj, Mat, MatRef, Par};

/// The least-distance form, in scaled units.
pub(crate) struct Reduced {
    /// r × (n + m p): z* = K ([x̄; y] - c).
    pub K: Mat<f64>,
    /// d × r: w = c + A z.
    pub A: Mat<f64>,
    /// m n × r: ŵ = A_w z, if a disturbance is fitted.
    pub A_w: Option<Mat<f64>>,
    /// r × m p: z_c = K_c (y - c_y) of the window x_c(t) of the experiment IV-A1, if it is asked
    /// for.
    pub K_c: Option<Mat<f64>>,
    /// r × q: orthonormal basis of the z that the cost does not see, if there are any and no weight
    /// on ‖α‖² decides.
    pub unseen: Option<Mat<f64>>,
}

/// Factors the problem of one depth. `measured` (m·p, time-major) says which outputs exist; None:
/// all of them.
pub(crate) fn reduce(
    layout: Layout,
    space: &TrajectorySpace,
    weights: &Weights,
    centered: bool,
    measured: Option<&[bool]>,
) -> Result<Reduced, SvdError> {
    let all = vec![true; layout.depth * layout.p];
    let measured = measured.unwrap_or(&all);
    let (blocks, stacked) = stacked(layout, space, weights, measured)?;
    let (n, r, seen) = (layout.n, space.rank(), layout.seen().collect::<Vec<_>>());
    let driven = space.driven.as_ref();
    let qr = stacked.qr();
    let (Q, R) = (qr.compute_thin_Q(), qr.thin_R());
    let mut K = Mat::zeros(r, seen.len());
    for (first, W) in &blocks {
        K.subcols_mut(*first, W.nrows()).copy_from(Q.subrows(*first, W.nrows()).transpose() * W);
    }
    // A = B R⁻¹, from Rᵀ Aᵀ = Bᵀ
    let by_z = |B: &Mat<f64>| {
        let mut A_t = B.transpose().to_owned();
        R.transpose().solve_lower_triangular_in_place(A_t.as_mut());
        A_t.transpose().to_owned()
    };
    let K_c = match centered {
        true => Some(R * center_gain(space, &seen[n..], weights, |i| measured[i])?),
        false => None,
    };
    // Q_F Q_Gᵀ = 0: the kernel of F alone reaches whatever G b is to be
    let first = seen.len() + driven.map_or(0, |driven| driven.coordinates);
    let rest = stacked.nrows() - first;
    let surplus = space.lambda == 0.0 && rest > 0;
    let unseen = surplus.then(|| Q.subrows(first, rest).transpose().to_owned());
    Ok(Reduced {
        K,
        A: by_z(&space.basis),
        A_w: driven.map(|driven| by_z(&driven.rows)),
        K_c,
        unseen,
    })
}

/// Gᵀ of x̂(t) = c_x + G ([x̄; y] - c), (n + m p) × n: the last rows of A K.
pub(crate) fn gain(
    layout: Layout,
    space: &TrajectorySpace,
    weights: &Weights,
) -> Result<Mat<f64>, SvdError> {
    let (blocks, stacked) = stacked(layout, space, weights, &vec![true; layout.depth * layout.p])?;
    let (last, seen) = (layout.x(layout.depth).start, layout.n + layout.depth * layout.p);
    let qr = stacked.qr();
    // with [F; G] = Q R, (A K)ᵀ is the weights' Wᵀ times the rows of F in Q R⁻ᵀ Bᵀ
    let mut z = space.basis.subrows(last, layout.n).transpose().to_owned();
    qr.thin_R().transpose().solve_lower_triangular_in_place(z.as_mut());
    let found = rotated(&qr, z.as_ref());
    let mut gain = Mat::zeros(seen, layout.n);
    for (first, W) in &blocks {
        gain.subrows_mut(*first, W.nrows())
            .copy_from(W.transpose() * found.subrows(*first, W.nrows()));
    }
    Ok(gain)
}

/// Q [z; 0] by the reflections whose product Q is, without forming it.
fn rotated(qr: &Qr<f64>, z: MatRef<'_, f64>) -> Mat<f64> {
    let (basis, coefficients) = (qr.Q_basis(), qr.Q_coeff());
    let mut found = Mat::zeros(basis.nrows(), z.ncols());
    found.subrows_mut(0, z.nrows()).copy_from(z);
    let room = apply_block_householder_sequence_on_the_left_in_place_scratch::<f64>(
        basis.nrows(),
        coefficients.nrows(),
        z.ncols(),
    );
    apply_block_householder_sequence_on_the_left_in_place_with_conj(
        basis,
        coefficients,
        Conj::No,
        found.as_mut(),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(room)),
    );
    found
}

/// The weights, and [F; G]: the weighted rows of the basis that the cost sees, and what makes the
/// minimiser unique.
fn stacked(
    layout: Layout,
    space: &TrajectorySpace,
    weights: &Weights,
    measured: &[bool],
) -> Result<(Blocks, Mat<f64>), SvdError> {
    let blocks = weights.blocks(layout, measured); // (17)
    let seen: Vec<usize> = layout.seen().collect();
    let r = space.rank();
    // (16b): the window is c + B b, and the cost sees these rows of it
    let basis = Mat::from_fn(seen.len(), r, |i, j| space.basis[(seen[i], j)]);
    let mut F = Mat::zeros(seen.len(), r);
    for (first, W) in &blocks {
        F.subrows_mut(*first, W.nrows()).copy_from(W * basis.subrows(*first, W.nrows()));
    }
    let own = space.undisturbed();
    let G = if space.lambda > 0.0 {
        Mat::from_fn(own, own, |i, j| if i == j { space.lambda.sqrt() } else { 0.0 })
    } else {
        // with the disturbance at 0, which its own cost asks for
        least_norm(F.subcols(0, own), space)?
    };
    let mut stacked = Mat::zeros(F.nrows() + (r - own) + G.nrows(), r);
    stacked.subrows_mut(0, F.nrows()).copy_from(&F);
    if let Some(driven) = &space.driven {
        let price = weights.price(&driven.variances).sqrt();
        (own..r).for_each(|j| stacked[(F.nrows() + j - own, j)] = price);
    }
    let first = F.nrows() + (r - own);
    stacked.submatrix_mut(first, 0, G.nrows(), own).copy_from(&G);
    Ok((blocks, stacked))
}

/// Rows that single out the least-norm α among the minimisers when F does not determine b.
///
/// With Z a basis of the kernel of F and D = S/√N (b = D a), the shortest a satisfies Eᵀa = 0 for E
/// an orthonormal basis of D⁻¹Z. Minimising ‖F b‖ and Eᵀ D⁻¹ b do not compete (the kernel
/// directions alone can satisfy the second), so a small weight on the latter leaves the minimisers
/// of (17) untouched and makes them unique.
fn least_norm(F: MatRef<'_, f64>, space: &TrajectorySpace) -> Result<Mat<f64>, SvdError> {
    let r = F.ncols();
    let svd = F.svd()?;
    let sigma: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let sigma_1 = sigma.first().copied().unwrap_or(0.0);
    let floor = tol::RANK_EPS * F.nrows().max(r) as f64 * sigma_1;
    let rank = sigma.iter().filter(|&&s| s > floor).count();
    if rank == r {
        return Ok(Mat::zeros(0, r));
    }
    let inverse_length = |i: usize| (space.windows as f64).sqrt() / space.singular_values[i];
    let V = svd.V();
    let DZ = Mat::from_fn(r, r - rank, |i, j| inverse_length(i) * V[(i, rank + j)]);
    let E = DZ.qr().compute_thin_Q();
    let mut G = Mat::from_fn(r - rank, r, |i, j| E[(j, i)] * inverse_length(j));
    let scale = tol::LEAST_NORM.sqrt() * sigma_1.max(f64::MIN_POSITIVE) / G.norm_max();
    G *= faer::Scale(scale);
    Ok(G)
}

/// K_c with b = K_c (y - c_y): H_x H_y† of IV-A1 in affine form. The least-norm α whose outputs fit
/// best; with a regularised space, its weight relative to the outputs' (λ/μ) instead of the
/// pseudo-inverse's cut at rounding.
fn center_gain(
    space: &TrajectorySpace,
    y_rows: &[usize],
    weights: &Weights,
    measured: impl Fn(usize) -> bool,
) -> Result<Mat<f64>, SvdError> {
    let r = space.undisturbed();
    let length = |j: usize| {
        if space.lambda > 0.0 {
            1.0
        } else {
            space.singular_values[j] / (space.windows as f64).sqrt()
        }
    };
    let alike = |i: usize| if measured(i) { weights.alike[i % weights.alike.len()] } else { 0.0 };
    let Y =
        Mat::from_fn(y_rows.len(), r, |i, j| space.basis[(y_rows[i], j)] * length(j) * alike(i));
    let svd = Y.thin_svd()?;
    let sigma = svd.S().column_vector();
    let k = sigma.nrows();
    let floor = if k > 0 { tol::RANK_EPS * r.max(y_rows.len()) as f64 * sigma[0] } else { 0.0 };
    let filter = |s: f64| if s > floor { s / (s * s + space.lambda / weights.mu()) } else { 0.0 };
    let (U, V) = (svd.U(), svd.V());
    let right = Mat::from_fn(r, k, |i, j| length(i) * V[(i, j)] * filter(sigma[j]));
    let K = right * U.transpose();
    let disturbed = |i: usize| i >= r; // by nothing, as the recording has it
    let entry = |i: usize, j: usize| if disturbed(i) { 0.0 } else { K[(i, j)] * alike(j) };
    Ok(Mat::from_fn(space.rank(), y_rows.len(), entry))
}

/// A problem that cannot be factored, in words.
pub(crate) fn factorisation(_: SvdError) -> Error {
    Error::rank(
        "history",
        "data whose singular values can be computed",
        "data on which the decomposition does not converge",
    )
}
