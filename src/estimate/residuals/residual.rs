//! What a response leaves of a measurement.

/// Measured minus modelled, cell by cell; NaN where nothing was measured.
pub fn residuals(measured: &[f64], modelled: &[f64]) -> Vec<f64> {
    measured.iter().zip(modelled).map(|(z, y)| z - y).collect()
}

/// The residuals of what was measured, each with its cell.
pub fn compared(measured: &[f64], modelled: &[f64]) -> impl Iterator<Item = (usize, f64)> {
    let cells = measured.iter().zip(modelled).enumerate();
    cells.filter(|(_, (z, _))| !z.is_nan()).map(|(k, (z, y))| (k, z - y))
}

/// Adds the squares of the residuals of each output (q), and their number.
pub fn add_squares(sums: &mut [(f64, usize)], measured: &[f64], modelled: &[f64]) {
    let q = sums.len();
    for (k, residual) in compared(measured, modelled) {
        let (sum, count) = &mut sums[k % q];
        *sum += residual * residual;
        *count += 1;
    }
}
