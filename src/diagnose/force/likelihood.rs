//! The likelihood of residuals that are noise of a smooth spectrum in every output, and of those that hold the response to a
//! random force besides.
//!
//! With the force's course f ~ N(0, g D) and the response X to it, residuals r of a fit with sensitivities J have the
//! covariance S + g X D X'. With G = D^1/2 X' S^-1 X D^1/2 = V L V' everything is a sum over eigenvalues, for all g at
//! once; the fitted parameters are integrated over (restricted likelihood, Patterson & Thompson 1971). The spectra are found
//! together with g: what the force explains is not noise, and the other way round.

use super::sheet::Sheet;
use super::spectra::{Density, Spectra};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};

/// Eigenvalues below this share of the largest say nothing.
const SILENT: f64 = 1e-12;
/// Rounds of spectra from what a force leaves over, and force by spectra.
const ROUNDS: usize = 4;
/// Strengths of a force that are compared first, as powers of ten of the inverse of the largest eigenvalue.
const STRENGTHS: std::ops::Range<i32> = -2..8;

/// Responses of one run to the hats at one place: low lines by hats, for each output.
pub(super) type Hats = Vec<DMatrix<f64>>;

/// Products of one run under given spectra.
struct Products {
    /// Sum of log S, and r'r/S.
    log: f64,
    squares: f64,
    /// J'J/S and J'r/S.
    fitted: DMatrix<f64>,
    residual: DVector<f64>,
    force: Option<Force>,
}

/// The force's part: U = S^-1/2 X V L^-1/2.
struct Force {
    /// L, largest first not needed.
    values: DVector<f64>,
    /// V (hats by eigenvalues).
    vectors: DMatrix<f64>,
    /// U' J / sqrt S (eigenvalues by p), U' r / sqrt S.
    fitted: DMatrix<f64>,
    residual: DVector<f64>,
}

/// Strength of a force and the likelihood that it gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Level {
    /// g
    pub(super) strength: f64,
    /// Logarithm of the restricted likelihood.
    pub(super) log_likelihood: f64,
}

/// Spectra, strength and likelihood that belong together.
#[derive(Debug, Clone)]
pub(super) struct Settled {
    pub(super) spectra: Spectra,
    pub(super) strength: f64,
    /// Logarithm of the restricted likelihood less what the spectra cost.
    pub(super) score: f64,
    /// The same with the fitted parameters at their values, not integrated over: comparable between models.
    pub(super) profile: f64,
}

/// What is left of each line, and how much of it was free: residuals (L by q) and 1 - h.
pub(super) struct Rest {
    pub(super) residual: DMatrix<f64>,
    pub(super) freedom: DMatrix<f64>,
}

/// Finds spectra and strength together, from spectra to begin with.
pub(super) fn settle(sheets: &[Sheet], hats: Option<&[Hats]>, start: &Spectra) -> Settled {
    let mut spectra = start.clone();
    let mut best: Option<Settled> = None;
    for _ in 0..ROUNDS {
        let densities: Vec<Density> = sheets.iter().map(|s| spectra.density(s)).collect();
        let products = products(sheets, hats, &densities);
        let level = strongest(&products);
        let settled = Settled {
            strength: level.strength,
            score: level.log_likelihood - spectra.price(),
            profile: profile(&products, level.strength) - spectra.price(),
            spectra: spectra.clone(),
        };
        if best.as_ref().is_none_or(|b| settled.score > b.score) {
            best = Some(settled);
        }
        let rests = rests(sheets, hats, &densities, &products, level.strength);
        let next = Spectra::fit(sheets, &rests);
        if next == spectra {
            break;
        }
        spectra = next;
    }
    best.unwrap_or_else(|| Settled { spectra, strength: 0.0, score: f64::NEG_INFINITY, profile: f64::NEG_INFINITY })
}

fn products(sheets: &[Sheet], hats: Option<&[Hats]>, densities: &[Density]) -> Vec<Products> {
    let one = |(run, (sheet, density)): (usize, (&Sheet, &Density))| {
        let p = sheet.fitted[0].ncols();
        let (mut fitted, mut residual) = (DMatrix::zeros(p, p), DVector::zeros(p));
        let (mut log, mut squares) = (0.0, 0.0);
        let mut gram = hats.map(|h| DMatrix::zeros(h[run][0].ncols(), h[run][0].ncols()));
        let mut cross = hats.map(|h| DMatrix::zeros(h[run][0].ncols(), p + 1));
        for channel in 0..sheet.channels() {
            let weight = density.channel(channel).map(|s| 1.0 / s.sqrt());
            log -= 2.0 * weight.iter().map(|w| w.ln()).sum::<f64>();
            let columns = weighed(&sheet.fitted[channel], &weight);
            let own = sheet.residual.column(channel).component_mul(&weight);
            squares += own.norm_squared();
            fitted += columns.tr_mul(&columns);
            residual += columns.tr_mul(&own);
            let (Some(gram), Some(cross), Some(hats)) = (&mut gram, &mut cross, hats) else { continue };
            let hats = weighed(&hats[run][channel], &weight);
            let low = hats.nrows();
            gram.gemm_tr(1.0, &hats, &hats, 1.0);
            cross.columns_mut(0, p).gemm_tr(1.0, &hats, &columns.rows(0, low), 1.0);
            cross.column_mut(p).gemv_tr(1.0, &hats, &own.rows(0, low), 1.0);
        }
        let force = gram.zip(cross).map(|(gram, cross)| Force::new(gram, &cross, p));
        Products { log, squares, fitted, residual, force }
    };
    sheets.iter().zip(densities).enumerate().map(one).collect()
}

/// The first rows of a matrix, each times its weight.
fn weighed(columns: &DMatrix<f64>, weight: &DVector<f64>) -> DMatrix<f64> {
    let mut result = columns.clone();
    for mut column in result.column_iter_mut() {
        column.iter_mut().zip(weight.iter()).for_each(|(value, w)| *value *= w);
    }
    result
}

impl Force {
    fn new(gram: DMatrix<f64>, cross: &DMatrix<f64>, p: usize) -> Self {
        let eigen = SymmetricEigen::new(gram);
        let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
        let kept: Vec<usize> = (0..eigen.eigenvalues.len())
            .filter(|k| eigen.eigenvalues[*k] > SILENT * largest && largest > 0.0)
            .collect();
        let values = DVector::from_fn(kept.len(), |k, _| eigen.eigenvalues[kept[k]]);
        let vectors = eigen.eigenvectors.select_columns(&kept);
        let mut turned = vectors.tr_mul(cross);
        for (k, mut row) in turned.row_iter_mut().enumerate() {
            row /= values[k].sqrt();
        }
        Self { values, vectors, fitted: turned.columns(0, p).into_owned(), residual: turned.column(p).into_owned() }
    }

    /// g L/(1 + g L)
    fn shrink(&self, strength: f64) -> DVector<f64> {
        self.values.map(|l| strength * l / (1.0 + strength * l))
    }
}

/// J'C^-1 J, J'C^-1 r, r'C^-1 r and log|C| of all runs, where C is the covariance.
struct Sums {
    fitted: DMatrix<f64>,
    residual: DVector<f64>,
    squares: f64,
    log: f64,
}

impl Sums {
    fn new(products: &[Products], strength: f64) -> Self {
        let p = products[0].residual.len();
        let mut sums = Self { fitted: DMatrix::zeros(p, p), residual: DVector::zeros(p), squares: 0.0, log: 0.0 };
        for run in products {
            sums.fitted += &run.fitted;
            sums.residual += &run.residual;
            sums.squares += run.squares;
            sums.log += run.log;
            let Some(force) = run.force.as_ref().filter(|_| strength > 0.0) else { continue };
            let shrink = force.shrink(strength);
            let mut shrunk = force.fitted.clone();
            shrunk.row_iter_mut().zip(shrink.iter()).for_each(|(mut row, s)| row *= *s);
            sums.fitted -= force.fitted.tr_mul(&shrunk);
            sums.residual -= shrunk.tr_mul(&force.residual);
            sums.squares -= force.residual.iter().zip(shrink.iter()).map(|(u, s)| s * u * u).sum::<f64>();
            sums.log += force.values.iter().map(|l| (strength * l).ln_1p()).sum::<f64>();
        }
        sums
    }

    /// J'C^-1 J with what keeps it regular where a force can do all that a parameter can.
    fn factor(&self) -> Option<Cholesky<f64, Dyn>> {
        let size = self.fitted.nrows();
        let scale = self.fitted.diagonal().amax().max(f64::MIN_POSITIVE);
        (&self.fitted + DMatrix::identity(size, size) * (1e-12 * scale)).cholesky()
    }

    fn log_likelihood(&self, restricted: bool) -> f64 {
        if self.residual.is_empty() {
            return -0.5 * (self.log + self.squares);
        }
        let Some(factor) = self.factor() else { return f64::NEG_INFINITY };
        let taken = self.residual.dot(&factor.solve(&self.residual));
        let determinant = if restricted { 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum() } else { 0.0 };
        -0.5 * (self.log + determinant + self.squares - taken)
    }
}

fn profile(products: &[Products], strength: f64) -> f64 {
    Sums::new(products, strength).log_likelihood(false)
}

/// The strength of the greatest likelihood: a grid, then the golden section around its best.
fn strongest(products: &[Products]) -> Level {
    let at = |strength: f64| Level { strength, log_likelihood: Sums::new(products, strength).log_likelihood(true) };
    let none = at(0.0);
    let largest = products.iter().filter_map(|p| p.force.as_ref()).map(|f| f.values.max()).fold(0.0, f64::max);
    if largest <= 0.0 {
        return none;
    }
    let power = |exponent: f64| at(10_f64.powf(exponent) / largest);
    let grid: Vec<(f64, Level)> = STRENGTHS.map(|e| (f64::from(e), power(f64::from(e)))).collect();
    let Some((exponent, level)) = grid.iter().copied().max_by(|a, b| a.1.log_likelihood.total_cmp(&b.1.log_likelihood))
    else {
        return none;
    };
    let (mut low, mut high, mut best) = (exponent - 1.0, exponent + 1.0, level);
    let ratio = 0.618_033_988_749_895;
    for _ in 0..12 {
        let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
        let (left, right) = (power(a), power(b));
        if left.log_likelihood > right.log_likelihood {
            high = b;
        } else {
            low = a;
        }
        for level in [left, right] {
            if level.log_likelihood > best.log_likelihood {
                best = level;
            }
        }
    }
    if best.log_likelihood > none.log_likelihood { best } else { none }
}

/// What is left of the lines, and how free it was.
fn rests(
    sheets: &[Sheet],
    hats: Option<&[Hats]>,
    densities: &[Density],
    products: &[Products],
    strength: f64,
) -> Vec<Rest> {
    let sums = Sums::new(products, strength);
    let p = sums.residual.len();
    let factor = if p > 0 { sums.factor() } else { None };
    let theta = factor.as_ref().map_or_else(|| DVector::zeros(p), |f| f.solve(&sums.residual));
    // R with R R' = (J'C^-1 J)^-1
    let root = factor.and_then(|f| f.l().try_inverse()).map_or_else(|| DMatrix::zeros(p, p), |l| l.transpose());
    let one = |run: usize| {
        let (sheet, density, own) = (&sheets[run], &densities[run], &products[run]);
        let (lines, q) = (sheet.frequency.len(), sheet.channels());
        let mut rest = Rest { residual: DMatrix::zeros(lines, q), freedom: DMatrix::zeros(lines, q) };
        let force = own.force.as_ref().filter(|_| strength > 0.0);
        let shrink = force.map(|f| f.shrink(strength));
        for channel in 0..q {
            let weight = density.channel(channel).map(|s| 1.0 / s.sqrt());
            let mut columns = weighed(&sheet.fitted[channel], &weight);
            let mut left = sheet.residual.column(channel).component_mul(&weight);
            let mut leverage: DVector<f64> = DVector::zeros(lines);
            if let (Some(force), Some(shrink), Some(hats)) = (force, &shrink, hats) {
                let mut basis = weighed(&hats[run][channel], &weight) * &force.vectors;
                for (k, mut column) in basis.column_iter_mut().enumerate() {
                    column /= force.values[k].sqrt();
                }
                let low = basis.nrows();
                let eaten = force.residual.component_mul(shrink);
                left.rows_mut(0, low).gemv(-1.0, &basis, &eaten, 1.0);
                let mut shrunk = force.fitted.clone();
                shrunk.row_iter_mut().zip(shrink.iter()).for_each(|(mut row, s)| row *= *s);
                columns.rows_mut(0, low).gemm(-1.0, &basis, &shrunk, 1.0);
                for (line, row) in basis.row_iter().enumerate() {
                    leverage[line] += row.iter().zip(shrink.iter()).map(|(u, s)| s * u * u).sum::<f64>();
                }
            }
            left.gemv(-1.0, &columns, &theta, 1.0);
            let turned = &columns * &root;
            for (line, row) in turned.row_iter().enumerate() {
                leverage[line] += row.norm_squared();
                rest.residual[(line, channel)] = left[line] / weight[line];
                rest.freedom[(line, channel)] = (1.0 - leverage[line]).max(0.0);
            }
        }
        rest
    };
    (0..sheets.len()).map(one).collect()
}

/// The course of a force at one place with its deviation, run by run, as ordinates of its hats (in the basis of D^1/2).
pub(super) fn course(sheets: &[Sheet], hats: &[Hats], settled: &Settled) -> Vec<(DVector<f64>, DMatrix<f64>)> {
    let densities: Vec<Density> = sheets.iter().map(|s| settled.spectra.density(s)).collect();
    let products = products(sheets, Some(hats), &densities);
    let (g, sums) = (settled.strength, Sums::new(&products, settled.strength));
    let p = sums.residual.len();
    let theta = sums.factor().filter(|_| p > 0).map_or_else(|| DVector::zeros(p), |f| f.solve(&sums.residual));
    let one = |own: &Products| {
        let size = hats[0][0].ncols();
        let Some(force) = own.force.as_ref() else { return (DVector::zeros(size), DMatrix::identity(size, size)) };
        let left = &force.residual - &force.fitted * &theta;
        let weights = DVector::from_fn(force.values.len(), |k, _| {
            let l = force.values[k];
            g * l.sqrt() / (1.0 + g * l) * left[k]
        });
        let mut covariance = DMatrix::identity(force.vectors.nrows(), force.vectors.nrows()) * g;
        for (k, v) in force.vectors.column_iter().enumerate() {
            let l = force.values[k];
            covariance.ger(-g * (g * l / (1.0 + g * l)), &v, &v, 1.0);
        }
        (&force.vectors * weights, covariance)
    };
    products.iter().map(one).collect()
}
