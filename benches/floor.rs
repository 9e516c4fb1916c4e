//! What no step can spare, in plain loops, on the sizes of an estimator: a new output into the
//! window, z* = z_0 + K [x̄; y], its window c + A z*, the states in the user's units, v = y - ŷ,
//! the distance of both to their bounds, the cost (17), and x̂(t) out and into memory as a later
//! x̄.
//!
//! Sizes are known when it runs, as in the estimator. Matrices lie in panels of eight rows, and
//! vectors are padded to whole panels, so that no loop has a rest. Nothing is looked at that may be
//! otherwise: all outputs are measured, numbers are finite, nothing but the minimiser is asked for.

use pulp::{Arch, NullaryFnOnce};

const WIDTH: usize = 8;

type Column = [f64; WIDTH];

/// One window's numbers, all made up: the work does not depend on them.
pub struct Floor {
    units: Arch,
    n: usize,
    p: usize,
    depth: usize,
    rank: usize,
    samples: usize, // in the stretches that the window slides through
    start: usize,   // the oldest of the window
    mean: [Vec<f64>; 2],
    scale: [Vec<f64>; 2], // of x and y
    outputs: Vec<f64>,
    states: Vec<f64>,
    z_0: Vec<Column>,
    K: Vec<Column>,
    c: Vec<Column>,
    A: Vec<Column>,
    means: Vec<Column>,
    s_y: Vec<Column>,
    weights: Vec<Column>,
    lo: Vec<Column>,
    hi: Vec<Column>,
    z: Vec<Column>,
    w: Vec<Column>,
    /// The states of the window in the user's units.
    window: Vec<Column>,
    /// The fitted noise.
    v: Vec<Column>,
    /// x̂(t) (n).
    x: Vec<f64>,
}

impl Floor {
    /// For n states and outputs, a depth M and r directions.
    pub fn new(n: usize, M: usize, r: usize) -> Self {
        let (seen, samples) = (n + M * n, 2 * M.max(32) + 1);
        let [of_x, of_y, of_z] = [(M + 1) * n, M * n, r].map(|len| len.div_ceil(WIDTH));
        let rows = of_x + of_y;
        let numbers =
            |len: usize| (0..len).map(|i| (i as f64).sin() / len as f64).collect::<Vec<_>>();
        let columns = |len: usize| {
            let all = numbers(len * WIDTH);
            all.as_chunks().0.to_vec()
        };
        Floor {
            units: Arch::new(),
            n,
            p: n,
            depth: M,
            rank: r,
            samples,
            start: 0,
            mean: [numbers(n), numbers(n)],
            scale: [vec![0.5; n], vec![2.0; n]],
            outputs: numbers(samples * n + WIDTH),
            states: numbers(samples * n + n),
            z_0: columns(of_z),
            K: columns(of_z * seen),
            c: columns(rows),
            A: columns(rows * r),
            means: columns(of_x),
            s_y: columns(of_y),
            weights: columns(of_y),
            lo: vec![[-1e3; WIDTH]; rows],
            hi: vec![[1e3; WIDTH]; rows],
            z: columns(of_z),
            w: columns(rows),
            window: columns(of_x),
            v: columns(of_y),
            x: numbers(n),
        }
    }

    /// One step on the machine's vector units: its cost, if all bounds are kept.
    #[inline]
    pub fn step(&mut self, y: &[f64]) -> Option<f64> {
        self.units.dispatch(Step { floor: self, y })
    }

    #[inline(always)]
    fn bare(&mut self, y: &[f64]) -> Option<f64> {
        let (n, p, depth, rank) = (self.n, self.p, self.depth, self.rank);
        if self.start + depth == self.samples {
            self.outputs.copy_within(self.start * p..self.samples * p, 0);
            self.states.copy_within(self.start * n..(self.samples + 1) * n, 0);
            self.start = 0;
        }
        // the newest output, and [x̄; y]
        let end = self.start + depth;
        let newest = &mut self.outputs[end * p..(end + 1) * p];
        for (((to, y), mean), s) in newest.iter_mut().zip(y).zip(&self.mean[1]).zip(&self.scale[1])
        {
            *to = (y - mean) / s;
        }
        self.start += 1;
        let prior = &self.states[self.start * n..(self.start + 1) * n];
        let outputs = &self.outputs[self.start * p..];
        // z* and its window
        for ((z, z_0), panel) in
            self.z.iter_mut().zip(&self.z_0).zip(self.K.chunks_exact(n + depth * p))
        {
            let (first, rest) = panel.split_at(n);
            *z = product(running(*z_0, first, prior), rest, outputs);
        }
        let z = &self.z.as_flattened()[..rank];
        if rank == 5 {
            narrow::<5>(&self.c, &self.A, z, &mut self.w); // fewer instructions, at five columns
        } else {
            let panels = self.A.chunks_exact(rank);
            for ((w, c), panel) in self.w.iter_mut().zip(&self.c).zip(panels) {
                *w = running(*c, panel, z);
            }
        }
        // the states: their bounds, and their means added
        let mut margin = [f64::INFINITY; WIDTH];
        let (w_x, w_y) = self.w.split_at(self.means.len());
        let (lo, hi) = (self.lo.split_at(w_x.len()), self.hi.split_at(w_x.len()));
        for ((((w, lo), hi), mean), x) in
            w_x.iter().zip(lo.0).zip(hi.0).zip(&self.means).zip(&mut self.window)
        {
            margin = least(margin, w, lo, hi);
            *x = each(w, mean, |w, mean| w + mean);
        }
        // the noise: its bounds and its cost
        let mut cost = [0.0; WIDTH];
        for ((((((fitted, y), s), weight), lo), hi), v) in w_y
            .iter()
            .zip(outputs.as_chunks().0)
            .zip(&self.s_y)
            .zip(&self.weights)
            .zip(lo.1)
            .zip(hi.1)
            .zip(&mut self.v)
        {
            *v = each(&each(y, fitted, |y, fitted| y - fitted), s, |d, s| d * s);
            margin = least(margin, v, lo, hi);
            let square = each(v, v, |a, b| a * b);
            cost = each(&cost, &each(weight, &square, |a, b| a * b), |a, b| a + b);
        }
        let mut cost: f64 = cost.iter().sum();
        for ((w, prior), s) in w_x.as_flattened().iter().zip(prior).zip(&self.scale[0]) {
            cost += (w * s - prior) * (w * s - prior);
        }
        // x̂(t), and as a later x̄
        self.x.copy_from_slice(&self.window.as_flattened()[depth * n..(depth + 1) * n]);
        let newest = &mut self.states[(end + 1) * n..(end + 2) * n];
        for (((to, x), mean), s) in
            newest.iter_mut().zip(&self.x).zip(&self.mean[0]).zip(&self.scale[0])
        {
            *to = (x - mean) / s;
        }
        margin.iter().fold(true, |inside, margin| inside & (*margin > 0.0)).then_some(cost)
    }
}

/// One step, to be compiled for each kind of vector units.
struct Step<'a> {
    floor: &'a mut Floor,
    y: &'a [f64],
}

impl NullaryFnOnce for Step<'_> {
    type Output = Option<f64>;

    #[inline(always)]
    fn call(self) -> Option<f64> {
        self.floor.bare(self.y)
    }
}

/// The smallest distances to two bounds so far.
#[inline(always)]
fn least(margin: Column, w: &Column, lo: &Column, hi: &Column) -> Column {
    let smaller = |a, b| if a < b { a } else { b };
    let (above, below) = (each(w, lo, |w, lo| w - lo), each(hi, w, |hi, w| hi - w));
    each(&each(&above, &below, smaller), &margin, smaller)
}

/// c + A z of so many columns, without a loop over them.
#[inline(always)]
fn narrow<const COLUMNS: usize>(c: &[Column], A: &[Column], z: &[f64], w: &mut [Column]) {
    for ((w, c), panel) in w.iter_mut().zip(c).zip(A.as_chunks::<COLUMNS>().0) {
        *w = running(*c, panel, &z[..COLUMNS]);
    }
}

/// start + Σ_j column_j x_j.
#[inline(always)]
fn running(start: Column, columns: &[Column], x: &[f64]) -> Column {
    let mut sum = start;
    for (column, x) in columns.iter().zip(x) {
        sum = each(&sum, &each(column, &[*x; WIDTH], |a, b| a * b), |a, b| a + b);
    }
    sum
}

/// The same in four sums, which need not wait for each other.
#[inline(always)]
fn product(start: Column, columns: &[Column], x: &[f64]) -> Column {
    let mut sums = [start, [0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH]];
    let (fours, rest) = columns.as_chunks::<4>();
    let (x, left) = x.split_at(4 * fours.len());
    for (columns, x) in fours.iter().zip(x.as_chunks::<4>().0) {
        for ((sum, column), x) in sums.iter_mut().zip(columns).zip(x) {
            *sum = each(sum, &each(column, &[*x; WIDTH], |a, b| a * b), |a, b| a + b);
        }
    }
    let [a, b, c, d] = sums;
    let pairs = [each(&a, &b, |a, b| a + b), each(&c, &d, |a, b| a + b)];
    running(each(&pairs[0], &pairs[1], |a, b| a + b), rest, left)
}

#[inline(always)]
fn each(a: &Column, b: &Column, f: impl Fn(f64, f64) -> f64) -> Column {
    let mut out = *a;
    for (a, b) in out.iter_mut().zip(b) {
        *a = f(*a, *b);
    }
    out
}
