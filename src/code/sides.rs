//! Both derivatives of a model at one point: what its programs of partials say, and what a complex step finds in the
//! programs without partials (Squire and Trapp 1998).
//!
//! Equations are counted through: rates, outputs, initial values, delays; leaves: states, drive, parameters.

use super::complex::{ComplexPoint, evaluate};
use super::rounding::Rounding;
use super::scatter::{Nominal, Scatter};
use crate::dynamics::Point;
use fdm_grammar::model::Model;
use fdm_grammar::schedule::{Layout, Schedule};
use num_complex::Complex64;
use std::ops::Range;

/// Its square is below the last digit of everything, so the step has no error of truncation.
const STEP: f64 = 1e-30;
/// Part of it by which slopes that look infinite are asked again.
const CLOSER: f64 = 1e-20;

/// Disturbed evaluations from which rounding is estimated, and how much more there may be of it.
pub(super) const DISTURBANCES: usize = 3;
const MARGIN: f64 = 16.0;
/// The same for a step, and for both where the two sides differ: each misses a single operation half of the time.
const SUSPICIONS: usize = 16;

/// Where a model is looked at.
pub(super) struct Site {
    pub(super) t: f64,
    pub(super) theta: Vec<f64>,
    pub(super) x: Vec<f64>,
    pub(super) drive: Vec<f64>,
}

/// The symbolic side at one point.
pub(super) struct Symbolic {
    /// The equations themselves.
    pub(super) values: Vec<f64>,
    /// The entries of all partials, by leaf.
    pub(super) entries: Vec<Entry>,
}

impl Symbolic {
    /// The derivatives of all equations by one leaf, with what rounding may have done to them.
    pub(super) fn column(&self, leaf: usize, column: &mut [(f64, f64)]) {
        column.fill((0.0, 0.0));
        let first = self.entries.partition_point(|e| e.leaf < leaf);
        let own = self.entries[first..].iter().take_while(|e| e.leaf == leaf);
        own.for_each(|e| column[e.equation] = (e.value, e.noise));
    }
}

/// A partial that the patterns know.
#[derive(Clone, Copy)]
pub(super) struct Entry {
    pub(super) equation: usize,
    pub(super) leaf: usize,
    pub(super) value: f64,
    /// What rounding may have done to the value.
    pub(super) noise: f64,
}

/// Evaluates both sides.
pub(super) struct Sides<'a> {
    schedule: &'a Schedule,
    layout: &'a Layout,
    values: Vec<Complex64>,
}

impl<'a> Sides<'a> {
    pub(super) fn new(schedule: &'a Schedule) -> Self {
        Self { schedule, layout: &schedule.layout, values: Vec::new() }
    }

    /// How many can be differentiated by.
    pub(super) fn leaves(&self) -> usize {
        self.layout.states + self.layout.drive() + self.layout.params
    }

    /// How many are differentiated.
    pub(super) fn equations(&self) -> usize {
        2 * self.layout.states + self.layout.outputs + self.layout.tau.len()
    }

    pub(super) fn site(&self, model: &Model, mut scatter: Scatter, nominal: &Nominal) -> Site {
        let theta = scatter.theta(model, &nominal.theta);
        let known = self.known(&theta, &mut Rounding::exact());
        let home = nominal.x.as_deref().unwrap_or(&known[self.layout.initial.clone()]);
        let x: Vec<f64> = home[..self.layout.states].iter().map(|x| scatter.around(*x)).collect();
        let drive = scatter.drive(self.layout, nominal.drive.as_deref(), &x);
        Site { t: scatter.time(nominal.t), theta, x, drive }
    }

    fn known(&self, theta: &[f64], rounding: &mut Rounding) -> Vec<f64> {
        rounding.evaluate(&self.schedule.prepare, Point { t: 0.0, x: &[], drive: &[], known: theta })
    }

    /// The values of all equations, from the programs without partials.
    pub(super) fn values(&self, site: &Site) -> Vec<f64> {
        let mut rounding = Rounding::exact();
        let known = self.known(&site.theta, &mut rounding);
        let at = Point { t: site.t, x: &site.x, drive: &site.drive, known: &known };
        let mut values = rounding.evaluate(&self.schedule.rates, at);
        values.extend(rounding.evaluate(&self.schedule.outputs, at));
        values.extend(&known[self.layout.initial.clone()]);
        values.extend(&known[self.layout.tau.clone()]);
        values
    }

    /// All partials, and what rounding does to them.
    pub(super) fn symbolic(&self, site: &Site) -> Symbolic {
        let mut symbolic = self.evaluate(site, &mut Rounding::exact());
        self.disturb(site, &mut symbolic, 0..DISTURBANCES);
        symbolic
    }

    /// What more disturbances say of rounding, where the two sides differ.
    pub(super) fn suspect(&self, site: &Site, symbolic: &mut Symbolic) {
        self.disturb(site, symbolic, DISTURBANCES..SUSPICIONS);
    }

    fn disturb(&self, site: &Site, symbolic: &mut Symbolic, numbers: Range<usize>) {
        for number in numbers {
            let disturbed = self.evaluate(site, &mut Rounding::disturbed(number));
            for (entry, other) in symbolic.entries.iter_mut().zip(disturbed.entries) {
                entry.noise = entry.noise.max(MARGIN * (other.value - entry.value).abs());
            }
        }
    }

    fn evaluate(&self, site: &Site, rounding: &mut Rounding) -> Symbolic {
        let (layout, patterns, stage) = (self.layout, &self.layout.patterns, &self.layout.stage);
        let (n, m, q) = (layout.states, layout.inputs, layout.outputs);
        let known = self.known(&site.theta, rounding);
        let at = Point { t: site.t, x: &site.x, drive: &site.drive, known: &known };
        let rates = rounding.evaluate(&self.schedule.rates_and_partials, at);
        let outputs = rounding.evaluate(&self.schedule.outputs_and_partials, at);
        let inputs = rounding.evaluate(&self.schedule.by_input, at);

        let entry = |equation, leaf, value| Entry { equation, leaf, value, noise: 0.0 };
        let (delayed, params) = (n + m, n + layout.drive());
        let by_state = patterns.rates_by_state.entries().zip(&stage.by_state);
        let by_state = by_state.map(|((_, i, j), slot)| entry(i, j, rates[*slot as usize]));
        let by_delayed = patterns.rates_by_delayed.entries();
        let by_delayed = by_delayed.map(|(k, i, j)| entry(i, delayed + j, rates[stage.by_delayed + k]));
        let by_param = patterns.rates_by_param.entries();
        let by_param = by_param.filter_map(|(_, i, j)| Some(entry(i, params + j, rates[stage.by_param(i, j)?])));
        let mut entries: Vec<Entry> = by_state.chain(by_delayed).chain(by_param).collect();

        let (after_state, after_delayed) = (q + patterns.outputs_by_state.len(), patterns.outputs_by_delayed.len());
        // pattern, its first equation and leaf, its entries
        let plain = [
            (&patterns.rates_by_input, 0, n, &inputs[..]),
            (&patterns.outputs_by_input, n, n, &inputs[patterns.rates_by_input.len()..]),
            (&patterns.outputs_by_state, n, 0, &outputs[q..]),
            (&patterns.outputs_by_delayed, n, delayed, &outputs[after_state..]),
            (&patterns.outputs_by_param, n, params, &outputs[after_state + after_delayed..]),
            (&patterns.initial_by_param, n + q, params, &known[layout.initial_by_param.clone()]),
            (&patterns.tau_by_param, n + q + n, params, &known[layout.tau_by_param.clone()]),
        ];
        for (pattern, equation, leaf, values) in plain {
            entries.extend(pattern.entries().map(|(k, i, j)| entry(equation + i, leaf + j, values[k])));
        }
        let mut values = [&rates[..n], &outputs[..q]].concat();
        values.extend(&known[layout.initial.clone()]);
        values.extend(&known[layout.tau.clone()]);
        entries.sort_by_key(|e| e.leaf);
        Symbolic { values, entries }
    }

    /// The derivatives of all equations by one leaf, structural zeros included.
    pub(super) fn numeric(&mut self, site: &Site, leaf: usize) -> Vec<f64> {
        self.stepped(site, leaf, STEP, &mut Rounding::exact())
    }

    /// The same by a step so much smaller that it finds more where a slope is infinite, and the same where it is not.
    pub(super) fn numeric_closer(&mut self, site: &Site, leaf: usize) -> Vec<f64> {
        self.stepped(site, leaf, CLOSER * STEP, &mut Rounding::exact())
    }

    /// What rounding may have done to them: the step, too, loses digits where terms cancel.
    pub(super) fn numeric_noise(&mut self, site: &Site, leaf: usize, exact: &[f64]) -> Vec<f64> {
        let mut noise = vec![0.0_f64; exact.len()];
        for number in 0..SUSPICIONS {
            let disturbed = self.stepped(site, leaf, STEP, &mut Rounding::disturbed(number));
            for ((noise, other), value) in noise.iter_mut().zip(disturbed).zip(exact) {
                *noise = noise.max(MARGIN * (other - value).abs());
            }
        }
        noise
    }

    fn stepped(&mut self, site: &Site, leaf: usize, step: f64, rounding: &mut Rounding) -> Vec<f64> {
        let mut leaves: Vec<Complex64> =
            site.x.iter().chain(&site.drive).chain(&site.theta).map(|v| Complex64::from(*v)).collect();
        leaves[leaf].im = step;
        let (x, rest) = leaves.split_at(self.layout.states);
        let (drive, theta) = rest.split_at(self.layout.drive());
        let at = |known| ComplexPoint { t: site.t, x, drive, known };
        let known = evaluate(&self.schedule.prepare, at(theta), &mut self.values, rounding);
        let mut results = evaluate(&self.schedule.rates, at(&known), &mut self.values, rounding);
        results.extend(evaluate(&self.schedule.outputs, at(&known), &mut self.values, rounding));
        results.extend(&known[self.layout.initial.clone()]);
        results.extend(&known[self.layout.tau.clone()]);
        results.into_iter().map(|z| z.im / step).collect()
    }
}
