//! Noise of smooth spectra and a nonlinearity's size, found together (as `likelihood` does for a disturbance that does not repeat): the
//! coefficients a of its functions are normal with variance g d, the fitted parameters are integrated over.
//!
//! Products of fitted sensitivities, responses to a nonlinearity's functions and residuals in bands of neighbouring bins: whatever the
//! noise's spectrum is, everything that is asked for is a sum over bands.

use super::super::binned_run::BinnedRun;
use super::super::likelihood::{CourseResponses, WIDE, highest};
use crate::noise::{BandedPower, ResidualPower, Resonance, SmoothSpectrum};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, SymmetricEigen};
use std::ops::Range;

/// Freedom of a band below which it was fitted away.
const LEAST_FREEDOM: f64 = 0.2;
/// Responses of which less than this part is left beside the fitted parameters are made up for by them.
const MADE_UP: f64 = 1e-6;
/// Rounds of spectra by what is left over, and nonlinearity by spectra.
const ROUNDS: usize = 4;
/// Kinds of nonlinearities of which the best is taken.
const KINDS: f64 = 3.0;
/// Sizes that are compared first, as powers of ten of the inverse of the largest eigenvalue.
const SIZES: Range<i32> = -2..7;

/// Functions of their own, as combinations (by rows); so many neighbours are one in several phases.
#[derive(Debug, Clone, Copy)]
pub(super) struct Singles<'a> {
    pub(super) combinations: &'a DMatrix<f64>,
    pub(super) alike: usize,
}

/// Spectra with the likelihood that belongs to them.
#[derive(Debug, Clone)]
pub(super) struct Settled {
    pub(super) spectra: Vec<SmoothSpectrum>,
    /// Logarithm of the restricted likelihood less what the spectra cost.
    pub(super) score: f64,
    /// Coefficients of the courses and their covariance, given spectra and sizes.
    pub(super) coefficients: (DVector<f64>, DMatrix<f64>),
}

/// Products of all bands by one noise.
struct Weighed {
    products: DMatrix<f64>,
    /// Sum of log S over bins.
    log: f64,
    density: Vec<f64>,
}

/// Which functions a nonlinearity is made of.
#[derive(Debug, Clone, Copy)]
enum Preference {
    /// Those that most functions have in common.
    Common,
    /// All alike, by what they do to the outputs.
    Alike,
}

/// A nonlinearity by one noise.
struct Sized {
    log_likelihood: f64,
    /// Root R of the coefficients' covariance R R' (K by its rank); of rank 0 where there is no nonlinearity.
    root: DMatrix<f64>,
}

/// Finds both from spectra to begin with; `p` is the number of fitted parameters, `single` are functions of their own.
pub(super) fn settle(banded: &Banded, p: usize, single: Singles<'_>, start: &[SmoothSpectrum]) -> Settled {
    let cells = &banded.cells[..];
    let mut spectra = start.to_vec();
    let mut best: Option<Settled> = None;
    for _ in 0..ROUNDS {
        let weighed = Weighed::new(cells, &spectra);
        let Some(sized) = sized(&weighed, p, single) else { break };
        let penalty: f64 = spectra.iter().map(SmoothSpectrum::penalty).sum();
        let score = sized.log_likelihood - penalty;
        if best.as_ref().is_none_or(|b| score > b.score) {
            let coefficients = coefficients(&weighed, p, &sized.root);
            best = Some(Settled { spectra: spectra.clone(), score, coefficients });
        }
        let Some(next) = weighed.spectra(banded, p, &sized.root, &spectra) else { break };
        if next == spectra {
            break;
        }
        spectra = next;
    }
    let none = (DVector::zeros(0), DMatrix::zeros(0, 0));
    best.unwrap_or(Settled { spectra, score: f64::NEG_INFINITY, coefficients: none })
}

/// Mean and covariance of the courses' coefficients a = R b, b standard normal beforehand.
fn coefficients(weighed: &Weighed, p: usize, root: &DMatrix<f64>) -> (DVector<f64>, DMatrix<f64>) {
    let (k, rank) = root.shape();
    let none = (DVector::zeros(k), DMatrix::zeros(k, k));
    if rank == 0 {
        return none;
    }
    let Some((_, beside)) = beside(&weighed.products, p) else { return none };
    let system = root.tr_mul(&(beside.view((0, 0), (k, k)) * root)) + DMatrix::identity(rank, rank);
    let Some(inverse) = system.cholesky().map(|c| c.inverse()) else { return none };
    let covariance = root * inverse * root.transpose();
    (&covariance * beside.view((0, k), (k, 1)).column(0), covariance)
}

/// The nonlinearity of the greatest likelihood: of many functions, or of one.
fn sized(weighed: &Weighed, p: usize, single: Singles<'_>) -> Option<Sized> {
    let k = weighed.products.nrows() - p - 1;
    let (fitted, beside) = beside(&weighed.products, p)?;
    let determinant = fitted.map_or(0.0, |f| 2.0 * f.l_dirty().diagonal().map(f64::ln).sum());
    let none = -0.5 * (weighed.log + determinant + beside[(k, k)]);
    let mut best = Sized { log_likelihood: none, root: DMatrix::zeros(k, 0) };
    if k == 0 {
        return Some(best);
    }
    for preference in [Preference::Common, Preference::Alike] {
        let scale = DVector::from_fn(k, |i, _| {
            let (own, left) = (weighed.products[(p + i, p + i)], beside[(i, i)]);
            match preference {
                _ if left <= MADE_UP * own || left <= 0.0 => 0.0,
                Preference::Common => 1.0,
                Preference::Alike => left.sqrt().recip(),
            }
        });
        let gram = DMatrix::from_fn(k, k, |i, j| scale[i] * beside[(i, j)] * scale[j]);
        if !gram.iter().all(|v| v.is_finite()) {
            continue;
        }
        let eigen = SymmetricEigen::new(gram);
        let cross = eigen.eigenvectors.tr_mul(&beside.view((0, k), (k, 1)).column(0).component_mul(&scale));
        let (gain, size) = largest(&eigen.eigenvalues, &cross);
        let log_likelihood = none + gain - KINDS.ln();
        if log_likelihood > best.log_likelihood {
            best = Sized { log_likelihood, root: DMatrix::from_diagonal(&(scale * size.sqrt())) };
        }
    }
    let (gain, root) = one(&weighed.products, &beside, (p, k), single);
    let log_likelihood = none + gain - KINDS.ln();
    if log_likelihood > best.log_likelihood {
        best = Sized { log_likelihood, root };
    }
    Some(best)
}

/// The gain of the best nonlinearity of one function, less the logarithm of their number, and its directions times their deviations.
fn one(
    products: &DMatrix<f64>,
    beside: &DMatrix<f64>,
    (p, k): (usize, usize),
    single: Singles<'_>,
) -> (f64, DMatrix<f64>) {
    let (own, left) = (products.view((p, p), (k, k)), beside.view((0, 0), (k, k)));
    let cross = beside.view((0, k), (k, 1)).into_owned();
    let mut best = (0.0, DMatrix::zeros(k, 0));
    let functions = single.combinations.nrows() / single.alike;
    for function in 0..functions {
        let directions = single.combinations.rows(function * single.alike, single.alike).transpose();
        let (energy, left) = (directions.tr_mul(&(own * &directions)), directions.tr_mul(&(left * &directions)));
        if (0..single.alike).any(|i| left[(i, i)] <= MADE_UP * energy[(i, i)]) {
            continue;
        }
        let Some(factor) = left.cholesky() else { continue };
        // phases of unit information each
        let Some(root) = factor.l().transpose().try_inverse() else { continue };
        let directions = directions * root;
        let each = directions.tr_mul(&cross).norm_squared() / single.alike as f64;
        if !(each > 1.0 && each.is_finite()) {
            continue;
        }
        // the variance of the coefficients at which the likelihood is greatest
        let gain = 0.5 * single.alike as f64 * (each - 1.0 - each.ln()) - (functions as f64).ln();
        if gain > best.0 {
            best = (gain, directions * (each - 1.0).sqrt());
        }
    }
    best
}

/// Factor of the fitted parameters' products; none where nothing is fitted.
type Fitted = Option<Cholesky<f64, Dyn>>;

/// That factor, and what is left of all others beside them.
fn beside(products: &DMatrix<f64>, p: usize) -> Option<(Fitted, DMatrix<f64>)> {
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
    fn new(cells: &[BandProducts], spectra: &[SmoothSpectrum]) -> Self {
        let width = cells[0].products.nrows();
        let mut products = DMatrix::zeros(width, width);
        let (mut log, mut density) = (0.0, Vec::with_capacity(cells.len()));
        for cell in cells {
            let s = spectra[cell.channel].at(cell.log_frequency).max(f64::MIN_POSITIVE);
            products.zip_apply(&cell.products, |sum, v| *sum += v / s);
            log += cell.bins * s.ln();
            density.push(s);
        }
        Self { products, log, density }
    }

    /// Smooth spectra of what parameters and nonlinearity leave, by those that were found before.
    fn spectra(
        &self,
        banded: &Banded,
        p: usize,
        root: &DMatrix<f64>,
        spectra: &[SmoothSpectrum],
    ) -> Option<Vec<SmoothSpectrum>> {
        let Banded { cells, highest, narrow } = banded;
        let (size, rank) = (p + root.nrows(), root.ncols());
        // coefficients in units of their deviations, parameters as they are
        let mut unit = DMatrix::zeros(size, p + rank);
        unit.view_mut((0, 0), (p, p)).fill_with_identity();
        unit.view_mut((p, p), (size - p, rank)).copy_from(root);
        let own = self.products.view((0, 0), (size, size)).into_owned();
        let mut system = unit.transpose() * &own * &unit;
        let floor = 1e-12 * (0..p).map(|i| system[(i, i)]).fold(0.0, f64::max);
        (0..p + rank).for_each(|i| system[(i, i)] += if i < p { floor } else { 1.0 });
        let inverse = if p + rank > 0 { system.cholesky()?.inverse() } else { DMatrix::zeros(0, 0) };
        let spread = &unit * inverse * unit.transpose();
        let mut found = DVector::zeros(size + 1);
        found.rows_mut(0, size).copy_from(&(-&spread * self.products.view((0, size), (size, 1))));
        found[size] = 1.0;
        let channels = cells.iter().map(|c| c.channel).max()? + 1;
        let mut left: Vec<Vec<ResidualPower>> = vec![Vec::new(); channels];
        for (cell, density) in cells.iter().zip(&self.density) {
            let own = cell.products.view((0, 0), (size, size));
            let freedom = cell.bins - own.dot(&spread) / density;
            let power = (&cell.products * &found).dot(&found).max(0.0);
            if freedom > LEAST_FREEDOM {
                left[cell.channel].push(ResidualPower {
                    log_frequency: cell.log_frequency,
                    power: power / freedom,
                    freedom,
                });
            }
        }
        // bands are as narrow as the resonances of the noise want them
        let fitted = |(channel, wide): (usize, Vec<ResidualPower>)| {
            let narrow = if *narrow { wide.clone() } else { Vec::new() };
            let left = BandedPower { narrow, wide, highest: *highest };
            (!left.wide.is_empty()).then(|| SmoothSpectrum::fit(&left, spectra.get(channel)))
        };
        left.into_iter().enumerate().map(fitted).collect()
    }
}

/// All bands of all outputs.
pub(super) struct Banded {
    pub(super) cells: Vec<BandProducts>,
    /// The Nyquist frequency.
    pub(super) highest: f64,
    /// Whether some are narrow, for a resonance: in wide ones none can be seen.
    pub(super) narrow: bool,
}

/// One output in a narrow band, all runs together.
pub(super) struct BandProducts {
    pub(super) channel: usize,
    pub(super) log_frequency: f64,
    pub(super) bins: f64,
    /// Products of sensitivities (p), responses (K) and residual (1) with each other.
    pub(super) products: DMatrix<f64>,
}

/// Bins of every run that belong to a band.
pub(super) struct Band {
    log_frequency: f64,
    rows: Vec<Range<usize>>,
    /// For a resonance.
    narrow: bool,
}

/// Bands that do not overlap and hold bins enough of all runs; narrow ones where the noise has resonances.
pub(super) fn bands(binned_runs: &[BinnedRun], resonances: &[&Resonance]) -> Vec<Band> {
    let mut bins: Vec<f64> = binned_runs.iter().flat_map(|s| s.frequency.iter().copied()).collect();
    bins.sort_by(f64::total_cmp);
    let runs = binned_runs.len();
    let width = |f: f64| resonances.iter().map(|r| r.even(f, WIDE.0)).fold(WIDE.0, f64::min);
    let (mut bands, mut first) = (Vec::new(), 0);
    while first < bins.len() {
        let own = width(bins[first]);
        let narrow = own < WIDE.0;
        let fewest = if narrow { runs } else { WIDE.1 * runs };
        let mut last = bins.partition_point(|f| *f < bins[first] * own).max(first + fewest);
        if !narrow && let Some(end) = (first + 1..last.min(bins.len())).find(|k| width(bins[*k]) < WIDE.0) {
            last = end;
        }
        if bins.len() < last + fewest {
            last = bins.len();
        }
        let edge = bins.get(last).copied().unwrap_or(f64::INFINITY);
        let rows = |s: &BinnedRun| {
            s.frequency.partition_point(|f| *f < bins[first])..s.frequency.partition_point(|f| *f < edge)
        };
        let own = &bins[first..bins.partition_point(|f| *f < edge)];
        let log_frequency = own.iter().map(|f| f.ln()).sum::<f64>() / own.len() as f64;
        bands.push(Band { log_frequency, rows: binned_runs.iter().map(rows).collect(), narrow });
        first += own.len().max(1);
    }
    bands
}

/// Cells of all outputs; `hats` are responses in all runs, the same functions in each, or none.
pub(super) fn cells(binned_runs: &[BinnedRun], bands: &[Band], responses: Option<&[CourseResponses]>) -> Banded {
    let p = binned_runs[0].fitted[0].ncols();
    let k = responses.map_or(0, |h| h[0][0].ncols());
    let one = |channel: usize, band: &Band| {
        let count: usize = band.rows.iter().map(ExactSizeIterator::len).sum();
        let mut columns = DMatrix::zeros(count, p + k + 1);
        let mut row = 0;
        for (run, (binned, rows)) in binned_runs.iter().zip(&band.rows).enumerate() {
            let (start, n) = (rows.start, rows.len());
            columns.view_mut((row, 0), (n, p)).copy_from(&binned.fitted[channel].rows(start, n));
            if let Some(responses) = responses {
                let own = &responses[run][channel];
                // responses end where nothing of them is left
                let told = own.nrows().saturating_sub(start).min(n);
                columns.view_mut((row, p), (told, k)).copy_from(&own.rows(start.min(own.nrows()), told));
            }
            columns.view_mut((row, p + k), (n, 1)).copy_from(&binned.residual.view((start, channel), (n, 1)));
            row += n;
        }
        let products = columns.transpose() * columns;
        BandProducts { channel, log_frequency: band.log_frequency, bins: count as f64, products }
    };
    let channels = 0..binned_runs[0].channels();
    let cells = channels.flat_map(|channel| bands.iter().map(move |band| one(channel, band))).collect();
    Banded { cells, highest: highest(binned_runs), narrow: bands.iter().any(|band| band.narrow) }
}
