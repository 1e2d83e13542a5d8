//! Stated initial values are doubted: would the likelihood rise by more than it costs, were they free?
//!
//! One Gauss-Newton step from the estimates, with sensitivities to the initial values beside those to all that was estimated, says what may be gained
//! (Rao's score test, in which all others may move). Where that pays, a second look at the residuals of that step allows for their colour; and where it
//! still pays, the model is fitted with these initial values free. Nothing is told that this fit does not bear out.

use crate::estimation::{ParameterEstimate, Status};
use crate::examined::doubted_initials::{DoubtedInitial, DoubtedInitials, MovedParameter};
use crate::iteration::evaluation::NormalEquations;
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::options::Attempt;
use crate::methods::output_error::options::{Continuation, FitOptions, SharedSteps};
use crate::methods::spectra::initial_conditions::{all_are_free, with_initials};
use crate::methods::time_domain::fit_from;
use crate::problem::unknowns::Unknowns;
use crate::work::Work;
use fdm_grammar::graph::Leaf;
use fdm_grammar::model::{Origin, Param};
use fdm_numeric::statistics::{Student, chi_squared_tail, normal_tail};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Simulator, Steps};
use nalgebra::{DMatrix, DVector};

/// Probability, over all initial values of a model together, of a remark on values that are right. Errors that allow for the colour of residuals are known
/// to a tenth or so: what is meant to happen once in a thousand fits then happens in a few.
const CHANCE: f64 = 1e-3;
/// Part of the information on an initial value that must be left beside all others: below it is a combination of them.
const LEFT: f64 = 1e-8;

/// What the data say of the initial values that the model states; none where they do not contradict them, or where that cannot be told: of a fit that did
/// not converge, without squares of residuals as its loss, or without errors that allow for coloured residuals. `thetas` are all parameters of each run at
/// the estimates.
///
/// # Errors
/// [`FitError`] of the fit with free initial values.
pub(crate) fn doubted_initials(fit: &Fit, reached: &Attempt<'_>) -> Result<Option<DoubtedInitials>, FitError> {
    let Attempt { runs, starts: thetas, options, work, .. } = *reached;
    let estimate = &fit.estimate;
    let noise_free = estimate.noise_free.len() == fit.model.definition().outputs.len();
    let judged = options.options.colour && estimate.termination.is_good() && fit.loss.is_squares();
    let whole = fit.noise_of_samples.is_empty() && fit.shooting.as_ref().is_none_or(|s| s.polished);
    let shares = estimate.covered.iter().any(|k| estimate.parameters[*k].run.is_none());
    if options.bare || !judged || !whole || noise_free || !shares || estimate.runs.is_empty() {
        return Ok(None);
    }
    let Some(freed) = Freed::of(fit, runs, thetas) else { return Ok(None) };
    work.doing("judging the stated initial values");
    let Some(states) = freed.worth_a_fit(options) else { return Ok(None) };
    if !work.goes_on() {
        return Ok(None);
    }
    let (model, starts) = freed.model_of(&states);
    let options = FitOptions {
        bare: true,
        continuation: Continuation::Never,
        substitute: Vec::new(),
        shooting: None,
        confidence: false,
        reweight: false,
        shared_steps: SharedSteps::of(fit.integration.clone()),
        ..options.clone()
    };
    let refit = fit_from(&Attempt { model: &model, runs, starts: &starts, options: &options, work: &work.quiet() })?;
    Ok(freed.told(&states, &refit))
}

/// A fit and its model with all initial values free.
struct Freed<'f> {
    fit: &'f Fit,
    runs: &'f [Run],
    /// All parameters of each run of the fit, and with the stated initial values those of `model`.
    thetas: &'f [Vec<f64>],
    starts: Vec<Vec<f64>>,
    model: Model,
    /// Initial values (by parameter of `model`) and their states.
    initials: Vec<(usize, usize)>,
    /// Stated initial values, runs by `initials`.
    stated: Vec<Vec<f64>>,
    /// Whether each parameter (of `model`) is held: fixed, or neither estimated nor an initial value.
    held: Vec<bool>,
    /// Sums of squares of the residuals of each output (q), and how many there are.
    squares: Vec<(f64, usize)>,
}

/// One Gauss-Newton step: the normal equations in all unknowns.
struct Step {
    unknowns: Unknowns,
    /// Information (U by U).
    information: DMatrix<f64>,
    /// Score (U).
    score: DVector<f64>,
}

impl<'f> Freed<'f> {
    fn of(fit: &'f Fit, runs: &'f [Run], thetas: &'f [Vec<f64>]) -> Option<Self> {
        let before = fit.model.definition().params.len();
        if all_are_free(&fit.model) {
            return None;
        }
        let model = with_initials(&fit.model, thetas.first()?, &|_| true);
        let params = &model.definition().params;
        let state =
            |k: usize| if let Origin::FreeInitial(state) = params[k].origin { Some(state as usize) } else { None };
        let initials: Vec<(usize, usize)> = (before..params.len()).filter_map(|k| Some((k, state(k)?))).collect();
        let value = |theta: &Vec<f64>, state: usize| stated_value(&fit.model, theta, state);
        let stated: Vec<Vec<f64>> =
            thetas.iter().map(|theta| initials.iter().map(|(_, state)| value(theta, *state)).collect()).collect();
        if initials.is_empty() || stated.iter().flatten().any(|v| !v.is_finite()) {
            return None;
        }
        let estimated = |p: &Param| {
            let own = p.per_run.then(|| runs[0].name.as_str());
            let found = fit.estimate.parameter(&p.quantity.name, own);
            found.is_none_or(|f| matches!(f.status, Status::Estimated | Status::NotDetermined))
        };
        let held: Vec<bool> = params.iter().enumerate().map(|(k, p)| p.fixed || k < before && !estimated(p)).collect();
        let unknowns = params.iter().zip(&held).filter(|(_, held)| !**held);
        let unknowns: usize = unknowns.map(|(p, _)| if p.per_run { runs.len() } else { 1 }).sum();
        let q = model.definition().outputs.len();
        let of_output = |o: usize| {
            let values = fit.estimate.runs.iter().flat_map(|r| r.residuals.iter().skip(o).step_by(q));
            values.filter(|v| !v.is_nan()).fold((0.0, 0), |(sum, count), v| (sum + v * v, count + 1))
        };
        let squares = (0..q).map(of_output).collect();
        let starts = thetas.iter().zip(&stated).map(|(theta, own)| [&theta[..], own].concat()).collect();
        let freed = Self { fit, runs, thetas, starts, model, initials, stated, held, squares };
        // most columns of one system of normal equations: solved in less than a second
        (unknowns <= 1000).then_some(freed)
    }

    /// Values that are compared.
    fn compared(&self) -> f64 {
        self.squares.iter().map(|(_, count)| *count as f64).sum()
    }

    /// The states whose initial values a fit is worth, by what is expected of it.
    fn worth_a_fit(&self, options: &FitOptions) -> Option<Vec<usize>> {
        let step = self.step(options)?;
        let reduced = Reduced::of(self, &step)?;
        let states = reduced.selected(self)?;
        let moves = reduced.moves(&states)?;
        let (gain, samples) = self.expected(&step, &moves)?;
        self.pays(gain, states.len(), samples).then_some(states)
    }

    /// Whether freeing so many states in every run pays: the likelihood rises by more than so many numbers cost, and by more than chance explains, as often as
    /// one of the states is looked at.
    fn pays(&self, gain: f64, states: usize, samples: f64) -> bool {
        let numbers = (states * self.runs.len()) as f64;
        let chance = chi_squared_tail(2.0 * gain.max(0.0), numbers).unwrap_or(1.0) * self.initials.len() as f64;
        gain > cost(numbers, samples) && chance < CHANCE
    }

    fn steps(&self) -> Vec<Steps> {
        self.fit.integration.iter().map(|a| a.steps.clone()).collect()
    }

    /// The normal equations at the estimates, outputs weighed by their residuals.
    fn step(&self, options: &FitOptions) -> Option<Step> {
        let Self { model, runs, starts, .. } = self;
        let attempt = Attempt { model, runs, starts, options, work: &Work::default() };
        let mut problem = attempt.problem(&self.steps()).ok()?;
        problem.params.iter_mut().zip(&self.held).for_each(|(p, held)| p.fixed = *held);
        let deviation = |(sum, count): &(f64, usize)| match *sum > 0.0 {
            true => (sum / *count as f64).sqrt(),
            // what is met says nothing of the others
            false => f64::INFINITY,
        };
        let deviations: Vec<f64> = self.squares.iter().map(deviation).collect();
        let unknowns = Unknowns::new(&problem);
        let mut equations = NormalEquations::new(&mut problem, &deviations);
        equations.evaluate(&unknowns.start).ok()?;
        let size = unknowns.len();
        let information = DMatrix::from_row_slice(size, size, equations.information());
        let score = DVector::from_column_slice(equations.gradient());
        information.iter().all(|v| v.is_finite()).then_some(Step { unknowns, information, score })
    }

    /// What freeing would raise the logarithm of the likelihood by, were the model linear, with the number of independent values that it is known from: each
    /// output counts as many as its residuals behind the step are worth, by their correlation.
    fn expected(&self, step: &Step, moves: &DVector<f64>) -> Option<(f64, f64)> {
        let q = self.squares.len();
        let mut left: Vec<Vec<Vec<f64>>> = vec![vec![Vec::new(); self.runs.len()]; q];
        for (r, ((run, theta), steps)) in self.runs.iter().zip(&self.starts).zip(self.steps()).enumerate() {
            let columns = &step.unknowns.columns;
            let moves: Vec<f64> = (0..columns.len()).map(|c| moves[step.unknowns.position(r, c)]).collect();
            let mut simulator = Simulator::new(self.model.dynamics(), run, steps).ok()?;
            let streamed = simulator.stream(theta, columns, &mut |block| {
                for sample in 0..block.samples() {
                    for (o, left) in left.iter_mut().enumerate() {
                        let residual = block.residual(&run.measured, sample, o);
                        if residual.is_nan() {
                            continue;
                        }
                        let lanes = block.layout.outputs[o].columns.iter().zip(block.row(sample, o));
                        left[r].push(residual - lanes.map(|(i, s)| s * moves[*i as usize]).sum::<f64>());
                    }
                }
            });
            streamed.ok()?;
        }
        let (mut gain, mut samples) = (0.0, 0.0);
        for ((before, count), runs) in self.squares.iter().zip(&left).filter(|((before, _), _)| *before > 0.0) {
            let after: f64 = runs.iter().flatten().map(|v| v * v).sum();
            let independent = *count as f64 / alike(runs, after);
            gain += 0.5 * independent * (before / after.max(f64::MIN_POSITIVE)).ln();
            samples += independent;
        }
        gain.is_finite().then_some((gain, samples))
    }

    /// The model with the initial values of some states free, and where its fit starts.
    fn model_of(&self, states: &[usize]) -> (Model, Vec<Vec<f64>>) {
        let chosen: Vec<usize> = states.iter().map(|s| self.initials[*s].1).collect();
        let model = with_initials(&self.fit.model, &self.thetas[0], &|state| chosen.contains(&state));
        let start = |(theta, stated): (&Vec<f64>, &Vec<f64>)| {
            let own = self.initials.iter().zip(stated).filter(|((_, state), _)| chosen.contains(state));
            theta.iter().copied().chain(own.map(|(_, value)| *value)).collect()
        };
        (model, self.thetas.iter().zip(&self.stated).map(start).collect())
    }

    /// What the fit with free initial values bears out.
    fn told(&self, states: &[usize], refit: &Fit) -> Option<DoubtedInitials> {
        let (before, after) = (self.fit.estimate.log_likelihood?, refit.estimate.log_likelihood?);
        let mut ordered = states.to_vec();
        ordered.sort_unstable();
        let numbers = (ordered.len() * self.runs.len()) as f64;
        let (gain, cost) = (after - before, cost(numbers, self.compared()));
        if !refit.estimate.termination.is_good() || gain.is_nan() || gain <= cost {
            return None;
        }
        let (mut values, mut chance) = (Vec::new(), 1.0_f64);
        for (run, stated) in self.runs.iter().zip(&self.stated) {
            for s in &ordered {
                let state = &self.model.definition().states[self.initials[*s].1].quantity;
                let found = refit.estimate.parameter(&format!("{}(0)", state.name), Some(&run.name))?;
                chance = chance.min(chance_of(found, stated[*s]));
                values.push(DoubtedInitial {
                    state: state.name.clone(),
                    run: run.name.clone(),
                    unit: state.unit.as_ref().map(ToString::to_string),
                    stated: stated[*s],
                    found: found.value,
                    error: found.error(),
                });
            }
        }
        // as many as were looked at
        let looked = (self.initials.len() * self.runs.len()) as f64;
        (chance * looked < CHANCE).then(|| DoubtedInitials { values, gain, cost, parameters: self.moved(refit) })
    }

    /// Shared parameters before and after, those first that move by most of their errors.
    fn moved(&self, refit: &Fit) -> Vec<MovedParameter> {
        let shared = refit.estimate.parameters.iter().filter(|p| p.run.is_none() && p.status == Status::Estimated);
        let one = |p: &ParameterEstimate| {
            let before = self.fit.estimate.parameter(&p.name, None)?.value;
            Some(MovedParameter { name: p.name.clone(), before, value: p.value, error: p.error() })
        };
        let mut moved: Vec<MovedParameter> = shared.filter_map(one).collect();
        let far = |m: &MovedParameter| m.error.map_or(0.0, |error| ((m.value - m.before) / error).abs());
        moved.sort_by(|a, b| far(b).total_cmp(&far(a)));
        moved
    }
}

/// What so many numbers cost of the logarithm of a likelihood (Schwarz 1978).
fn cost(numbers: f64, samples: f64) -> f64 {
    0.5 * numbers * samples.max(1.0).ln()
}

/// Probability of an estimate as far from the stated value by chance, were that right.
fn chance_of(found: &ParameterEstimate, stated: f64) -> f64 {
    let Some(error) = found.error().filter(|error| *error > 0.0 && found.status == Status::Estimated) else {
        return 1.0;
    };
    let far = ((found.value - stated) / error).abs();
    let law = found.degrees_of_freedom.filter(|_| found.corrected_error.is_some()).and_then(Student::new);
    2.0 * law.map_or_else(|| normal_tail(far), |law| law.tail(far))
}

/// How many residuals are worth one independent one: one plus twice the sum of their correlations as far as it is positive (Geyer's initial sequence).
fn alike(runs: &[Vec<f64>], squares: f64) -> f64 {
    let longest = runs.iter().map(Vec::len).max().unwrap_or(0);
    let lag = |k: usize| {
        let of_run = |v: &Vec<f64>| v.iter().zip(v.iter().skip(k)).map(|(a, b)| a * b).sum::<f64>();
        runs.iter().map(of_run).sum::<f64>() / squares.max(f64::MIN_POSITIVE)
    };
    // most lags of which the correlation of residuals is summed
    1.0 + 2.0 * (1..longest.min(1000)).map(lag).take_while(|r| *r > 0.0).sum::<f64>()
}

/// The value of a state at the beginning of a run that the model states, at all its parameters.
fn stated_value(model: &Model, theta: &[f64], state: usize) -> f64 {
    let definition = model.definition();
    definition.graph.evaluate(definition.states[state].initial, |leaf| match leaf {
        Leaf::Param(k) => theta[k as usize],
        _ => f64::NAN,
    })
}

/// The normal equations of the initial values alone, all others having moved along.
struct Reduced {
    /// The unknowns of the initial values, states outermost.
    initials: Vec<Vec<usize>>,
    /// How the others follow them (U by I): minus their regression on these.
    follow: DMatrix<f64>,
    /// Information (I by I); rows of those that are combinations of others hold one in the diagonal.
    information: DMatrix<f64>,
    score: DVector<f64>,
    /// Unknowns (I) in the order of the matrix.
    order: Vec<usize>,
}

impl Reduced {
    fn of(freed: &Freed<'_>, step: &Step) -> Option<Self> {
        let of_run = |k: usize| (0..freed.runs.len()).map(|r| step.unknowns.of(r, k)).collect::<Option<Vec<usize>>>();
        let initials: Vec<Vec<usize>> = freed.initials.iter().map(|(k, _)| of_run(*k)).collect::<Option<_>>()?;
        let order: Vec<usize> = initials.iter().flatten().copied().collect();
        let others: Vec<usize> = (0..step.score.len()).filter(|u| !order.contains(u)).collect();
        let part = |rows: &[usize], columns: &[usize]| {
            DMatrix::from_fn(rows.len(), columns.len(), |i, j| step.information[(rows[i], columns[j])])
        };
        let mut middle = part(&others, &others);
        // what nothing determines does not move; a ridge far below what is known
        let scale: Vec<f64> = (0..others.len()).map(|i| middle[(i, i)].sqrt()).collect();
        let scale: Vec<f64> = scale.iter().map(|s| if *s > 0.0 { 1.0 / s } else { 0.0 }).collect();
        middle = DMatrix::from_fn(others.len(), others.len(), |i, j| {
            middle[(i, j)] * scale[i] * scale[j] + if i == j { 1e-10 + f64::from(scale[i] == 0.0) } else { 0.0 }
        });
        let cross = part(&others, &order);
        let scaled = DMatrix::from_fn(others.len(), order.len(), |i, j| cross[(i, j)] * scale[i]);
        let solved = middle.cholesky()?.solve(&scaled);
        let whole = part(&order, &order);
        let mut information = &whole - scaled.transpose() * &solved;
        let mut score = DVector::from_fn(order.len(), |i, _| step.score[order[i]]);
        let mut follow = DMatrix::zeros(step.score.len(), order.len());
        for (i, other) in others.iter().enumerate() {
            (0..order.len()).for_each(|j| follow[(*other, j)] = -solved[(i, j)] * scale[i]);
        }
        for i in 0..order.len() {
            follow[(order[i], i)] = 1.0;
            if information[(i, i)].is_nan() || information[(i, i)] <= LEFT * whole[(i, i)] {
                information.fill_row(i, 0.0);
                information.fill_column(i, 0.0);
                information[(i, i)] = 1.0;
                score[i] = 0.0;
            }
        }
        Some(Self { initials, follow, information, score, order })
    }

    /// Places in the matrix of the initial values of some states.
    fn places(&self, states: &[usize]) -> Vec<usize> {
        let runs = self.initials.first().map_or(0, Vec::len);
        states.iter().flat_map(|s| s * runs..(s + 1) * runs).collect()
    }

    /// The step of the initial values of some states, and what it gains under noise as large as the residuals are.
    fn gain(&self, states: &[usize]) -> Option<(f64, DVector<f64>)> {
        let at = self.places(states);
        let own = DMatrix::from_fn(at.len(), at.len(), |i, j| self.information[(at[i], at[j])]);
        let score = DVector::from_fn(at.len(), |i, _| self.score[at[i]]);
        let step = own.cholesky()?.solve(&score);
        Some((0.5 * step.dot(&score), step))
    }

    /// The states whose free initial values pay, each beside those before it; none where none does.
    fn selected(&self, freed: &Freed<'_>) -> Option<Vec<usize>> {
        let samples = freed.compared();
        // the noise is estimated: what is gained is the logarithm of what is left of it
        let logarithmic = |gain: f64| {
            let left = (1.0 - 2.0 * gain / samples).max(f64::MIN_POSITIVE);
            -0.5 * samples * left.ln()
        };
        let (mut chosen, mut reached) = (Vec::new(), 0.0);
        loop {
            let others = (0..freed.initials.len()).filter(|s| !chosen.contains(s));
            let with = |s: usize| {
                let states: Vec<usize> = chosen.iter().copied().chain([s]).collect();
                Some((logarithmic(self.gain(&states)?.0), s))
            };
            let best = others.filter_map(with).max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
            let Some((gain, state)) = best.filter(|(gain, _)| freed.pays(gain - reached, 1, samples)) else { break };
            chosen.push(state);
            reached = gain;
        }
        (!chosen.is_empty()).then_some(chosen)
    }

    /// How all unknowns move with the initial values of some states.
    fn moves(&self, states: &[usize]) -> Option<DVector<f64>> {
        let (_, step) = self.gain(states)?;
        let mut all = DVector::zeros(self.order.len());
        self.places(states).iter().zip(step.iter()).for_each(|(place, value)| all[*place] = *value);
        Some(&self.follow * all)
    }
}
