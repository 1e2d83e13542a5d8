//! Whether residuals are noise: noise of a sensor has nothing in common with the inputs.
//!
//! In every band of bins the residual of an output is regressed on an input and its quadrature, with one gain and phase
//! for all runs, and on what lightly damped modes make of the input. For noise whose spectrum is flat across the band the share that
//! they explain has the distribution of a Beta variate, whatever the noise's power there: nothing that a spectrum can
//! swallow. The least chance of all is judged by what it is for residuals that are drawn as noise, with the fit taken out of
//! them. (What is not linear in the inputs is asked for by `nonlinearity`.)
//!
//! What a residual hangs together with.
//!
//! Bands of bins in which a residual is held against a signal.
//!
//! Lightly damped modes that an input shakes: what rings for longer than a band of bins is wide has a phase that turns within
//! a few bins, and no constant gain and phase follow it. So every frequency is tried, a half bandwidth from the next.

use super::binned_run::BinnedRun;
use super::likelihood::{Density, Spectra};
use super::null_model::NullModel;
use super::place::FittedRun;
use crate::bins::{Cosines, DROPPED, Quadrature};
use crate::screening::exceedance;
use fdm_grammar::math;
use fdm_numeric::parallel;
use fdm_numeric::random::Stream;
use fdm_numeric::statistics::gamma_tail;
use fdm_system::model::Model;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Draws of residuals that are noise.
const DRAWS: usize = 200;
/// Most findings that are told.
const TOLD: usize = 12;

/// Whether residuals are noise.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub(crate) struct ResidualAnalysis {
    /// The chance that noise looks as much like what the inputs do: a cause that repeats.
    pub repeatable: f64,
    /// What stands out, by rising chance, at most one band for every output and partner.
    pub coherences: Vec<Coherence>,
}

/// Asks whether the residuals of a fit are noise.
pub(super) fn residual_analysis(
    model: &Model,
    fitted_runs: &[FittedRun<'_>],
    null_model: &NullModel,
) -> ResidualAnalysis {
    // output by output: what their noises share does not matter
    let binned_runs = &null_model.binned_runs;
    let judge = NoiseTest::new(binned_runs, probes(model, fitted_runs, binned_runs), &null_model.noise.spectra);
    let residuals: Vec<DMatrix<f64>> = binned_runs.iter().map(|s| s.residual.clone()).collect();
    let found = judge.tests(&judge.whitened(residuals));
    let mut drawn: Vec<f64> = parallel::map(0..DRAWS as u64, |seed| judge.draw(seed));
    let own = least(&found);
    let repeatable = if drawn.iter().all(|v| *v <= 0.0) { 1.0 } else { exceedance(&mut drawn, own) };
    ResidualAnalysis { repeatable, coherences: judge.told(model, found) }
}

/// A signal and its quadrature in a band.
struct Probe {
    partner: Partner,
    band: Band,
    /// Orthonormal (bins of all runs by 2).
    basis: DMatrix<f64>,
}

/// Inputs in all bands, and all modes of all inputs.
fn probes(model: &Model, fitted_runs: &[FittedRun<'_>], binned_runs: &[BinnedRun]) -> Vec<Probe> {
    let definition = model.definition();
    let m = definition.inputs.len();
    let bands = bands(binned_runs);
    let length = binned_runs.iter().map(|s| s.samples as f64 * s.interval).fold(0.0, f64::max);
    let interval = binned_runs.iter().map(|s| s.interval).fold(f64::INFINITY, f64::min);
    let modes = modes(length, interval);
    let mut probes = Vec::new();
    for (k, input) in definition.inputs.iter().enumerate().filter(|(_, i)| i.is_declared()) {
        let name = &input.quantity.name;
        let courses: Vec<Vec<f64>> =
            fitted_runs.iter().map(|p| p.run.inputs.iter().skip(k).step_by(m).copied().collect()).collect();
        let plain: Vec<DMatrix<f64>> = binned_runs
            .iter()
            .zip(&courses)
            .map(|(s, course)| Quadrature::new(s.samples).bins(&mut Cosines::new(s.samples), course))
            .collect();
        let probe = |partner: Partner, band: Band, bins: &[DMatrix<f64>]| {
            let basis = basis(&band.gathered(bins))?;
            Some(Probe { partner, band, basis })
        };
        probes.extend(bands.iter().filter_map(|b| probe(Partner::Input(name.clone()), b.clone(), &plain)));
        let of_mode = |mode: &LightMode| {
            let band = Band::between(binned_runs, mode.frequency - mode.reach, mode.frequency + mode.reach);
            let bins: Vec<DMatrix<f64>> = binned_runs.iter().zip(&courses).map(|(s, c)| rung(mode, s, c)).collect();
            probe(Partner::Mode(name.clone()), band, &bins)
        };
        probes.extend(parallel::filter_map(modes.iter(), of_mode));
    }
    probes
}

/// Bins of a mode's two responses (L by 2).
fn rung(mode: &LightMode, binned: &BinnedRun, course: &[f64]) -> DMatrix<f64> {
    let mut cosines = Cosines::new(binned.samples);
    let mut bins = DMatrix::zeros(binned.samples - DROPPED, 2);
    for (response, mut column) in mode.response(course, binned.interval).into_iter().zip(bins.column_iter_mut()) {
        cosines.bins(response.into_iter(), column.as_mut_slice());
    }
    bins
}

/// Two orthonormal columns, or none where there is no signal.
fn basis(columns: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let (first, second) = (columns.column(0), columns.column(1));
    let size = first.norm();
    if columns.nrows() < 4 || size <= 0.0 || !size.is_finite() {
        return None;
    }
    let first = first / size;
    let beside = second - &first * first.dot(&second);
    let rest = beside.norm();
    (rest > 1e-6 * second.norm() && rest > 0.0).then(|| DMatrix::from_columns(&[first, beside / rest]))
}

/// An output against a partner in a band, or in all bands of a width together: share and chance.
#[derive(Debug, Clone, Copy)]
struct Test {
    output: usize,
    /// Any probe of the partner; that of the band, unless it is of all of them.
    probe: usize,
    everywhere: bool,
    share: f64,
    chance: f64,
}

/// Minus the logarithm of the least chance.
fn least(tests: &[Test]) -> f64 {
    -tests.iter().map(|t| t.chance).fold(1.0, f64::min).max(f64::MIN_POSITIVE).ln()
}

/// Bands that do not overlap, taken together.
#[derive(Debug, Clone, Copy, Default)]
struct Together {
    probe: usize,
    follows: f64,
    total: f64,
    /// Sum of minus the logarithms of the chances.
    logs: f64,
    bands: usize,
}

impl Together {
    fn add(&mut self, probe: usize, (follows, total): (f64, f64), chance: f64) {
        self.probe = probe;
        self.follows += follows;
        self.total += total;
        self.logs -= chance.max(f64::MIN_POSITIVE).ln();
        self.bands += 1;
    }

    /// Fisher's: minus the logarithms of chances are exponential variates, their sum is a gamma variate.
    fn test(&self, output: usize) -> Test {
        let chance = gamma_tail(self.logs, self.bands as f64).unwrap_or(1.0);
        Test { output, probe: self.probe, everywhere: true, share: self.follows / self.total, chance }
    }
}

struct NoiseTest<'a> {
    binned_runs: &'a [BinnedRun],
    densities: Vec<Density>,
    probes: Vec<Probe>,
    /// For each output whose noise has a resonance: the bases of all probes by that noise, which is not even across a band.
    bases: Vec<Option<Vec<DMatrix<f64>>>>,
    /// Takes the fit out of drawn residuals: (J'J/S)^-1.
    fitted: DMatrix<f64>,
}

impl<'a> NoiseTest<'a> {
    fn new(binned_runs: &'a [BinnedRun], probes: Vec<Probe>, spectra: &Spectra) -> Self {
        let densities: Vec<Density> = binned_runs.iter().map(|s| spectra.density(s)).collect();
        let p = binned_runs[0].fitted[0].ncols();
        let mut products = DMatrix::zeros(p, p);
        for (binned, density) in binned_runs.iter().zip(&densities) {
            for channel in 0..binned.channels() {
                let mut weighed = binned.fitted[channel].clone();
                for mut column in weighed.column_iter_mut() {
                    column.component_div_assign(&density.channel(channel));
                }
                products += weighed.tr_mul(&binned.fitted[channel]);
            }
        }
        let fitted = products.cholesky().map_or_else(|| DMatrix::zeros(p, p), |c| c.inverse());
        let by_noise = |output: usize| {
            let of = |probe: &Probe| probe.whitened(&densities, output).unwrap_or_else(|| probe.basis.clone());
            spectra.channels[output].resonance().map(|_| parallel::map(probes.iter(), of))
        };
        let bases = (0..binned_runs[0].channels()).map(by_noise).collect();
        Self { binned_runs, densities, probes, bases, fitted }
    }

    /// Residuals over the deviation of their noise.
    fn whitened(&self, mut residuals: Vec<DMatrix<f64>>) -> Vec<DMatrix<f64>> {
        for (residual, density) in residuals.iter_mut().zip(&self.densities) {
            for (channel, mut column) in residual.column_iter_mut().enumerate() {
                column.iter_mut().zip(density.channel(channel).iter()).for_each(|(r, s)| *r /= s.sqrt());
            }
        }
        residuals
    }

    /// Every output against every partner in every band.
    fn tests(&self, white: &[DMatrix<f64>]) -> Vec<Test> {
        let q = self.binned_runs[0].channels();
        let mut tests = Vec::with_capacity(q * (self.probes.len() + WIDTHS.len()));
        for output in 0..q {
            let mut together = [Together::default(); WIDTHS.len()];
            for (k, probe) in self.probes.iter().enumerate() {
                if k > 0 && self.probes[k - 1].partner != probe.partner {
                    tests.extend(together.iter().filter(|t| t.bands > 1).map(|t| t.test(output)));
                    together = Default::default();
                }
                let basis = self.bases[output].as_ref().map_or(&probe.basis, |bases| &bases[k]);
                let (follows, total) = probe.against(basis, white, output);
                if total <= 0.0 {
                    continue;
                }
                let share = (follows / total).min(1.0);
                let chance = (1.0 - share).powf((probe.band.bins() as f64 - 2.0) / 2.0);
                tests.push(Test { output, probe: k, everywhere: false, share, chance });
                if let Some(width) = probe.band.disjoint {
                    together[width].add(k, (follows, total), chance);
                }
            }
            tests.extend(together.iter().filter(|t| t.bands > 1).map(|t| t.test(output)));
        }
        tests
    }

    /// The least chance of residuals that are noise, with the fit taken out.
    fn draw(&self, seed: u64) -> f64 {
        let mut normal = Stream::seeded(seed + 5000);
        let p = self.fitted.nrows();
        let mut score = DVector::zeros(p);
        let mut drawn: Vec<DMatrix<f64>> = Vec::new();
        for (binned, density) in self.binned_runs.iter().zip(&self.densities) {
            let mut noise = DMatrix::zeros(binned.frequency.len(), binned.channels());
            for (channel, mut column) in noise.column_iter_mut().enumerate() {
                column
                    .iter_mut()
                    .zip(density.channel(channel).iter())
                    .for_each(|(v, s)| *v = s.sqrt() * normal.normal_of_pair());
                score += binned.fitted[channel].tr_mul(&column.component_div(&density.channel(channel)));
            }
            drawn.push(noise);
        }
        let theta = &self.fitted * score;
        for (binned, noise) in self.binned_runs.iter().zip(&mut drawn) {
            for (channel, mut column) in noise.column_iter_mut().enumerate() {
                column.gemv(-1.0, &binned.fitted[channel], &theta, 1.0);
            }
        }
        least(&self.tests(&self.whitened(drawn)))
    }

    fn told(&self, model: &Model, mut tests: Vec<Test>) -> Vec<Coherence> {
        tests.sort_by(|a, b| a.chance.total_cmp(&b.chance));
        let outputs = &model.definition().outputs;
        let whole = |a: (f64, f64), p: &Probe| (a.0.min(p.band.low), a.1.max(p.band.high));
        let ends = self.probes.iter().fold((f64::INFINITY, 0.0), whole);
        let mut coherences: Vec<Coherence> = Vec::new();
        for test in tests {
            let (probe, output) = (&self.probes[test.probe], &outputs[test.output].quantity.name);
            if coherences.len() == TOLD {
                break;
            }
            if coherences.iter().any(|c| c.output == *output && c.partner == probe.partner) {
                continue;
            }
            let (low, high) = if test.everywhere { ends } else { (probe.band.low, probe.band.high) };
            let (share, chance) = (test.share, test.chance);
            coherences.push(Coherence {
                output: output.clone(),
                partner: probe.partner.clone(),
                low,
                high,
                share,
                chance,
            });
        }
        coherences
    }
}

impl Probe {
    /// Its basis over the deviations of an output's noise; none where nothing is left of it.
    fn whitened(&self, densities: &[Density], output: usize) -> Option<DMatrix<f64>> {
        let mut columns = self.basis.clone();
        let mut row = 0;
        for (density, rows) in densities.iter().zip(&self.band.rows) {
            for bin in rows.clone() {
                let deviation = density.channel(output)[bin].sqrt();
                columns.row_mut(row).iter_mut().for_each(|v| *v /= deviation);
                row += 1;
            }
        }
        basis(&columns)
    }

    /// Squares of what of an output's whitened bins follows this basis, and of all of them.
    fn against(&self, basis: &DMatrix<f64>, white: &[DMatrix<f64>], output: usize) -> (f64, f64) {
        let (first, second) = basis.as_slice().split_at(basis.nrows());
        let (mut a, mut b, mut total, mut row) = (0.0, 0.0, 0.0, 0);
        for (white, rows) in white.iter().zip(&self.band.rows) {
            let bins = &white.as_slice()[output * white.nrows()..][rows.clone()];
            let own = first[row..].iter().zip(&second[row..]);
            for (v, (one, other)) in bins.iter().zip(own) {
                a += v * one;
                b += v * other;
                total += v * v;
            }
            row += rows.len();
        }
        (a * a + b * b, total)
    }
}

/// What a residual follows.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Partner {
    /// An input.
    Input(String),
    /// A lightly damped mode that an input shakes.
    Mode(String),
}

impl Partner {
    /// The input.
    pub(crate) fn input(&self) -> &str {
        match self {
            Self::Input(name) | Self::Mode(name) => name,
        }
    }
}

/// A band in which a residual is not noise.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub(crate) struct Coherence {
    /// The output.
    pub output: String,
    /// What it follows.
    pub partner: Partner,
    /// Lowest frequency of the band, in cycles per unit of time.
    pub low: f64,
    /// Highest.
    pub high: f64,
    /// The share of the residual's power in the band that follows the partner.
    pub share: f64,
    /// The chance of such a share for noise, in this band alone.
    pub chance: f64,
}

impl std::fmt::Display for Coherence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { output, low, high, share, .. } = self;
        let share = 100.0 * share;
        match &self.partner {
            Partner::Input(name) => {
                write!(
                    f,
                    "{output}: {share:.0} % of the residual between {low:.3} and {high:.3} cycles per unit of time follows the input {name}"
                )
            }
            Partner::Mode(name) => {
                let middle = 0.5 * (low + high);
                write!(
                    f,
                    "{output}: {share:.0} % of the residual around {middle:.3} cycles per unit of time follows the input {name} through a lightly damped mode"
                )
            }
        }
    }
}

/// Widths of bands: ratio of their ends, and the fewest bins of the longest run.
pub(super) const WIDTHS: [(f64, usize); 3] = [(1.06, 6), (1.25, 10), (2.0, 20)];

/// One band: where it lies, and its bins in every run.
#[derive(Debug, Clone)]
pub(super) struct Band {
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) rows: Vec<Range<usize>>,
    /// Which of the widths it has, where it is one of those that do not overlap.
    pub(super) disjoint: Option<usize>,
}

impl Band {
    /// From one frequency to another.
    pub(super) fn between(binned_runs: &[BinnedRun], low: f64, high: f64) -> Self {
        let rows = |s: &BinnedRun| s.frequency.partition_point(|v| *v < low)..s.below(high);
        Self { low: low.max(0.0), high, rows: binned_runs.iter().map(rows).collect(), disjoint: None }
    }

    /// Bins of all runs.
    pub(super) fn bins(&self) -> usize {
        self.rows.iter().map(ExactSizeIterator::len).sum()
    }

    /// The bins of the band of all runs, one below the other.
    pub(super) fn gathered(&self, bins: &[DMatrix<f64>]) -> DMatrix<f64> {
        let mut all = DMatrix::zeros(self.bins(), bins[0].ncols());
        let mut row = 0;
        for (bins, rows) in bins.iter().zip(&self.rows) {
            all.rows_mut(row, rows.len()).copy_from(&bins.rows(rows.start, rows.len()));
            row += rows.len();
        }
        all
    }
}

/// Overlapping bands of several widths.
pub(super) fn bands(binned_runs: &[BinnedRun]) -> Vec<Band> {
    let Some(longest) = binned_runs.iter().max_by_key(|s| s.frequency.len()) else { return Vec::new() };
    let f = &longest.frequency;
    let mut bands = Vec::new();
    for (width, (ratio, fewest)) in WIDTHS.into_iter().enumerate() {
        let (mut first, mut free) = (0, 0);
        while first + fewest <= f.len() {
            let last = f.partition_point(|v| *v < f[first] * ratio).max(first + fewest).min(f.len());
            let disjoint = first >= free;
            if disjoint {
                free = last;
            }
            let band = Band::between(binned_runs, f[first], f[last - 1]);
            bands.push(Band { disjoint: disjoint.then_some(width), ..band });
            // each begins in the middle of the one before
            first += ((last - first) / 2).max(1);
        }
    }
    bands
}

/// Damping ratios that are tried, and how many bins around a mode's own are looked at on either side.
const DAMPED: [(f64, f64); 2] = [(0.01, 8.0), (0.04, 16.0)];
/// Lowest frequency, in cycles per record.
const LOWEST: f64 = 3.0;
/// Highest, as a part of the sampling frequency.
const HIGHEST: f64 = 0.45;
/// Distance of frequencies that no record tells apart, in cycles per record.
const ALIKE: f64 = 0.3;

/// A mode.
#[derive(Debug, Clone, Copy)]
pub(super) struct LightMode {
    /// Cycles per unit of time.
    pub(super) frequency: f64,
    pub(super) damping: f64,
    /// How far around it is looked, in cycles per unit of time.
    pub(super) reach: f64,
}

/// All that are tried for records of this length and interval.
pub(super) fn modes(length: f64, interval: f64) -> Vec<LightMode> {
    let mut modes = Vec::new();
    for (damping, bins) in DAMPED {
        let mut frequency = LOWEST / length;
        while frequency < HIGHEST / interval {
            modes.push(LightMode { frequency, damping, reach: bins / (2.0 * length) });
            frequency += (damping * frequency).max(ALIKE / length);
        }
    }
    modes
}

impl LightMode {
    /// Response to a signal (linear between samples) from rest at its first value, and the same a quarter of a period late.
    pub(super) fn response(&self, signal: &[f64], interval: f64) -> [Vec<f64>; 2] {
        let omega = std::f64::consts::TAU * self.frequency * interval;
        // w' = s w + u, exactly
        let s = Complex::new(-self.damping * omega, omega * (1.0 - self.damping * self.damping).sqrt());
        let keep = Complex::new(math::cos(s.im), math::sin(s.im)) * math::exp(s.re);
        let first = (keep - 1.0) / s;
        let second = (first - 1.0) / s;
        let from = signal.first().copied().unwrap_or_default();
        let (mut w, mut last) = (Complex::new(0.0, 0.0), 0.0);
        let mut both = [Vec::with_capacity(signal.len()), Vec::with_capacity(signal.len())];
        for (k, value) in signal.iter().enumerate() {
            let u = value - from;
            if k > 0 {
                w = keep * w + (first - second) * last + second * u;
            }
            last = u;
            both[0].push(w.re);
            both[1].push(w.im);
        }
        both
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_rings_as_its_equation_says() {
        // a step: x'' + 2 z w x' + w^2 x = 1 from rest, in closed form; Im w is x times the damped frequency
        let (interval, mode) = (0.05, LightMode { frequency: 0.4, damping: 0.02, reach: 1.0 });
        let mut step = vec![1.0; 200];
        step[0] = 0.0;
        step[1] = 1.0;
        let [_, x] = mode.response(&step, interval);
        let (omega, zeta) = (std::f64::consts::TAU * 0.4, 0.02_f64);
        let damped = omega * (1.0 - zeta * zeta).sqrt();
        // the ramp from 0 to 1 over the first interval is a step's integral over it
        let at = |t: f64| {
            let decay = (-zeta * omega * t).exp();
            (1.0 - decay * ((damped * t).cos() + zeta * omega / damped * (damped * t).sin())) / (omega * omega)
        };
        let steps = 2000;
        for k in [1_usize, 7, 80, 199] {
            let mean = (0..steps)
                .map(|i| at(k as f64 * interval - (i as f64 + 0.5) / f64::from(steps) * interval))
                .sum::<f64>()
                / f64::from(steps);
            let own = x[k] * interval / damped;
            assert!((own - mean).abs() < 1e-6 * mean.abs().max(0.01), "{k}: {own} {mean}");
        }
    }
}
