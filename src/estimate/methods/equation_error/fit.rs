//! A model and its runs to the regressions of all its equations; and the estimates over the cut-off frequency and over the length of the records, since what
//! depends on how much of the data is used deserves little confidence.

use super::equations::Equations;
use super::error::{Refusal, RegressionError};
use super::options::{Components, Domain, RegressionOptions, Smoothing};
use super::principal_components::{Chosen, Component};
use super::regression::{Block, Group, Solved, Unknown, spread};
use super::regressors::{Series, Signals, rows};
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
    /// `der(x)`.
    pub equation: String,
    /// Part of the rate's sum of squares that is explained, what is known of it left out.
    pub r_squared: f64,
    /// Root mean square of the residual, in the unit of the rate.
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
    let mut fits = Vec::new();
    for members in groups(&equations) {
        let own = blocks.iter().filter(|b| members.contains(&b.equation) && !b.rows.left.is_empty()).collect();
        let group = Group::new(own, namer.equations(&members));
        let names: Vec<String> = group.unknowns.iter().map(|u| namer.unknown(*u)).collect();
        if group.unknowns.is_empty() && !group.blocks.is_empty() {
            fits.push(namer.empty(&members, &group));
            continue;
        }
        let solved = group.solve(&names, options)?;
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
    Ok(Regression { domain: options.domain.clone(), fits, refused, kept, noise })
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
        let Some(state) = &signals.states[equation.state] else { continue };
        let none = vec![f64::NAN; state.len()];
        let rate = signals.rates[equation.state].as_ref().unwrap_or(&none);
        let series = Series { state, rate, known: &series[0], columns: &series[1..] };
        let own = |param: u32| definition.params[param as usize].per_run.then_some(run);
        let unknowns = equation.columns.iter().map(|(param, _)| Unknown { param: *param, run: own(*param) }).collect();
        blocks.push(Block { equation: k, rows: rows(signals.run, &series, options)?, unknowns });
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

    fn unknown(&self, unknown: Unknown) -> String {
        let name = &self.definition.params[unknown.param as usize].quantity.name;
        unknown.run.map_or_else(|| name.clone(), |run| format!("{name} ({})", self.runs[run].name))
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
                .map(|k| EquationQuality { equation: self.equation(*k), r_squared: 0.0, rms: 0.0, rows: 0 })
                .collect(),
            rows: 0,
            parameters: Vec::new(),
            not_identifiable: group.unseen.iter().map(|u| self.unknown(*u)).collect(),
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
            let quantity = &self.definition.params[unknown.param as usize].quantity;
            Regressed {
                name: quantity.name.clone(),
                run: unknown.run.map(|run| self.runs[run].name.clone()),
                unit: quantity.unit.as_ref().map(ToString::to_string),
                value: chosen.values[j],
                standard_error: chosen.standard_errors[j],
                coloured_error: solved.coloured.as_ref().map(|c| c[j]).filter(|c| c.is_finite()),
                // nothing that explains nothing: 0/0
                partial_f: some_or_none(chosen.partial_f[j]),
                significance: some_or_none(solved.significance[j]),
                columns: self.columns(members, unknown.param),
            }
        };
        let parameters = group.unknowns.iter().enumerate().map(parameter).collect();
        let time = options.domain == Domain::Time;
        let quality = |k: &usize| {
            let own = || group.blocks.iter().zip(&solved.residuals).filter(|(b, _)| b.equation == *k);
            let rows = own().map(|(_, r)| r.len()).sum::<usize>();
            let squares: f64 = own().flat_map(|(_, r)| r).map(|v| v * v).sum();
            let total: f64 = own().map(|(b, _)| spread(&b.rows.left, time)).sum();
            let rms = (squares / rows.max(1) as f64).sqrt();
            // of a rate that does not move nothing is explained
            let r_squared = if total > 0.0 { 1.0 - squares / total } else { 0.0 };
            EquationQuality { equation: self.equation(*k), r_squared, rms, rows }
        };
        EquationErrorFit {
            equations: members.iter().map(quality).collect(),
            rows: solved.rows,
            parameters,
            not_identifiable: group.unseen.iter().map(|u| self.unknown(*u)).collect(),
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
        self.parameters.iter().all(whole) && self.equations.iter().all(|e| e.rms.is_finite() && e.r_squared.is_finite())
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
