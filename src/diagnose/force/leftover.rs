//! Whether residuals are noise: noise of a sensor has nothing in common with the inputs.
//!
//! In every band of lines the residual of an output is regressed on an input and its quadrature, with one gain and phase
//! for all runs, and on what lightly damped modes make of the input. For noise whose spectrum is flat across the band the share that
//! they explain has the distribution of a Beta variate, whatever the noise's power there: nothing that a spectrum can
//! swallow. The least chance of all is judged by what it is for residuals that are drawn as noise, with the fit taken out of
//! them. (What is not linear in the inputs is asked for by `law`.)

use super::bands::{Band, WIDTHS, bands};
use super::coherence::{Coherence, Partner};
use super::ground::Ground;
use super::modes::{Mode, modes};
use super::place::Passage;
use super::quadrature::Quadrature;
use super::sheet::{Cosines, DROPPED, Sheet};
use super::spectra::{Density, Spectra};
use crate::diagnose::screen::{Normal, exceedance};
use crate::model::Model;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::Serialize;
use statrs::distribution::{ContinuousCDF, Gamma};

/// Draws of residuals that are noise.
const DRAWS: usize = 200;
/// Most findings that are told.
const TOLD: usize = 12;

/// Whether residuals are noise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Leftover {
    /// The chance that noise looks as much like what the inputs do: a cause that repeats.
    pub repeatable: f64,
    /// What stands out, by rising chance, at most one band for every output and partner.
    pub coherences: Vec<Coherence>,
}

/// Asks whether the residuals of a fit are noise.
pub(super) fn leftover(model: &Model, passages: &[Passage<'_>], ground: &Ground) -> Leftover {
    // output by output: what their noises share does not matter
    let sheets = &ground.sheets;
    let judge = Judge::new(sheets, probes(model, passages, sheets), &ground.noise.spectra);
    let residuals: Vec<DMatrix<f64>> = sheets.iter().map(|s| s.residual.clone()).collect();
    let found = judge.tests(&judge.whitened(residuals));
    let mut drawn: Vec<f64> = (0..DRAWS as u64).into_par_iter().map(|seed| judge.draw(seed)).collect();
    let own = least(&found);
    let repeatable = if drawn.iter().all(|v| *v <= 0.0) { 1.0 } else { exceedance(&mut drawn, own) };
    Leftover { repeatable, coherences: judge.told(model, found) }
}

/// A signal and its quadrature in a band.
struct Probe {
    partner: Partner,
    band: Band,
    /// Orthonormal (lines of all runs by 2).
    basis: DMatrix<f64>,
}

/// Inputs in all bands, and all modes of all inputs.
fn probes(model: &Model, passages: &[Passage<'_>], sheets: &[Sheet]) -> Vec<Probe> {
    let definition = model.definition();
    let m = definition.inputs.len();
    let bands = bands(sheets);
    let length = sheets.iter().map(|s| s.samples as f64 * s.interval).fold(0.0, f64::max);
    let interval = sheets.iter().map(|s| s.interval).fold(f64::INFINITY, f64::min);
    let modes = modes(length, interval);
    let mut probes = Vec::new();
    for (k, input) in definition.inputs.iter().enumerate().filter(|(_, i)| i.is_declared()) {
        let name = &input.quantity.name;
        let courses: Vec<Vec<f64>> =
            passages.iter().map(|p| p.run.inputs.iter().skip(k).step_by(m).copied().collect()).collect();
        let plain: Vec<DMatrix<f64>> = sheets
            .iter()
            .zip(&courses)
            .map(|(s, course)| Quadrature::new(s.samples).lines(&mut Cosines::new(s.samples), course))
            .collect();
        let probe = |partner: Partner, band: Band, lines: &[DMatrix<f64>]| {
            let basis = basis(&band.gathered(lines))?;
            Some(Probe { partner, band, basis })
        };
        probes.extend(bands.iter().filter_map(|b| probe(Partner::Input(name.clone()), b.clone(), &plain)));
        let of_mode = |mode: &Mode| {
            let band = Band::between(sheets, mode.frequency - mode.reach, mode.frequency + mode.reach);
            let lines: Vec<DMatrix<f64>> = sheets.iter().zip(&courses).map(|(s, c)| rung(mode, s, c)).collect();
            probe(Partner::Mode(name.clone()), band, &lines)
        };
        probes.par_extend(modes.par_iter().filter_map(of_mode));
    }
    probes
}

/// Lines of a mode's two responses (L by 2).
fn rung(mode: &Mode, sheet: &Sheet, course: &[f64]) -> DMatrix<f64> {
    let mut cosines = Cosines::new(sheet.samples);
    let mut lines = DMatrix::zeros(sheet.samples - DROPPED, 2);
    for (response, mut column) in mode.response(course, sheet.interval).into_iter().zip(lines.column_iter_mut()) {
        cosines.lines(response.into_iter(), column.as_mut_slice());
    }
    lines
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
        let chance = Gamma::new(self.bands as f64, 1.0).map_or(1.0, |gamma| gamma.sf(self.logs));
        Test { output, probe: self.probe, everywhere: true, share: self.follows / self.total, chance }
    }
}

struct Judge<'a> {
    sheets: &'a [Sheet],
    densities: Vec<Density>,
    probes: Vec<Probe>,
    /// Takes the fit out of drawn residuals: (J'J/S)^-1.
    fitted: DMatrix<f64>,
}

impl<'a> Judge<'a> {
    fn new(sheets: &'a [Sheet], probes: Vec<Probe>, spectra: &Spectra) -> Self {
        let densities: Vec<Density> = sheets.iter().map(|s| spectra.density(s)).collect();
        let p = sheets[0].fitted[0].ncols();
        let mut products = DMatrix::zeros(p, p);
        for (sheet, density) in sheets.iter().zip(&densities) {
            for channel in 0..sheet.channels() {
                let mut weighed = sheet.fitted[channel].clone();
                for mut column in weighed.column_iter_mut() {
                    column.component_div_assign(&density.channel(channel));
                }
                products += weighed.tr_mul(&sheet.fitted[channel]);
            }
        }
        let fitted = products.cholesky().map_or_else(|| DMatrix::zeros(p, p), |c| c.inverse());
        Self { sheets, densities, probes, fitted }
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
        let q = self.sheets[0].channels();
        let mut tests = Vec::with_capacity(q * (self.probes.len() + WIDTHS.len()));
        for output in 0..q {
            let mut together = [Together::default(); WIDTHS.len()];
            for (k, probe) in self.probes.iter().enumerate() {
                if k > 0 && self.probes[k - 1].partner != probe.partner {
                    tests.extend(together.iter().filter(|t| t.bands > 1).map(|t| t.test(output)));
                    together = Default::default();
                }
                let (follows, total) = probe.against(white, output);
                if total <= 0.0 {
                    continue;
                }
                let share = (follows / total).min(1.0);
                let chance = (1.0 - share).powf((probe.band.lines() as f64 - 2.0) / 2.0);
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
        let mut normal = Normal::new(seed + 5000);
        let p = self.fitted.nrows();
        let mut score = DVector::zeros(p);
        let mut drawn: Vec<DMatrix<f64>> = Vec::new();
        for (sheet, density) in self.sheets.iter().zip(&self.densities) {
            let mut noise = DMatrix::zeros(sheet.frequency.len(), sheet.channels());
            for (channel, mut column) in noise.column_iter_mut().enumerate() {
                column.iter_mut().zip(density.channel(channel).iter()).for_each(|(v, s)| *v = s.sqrt() * normal.next());
                score += sheet.fitted[channel].tr_mul(&column.component_div(&density.channel(channel)));
            }
            drawn.push(noise);
        }
        let theta = &self.fitted * score;
        for (sheet, noise) in self.sheets.iter().zip(&mut drawn) {
            for (channel, mut column) in noise.column_iter_mut().enumerate() {
                column.gemv(-1.0, &sheet.fitted[channel], &theta, 1.0);
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
    /// Squares of what of an output's whitened lines follows, and of all of them.
    fn against(&self, white: &[DMatrix<f64>], output: usize) -> (f64, f64) {
        let (first, second) = self.basis.as_slice().split_at(self.basis.nrows());
        let (mut a, mut b, mut total, mut row) = (0.0, 0.0, 0.0, 0);
        for (white, rows) in white.iter().zip(&self.band.rows) {
            let lines = &white.as_slice()[output * white.nrows()..][rows.clone()];
            let own = first[row..].iter().zip(&second[row..]);
            for (v, (one, other)) in lines.iter().zip(own) {
                a += v * one;
                b += v * other;
                total += v * v;
            }
            row += rows.len();
        }
        (a * a + b * b, total)
    }
}
