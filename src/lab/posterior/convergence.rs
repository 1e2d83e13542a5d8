//! Whether chains have converged, and how much their draws are worth: rank-normalised split R-hat, bulk and tail effective sample sizes (Vehtari, Gelman,
//! Simpson, Carpenter and Bürkner, Bayesian Analysis 16, 2021).
//!
//! Whether draws are those of the posterior: simulation-based calibration conditional on the data.
//!
//! A draw of the posterior and the noise make replicates of the runs. The posterior of runs and replicates together is sampled anew. The draw that made
//! the replicates is one of that posterior too: its rank among the new draws is uniform, whatever the model, the record and the priors, flat ones among
//! them (Säilynoja, Schmitt, Bürkner and Vehtari, arXiv:2502.03279; Talts, Betancourt, Simpson, Vehtari and Gelman, arXiv:1804.06788).

use super::density::{Posterior, SampledName};
use super::sample::{SampleError, Samples, Sampling, sample};
use fdm_estimate::Halt;
use fdm_numeric::random::{Stream, mixed};
use fdm_numeric::statistics::{chi_squared_tail, normal_quantile};
use fdm_results::documents::calibration::{CalibratedParameter, CalibrationDocument};

/// The larger of the R-hat of the ranks and of the ranks of the distances from the median; NaN where there are fewer than four draws or nothing varies.
pub(super) fn r_hat(chains: &[Vec<f64>]) -> f64 {
    let split = split(chains);
    let mut all: Vec<f64> = split.iter().flatten().copied().collect();
    all.sort_by(f64::total_cmp);
    let middle = median(&all);
    let folded: Vec<Vec<f64>> = split.iter().map(|c| c.iter().map(|v| (v - middle).abs()).collect()).collect();
    plain_r_hat(&ranks(&split)).max(plain_r_hat(&ranks(&folded)))
}

/// Effective number of draws for the middle of the law.
pub(super) fn bulk(chains: &[Vec<f64>]) -> f64 {
    effective(&ranks(&split(chains)))
}

/// Effective number of draws for its tails: the smaller of those of the 5 % and the 95 % quantile.
pub(super) fn tail(chains: &[Vec<f64>]) -> f64 {
    let split = split(chains);
    let mut all: Vec<f64> = split.iter().flatten().copied().collect();
    all.sort_by(f64::total_cmp);
    let of = |share: f64| {
        let limit = quantile(&all, share);
        let below = |c: &Vec<f64>| c.iter().map(|v| f64::from(u8::from(*v <= limit))).collect();
        effective(&split.iter().map(below).collect::<Vec<Vec<f64>>>())
    };
    of(0.05).min(of(0.95))
}

/// Effective number of draws for the mean of the values themselves.
pub(super) fn of_mean(chains: &[Vec<f64>]) -> f64 {
    effective(&split(chains))
}

/// The value below which a share of sorted values lies.
pub(super) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len().saturating_sub(1)) as f64;
    let (k, rest) = (place.floor() as usize, place.fract());
    match (sorted.get(k), sorted.get(k + 1)) {
        (Some(a), Some(b)) => a + rest * (b - a),
        (Some(a), None) => *a,
        _ => f64::NAN,
    }
}

fn median(sorted: &[f64]) -> f64 {
    quantile(sorted, 0.5)
}

/// Each chain in two halves; the middle draw of an odd number is left out.
fn split(chains: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let halves = chains.iter().flat_map(|c| {
        let half = c.len() / 2;
        [c[..half].to_vec(), c[c.len() - half..].to_vec()]
    });
    halves.collect()
}

/// Normal scores of the ranks among all draws, equal ones in the middle (Blom).
fn ranks(chains: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut order: Vec<(f64, usize, usize)> = Vec::new();
    for (c, chain) in chains.iter().enumerate() {
        order.extend(chain.iter().enumerate().map(|(k, v)| (*v, c, k)));
    }
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let count = order.len() as f64;
    let mut scores: Vec<Vec<f64>> = chains.iter().map(|c| vec![0.0; c.len()]).collect();
    let mut from = 0;
    while from < order.len() {
        let to = from + order[from..].iter().take_while(|o| o.0 == order[from].0).count();
        let rank = 0.5 * (from + 1 + to) as f64;
        let score = normal_quantile((rank - 0.375) / (count + 0.25));
        order[from..to].iter().for_each(|(_, c, k)| scores[*c][*k] = score);
        from = to;
    }
    scores
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn variance(values: &[f64]) -> f64 {
    let middle = mean(values);
    values.iter().map(|v| (v - middle) * (v - middle)).sum::<f64>() / (values.len() as f64 - 1.0)
}

/// Variance between the chains' means, and the mean of those within (Gelman and Rubin).
fn between_and_within(chains: &[Vec<f64>]) -> (f64, f64) {
    let means: Vec<f64> = chains.iter().map(|c| mean(c)).collect();
    let within = chains.iter().map(|c| variance(c)).sum::<f64>() / chains.len() as f64;
    (variance(&means), within)
}

fn plain_r_hat(chains: &[Vec<f64>]) -> f64 {
    let n = chains.first().map_or(0, Vec::len) as f64;
    if n < 2.0 {
        return f64::NAN;
    }
    let (between, within) = between_and_within(chains);
    (((n - 1.0) / n * within + between) / within).sqrt()
}

/// Geyer's initial monotone sequence over all chains, as Stan and ArviZ have it.
fn effective(chains: &[Vec<f64>]) -> f64 {
    let (m, n) = (chains.len(), chains.first().map_or(0, Vec::len));
    if n < 4 {
        return f64::NAN;
    }
    let total = (m * n) as f64;
    let means: Vec<f64> = chains.iter().map(|c| mean(c)).collect();
    let covariance = |lag: usize| {
        let of = |(c, middle): (&Vec<f64>, &f64)| {
            c.iter().zip(&c[lag..]).map(|(a, b)| (a - middle) * (b - middle)).sum::<f64>() / n as f64
        };
        chains.iter().zip(&means).map(of).sum::<f64>() / m as f64
    };
    let within = covariance(0) * n as f64 / (n as f64 - 1.0);
    let mut whole = within * (n as f64 - 1.0) / n as f64;
    if m > 1 {
        whole += variance(&means);
    }
    if whole.is_nan() || whole <= 0.0 {
        return f64::NAN;
    }
    let correlation = |lag: usize| 1.0 - (within - covariance(lag) * n as f64 / (n as f64 - 1.0)) / whole;
    let mut sum = 0.0;
    let (mut even, mut odd) = (1.0, correlation(1));
    let mut last = even + odd;
    let mut lag = 2;
    while last > 0.0 && lag + 1 < n {
        sum += last;
        (even, odd) = (correlation(lag), correlation(lag + 1));
        last = (even + odd).min(last);
        lag += 2;
    }
    // half of a pair that is negative as a whole still counts where its first part is positive
    let rest = if even > 0.0 && last <= 0.0 { even } else { 0.0 };
    let time = -1.0 + 2.0 * sum + rest;
    total / time.max(1.0 / total.log10())
}

/// Ranks that a draw can have: one more than the draws that it is compared with.
const LEVELS: usize = 100;
/// Of so many draws one is compared, so that those that are compared are nearly independent.
const THINNING: usize = 3;
/// Columns of the histograms.
const COLUMNS: usize = 20;
/// Polynomials of Neyman's test.
const ORDER: usize = 4;

/// A posterior whose sampler is put to the test.
pub struct Calibration<'a> {
    posterior: &'a Posterior,
    samples: &'a Samples,
    sampling: Sampling,
}

/// The ranks of the unknowns and derived quantities in one repeat, 0 to 99.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ranks {
    ranks: Vec<usize>,
    /// Trajectories that diverged.
    divergent: usize,
}

impl<'a> Calibration<'a> {
    /// Of a posterior and its draws; new ones are made as `sampling` says, by one chain.
    pub fn new(posterior: &'a Posterior, samples: &'a Samples, sampling: Sampling) -> Self {
        let draws = (LEVELS - 1) * THINNING;
        Self { posterior, samples, sampling: Sampling { chains: 1, draws, ..sampling } }
    }

    /// The repeat of this number; none where it was stopped, or where no replicate could be made.
    ///
    /// # Errors
    /// [`SampleError`]
    pub fn once(&self, number: u64, halt: &Halt) -> Result<Option<Ranks>, SampleError> {
        let mut stream = Stream::named(self.sampling.seed, &["calibration", &number.to_string()]);
        let chain = &self.samples.chains[(stream.uniform() * self.samples.chains.len() as f64) as usize];
        let drawn = (stream.uniform() * chain.values.len() as f64) as usize;
        let Some(posterior) = self.posterior.replicated(&chain.u[drawn], &mut stream)? else { return Ok(None) };
        let sampling = Sampling { seed: mixed(self.sampling.seed ^ mixed(number)), ..self.sampling };
        let found = sample(&posterior, &sampling, halt)?;
        if !found.whole {
            return Ok(None);
        }
        let compared = || found.chains[0].values.iter().skip(THINNING - 1).step_by(THINNING);
        let truth = &chain.values[drawn];
        let rank = |k: usize| {
            let below = compared().filter(|row| row[k] < truth[k]).count();
            // equal ones, as at a bound, lie on either side
            let equal = compared().filter(|row| row[k] == truth[k]).count();
            below + equal / 2
        };
        let divergent = found.chains(sampling.most_depth).iter().map(|c| c.divergent).sum();
        Ok(Some(Ranks { ranks: (0..truth.len()).map(rank).collect(), divergent }))
    }
}

/// What the ranks of all repeats say; those that are missing were stopped or could not be made.
pub fn calibrated(name: &str, seed: u64, names: &[SampledName], repeats: &[Option<Ranks>]) -> CalibrationDocument {
    let done: Vec<&Ranks> = repeats.iter().flatten().collect();
    let one = |(k, name): (usize, &SampledName)| {
        let ranks: Vec<usize> = done.iter().map(|r| r.ranks[k]).collect();
        let mut counts = vec![0; COLUMNS];
        ranks.iter().for_each(|r| counts[r * COLUMNS / LEVELS] += 1);
        let components = components(&ranks);
        let sum: f64 = components.iter().map(|z| z * z).sum();
        CalibratedParameter {
            name: name.name.clone(),
            run: name.run.clone(),
            counts,
            mean_rank: ranks.iter().map(|r| place(*r)).sum::<f64>() / ranks.len().max(1) as f64,
            shift: components[0],
            spread: components[1],
            p: chi_squared_tail(sum, ORDER as f64).unwrap_or(1.0),
        }
    };
    let parameters: Vec<CalibratedParameter> = names.iter().enumerate().map(one).collect();
    // Sidak's bound over all of them
    let least = parameters.iter().map(|p| p.p).fold(1.0, f64::min);
    let p = -(parameters.len() as f64 * (-least).ln_1p()).exp_m1();
    CalibrationDocument {
        model: name.into(),
        seed,
        asked: repeats.len(),
        done: done.len(),
        levels: LEVELS,
        divergent: done.iter().map(|r| r.divergent).sum(),
        parameters,
        p,
    }
}

/// Where a rank lies in 0 to 1.
fn place(rank: usize) -> f64 {
    (rank as f64 + 0.5) / LEVELS as f64
}

/// Sums of the first Legendre polynomials over uniform places, each a standard normal variate where ranks are uniform (Neyman's smooth test, 1937).
fn components(ranks: &[usize]) -> [f64; ORDER] {
    let mut sums = [0.0; ORDER];
    for rank in ranks {
        let x = 2.0 * place(*rank) - 1.0;
        let (mut before, mut now) = (1.0, x);
        for (k, sum) in sums.iter_mut().enumerate() {
            let n = (k + 1) as f64;
            *sum += (2.0 * n + 1.0).sqrt() * now;
            (before, now) = (now, ((2.0 * n + 1.0) * x * now - n * before) / (n + 1.0));
        }
    }
    let scale = (ranks.len().max(1) as f64).sqrt();
    sums.map(|s| s / scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Stream;

    /// Chains of an autoregression of first order.
    fn chains(rho: f64, shift: f64, count: usize) -> Vec<Vec<f64>> {
        let one = |c: u64| {
            let mut stream = Stream::seeded(100 + c);
            let mut x = stream.normal();
            let scale = (1.0f64 - rho * rho).sqrt();
            let draw = |_| {
                x = rho * x + scale * stream.normal();
                x + shift * c as f64
            };
            (0..count).map(draw).collect()
        };
        (0..4).map(one).collect()
    }

    #[test]
    fn effective_sizes_are_those_of_an_autoregression() {
        for rho in [0.0f64, 0.5, 0.9] {
            let chains = chains(rho, 0.0, 5000);
            let expected = 20_000.0 * (1.0 - rho) / (1.0 + rho);
            for found in [of_mean(&chains), bulk(&chains)] {
                assert!((found / expected - 1.0).abs() < 0.15, "{rho}: {found}, not {expected}");
            }
            assert!(r_hat(&chains) < 1.01 && tail(&chains) > 0.2 * expected);
        }
    }

    #[test]
    fn chains_that_differ_in_place_or_width_are_told() {
        assert!(r_hat(&chains(0.3, 0.5, 1000)) > 1.1);
        let mut wide = chains(0.3, 0.0, 1000);
        wide[0].iter_mut().for_each(|v| *v *= 3.0);
        assert!(r_hat(&wide) > 1.05, "{}", r_hat(&wide));
        assert!(r_hat(&vec![vec![1.0; 100]; 4]).is_nan());
    }
}

#[cfg(test)]
mod calibration_tests {
    use super::*;

    fn p(ranks: Vec<usize>) -> CalibratedParameter {
        let name = SampledName { name: "a".into(), run: None, unit: None };
        let repeats: Vec<Option<Ranks>> =
            ranks.into_iter().map(|r| Some(Ranks { ranks: vec![r], divergent: 0 })).collect();
        calibrated("m", 1, &[name], &repeats).parameters.remove(0)
    }

    #[test]
    fn uniform_ranks_pass_and_what_is_wrong_with_others_is_told() {
        let mut stream = Stream::seeded(4);
        // of uniform ranks p is uniform
        let mut small = 0;
        for _ in 0..400 {
            let found = p((0..100).map(|_| (stream.uniform() * 100.0) as usize).collect());
            small += usize::from(found.p < 0.05);
        }
        assert!((8..=34).contains(&small), "{small}");
        let low = p((0..100).map(|k| k % 60).collect());
        assert!(low.p < 1e-3 && low.shift < -4.0, "{low:?}");
        let ends = p((0..100).map(|k| if k % 2 == 0 { k % 20 } else { 99 - k % 20 }).collect());
        assert!(ends.p < 1e-3 && ends.spread > 4.0 && ends.shift.abs() < 2.0, "{ends:?}");
        assert_eq!(low.counts.iter().sum::<usize>(), 100);
    }
}
