//! Sensitivities and residuals of one run in time, output by output, and the filters of coloured noise over them.

use crate::iteration::products::accumulate as accumulate_products;
use crate::problem::ProblemRun;
use crate::problem::unknowns::Unknowns;
use crate::residuals::autocovariance::add_lagged_products;
use crate::residuals::autoregression::AutoRegression;
use fdm_numeric::lanes::{Simd, WithSimd, accumulate, dispatch, widest};
use fdm_system::record::even_grid::EvenGrid;
use fdm_system::simulate::{Block, Divergence};

/// One run at the estimates.
pub(crate) struct SensitivityRows {
    /// Places of the grid.
    pub(crate) length: usize,
    /// The place of each sample, and the time between places where they are even.
    pub(crate) grid: EvenGrid,
    /// Time of each.
    pub(crate) moments: Vec<f64>,
    /// Whether they are evenly spaced.
    pub(crate) even: bool,
    /// Numbers of a row, a multiple of 8: a scaled sensitivity for each column, then zeros.
    pub(crate) width: usize,
    /// The rows of the outputs, one output (length by width) after the other; zeros where nothing is compared. One piece of memory, which
    /// allocators give back and take anew less readily than several.
    rows: Vec<f64>,
    /// For each output (q) its residuals (length); NaN where nothing is compared.
    pub(crate) residuals: Vec<Vec<f64>>,
    /// For each output (q) the sum of the products of its rows (width by width).
    squares: Vec<Vec<f64>>,
}

/// The colour of the noise of all outputs.
#[derive(Debug, Clone)]
pub(crate) struct Colour {
    /// The autoregression of each output (q).
    pub(crate) models: Vec<AutoRegression>,
    /// Covariance of the innovations, q by q.
    pub(crate) innovations: Vec<f64>,
}

impl Colour {
    fn is_white(&self) -> bool {
        self.models.iter().all(|m| m.coefficients.is_empty())
    }
}

/// What coloured noise makes of a run.
pub(crate) struct Filtered {
    /// Sum over all pairs of samples of `S' R^-1 Rvv R^-1 S` (width by width).
    pub(crate) middle: Vec<f64>,
    /// For each output what the noise looks like there.
    pub(crate) images: Vec<Image>,
}

/// Rows of `Rvv R^-1 S` for one output (length by width); zeros where nothing is compared.
pub(crate) enum Image {
    /// Under coloured noise.
    Rows(Vec<f64>),
    /// Under white noise: the rows of each output (q) with these weights.
    Mixed(Vec<f64>),
}

/// Compared samples of each output of a run from which on the run determines the colour of its noise by itself.
pub const LONG_RUN: usize = 500;
/// Rows that are worked on while they are in the nearest cache.
const BLOCK: usize = 64;

/// The grid on which a run is sampled; none when it is not sampled evenly.
pub(crate) fn sampling(run: &ProblemRun<'_>) -> Option<EvenGrid> {
    let samples = run.response.samples();
    match run.response.time() {
        Some(time) if samples > 2 => {
            let q = run.response.outputs();
            let compared = |k: usize| run.measured[k * q..(k + 1) * q].iter().any(|z| !z.is_nan());
            EvenGrid::of_compared(time, compared).ok()
        }
        _ => Some(EvenGrid::counted(samples)),
    }
}

impl SensitivityRows {
    /// Simulates a run at `theta`; `scale` is the norm of each column, 0 for those that are left out. Without a grid the
    /// places are the samples, at times of their own.
    ///
    /// # Errors
    /// [`Divergence`] as for the response.
    pub(crate) fn new(
        run: &mut ProblemRun<'_>,
        unknowns: &Unknowns,
        theta: &[f64],
        scale: &[f64],
        grid: Option<EvenGrid>,
    ) -> Result<Self, Divergence> {
        let counted = || EvenGrid::counted(run.response.samples());
        let (even, grid) = (grid.is_some(), grid.unwrap_or_else(counted));
        let (q, width, length) = (run.response.outputs(), scale.len().next_multiple_of(8), grid.length());
        let factors: Vec<f64> = scale.iter().map(|s| if *s > 0.0 { 1.0 / s } else { 0.0 }).collect();
        let mut rows = vec![0.0; q * length * width];
        let mut residuals = vec![vec![f64::NAN; length]; q];
        let measured = &run.measured;
        run.response.sensitivities(theta, &unknowns.columns, &mut |block: Block<'_>| {
            let in_order = |columns: &[u32]| columns.iter().enumerate().all(|(k, column)| k == *column as usize);
            let in_order: Vec<bool> = block.layout.outputs.iter().map(|o| in_order(&o.columns)).collect();
            for (cell, y) in block.y.iter().enumerate() {
                let (sample, output, z) = (cell / q, cell % q, measured[block.first * q + cell]);
                if z.is_nan() {
                    continue;
                }
                let place = grid.place[block.first + sample];
                residuals[output][place] = z - y;
                let (to, from) = (&mut rows[(output * length + place) * width..][..width], block.row(sample, output));
                let scaled = |value: f64, factor: f64| if factor > 0.0 { value * factor } else { 0.0 };
                let columns = &block.layout.outputs[output].columns;
                if in_order[output] {
                    let values = from[..columns.len()].iter().zip(&factors);
                    to.iter_mut().zip(values).for_each(|(to, (value, factor))| *to = scaled(*value, *factor));
                    continue;
                }
                for (column, value) in columns.iter().zip(from) {
                    let column = *column as usize;
                    to[column] = scaled(*value, factors[column]);
                }
            }
        })?;
        let mut rows = Self::of(grid, width, rows, residuals);
        if let Some(time) = run.response.time().filter(|_| !even) {
            (rows.moments, rows.even) = (time.to_vec(), false);
        }
        Ok(rows)
    }

    /// Rows (q by length by width) and residuals as they are.
    pub(super) fn of(grid: EvenGrid, width: usize, rows: Vec<f64>, residuals: Vec<Vec<f64>>) -> Self {
        let length = residuals.first().map_or(0, Vec::len);
        let squares =
            (0..residuals.len()).map(|o| squared(&rows[o * length * width..][..length * width], width)).collect();
        let moments = (0..length).map(|i| i as f64 * grid.interval).collect();
        Self { length, grid, moments, even: true, width, rows, residuals, squares }
    }

    /// The rows of an output (length by width).
    pub(crate) fn of_output(&self, output: usize) -> &[f64] {
        let numbers = self.length * self.width;
        &self.rows[output * numbers..][..numbers]
    }

    fn of_outputs(&self) -> impl Iterator<Item = &[f64]> {
        (0..self.residuals.len()).map(|o| self.of_output(o))
    }

    /// Whether the run determines the colour of its noise by itself: evenly sampled, each compared output at least [`LONG_RUN`] times.
    pub(super) fn is_long(&self) -> bool {
        let compared = |v: &Vec<f64>| v.iter().filter(|v| !v.is_nan()).count();
        self.even && self.residuals.iter().map(compared).filter(|n| *n > 0).min().is_some_and(|n| n >= LONG_RUN)
    }

    /// The share of each residual of an output that fitting takes (length): `s' D s / r` with the Cramer-Rao covariance of this run's columns (width by
    /// width) and the inverse variance of the noise.
    pub(super) fn leverages(&self, output: usize, covariance: &[f64], inverse_noise: f64) -> Vec<f64> {
        let rows = self.of_output(output);
        let mut mapped = vec![0.0; rows.len()];
        add_mapped(rows, covariance, self.width, &mut mapped);
        let share = |(row, mapped): (&[f64], &[f64])| row.iter().zip(mapped).map(|(a, b)| a * b).sum::<f64>();
        let width = self.width.max(1);
        rows.chunks(width).zip(mapped.chunks(width)).map(|pair| inverse_noise * share(pair)).collect()
    }

    /// These rows of all outputs weighted by `inverse_noise` (q by q).
    pub(super) fn weighted(&self, inverse_noise: &[f64]) -> Self {
        let q = self.residuals.len();
        let mut rows = vec![0.0; self.rows.len()];
        for (rows, weights) in rows.chunks_mut((self.length * self.width).max(1)).zip(inverse_noise.chunks(q)) {
            self.weigh(weights, rows);
        }
        self.with_rows(rows)
    }

    /// These rows, each times a factor (q by length).
    pub(super) fn scaled(&self, factors: &[Vec<f64>]) -> Self {
        let mut rows = self.rows.clone();
        rows.chunks_mut(self.width.max(1)).zip(factors.iter().flatten()).for_each(|(row, factor)| scale(*factor, row));
        self.with_rows(rows)
    }

    fn with_rows(&self, rows: Vec<f64>) -> Self {
        let (moments, even) = (self.moments.clone(), self.even);
        Self { moments, even, ..Self::of(self.grid.clone(), self.width, rows, self.residuals.clone()) }
    }

    /// Runs the noise's filters over the rows, weighted by `inverse_noise` (q by q): backward to what each innovation does,
    /// and forward again to what the noise looks like.
    pub(crate) fn filter(&self, colour: &Colour, inverse_noise: &[f64]) -> Filtered {
        let (q, width) = (self.residuals.len(), self.width);
        let factor = factor(&colour.innovations, q);
        if colour.is_white() {
            return self.mix(colour, &factor, inverse_noise);
        }
        let memory = colour.models.iter().map(|m| m.memory(self.length)).max().unwrap_or(0);
        let effect = |a: usize| {
            let mut rows = vec![0.0; (memory + self.length) * width];
            self.weigh(&inverse_noise[a * q..(a + 1) * q], &mut rows[memory * width..]);
            colour.models[a].backward(&mut rows, width);
            rows
        };
        let mut images: Vec<Vec<f64>> = (0..q).map(effect).collect();
        // of innovations that correlate to independent ones of unit variance, in their place
        for c in 0..q {
            let (head, tail) = images.split_at_mut(c + 1);
            scale(factor[c * q + c], &mut head[c]);
            tail.iter().enumerate().for_each(|(b, rows)| add(factor[(c + 1 + b) * q + c], rows, &mut head[c]));
        }
        let mut middle = vec![0.0; width * width];
        images.iter().for_each(|rows| add(1.0, &squared(rows, width), &mut middle));
        for a in (0..q).rev() {
            let (head, tail) = images.split_at_mut(a);
            scale(factor[a * q + a], &mut tail[0]);
            head.iter().enumerate().for_each(|(c, rows)| add(factor[a * q + c], rows, &mut tail[0]));
            colour.models[a].forward(&mut tail[0], width);
            tail[0].drain(..memory * width);
            self.blank(a, 0, &mut tail[0]);
        }
        Filtered { middle, images: images.into_iter().map(Image::Rows).collect() }
    }

    /// What white noise makes of the rows; nothing of their size is made.
    fn mix(&self, colour: &Colour, factor: &[f64], inverse_noise: &[f64]) -> Filtered {
        let (q, width) = (self.residuals.len(), self.width);
        let product = |a: &[f64], b: &[f64]| -> Vec<f64> {
            (0..q * q).map(|k| (0..q).map(|l| a[k / q * q + l] * b[l * q + k % q]).sum()).collect()
        };
        let (half, weights) = (product(inverse_noise, factor), product(&colour.innovations, inverse_noise));
        let mut middle = vec![0.0; width * width];
        for c in 0..q {
            let column: Vec<f64> = (0..q).map(|b| half[b * q + c]).collect();
            add(1.0, &self.square_of(&column), &mut middle);
        }
        let images = weights.chunks(q.max(1)).map(|w| Image::Mixed(w.to_vec())).collect();
        Filtered { middle, images }
    }

    /// The sum of the products of the rows of all outputs, added with these weights (width by width).
    pub(super) fn square_of(&self, weights: &[f64]) -> Vec<f64> {
        let width = self.width;
        let mut sums = vec![0.0; width * width];
        if weights.iter().filter(|w| **w != 0.0).count() < 2 {
            weights.iter().zip(&self.squares).for_each(|(w, square)| add(w.powi(2), square, &mut sums));
            return sums;
        }
        let mut buffer = vec![0.0; BLOCK * width];
        for first in (0..self.length).step_by(BLOCK) {
            let range = first * width..(first + BLOCK).min(self.length) * width;
            let rows = &mut buffer[..range.len()];
            rows.fill(0.0);
            self.of_outputs().zip(weights).for_each(|(r, w)| add(*w, &r[range.clone()], rows));
            accumulate_products(rows, width, rows.len() / width, width, width, &mut sums);
        }
        mirrored(sums, width)
    }

    /// `S' R^-1 S`, with `inverse_noise` (q by q).
    pub(super) fn information(&self, inverse_noise: &[f64]) -> Vec<f64> {
        let (q, width) = (self.residuals.len(), self.width);
        let factor = factor(inverse_noise, q);
        let mut sums = vec![0.0; width * width];
        for k in 0..q {
            let column: Vec<f64> = (0..q).map(|o| factor[o * q + k]).collect();
            add(1.0, &self.square_of(&column), &mut sums);
        }
        sums
    }

    /// Zeros where an output has no sample; `rows` begin at the place `first`.
    fn blank(&self, output: usize, first: usize, rows: &mut [f64]) {
        for (row, v) in rows.chunks_mut(self.width).zip(&self.residuals[output][first..]) {
            if v.is_nan() {
                row.fill(0.0);
            }
        }
    }

    /// Adds the rows of all outputs with these weights.
    pub(super) fn weigh(&self, weights: &[f64], to: &mut [f64]) {
        for (rows, weight) in self.of_outputs().zip(weights) {
            add(*weight, rows, to);
        }
    }

    /// Leverage correction: what fitting takes off the sums of lagged products of an output's residuals, for lags 0 to `most`: with P the
    /// projection on the sensitivities, the residuals have the covariance (1 - P) Rvv (1 - P)'. `reduced` are the Cramer-Rao
    /// covariance of this run's columns and the corrected one (width by width). `half` is room for rows, kept from call to call.
    pub(crate) fn taken(
        &self,
        output: usize,
        image: &Image,
        [inverse, covariance]: &[Vec<f64>; 2],
        most: usize,
        half: &mut Vec<f64>,
    ) -> Vec<f64> {
        let (width, rows) = (self.width, self.of_output(output));
        // what white noise makes of an output's own rows is a multiple of them
        let (own, others) = match image {
            Image::Rows(_) => (0.0, true),
            Image::Mixed(weights) => (weights[output], (0..weights.len()).any(|b| b != output && weights[b] != 0.0)),
        };
        let matrix: Vec<f64> = covariance.iter().zip(inverse).map(|(c, i)| own * i - 0.5 * c).collect();
        half.clear();
        half.resize(rows.len(), 0.0);
        let mut buffer = vec![0.0; BLOCK * width];
        for (block, half) in half.chunks_mut(BLOCK * width).enumerate() {
            let range = block * BLOCK * width..block * BLOCK * width + half.len();
            add_mapped(&rows[range.clone()], &matrix, width, half);
            match image {
                Image::Rows(image) => add_mapped(&image[range], inverse, width, half),
                Image::Mixed(weights) if others => {
                    let mixed = &mut buffer[..half.len()];
                    mixed.fill(0.0);
                    for (_, (rows, weight)) in self.of_outputs().zip(weights).enumerate().filter(|(b, _)| *b != output)
                    {
                        add(*weight, &rows[range.clone()], mixed);
                    }
                    self.blank(output, block * BLOCK, mixed);
                    add_mapped(mixed, inverse, width, half);
                }
                Image::Mixed(_) => {}
            }
        }
        let mut sums = vec![0.0; most + 1];
        add_lagged_products(rows, half, width, &mut sums);
        match others {
            true => add_lagged_products(half, rows, width, &mut sums),
            // times a symmetric matrix they give the same sums the other way round
            false => sums.iter_mut().for_each(|sum| *sum *= 2.0),
        }
        sums
    }

    /// What [`Self::taken`] cannot exceed at any lag: by the inequality of Cauchy and Schwarz from the sums at lag 0.
    pub(crate) fn bound(&self, output: usize, image: &Image, [inverse, covariance]: &[Vec<f64>; 2]) -> f64 {
        let size = |squares: &[f64], by: &[f64]| squares.iter().zip(by).map(|(s, d)| s * d).sum::<f64>().max(0.0);
        let reach = |squares: &[f64]| size(squares, inverse).sqrt();
        let image = match image {
            Image::Rows(rows) => reach(&squared(rows, self.width)),
            Image::Mixed(weights) => self.squares.iter().zip(weights).map(|(s, w)| w.abs() * reach(s)).sum(),
        };
        2.0 * reach(&self.squares[output]) * image + size(&self.squares[output], covariance)
    }
}

/// A factor L (lower triangle) of a positive semidefinite matrix L L'.
pub(super) fn factor(matrix: &[f64], n: usize) -> Vec<f64> {
    let mut l = vec![0.0; n * n];
    for j in 0..n {
        for i in j..n {
            let rest = matrix[i * n + j] - (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum::<f64>();
            l[i * n + j] = match () {
                () if i == j => rest.max(0.0).sqrt(),
                // what is left of a row that the others determine is rounding
                () if l[j * n + j] > 1e-8 * matrix[j * n + j].sqrt() => rest / l[j * n + j],
                () => 0.0,
            };
        }
    }
    l
}

/// The sum of the products of rows (width by width).
fn squared(rows: &[f64], width: usize) -> Vec<f64> {
    let mut sums = vec![0.0; width * width];
    if width > 0 {
        accumulate_products(rows, width, rows.len() / width, width, width, &mut sums);
    }
    mirrored(sums, width)
}

/// A symmetric matrix of which the upper triangle is known.
fn mirrored(mut sums: Vec<f64>, width: usize) -> Vec<f64> {
    for i in 0..width {
        (0..i).for_each(|j| sums[i * width + j] = sums[j * width + i]);
    }
    sums
}

fn scale(factor: f64, rows: &mut [f64]) {
    rows.iter_mut().for_each(|r| *r *= factor);
}

fn add(factor: f64, from: &[f64], to: &mut [f64]) {
    if factor != 0.0 {
        widest(
            #[inline(always)]
            || accumulate(factor, from, to),
        );
    }
}

/// Adds to each row of `to` the row of `from` times a matrix (width by width, width a multiple of 8).
pub(super) fn add_mapped(from: &[f64], matrix: &[f64], width: usize, to: &mut [f64]) {
    dispatch(Mapping { from, matrix, width, to });
}

struct Mapping<'a> {
    from: &'a [f64],
    matrix: &'a [f64],
    width: usize,
    to: &'a mut [f64],
}

impl WithSimd for Mapping<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let across = self.width / S::F64_LANES;
        let mut vector = 0;
        while vector < across {
            vector += match across - vector {
                1 => self.tiles::<S, 1>(simd, vector),
                _ => self.tiles::<S, 2>(simd, vector),
            };
        }
    }
}

impl Mapping<'_> {
    /// C vectors of all rows, four rows at a time as far as there are as many; gives C.
    #[inline(always)]
    fn tiles<S: Simd, const C: usize>(&mut self, simd: S, vector: usize) -> usize {
        let rows = self.from.len() / self.width;
        let mut row = 0;
        while row + 4 <= rows {
            self.tile::<S, 4, C>(simd, row, vector);
            row += 4;
        }
        while row < rows {
            self.tile::<S, 1, C>(simd, row, vector);
            row += 1;
        }
        C
    }

    /// C vectors of R rows.
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const C: usize>(&mut self, simd: S, row: usize, vector: usize) {
        let (width, across) = (self.width, self.width / S::F64_LANES);
        let (matrix, to) = (S::as_simd_f64s(self.matrix).0, S::as_mut_simd_f64s(self.to).0);
        let mut sums = [[simd.splat_f64s(0.0); C]; R];
        for (r, sums) in sums.iter_mut().enumerate() {
            sums.copy_from_slice(&to[(row + r) * across + vector..][..C]);
        }
        let mut from = [&self.from[..0]; R];
        for (r, from) in from.iter_mut().enumerate() {
            *from = &self.from[(row + r) * width..][..width];
        }
        for (k, matrix) in matrix.chunks_exact(across).enumerate() {
            let Some(matrix) = matrix[vector..].first_chunk::<C>() else { return };
            for r in 0..R {
                let factor = simd.splat_f64s(from[r][k]);
                for c in 0..C {
                    sums[r][c] = simd.mul_add_f64s(factor, matrix[c], sums[r][c]);
                }
            }
        }
        for (r, sums) in sums.iter().enumerate() {
            to[(row + r) * across + vector..][..C].copy_from_slice(sums);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_multiplied_from_the_right_and_added() {
        for width in [8, 24, 40] {
            let numbers = |n: usize| (0..n).map(|k| (k as f64 * 0.7).sin()).collect::<Vec<_>>();
            let (from, matrix, mut to) = (numbers(5 * width), numbers(width * width), vec![1.0; 5 * width]);
            add_mapped(&from, &matrix, width, &mut to);
            for (k, to) in to.iter().enumerate() {
                let (i, j) = (k / width, k % width);
                let want = 1.0 + (0..width).map(|l| from[i * width + l] * matrix[l * width + j]).sum::<f64>();
                assert!((to - want).abs() < 1e-12);
            }
        }
    }
}
