//! What a nonlinearity may be made of: powers and products of states and inputs, what jumps or saturates, and what remembers; as few
//! independent courses as hold nearly all of it.
//!
//! States and inputs of all runs, brought to one size.
//!
//! Functions of a signal's past: what lags, has play, or sticks.

use super::super::forced_response::ForcedResponse;
use super::super::place::{DisturbanceError, FittedRun};
use super::{Curve, CurvePoint};
use fdm_system::model::Model;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Most functions; products of three are left out beyond it, then those of two.
const MOST: usize = 160;
/// Time constants of lags, as parts of the longest run.
const LAGS: [f64; 2] = [0.01, 0.04];
/// How far a sticking disturbance is carried before it yields, at its mean speed: parts of the longest run.
const REACHES: [f64; 3] = [0.005, 0.017, 0.06];
/// Half width of a play, as a part of the largest distance.
const PLAY: f64 = 0.2;
/// Steepness of what saturates.
const STEEP: [f64; 2] = [20.0, 5.0];
/// Points at which a curve is drawn.
const DRAWN: usize = 97;
/// Courses of less than this part of the largest variance are rounding.
const ROUNDING: f64 = 1e-7;

/// Courses of one function in all runs.
type Course = Vec<Vec<f64>>;

/// What a nonlinearity may be made of.
pub(super) struct Functions {
    /// At most so many courses (runs, courses, N) as are asked for, not correlated with each other over all runs, the most
    /// common first; each has the variance that it has among all functions.
    pub(super) courses: Vec<Vec<Vec<f64>>>,
    /// Every function by itself, as a combination of the courses (functions by courses).
    pub(super) single: DMatrix<f64>,
    /// So many neighbours in `single` are one function in several phases.
    pub(super) alike: usize,
    /// The variable of which all are functions; none of functions of several variables.
    pub(super) curve: Option<Range>,
}

/// Waves over one variable.
pub(super) struct Range {
    variable: String,
    low: f64,
    high: f64,
    /// By what each was divided.
    sizes: Vec<f64>,
}

impl Range {
    /// The curve and its deviation, from coefficients of the courses and their covariance.
    pub(super) fn curve(&self, single: &DMatrix<f64>, (mean, covariance): (&DVector<f64>, &DMatrix<f64>)) -> Curve {
        let point = |k: usize| {
            let at = k as f64 / (DRAWN - 1) as f64;
            let waves = DVector::from_fn(self.sizes.len(), |k, _| match self.sizes[k] {
                0.0 => 0.0,
                size => wave(k, at) / size,
            });
            let courses = single.tr_mul(&waves);
            CurvePoint {
                at: self.low + at * (self.high - self.low),
                value: courses.dot(mean),
                deviation: (covariance * &courses).dot(&courses).max(0.0).sqrt(),
            }
        };
        Curve { variable: self.variable.clone(), points: (0..DRAWN).map(point).collect() }
    }
}

/// All functions of these variables in at most so many courses; none where nothing changes.
pub(super) fn functions(variables: &[Variable], most: usize) -> Option<Functions> {
    let first = variables.first()?;
    let longest = first.centred.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let mut all: Vec<Course> = vec![first.centred.iter().map(|run| vec![1.0; run.len()]).collect()];
    all.extend(variables.iter().flat_map(|v| singles(v, longest)));
    products(variables, &mut all);
    Some(principal(&all, most).0)
}

/// Any function of one variable: waves over all that it goes through, of whole and half periods.
pub(super) fn curve(variable: &Variable, most: usize) -> Functions {
    let all = || variable.values.iter().flatten().copied();
    let (low, high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    let waves: Vec<Course> = (0..most)
        .map(|k| {
            let of = |run: &Vec<f64>| run.iter().map(|v| wave(k, (v - low) / (high - low))).collect();
            variable.values.iter().map(of).collect()
        })
        .collect();
    let (functions, sizes) = principal(&waves, most);
    let range = Range { variable: variable.name.clone(), low, high, sizes };
    Functions { alike: 2, curve: Some(range), ..functions }
}

/// The cosine and the sine of half a period over [0, 1], of two, of three.
fn wave(k: usize, at: f64) -> f64 {
    let phase = std::f64::consts::PI * (k / 2 + 1) as f64 * at;
    if k.is_multiple_of(2) { fdm_grammar::math::cos(phase) } else { fdm_grammar::math::sin(phase) }
}

/// Functions of one variable.
fn singles(variable: &Variable, longest: f64) -> Vec<Course> {
    let of = |values: &Course, f: &dyn Fn(f64) -> f64| -> Course {
        values.iter().map(|run| run.iter().map(|v| f(*v)).collect()).collect()
    };
    let (centred, signed) = (&variable.centred, &variable.signed);
    let mut all = vec![
        centred.clone(),
        of(centred, &|z| z * z),
        of(centred, &|z| z * z * z),
        of(signed, &|w| w * w.abs()),
        centred.iter().map(|run| play(run, PLAY)).collect(),
    ];
    all.extend(STEEP.iter().map(|steep| of(signed, &|w| fdm_grammar::math::tanh(steep * w))));
    all.extend(LAGS.iter().map(|part| centred.iter().map(|run| lag(run, part * longest)).collect()));
    if variable.state {
        let squares: f64 = signed.iter().flatten().map(|w| w * w).sum();
        let size = (squares / signed.iter().map(Vec::len).sum::<usize>() as f64).sqrt();
        all.extend(REACHES.iter().map(|part| signed.iter().map(|run| stop(run, size * part * longest)).collect()));
    }
    all
}

fn products(variables: &[Variable], all: &mut Vec<Course>) {
    let count = variables.len();
    let times = |a: &Course, b: &Course| -> Course {
        let run = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| a * b).collect();
        a.iter().zip(b).map(run).collect()
    };
    let pairs: Vec<(usize, usize)> = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b))).collect();
    let room = MOST.saturating_sub(all.len());
    let twice: Vec<Course> =
        pairs.iter().take(room).map(|(a, b)| times(&variables[*a].centred, &variables[*b].centred)).collect();
    let triples: Vec<(usize, usize)> = pairs
        .iter()
        .enumerate()
        .flat_map(|(k, (a, b))| (0..count).filter(move |c| c == a || c >= b).map(move |c| (k, c)))
        .collect();
    if all.len() + twice.len() + triples.len() <= MOST {
        all.extend(triples.iter().map(|(pair, c)| times(&twice[*pair], &variables[*c].centred)));
    }
    all.extend(twice);
}

/// Principal components of functions that are brought to unit variance, and by what each was divided for that.
fn principal(all: &[Course], most: usize) -> (Functions, Vec<f64>) {
    let lengths: Vec<usize> = all[0].iter().map(Vec::len).collect();
    let samples: usize = lengths.iter().sum();
    let mut table = DMatrix::zeros(samples, all.len());
    let mut sizes = vec![0.0; all.len()];
    for ((mut column, course), divided) in table.column_iter_mut().zip(all).zip(&mut sizes) {
        column.iter_mut().zip(course.iter().flatten()).for_each(|(cell, v)| *cell = *v);
        let size = (column.norm_squared() / samples as f64).sqrt();
        if size > 0.0 && size.is_finite() {
            column /= size;
            *divided = size;
        } else {
            column.fill(0.0);
        }
    }
    let eigen = SymmetricEigen::new(table.transpose() * &table / samples as f64);
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let largest = order.first().map_or(0.0, |k| eigen.eigenvalues[*k]);
    order.retain(|k| eigen.eigenvalues[*k] > ROUNDING * largest);
    order.truncate(most);
    let single = eigen.eigenvectors.select_columns(&order);
    let turned = &table * &single;
    let mut first = 0;
    let courses = lengths
        .iter()
        .map(|n| {
            first += n;
            turned.column_iter().map(|c| c.rows(first - n, *n).iter().copied().collect()).collect()
        })
        .collect();
    (Functions { courses, single, alike: 1, curve: None }, sizes)
}

/// A state or an input.
pub(super) struct Variable {
    pub(super) name: String,
    /// As it is (runs by samples).
    pub(super) values: Vec<Vec<f64>>,
    /// Runs by samples: from its middle, the largest distance 1.
    pub(super) centred: Vec<Vec<f64>>,
    /// From its zero where it has both signs, otherwise from its middle; the largest distance 1.
    pub(super) signed: Vec<Vec<f64>>,
    /// Whether it is a state.
    pub(super) state: bool,
}

impl Variable {
    /// None where it does not change.
    fn new(name: &str, runs: Vec<Vec<f64>>, state: bool) -> Option<Self> {
        let all = || runs.iter().flatten().copied();
        let (low, high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let mean = all().sum::<f64>() / all().count().max(1) as f64;
        let scaled = |from: f64| -> Vec<Vec<f64>> {
            let size = (high - from).max(from - low);
            runs.iter().map(|run| run.iter().map(|v| (v - from) / size).collect()).collect()
        };
        let changes = high - low > 1e-9 * high.abs().max(low.abs());
        if !changes || !low.is_finite() || !high.is_finite() {
            return None;
        }
        let zero = if low < 0.0 && high > 0.0 { 0.0 } else { mean };
        let (centred, signed) = (scaled(mean), scaled(zero));
        Some(Self { name: name.to_string(), values: runs, centred, signed, state })
    }
}

/// All states and declared inputs that change.
pub(super) fn variables(
    model: &Model,
    forced_response: &ForcedResponse,
    fitted_runs: &[FittedRun<'_>],
) -> Result<Vec<Variable>, DisturbanceError> {
    let definition = model.definition();
    let (n, m) = (definition.states.len(), definition.inputs.len());
    let declared = definition.inputs.iter().take_while(|i| i.is_declared()).count();
    let mut courses = vec![Vec::with_capacity(fitted_runs.len()); n + declared];
    for (run, fitted_run) in fitted_runs.iter().enumerate() {
        let states = forced_response.states(run, *fitted_run)?;
        for (k, course) in courses.iter_mut().enumerate() {
            course.push(match k < n {
                true => states.iter().skip(k).step_by(n).copied().collect::<Vec<f64>>(),
                false => fitted_run.run.inputs.iter().skip(k - n).step_by(m).copied().collect(),
            });
        }
    }
    let states = definition.states.iter().map(|s| &s.quantity.name);
    let names = states.chain(definition.inputs.iter().map(|i| &i.quantity.name));
    let each = courses.into_iter().zip(names).enumerate();
    Ok(each.filter_map(|(k, (runs, name))| Variable::new(name, runs, k < n)).collect())
}

/// First-order lag of a time constant, in samples.
pub(super) fn lag(signal: &[f64], samples: f64) -> Vec<f64> {
    let keep = fdm_grammar::math::exp(-1.0 / samples);
    let mut value = signal.first().copied().unwrap_or_default();
    let follow = |v: &f64| {
        value = keep * value + (1.0 - keep) * v;
        value
    };
    signal.iter().map(follow).collect()
}

/// Play: follows where the signal pushes it from either side (Prandtl's operator).
pub(super) fn play(signal: &[f64], half: f64) -> Vec<f64> {
    let mut value = signal.first().copied().unwrap_or_default();
    let follow = |v: &f64| {
        value = value.max(v - half).min(v + half);
        value
    };
    signal.iter().map(follow).collect()
}

/// An elastic disturbance that yields at a limit while its foot point moves with this speed: hysteresis that does not depend on the
/// rate (Prandtl's stop operator).
pub(super) fn stop(speed: &[f64], limit: f64) -> Vec<f64> {
    let mut value = 0.0_f64;
    let follow = |v: &f64| {
        value = (value + v).clamp(-limit, limit);
        value / limit
    };
    speed.iter().map(follow).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::float_cmp)]
    use super::*;

    #[test]
    fn operators_do_what_their_names_say() {
        let there_and_back = [0.0, 1.0, 2.0, 1.0, 0.0, -1.0];
        assert_eq!(play(&there_and_back, 0.5), [0.0, 0.5, 1.5, 1.5, 0.5, -0.5]);
        assert_eq!(
            stop(&[1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0, -1.0], 2.0)[..],
            [0.5, 1.0, 1.0, 0.5, 0.0, -0.5, -1.0, -1.0]
        );
        let late = lag(&[0.0, 1.0, 1.0, 1.0, 1.0], 2.0);
        assert!((late[4] - (1.0 - (-2.0_f64).exp())).abs() < 1e-12);
    }
}
