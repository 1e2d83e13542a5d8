//! Experiments: levels of conditions and initial amounts, and the times of samples, that are planned together.
//!
//! Levels are sought on a grid over their ranges and around its best corners by steps that are halved; times are exchanged with others of
//! the sampling grid while that gains (Fedorov 1972; Atkinson, Donev and Tobias 2007, chapter 12). Experiments are added one after the other,
//! and then each is sought anew beside all others, until none gets better: the best runs of all are seldom the best ones one by one.

use super::plan::{Asked, Question, STOPPED, exceeded, excursions, known, outlook, sizes};
use crate::experiment::Table;
use fdm_estimate::{Halt, Information, SampleInformation};
use fdm_numeric::parallel;
use fdm_results::documents::design::{Experiment, Experiments, Level};
use fdm_system::record::Run;

/// What experiments are planned in: of the question, inputs and their motion have no part.
#[derive(Debug, Clone)]
pub struct DesignSpace<'a> {
    /// The model, what is known of it, the times (`dt` apart) among which samples are taken, and the number of runs.
    pub question: Question<'a>,
    /// What an experiment may be set to.
    pub factors: Vec<Factor>,
    /// How many samples are taken of it; at all times where nothing is said.
    pub samples: Option<usize>,
}

/// Something that an experiment may be set to.
#[derive(Debug, Clone, PartialEq)]
pub struct Factor {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: Option<String>,
    /// What it is in the model.
    pub place: Place,
    /// From where to where.
    pub range: [f64; 2],
}

/// What a factor is in the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// An input, held through the run, or a value that runs bring.
    Input(usize),
    /// A parameter of the run, such as an amount at its beginning: set to about this, and still estimated.
    Param(usize),
}

/// The response of a planned experiment at all times of the grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    /// The times (N).
    pub time: Vec<f64>,
    /// The outputs (N by q).
    pub response: Vec<f64>,
}

/// Points of the first grid along each factor, by the number of factors, so that there are some dozens of places; of more factors the
/// first six at their ends, the others in the middle.
const POINTS: [usize; 5] = [1, 9, 5, 3, 3];
const AT_ENDS: usize = 6;
/// Most times of a grid: each has a matrix, and is tried at every place.
const MOST_TIMES: f64 = 2000.0;
/// Places of the grid around which levels are sought further.
const PLACES: usize = 3;
/// Halvings of the step around them: the last is a ten-thousandth of the range.
const HALVINGS: usize = 12;
/// A gain in bits that is one: below it rounding decides.
const GAIN: f64 = 1e-9;
/// Most rounds of exchanges: each gains, so they end by themselves, mostly after two or three.
const ROUNDS: usize = 20;

/// An experiment and what it tells.
#[derive(Clone)]
struct Chosen {
    values: Vec<f64>,
    /// Places on the grid, rising.
    times: Vec<usize>,
    told: Information,
    /// Bits of it and all that it is beside.
    bits: f64,
    response: Vec<f64>,
}

/// Plans experiments; of work that is stopped the best so far.
///
/// # Errors
/// Everything that makes it impossible, one sentence each.
pub fn experiments(space: &DesignSpace<'_>, halt: &Halt) -> Result<(Experiments, Vec<Course>), Vec<String>> {
    let question = &space.question;
    space.examine().map_err(|all| all.iter().map(ToString::to_string).collect::<Vec<_>>())?;
    let now = known(question).map_err(|e| vec![e.to_string()])?;
    let search = Search { space, sizes: sizes(question), halt };
    let mut chosen: Vec<Chosen> = Vec::new();
    for _ in 0..question.runs {
        if !halt.goes_on() && !chosen.is_empty() {
            break;
        }
        let beside = chosen.iter().fold(now.clone(), |sum, one| sum.plus(&one.told));
        chosen.push(search.best(&beside, None).map_err(|e| vec![e])?);
    }
    for _ in 0..ROUNDS {
        let mut better = false;
        for k in 0..chosen.len() {
            if !halt.goes_on() {
                break;
            }
            let others = chosen.iter().enumerate().filter(|(j, _)| *j != k);
            let beside = others.fold(now.clone(), |sum, (_, one)| sum.plus(&one.told));
            let before = beside.plus(&chosen[k].told).bits(&search.sizes);
            let found = search.best(&beside, Some(&chosen[k])).map_err(|e| vec![e])?;
            if found.bits > before + GAIN {
                (chosen[k], better) = (found, true);
            }
        }
        if !better || chosen.len() < 2 {
            break;
        }
    }
    Ok(document(space, &now, &chosen, &search.sizes))
}

fn document(
    space: &DesignSpace<'_>,
    now: &Information,
    chosen: &[Chosen],
    sizes: &[f64],
) -> (Experiments, Vec<Course>) {
    let question = &space.question;
    let time: Vec<f64> = (0..question.samples()).map(|k| question.dt * k as f64).collect();
    let (mut sum, mut after, mut planned) = (now.clone(), Vec::new(), Vec::new());
    for one in chosen {
        let before = sum.bits(sizes);
        sum = sum.plus(&one.told);
        after.push(sum.clone());
        let level = |(s, value): (&Factor, &f64)| Level { name: s.name.clone(), unit: s.unit.clone(), value: *value };
        planned.push(Experiment {
            levels: space.factors.iter().zip(&one.values).map(level).collect(),
            times: one.times.iter().map(|k| time[*k]).collect(),
            bits: sum.bits(sizes) - before,
            excursions: excursions(&one.response, question.deviations.len()),
        });
    }
    let course = |one: &Chosen| Course { time: time.clone(), response: one.response.clone() };
    let found = Experiments {
        outlook: outlook(question, now, &after, &[]),
        covariance: [now.covariance(), sum.covariance()],
        undetermined_now: now.undetermined(),
        undetermined_then: sum.undetermined(),
        experiments: planned,
    };
    (found, chosen.iter().map(course).collect())
}

struct Search<'q, 'm> {
    space: &'q DesignSpace<'m>,
    sizes: Vec<f64>,
    halt: &'q Halt,
}

impl Search<'_, '_> {
    /// The experiment that tells most beside what is known; from an earlier choice too.
    fn best(&self, beside: &Information, from: Option<&Chosen>) -> Result<Chosen, String> {
        let mut starts = corners(&self.space.factors);
        starts.extend(from.map(|one| one.values.clone()));
        let tried: Vec<Result<Chosen, String>> = parallel::map(starts.iter(), |values| self.told(beside, values, None));
        let mut reason = String::from(STOPPED);
        let mut good = Vec::new();
        for one in tried {
            match one {
                Ok(one) => good.push(one),
                Err(e) => reason = e,
            }
        }
        // equal ones stay in the order of the grid
        good.sort_by(|a, b| b.bits.total_cmp(&a.bits));
        good.truncate(PLACES);
        let refined: Vec<Chosen> = parallel::map(good.iter(), |one| self.refined(beside, one));
        refined.into_iter().reduce(|a, b| if b.bits > a.bits { b } else { a }).ok_or(reason)
    }

    /// Goes on from a choice of levels by steps along each of them, halved where none gains.
    fn refined(&self, beside: &Information, from: &Chosen) -> Chosen {
        let mut best = from.clone();
        let factors = &self.space.factors;
        for halving in 1..=HALVINGS {
            for (k, factor) in factors.iter().enumerate() {
                let part = 0.5_f64.powi(halving as i32) / (points(factors.len(), k).max(2) - 1) as f64;
                let step = part * (factor.range[1] - factor.range[0]);
                for way in [step, -step] {
                    while self.halt.goes_on() {
                        let mut values = best.values.clone();
                        values[k] = (values[k] + way).clamp(factor.range[0], factor.range[1]);
                        let next = self.told(beside, &values, Some(&best.times)).ok();
                        let Some(next) = next.filter(|next| next.bits > best.bits + GAIN) else { break };
                        best = next;
                    }
                }
            }
        }
        best
    }

    /// What an experiment tells with its best times, sought from earlier ones where there are some.
    fn told(&self, beside: &Information, values: &[f64], times: Option<&[usize]>) -> Result<Chosen, String> {
        if !self.halt.goes_on() && times.is_some() {
            return Err(STOPPED.into());
        }
        let question = &self.space.question;
        let (run, theta) = set(self.space, values);
        let samples = SampleInformation::of(question.model, &run, &theta, &question.deviations);
        let samples = samples.map_err(|e| e.to_string())?;
        let moved = excursions(&samples.response, question.deviations.len());
        if let Some(reason) = exceeded(question, &moved) {
            return Err(reason);
        }
        let bits = |times: &[usize]| beside.plus(&samples.taken(times)).bits(&self.sizes);
        let times = self.times(samples.len(), times, &bits);
        let told = samples.taken(&times);
        let bits = beside.plus(&told).bits(&self.sizes);
        Ok(Chosen { values: values.to_vec(), times, told, bits, response: samples.response })
    }

    /// The best times of so many: one after the other, then each exchanged while that gains.
    fn times(&self, count: usize, from: Option<&[usize]>, bits: &dyn Fn(&[usize]) -> f64) -> Vec<usize> {
        let wanted = self.space.samples.filter(|n| *n < count);
        let Some(wanted) = wanted else { return (0..count).collect() };
        let mut times: Vec<usize> = from.map_or_else(Vec::new, <[usize]>::to_vec);
        let best_of = |times: &[usize], place: usize| {
            let mut tried = times.to_vec();
            let mut best: Option<(usize, f64)> = None;
            for k in (0..count).filter(|k| !times.contains(k)) {
                tried[place] = k;
                let told = bits(&tried);
                if best.is_none_or(|(_, most)| told > most + GAIN) {
                    best = Some((k, told));
                }
            }
            best
        };
        while times.len() < wanted {
            // a place that is none, and so taken by no time
            times.push(usize::MAX);
            let place = times.len() - 1;
            let Some((k, _)) = best_of(&times, place) else { break };
            times[place] = k;
        }
        for _ in 0..ROUNDS {
            let mut better = false;
            for place in 0..times.len() {
                let now = bits(&times);
                if let Some((k, _)) = best_of(&times, place).filter(|(_, told)| *told > now + GAIN) {
                    (times[place], better) = (k, true);
                }
            }
            if !better {
                break;
            }
        }
        times.sort_unstable();
        times
    }
}

/// Points of the first grid along the factor at a place, of so many factors.
fn points(count: usize, place: usize) -> usize {
    POINTS.get(count).copied().unwrap_or(if place < AT_ENDS { 2 } else { 1 })
}

/// The points of a grid over all ranges.
fn corners(factors: &[Factor]) -> Vec<Vec<f64>> {
    let mut all = vec![Vec::new()];
    for (place, factor) in factors.iter().enumerate() {
        let points = points(factors.len(), place);
        let share = |k: usize| if points > 1 { k as f64 / (points - 1) as f64 } else { 0.5 };
        let value = |k: usize| factor.range[0] + (factor.range[1] - factor.range[0]) * share(k);
        let longer = |values: &Vec<f64>| -> Vec<Vec<f64>> {
            (0..points).map(|k| values.iter().copied().chain([value(k)]).collect()).collect()
        };
        all = all.iter().flat_map(longer).collect();
    }
    all
}

/// The run of these levels, all times of the grid measured, and its parameters.
fn set(space: &DesignSpace<'_>, values: &[f64]) -> (Run, Vec<f64>) {
    let question = &space.question;
    let (mut rest, mut theta) = (question.rest.clone(), question.theta.clone());
    for (factor, value) in space.factors.iter().zip(values) {
        match factor.place {
            Place::Input(k) => rest[k] = *value,
            Place::Param(k) => theta[k] = *value,
        }
    }
    (question.resting("experiment", &rest), theta)
}

/// The times and levels of an experiment as columns: what is to be measured is filled in.
pub fn sheet(space: &DesignSpace<'_>, experiment: &Experiment, name: &str) -> Table {
    let values: Vec<f64> = experiment.levels.iter().map(|level| level.value).collect();
    let (run, _) = set(space, &values);
    let count = experiment.times.len();
    let mut table = space.question.columns(&run, name);
    for (_, _, column) in &mut table.columns {
        column.truncate(1);
        column.resize(count, column.first().copied().unwrap_or_default());
    }
    if let Some((_, _, time)) = table.columns.first_mut() {
        time.clone_from(&experiment.times);
    }
    for (level, factor) in experiment.levels.iter().zip(&space.factors) {
        if let Place::Param(_) = factor.place {
            table.columns.push((level.name.clone(), level.unit.clone(), vec![level.value; count]));
        }
    }
    table
}

impl DesignSpace<'_> {
    /// Everything that makes it impossible to plan experiments.
    fn examine(&self) -> Result<(), Vec<Asked>> {
        let question = &self.question;
        let mut found = question.examine_parts();
        for factor in &self.factors {
            let [from, to] = factor.range;
            let bad = !(from.is_finite() && to.is_finite() && from < to);
            found.extend(bad.then(|| Asked::Range { name: factor.name.clone(), from, to }));
        }
        let times = question.duration / question.dt + 1.0;
        if !(1.0..=MOST_TIMES).contains(&times) {
            found.push(Asked::Grid { times: times.round(), most: MOST_TIMES });
        } else if let Some(samples) = self.samples.filter(|n| !(1..=question.samples()).contains(n)) {
            found.push(Asked::Taken { samples, times: question.samples() });
        }
        if found.is_empty() { Ok(()) } else { Err(found) }
    }
}
