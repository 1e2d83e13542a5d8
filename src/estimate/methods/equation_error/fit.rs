//! A model and its runs to the regressions of all its equations; and the estimates over the cut-off frequency and over the length of the records, since what
//! depends on how much of the data is used deserves little confidence.

use super::equations::{Equations, Left};
use super::error::{Refusal, RegressionError};
use super::options::{Components, Domain, RegressionOptions, Smoothing};
use super::principal_components::{Chosen, Component};
use super::regression::{Block, Group, Solved, Unknown, spread};
use super::regressors::{Places, Series, Signals, rows};
use crate::residuals::{OutputQuality, residual_quality};
use fdm_grammar::graph::show;
use fdm_grammar::op::ExprId;
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::spectrum::Frequencies;
use serde::{Deserialize, Serialize};

/// What regressions say about a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Regression {
    /// Where rates and regressors were compared.
    pub domain: Domain,
    /// One for each equation, or for several that share parameters.
    pub fits: Vec<EquationErrorFit>,
    /// Equations that are no regressions.
    pub refused: Vec<Refusal>,
    /// Free parameters that none of the regressions gives; they keep their values.
    pub kept: Vec<String>,
    /// What smoothing found, when it was by a sine series.
    pub noise: Vec<ChannelNoise>,
    /// Every equation of every run: what was measured, and what is explained of it.
    pub courses: Vec<Course>,
}

/// What was measured of one equation in one run, and what the chosen solution explains, its known part included.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    /// `der(x)`, or the output.
    pub equation: String,
    /// Its unit, when one was declared.
    pub unit: Option<String>,
    /// The run, by index.
    pub run: usize,
    /// Along time or over frequency.
    pub along: Along,
}

/// Measured and explained values; trends that were taken off are no part of them.
#[derive(Debug, Clone, PartialEq)]
pub enum Along {
    /// At every sample (N); NaN where the equation was not compared.
    Time {
        /// What was measured.
        measured: Vec<f64>,
        /// What is explained.
        explained: Vec<f64>,
    },
    /// At the frequencies that were compared.
    Frequency {
        /// In cycles per unit of time.
        frequency: Vec<f64>,
        /// What was measured, all real parts in front of all imaginary ones.
        measured: Vec<f64>,
        /// What is explained, likewise.
        explained: Vec<f64>,
    },
}

/// Noise of a measured state.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct ChannelNoise {
    /// The state.
    pub state: String,
    /// The run.
    pub run: String,
    /// Standard deviation.
    pub deviation: f64,
    /// Where the weight of the series is a half, in cycles per unit of time.
    pub cutoff: f64,
}

/// The regression of one equation, or of several that share parameters.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct EquationErrorFit {
    /// Each equation by itself.
    pub equations: Vec<EquationQuality>,
    /// Rows: samples, or two for each frequency.
    pub rows: usize,
    /// Parameters of the chosen solution.
    pub parameters: Vec<Regressed>,
    /// Constants of equations in which a signal has a bias that is to be estimated, named by their equation; behind the parameters in
    /// `components`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub biases: Vec<Regressed>,
    /// Parameters whose columns vanish in these data, so that nothing is said about them (constants at frequencies above zero).
    pub not_identifiable: Vec<String>,
    /// The solutions with 1, 2, ... principal components.
    pub components: Vec<Component>,
    /// How many make the chosen one.
    pub chosen: usize,
    /// Why.
    pub reason: Chosen,
}

/// How well one equation is met.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct EquationQuality {
    /// `der(x)`, or the output.
    pub equation: String,
    /// Its unit, when one was declared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Part of the left side's sum of squares that is explained, what is known of it left out.
    pub r_squared: f64,
    /// Root mean square of the residual, in its unit.
    pub rms: f64,
    /// Rows of it.
    pub rows: usize,
}

/// A parameter as a regression gives it.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Regressed {
    /// Name.
    pub name: String,
    /// The run whose value it is, for parameters that every run has.
    pub run: Option<String>,
    /// Unit, when one was declared.
    pub unit: Option<String>,
    /// Value.
    pub value: f64,
    /// Standard error, for white residuals.
    pub standard_error: f64,
    /// Standard error for the colour of the residuals; time domain only.
    pub coloured_error: Option<f64>,
    /// `(value/standard error)^2`.
    pub partial_f: f64,
    /// Its part in the rate, `|theta_j| int|X_j| / int|xdot|`.
    pub significance: f64,
    /// Its column in each equation.
    pub columns: Vec<String>,
}

/// Estimates the parameters of every equation that is linear in them and whose state is measured.
///
/// # Errors
/// [`RegressionError`]: no equation is a regression (each with its reason), or the records do not serve.
pub fn regress(model: &Model, runs: &[Run], options: &RegressionOptions) -> Result<Regression, RegressionError> {
    if model.definition().has_events() {
        return Err(RegressionError::Events);
    }
    check(runs, options)?;
    let definition = model.definition();
    let mut equations = Equations::new(definition);
    if equations.equations.is_empty() {
        return Err(RegressionError::NoEquation(equations.refused));
    }
    let runs = completed(definition, runs)?;
    let (mut blocks, mut noise) = (Vec::new(), Vec::new());
    for (k, run) in runs.iter().enumerate() {
        let signals = Signals::new(definition, &equations.graph, &equations.readings, run, options)?;
        blocks.extend(equation_blocks(definition, &equations, &signals, k, options)?);
        noise.extend(noises(definition, &signals));
    }
    let namer = Namer { definition, equations: &equations, runs: &runs };
    let (mut fits, mut courses) = (Vec::new(), Vec::new());
    for members in groups(&equations) {
        let own = blocks.iter().filter(|b| members.contains(&b.equation) && !b.rows.left.is_empty()).collect();
        let group = Group::new(own, namer.equations(&members));
        let names: Vec<String> = group.unknowns.iter().map(|u| namer.unknown(*u)).collect();
        if group.unknowns.is_empty() && !group.blocks.is_empty() {
            fits.push(namer.empty(&members, &group));
            continue;
        }
        let solved = group.solve(&names, options)?;
        courses
            .extend(group.blocks.iter().zip(&solved.residuals).map(|(block, residual)| namer.course(block, residual)));
        let fit = namer.fit(&members, &group, solved, options);
        if !fit.is_finite() {
            return Err(RegressionError::NotFinite { equations: group.name });
        }
        fits.push(fit);
    }
    if let Components::Count(asked) = options.components {
        let largest = fits.iter().max_by_key(|f| f.parameters.len());
        let most = largest.map_or(0, |f| f.parameters.len());
        if let Some(fit) = largest.filter(|_| most > 0 && asked > most) {
            let equations = fit.equations.iter().map(|e| e.equation.clone()).collect::<Vec<_>>().join(", ");
            return Err(RegressionError::TooManyComponents { equations, asked, most });
        }
    }
    let given = |name: &String| fits.iter().any(|f: &EquationErrorFit| f.parameters.iter().any(|p| p.name == *name));
    let free = definition.params.iter().filter(|p| !p.fixed).map(|p| p.quantity.name.clone());
    let kept = free.filter(|name| !given(name)).collect();
    let refused = std::mem::take(&mut equations.refused);
    courses.sort_by_key(|(place, _)| *place);
    let courses = courses.into_iter().map(|(_, course)| course).collect();
    Ok(Regression { domain: options.domain.clone(), fits, refused, kept, noise, courses })
}

fn check(runs: &[Run], options: &RegressionOptions) -> Result<(), RegressionError> {
    if runs.is_empty() {
        return Err(RegressionError::NoRuns);
    }
    if options.components == Components::Count(0) {
        return Err(RegressionError::NoComponent);
    }
    match options.smoothing {
        Smoothing::Local { points } if points < 5 || points.is_multiple_of(2) => Err(RegressionError::Window(points)),
        Smoothing::Fixed { cutoff } if !(cutoff > 0.0 && cutoff.is_finite()) => Err(RegressionError::Cutoff(cutoff)),
        _ => Ok(()),
    }
}

/// Runs with the inputs that a model takes from records.
pub(super) fn completed(definition: &fdm_grammar::Model, runs: &[Run]) -> Result<Vec<Run>, RegressionError> {
    runs.iter().map(|r| r.with_measured(definition).map_err(RegressionError::Incomplete)).collect()
}

fn noises(definition: &fdm_grammar::Model, signals: &Signals<'_>) -> Vec<ChannelNoise> {
    let one = |(k, found): (usize, &Option<(f64, f64)>)| {
        let (deviation, cutoff) = (*found)?;
        let state = definition.states[k].quantity.name.clone();
        Some(ChannelNoise { state, run: signals.run.name.clone(), deviation, cutoff })
    };
    signals.smoothed.iter().enumerate().filter_map(one).collect()
}

fn equation_blocks(
    definition: &fdm_grammar::Model,
    equations: &Equations,
    signals: &Signals<'_>,
    run: usize,
    options: &RegressionOptions,
) -> Result<Vec<Block>, RegressionError> {
    let mut blocks = Vec::new();
    for (k, equation) in equations.equations.iter().enumerate() {
        let roots: Vec<ExprId> =
            std::iter::once(equation.known).chain(equation.columns.iter().map(|(_, column)| *column)).collect();
        let series = signals.evaluate(definition, &equations.graph, &roots);
        let none = vec![f64::NAN; signals.run.len()];
        let Some(explained) = signals.explained(equation.left, &none) else { continue };
        let series = Series { explained, known: &series[0], columns: &series[1..] };
        let of_run = |param: u32| definition.params.get(param as usize).map_or(equation.bias_per_run, |p| p.per_run);
        let unknown = |param: u32| Unknown { param, run: of_run(param).then_some(run) };
        let unknowns = equation.columns.iter().map(|(param, _)| unknown(*param)).collect();
        blocks.push(Block { equation: k, run, rows: rows(signals.run, &series, options)?, unknowns });
    }
    Ok(blocks)
}

/// Equations that share parameters, directly or by way of others.
pub(super) fn groups(equations: &Equations) -> Vec<Vec<usize>> {
    let mut groups: Vec<(Vec<usize>, Vec<u32>)> = Vec::new();
    for (k, equation) in equations.equations.iter().enumerate() {
        let params: Vec<u32> = equation.columns.iter().map(|(p, _)| *p).collect();
        let (sharing, mut rest): (Vec<_>, Vec<_>) =
            groups.into_iter().partition(|(_, own)| own.iter().any(|p| params.contains(p)));
        let mut joined = (vec![k], params);
        for (members, params) in sharing {
            joined.0.extend(members);
            joined.1.extend(params);
        }
        joined.0.sort_unstable();
        rest.push(joined);
        groups = rest;
    }
    groups.sort();
    groups.into_iter().map(|(members, _)| members).collect()
}

/// What numbers are called.
struct Namer<'a> {
    definition: &'a fdm_grammar::Model,
    equations: &'a Equations,
    runs: &'a [Run],
}

impl Namer<'_> {
    fn equation(&self, k: usize) -> String {
        self.equations.name(self.definition, k)
    }

    fn equations(&self, members: &[usize]) -> String {
        members.iter().map(|k| self.equation(*k)).collect::<Vec<_>>().join(", ")
    }

    /// The equation whose bias it is; none of a parameter of the model.
    fn biased(&self, unknown: Unknown) -> Option<usize> {
        (unknown.param as usize).checked_sub(self.definition.params.len())
    }

    fn name(&self, unknown: Unknown) -> String {
        match self.biased(unknown) {
            Some(k) => format!("bias of {}", self.equation(k)),
            None => self.definition.params[unknown.param as usize].quantity.name.clone(),
        }
    }

    fn unknown(&self, unknown: Unknown) -> String {
        let name = self.name(unknown);
        unknown.run.map_or_else(|| name.clone(), |run| format!("{name} ({})", self.runs[run].name))
    }

    /// The unit of what an equation explains.
    fn unit(&self, k: usize) -> Option<String> {
        let unit = match self.equations.equations[k].left {
            Left::Rate(state) => {
                self.definition.states[state].quantity.unit.as_ref()?.quotient(&self.definition.time)?
            }
            Left::Output(output) => self.definition.outputs[output].quantity.unit.clone()?,
        };
        Some(unit.to_string())
    }

    /// Those of which the data say nothing; that a bias has no part above zero frequency needs no word.
    fn unseen(&self, group: &Group<'_>) -> Vec<String> {
        group.unseen.iter().filter(|u| self.biased(**u).is_none()).map(|u| self.unknown(*u)).collect()
    }

    /// What was measured and explained of a block, with its place among all.
    fn course(&self, block: &Block, residual: &[f64]) -> ((usize, usize), Course) {
        let explained: Vec<f64> = block.rows.measured.iter().zip(residual).map(|(z, v)| z - v).collect();
        let along = match &block.rows.places {
            Places::Samples(samples) => {
                let spread = |values: &[f64]| {
                    let mut whole = vec![f64::NAN; self.runs[block.run].len()];
                    samples.iter().zip(values).for_each(|(k, v)| whole[*k] = *v);
                    whole
                };
                Along::Time { measured: spread(&block.rows.measured), explained: spread(&explained) }
            }
            Places::Frequencies(frequency) => {
                Along::Frequency { frequency: frequency.clone(), measured: block.rows.measured.clone(), explained }
            }
        };
        let (equation, unit) = (self.equation(block.equation), self.unit(block.equation));
        ((block.run, block.equation), Course { equation, unit, run: block.run, along })
    }

    fn columns(&self, members: &[usize], param: u32) -> Vec<String> {
        let of = |k: &usize| {
            let column = self.equations.equations[*k].columns.iter().find(|(p, _)| *p == param)?;
            Some(show(&self.equations.graph, column.1, self.definition))
        };
        members.iter().filter_map(of).collect()
    }

    /// A group whose columns all vanish.
    fn empty(&self, members: &[usize], group: &Group<'_>) -> EquationErrorFit {
        EquationErrorFit {
            equations: members
                .iter()
                .map(|k| {
                    let (equation, unit) = (self.equation(*k), self.unit(*k));
                    EquationQuality { equation, unit, r_squared: 0.0, rms: 0.0, rows: 0 }
                })
                .collect(),
            rows: 0,
            parameters: Vec::new(),
            biases: Vec::new(),
            not_identifiable: self.unseen(group),
            components: Vec::new(),
            chosen: 0,
            reason: Chosen::All,
        }
    }

    fn fit(
        &self,
        members: &[usize],
        group: &Group<'_>,
        solved: Solved,
        options: &RegressionOptions,
    ) -> EquationErrorFit {
        let chosen = &solved.components[solved.chosen - 1];
        let parameter = |(j, unknown): (usize, &Unknown)| {
            let declared = self.definition.params.get(unknown.param as usize).map(|p| p.quantity.unit.as_ref());
            let of_equation = || self.biased(*unknown).and_then(|k| self.unit(k));
            Regressed {
                name: self.name(*unknown),
                run: unknown.run.map(|run| self.runs[run].name.clone()),
                unit: declared.map_or_else(of_equation, |unit| unit.map(ToString::to_string)),
                value: chosen.values[j],
                standard_error: chosen.standard_errors[j],
                coloured_error: solved.coloured.as_ref().map(|c| c[j]).filter(|c| c.is_finite()),
                // nothing that explains nothing: 0/0
                partial_f: some_or_none(chosen.partial_f[j]),
                significance: some_or_none(solved.significance[j]),
                columns: self.columns(members, unknown.param),
            }
        };
        let mut parameters: Vec<Regressed> = group.unknowns.iter().enumerate().map(parameter).collect();
        let own = group.unknowns.iter().filter(|u| self.biased(**u).is_none()).count();
        let biases = parameters.split_off(own);
        let time = options.domain == Domain::Time;
        let quality = |k: &usize| {
            let own = || group.blocks.iter().zip(&solved.residuals).filter(|(b, _)| b.equation == *k);
            let rows = own().map(|(_, r)| r.len()).sum::<usize>();
            let squares: f64 = own().flat_map(|(_, r)| r).map(|v| v * v).sum();
            let total: f64 = own().map(|(b, _)| spread(&b.rows.left, time)).sum();
            let rms = (squares / rows.max(1) as f64).sqrt();
            // of a rate that does not move nothing is explained
            let r_squared = if total > 0.0 { 1.0 - squares / total } else { 0.0 };
            EquationQuality { equation: self.equation(*k), unit: self.unit(*k), r_squared, rms, rows }
        };
        EquationErrorFit {
            equations: members.iter().map(quality).collect(),
            rows: solved.rows,
            parameters,
            biases,
            not_identifiable: self.unseen(group),
            chosen: solved.chosen,
            reason: solved.reason,
            components: solved.components,
        }
    }
}

/// What is 0/0 is none.
fn some_or_none(value: f64) -> f64 {
    if value.is_nan() { 0.0 } else { value }
}

impl Regression {
    /// How well every equation is met along every run, and what its residuals say; none in the frequency domain. The runs are those that were
    /// regressed.
    pub fn quality(&self, model: &Model, runs: &[Run]) -> Vec<OutputQuality> {
        let inputs = model.definition().inputs.iter().filter(|i| i.is_declared()).map(|i| i.quantity.name.clone());
        let inputs: Vec<String> = inputs.collect();
        let one = |course: &Course| {
            let (run, Along::Time { measured, explained }) = (runs.get(course.run)?, &course.along) else {
                return None;
            };
            let width = run.held.len();
            let values = |row: &[f64]| row[..inputs.len().min(width)].to_vec();
            let input_values: Vec<f64> = run.inputs.chunks_exact(width.max(1)).flat_map(values).collect();
            let found = residual_quality(&crate::residuals::Signals {
                run: &run.name,
                time: &run.time,
                outputs: std::slice::from_ref(&course.equation),
                measured,
                response: explained,
                inputs: &inputs[..inputs.len().min(width)],
                input_values: &input_values,
            });
            found.into_iter().next()
        };
        self.courses.iter().filter_map(one).collect()
    }

    /// Whether no equation says anything about a parameter.
    pub fn is_undetermined(&self) -> bool {
        self.fits.iter().all(EquationErrorFit::is_undetermined)
    }
}

impl EquationErrorFit {
    /// Whether these records say nothing about the parameters: nothing multiplies them, or a rate that is zero throughout is met by
    /// values that are all zero, without any error.
    pub fn is_undetermined(&self) -> bool {
        self.parameters.iter().all(|p| p.value == 0.0 && p.standard_error == 0.0)
    }

    /// Whether all estimates are numbers, with errors that are.
    fn is_finite(&self) -> bool {
        let whole = |p: &Regressed| p.value.is_finite() && p.standard_error.is_finite();
        self.parameters.iter().chain(&self.biases).all(whole)
            && self.equations.iter().all(|e| e.rms.is_finite() && e.r_squared.is_finite())
    }
}

/// All parameters at one cut-off or length.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Dependence {
    /// Highest frequency (cycles per unit of time), or part of each record.
    pub at: f64,
    /// The parameters; none when these data do not serve, which `reason` says.
    pub parameters: Vec<Regressed>,
    /// Why there are none.
    pub reason: Option<String>,
}

impl Dependence {
    fn new(at: f64, found: Result<Vec<EquationErrorFit>, RegressionError>) -> Self {
        match found {
            Ok(fits) => {
                let parameters = fits.into_iter().flat_map(|f| f.parameters).collect();
                Self { at, parameters, reason: None }
            }
            Err(error) => Self { at, parameters: Vec::new(), reason: Some(error.to_string()) },
        }
    }
}

/// The regression with each of the highest frequencies: the band's upper end, or in the time domain the cut-off of the smoothing.
pub fn by_cutoff(model: &Model, runs: &[Run], options: &RegressionOptions, cutoffs: &[f64]) -> Vec<Dependence> {
    let one = |cutoff: &f64| {
        let mut options = options.clone();
        match &mut options.domain {
            Domain::Time => options.smoothing = Smoothing::Fixed { cutoff: *cutoff },
            Domain::Frequency(Frequencies::Grid { highest, .. }) => *highest = Some(*cutoff),
            Domain::Frequency(Frequencies::Band { highest, .. }) => *highest = *cutoff,
            Domain::Frequency(Frequencies::List(list)) => list.retain(|f| f <= cutoff),
        }
        Dependence::new(*cutoff, regress(model, runs, &options).map(|r| r.fits))
    };
    cutoffs.iter().map(one).collect()
}

/// The regression with the first part of each record; `parts` in (0, 1].
pub fn by_length(model: &Model, runs: &[Run], options: &RegressionOptions, parts: &[f64]) -> Vec<Dependence> {
    let one = |part: &f64| {
        let first = |run: &Run| {
            let samples = (part.clamp(0.0, 1.0) * run.len() as f64).round() as usize;
            run.part(0..samples.clamp(1.min(run.len()), run.len()))
        };
        let shorter: Vec<Run> = runs.iter().map(first).collect();
        Dependence::new(*part, regress(model, &shorter, options).map(|r| r.fits))
    };
    parts.iter().map(one).collect()
}
