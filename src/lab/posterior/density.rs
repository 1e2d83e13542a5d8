//! The posterior of a model's parameters: likelihood of output error, the priors of the text, and the noise as parameters.
//!
//! With v = measured - model and deviation s of a sample its logarithm is the sum of `-v^2/(2 s^2) - log s`. A deviation is what the text says: a number,
//! an expression with parameters of its own, or nothing; then it is a parameter with a flat prior of its logarithm. Gradients are exact: sensitivities
//! are streamed and folded, nothing of the record's length is kept.
#![allow(clippy::needless_range_loop, reason = "outputs of a sample are indexed alike")]

use super::coordinates::{Free, Freed, Units};
use super::correction::{CorrectedErrors, Correction, Known};
use super::nuts::Density;
use crate::study::reached;
use fdm_estimate::{DerivedQuantities, Fit, Noise as Deviations};
use fdm_grammar::model::{Prior, Quantity};
use fdm_numeric::elementary::log;
use fdm_numeric::random::Stream;
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Block, Simulator, StepOptions, Steps, Unsuited, choose_steps};

/// What is unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// A parameter, by index, of all runs or of one.
    Param(usize, Option<usize>),
    /// The logarithm of the noise of an output.
    Deviation(usize),
}

/// One unknown.
#[derive(Debug, Clone)]
struct Unknown {
    kind: Kind,
    free: Free,
    prior: Option<Prior>,
}

/// What an unknown is called.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SampledName {
    /// The parameter; `noise y` for the deviation of an output's noise.
    pub name: String,
    /// The run that it belongs to; none when all share it.
    pub run: Option<String>,
    /// Its unit.
    pub unit: Option<String>,
}

/// The noise of an output.
#[derive(Debug, Clone, Copy)]
enum Noise {
    /// One over its deviation is this output of the model.
    Expression(usize),
    /// Its deviation.
    Known(f64),
    /// The unknown.
    Unknown(usize),
    /// It is nowhere measured.
    None,
}

/// A posterior, ready to be evaluated.
pub struct Posterior {
    model: Model,
    runs: Vec<Run>,
    /// Of each run the first that has its own parameters: itself, unless it is a replicate.
    owner: Vec<usize>,
    steps: Vec<Steps>,
    unknowns: Vec<Unknown>,
    /// All parameters of each run at the start (p).
    theta: Vec<Vec<f64>>,
    noise: Vec<Noise>,
    /// Derived quantities and the run that each is told of, run by run; shared ones of the first.
    derived: Vec<(usize, usize)>,
    derived_per_run: Vec<bool>,
    /// Coordinates of the start.
    start: Vec<f64>,
    /// How the likelihood is widened; none where its noise is what it takes it for.
    correction: Option<Correction>,
}

/// What a posterior is made of.
pub struct Given<'a> {
    /// The model; parameters that are sampled are not fixed in it.
    pub model: &'a Model,
    /// The runs.
    pub runs: Vec<Run>,
    /// Their steps.
    pub steps: Vec<Steps>,
    /// All parameters of each run where the chains begin (p).
    pub theta: Vec<Vec<f64>>,
    /// Deviation of the noise of each output (q): where it begins, and whether it is known.
    pub noise: Vec<(f64, bool)>,
}

impl Posterior {
    /// Prepares a posterior.
    ///
    /// # Errors
    /// [`Unsuited`] where a run cannot be simulated with exact derivatives.
    pub fn new(given: Given<'_>) -> Result<Self, Unsuited> {
        let Given { model, runs, steps, theta, noise } = given;
        let definition = model.definition();
        let q = definition.outputs.len();
        let own = model.clone();
        let with = definition.with_precisions().map_or(own, |with| model.altered(with));
        let elsewhere = definition.only_in_noise();
        let of_outputs = definition.only_in_output_noise();
        let sampled = |k: usize| {
            let p = &definition.params[k];
            !p.fixed && !p.is_recorded() && (!elsewhere[k] || of_outputs[k])
        };
        let mut unknowns = Vec::new();
        let mut start = Vec::new();
        let mut add = |kind: Kind, value: f64, free: Free, prior: Option<Prior>| {
            unknowns.push(Unknown { kind, free, prior });
            start.push(free.coordinate(value));
        };
        for (k, p) in definition.params.iter().enumerate().filter(|(k, _)| sampled(*k)) {
            let lower = if p.logarithmic { p.lower.max(0.0) } else { p.lower };
            let free = Free::of(lower, p.upper);
            let copies: Vec<Option<usize>> = if p.per_run { (0..runs.len()).map(Some).collect() } else { vec![None] };
            for run in copies {
                add(Kind::Param(k, run), theta[run.unwrap_or(0)][k], free, p.prior);
            }
        }
        let mut kinds = Vec::with_capacity(q);
        let mut next = q;
        for (o, output) in definition.outputs.iter().enumerate() {
            kinds.push(match (output.noise_model, noise[o]) {
                (Some(_), _) => {
                    next += 1;
                    Noise::Expression(next - 1)
                }
                _ if !runs.iter().any(|r| r.measures(o)) => Noise::None,
                (None, (deviation, true)) => Noise::Known(deviation),
                (None, (deviation, false)) => {
                    let deviation = if deviation > 0.0 { deviation } else { 1.0 };
                    add(Kind::Deviation(o), log(deviation), Free::Line, None);
                    Noise::Unknown(0)
                }
            });
        }
        for (k, unknown) in unknowns.iter().enumerate() {
            if let Kind::Deviation(o) = unknown.kind {
                kinds[o] = Noise::Unknown(k);
            }
        }
        for (run, steps) in runs.iter().zip(&steps) {
            drop(Simulator::new(with.dynamics(), run, steps.clone())?);
        }
        let derived_per_run: Vec<bool> =
            DerivedQuantities::of(with.definition(), with.dynamics()).names.iter().map(|n| n.per_run).collect();
        let each = |run: usize| derived_per_run.iter().enumerate().filter(move |(_, own)| **own || run == 0);
        let derived = (0..runs.len()).flat_map(|run| each(run).map(move |(k, _)| (k, run))).collect();
        let owner = (0..runs.len()).collect();
        Ok(Self {
            model: with,
            runs,
            owner,
            steps,
            unknowns,
            theta,
            noise: kinds,
            derived,
            derived_per_run,
            start,
            correction: None,
        })
    }

    /// This posterior with the likelihood widened about the start, until its curvature is that of these errors;
    /// unchanged where that cannot be.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn corrected(mut self, errors: &CorrectedErrors) -> Result<Self, Unsuited> {
        let definition = self.model.definition();
        let place = |unknown: &Unknown| match unknown.kind {
            Kind::Param(k, run) => {
                let (name, run) = (&definition.params[k].quantity.name, run.map(|r| self.runs[r].name.as_str()));
                errors.parameters.iter().position(|(own, of)| own == name && of.as_deref() == run)
            }
            Kind::Deviation(_) => None,
        };
        let known: Vec<Option<usize>> = self.unknowns.iter().map(place).collect();
        let places: Vec<usize> = (0..known.len()).filter(|g| known[*g].is_some()).collect();
        let rows: Vec<usize> = known.iter().flatten().copied().collect();
        let n = errors.parameters.len();
        let covariance: Vec<f64> =
            rows.iter().flat_map(|a| rows.iter().map(move |b| errors.covariance[a * n + b])).collect();
        let deviation = |(g, unknown): (usize, &Unknown)| match unknown.kind {
            Kind::Deviation(o) => {
                let name = &definition.outputs[o].quantity.name;
                Some((g, errors.squares.iter().find(|(own, _)| own == name)?.1))
            }
            Kind::Param(..) => None,
        };
        let deviations: Vec<(usize, f64)> = self.unknowns.iter().enumerate().filter_map(deviation).collect();
        let freed: Vec<Freed> = self.unknowns.iter().zip(&self.start).map(|(u, at)| u.free.at(*at)).collect();
        let slopes: Vec<f64> = freed.iter().map(|f| f.slope).collect();
        let prior = |(unknown, freed): (&Unknown, &Freed)| {
            unknown.prior.map_or((0.0, 0.0), |p| (1.0 / (p.deviation * p.deviation), freed.value - p.mean))
        };
        let priors: Vec<(f64, f64)> = self.unknowns.iter().zip(&freed).map(prior).collect();
        let fisher = self.evaluator()?.fisher(&self.start);
        let Some(fisher) = fisher else { return Ok(self) };
        self.correction = Correction::of(&Known {
            centre: &self.start,
            slopes: &slopes,
            fisher: &fisher,
            priors: &priors,
            places: &places,
            covariance: &covariance,
            deviations: &deviations,
        });
        Ok(self)
    }

    /// By how much the likelihood was widened, as factors of a deviation: in the direction of the least, and in that of the most. None where it was not.
    pub fn widened(&self) -> Option<[f64; 2]> {
        self.correction.as_ref().map(|c| c.factors)
    }

    /// The posterior of a fit of these runs by output error; noise is known as far as it was given.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_fit(fit: &Fit, runs: &[Run], given: &Deviations) -> Result<Self, Unsuited> {
        let estimated = fit.estimate.noise.as_ref();
        let known =
            |k: usize| if let Deviations::Given(given) = given { given.get(k).copied().flatten() } else { None };
        let one = |k: usize| match known(k) {
            Some(deviation) => (deviation, true),
            None => (estimated.map_or(1.0, |c| c.at(k, k).sqrt()), false),
        };
        let theta = reached(&fit.model, runs, &fit.estimate);
        let chosen = |r: usize| match fit.integration.get(r) {
            Some(found) => Ok(found.steps.clone()),
            None => choose_steps(fit.model.dynamics(), &runs[r], &theta[r], &StepOptions::default())
                .map(|found| found.steps),
        };
        let steps = (0..runs.len()).map(chosen).collect::<Result<_, _>>()?;
        let noise = (0..fit.model.layout().outputs).map(one).collect();
        Self::new(Given { model: &fit.model, runs: runs.to_vec(), steps, theta, noise })
    }

    /// The posterior of these runs and of replicates: the same runs as the model at coordinates u and its noise would have measured them. Noise is
    /// independent in replicates, so that nothing is widened. None where the response diverges.
    pub(super) fn replicated(&self, u: &[f64], stream: &mut Stream) -> Result<Option<Self>, Unsuited> {
        let mut evaluator = self.evaluator()?;
        let (mut y, mut deviation) = (Vec::new(), Vec::new());
        let mut both = self.runs.clone();
        for (r, run) in self.runs.iter().enumerate() {
            if !evaluator.predict(u, r, &mut y, &mut deviation) {
                return Ok(None);
            }
            let mut again = run.clone();
            for ((z, y), s) in again.measured.iter_mut().zip(&y).zip(&deviation).filter(|((z, _), _)| !z.is_nan()) {
                *z = y + s * stream.normal();
            }
            both.push(again);
        }
        Ok(Some(Self {
            model: self.model.clone(),
            runs: both,
            owner: self.owner.repeat(2),
            steps: [&self.steps[..], &self.steps].concat(),
            unknowns: self.unknowns.clone(),
            theta: [&self.theta[..], &self.theta].concat(),
            noise: self.noise.clone(),
            derived: self.derived.clone(),
            derived_per_run: self.derived_per_run.clone(),
            start: self.start.clone(),
            correction: None,
        }))
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.unknowns.len()
    }

    /// Coordinates of the start.
    pub(super) fn start(&self) -> &[f64] {
        &self.start
    }

    /// What the unknowns are called, and the derived quantities behind them.
    pub fn names(&self) -> Vec<SampledName> {
        let definition = self.model.definition();
        let name = |unknown: &Unknown| match unknown.kind {
            Kind::Param(k, run) => SampledName {
                name: definition.params[k].quantity.name.clone(),
                run: run.map(|r| self.runs[r].name.clone()),
                unit: definition.params[k].quantity.unit.as_ref().map(ToString::to_string),
            },
            Kind::Deviation(o) => SampledName {
                name: format!("noise {}", definition.outputs[o].quantity.name),
                run: None,
                unit: definition.outputs[o].quantity.unit.as_ref().map(ToString::to_string),
            },
        };
        let derived = self.derived.iter().map(|(k, run)| {
            let quantity = &definition.derived[*k].quantity;
            SampledName {
                name: quantity.name.clone(),
                run: self.derived_per_run[*k].then(|| self.runs[*run].name.clone()),
                unit: quantity.unit.as_ref().map(ToString::to_string),
            }
        });
        self.unknowns.iter().map(name).chain(derived).collect()
    }

    /// Parameters and deviations at coordinates, and what follows from them.
    pub(super) fn values(&self, u: &[f64]) -> Vec<f64> {
        let value = |(unknown, u): (&Unknown, &f64)| match unknown.kind {
            Kind::Param(..) => unknown.free.at(*u).value,
            Kind::Deviation(_) => u.exp(),
        };
        let mut values: Vec<f64> = self.unknowns.iter().zip(u).map(value).collect();
        if self.derived.is_empty() {
            return values;
        }
        let mut quantities = DerivedQuantities::of(self.model.definition(), self.model.dynamics());
        let mut row = vec![0.0; quantities.names.len()];
        for run in (0..self.runs.len()).filter(|run| self.owner[*run] == *run) {
            let mut theta = self.theta[run].clone();
            for (unknown, value) in self.unknowns.iter().zip(&values) {
                match unknown.kind {
                    Kind::Param(k, own) if own.is_none_or(|own| own == run) => theta[k] = *value,
                    _ => {}
                }
            }
            (quantities.evaluate)(&theta, &mut row);
            let own = self.derived.iter().filter(|(_, of)| *of == run).map(|(k, _)| row[*k]);
            let own: Vec<f64> = own.collect();
            values.extend(own);
        }
        values
    }

    /// What an output is called.
    pub(super) fn output(&self, output: usize) -> &Quantity {
        &self.model.definition().outputs[output].quantity
    }

    /// The runs.
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// A chain's own simulators and memory.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(super) fn evaluator(&self) -> Result<Evaluator<'_>, Unsuited> {
        let mut simulators = Vec::new();
        let mut columns = Vec::new();
        let mut owners = Vec::new();
        for (r, (run, steps)) in self.runs.iter().zip(&self.steps).enumerate() {
            simulators.push(Simulator::new(self.model.dynamics(), run, steps.clone())?);
            let mine = self.unknowns.iter().enumerate().filter_map(|(g, u)| match u.kind {
                Kind::Param(k, None) => Some((false, k, g)),
                Kind::Param(k, Some(own)) if own == self.owner[r] => Some((true, k, g)),
                _ => None,
            });
            let mut mine: Vec<(bool, usize, usize)> = mine.collect();
            // shared ones first, each kind in the order of the model
            mine.sort_by_key(|(own, k, _)| (*own, *k));
            columns.push(mine.iter().map(|(_, k, _)| *k).collect::<Vec<usize>>());
            owners.push(mine.iter().map(|(_, _, g)| *g).collect::<Vec<usize>>());
        }
        let n = self.unknowns.len();
        Ok(Evaluator {
            posterior: self,
            simulators,
            columns,
            owners,
            theta: self.theta.clone(),
            freed: vec![Freed::default(); n],
            by_value: vec![0.0; n],
            place: vec![0.0; n],
        })
    }
}

/// A posterior at work.
pub(super) struct Evaluator<'p> {
    posterior: &'p Posterior,
    simulators: Vec<Simulator<'p>>,
    /// Of each run the parameters that have derivatives, and the unknowns that they are.
    columns: Vec<Vec<usize>>,
    owners: Vec<Vec<usize>>,
    theta: Vec<Vec<f64>>,
    freed: Vec<Freed>,
    /// Gradient by parameters and logarithms of deviations.
    by_value: Vec<f64>,
    /// Coordinates at which the likelihood is taken.
    place: Vec<f64>,
}

/// Half of the logarithm of two pi.
const HALF_LOG_TAU: f64 = 0.918_938_533_204_672_8;

impl Evaluator<'_> {
    /// Puts the parameters of coordinates into those of the runs.
    fn take(&mut self, u: &[f64]) {
        for ((unknown, u), freed) in self.posterior.unknowns.iter().zip(u).zip(&mut self.freed) {
            *freed = unknown.free.at(*u);
            if let Kind::Param(k, run) = unknown.kind {
                let owner = &self.posterior.owner;
                let all = self.theta.iter_mut().zip(owner).filter(|(_, own)| run.is_none_or(|run| run == **own));
                all.for_each(|(theta, _)| theta[k] = freed.value);
            }
        }
    }

    /// Logarithm of the density at coordinates u, and its gradient.
    pub(super) fn log_density(&mut self, u: &[f64], gradient: &mut [f64]) -> f64 {
        let posterior = self.posterior;
        let mut place = std::mem::take(&mut self.place);
        match &posterior.correction {
            Some(correction) => correction.place(u, &mut place),
            None => place.copy_from_slice(u),
        }
        self.take(&place);
        self.place = place;
        self.by_value.fill(0.0);
        let mut sum = 0.0;
        for r in 0..posterior.runs.len() {
            let (run, noise) = (&posterior.runs[r], &posterior.noise);
            let (owners, by_value, freed) = (&self.owners[r], &mut self.by_value, &self.freed);
            let q = run.output_gaps.len();
            let mut part = 0.0;
            let mut sink = |block: Block<'_>| {
                let width = block.layout.outputs.len();
                for s in 0..block.samples() {
                    let (y, z) = (&block.y[s * width..][..width], &run.measured[(block.first + s) * q..][..q]);
                    for o in 0..q {
                        let v = z[o] - y[o];
                        if z[o].is_nan() {
                            continue;
                        }
                        let precision = match noise[o] {
                            Noise::Known(deviation) => 1.0 / deviation,
                            Noise::Unknown(g) => (-freed[g].value).exp(),
                            Noise::Expression(place) => y[place].abs(),
                            Noise::None => continue,
                        };
                        // an infinite deviation leaves the sample out
                        if precision == 0.0 {
                            continue;
                        }
                        let e = v * precision;
                        part += precision.ln() - 0.5 * e * e - HALF_LOG_TAU;
                        let weight = e * precision;
                        let own = &block.layout.outputs[o];
                        for (c, d) in own.columns.iter().zip(block.row(s, o)) {
                            by_value[owners[*c as usize]] += weight * d;
                        }
                        match noise[o] {
                            Noise::Unknown(g) => by_value[g] += e * e - 1.0,
                            Noise::Expression(place) => {
                                let weight = (1.0 - e * e) / y[place];
                                let own = &block.layout.outputs[place];
                                for (c, d) in own.columns.iter().zip(block.row(s, place)) {
                                    by_value[owners[*c as usize]] += weight * d;
                                }
                            }
                            Noise::Known(_) | Noise::None => {}
                        }
                    }
                }
            };
            let found = self.simulators[r].stream(&self.theta[r], &self.columns[r], &mut sink);
            if found.is_err() || !part.is_finite() {
                return f64::NEG_INFINITY;
            }
            sum += part;
        }
        if let Some(correction) = &posterior.correction {
            self.by_value.iter_mut().zip(&self.freed).for_each(|(g, freed)| *g *= freed.slope);
            sum = correction.widen(u, sum, &self.by_value, gradient);
            // priors and bounds are those of the place that is asked for
            self.take(u);
            let by_value = self.by_value.iter_mut().zip(&*gradient).zip(&self.freed);
            by_value.for_each(|((to, g), freed)| *to = g / freed.slope);
        }
        for (g, unknown) in posterior.unknowns.iter().enumerate() {
            let Freed { value, slope, log_jacobian, jacobian_slope } = self.freed[g];
            if let Some(Prior { mean, deviation }) = unknown.prior {
                let off = (value - mean) / deviation;
                sum -= 0.5 * off * off + deviation.ln() + HALF_LOG_TAU;
                self.by_value[g] -= off / deviation;
            }
            sum += log_jacobian;
            gradient[g] = self.by_value[g] * slope + jacobian_slope;
        }
        if gradient.iter().all(|g| g.is_finite()) { sum } else { f64::NEG_INFINITY }
    }

    /// The information of the likelihood about parameters and logarithms of deviations at coordinates u (n by n).
    pub(super) fn fisher(&mut self, u: &[f64]) -> Option<Vec<f64>> {
        self.take(u);
        let posterior = self.posterior;
        let n = posterior.unknowns.len();
        let mut matrix = vec![0.0; n * n];
        for r in 0..posterior.runs.len() {
            let (run, noise) = (&posterior.runs[r], &posterior.noise);
            let (owners, freed) = (&self.owners[r], &self.freed);
            let q = run.output_gaps.len();
            let matrix = &mut matrix;
            let mut sink = |block: Block<'_>| {
                let width = block.layout.outputs.len();
                for s in 0..block.samples() {
                    let (y, z) = (&block.y[s * width..][..width], &run.measured[(block.first + s) * q..][..q]);
                    for o in (0..q).filter(|o| !z[*o].is_nan()) {
                        let mut add = |place: usize, weight: f64| {
                            let own = &block.layout.outputs[place].columns;
                            let row = block.row(s, place);
                            for (a, x) in own.iter().zip(row).filter(|(_, x)| **x != 0.0) {
                                let g = owners[*a as usize];
                                let left = weight * x;
                                for (b, y) in own.iter().zip(row) {
                                    let h = owners[*b as usize];
                                    matrix[g * n + h] += left * y;
                                }
                            }
                        };
                        match noise[o] {
                            Noise::Known(deviation) => add(o, 1.0 / (deviation * deviation)),
                            Noise::Unknown(g) => {
                                add(o, (-2.0 * freed[g].value).exp());
                                matrix[g * n + g] += 2.0;
                            }
                            Noise::Expression(place) if y[place] != 0.0 => {
                                add(o, y[place] * y[place]);
                                add(place, 2.0 / (y[place] * y[place]));
                            }
                            Noise::Expression(_) | Noise::None => {}
                        }
                    }
                }
            };
            self.simulators[r].stream(&self.theta[r], &self.columns[r], &mut sink).ok()?;
        }
        matrix.iter().all(|v| v.is_finite()).then_some(matrix)
    }

    /// The information about the coordinates at the start (n by n): of residuals and noise, of priors and bounds.
    pub(super) fn information(&mut self) -> Option<Vec<f64>> {
        let posterior = self.posterior;
        let n = posterior.unknowns.len();
        let mut matrix = self.fisher(&posterior.start)?;
        for k in 0..n * n {
            matrix[k] *= self.freed[k / n].slope * self.freed[k % n].slope;
        }
        if let Some(correction) = &posterior.correction {
            matrix = correction.information(&matrix);
        }
        for (g, unknown) in posterior.unknowns.iter().enumerate() {
            let Freed { slope, jacobian_slope, .. } = self.freed[g];
            if let Some(Prior { deviation, .. }) = unknown.prior {
                matrix[g * n + g] += (slope / deviation) * (slope / deviation);
            }
            if let Free::Between(..) = unknown.free {
                // minus the second derivative of the Jacobian's logarithm
                matrix[g * n + g] += 0.5 * (1.0 - jacobian_slope * jacobian_slope);
            }
        }
        matrix.iter().all(|v| v.is_finite()).then_some(matrix)
    }

    /// Outputs of a run (N by q) at coordinates u, and the deviation of the noise of each; false where the response diverges.
    pub(super) fn predict(&mut self, u: &[f64], run: usize, y: &mut Vec<f64>, deviation: &mut Vec<f64>) -> bool {
        self.take(u);
        let posterior = self.posterior;
        let (width, q) = (posterior.model.layout().outputs, posterior.noise.len());
        let mut all = vec![f64::NAN; posterior.runs[run].len() * width];
        let good = self.simulators[run].simulate(&self.theta[run], &mut all).is_ok();
        y.clear();
        deviation.clear();
        for row in all.chunks(width) {
            y.extend_from_slice(&row[..q]);
            deviation.extend(posterior.noise.iter().map(|noise| match noise {
                Noise::Known(deviation) => *deviation,
                Noise::Unknown(g) => self.freed[*g].value.exp(),
                Noise::Expression(place) => 1.0 / row[*place].abs(),
                Noise::None => f64::NAN,
            }));
        }
        good
    }
}

/// A posterior in the units of a chain.
pub(super) struct InUnits<'e, 'p> {
    pub(super) evaluator: &'e mut Evaluator<'p>,
    pub(super) units: &'e Units,
    pub(super) u: &'e mut Vec<f64>,
    pub(super) by_u: &'e mut Vec<f64>,
    /// Evaluations so far.
    pub(super) count: &'e mut u64,
}

impl Density for InUnits<'_, '_> {
    fn evaluate(&mut self, z: &[f64], gradient: &mut [f64]) -> f64 {
        *self.count += 1;
        self.units.to_u(z, self.u);
        let found = self.evaluator.log_density(self.u, self.by_u);
        self.units.pull(self.by_u, gradient);
        found
    }
}
