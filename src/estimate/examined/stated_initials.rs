//! Stated initial values are doubted: would the likelihood rise by more than it costs, were they free?
//!
//! One Gauss-Newton step from the estimates, with sensitivities to the initial values beside those to all that was estimated, says what may be gained
//! (Rao's score test, in which all others may move). Where that pays, a second look at the residuals of that step allows for their colour; and where it
//! still pays, the model is fitted with these initial values free. Nothing is told that this fit does not bear out.

use crate::estimation::estimate::{ParameterEstimate, Status};
use crate::examined::doubted_initials::{DoubtedInitial, DoubtedInitials, MovedParameter};
use crate::methods::output_error::attempt::Attempt;
use crate::methods::output_error::error::FitError;
use crate::methods::output_error::fit::Fit;
use crate::methods::output_error::options::{Continuation, FitOptions, SharedSteps};
use crate::methods::spectra::initial_conditions::with_initials;
use crate::methods::time_domain::fit_from;
use fdm_grammar::graph::Leaf;
use fdm_grammar::model::{Origin, Param};
use fdm_numeric::statistics::{Student, chi_squared_tail, normal_tail};
use fdm_system::model::Model;
use fdm_system::record::Run;
use fdm_system::simulate::{Block, Simulator};
use nalgebra::{DMatrix, DVector};

/// Probability, over all initial values of a model together, of a remark on values that are right. Errors that allow for the colour of residuals are known
/// to a tenth or so: what is meant to happen once in a thousand fits then happens in a few.
const CHANCE: f64 = 1e-3;
/// Most columns of one system of normal equations: solved in less than a second.
const MOST_COLUMNS: usize = 1000;
/// Part of the information on an initial value that must be left beside all others: below it is a combination of them.
const LEFT: f64 = 1e-8;
/// Most lags of which the correlation of residuals is summed.
const MOST_LAGS: usize = 1000;

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
    let Some(states) = freed.worth_a_fit() else { return Ok(None) };
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
    thetas: &'f [Vec<f64>],
    model: Model,
    /// Initial values (by parameter of `model`) and their states.
    initials: Vec<(usize, usize)>,
    /// Stated initial values, runs by `initials`.
    stated: Vec<Vec<f64>>,
    /// Parameters (of `model`) that may move: those that were estimated, then the initial values.
    open: Vec<usize>,
    /// Whether each of them belongs to its run.
    own: Vec<bool>,
    /// Sums of squares of the residuals of each output (q), and how many there are.
    squares: Vec<(f64, usize)>,
}

/// One Gauss-Newton step: the normal equations in all unknowns, and where the initial values stand there.
struct Step {
    /// Unknown of each run and open parameter.
    place: Vec<Vec<usize>>,
    /// Information (U by U).
    information: DMatrix<f64>,
    /// Score (U).
    score: DVector<f64>,
}

impl<'f> Freed<'f> {
    fn of(fit: &'f Fit, runs: &'f [Run], thetas: &'f [Vec<f64>]) -> Option<Self> {
        let before = fit.model.definition().params.len();
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
        let estimated = |p: &Param, k: usize| {
            let own = p.per_run.then(|| runs[0].name.as_str());
            let found = fit.estimate.parameter(&p.quantity.name, own);
            k >= before
                || !p.fixed && found.is_none_or(|f| matches!(f.status, Status::Estimated | Status::NotDetermined))
        };
        let open: Vec<usize> = (0..params.len()).filter(|k| !params[*k].fixed && estimated(&params[*k], *k)).collect();
        let own = open.iter().map(|k| params[*k].per_run).collect();
        let q = model.definition().outputs.len();
        let of_output = |o: usize| {
            let values = fit.estimate.runs.iter().flat_map(|r| r.residuals.iter().skip(o).step_by(q));
            values.filter(|v| !v.is_nan()).fold((0.0, 0), |(sum, count), v| (sum + v * v, count + 1))
        };
        let squares = (0..q).map(of_output).collect();
        let freed = Self { fit, runs, thetas, model, initials, stated, open, own, squares };
        (freed.unknowns() <= MOST_COLUMNS).then_some(freed)
    }

    fn unknowns(&self) -> usize {
        self.own.iter().map(|own| if *own { self.runs.len() } else { 1 }).sum()
    }

    /// Values that are compared.
    fn compared(&self) -> f64 {
        self.squares.iter().map(|(_, count)| *count as f64).sum()
    }

    /// The states whose initial values a fit is worth, by what is expected of it.
    fn worth_a_fit(&self) -> Option<Vec<usize>> {
        let step = self.step()?;
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

    /// All runs with sensitivities to what may move, block by block to `sink` with the run.
    fn stream(&self, sink: &mut dyn FnMut(usize, Block<'_>)) -> Option<()> {
        for (r, (run, theta)) in self.runs.iter().zip(self.thetas).enumerate() {
            let mut whole = theta.clone();
            whole.extend(&self.stated[r]);
            let steps = self.fit.integration.get(r)?.steps.clone();
            let mut simulator = Simulator::new(self.model.dynamics(), run, steps).ok()?;
            simulator.suits(&whole).ok()?;
            simulator.stream(&whole, &self.open, &mut |block| sink(r, block)).ok()?;
        }
        Some(())
    }

    /// The normal equations at the estimates, outputs weighed by their residuals.
    fn step(&self) -> Option<Step> {
        let mut next = 0;
        let mut shared = vec![0; self.open.len()];
        for (place, _) in shared.iter_mut().zip(&self.own).filter(|(_, own)| !**own) {
            *place = next;
            next += 1;
        }
        let of_run = |_| {
            let of = |(own, shared): (&bool, &usize)| {
                if *own {
                    next += 1;
                    next - 1
                } else {
                    *shared
                }
            };
            self.own.iter().zip(&shared).map(of).collect()
        };
        let place: Vec<Vec<usize>> = (0..self.runs.len()).map(of_run).collect();
        let weight = |(sum, count): &(f64, usize)| if *sum > 0.0 { *count as f64 / sum } else { 0.0 };
        let weights: Vec<f64> = self.squares.iter().map(weight).collect();
        let (mut information, mut score) = (DMatrix::zeros(next, next), DVector::zeros(next));
        self.stream(&mut |r, block| {
            for sample in 0..block.samples() {
                for (o, weight) in weights.iter().enumerate() {
                    let residual = block.residual(&self.runs[r].measured, sample, o);
                    if residual.is_nan() {
                        continue;
                    }
                    let (columns, row) = (&block.layout.outputs[o].columns, block.row(sample, o));
                    for (a, (i, left)) in columns.iter().zip(row).enumerate() {
                        let i = place[r][*i as usize];
                        score[i] += weight * left * residual;
                        for (j, right) in columns.iter().zip(row).take(a + 1) {
                            information[(i, place[r][*j as usize])] += weight * left * right;
                        }
                    }
                }
            }
        })?;
        // columns of an output rise, unknowns need not
        let whole = &information + information.transpose() - DMatrix::from_diagonal(&information.diagonal());
        whole.iter().all(|v: &f64| v.is_finite()).then_some(Step { place, information: whole, score })
    }

    /// What freeing would raise the logarithm of the likelihood by, were the model linear, with the number of independent values that it is known from: each
    /// output counts as many as its residuals behind the step are worth, by their correlation.
    fn expected(&self, step: &Step, moves: &DVector<f64>) -> Option<(f64, f64)> {
        let q = self.squares.len();
        let mut left: Vec<Vec<Vec<f64>>> = vec![vec![Vec::new(); self.runs.len()]; q];
        self.stream(&mut |r, block| {
            for sample in 0..block.samples() {
                for (o, left) in left.iter_mut().enumerate() {
                    let residual = block.residual(&self.runs[r].measured, sample, o);
                    if residual.is_nan() {
                        continue;
                    }
                    let columns = block.layout.outputs[o].columns.iter().zip(block.row(sample, o));
                    let moved: f64 = columns.map(|(i, s)| s * moves[step.place[r][*i as usize]]).sum();
                    left[r].push(residual - moved);
                }
            }
        })?;
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
    1.0 + 2.0 * (1..longest.min(MOST_LAGS)).map(lag).take_while(|r| *r > 0.0).sum::<f64>()
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
        let first = freed.open.len() - freed.initials.len();
        let initials: Vec<Vec<usize>> =
            (first..freed.open.len()).map(|k| step.place.iter().map(|places| places[k]).collect()).collect();
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
