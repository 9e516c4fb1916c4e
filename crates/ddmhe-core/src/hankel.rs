//! Block Hankel matrices (Definition 1).

use crate::error::Error;
use faer::Mat;

/// H_depth(u) of a signal u with `width` channels: column k stacks u(k), …, u(k+depth-1).
///
/// A view: stored time-major, a column is a contiguous slice of the recording, so no depth costs a
/// copy.
#[derive(Debug, Clone, Copy)]
pub struct BlockHankel<'a> {
    signal: &'a [f64],
    width: usize,
    depth: usize,
}

impl<'a> BlockHankel<'a> {
    /// The matrix of a time-major `signal` with `width` channels.
    ///
    /// # Errors
    /// [`Error::Value`] when `width` or `depth` is 0, [`Error::Shape`] when the signal is no whole
    /// number of samples.
    pub fn new(signal: &'a [f64], width: usize, depth: usize) -> Result<Self, Error> {
        for (name, value) in [("width", width), ("depth", depth)] {
            if value == 0 {
                return Err(Error::value(name, "at least 1", value));
            }
        }
        if !signal.len().is_multiple_of(width) {
            return Err(Error::shape(
                "signal",
                format!("a multiple of width = {width} numbers"),
                signal.len(),
            ));
        }
        Ok(BlockHankel { signal, width, depth })
    }

    /// Number of rows, depth · width.
    pub fn nrows(&self) -> usize {
        self.depth.saturating_mul(self.width)
    }

    /// Number of columns, samples - depth + 1 (0 when the signal is shorter than the depth).
    pub fn ncols(&self) -> usize {
        (self.signal.len() / self.width + 1).saturating_sub(self.depth)
    }

    /// Column k.
    ///
    /// # Errors
    /// [`Error::Value`] when k ≥ [`ncols`](Self::ncols).
    pub fn col(&self, k: usize) -> Result<&'a [f64], Error> {
        let columns = self.ncols();
        if k >= columns {
            return Err(Error::value(
                "k",
                format!("less than the number of columns, {columns}"),
                k,
            ));
        }
        Ok(&self.signal[k * self.width..(k + self.depth) * self.width])
    }

    /// All columns, in time.
    pub fn columns(&self) -> impl Iterator<Item = &'a [f64]> + use<'a> {
        let (signal, width, depth) = (self.signal, self.width, self.depth);
        (0..self.ncols()).map(move |k| &signal[k * width..(k + depth) * width])
    }

    /// A dense copy, rows × columns; 0 × 0 without columns.
    pub fn to_mat(&self) -> Mat<f64> {
        if self.ncols() == 0 {
            return Mat::zeros(0, 0);
        }
        // a column is contiguous in the signal
        Mat::from_fn(self.nrows(), self.ncols(), |i, k| self.signal[k * self.width + i])
    }
}
