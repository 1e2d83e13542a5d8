//! What has no name: a disturbance at a place, and a function of one signal in an equation. Both are many columns whose coefficients have a
//! common prior, averaged over their size and smoothness, and judged as everything else is.

use super::state::{Ground, Judged, STAND_IN, State};
use crate::candidates::forced_response::ForcedResponse;
use crate::candidates::place::{Place, PlaceKind, places};
use crate::evidence::binning::RunBins;
use crate::evidence::gram::Grams;
use crate::evidence::question::Question;
use fdm_grammar::graph::{Leaf, Node};
use fdm_numeric::parallel;
use nalgebra::DMatrix;

/// Hats over each run, and how many of them first-order noise remembers.
const HATS: usize = 36;
const MEMORY: f64 = 3.0;
/// Sizes of the motion, in deviations of an output, that are averaged: from one two-hundredth to one and a half.
const SIZES: (f64, f64, usize) = (0.005, 1.5, 7);
/// Sizes that are asked first, by their places, and nats over the state alone below which the others are not asked: no prior odds let them matter.
const FIRST: [usize; 2] = [2, 4];
const MATTERS: f64 = 3.0;
/// Nats behind the best size from which it adds nothing to the mean.
const BEHIND: f64 = 8.0;
const ROUNDS: usize = 4;
/// Log prior odds of what has no name against a mechanism: a stand-in of two numbers, its size and its smoothness.
const UNNAMED: f64 = 2.0 * STAND_IN;
/// Half waves of a law over its signal's range, and those of a coefficient.
const WAVES: usize = 25;
const OF_COEFFICIENT: usize = 8;
/// Half waves at which the variance of a smooth law has fallen to a quarter.
const SMOOTH: f64 = 3.0;

/// Something without a name, at a place.
#[derive(Debug, Clone)]
pub(crate) struct Unnamed {
    pub(crate) place: Place,
    /// The signal that it is a function of; none of a disturbance.
    pub(crate) signal: Option<String>,
    /// Evidence with prior odds, beside the state alone (nats).
    pub(crate) log: f64,
    /// The likeliest function.
    pub(crate) curve: Option<Waves>,
}

/// A function of a signal.
#[derive(Debug, Clone)]
pub(crate) struct Waves {
    /// Least and greatest value of the signal.
    pub(crate) ends: (f64, f64),
    /// Places of waves (cosine and sine of each number of half waves), and their amounts.
    amounts: Vec<(usize, f64)>,
}

/// Evidence over sizes, and the mean of the likeliest.
struct Averaged {
    logs: Vec<f64>,
    likeliest: (f64, Vec<f64>),
}

impl Waves {
    /// Its value.
    pub(crate) fn at(&self, v: f64) -> f64 {
        let wave = |(c, amount): &(usize, f64)| {
            let phase = phase(1 + c / 2, v, self.ends);
            amount * if c % 2 == 0 { phase.cos() } else { phase.sin() }
        };
        self.amounts.iter().map(wave).sum()
    }

    /// Half waves up to which it has all but this share of its squares.
    pub(crate) fn half_waves(&self, but: f64) -> usize {
        let squares = |beyond: usize| {
            let of = self.amounts.iter().filter(|(c, _)| 1 + c / 2 > beyond);
            of.map(|(_, amount)| amount * amount).sum::<f64>()
        };
        (0..WAVES).find(|m| squares(*m) <= but * squares(0)).unwrap_or(WAVES)
    }
}

/// Of so many half waves between two ends.
fn phase(half_waves: usize, v: f64, ends: (f64, f64)) -> f64 {
    std::f64::consts::PI * half_waves as f64 * (v - ends.0) / (ends.1 - ends.0)
}

/// The responses of all runs to courses of a disturbance at all places, in bins: place, course, run.
struct Forced {
    places: Vec<Place>,
    bins: Vec<Vec<Vec<Vec<f64>>>>,
}

/// Sizes that are averaged.
fn sizes() -> impl Iterator<Item = f64> {
    let (low, high, count) = SIZES;
    (0..count).map(move |k| low * (high / low).powf(k as f64 / (count - 1) as f64))
}

/// Least and greatest.
pub(crate) fn extent<'v>(values: impl Iterator<Item = &'v f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)))
}

/// The logarithm of a sum of exponentials.
pub(crate) fn log_sum(values: &[f64]) -> f64 {
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if most.is_finite() { most + values.iter().map(|v| (v - most).exp()).sum::<f64>().ln() } else { most }
}

impl Ground<'_> {
    /// Responses to `courses` (of each run) at these places; none where a run has none.
    fn forced(&self, state: &State, places: &[Place], courses: &[Vec<Vec<f64>>]) -> Option<Forced> {
        let model = &state.text.model;
        let forced = ForcedResponse::new(model, places);
        let count = courses.first().map_or(0, Vec::len);
        let of = |r: usize| -> Option<Vec<Vec<Vec<f64>>>> {
            let steps = state.text.predictors[r].steps()?;
            let run = &self.runs.all[r];
            let mut bins = vec![vec![Vec::new(); count]; places.len()];
            let take = &mut |place: usize, course: usize, response: Vec<f64>| {
                bins[place][course] = self.binning.runs[r].of(&response, false);
            };
            forced.respond((run, steps), &state.theta[r], &courses[r], take)?;
            bins.iter().flatten().flatten().all(|v| v.is_finite()).then_some(bins)
        };
        let of_runs = parallel::map(0..self.runs.all.len(), of).into_iter().collect::<Option<Vec<_>>>()?;
        let bins = (0..places.len())
            .map(|p| (0..count).map(|c| of_runs.iter().map(|own| own[p][c].clone()).collect()).collect())
            .collect();
        Some(Forced { places: places.to_vec(), bins })
    }

    /// A course (by its place) of each run, in an output alone, in bins.
    fn shown(&self, output: usize, course: usize, courses: &[Vec<Vec<f64>>]) -> Vec<Vec<f64>> {
        let q = self.binning.outputs;
        let of = |(own, bins): (&Vec<Vec<f64>>, &RunBins)| {
            let mut signal = vec![0.0; own[course].len() * q];
            own[course].iter().enumerate().for_each(|(k, v)| signal[k * q + output] = *v);
            bins.of(&signal, false)
        };
        courses.iter().zip(&self.binning.runs).map(of).collect()
    }

    /// Root mean square of what unit coefficients of these columns do together, in deviations of the output that they move most.
    fn motion(&self, columns: &[Vec<Vec<f64>>]) -> f64 {
        let bands = self.binning.bands;
        let of = |output: usize| {
            let (mut sum, mut count) = (0.0, 0);
            for (r, run) in self.binning.runs.iter().enumerate() {
                for segment in run.segments.iter().filter(|s| s.place / bands == output) {
                    count += segment.end - segment.begin;
                    let own =
                        columns.iter().map(|c| c[r][segment.begin..segment.end].iter().map(|v| v * v).sum::<f64>());
                    sum += own.sum::<f64>();
                }
            }
            (sum / f64::from(u32::try_from(count.max(1)).unwrap_or(u32::MAX))).sqrt() / self.deviations[output]
        };
        (0..self.binning.outputs).map(of).fold(0.0, f64::max)
    }

    /// Evidence with random columns of each run's own or of all, averaged over sizes: `grams` has them behind the run's own columns or the shared
    /// ones.
    fn averaged(
        &self,
        grams: &Grams,
        (state, judged): (&State, &Judged),
        (count, own): (usize, bool),
        raw: f64,
    ) -> Averaged {
        let precision = self.precision(state);
        let q = precision.len();
        let plain = self.plain_weights(&judged.linear.grams);
        let sizes: Vec<f64> = sizes().collect();
        let mut found = vec![f64::NEG_INFINITY; sizes.len()];
        let (mut weights, mut likeliest): (Option<Vec<f64>>, (f64, Vec<f64>)) = (None, (f64::NEG_INFINITY, Vec::new()));
        let mut ask = |k: usize, found: &mut Vec<f64>| {
            let prior = (raw / sizes[k]).powi(2);
            let (mut shared, mut of_run) = (precision.clone(), self.own_precision(state));
            if own {
                of_run.resize(state.text.own.len() + count, prior);
            } else {
                shared.resize(q + count, prior);
            }
            let question = Question { grams, noise: &self.binning.noise, precision: &shared, own: &of_run };
            let begun: Vec<&[f64]> = match &weights {
                Some(last) => vec![last],
                None => vec![&judged.evidence.weights, &plain],
            };
            let answers = begun.iter().filter_map(|w| question.answer_within(ROUNDS, Some(w)));
            if let Some(answer) = answers.max_by(|a, b| a.log.total_cmp(&b.log)) {
                found[k] = answer.log;
                if !own && answer.log > likeliest.0 {
                    likeliest = (answer.log, answer.mean[q..].to_vec());
                }
                weights = Some(answer.weights);
            }
        };
        FIRST.iter().for_each(|k| ask(*k, &mut found));
        let best = |found: &[f64]| found.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if best(&found) < judged.evidence.log + MATTERS {
            return Averaged { logs: found, likeliest };
        }
        // outwards from the first ones, as long as that adds something
        for k in FIRST[0] + 1..FIRST[1] {
            ask(k, &mut found);
        }
        for k in (0..FIRST[0]).rev() {
            ask(k, &mut found);
            if found[k] < best(&found) - BEHIND {
                break;
            }
        }
        for k in FIRST[1] + 1..sizes.len() {
            ask(k, &mut found);
            if found[k] < best(&found) - BEHIND {
                break;
            }
        }
        Averaged { logs: found, likeliest }
    }

    /// Courses of their own in every run, in each equation (disturbances) and each output (what nothing in the model explains): with evidence
    /// beside the state, the likeliest first.
    pub(crate) fn disturbances(&self, (state, judged): (&State, &Judged)) -> Vec<Unnamed> {
        let places: Vec<Place> =
            places(&state.text.model).into_iter().filter(|p| p.kind == PlaceKind::Equation).collect();
        let hats = |r: usize| -> Vec<Vec<f64>> {
            let n = self.runs.all[r].len();
            let width = (n - 1) as f64 / (HATS - 1) as f64;
            let hat = |k: usize| (0..n).map(|i| (1.0 - (i as f64 / width - k as f64).abs()).max(0.0)).collect();
            (0..HATS).map(hat).collect()
        };
        let courses: Vec<Vec<Vec<f64>>> = (0..self.runs.all.len()).map(hats).collect();
        let Some(Forced { mut places, mut bins }) = self.forced(state, &places, &courses) else { return Vec::new() };
        let outputs = state.text.model.definition().outputs.iter().enumerate();
        for (output, own) in outputs {
            let name = own.quantity.name.clone();
            places.push(Place { kind: PlaceKind::Output, index: output, name });
            bins.push((0..HATS).map(|k| self.shown(output, k, &courses)).collect());
        }
        let remembered = DMatrix::from_fn(HATS, HATS, |i, j| {
            (-(i as f64 - j as f64).abs() / MEMORY).exp() + if i == j { 1e-9 } else { 0.0 }
        });
        let Some(root) = remembered.cholesky().map(|c| c.l()) else { return Vec::new() };
        let count = places.len() as f64;
        let base = judged.evidence.log;
        let one = |(place, columns): (Place, Vec<Vec<Vec<f64>>>)| -> Option<Unnamed> {
            let raw = self.motion(&columns);
            if raw.is_nan() || raw <= 0.0 {
                return None;
            }
            let mut logs = Vec::new();
            for memory in [false, true] {
                let mut grams = Grams::new(self.binning.outputs, self.binning.bands, state.text.shared.len());
                for (r, bins) in self.binning.runs.iter().enumerate() {
                    let own = state.text.own.len();
                    let mut all: Vec<Vec<f64>> = judged.linear.columns[r][..own].to_vec();
                    if memory {
                        all.extend((0..HATS).map(|j| {
                            let mut sum = vec![0.0; bins.length];
                            for k in j..HATS {
                                sum.iter_mut().zip(&columns[k][r]).for_each(|(s, v)| *s += root[(k, j)] * v);
                            }
                            sum
                        }));
                    } else {
                        all.extend(columns.iter().map(|c| c[r].clone()));
                    }
                    all.extend(judged.linear.columns[r][own..].iter().cloned());
                    grams.add(own + HATS, &bins.segments, &all);
                }
                logs.extend(self.averaged(&grams, (state, judged), (HATS, true), raw).logs);
            }
            let log = log_sum(&logs) - (logs.len() as f64).ln() - base - count.ln() + UNNAMED;
            Some(Unnamed { place, signal: None, log, curve: None })
        };
        let mut found: Vec<Unnamed> = parallel::map(places.into_iter().zip(bins), one).into_iter().flatten().collect();
        found.sort_by(|a, b| b.log.total_cmp(&a.log));
        found
    }

    /// Functions of one signal, the same in every run, in each equation (beyond a constant and a slope) or in the place of a coefficient: with evidence
    /// beside the state, the likeliest first.
    pub(crate) fn laws(&self, (state, judged): (&State, &Judged)) -> Vec<Unnamed> {
        let definition = state.text.model.definition();
        let mut entries: Vec<Place> =
            places(&state.text.model).into_iter().filter(|p| p.kind == PlaceKind::Equation).collect();
        let moves = |k: &&usize| {
            let by = definition.graph.depends(|leaf| matches!(leaf, Leaf::Param(p) if p as usize == **k));
            definition.states.iter().any(|s| by[s.rate.index()])
        };
        entries.extend(state.text.shared.iter().filter(|k| **k < definition.params.len()).filter(moves).map(|k| {
            Place { kind: PlaceKind::Coefficient, index: *k, name: definition.params[*k].quantity.name.clone() }
        }));
        let signals = self.signals(state);
        let count = (entries.len() * signals.len()) as f64;
        let (base, mut found) = (judged.evidence.log, Vec::new());
        for (name, courses) in signals {
            let ends = extent(courses.iter().flatten());
            if ends.1 - ends.0 <= 0.0 || !(ends.1 - ends.0).is_finite() {
                continue;
            }
            let waves = |course: &Vec<f64>| -> Vec<Vec<f64>> {
                let of = |m: usize| {
                    [
                        course.iter().map(|v| phase(m, *v, ends).cos()).collect(),
                        course.iter().map(|v| phase(m, *v, ends).sin()).collect(),
                    ]
                };
                (1..=WAVES).flat_map(of).collect()
            };
            let courses: Vec<Vec<Vec<f64>>> = courses.iter().map(waves).collect();
            let Some(Forced { places, bins }) = self.forced(state, &entries, &courses) else { continue };
            let one = |(place, columns): (Place, Vec<Vec<Vec<f64>>>)| -> Option<Unnamed> {
                let used = match place.kind {
                    PlaceKind::Coefficient => 0..2 * OF_COEFFICIENT,
                    _ => 2..2 * WAVES,
                };
                let mut logs: Vec<f64> = Vec::new();
                let mut curve: (f64, Vec<(usize, f64)>) = (f64::NEG_INFINITY, Vec::new());
                for smooth in [true, false] {
                    let scale = |c: usize| {
                        let m = (1 + c / 2) as f64;
                        if smooth { 1.0 / (1.0 + (m / SMOOTH).powi(2)) } else { 1.0 }
                    };
                    let of = |c: usize| -> Vec<Vec<f64>> {
                        columns[c].iter().map(|v| v.iter().map(|v| v * scale(c)).collect()).collect()
                    };
                    let scaled: Vec<Vec<Vec<f64>>> = used.clone().map(of).collect();
                    let raw = self.motion(&scaled);
                    if raw.is_nan() || raw <= 0.0 {
                        return None;
                    }
                    let own = state.text.own.len();
                    let shared = state.text.shared.len() + scaled.len();
                    let mut grams = Grams::new(self.binning.outputs, self.binning.bands, shared);
                    for (r, bins) in self.binning.runs.iter().enumerate() {
                        let mut all = judged.linear.columns[r].clone();
                        all.extend(scaled.iter().map(|c| c[r].clone()));
                        grams.add(own, &bins.segments, &all);
                    }
                    let found = self.averaged(&grams, (state, judged), (scaled.len(), false), raw);
                    logs.extend(found.logs);
                    if found.likeliest.0 > curve.0 {
                        let of = |(c, mean): (usize, &f64)| (used.start + c, mean * scale(used.start + c));
                        curve = (found.likeliest.0, found.likeliest.1.iter().enumerate().map(of).collect());
                    }
                }
                let log = log_sum(&logs) - (logs.len() as f64).ln() - base - count.ln() + UNNAMED;
                let curve = Some(Waves { ends, amounts: curve.1 });
                Some(Unnamed { place, signal: Some(name.clone()), log, curve })
            };
            found.extend(parallel::map(places.into_iter().zip(bins), one).into_iter().flatten());
        }
        found.sort_by(|a, b| b.log.total_cmp(&a.log));
        found
    }

    /// States and declared inputs over all runs: as recorded where an output is the state itself, since a model in error is out of phase.
    pub(crate) fn signals(&self, state: &State) -> Vec<(String, Vec<Vec<f64>>)> {
        let Some(fitted) = state.fitted(self.runs) else { return Vec::new() };
        let definition = state.text.model.definition();
        let (states, _) = crate::candidates::extended_model::states_and_outputs(&fitted, self.runs.all);
        let (n, m, q) = (definition.states.len(), definition.inputs.len(), definition.outputs.len());
        let mut found = Vec::new();
        for (j, own) in definition.states.iter().enumerate() {
            let is_it =
                |o: &fdm_grammar::model::Output| definition.graph.node(o.expr) == Node::Leaf(Leaf::State(j as u32));
            let shown = definition.outputs.iter().position(is_it);
            let course = |r: usize| -> Vec<f64> {
                let simulated = states[r].iter().skip(j).step_by(n.max(1)).copied();
                let recorded = |o: usize| self.runs.all[r].measured.iter().skip(o).step_by(q).copied();
                match shown {
                    Some(o) => simulated.zip(recorded(o)).map(|(x, z)| if z.is_nan() { x } else { z }).collect(),
                    None => simulated.collect(),
                }
            };
            found.push((own.quantity.name.clone(), (0..self.runs.all.len()).map(course).collect()));
        }
        for (k, input) in definition.inputs.iter().enumerate().filter(|(_, i)| i.is_declared()) {
            let course = |run: &fdm_system::record::Run| run.inputs.iter().skip(k).step_by(m).copied().collect();
            found.push((input.quantity.name.clone(), self.runs.all.iter().map(course).collect()));
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_exponentials_do_not_overflow() {
        assert!((log_sum(&[0.0, 0.0]) - 2.0_f64.ln()).abs() < 1e-12);
        assert!((log_sum(&[3000.0, 2990.0]) - (3000.0 + (-10.0_f64).exp().ln_1p())).abs() < 1e-9);
        assert_eq!(log_sum(&[f64::NEG_INFINITY, f64::NEG_INFINITY]), f64::NEG_INFINITY);
    }

    #[test]
    fn sizes_go_from_one_two_hundredth_to_one_and_a_half() {
        let all: Vec<f64> = sizes().collect();
        assert!(all.len() == 7 && (all[0] - 0.005).abs() < 1e-12 && (all[6] - 1.5).abs() < 1e-12);
    }
}
