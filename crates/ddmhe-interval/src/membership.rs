//! Is a point in a zonotope? The linear programme min ‖ξ‖∞ subject to M ξ = x - p. What the solver
//! proposes is not believed: a ξ within the unit box proves that the point is in, a plane between
//! point and set that it is not.

use crate::programme::Programme;
use crate::rounding::{map, row_sums};
use crate::tol;
use faer::Mat;

/// How much larger a set is within which a point counts as in.
const ROOM: f64 = 1.0 + tol::MEMBER;

/// Is x (n) in {center + M ξ : ‖ξ‖∞ ≤ 1}, M by columns, all numbers below about one?
pub(crate) fn holds(center: &[f64], generators: &[f64], x: &[f64]) -> bool {
    let n = x.len();
    let d: Vec<f64> = x.iter().zip(center).map(|(x, c)| x - c).collect();
    let half = row_sums(n, generators);
    let beyond = |d: f64, h: f64, x: f64| d.abs() > h * ROOM + 2.0 * f64::EPSILON * x.abs();
    if (0..n).any(|i| beyond(d[i], half[i], x[i])) {
        return false;
    }
    // Flat directions and units of different size: work in units of the half widths.
    let kept: Vec<usize> = (0..n).filter(|&i| half[i] > 0.0).collect();
    if kept.is_empty() {
        return true;
    }
    let difference = Difference {
        d: kept.iter().map(|&i| d[i] / half[i]).collect(),
        columns: generators
            .chunks_exact(n)
            .flat_map(|g| kept.iter().map(|&i| g[i] / half[i]))
            .collect(),
    };
    if difference.reached_from(&vec![0.0; generators.len() / n]) {
        return true;
    }
    let Some((xi, y)) = difference.least_max_norm() else { return true };
    difference.reached_from(&xi) || !difference.beyond_plane(&y, n)
}

/// x - p and the generators, in units of the set's half widths.
struct Difference {
    d: Vec<f64>,       // (rows)
    columns: Vec<f64>, // M (rows × m), by columns
}

impl Difference {
    /// d - M ξ.
    fn rest(&self, xi: &[f64]) -> Vec<f64> {
        let (d, rows) = (&self.d, self.d.len());
        let image =
            |i: usize| (0..xi.len()).map(|j| self.columns[j * rows + i] * xi[j]).sum::<f64>();
        (0..rows).map(|i| d[i] - image(i)).collect()
    }

    /// ξ moved onto M ξ = d: does it prove that x is in?
    fn reached_from(&self, xi: &[f64]) -> bool {
        self.least_norm(&self.rest(xi)).is_some_and(|step| {
            let xi: Vec<f64> = xi.iter().zip(step).map(|(a, b)| a + b).collect();
            xi.iter().all(|v| v.abs() <= ROOM)
                && self.rest(&xi).iter().all(|r| r.abs() <= tol::MEMBER)
        })
    }

    /// Does the plane with the normal y, however good, lie between the point and the set in n
    /// dimensions? In units of the half widths the products and the divisions round by this much.
    fn beyond_plane(&self, y: &[f64], n: usize) -> bool {
        let d = &self.d;
        let reach: f64 = self.columns.chunks_exact(d.len()).map(|g| map(y, g)[0].abs()).sum();
        let size: f64 = y.iter().zip(d).map(|(y, d)| y.abs() * (1.0 + d.abs())).sum();
        map(y, d)[0] > reach * ROOM + (n as f64 + 6.0) * f64::EPSILON * size
    }

    /// M† rest.
    fn least_norm(&self, rest: &[f64]) -> Option<Vec<f64>> {
        let (n, m) = (rest.len(), self.columns.len() / rest.len());
        let M = Mat::from_fn(n, m, |i, j| self.columns[j * n + i]);
        let svd = M.thin_svd().ok()?;
        let (U, V, sigma) = (svd.U(), svd.V(), svd.S().column_vector());
        let rank = (0..sigma.nrows()).take_while(|&k| sigma[k] > tol::FLAT * sigma[0]).count();
        let inner = |k: usize| (0..n).map(|i| U[(i, k)] * rest[i]).sum::<f64>();
        let weight: Vec<f64> = (0..rank).map(|k| inner(k) / sigma[k]).collect();
        Some((0..m).map(|j| (0..rank).map(|k| V[(j, k)] * weight[k]).sum()).collect())
    }

    /// min ‖ξ‖∞ subject to M ξ = d: a primal and a dual point near the optimum, ξ (m) and y (rows)
    /// of max dᵀy subject to ‖Mᵀy‖₁ ≤ 1. What they prove is for the caller to check; None if the
    /// solver rejects the data.
    fn least_max_norm(&self) -> Option<(Vec<f64>, Vec<f64>)> {
        let (n, m) = (self.d.len(), self.columns.len() / self.d.len());
        let rows = n + 2 * m;
        // Variables (ξ, t): M ξ = d; ξ - t ≤ 0; -ξ - t ≤ 0.
        let mut A = vec![0.0; rows * (m + 1)]; // by columns
        for j in 0..m {
            A[j * rows..j * rows + n].copy_from_slice(&self.columns[j * n..(j + 1) * n]);
            for (row, sign) in [(n + j, 1.0), (n + m + j, -1.0)] {
                A[j * rows + row] = sign;
                A[m * rows + row] = -1.0;
            }
        }
        let mut b = self.d.clone();
        b.resize(rows, 0.0);
        let mut cost = vec![0.0; m];
        cost.push(1.0);
        let programme = Programme { quadratic: false, cost, columns: A, b, equations: n };
        let found = programme.propose(tol::PROGRAMME)?;
        Some((found.x[..m].to_vec(), found.z[..n].iter().map(|z| -z).collect()))
    }
}
