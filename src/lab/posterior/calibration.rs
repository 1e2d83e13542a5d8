//! Whether draws are those of the posterior: simulation-based calibration conditional on the data.
//!
//! A draw of the posterior and the noise make replicates of the runs. The posterior of runs and replicates together is sampled anew. The draw that made
//! the replicates is one of that posterior too: its rank among the new draws is uniform, whatever the model, the record and the priors, flat ones among
//! them (Säilynoja, Schmitt, Bürkner and Vehtari, arXiv:2502.03279; Talts, Betancourt, Simpson, Vehtari and Gelman, arXiv:1804.06788).

use super::density::{Posterior, SampledName};
use super::sample::{SampleError, Samples, Sampling, sample};
use fdm_estimate::Halt;
use fdm_numeric::random::{Stream, mixed};
use fdm_numeric::statistics::chi_squared_tail;
use fdm_results::documents::calibration::{CalibratedParameter, CalibrationDocument};

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
