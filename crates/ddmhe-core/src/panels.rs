//! Products of prepared matrices with vectors, at the speed of the machine's vector units.
//!
//! A [`Panels`] holds a matrix in panels of eight rows, column after column, so that a product
//! reads memory once, in order, with the eight sums in registers. Every sum is taken in an order
//! that the layout alone fixes and without fused multiplications: the numbers are the same on every
//! machine, whichever vector units [`vectorised`] finds.

use faer::MatRef;

/// Rows of a panel.
pub(crate) const WIDTH: usize = 8;

/// One column of a panel, on a cache line of its own.
#[derive(Clone, Copy)]
#[repr(align(64))]
struct Column([f64; WIDTH]);

/// A matrix for products M x; vectors over its rows are padded to whole panels.
pub(crate) struct Panels {
    columns: usize,
    data: Vec<Column>,
}

/// `len` rounded up to whole panels.
pub(crate) fn padded(len: usize) -> usize {
    len.next_multiple_of(WIDTH)
}

/// Runs `f` compiled for the best vector units of this machine; what is to profit must be inlined
/// into it.
#[inline(always)]
pub(crate) fn vectorised<R>(f: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(f)
}

impl Panels {
    pub fn new(M: MatRef<'_, f64>) -> Self {
        let columns = M.ncols().max(1);
        let panels = padded(M.nrows()) / WIDTH;
        let mut data = vec![Column([0.0; WIDTH]); panels * columns];
        for j in 0..M.ncols() {
            for i in 0..M.nrows() {
                data[i / WIDTH * columns + j].0[i % WIDTH] = M[(i, j)];
            }
        }
        Panels { columns, data }
    }

    /// out = start + M x, for many rows and few columns: one running sum a row.
    #[inline(always)]
    pub fn tall(&self, start: &[f64], x: &[f64], out: &mut [f64]) {
        let start = start.as_chunks::<WIDTH>().0;
        let panels = self.data.chunks_exact(self.columns);
        for ((panel, start), out) in panels.zip(start).zip(out.as_chunks_mut::<WIDTH>().0) {
            *out = product::<1>(*start, panel, x);
        }
    }

    /// out = start + M [x; y], for few rows and many columns: four running sums a row, which need
    /// not wait for each other.
    #[inline(always)]
    pub fn wide(&self, start: &[f64], x: &[f64], y: &[f64], out: &mut [f64]) {
        let start = start.as_chunks::<WIDTH>().0;
        let panels = self.data.chunks_exact(self.columns);
        for ((panel, start), out) in panels.zip(start).zip(out.as_chunks_mut::<WIDTH>().0) {
            let (first, rest) = panel.split_at(x.len());
            *out = product::<4>(product::<1>(*start, first, x), rest, y);
        }
    }
}

/// start + Σ_j column_j x_j, in SUMS interleaved sums.
#[inline(always)]
fn product<const SUMS: usize>(start: [f64; WIDTH], columns: &[Column], x: &[f64]) -> [f64; WIDTH] {
    let mut sums = [[0.0; WIDTH]; SUMS];
    sums[0] = start;
    let (columns, x) = (columns.as_chunks::<SUMS>(), x.as_chunks::<SUMS>());
    for (columns, x) in columns.0.iter().zip(x.0) {
        for ((sum, column), x) in sums.iter_mut().zip(columns).zip(x) {
            add(sum, column, *x);
        }
    }
    for (column, x) in columns.1.iter().zip(x.1) {
        add(&mut sums[0], column, *x);
    }
    let [first, others @ ..] = &sums[..] else { return start };
    others.iter().fold(*first, |all, sum| each(all, *sum, |a, b| a + b))
}

#[inline(always)]
fn add(sum: &mut [f64; WIDTH], column: &Column, x: f64) {
    // products first, all eight: they stay whole vectors wherever this is inlined
    *sum = each(*sum, each(column.0, [x; WIDTH], |value, x| value * x), |sum, part| sum + part);
}

/// aᵀb of equally long vectors, in four interleaved sums.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    debug_assert_eq!(a.len(), b.len());
    let mut sums = [0.0; 4];
    let (a, b) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    for (a, b) in a.0.iter().zip(b.0) {
        for i in 0..4 {
            sums[i] += a[i] * b[i];
        }
    }
    for (a, b) in a.1.iter().zip(b.1) {
        sums[0] += a * b;
    }
    (sums[0] + sums[2]) + (sums[1] + sums[3])
}

/// y += a x.
#[inline(always)]
pub(crate) fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

/// The smallest distance of a value to its bounds, negative outside of them; infinite if there is
/// none. NaN values (not measured) have no bounds.
#[inline(always)]
pub(crate) fn margin(values: &[f64], lo: &[f64], hi: &[f64]) -> f64 {
    let mut least = [f64::INFINITY; WIDTH];
    let (w, l, h) = (values.as_chunks::<WIDTH>(), lo.as_chunks::<WIDTH>(), hi.as_chunks::<WIDTH>());
    for ((w, l), h) in w.0.iter().zip(l.0).zip(h.0) {
        least = each(each(*w, *l, |w, l| w - l), least, smaller);
        least = each(each(*h, *w, |h, w| h - w), least, smaller);
    }
    // lane after lane: by halves, the loop above would be compiled for half as wide units
    let mut all = least.into_iter().fold(f64::INFINITY, smaller);
    let done = w.0.len() * WIDTH;
    for ((w, l), h) in w.1.iter().zip(&lo[done..]).zip(&hi[done..]) {
        all = smaller(h - w, smaller(w - l, all));
    }
    all
}

/// The smaller one, b if a is NaN.
#[inline(always)]
pub(crate) fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Σ w v².
#[inline(always)]
pub(crate) fn weighted_square(weights: &[f64], v: &[f64]) -> f64 {
    let mut sums = [0.0; WIDTH];
    let (w, v) = (weights.as_chunks::<WIDTH>(), v.as_chunks::<WIDTH>());
    for (w, v) in w.0.iter().zip(v.0) {
        sums = each(sums, each(*w, each(*v, *v, |a, b| a * b), |w, v| w * v), |s, v| s + v);
    }
    for (w, v) in w.1.iter().zip(v.1) {
        sums[0] += w * (v * v);
    }
    halve(sums, |a, b| a + b)
}

// Here and in `axpy` a loop, not `for_each`, which may be compiled on its own, without the vector
// units.
#[inline(always)]
pub(crate) fn each(a: [f64; WIDTH], b: [f64; WIDTH], f: impl Fn(f64, f64) -> f64) -> [f64; WIDTH] {
    let mut out = a;
    for (a, b) in out.iter_mut().zip(b) {
        *a = f(*a, b);
    }
    out
}

/// Eight values to one, by halves.
#[inline(always)]
pub(crate) fn halve(mut x: [f64; WIDTH], join: impl Fn(f64, f64) -> f64) -> f64 {
    for half in [WIDTH / 2, WIDTH / 4, WIDTH / 8] {
        (0..half).for_each(|i| x[i] = join(x[i], x[i + half]));
    }
    x[0]
}
