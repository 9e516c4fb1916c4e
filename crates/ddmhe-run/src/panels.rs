//! Products of prepared matrices with vectors, at the speed of the machine's vector units.
//!
//! A matrix lies in panels of eight rows, column after column ([`Panels`]), so that a product reads
//! memory once, in order, with the eight sums in registers. Every sum is taken in an order that the
//! layout alone fixes and without fused multiplications: the numbers are the same on every machine,
//! whichever vector units it has. What is to use them must be inlined into a function that is
//! compiled for them.

/// Rows of a panel.
pub const WIDTH: usize = 8;

/// One column of a panel.
pub type Column = [f64; WIDTH];

/// A matrix for products M x; vectors over its rows are padded to whole panels.
#[derive(Debug, Clone, Copy)]
pub struct Panels<'a> {
    columns: usize,
    data: &'a [Column],
}

/// A product of one panel that grows part by part.
#[derive(Debug)]
pub struct RunningSum<'a> {
    columns: &'a [Column],
    sum: [f64; WIDTH],
}

impl RunningSum<'_> {
    /// The next entries of x.
    #[inline(always)]
    pub fn add(&mut self, x: &[f64]) {
        let (columns, rest) = self.columns.split_at(x.len());
        self.sum = running(self.sum, columns, x);
        self.columns = rest;
    }

    /// As many entries that are 0.
    #[inline(always)]
    pub fn skip(&mut self, entries: usize) {
        self.columns = &self.columns[entries..];
    }
}

/// `len` rounded up to whole panels.
#[inline(always)]
pub const fn padded(len: usize) -> usize {
    len.next_multiple_of(WIDTH)
}

/// √x, correctly rounded, with or without the standard library.
pub(crate) trait Root {
    fn root(self) -> f64;
}

impl Root for f64 {
    #[inline(always)]
    fn root(self) -> f64 {
        #[cfg(feature = "std")]
        return self.sqrt();
        #[cfg(not(feature = "std"))]
        libm::sqrt(self)
    }
}

/// Numbers that a matrix takes in panels.
pub const fn panels_len(rows: usize, columns: usize) -> usize {
    padded(rows) * if columns > 0 { columns } else { 1 }
}

/// Writes a matrix in panels, from its entries.
pub fn write_panels(
    (rows, columns): (usize, usize),
    entry: impl Fn(usize, usize) -> f64,
    out: &mut [f64],
) {
    for i in 0..rows {
        (0..columns).for_each(|j| out[place(columns, i, j)] = entry(i, j));
    }
}

fn place(columns: usize, i: usize, j: usize) -> usize {
    (i / WIDTH * columns + j) * WIDTH + i % WIDTH
}

impl<'a> Panels<'a> {
    /// What [`write_panels`] wrote.
    #[inline(always)]
    pub fn new(columns: usize, data: &'a [f64]) -> Self {
        Panels { columns: if columns > 0 { columns } else { 1 }, data: data.as_chunks().0 }
    }

    /// out = start + M x, for many rows and few columns: one running sum a row. Where they are very
    /// few x stays in registers, and a panel has no loop of its own.
    #[inline(always)]
    pub fn tall(self, start: &[f64], x: &[f64], out: &mut [f64]) {
        match x.len() {
            1 => self.narrow::<1>(start, x, out),
            2 => self.narrow::<2>(start, x, out),
            3 => self.narrow::<3>(start, x, out),
            4 => self.narrow::<4>(start, x, out),
            5 => self.narrow::<5>(start, x, out),
            6 => self.narrow::<6>(start, x, out),
            _ => self.broad(start, x, out),
        }
    }

    /// The same of so many columns.
    #[inline(always)]
    fn narrow<const COLUMNS: usize>(self, start: &[f64], x: &[f64], out: &mut [f64]) {
        let Some(x) = x.first_chunk::<COLUMNS>() else { return };
        let (start, panels) = (start.as_chunks().0, self.data.as_chunks::<COLUMNS>().0);
        for ((start, panel), out) in start.iter().zip(panels).zip(out.as_chunks_mut().0) {
            let mut sum = *start;
            for (column, x) in panel.iter().zip(x) {
                add(&mut sum, column, *x);
            }
            *out = sum;
        }
    }

    /// The same of any number of columns.
    #[inline(always)]
    fn broad(self, start: &[f64], x: &[f64], out: &mut [f64]) {
        let (start, mut left) = (start.as_chunks::<WIDTH>().0, self.data);
        for (start, out) in start.iter().zip(out.as_chunks_mut::<WIDTH>().0) {
            let Some((panel, others)) = left.split_at_checked(self.columns) else { return };
            *out = running(*start, panel, x);
            left = others;
        }
    }

    /// out = M x for the columns of M from `first` on, where x is told part by part.
    #[inline(always)]
    pub fn sums(self, first: usize, out: &mut [f64], tell: impl Fn(&mut RunningSum<'_>)) {
        let panels = self.data.chunks_exact(self.columns);
        for (panel, out) in panels.zip(out.as_chunks_mut::<WIDTH>().0) {
            let mut sum = RunningSum { columns: &panel[first..], sum: [0.0; WIDTH] };
            tell(&mut sum);
            *out = sum.sum;
        }
    }

    /// out = start + M [x; y], for few rows and many columns: four running sums a row, which need
    /// not wait for each other.
    #[inline(always)]
    pub fn wide(self, start: &[f64], x: &[f64], y: &[f64], out: &mut [f64]) {
        let (start, mut left) = (start.as_chunks::<WIDTH>().0, self.data);
        for (start, out) in start.iter().zip(out.as_chunks_mut::<WIDTH>().0) {
            let Some((first, rest)) = left.split_at_checked(x.len()) else { return };
            let Some((rest, others)) = rest.split_at_checked(y.len()) else { return };
            let mut sum = *start;
            for (column, x) in first.iter().zip(x) {
                add(&mut sum, column, *x);
            }
            *out = product::<4>(sum, rest, y);
            left = others;
        }
    }
}

/// start + Σ_j column_j x_j, in one sum; four columns a turn.
#[inline(always)]
fn running(start: [f64; WIDTH], columns: &[Column], x: &[f64]) -> [f64; WIDTH] {
    let mut sum = start;
    let (columns, x) = (columns.as_chunks::<4>(), x.as_chunks::<4>());
    for (columns, x) in columns.0.iter().zip(x.0) {
        for (column, x) in columns.iter().zip(x) {
            add(&mut sum, column, *x);
        }
    }
    for (column, x) in columns.1.iter().zip(x.1) {
        add(&mut sum, column, *x);
    }
    sum
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

/// sum += column x.
#[inline(always)]
pub(crate) fn add(sum: &mut [f64; WIDTH], column: &Column, x: f64) {
    // products first, all eight: they stay whole vectors wherever this is inlined
    *sum = each(*sum, each(*column, [x; WIDTH], |value, x| value * x), |sum, part| sum + part);
}

/// aᵀb of equally long vectors, in four interleaved sums.
#[inline(always)]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
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

/// ‖a‖², in sixteen interleaved sums: for vectors that are long beside the time of an addition.
#[inline(always)]
pub fn square(a: &[f64]) -> f64 {
    let mut sums = [[0.0; WIDTH]; 2];
    let (pairs, rest) = a.as_chunks::<{ 2 * WIDTH }>();
    for pair in pairs {
        for (sum, a) in sums.iter_mut().zip(pair.as_chunks::<WIDTH>().0) {
            *sum = each(*sum, each(*a, *a, |a, b| a * b), |sum, part| sum + part);
        }
    }
    let [first, second] = sums;
    let all = each(first, second, |a, b| a + b);
    halve(all, |a, b| a + b) + dot(rest, rest)
}

/// y += a x.
#[inline(always)]
pub fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

/// out = a + b, of equally long vectors.
#[inline(always)]
pub fn sum(a: &[f64], b: &[f64], out: &mut [f64]) {
    let (a, b) = (&a[..out.len()], &b[..out.len()]);
    let (a_8, b_8) = (a.as_chunks::<WIDTH>().0, b.as_chunks::<WIDTH>().0);
    let (out_8, rest) = out.as_chunks_mut::<WIDTH>();
    for ((out, a), b) in out_8.iter_mut().zip(a_8).zip(b_8) {
        *out = each(*a, *b, |a, b| a + b);
    }
    if rest.is_empty() {
        return;
    }
    if let (Some(a), Some(b), Some(out)) = (a.last_chunk(), b.last_chunk(), out.last_chunk_mut()) {
        *out = each(*a, *b, |a, b| a + b); // the last eight, some of them once more
        return;
    }
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = a + b;
    }
}

/// out = (a - b) c, entry by entry, of equally long vectors.
#[inline(always)]
pub fn scaled_difference(a: &[f64], b: &[f64], c: &[f64], out: &mut [f64]) {
    let (a, b, c) = (&a[..out.len()], &b[..out.len()], &c[..out.len()]);
    let scaled = |a, b, c| each(each(a, b, |a, b| a - b), c, |d, c| d * c);
    let (a_8, b_8) = (a.as_chunks::<WIDTH>().0, b.as_chunks::<WIDTH>().0);
    let (out_8, rest) = out.as_chunks_mut::<WIDTH>();
    for (((out, a), b), c) in out_8.iter_mut().zip(a_8).zip(b_8).zip(c.as_chunks::<WIDTH>().0) {
        *out = scaled(*a, *b, *c);
    }
    if rest.is_empty() {
        return;
    }
    if let (Some(a), Some(b), Some(c), Some(out)) =
        (a.last_chunk(), b.last_chunk(), c.last_chunk(), out.last_chunk_mut())
    {
        *out = scaled(*a, *b, *c); // the last eight, some of them once more
        return;
    }
    for (((out, a), b), c) in out.iter_mut().zip(a).zip(b).zip(c) {
        *out = (a - b) * c;
    }
}

/// out = a + b c, entry by entry, of equally long vectors.
#[inline(always)]
pub fn scaled_sum(a: &[f64], b: &[f64], c: &[f64], out: &mut [f64]) {
    let (a_8, b_8, c_8) = (a.as_chunks::<WIDTH>(), b.as_chunks::<WIDTH>(), c.as_chunks::<WIDTH>());
    let (out_8, rest) = out.as_chunks_mut::<WIDTH>();
    for (((out, a), b), c) in out_8.iter_mut().zip(a_8.0).zip(b_8.0).zip(c_8.0) {
        *out = each(*a, each(*b, *c, |b, c| b * c), |a, part| a + part);
    }
    for (((out, a), b), c) in rest.iter_mut().zip(a_8.1).zip(b_8.1).zip(c_8.1) {
        *out = a + b * c;
    }
}

/// The smallest distances of values to their bounds, negative outside of them, in eight groups;
/// infinite where there is none. NaN values (not measured) have no bounds.
#[inline(always)]
pub fn margins(values: &[f64], lo: &[f64], hi: &[f64]) -> [f64; WIDTH] {
    let (lo, hi) = (&lo[..values.len()], &hi[..values.len()]);
    let mut all = [f64::INFINITY; WIDTH];
    let (w, l, h) = (values.as_chunks::<WIDTH>(), lo.as_chunks::<WIDTH>(), hi.as_chunks::<WIDTH>());
    for ((w, l), h) in w.0.iter().zip(l.0).zip(h.0) {
        all = nearer(all, *w, *l, *h);
    }
    if w.1.is_empty() {
        return all;
    }
    if let (Some(w), Some(l), Some(h)) = (values.last_chunk(), lo.last_chunk(), hi.last_chunk()) {
        return nearer(all, *w, *l, *h); // the last eight, some of them once more
    }
    for (((all, w), l), h) in all.iter_mut().zip(w.1).zip(l.1).zip(h.1) {
        *all = smaller(smaller(w - l, h - w), *all);
    }
    all
}

/// The smallest distances to two bounds so far.
#[inline(always)]
pub(crate) fn nearer(least: Column, w: Column, lo: Column, hi: Column) -> Column {
    // the nearer bound first: the smallest so far waits for one comparison, not for two
    let (above, below) = (each(w, lo, |w, lo| w - lo), each(hi, w, |hi, w| hi - w));
    each(each(above, below, smaller), least, smaller)
}

/// The smaller one, b if a is NaN.
#[inline(always)]
pub fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The larger one, b if a is NaN.
#[inline(always)]
pub fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// Σ w v².
#[inline(always)]
pub fn weighted_square(weights: &[f64], v: &[f64]) -> f64 {
    let weights = &weights[..v.len()];
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

// Here, in `axpy` and in `halve` a loop, not `for_each`, which may be compiled on its own, without
// the vector units.
/// f of eight pairs.
#[inline(always)]
pub fn each(a: [f64; WIDTH], b: [f64; WIDTH], f: impl Fn(f64, f64) -> f64) -> [f64; WIDTH] {
    let mut out = a;
    for (a, b) in out.iter_mut().zip(b) {
        *a = f(*a, b);
    }
    out
}

/// Eight values to one, by halves.
#[inline(always)]
pub fn halve(mut x: [f64; WIDTH], join: impl Fn(f64, f64) -> f64) -> f64 {
    for half in [WIDTH / 2, WIDTH / 4, WIDTH / 8] {
        for i in 0..half {
            x[i] = join(x[i], x[i + half]);
        }
    }
    x[0]
}

#[cfg(test)]
mod tests {
    use super::{Panels, WIDTH, margins, panels_len, write_panels};

    const ROWS: usize = 2 * WIDTH;

    fn entry(i: usize, j: usize) -> f64 {
        1.0 / (1.0 + i as f64 + 3.0 * j as f64)
    }

    #[test]
    fn however_many_columns_a_row_is_summed_in_their_order() {
        for columns in 1..10 {
            let mut room = [0.0; panels_len(ROWS, 9)];
            let data = &mut room[..panels_len(ROWS, columns)];
            write_panels((ROWS, columns), entry, data);
            let x: [f64; 9] = core::array::from_fn(|j| 0.3 - j as f64);
            let start: [f64; ROWS] = core::array::from_fn(|i| 0.1 * i as f64);
            let mut out = [0.0; ROWS];
            Panels::new(columns, data).tall(&start, &x[..columns], &mut out);
            for (i, out) in out.iter().enumerate() {
                let sum = (0..columns).fold(start[i], |sum, j| sum + entry(i, j) * x[j]);
                assert_eq!(*out, sum, "row {i} of {columns} columns");
            }
        }
    }

    #[test]
    fn the_smallest_margin_is_that_to_the_nearest_bound_of_what_was_measured() {
        for len in 1..20 {
            for nearest in 0..len {
                let mut values = [0.0; 20];
                (values[nearest], values[(nearest + 1) % len]) = (0.5, -0.25);
                let expected = if len > 1 { 0.5 } else { 0.75 };
                if len > 2 {
                    values[(nearest + 2) % len] = f64::NAN;
                }
                let all = margins(&values[..len], &[-1.0; 20], &[1.0; 20]);
                assert_eq!(all.into_iter().fold(f64::INFINITY, f64::min), expected);
            }
        }
    }
}
