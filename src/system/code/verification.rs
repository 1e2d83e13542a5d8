//! What `fdm check` runs before anyone trusts a derivative: every partial of every program against the derivative that
//! a complex step finds in the program without partials (Squire and Trapp 1998), structural zeros included.
//!
//! Equations are counted through: rates, outputs, initial values, delays, limits, guards of events and what these set; leaves: states, drive, parameters.
//!
//! How many digits of a program's results are worth comparing: every rounding disturbed (the idea of Vignes' stochastic arithmetic, 1993), at
//! points around nominal values that are the same on every machine.

use super::expressions::{ComplexPoint, evaluate};
use crate::dynamics::Point;
use fdm_grammar::graph::{Leaf, Names};
use fdm_grammar::model::Model;
use fdm_grammar::schedule::{Layout, Operand, Program, Schedule};
use num_complex::Complex64;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;

/// Relative deviations above this are failures. Both derivatives are exact up to rounding, and what rounding does
/// to the symbolic one is measured and allowed for; a term that weighs less than this everywhere harms no estimation.
pub const TOLERANCE: f64 = 1e-8;

/// Slopes that are zero for every purpose: on the way to them numbers lose their digits.
const NOTHING: f64 = 1e-90;

/// Slopes that are infinite for every purpose, and by how much a step across one finds more when it is made smaller.
const INFINITE: f64 = 1e100;
const STEEPER: f64 = 1e3;

/// Points that are compared, when the model is not so large that fewer must do.
const POINTS: usize = 12;

/// Points that are tried for each one wanted.
const TRIALS: usize = 4;

/// Operations that may be spent: a fraction of a second, so that checking stays quicker than compiling.
const BUDGET: usize = 10_000_000;

/// Directions in which all leaves of a large model are moved at once.
const DIRECTIONS: usize = 6;

/// An entry whose two derivatives differ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Discrepancy {
    /// What was differentiated: `der(x)`, an output, the initial value `x(0)`, the time of a `delay(...)`.
    pub equation: String,
    /// By what it was differentiated; nothing when it is the value itself that differs between two programs.
    pub by: Option<String>,
    /// What the program of partials says.
    pub symbolic: f64,
    /// What the complex step found.
    pub numeric: f64,
    /// Their difference, relative to the greater of them; less where rounding explains it.
    pub relative: f64,
}

/// What a verification found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Verification {
    /// Points at which everything was compared.
    pub points: usize,
    /// Points that were passed over because an equation had no finite value there.
    pub skipped: usize,
    /// Comparisons made, structural zeros included.
    pub compared: usize,
    /// Directions in which all leaves were moved at once at a point, since the model is too large for one after the other; else 0.
    pub directions: usize,
    /// The largest deviation, failure or not; none when everything was equal.
    pub worst: Option<Discrepancy>,
    /// Entries beyond [`TOLERANCE`], each at its worst point, ordered by equation.
    pub failures: Vec<Discrepancy>,
}

impl Verification {
    /// Whether there was a point to compare at, and no failure.
    pub fn passed(&self) -> bool {
        self.points > 0 && self.failures.is_empty()
    }
}

/// Compares all partials of a model at points around the nominal ones.
///
/// Near kinks (`abs`, `min`, `if`) both derivatives take the branch of the real values, so they agree there too.
///
/// # Panics
/// When `nominal` has fewer values than the model.
pub fn verify(model: &Model, schedule: &Schedule, nominal: &Nominal) -> Verification {
    let mut comparison = Comparison::new(model, schedule);
    let wanted = comparison.affordable();
    for k in 0..wanted * TRIALS {
        if comparison.found.points == wanted {
            break;
        }
        let site = comparison.sides.site(model, Scatter::new(k), nominal);
        if comparison.sides.values(&site).iter().all(|v| v.is_finite()) {
            comparison.found.points += 1;
            comparison.compare(&site);
        } else {
            comparison.found.skipped += 1;
        }
    }
    comparison.finish()
}

struct Comparison<'a> {
    model: &'a Model,
    schedule: &'a Schedule,
    layout: &'a Layout,
    sides: Sides<'a>,
    found: Verification,
    /// Failures by equation and leaf (none: the value).
    failures: BTreeMap<(usize, Option<usize>), Discrepancy>,
}

impl<'a> Comparison<'a> {
    fn new(model: &'a Model, schedule: &'a Schedule) -> Self {
        let (layout, found, failures) = (&schedule.layout, Verification::default(), BTreeMap::new());
        Self { model, schedule, layout, sides: Sides::new(schedule), found, failures }
    }

    fn affordable(&self) -> usize {
        let s = self.schedule;
        let sum = |programs: [&Program; 3]| programs.map(|p| p.instructions.len()).into_iter().sum::<usize>();
        let plain = sum([&s.prepare, &s.rates, &s.outputs]) + self.sides.equations();
        let partials = sum([&s.rates_and_partials, &s.outputs_and_partials, &s.by_input]);
        (BUDGET / (self.sides.leaves() * plain + (1 + DISTURBANCES) * partials + 1)).clamp(1, POINTS)
    }

    fn compare(&mut self, site: &Site) {
        let mut symbolic = self.sides.symbolic(site);
        for (i, value) in self.sides.values(site).into_iter().enumerate() {
            self.judge(i, None, (symbolic.values[i], 0.0), value);
        }
        if self.is_large() && self.agrees_in_all_directions(site, &symbolic) {
            return;
        }
        let mut column = vec![(0.0, 0.0); self.sides.equations()];
        let free: Vec<usize> = (0..self.sides.leaves()).filter(|leaf| self.is_free(*leaf)).collect();
        let mut suspected = false;
        for leaf in free {
            symbolic.column(leaf, &mut column);
            let numeric = self.sides.numeric(site, leaf);
            let apart =
                |((symbolic, noise), numeric): (&(f64, f64), &f64)| deviation(*symbolic, *numeric, *noise) > TOLERANCE;
            if column.iter().zip(&numeric).any(apart) {
                if !std::mem::replace(&mut suspected, true) {
                    self.sides.suspect(site, &mut symbolic);
                    symbolic.column(leaf, &mut column);
                }
                let noise = self.sides.numeric_noise(site, leaf, &numeric);
                column.iter_mut().zip(noise).for_each(|((_, own), other)| *own += other);
            }
            let closer = column.iter().any(|(v, _)| is_infinite(*v)).then(|| self.sides.numeric_closer(site, leaf));
            for (i, numeric) in numeric.into_iter().enumerate() {
                // the slope of a root at zero, which a step finds the steeper the smaller it is
                let steep = |closer: &Vec<f64>| closer[i].abs() > STEEPER * numeric.abs();
                if !(is_infinite(column[i].0) && closer.as_ref().is_some_and(steep)) {
                    self.judge(i, Some(leaf), column[i], numeric);
                }
            }
        }
    }

    /// Whether steps of one leaf after the other, each through all equations, would take too long.
    fn is_large(&self) -> bool {
        let s = self.schedule;
        let plain = [&s.prepare, &s.rates, &s.outputs].map(|p| p.instructions.len()).into_iter().sum::<usize>();
        // budgets that one point may take leaf by leaf; beyond, all leaves are moved at once
        (plain + self.sides.equations()).saturating_mul(self.sides.leaves()) > 4 * BUDGET
    }

    /// Moves all leaves at once, in random directions: what a step finds is the sum of all partials of an equation along the direction, structural
    /// zeros included, at the cost of one evaluation. False where an equation differs, or has a partial that is not finite: then leaf by leaf.
    fn agrees_in_all_directions(&mut self, site: &Site, symbolic: &Symbolic) -> bool {
        let before = (self.found.compared, self.found.worst.clone());
        let leaves: Vec<f64> = site.x.iter().chain(&site.drive).chain(&site.theta).copied().collect();
        for number in 0..DIRECTIONS {
            let mut chance = Scatter::new(number);
            let direction = leaves.iter().enumerate().map(|(leaf, value)| {
                let size = if *value == 0.0 || !value.is_finite() { 1.0 } else { value.abs() };
                let part = chance.uniform();
                if self.is_free(leaf) { size * part } else { 0.0 }
            });
            let direction: Vec<f64> = direction.collect();
            let mut sums = vec![(0.0, 0.0, 0.0); self.sides.equations()];
            for entry in symbolic.entries.iter().filter(|e| direction[e.leaf] != 0.0) {
                let along = direction[entry.leaf];
                let (sum, size, noise) = &mut sums[entry.equation];
                *sum += entry.value * along;
                *size += (entry.value * along).abs();
                *noise += entry.noise * along.abs();
            }
            let steps: Vec<f64> = direction.iter().map(|v| v * STEP).collect();
            let numeric = self.sides.moved(site, &steps, &mut Rounding::exact());
            for (equation, ((sum, size, noise), numeric)) in sums.into_iter().zip(numeric).enumerate() {
                let numeric = numeric / STEP;
                if !numeric.is_finite() {
                    // overflow on the way
                    continue;
                }
                let relative = (sum - numeric).abs() / (size + noise / TOLERANCE + NOTHING);
                if relative.is_nan() || relative > TOLERANCE {
                    (self.found.compared, self.found.worst) = before;
                    return false;
                }
                self.found.compared += 1;
                if relative > 0.0 && self.found.worst.as_ref().is_none_or(|worst| relative > worst.relative) {
                    let (equation, by) = (self.equation_name(equation), Some("all variables".into()));
                    self.found.worst = Some(Discrepancy { equation, by, symbolic: sum, numeric, relative });
                }
            }
        }
        self.found.directions = DIRECTIONS;
        true
    }

    /// Fixed parameters are not differentiated by.
    fn is_free(&self, leaf: usize) -> bool {
        let param = leaf.checked_sub(self.layout.states + self.layout.drive());
        param.is_none_or(|k| !self.model.params[k].fixed)
    }

    /// Compares the symbolic value with the numeric one; rounding may have made the noise in either.
    fn judge(&mut self, equation: usize, leaf: Option<usize>, (symbolic, noise): (f64, f64), numeric: f64) {
        if !numeric.is_finite() {
            // overflow on the way
            return;
        }
        self.found.compared += 1;
        if symbolic == numeric {
            return;
        }
        let relative = deviation(symbolic, numeric, noise);
        let beyond = |d: Option<&Discrepancy>| d.is_none_or(|d| relative > d.relative);
        let (worst, fails) = (beyond(self.found.worst.as_ref()), relative > TOLERANCE);
        let fails = fails && beyond(self.failures.get(&(equation, leaf)));
        if worst || fails {
            let (equation_name, by) = (self.equation_name(equation), leaf.map(|l| self.leaf_name(l)));
            let discrepancy = Discrepancy { equation: equation_name, by, symbolic, numeric, relative };
            if worst {
                self.found.worst = Some(discrepancy.clone());
            }
            if fails {
                self.failures.insert((equation, leaf), discrepancy);
            }
        }
    }

    fn equation_name(&self, k: usize) -> String {
        let (n, q) = (self.layout.states, self.layout.outputs);
        let state = |i: usize| &self.model.states[i].quantity.name;
        if k < n {
            format!("der({})", state(k))
        } else if k < n + q {
            self.model.outputs[k - n].quantity.name.clone()
        } else if k < n + q + n {
            format!("{}(0)", state(k - n - q))
        } else if k < n + q + n + self.layout.delayed.len() {
            format!("the time of {}", self.model.leaf(Leaf::Delayed((k - n - q - n) as u32)))
        } else if k < n + q + n + self.layout.delayed.len() + self.layout.limits.len() {
            let k = k - n - q - n - self.layout.delayed.len();
            format!("the {} limit of {}", ["lower", "upper"][k % 2], state(self.layout.limited[k / 2] as usize))
        } else {
            let k = k - n - q - n - self.layout.delayed.len() - self.layout.limits.len();
            match self
                .layout
                .events
                .iter()
                .position(|event| (event.first..event.first + event.states.len()).contains(&k))
            {
                Some(at) => {
                    let event = &self.layout.events[at];
                    format!("{} behind event {}", state(event.states[k - event.first] as usize), at + 1)
                }
                None if self.layout.events.is_empty() => format!("kink {} of the rates", k + 1),
                None => format!("the condition of event {}", k + 1),
            }
        }
    }

    fn leaf_name(&self, k: usize) -> String {
        let (n, m, delayed) = (self.layout.states, self.layout.inputs, self.layout.delayed.len());
        self.model.leaf(if k < n {
            Leaf::State(k as u32)
        } else if k < n + m {
            Leaf::Input((k - n) as u32)
        } else if k < n + m + delayed {
            Leaf::Delayed((k - n - m) as u32)
        } else {
            Leaf::Param((k - n - m - delayed) as u32)
        })
    }

    fn finish(mut self) -> Verification {
        self.found.failures = self.failures.into_values().collect();
        self.found
    }
}

fn is_infinite(slope: f64) -> bool {
    slope.is_nan() || slope.abs() >= INFINITE
}

/// The difference of two slopes in relation to the greater of them, less where rounding explains it.
fn deviation(symbolic: f64, numeric: f64, noise: f64) -> f64 {
    let scale = symbolic.abs().max(numeric.abs()) + noise / TOLERANCE + NOTHING;
    if symbolic.is_finite() { (symbolic - numeric).abs() / scale } else { f64::INFINITY }
}

/// Its square is below the last digit of everything, so the step has no error of truncation.
const STEP: f64 = 1e-30;
/// Part of it by which slopes that look infinite are asked again.
const CLOSER: f64 = 1e-20;

/// Disturbed evaluations from which rounding is estimated, and how much more there may be of it.
pub(super) const DISTURBANCES: usize = 3;
const MARGIN: f64 = 16.0;
/// Disturbances for a step, and for both where the two sides differ: each misses a single operation half of the time.
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
        let layout = self.layout;
        2 * layout.states + layout.outputs + layout.tau.len() + layout.limits.len() + layout.event_rows()
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
        values.extend(&known[self.layout.limits.clone()]);
        values.extend(rounding.evaluate(&self.schedule.events, at));
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
        let events = rounding.evaluate(&self.schedule.events_and_partials, at);

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
            (
                &patterns.limits_by_param,
                n + q + n + layout.delayed.len(),
                params,
                &known[layout.limits_by_param.clone()],
            ),
        ];
        let (first, rows) = (n + q + n + layout.delayed.len() + layout.limits.len(), layout.event_rows());
        let by_input = rows + patterns.events_by_state.len();
        let by_param = by_input + patterns.events_by_input.len();
        let of_events = [
            (&patterns.events_by_state, first, 0, &events[rows..]),
            (&patterns.events_by_input, first, n, &events[by_input..]),
            (&patterns.events_by_param, first, params, &events[by_param..]),
        ];
        for (pattern, equation, leaf, values) in plain.into_iter().chain(of_events) {
            entries.extend(pattern.entries().map(|(k, i, j)| entry(equation + i, leaf + j, values[k])));
        }
        let mut values = [&rates[..n], &outputs[..q]].concat();
        values.extend(&known[layout.initial.clone()]);
        values.extend(&known[layout.tau.clone()]);
        values.extend(&known[layout.limits.clone()]);
        values.extend(&events[..layout.event_rows()]);
        entries.sort_by_key(|e| e.leaf);
        Symbolic { values, entries }
    }

    /// The derivatives of all equations by one leaf, structural zeros included.
    pub(super) fn numeric(&mut self, site: &Site, leaf: usize) -> Vec<f64> {
        self.stepped(site, leaf, STEP, &mut Rounding::exact())
    }

    /// The derivatives of all equations by one leaf, by a step so much smaller that it finds more where a slope is
    /// infinite, and as much where it is not.
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
        let mut steps = vec![0.0; self.leaves()];
        steps[leaf] = step;
        let found = self.moved(site, &steps, rounding);
        found.into_iter().map(|change| change / step).collect()
    }

    /// What becomes of all equations when each leaf takes a step of its own.
    fn moved(&mut self, site: &Site, steps: &[f64], rounding: &mut Rounding) -> Vec<f64> {
        let values = site.x.iter().chain(&site.drive).chain(&site.theta);
        let leaves: Vec<Complex64> = values.zip(steps).map(|(v, step)| Complex64::new(*v, *step)).collect();
        let (x, rest) = leaves.split_at(self.layout.states);
        let (drive, theta) = rest.split_at(self.layout.drive());
        let at = |known| ComplexPoint { t: site.t, x, drive, known };
        let known = evaluate(&self.schedule.prepare, at(theta), &mut self.values, rounding);
        let mut results = evaluate(&self.schedule.rates, at(&known), &mut self.values, rounding);
        results.extend(evaluate(&self.schedule.outputs, at(&known), &mut self.values, rounding));
        results.extend(&known[self.layout.initial.clone()]);
        results.extend(&known[self.layout.tau.clone()]);
        results.extend(&known[self.layout.limits.clone()]);
        results.extend(evaluate(&self.schedule.events, at(&known), &mut self.values, rounding));
        results.into_iter().map(|z| z.im).collect()
    }
}

/// Evaluates programs, and moves each result of an operation by up to one unit of the last place.
pub(super) struct Rounding {
    state: u64,
    values: Vec<f64>,
}

impl Rounding {
    /// No disturbance: what the programs say.
    pub(super) fn exact() -> Self {
        Self { state: 0, values: Vec::new() }
    }

    /// A disturbance of its own for each number.
    pub(super) fn disturbed(number: usize) -> Self {
        Self { state: (number as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1, values: Vec::new() }
    }

    /// The results of a program; slots that it does not write stay zero.
    pub(super) fn evaluate(&mut self, program: &Program, at: Point<'_>) -> Vec<f64> {
        let operand = |operand: Operand, values: &[f64]| match operand {
            Operand::Value(k) => values[k as usize],
            Operand::Constant(k) => program.constants[k as usize],
            Operand::Time => at.t,
            Operand::State(k) => at.x[k as usize],
            Operand::Drive(k) => at.drive[k as usize],
            Operand::Known(k) => at.known[k as usize],
        };
        let mut values = std::mem::take(&mut self.values);
        values.clear();
        for (k, instruction) in program.instructions.iter().enumerate() {
            let [a, b, c] = instruction.args.map(|o| operand(o, &values));
            let value = match program.call(k) {
                Some((function, operands)) => {
                    let operands: Vec<f64> = operands.iter().map(|o| operand(*o, &values)).collect();
                    function.compute(instruction.op, &operands)
                }
                None => (instruction.op.row().value)(a, b, c),
            };
            // conditions are decisions, not numbers with a last place
            values.push(if instruction.op.is_condition() { value } else { self.round(value) });
        }
        let mut results = vec![0.0; program.width];
        for result in &program.results {
            results[result.slot as usize] = operand(result.operand, &values);
        }
        self.values = values;
        results
    }

    /// A result, moved.
    pub(super) fn round(&mut self, value: f64) -> f64 {
        if self.state == 0 {
            return value;
        }
        self.state ^= self.state << 13;
        self.state ^= self.state >> 7;
        self.state ^= self.state << 17;
        match self.state >> 62 {
            0 => value.next_up(),
            1 => value.next_down(),
            _ => value,
        }
    }
}

/// Where a model is at home: the middle of the points at which it is looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct Nominal {
    /// Time since the run began, in the model's time unit.
    pub t: f64,
    /// Parameters (p), in the model's order and units.
    pub theta: Vec<f64>,
    /// States (n); `None` for the initial values that the parameters give.
    pub x: Option<Vec<f64>>,
    /// Inputs (m), then delayed signals; `None` for zero inputs and the states themselves.
    pub drive: Option<Vec<f64>>,
}

impl Nominal {
    /// The start values of the parameters at the beginning of a run that nothing drives.
    pub fn start(model: &Model) -> Self {
        Self { t: 0.0, theta: model.start(), x: None, drive: None }
    }
}

/// Shares of the values by which points lie apart, in turn: near ones where the model is certainly defined, far ones
/// where every branch is seen.
const SPREADS: [f64; 6] = [0.1, 1.0, 0.01, 0.3, 3.0, 0.001];

/// Moves numbers about.
pub(super) struct Scatter {
    state: u64,
    spread: f64,
}

impl Scatter {
    /// For the point of this number.
    pub(super) fn new(point: usize) -> Self {
        Self { state: (point as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15), spread: SPREADS[point % SPREADS.len()] }
    }

    /// Between -1 and 1 (Marsaglia's xorshift, multiplied).
    pub(super) fn uniform(&mut self) -> f64 {
        self.state ^= self.state >> 12;
        self.state ^= self.state << 25;
        self.state ^= self.state >> 27;
        let bits = self.state.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11;
        bits as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// A number near this one, or near zero when it is none.
    pub(super) fn around(&mut self, value: f64) -> f64 {
        let value = if value.is_finite() { value } else { 0.0 };
        let scale = if value == 0.0 { 1.0 } else { value.abs() };
        value + self.spread * scale * self.uniform()
    }

    /// A time at or after the beginning.
    pub(super) fn time(&mut self, value: f64) -> f64 {
        self.around(value).abs()
    }

    /// Parameters within their bounds; a step that would leave them goes part of the way to the bound.
    pub(super) fn theta(&mut self, model: &Model, nominal: &[f64]) -> Vec<f64> {
        let within = |(param, value): (&fdm_grammar::model::Param, &f64)| {
            let moved = self.around(*value);
            let bound = if moved < param.lower { param.lower } else { param.upper };
            match (param.lower..=param.upper).contains(&moved) || !value.is_finite() {
                true => moved,
                false => value + 0.9 * self.uniform().abs() * (bound - value),
            }
        };
        model.params.iter().zip(nominal).map(within).collect()
    }

    /// Inputs and delayed signals; where nothing is said, inputs around zero and delayed signals around theirs.
    pub(super) fn drive(&mut self, layout: &Layout, nominal: Option<&[f64]>, x: &[f64]) -> Vec<f64> {
        use fdm_grammar::graph::Signal;
        let value = |k: usize| match (nominal.and_then(|d| d.get(k)), k.checked_sub(layout.inputs)) {
            (Some(value), _) => *value,
            (None, Some(delayed)) => match layout.delayed[delayed] {
                Signal::State(i) => x[i as usize],
                Signal::Input(_) => 0.0,
            },
            (None, None) => 0.0,
        };
        (0..layout.drive()).map(|k| self.around(value(k))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::code::specimen::{blank, quantity, random, ship};
    use crate::code::{Engine, compile};
    use crate::dynamics::{Point, Workspace};
    use fdm_grammar::model::Output;
    use fdm_grammar::op::{Build, Form, Op, ROWS};
    use fdm_grammar::schedule::{Instruction, Operand};

    fn check(model: &Model, schedule: &Schedule) -> Verification {
        verify(model, schedule, &Nominal::start(model))
    }

    /// The ship with a delay, an input in an output, and initial values that depend on parameters.
    fn rich() -> Model {
        let mut model = ship();
        let g = &mut model.graph;
        let (tau, c, d) = (g.leaf(Leaf::Param(1)), g.leaf(Leaf::Param(2)), g.leaf(Leaf::Input(0)));
        let tau = g.apply(Op::Exp, &[tau]);
        let late = g.delay(fdm_grammar::graph::Signal::State(0), tau);
        let product = g.apply(Op::Mul, &[late, c]);
        let sum = g.apply(Op::Add, &[product, d]);
        model.outputs.push(Output::new(quantity("late"), sum));
        let rate = model.states[2].rate;
        model.states[2].rate = g.apply(Op::Add, &[rate, product]);
        model.states[1].initial = g.apply(Op::Mul, &[c, c]);
        model
    }

    #[test]
    fn exact_derivatives_pass() {
        let mut model = rich();
        let schedule = Schedule::new(&mut model);
        let found = check(&model, &schedule);
        assert!(found.passed(), "{found:?}");
        assert_eq!((found.points, found.skipped), (POINTS, 0));
        let (equations, leaves) = (3 + 4 + 3 + 1, 3 + 1 + 1 + 11);
        assert_eq!(found.compared, POINTS * equations * (leaves + 1), "the whole matrix, zeros included");
        assert!(found.worst.is_none_or(|d| d.relative < 1e-13));
    }

    #[test]
    fn equations_solved_for_derivatives_pass() {
        let text = "model m { input u, w; state p = 0.1, r = 0.3, v = 0.4, s;
            param ixx = 2.1, izz = 3.4, ixz = 0.3, k = 0.7, tau = 0.2 in [0, 1];
            ixx*(1 + s^2)*der(p) - ixz*der(r) + k*der(v) = delay(u + k*der(u), tau) - p*r;
            izz*der(r) - ixz*der(p) = sin(w) - r*abs(r); (if p > 0 then k else 1)*der(v) - p*der(r) = der(u*w) - v;
            der(s*exp(p)) = sqrt(1 + der(v)^2); output y = der(v) + k*der(delay(s*u, tau)), z = p; }";
        let compiled =
            fdm_grammar::compile(&fdm_grammar::Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}"));
        let found = check(&compiled.model, &compiled.schedule);
        assert!(found.passed() && found.points == POINTS, "{found:?}");
    }

    #[test]
    fn slopes_that_a_step_cannot_find_pass() {
        let bodies = [
            "state x = 0.3, z = 1e-6; der(x) = sqrt(log(cos(z^3))); der(z) = -z;",
            "state x = 0.3, z = 0.2; der(x) = deadzone(z/a*(if 0 < 0 then 0 else a), 0); der(z) = -z;",
            "state x = 0.3, z = 0.2; der(x) = log10(abs(tan(acos(1e-7*z)))); der(z) = -z;",
            "state x = 0.3, z = 0.2; der(x) = deadzone(clip(0, b, z), deadzone(hypot(z, 0), 0)); der(z) = -z;",
        ];
        for body in bodies {
            let text = format!("model m {{ {body} param a = 1, b = 0.5 in [0, 3]; output y = a*b*x; }}");
            let compiled =
                fdm_grammar::compile(&fdm_grammar::Source::new("m.fdm", text)).unwrap_or_else(|e| panic!("{e:?}"));
            let found = check(&compiled.model, &compiled.schedule);
            assert!(found.passed() && found.points == POINTS, "{body}: {found:?}");
        }
    }

    #[test]
    fn models_that_nobody_would_write_pass() {
        for seed in 0..2000 {
            let mut model = random(seed, false);
            let schedule = Schedule::new(&mut model);
            let found = check(&model, &schedule);
            // an infinite slope times zero is NaN in the symbolic derivative: a fit would stop there, so it is told
            let wrong: Vec<_> = found.failures.iter().filter(|d| d.symbolic.is_finite()).collect();
            assert!(wrong.is_empty(), "{seed}: {wrong:#?}");
        }
    }

    /// The operation as an output of a model with three states.
    fn alone(op: Op) -> Model {
        let mut model = blank(3, 0, &[]);
        let args = [0, 1, 2].map(|k| model.graph.leaf(Leaf::State(k)));
        let expr = model.graph.apply(op, &args[..op.row().arity]);
        model.outputs.push(Output::new(quantity(op.row().name), expr));
        model
    }

    #[test]
    fn every_operation_by_complex_step_and_by_differences() {
        for row in ROWS.iter().filter(|row| row.form != Form::External) {
            let mut model = alone(row.op);
            let schedule = Schedule::new(&mut model);
            let nominal = Nominal { x: Some(vec![0.6, 0.3, -0.4]), ..Nominal::start(&model) };
            let found = verify(&model, &schedule, &nominal);
            assert!(found.passed(), "{}: {found:#?}", row.name);

            let tape = compile(&schedule, Engine::Tape);
            let mut work = Workspace::new(&*tape);
            let outputs = |x: &[f64], out: &mut [f64], partials: bool, work: &mut Workspace| {
                let at = Point { t: 0.0, x, drive: &[], known: &[0.0; 3] };
                if partials { tape.outputs_and_partials(at, out, work) } else { tape.outputs(at, out, work) }
            };
            for x in [[0.6, 0.3, -0.4], [0.2, 0.9, 1.5]] {
                let mut exact = vec![0.0; schedule.layout.output_slots()];
                outputs(&x, &mut exact, true, &mut work);
                let mut dense = [0.0; 3];
                for (k, _, j) in schedule.layout.patterns.outputs_by_state.entries() {
                    dense[j] = exact[1 + k];
                }
                for j in 0..3 {
                    let mut sides = [0.0; 2];
                    for (side, h) in sides.iter_mut().zip([1e-6, -1e-6]) {
                        let mut moved = x;
                        moved[j] += h;
                        outputs(&moved, std::slice::from_mut(side), false, &mut work);
                    }
                    let difference = (sides[0] - sides[1]) / 2e-6;
                    assert!((difference - dense[j]).abs() < 1e-8, "{} by {j}: {difference} {}", row.name, dense[j]);
                }
            }
        }
    }

    fn negate(program: &mut Program, k: usize) {
        let operand = program.results[k].operand;
        program.instructions.push(Instruction { op: Op::Neg, args: [operand; 3] });
        program.results[k].operand = Operand::Value(program.instructions.len() as u32 - 1);
    }

    fn clear(program: &mut Program, k: usize) {
        program.constants.push(0.0);
        program.results[k].operand = Operand::Constant(program.constants.len() as u32 - 1);
    }

    #[test]
    fn every_wrong_entry_is_caught() {
        let mut model = rich();
        let schedule = Schedule::new(&mut model);
        let programs: [fn(&mut Schedule) -> &mut Program; 3] =
            [|s| &mut s.rates_and_partials, |s| &mut s.outputs_and_partials, |s| &mut s.by_input];
        for program in programs {
            for k in 0..program(&mut schedule.clone()).results.len() {
                for spoil in [negate, clear] {
                    let mut wrong = schedule.clone();
                    spoil(program(&mut wrong), k);
                    let found = check(&model, &wrong);
                    assert_eq!(found.failures.len(), 1, "result {k}: {:#?}", found.failures);
                    assert!(!found.passed() && found.worst.as_ref() == found.failures.first());
                }
            }
        }
        for k in schedule.layout.initial_by_param.clone().chain(schedule.layout.tau_by_param.clone()) {
            let mut wrong = schedule.clone();
            negate(&mut wrong.prepare, k);
            assert!(!check(&model, &wrong).failures.is_empty(), "known {k}");
        }
    }

    #[test]
    fn a_zero_that_is_none_is_caught_and_named() {
        let mut model = rich();
        let schedule = Schedule::new(&mut model);
        let patterns = &schedule.layout.patterns;
        for (position, i, j) in patterns.rates_by_state.entries() {
            let mut wrong = schedule.clone();
            let pattern = &mut wrong.layout.patterns.rates_by_state;
            pattern.columns.remove(position);
            pattern.rows[i + 1..].iter_mut().for_each(|r| *r -= 1);
            wrong.layout.stage.by_state.remove(position);
            let found = check(&model, &wrong);
            assert_eq!(found.failures.len(), 1, "{i} {j}");
            assert_eq!(found.failures[0].equation, format!("der(x{i})"));
            assert_eq!((found.failures[0].by.as_deref(), found.failures[0].symbolic), (Some(&*format!("x{j}")), 0.0));
        }
        for (position, i, j) in patterns.rates_by_param.entries() {
            let mut wrong = schedule.clone();
            let pattern = &mut wrong.layout.patterns.rates_by_param;
            pattern.columns.remove(position);
            pattern.rows[i + 1..].iter_mut().for_each(|r| *r -= 1);
            let found = check(&model, &wrong);
            assert_eq!((found.failures.len(), found.failures[0].by.as_deref()), (1, Some(&*format!("p{j}"))));
        }
    }

    /// A chain of so many states, each driven by its neighbours and one parameter.
    fn chain(count: u32) -> Model {
        let mut model = blank(count as usize, 0, &[0.7]);
        let k = model.graph.leaf(Leaf::Param(0));
        for i in 0..count {
            let (own, next) = (model.graph.leaf(Leaf::State(i)), model.graph.leaf(Leaf::State((i + 1) % count)));
            let product = model.graph.apply(Op::Mul, &[own, k]);
            let wave = model.graph.apply(Op::Sin, &[next]);
            model.states[i as usize].rate = model.graph.apply(Op::Add, &[product, wave]);
        }
        model
    }

    #[test]
    fn all_leaves_of_a_large_model_are_moved_at_once() {
        let mut model = chain(9000);
        let schedule = Schedule::new(&mut model);
        let found = check(&model, &schedule);
        assert!(found.passed() && found.directions == DIRECTIONS, "{:?}", found.failures);
        assert_eq!(found.compared, found.points * 2 * 9000 * (DIRECTIONS + 1), "rates and initial values");
        assert!(found.worst.is_some_and(|worst| worst.relative < 1e-12));
    }

    #[test]
    fn directions_find_every_wrong_entry() {
        let mut model = chain(12);
        let schedule = Schedule::new(&mut model);
        let agrees = |schedule: &Schedule| {
            let mut comparison = Comparison::new(&model, schedule);
            let site = comparison.sides.site(&model, Scatter::new(0), &Nominal::start(&model));
            let symbolic = comparison.sides.symbolic(&site);
            comparison.agrees_in_all_directions(&site, &symbolic)
        };
        assert!(agrees(&schedule));
        let mut entries = 0;
        for k in 0..schedule.rates_and_partials.results.len() {
            // the rates themselves are compared apart
            if (schedule.rates_and_partials.results[k].slot as usize) < 12 {
                continue;
            }
            for spoil in [negate, clear] {
                let mut wrong = schedule.clone();
                spoil(&mut wrong.rates_and_partials, k);
                assert!(!agrees(&wrong), "result {k}");
                entries += 1;
            }
        }
        assert!(entries >= 2 * 24, "{entries}");
        for (position, i, _) in schedule.layout.patterns.rates_by_state.entries() {
            let mut wrong = schedule.clone();
            let pattern = &mut wrong.layout.patterns.rates_by_state;
            pattern.columns.remove(position);
            pattern.rows[i + 1..].iter_mut().for_each(|r| *r -= 1);
            wrong.layout.stage.by_state.remove(position);
            assert!(!agrees(&wrong), "{position}");
        }
    }

    #[test]
    fn fixed_parameters_are_not_asked_for() {
        let mut model = rich();
        model.params[0].fixed = true;
        let schedule = Schedule::new(&mut model);
        assert!(check(&model, &schedule).passed());
    }

    #[test]
    fn a_model_without_a_usable_point_does_not_pass() {
        let mut model = blank(1, 0, &[]);
        let x = model.graph.leaf(Leaf::State(0));
        let (square, one) = (model.graph.apply(Op::Mul, &[x, x]), model.graph.number(-1.0));
        let below = model.graph.apply(Op::Sub, &[one, square]);
        model.states[0].rate = model.graph.apply(Op::Log, &[below]);
        let schedule = Schedule::new(&mut model);
        let found = check(&model, &schedule);
        assert_eq!((found.points, found.skipped, found.compared), (0, POINTS * TRIALS, 0));
        assert!(!found.passed() && found.failures.is_empty());
    }
}

#[cfg(test)]
mod disturbance_tests {
    use super::*;
    use crate::code::specimen::blank;
    use fdm_grammar::Schedule;
    use fdm_grammar::graph::Leaf;
    use fdm_grammar::op::{Build, Op};

    #[test]
    fn digits_that_cancel_are_seen() {
        let mut model = blank(2, 0, &[]);
        let g = &mut model.graph;
        let [x, y] = [0, 1].map(|k| g.leaf(Leaf::State(k)));
        let (sum, product) = (g.apply(Op::Add, &[x, y]), g.apply(Op::Mul, &[x, y]));
        model.states[0].rate = product;
        model.states[1].rate = g.apply(Op::Sub, &[sum, x]);
        let rates = Schedule::new(&mut model).rates;
        let at = Point { t: 0.0, x: &[1e8, 1.0], drive: &[], known: &[] };
        let exact = Rounding::exact().evaluate(&rates, at);
        assert_eq!(exact, [1e8, 1.0]);
        let spread = |k: usize| {
            let errors = (0..20).map(|n| (Rounding::disturbed(n).evaluate(&rates, at)[k] - exact[k]) / exact[k]);
            errors.fold(0.0, |m: f64, e| m.max(e.abs()))
        };
        assert!(spread(0) < 1e-15 && spread(1) > 1e-9, "{} {}", spread(0), spread(1));
    }

    #[test]
    fn parameters_stay_within_their_bounds() {
        let mut model = blank(0, 0, &[1.0, 0.0, -2.0, 5.0]);
        (model.params[0].lower, model.params[0].upper) = (0.999, 1.001);
        model.params[1].lower = 0.0;
        model.params[2].upper = -1.99;
        for point in 0..200 {
            let theta = Scatter::new(point).theta(&model, &model.start());
            for (p, value) in model.params.iter().zip(&theta) {
                assert!((p.lower..=p.upper).contains(value), "{point}: {value} in [{}, {}]", p.lower, p.upper);
            }
            assert_ne!(theta[3], 5.0);
        }
    }
}
