//! The likelihood of residuals that are noise of a smooth spectrum in every output, and of those that hold the response to a
//! random disturbance besides.
//!
//! With the disturbance's course f ~ N(0, g D) and the response X to it, residuals r of a fit with sensitivities J have the
//! covariance S + g X D X'. With G = D^1/2 X' S^-1 X D^1/2 = V L V' everything is a sum over eigenvalues, for all g at
//! once; the fitted parameters are integrated over (restricted likelihood, Patterson & Thompson 1971). The spectra are found
//! together with g: what the disturbance explains is not noise, and the other way round.
//!
//! The noise of every output, as smooth spectra of what is left over, in bands of neighbouring bins.

use super::binned_run::BinnedRun;
use crate::noise::{BandedPower, PENALTY, ResidualPower, SmoothSpectrum};
use nalgebra::{Cholesky, DMatrix, DVector, DVectorView, Dyn, SymmetricEigen};

/// Eigenvalues below this share of the largest say nothing.
const SILENT: f64 = 1e-12;
/// Rounds of spectra from what a disturbance leaves over, and disturbance by spectra.
const ROUNDS: usize = 4;
/// Strengths of a disturbance that are compared first, as powers of ten of the inverse of the largest eigenvalue.
const STRENGTHS: std::ops::Range<i32> = -2..8;

/// Responses of one run to the hats at one place: low bins by hats, for each output.
pub(super) type CourseResponses = Vec<DMatrix<f64>>;

/// Products of one run under given spectra.
struct Products {
    /// Sum of log S, and r'r/S.
    log: f64,
    squares: f64,
    /// J'J/S and J'r/S.
    fitted: DMatrix<f64>,
    residual: DVector<f64>,
    disturbance: Option<Disturbance>,
}

/// The disturbance's part: U = S^-1/2 X V L^-1/2.
struct Disturbance {
    /// L, in no order.
    values: DVector<f64>,
    /// V (hats by eigenvalues).
    vectors: DMatrix<f64>,
    /// U' J / sqrt S (eigenvalues by p), U' r / sqrt S.
    fitted: DMatrix<f64>,
    residual: DVector<f64>,
}

/// Strength of a disturbance and the likelihood that it gives.
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
    /// Logarithm of the likelihood with the fitted parameters at their values, not integrated over: comparable between
    /// models.
    pub(super) profile: f64,
}

/// What is left of each bin, and how much of it was free: residuals (L by q) and 1 - h.
pub(super) struct Rest {
    pub(super) residual: DMatrix<f64>,
    pub(super) freedom: DMatrix<f64>,
}

/// Finds spectra and strength together, from spectra to begin with.
pub(super) fn settle(binned_runs: &[BinnedRun], responses: Option<&[CourseResponses]>, start: &Spectra) -> Settled {
    let mut spectra = start.clone();
    let mut best: Option<Settled> = None;
    for _ in 0..ROUNDS {
        let densities: Vec<Density> = binned_runs.iter().map(|s| spectra.density(s)).collect();
        let products = products(binned_runs, responses, &densities);
        let level = strongest(&products);
        let settled = Settled {
            strength: level.strength,
            score: level.log_likelihood - spectra.penalty(),
            profile: profile(&products, level.strength) - spectra.penalty(),
            spectra: spectra.clone(),
        };
        if best.as_ref().is_none_or(|b| settled.score > b.score) {
            best = Some(settled);
        }
        let rests = rests(binned_runs, responses, &densities, &products, level.strength);
        let next = Spectra::fit(binned_runs, &rests, &spectra);
        if next == spectra {
            break;
        }
        spectra = next;
    }
    best.unwrap_or(Settled { spectra, strength: 0.0, score: f64::NEG_INFINITY, profile: f64::NEG_INFINITY })
}

fn products(binned_runs: &[BinnedRun], responses: Option<&[CourseResponses]>, densities: &[Density]) -> Vec<Products> {
    let one = |(run, (binned, density)): (usize, (&BinnedRun, &Density))| {
        let p = binned.fitted[0].ncols();
        let (mut fitted, mut residual) = (DMatrix::zeros(p, p), DVector::zeros(p));
        let (mut log, mut squares) = (0.0, 0.0);
        let mut gram = responses.map(|h| DMatrix::zeros(h[run][0].ncols(), h[run][0].ncols()));
        let mut cross = responses.map(|h| DMatrix::zeros(h[run][0].ncols(), p + 1));
        for channel in 0..binned.channels() {
            let weight = density.channel(channel).map(|s| 1.0 / s.sqrt());
            log -= 2.0 * weight.iter().map(|w| w.ln()).sum::<f64>();
            let columns = weighed(&binned.fitted[channel], &weight);
            let own = binned.residual.column(channel).component_mul(&weight);
            squares += own.norm_squared();
            fitted += columns.tr_mul(&columns);
            residual += columns.tr_mul(&own);
            let (Some(gram), Some(cross), Some(responses)) = (&mut gram, &mut cross, responses) else { continue };
            let responses = weighed(&responses[run][channel], &weight);
            let low = responses.nrows();
            gram.gemm_tr(1.0, &responses, &responses, 1.0);
            cross.columns_mut(0, p).gemm_tr(1.0, &responses, &columns.rows(0, low), 1.0);
            cross.column_mut(p).gemv_tr(1.0, &responses, &own.rows(0, low), 1.0);
        }
        let disturbance = gram.zip(cross).map(|(gram, cross)| Disturbance::new(gram, &cross, p));
        Products { log, squares, fitted, residual, disturbance }
    };
    binned_runs.iter().zip(densities).enumerate().map(one).collect()
}

/// The first rows of a matrix, each times its weight.
fn weighed(columns: &DMatrix<f64>, weight: &DVector<f64>) -> DMatrix<f64> {
    let mut result = columns.clone();
    for mut column in result.column_iter_mut() {
        column.iter_mut().zip(weight.iter()).for_each(|(value, w)| *value *= w);
    }
    result
}

impl Disturbance {
    fn new(mut gram: DMatrix<f64>, cross: &DMatrix<f64>, p: usize) -> Self {
        // numbers that overflow have no eigenvalues: the disturbance is silent there
        if !gram.iter().chain(cross.iter()).all(|v| v.is_finite()) {
            gram.fill(0.0);
        }
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
            let Some(disturbance) = run.disturbance.as_ref().filter(|_| strength > 0.0) else { continue };
            let shrink = disturbance.shrink(strength);
            let mut shrunk = disturbance.fitted.clone();
            shrunk.row_iter_mut().zip(shrink.iter()).for_each(|(mut row, s)| row *= *s);
            sums.fitted -= disturbance.fitted.tr_mul(&shrunk);
            sums.residual -= shrunk.tr_mul(&disturbance.residual);
            sums.squares -= disturbance.residual.iter().zip(shrink.iter()).map(|(u, s)| s * u * u).sum::<f64>();
            sums.log += disturbance.values.iter().map(|l| (strength * l).ln_1p()).sum::<f64>();
        }
        sums
    }

    /// J'C^-1 J with what keeps it regular where a disturbance can do all that a parameter can.
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
    let largest = products.iter().filter_map(|p| p.disturbance.as_ref()).map(|f| f.values.max()).fold(0.0, f64::max);
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

/// What is left of the bins, and how free it was.
fn rests(
    binned_runs: &[BinnedRun],
    responses: Option<&[CourseResponses]>,
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
        let (binned, density, own) = (&binned_runs[run], &densities[run], &products[run]);
        let (bins, q) = (binned.frequency.len(), binned.channels());
        let mut rest = Rest { residual: DMatrix::zeros(bins, q), freedom: DMatrix::zeros(bins, q) };
        let disturbance = own.disturbance.as_ref().filter(|_| strength > 0.0);
        let shrink = disturbance.map(|f| f.shrink(strength));
        for channel in 0..q {
            let weight = density.channel(channel).map(|s| 1.0 / s.sqrt());
            let mut columns = weighed(&binned.fitted[channel], &weight);
            let mut left = binned.residual.column(channel).component_mul(&weight);
            let mut leverage: DVector<f64> = DVector::zeros(bins);
            if let (Some(disturbance), Some(shrink), Some(responses)) = (disturbance, &shrink, responses) {
                let mut basis = weighed(&responses[run][channel], &weight) * &disturbance.vectors;
                for (k, mut column) in basis.column_iter_mut().enumerate() {
                    column /= disturbance.values[k].sqrt();
                }
                let low = basis.nrows();
                let absorbed = disturbance.residual.component_mul(shrink);
                left.rows_mut(0, low).gemv(-1.0, &basis, &absorbed, 1.0);
                let mut shrunk = disturbance.fitted.clone();
                shrunk.row_iter_mut().zip(shrink.iter()).for_each(|(mut row, s)| row *= *s);
                columns.rows_mut(0, low).gemm(-1.0, &basis, &shrunk, 1.0);
                for (bin, row) in basis.row_iter().enumerate() {
                    leverage[bin] += row.iter().zip(shrink.iter()).map(|(u, s)| s * u * u).sum::<f64>();
                }
            }
            left.gemv(-1.0, &columns, &theta, 1.0);
            let turned = &columns * &root;
            for (bin, row) in turned.row_iter().enumerate() {
                leverage[bin] += row.norm_squared();
                rest.residual[(bin, channel)] = left[bin] / weight[bin];
                rest.freedom[(bin, channel)] = (1.0 - leverage[bin]).max(0.0);
            }
        }
        rest
    };
    (0..binned_runs.len()).map(one).collect()
}

/// The course of a disturbance at one place with its deviation, run by run, as ordinates of its hats (in the basis of D^1/2).
pub(super) fn course(
    binned_runs: &[BinnedRun],
    responses: &[CourseResponses],
    settled: &Settled,
) -> Vec<(DVector<f64>, DMatrix<f64>)> {
    let densities: Vec<Density> = binned_runs.iter().map(|s| settled.spectra.density(s)).collect();
    let products = products(binned_runs, Some(responses), &densities);
    let (g, sums) = (settled.strength, Sums::new(&products, settled.strength));
    let p = sums.residual.len();
    let theta = sums.factor().filter(|_| p > 0).map_or_else(|| DVector::zeros(p), |f| f.solve(&sums.residual));
    let one = |own: &Products| {
        let size = responses[0][0].ncols();
        let Some(disturbance) = own.disturbance.as_ref() else {
            return (DVector::zeros(size), DMatrix::identity(size, size));
        };
        let left = &disturbance.residual - &disturbance.fitted * &theta;
        let weights = DVector::from_fn(disturbance.values.len(), |k, _| {
            let l = disturbance.values[k];
            g * l.sqrt() / (1.0 + g * l) * left[k]
        });
        let mut covariance = DMatrix::identity(disturbance.vectors.nrows(), disturbance.vectors.nrows()) * g;
        for (k, v) in disturbance.vectors.column_iter().enumerate() {
            let l = disturbance.values[k];
            covariance.ger(-g * (g * l / (1.0 + g * l)), &v, &v, 1.0);
        }
        (&disturbance.vectors * weights, covariance)
    };
    products.iter().map(one).collect()
}

/// Ratio of the frequencies at which neighbouring bands begin, and the fewest bins of one for each run: of bands by which smooth spectra
/// are fitted, and of those in which resonances are seen.
pub(super) const WIDE: (f64, usize) = (1.25, 4);
const NARROW: (f64, usize) = (1.02, 1);
/// Freedom of a band below which it was fitted away.
const LEAST_FREEDOM: f64 = 0.2;
/// The share of bins, at the upper end, in which a floor is looked for.
const UPPER: f64 = 0.4;

/// S at every bin of a run (L by q).
#[derive(Debug, Clone)]
pub(super) struct Density {
    values: DMatrix<f64>,
}

impl Density {
    pub(super) fn channel(&self, channel: usize) -> DVectorView<'_, f64> {
        self.values.column(channel)
    }
}

/// A smooth spectrum for each output.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Spectra {
    pub(super) channels: Vec<SmoothSpectrum>,
    /// By how much each beats a white one, less what it costs.
    pub(super) coloured: Vec<f64>,
}

impl Spectra {
    /// White noise as strong as the residual in its upper bins, where models have nothing to say.
    pub(super) fn floor(binned_runs: &[BinnedRun]) -> Self {
        let q = binned_runs[0].channels();
        let of = |channel: usize| {
            let (mut sum, mut count) = (0.0, 0.0);
            for binned in binned_runs {
                let bins = binned.frequency.len();
                let upper = ((1.0 - UPPER) * bins as f64) as usize;
                sum += binned.residual.column(channel).rows(upper, bins - upper).norm_squared();
                count += (bins - upper) as f64;
            }
            SmoothSpectrum::white(sum / count)
        };
        Self { channels: (0..q).map(of).collect(), coloured: vec![0.0; q] }
    }

    /// Of what is left, by spectra that were found before.
    fn fit(binned_runs: &[BinnedRun], rests: &[Rest], before: &Self) -> Self {
        let q = binned_runs[0].channels();
        let (channels, coloured) = (0..q)
            .map(|channel| {
                let left = banded(binned_runs, rests, channel);
                let before = before.channels.get(channel);
                let (own, white) = (SmoothSpectrum::fit(&left, before), SmoothSpectrum::level(&left.wide));
                let told = if own.resonance().is_some() { &left.narrow } else { &left.wide };
                let gain = 0.5 * (white.twice_loss(told) - own.twice_loss(told)) - (own.penalty() - PENALTY);
                (own, gain)
            })
            .unzip();
        Self { channels, coloured }
    }

    pub(super) fn density(&self, binned: &BinnedRun) -> Density {
        let logs: Vec<f64> = binned.frequency.iter().map(|f| f.ln()).collect();
        let values = DMatrix::from_fn(logs.len(), self.channels.len(), |bin, channel| {
            self.channels[channel].at(logs[bin]).max(f64::MIN_POSITIVE)
        });
        Density { values }
    }

    /// What the spectra cost in log-likelihood.
    pub(super) fn penalty(&self) -> f64 {
        self.channels.iter().map(SmoothSpectrum::penalty).sum()
    }
}

/// The Nyquist frequency of the runs.
pub(super) fn highest(binned_runs: &[BinnedRun]) -> f64 {
    binned_runs.iter().map(|binned| 0.5 / binned.interval).fold(0.0, f64::max)
}

/// What is left of one output in bands of neighbouring bins, all runs together.
fn banded(binned_runs: &[BinnedRun], rests: &[Rest], channel: usize) -> BandedPower {
    let mut bins: Vec<Bin> = Vec::new();
    for (binned, rest) in binned_runs.iter().zip(rests) {
        let own = rest.residual.column(channel).into_iter().zip(rest.freedom.column(channel));
        let of = |(f, (r, freedom)): (&f64, (&f64, &f64))| Bin { frequency: *f, power: r * r, freedom: *freedom };
        bins.extend(binned.frequency.iter().zip(own).map(of));
    }
    bins.sort_by(|a, b| a.frequency.total_cmp(&b.frequency));
    let runs = binned_runs.len();
    let of = |(width, fewest): (f64, usize)| cells(&bins, (width, fewest * runs));
    BandedPower { wide: of(WIDE), narrow: of(NARROW), highest: highest(binned_runs) }
}

/// What is left of one bin, and how free it was.
struct Bin {
    frequency: f64,
    power: f64,
    freedom: f64,
}

/// Bins, by rising frequency, in bands of this width (a ratio) and of so many at least.
fn cells(bins: &[Bin], (width, fewest): (f64, usize)) -> Vec<ResidualPower> {
    let mut cells = Vec::new();
    let mut first = 0;
    while first < bins.len() {
        let mut last = first + fewest.min(bins.len() - first);
        while last < bins.len() && bins[last].frequency < bins[first].frequency * width {
            last += 1;
        }
        if bins.len() - last < fewest {
            last = bins.len();
        }
        let own = &bins[first..last];
        let freedom: f64 = own.iter().map(|l| l.freedom).sum();
        if freedom > LEAST_FREEDOM {
            let log_frequency = own.iter().map(|l| l.frequency.ln()).sum::<f64>() / own.len() as f64;
            cells.push(ResidualPower {
                log_frequency,
                power: own.iter().map(|l| l.power).sum::<f64>() / freedom,
                freedom,
            });
        }
        first = last;
    }
    cells
}
