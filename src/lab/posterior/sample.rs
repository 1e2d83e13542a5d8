//! Draws from a posterior by several chains of the No-U-Turn sampler, and what they say.
//!
//! Chains begin around the fit, twice as far off as its errors say, in the units of its information matrix (a dense metric). During the warm-up the step
//! is adapted by dual averaging, and the units are renewed at the ends of windows that double, as Stan does. A chain depends on the seed and its number
//! alone.
#![allow(clippy::needless_range_loop, reason = "samples of a response and their draws are indexed alike")]

use super::convergence::{bulk, of_mean, quantile, r_hat, tail};
use super::coordinates::Units;
use super::density::{Evaluator, InUnits, Posterior, SampledName};
use super::nuts::{Nuts, StepSearch, Transition};
use fdm_estimate::Halt;
use fdm_numeric::parallel;
use fdm_numeric::random::Stream;
use fdm_results::documents::sample::{ChainDocument, PredictiveBand, SampledParameter};
use fdm_system::simulate::Unsuited;

/// How a posterior is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Chains.
    pub chains: usize,
    /// Draws of each that are kept.
    pub draws: usize,
    /// Transitions before them.
    pub warmup: usize,
    /// The seed.
    pub seed: u64,
    /// Mean acceptance that the step is adapted to.
    pub target: f64,
    /// Most doublings of a trajectory.
    pub most_depth: u32,
}

/// Why there are no draws.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SampleError {
    /// A run cannot be simulated with exact derivatives.
    #[error(transparent)]
    Unsuited(#[from] Unsuited),
    /// Nothing is unknown.
    #[error("nothing is to be sampled: no parameter is estimated and all noise is known")]
    Nothing,
    /// The density vanishes where the chains begin.
    #[error("the posterior is not finite where the chains begin")]
    NotFinite,
}

/// The draws of a chain.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Chain {
    /// Coordinates of the draws (draws by unknowns), for predictions.
    pub(super) u: Vec<Vec<f64>>,
    /// Values of the unknowns (draws by unknowns).
    pub values: Vec<Vec<f64>>,
    stats: Vec<Transition>,
    step: f64,
    evaluations: u64,
}

/// All chains.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples {
    /// What was sampled.
    pub names: Vec<SampledName>,
    /// The chains, of equal length.
    pub chains: Vec<Chain>,
    /// Whether all draws were made.
    pub whole: bool,
}

/// Samples a posterior, until it is to end.
///
/// # Errors
/// [`SampleError`]
pub fn sample(posterior: &Posterior, sampling: &Sampling, halt: &Halt) -> Result<Samples, SampleError> {
    let n = posterior.unknowns();
    if n == 0 {
        return Err(SampleError::Nothing);
    }
    let start = posterior.start().to_vec();
    let mut evaluator = posterior.evaluator()?;
    let mut gradient = vec![0.0; n];
    if !evaluator.log_density(&start, &mut gradient).is_finite() {
        return Err(SampleError::NotFinite);
    }
    let information = evaluator.information();
    drop(evaluator);
    let units = information.and_then(|matrix| Units::of_information(start.clone(), &matrix));
    let identity: Vec<f64> = (0..n * n).map(|k| if k % (n + 1) == 0 { 1.0 } else { 0.0 }).collect();
    let units = units.or_else(|| Units::of_covariance(start, &identity)).ok_or(SampleError::NotFinite)?;
    let chains: Result<Vec<Chain>, SampleError> =
        parallel::map(0..sampling.chains, |k| chain(posterior, &units, sampling, k, halt)).into_iter().collect();
    let mut chains = chains?;
    let shortest = chains.iter().map(|c| c.values.len()).min().unwrap_or(0);
    for chain in &mut chains {
        chain.u.truncate(shortest);
        chain.values.truncate(shortest);
        chain.stats.truncate(shortest);
    }
    Ok(Samples { names: posterior.names(), chains, whole: shortest == sampling.draws })
}

/// Where windows of the warm-up end, and whether the units are renewed there: Stan's schedule of 75, doubling from 25, and 50.
fn windows(warmup: usize) -> (usize, Vec<usize>) {
    let (first, last, least) = match warmup {
        w if w < 20 => return (w, Vec::new()),
        w if w < 150 => ((0.15 * w as f64) as usize, (0.1 * w as f64) as usize, w),
        _ => (75, 50, 25),
    };
    let end = warmup - last;
    let (mut ends, mut from, mut length) = (Vec::new(), first, least.min(end - first));
    while from < end {
        // a last window that would be shorter than the one before is part of it
        let to = if from + length + 2 * length > end { end } else { from + length };
        ends.push(to);
        (from, length) = (to, 2 * length);
    }
    (first, ends)
}

fn chain(
    posterior: &Posterior,
    units: &Units,
    sampling: &Sampling,
    number: usize,
    halt: &Halt,
) -> Result<Chain, SampleError> {
    let n = posterior.unknowns();
    let mut stream = Stream::named(sampling.seed, &["nuts", &number.to_string()]);
    let mut evaluator = posterior.evaluator()?;
    let (mut u, mut by_u, mut count) = (vec![0.0; n], vec![0.0; n], 0_u64);
    let mut units = units.clone();
    let mut nuts = Nuts::new(n, sampling.most_depth);
    /// A density in the chain's units.
    macro_rules! density {
        () => {
            InUnits { evaluator: &mut evaluator, units: &units, u: &mut u, by_u: &mut by_u, count: &mut count }
        };
    }
    // nearer and nearer to the fit, until the density is finite
    let mut reach = 2.0;
    let mut found = false;
    for _ in 0..50 {
        let z: Vec<f64> = (0..n).map(|_| reach * stream.normal()).collect();
        if nuts.put(&z, &mut density!()) {
            found = true;
            break;
        }
        reach *= 0.7;
    }
    if !found && !nuts.put(&vec![0.0; n], &mut density!()) {
        return Err(SampleError::NotFinite);
    }
    nuts.find_step(&mut density!(), &mut stream);
    let mut search = StepSearch::new(nuts.step, sampling.target);
    let (first, ends) = windows(sampling.warmup);
    let mut seen = Seen::new(n);
    let mut chain = Chain::default();
    for k in 0..sampling.warmup + sampling.draws {
        if !halt.goes_on() {
            break;
        }
        let transition = nuts.transit(&mut density!(), &mut stream);
        if k >= sampling.warmup {
            units.to_u(nuts.position(), &mut u);
            chain.values.push(posterior.values(&u));
            chain.u.push(u.clone());
            chain.stats.push(transition);
            continue;
        }
        nuts.step = search.learn(transition.accepted);
        if k >= first {
            seen.add(nuts.position());
        }
        if ends.contains(&(k + 1)) {
            units.to_u(nuts.position(), &mut u);
            if let Some(better) = seen.covariance().and_then(|c| units.renewed(&c)) {
                let place = u.clone();
                units = better;
                let z = units.to_z(&place);
                // the place is the same: the density is finite there
                let _ = nuts.put(&z, &mut density!());
                nuts.find_step(&mut density!(), &mut stream);
                search = StepSearch::new(nuts.step, sampling.target);
            }
            seen = Seen::new(n);
        }
        if k + 1 == sampling.warmup {
            nuts.step = search.step();
        }
    }
    chain.step = nuts.step;
    chain.evaluations = count;
    Ok(chain)
}

/// Mean and squares of positions (Welford).
struct Seen {
    count: f64,
    mean: Vec<f64>,
    squares: Vec<f64>,
}

impl Seen {
    fn new(n: usize) -> Self {
        Self { count: 0.0, mean: vec![0.0; n], squares: vec![0.0; n * n] }
    }

    fn add(&mut self, z: &[f64]) {
        let n = z.len();
        self.count += 1.0;
        let off: Vec<f64> = z.iter().zip(&self.mean).map(|(z, m)| z - m).collect();
        self.mean.iter_mut().zip(&off).for_each(|(m, d)| *m += d / self.count);
        for i in 0..n {
            let left = z[i] - self.mean[i];
            self.squares[i * n..][..n].iter_mut().zip(&off).for_each(|(s, d)| *s += left * d);
        }
    }

    /// The covariance, drawn towards the unit of the present coordinates as if that had been seen five times.
    fn covariance(&self) -> Option<Vec<f64>> {
        if self.count < 3.0 {
            return None;
        }
        let n = self.mean.len();
        let share = self.count / (self.count + 5.0);
        let entry = |(k, s): (usize, &f64)| {
            let unit = if k % (n + 1) == 0 { 1.0 - share } else { 0.0 };
            share * s / (self.count - 1.0) + unit
        };
        Some(self.squares.iter().enumerate().map(entry).collect())
    }
}

impl Samples {
    /// Values of an unknown, chain by chain.
    pub fn of(&self, unknown: usize) -> Vec<Vec<f64>> {
        self.chains.iter().map(|c| c.values.iter().map(|row| row[unknown]).collect()).collect()
    }

    /// Mean, deviation, quantiles and diagnostics of every unknown.
    pub fn parameters(&self) -> Vec<SampledParameter> {
        let one = |(k, name): (usize, &SampledName)| {
            let chains = self.of(k);
            let mut all: Vec<f64> = chains.iter().flatten().copied().collect();
            let count = all.len() as f64;
            let mean = all.iter().sum::<f64>() / count;
            let deviation = (all.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (count - 1.0)).sqrt();
            all.sort_by(f64::total_cmp);
            let finite = |v: f64| v.is_finite().then_some(v);
            SampledParameter {
                name: name.name.clone(),
                run: name.run.clone(),
                unit: name.unit.clone(),
                mean,
                deviation,
                median: quantile(&all, 0.5),
                interval: [quantile(&all, 0.025), quantile(&all, 0.975)],
                error_of_mean: finite(deviation / of_mean(&chains).sqrt()),
                r_hat: finite(r_hat(&chains)),
                bulk: finite(bulk(&chains)),
                tail: finite(tail(&chains)),
            }
        };
        self.names.iter().enumerate().map(one).collect()
    }

    /// How each chain went.
    pub fn chains(&self, most_depth: u32) -> Vec<ChainDocument> {
        let one = |chain: &Chain| {
            let count = chain.stats.len().max(1) as f64;
            ChainDocument {
                divergent: chain.stats.iter().filter(|s| s.divergent).count(),
                deepest: chain.stats.iter().filter(|s| s.depth >= most_depth).count(),
                step: chain.step,
                accepted: chain.stats.iter().map(|s| s.accepted).sum::<f64>() / count,
                steps: chain.stats.iter().map(|s| f64::from(s.steps)).sum::<f64>() / count,
                evaluations: chain.evaluations,
            }
        };
        self.chains.iter().map(one).collect()
    }

    /// Of every draw, chain by chain: name, and values.
    pub fn stats(&self) -> Vec<(&'static str, Vec<Vec<f64>>)> {
        let of = |what: fn(&Transition) -> f64| -> Vec<Vec<f64>> {
            self.chains.iter().map(|c| c.stats.iter().map(what).collect()).collect()
        };
        vec![
            ("lp", of(|s| s.log_density)),
            ("energy", of(|s| s.energy)),
            ("acceptance_rate", of(|s| s.accepted)),
            ("tree_depth", of(|s| f64::from(s.depth))),
            ("n_steps", of(|s| f64::from(s.steps))),
            ("diverging", of(|s| f64::from(u8::from(s.divergent)))),
        ]
    }

    /// Predictions at up to `most` draws, evenly taken from all chains: bands of 95 % of the response and of a new measurement.
    ///
    /// # Errors
    /// [`Unsuited`]
    pub fn predict(&self, posterior: &Posterior, most: usize, seed: u64) -> Result<Vec<PredictiveBand>, Unsuited> {
        let each = most.div_ceil(self.chains.len().max(1)).max(1);
        let thinned = |chain: &Chain| {
            let step = chain.u.len().div_ceil(each).max(1);
            chain.u.iter().step_by(step).cloned().collect::<Vec<_>>()
        };
        let draws: Vec<Vec<f64>> = self.chains.iter().flat_map(thinned).collect();
        let mut stream = Stream::named(seed, &["predictive"]);
        let mut evaluator: Evaluator<'_> = posterior.evaluator()?;
        let mut bands = Vec::new();
        for (r, run) in posterior.runs().iter().enumerate() {
            let q = run.output_gaps.len();
            let count = run.len() * q;
            let (mut responses, mut measured) = (vec![Vec::new(); count], vec![Vec::new(); count]);
            let (mut y, mut deviation) = (Vec::new(), Vec::new());
            for u in &draws {
                if !evaluator.predict(u, r, &mut y, &mut deviation) {
                    continue;
                }
                for k in 0..count {
                    responses[k].push(y[k]);
                    measured[k].push(y[k] + deviation[k] * stream.normal());
                }
            }
            let edge = |values: &mut Vec<f64>, share: f64| {
                values.sort_by(f64::total_cmp);
                let found = quantile(values, share);
                found.is_finite().then_some(found)
            };
            for o in 0..q {
                let column = |all: &mut Vec<Vec<f64>>, share: f64| -> Vec<Option<f64>> {
                    (0..run.len()).map(|k| edge(&mut all[k * q + o], share)).collect()
                };
                let quantity = posterior.output(o);
                bands.push(PredictiveBand {
                    run: run.name.clone(),
                    output: o,
                    name: quantity.name.clone(),
                    unit: quantity.unit.as_ref().map(ToString::to_string),
                    time: run.time.clone(),
                    response: [0.025, 0.5, 0.975].map(|share| column(&mut responses, share)),
                    measurement: [0.025, 0.5, 0.975].map(|share| column(&mut measured, share)),
                });
            }
        }
        Ok(bands)
    }
}
