//! Noise of smooth spectra and a law's size, found together (as `likelihood` does for a force that does not repeat): the
//! coefficients a of its functions are normal with variance g d, the fitted parameters are integrated over.

use super::super::spectrum::{Left, PRICE, SmoothSpectrum};
use super::cells::Cell;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};

/// Freedom of a cell below which it was fitted away.
const LEAST_FREEDOM: f64 = 0.2;
/// Responses of which less than this part is left beside the fitted parameters are made up for by them.
const MADE_UP: f64 = 1e-6;
/// Rounds of spectra by what is left over, and law by spectra.
const ROUNDS: usize = 4;
/// Sizes that are compared first, as powers of ten of the inverse of the largest eigenvalue.
const SIZES: std::ops::Range<i32> = -2..7;

/// Spectra with the likelihood that belongs to them.
#[derive(Debug, Clone)]
pub(super) struct Settled {
    pub(super) spectra: Vec<SmoothSpectrum>,
    /// Logarithm of the restricted likelihood less what the spectra cost.
    pub(super) score: f64,
}

/// Products of all cells by one noise.
struct Weighed {
    products: DMatrix<f64>,
    /// Sum of log S over lines.
    log: f64,
    density: Vec<f64>,
}

/// Which functions a law prefers.
#[derive(Debug, Clone, Copy)]
enum Preference {
    /// Those that most functions have in common.
    Common,
    /// None: every function alike, by what it does to the outputs.
    None,
}

/// A law by one noise.
struct Sized {
    log_likelihood: f64,
    /// Variances g d of the coefficients; zero where there is no law.
    variances: DVector<f64>,
}

/// Finds both from spectra to begin with; `p` is the number of fitted parameters.
pub(super) fn settle(cells: &[Cell], p: usize, start: &[SmoothSpectrum]) -> Settled {
    let mut spectra = start.to_vec();
    let mut best: Option<Settled> = None;
    for _ in 0..ROUNDS {
        let weighed = Weighed::new(cells, &spectra);
        let Some(sized) = sized(&weighed, p) else { break };
        let price: f64 = spectra.iter().map(|s| PRICE * s.size() as f64).sum();
        let score = sized.log_likelihood - price;
        if best.as_ref().is_none_or(|b| score > b.score) {
            best = Some(Settled { spectra: spectra.clone(), score });
        }
        let Some(next) = weighed.spectra(cells, p, &sized.variances) else { break };
        if next == spectra {
            break;
        }
        spectra = next;
    }
    best.unwrap_or(Settled { spectra, score: f64::NEG_INFINITY })
}

/// The law's size of the greatest likelihood, of all preferences.
fn sized(weighed: &Weighed, p: usize) -> Option<Sized> {
    let k = weighed.products.nrows() - p - 1;
    let (fitted, beside) = beside(&weighed.products, p)?;
    let determinant = fitted.map_or(0.0, |f| 2.0 * f.l_dirty().diagonal().map(f64::ln).sum());
    let none = -0.5 * (weighed.log + determinant + beside[(k, k)]);
    let mut best = Sized { log_likelihood: none, variances: DVector::zeros(k) };
    if k == 0 {
        return Some(best);
    }
    for preference in [Preference::Common, Preference::None] {
        let scale = DVector::from_fn(k, |i, _| {
            let (own, left) = (weighed.products[(p + i, p + i)], beside[(i, i)]);
            match preference {
                _ if left <= MADE_UP * own || left <= 0.0 => 0.0,
                Preference::Common => 1.0,
                Preference::None => left.sqrt().recip(),
            }
        });
        let gram = DMatrix::from_fn(k, k, |i, j| scale[i] * beside[(i, j)] * scale[j]);
        if !gram.iter().all(|v| v.is_finite()) {
            continue;
        }
        let eigen = SymmetricEigen::new(gram);
        let cross = eigen.eigenvectors.tr_mul(&beside.view((0, k), (k, 1)).column(0).component_mul(&scale));
        let (gain, size) = largest(&eigen.eigenvalues, &cross);
        // the better of two
        let log_likelihood = none + gain - std::f64::consts::LN_2;
        if log_likelihood > best.log_likelihood {
            best = Sized { log_likelihood, variances: scale.map(|s| size * s * s) };
        }
    }
    Some(best)
}

/// Factor of the fitted parameters' products, and what is left of all others beside them.
fn beside(products: &DMatrix<f64>, p: usize) -> Option<(Option<Cholesky<f64, Dyn>>, DMatrix<f64>)> {
    let rest = products.nrows() - p;
    let own = products.view((p, p), (rest, rest)).into_owned();
    if p == 0 {
        return Some((None, own));
    }
    let fitted = products.view((0, 0), (p, p)).into_owned();
    let floor = 1e-12 * fitted.diagonal().amax().max(f64::MIN_POSITIVE);
    let factor = (fitted + DMatrix::identity(p, p) * floor).cholesky()?;
    let cross = products.view((0, p), (p, rest)).into_owned();
    let left = own - cross.tr_mul(&factor.solve(&cross));
    Some((Some(factor), left))
}

/// Gain in log-likelihood and the g that has it: a grid, then the golden section.
fn largest(values: &DVector<f64>, cross: &DVector<f64>) -> (f64, f64) {
    let top = values.max();
    if top <= 0.0 {
        return (0.0, 0.0);
    }
    let gain = |exponent: f64| {
        let g = 10.0_f64.powf(exponent) / top;
        let one = |(l, a): (&f64, &f64)| {
            let l = l.max(0.0);
            0.5 * (g * a * a / (1.0 + g * l) - (g * l).ln_1p())
        };
        values.iter().zip(cross.iter()).map(one).sum::<f64>()
    };
    let tried = SIZES.map(|e| (gain(f64::from(e)), f64::from(e)));
    let Some((_, middle)) = tried.max_by(|a, b| a.0.total_cmp(&b.0)) else { return (0.0, 0.0) };
    let (mut low, mut high) = (middle - 1.0, middle + 1.0);
    let ratio = 0.618_033_988_749_895;
    for _ in 0..12 {
        let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
        if gain(a) > gain(b) { high = b } else { low = a }
    }
    let exponent = 0.5 * (low + high);
    let found = gain(exponent);
    if found > 0.0 { (found, 10.0_f64.powf(exponent) / top) } else { (0.0, 0.0) }
}

impl Weighed {
    fn new(cells: &[Cell], spectra: &[SmoothSpectrum]) -> Self {
        let width = cells[0].products.nrows();
        let mut products = DMatrix::zeros(width, width);
        let (mut log, mut density) = (0.0, Vec::with_capacity(cells.len()));
        for cell in cells {
            let s = spectra[cell.channel].at(cell.log_frequency).max(f64::MIN_POSITIVE);
            products.zip_apply(&cell.products, |sum, v| *sum += v / s);
            log += cell.lines * s.ln();
            density.push(s);
        }
        Self { products, log, density }
    }

    /// Smooth spectra of what parameters and law leave.
    fn spectra(&self, cells: &[Cell], p: usize, variances: &DVector<f64>) -> Option<Vec<SmoothSpectrum>> {
        let size = p + variances.len();
        // coefficients in units of their deviations, parameters as they are
        let unit = DVector::from_fn(size, |i, _| if i < p { 1.0 } else { variances[i - p].sqrt() });
        let mut system = DMatrix::from_fn(size, size, |i, j| unit[i] * self.products[(i, j)] * unit[j]);
        let floor = 1e-12 * (0..p).map(|i| system[(i, i)]).fold(0.0, f64::max);
        (0..size).for_each(|i| system[(i, i)] += if i < p { floor } else { 1.0 });
        let mut spread = if size > 0 { system.cholesky()?.inverse() } else { DMatrix::zeros(0, 0) };
        for i in 0..size {
            for j in 0..size {
                spread[(i, j)] *= unit[i] * unit[j];
            }
        }
        let mut found = DVector::zeros(size + 1);
        found.rows_mut(0, size).copy_from(&(-&spread * self.products.view((0, size), (size, 1))));
        found[size] = 1.0;
        let channels = cells.iter().map(|c| c.channel).max()? + 1;
        let mut left: Vec<Vec<Left>> = vec![Vec::new(); channels];
        for (cell, density) in cells.iter().zip(&self.density) {
            let own = cell.products.view((0, 0), (size, size));
            let freedom = cell.lines - own.dot(&spread) / density;
            let power = (&cell.products * &found).dot(&found).max(0.0);
            if freedom > LEAST_FREEDOM {
                left[cell.channel].push(Left { log_frequency: cell.log_frequency, power: power / freedom, freedom });
            }
        }
        left.iter().map(|own| (!own.is_empty()).then(|| SmoothSpectrum::fit(own))).collect()
    }
}
