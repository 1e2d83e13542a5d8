//! Errors where runs are short, or their times uneven, so that no noise model can be chosen: all of [`super::noise_candidates`] are weighed by their restricted
//! likelihood (Patterson and Thompson 1971), and variances averaged over them (Hoeting, Madigan, Raftery and Volinsky 1999).
//!
//! All outputs share one model, or each has its own; both hypotheses are weighed. Each decorrelated output acts on the parameters by `S' R^-1 L`. A variance
//! is then a mixture of values with weights, and the interval is that of the mixture.

use super::bounds::OUTSIDE;
use super::information::{Arrow, Blocks};
use super::noise_candidates::Clock;
use super::noise_candidates::{NoiseModel, candidates, log_prior, median_interval};
use super::restricted_likelihood::{
    Decorrelated, Decorrelation, Likelihood, NormalEquations, Restricted, ShortRun, normal_equations,
};
use super::sandwich::{NoiseColour, PriorInformation, Sandwich, Uncorrected, between};
use super::sensitivity_rows::SensitivityRows;
use crate::problem::Problem;
use crate::problem::noise::Weights;
use crate::residuals::autoregression::{AutoRegression, LevinsonDurbin};
use fdm_numeric::quadratic::Inverse;
use fdm_numeric::statistics::Student;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Runs whose noise is averaged over all that is possible.
pub(super) struct ShortRuns {
    runs: Vec<usize>,
    average: Average,
    /// Their middle (n by n, row-major).
    pub(super) middle: Vec<f64>,
}

impl ShortRuns {
    /// Those among all runs; none when all are long. `noise` is that of the fit.
    ///
    /// # Errors
    /// [`Uncorrected::NotFinite`].
    pub(super) fn of(
        runs: &[SensitivityRows],
        sandwich: &Sandwich<'_>,
        noise: &Weights,
        prior: &[PriorInformation],
    ) -> Result<Option<Self>, Uncorrected> {
        let (long, short): (Vec<usize>, Vec<usize>) = (0..runs.len()).partition(|r| runs[*r].is_long());
        if short.is_empty() {
            return Ok(None);
        }
        let n = sandwich.bound.inverse.chosen.len();
        let mut middles: Vec<Vec<f64>> = runs.iter().map(|r| vec![0.0; r.width * r.width]).collect();
        let inverse_noise = noise.inverse();
        long.iter().for_each(|r| middles[*r] = runs[*r].information(&inverse_noise));
        let others = DMatrix::from_row_slice(n, n, &sandwich.gather(&middles, prior));
        let member = |r: &usize| ShortRun { rows: &runs[*r], places: sandwich.places(*r) };
        let members: Vec<ShortRun<'_>> = short.iter().map(member).collect();
        let rows: Vec<&SensitivityRows> = members.iter().map(|m| m.rows).collect();
        let average = Average::new(&members, &inverse_noise, &correlated(&rows, &noise.covariance), others);
        let average = average.ok_or(Uncorrected::NotFinite)?;
        let middle = average.middle().as_slice().to_vec();
        Ok(Some(Self { runs: short, average, middle }))
    }

    /// Gives the covariance (n by n) the variances of the average, beside the middle of all others (n by n), and adds how little is known of them
    /// to the degrees of freedom.
    ///
    /// # Errors
    /// [`Uncorrected::NotFinite`].
    pub(super) fn settle(
        &self,
        sandwich: &Sandwich<'_>,
        others: &[f64],
        covariance: &mut [f64],
        freedom: &mut [f64],
    ) -> Result<(), Uncorrected> {
        let n = freedom.len();
        let square = |values: &[f64]| DMatrix::from_row_slice(n, n, values);
        let variances = self.average.variances(&sandwich.bound.inverse, &square(others));
        let variances = variances.ok_or(Uncorrected::NotFinite)?;
        let factor = |j: usize| match covariance[j * n + j] {
            variance if variance > 0.0 => (variances[j].0 / variance).sqrt(),
            _ => 1.0,
        };
        let factors: Vec<f64> = (0..n).map(factor).collect();
        covariance.iter_mut().enumerate().for_each(|(k, c)| *c *= factors[k / n] * factors[k % n]);
        for (freedom, (_, own)) in freedom.iter_mut().zip(&variances) {
            *freedom = 1.0 / (1.0 / *freedom + 1.0 / own);
        }
        Ok(())
    }

    /// What was found of the noise of each output; `covariance` is that of the fit (q by q).
    pub(super) fn report(&self, problem: &Problem<'_>, covariance: &[f64]) -> Vec<NoiseColour> {
        let names: Vec<String> = self.runs.iter().map(|r| problem.runs[*r].name.clone()).collect();
        let q = problem.outputs.len();
        let model = |o: usize| {
            let variance = covariance[o * q + o] * self.average.scale(o);
            match self.average.correlations(o) {
                Some(r) => {
                    let r: Vec<f64> = r.iter().map(|r| r * variance).collect();
                    LevinsonDurbin::of(&r).model(r.len() - 1)
                }
                None => AutoRegression::white(variance),
            }
        };
        let colour =
            |o: usize| NoiseColour::new(problem.outputs[o].clone(), names.clone(), self.average.interval, &model(o));
        (0..q).filter(|o| self.average.compares(*o)).map(colour).collect()
    }
}

/// The covariance of the noise: that of the fit (q by q), and where the fit takes outputs for independent with what the residuals have
/// in common, shrunk towards none where samples are few.
fn correlated(runs: &[&SensitivityRows], covariance: &[f64]) -> DMatrix<f64> {
    let q = covariance.len().isqrt();
    let mut matrix = DMatrix::from_row_slice(q, q, covariance);
    if (0..q * q).any(|k| k / q != k % q && covariance[k] != 0.0) {
        return matrix;
    }
    for a in 0..q {
        for b in 0..a {
            let both = runs.iter().flat_map(|r| r.residuals[a].iter().zip(&r.residuals[b]));
            let mut sums = [0.0; 4];
            for (x, y) in both.filter(|(x, y)| !x.is_nan() && !y.is_nan()) {
                sums.iter_mut().zip([x * y, x * x, y * y, 1.0]).for_each(|(s, v)| *s += v);
            }
            let [product, left, right, samples] = sums;
            let size = (left * right).sqrt();
            if size > 0.0 {
                let told = samples / (samples + 2.0 * q as f64);
                matrix[(a, b)] = told * product / size * (matrix[(a, a)] * matrix[(b, b)]).sqrt();
                matrix[(b, a)] = matrix[(a, b)];
            }
        }
    }
    matrix
}

/// Most that noise may be larger, as a variance, than what is left of it: fitting took four fifths of the deviation.
const MOST_GROWTH: f64 = 25.0;
/// Lags at which correlations are reported.
const LAGS: usize = 6;

/// Which noise model the outputs have.
struct Hypothesis {
    /// Whether all outputs share one.
    shared: bool,
    /// For each output the posterior probability of each model.
    weights: Vec<Vec<f64>>,
    /// For each output and model the variance of its noise over that of white noise.
    growth: Vec<Vec<f64>>,
    /// Logarithm of the likelihood of the residuals under all models.
    evidence: f64,
}

/// The average over the noise models of all outputs of the short runs.
struct Average {
    models: Vec<NoiseModel>,
    /// For each output its samples, and the degrees of freedom of its scale.
    samples: Vec<(f64, f64)>,
    /// For each output and model `S' R^-1 L C L' R^-1 S` (n by n).
    middles: Vec<Vec<DMatrix<f64>>>,
    /// Each with its posterior probability.
    hypotheses: Vec<(f64, Hypothesis)>,
    interval: f64,
}

impl Average {
    /// `inverse_noise` is that of the fit, `covariance` that of the noise (q by q), `others` the information of other runs and of
    /// priors (n by n). None where numbers are not finite.
    fn new(
        short: &[ShortRun<'_>],
        inverse_noise: &[f64],
        covariance: &DMatrix<f64>,
        others: DMatrix<f64>,
    ) -> Option<Self> {
        let (q, n) = (short[0].rows.residuals.len(), others.nrows());
        let places: Vec<Vec<usize>> = short.iter().map(|run| run.places.iter().flatten().copied().collect()).collect();
        let blocks = Blocks::new(&places, &others);
        let runs: Vec<&SensitivityRows> = short.iter().map(|run| run.rows).collect();
        let interval = median_interval(&runs);
        let (models, shares) = candidates(&runs, interval);
        let decorrelation = Decorrelation::new(inverse_noise, covariance);
        let outputs: Vec<Vec<Decorrelated>> = (0..q).map(|k| decorrelation.outputs(short, k)).collect();
        let samples: Vec<f64> = outputs.iter().map(|parts| parts.iter().map(|p| p.samples() as f64).sum()).collect();
        let tables: Vec<Vec<(NormalEquations, DMatrix<f64>)>> = outputs
            .iter()
            .map(|parts| models.par_iter().map(|m| normal_equations(parts, short, m, &blocks)).collect())
            .collect();
        // at the estimates the score of all runs vanishes by the noise of the fit: that of the others is opposite to these. By the noise of correlated outputs
        // it would pull at what the others say nothing of
        let mut pull = DVector::zeros(n);
        if others.amax() > 0.0 {
            short.iter().for_each(|run| run.add_score(-1.0, inverse_noise, &mut pull));
        }
        let pull = blocks.parts(&pull);
        let others = Arrow::of(&blocks, &others);
        let (normals, middles) = tables.into_iter().map(|t| t.into_iter().unzip()).unzip();
        let restricted = Restricted { samples: samples.clone(), normals, others, pull };
        let white = restricted.likely(&vec![0; q])?;
        let mut all = vec![shared(&restricted, &shares, &white)?];
        if q > 1 {
            all.push(separate(&restricted, &shares, &white)?);
        }
        let (shares, _) = posterior(&all.iter().map(|h| h.evidence).collect::<Vec<f64>>());
        let hypotheses = shares.into_iter().zip(all).collect();
        let samples = samples.into_iter().zip(white.freedom).collect();
        Some(Self { models, samples, middles, hypotheses, interval })
    }

    /// The mean of `S' R^-1 Rvv R^-1 S` (n by n).
    fn middle(&self) -> DMatrix<f64> {
        let mut sum = DMatrix::zeros(self.middles[0][0].nrows(), self.middles[0][0].ncols());
        for (share, h) in &self.hypotheses {
            for (k, middles) in self.middles.iter().enumerate() {
                for (b, middle) in middles.iter().enumerate() {
                    sum += middle * (share * h.weights[k][b] * h.growth[k][b]);
                }
            }
        }
        sum
    }

    /// Variance of each chosen unknown and its degrees of freedom (n), with the Cramer-Rao covariance of the fit on both sides
    /// and beside it the middle of the others (n by n); none where numbers are not finite.
    fn variances(&self, inverse: &Inverse, others: &DMatrix<f64>) -> Option<Vec<(f64, f64)>> {
        let n = inverse.chosen.len();
        let known = DMatrix::from_row_slice(n, n, &inverse.values);
        let around = |middle: &DMatrix<f64>| -> Vec<f64> {
            if let Some(covariance) = between(inverse, middle.as_slice()) {
                return (0..n).map(|j| covariance[j * n + j]).collect();
            }
            let half = middle * &known;
            known.column_iter().zip(half.column_iter()).map(|(a, b)| a.dot(&b).max(0.0)).collect()
        };
        // output, model, unknown
        let own: Vec<Vec<Vec<f64>>> = self.middles.iter().map(|m| m.par_iter().map(around).collect()).collect();
        let others = around(others);
        let one = |j: usize| {
            let mut mixture = VarianceMixture::none();
            for (share, h) in &self.hypotheses {
                let size = |k: usize, b: usize| h.growth[k][b] * own[k][b][j];
                let models = |k: usize| h.weights[k].iter().copied().enumerate();
                let possible = if h.shared {
                    let whole = |b: usize| others[j] + (0..own.len()).map(|k| size(k, b)).sum::<f64>();
                    VarianceMixture::of(models(0).map(|(b, weight)| (weight, whole(b))))
                } else {
                    let of = |k: usize| VarianceMixture::of(models(k).map(|(b, weight)| (weight, size(k, b))));
                    (0..own.len()).fold(VarianceMixture::known(others[j]), |sum, k| sum.plus(&of(k)))
                };
                mixture.or(&possible, *share);
            }
            // the scale of the noise is known by so many samples
            let all = others[j] + own.iter().map(|o| o[0][j]).sum::<f64>();
            let spread = own.iter().zip(&self.samples).map(|(o, (_, freedom))| (o[0][j] / all).powi(2) / freedom);
            mixture.student(1.0 / spread.sum::<f64>())
        };
        (0..others.len()).into_par_iter().map(one).collect()
    }

    /// Whether any sample of an output is compared.
    fn compares(&self, output: usize) -> bool {
        self.samples[output].0 > 0.0
    }

    /// The variance of an output's noise over the one that the fit found.
    fn scale(&self, output: usize) -> f64 {
        let mean = |h: &Hypothesis| h.weights[output].iter().zip(&h.growth[output]).map(|(w, g)| w * g).sum::<f64>();
        self.hypotheses.iter().map(|(share, h)| share * mean(h)).sum()
    }

    /// Correlations of an output's noise at lags 0, 1, .. intervals; none where it is most likely white.
    fn correlations(&self, output: usize) -> Option<Vec<f64>> {
        let weight = |b: usize| self.hypotheses.iter().map(|(share, h)| share * h.weights[output][b]).sum::<f64>();
        let weights: Vec<f64> = (1..self.models.len()).map(weight).collect();
        let coloured: f64 = weights.iter().sum();
        let at = |lag: usize| {
            let own = |(b, w): (&NoiseModel, &f64)| {
                let apart = if b.clock() == Clock::Time { lag as f64 * self.interval } else { lag as f64 };
                w * b.correlation(apart)
            };
            self.models[1..].iter().zip(&weights).map(own).sum::<f64>() / coloured
        };
        (coloured > 0.5).then(|| (0..=LAGS).map(at).collect())
    }
}

/// All outputs share one noise model.
fn shared(restricted: &Restricted, shares: &[f64], white: &Likelihood) -> Option<Hypothesis> {
    let q = restricted.samples.len();
    let likely: Vec<Likelihood> = (0..=shares.len()).map(|b| restricted.likely(&vec![b; q])).collect::<Option<_>>()?;
    let (weights, evidence) = weigh(&log_prior(shares, 1), &likely);
    let growth = (0..q).map(|k| likely.iter().map(|l| growth(l, white, k)).collect()).collect();
    Some(Hypothesis { shared: true, weights: vec![weights; q], growth, evidence })
}

/// Each output has a noise model of its own, weighed beside the likeliest of the others.
fn separate(restricted: &Restricted, shares: &[f64], white: &Likelihood) -> Option<Hypothesis> {
    let q = restricted.samples.len();
    let prior = log_prior(shares, q);
    let table = |best: &[usize], k: usize| -> Option<Vec<Likelihood>> {
        let of = |b: usize| {
            let mut models = best.to_vec();
            models[k] = b;
            restricted.likely(&models)
        };
        (0..prior.len()).map(of).collect()
    };
    let likeliest = |table: Vec<Likelihood>| {
        let worth = |b: &usize| table[*b].logarithm + prior[*b];
        (0..table.len()).max_by(|a, b| worth(a).total_cmp(&worth(b))).unwrap_or(0)
    };
    let best: Vec<usize> = (0..q).map(|k| table(&vec![0; q], k).map(likeliest)).collect::<Option<_>>()?;
    let base = restricted.likely(&best)?.logarithm;
    let mut hypothesis = Hypothesis { shared: false, weights: Vec::new(), growth: Vec::new(), evidence: base };
    for k in 0..q {
        let table = table(&best, k)?;
        let (weights, evidence) = weigh(&prior, &table);
        hypothesis.evidence += evidence - base;
        hypothesis.weights.push(weights);
        hypothesis.growth.push(table.iter().map(|l| growth(l, white, k)).collect());
    }
    Some(hypothesis)
}

/// The posterior probability of each model, and the logarithm of the likelihood under all of them.
fn weigh(prior: &[f64], likely: &[Likelihood]) -> (Vec<f64>, f64) {
    posterior(&prior.iter().zip(likely).map(|(prior, l)| prior + l.logarithm).collect::<Vec<f64>>())
}

/// Probabilities from their logarithms, known but for a common constant, and the logarithm of their sum.
fn posterior(logarithms: &[f64]) -> (Vec<f64>, f64) {
    let highest = logarithms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = logarithms.iter().map(|l| (l - highest).exp()).sum();
    (logarithms.iter().map(|l| (l - highest).exp() / sum).collect(), highest + sum.ln())
}

/// The variance of an output's noise over that of white noise.
fn growth(likely: &Likelihood, white: &Likelihood, k: usize) -> f64 {
    (likely.scales[k] / white.scales[k]).min(MOST_GROWTH)
}

/// Most values of a mixture that are kept apart.
const MOST_VALUES: usize = 64;
/// Weights below this are dropped.
const LEAST_WEIGHT: f64 = 1e-9;
/// Fewest degrees of freedom, and those from which on Student's law is the normal law.
const FREEDOM: [f64; 2] = [3.0, 1e6];
/// Halvings of an interval in which a number is sought.
const HALVINGS: usize = 50;

/// Values of a variance and how likely each is.
#[derive(Debug, Clone)]
struct VarianceMixture(Vec<(f64, f64)>);

impl VarianceMixture {
    /// A variance that is known.
    fn known(variance: f64) -> Self {
        Self(vec![(1.0, variance)])
    }

    /// Variances with these weights.
    fn of(values: impl Iterator<Item = (f64, f64)>) -> Self {
        Self(values.filter(|(weight, _)| *weight > LEAST_WEIGHT).collect())
    }

    /// Nothing yet.
    fn none() -> Self {
        Self(Vec::new())
    }

    /// Adds what is possible besides, with this weight.
    fn or(&mut self, other: &Self, weight: f64) {
        let values = other.0.iter().map(|(w, v)| (w * weight, *v));
        self.0.extend(values.filter(|(weight, _)| *weight > LEAST_WEIGHT));
    }

    /// The sum with another variance that is independent of this.
    fn plus(&self, other: &Self) -> Self {
        let pairs = self.0.iter().flat_map(|(w, v)| other.0.iter().map(move |(x, u)| (w * x, v + u)));
        let all: Vec<(f64, f64)> = pairs.filter(|(weight, _)| *weight > LEAST_WEIGHT).collect();
        let logarithm = |v: f64| v.max(f64::MIN_POSITIVE).ln();
        let range = |(low, high): (f64, f64), (_, v): &(f64, f64)| (low.min(logarithm(*v)), high.max(logarithm(*v)));
        let (low, high) = all.iter().fold((f64::INFINITY, f64::NEG_INFINITY), range);
        let mut bins = [(0.0, 0.0); MOST_VALUES];
        for (weight, v) in all {
            let part = if high > low { (logarithm(v) - low) / (high - low) } else { 0.0 };
            let bin = &mut bins[((part * MOST_VALUES as f64) as usize).min(MOST_VALUES - 1)];
            *bin = (bin.0 + weight, bin.1 + weight * v);
        }
        Self::of(bins.into_iter().map(|(weight, sum)| (weight, sum / weight)))
    }

    /// Mean of the logarithms, as a variance.
    fn geometric_mean(&self) -> f64 {
        let all: f64 = self.0.iter().map(|(w, _)| w).sum();
        (self.0.iter().map(|(w, v)| w * v.max(f64::MIN_POSITIVE).ln()).sum::<f64>() / all).exp()
    }

    /// Half the interval that holds 95 % of a number with such a variance, each known by so many degrees of freedom; all are above 0.
    fn reach(&self, freedom: f64) -> Option<f64> {
        let law = Student::new(freedom.clamp(1.0, FREEDOM[1]))?;
        let all: f64 = self.0.iter().map(|(w, _)| w).sum();
        let beyond = |c: f64| self.0.iter().map(|(w, v)| 2.0 * w * law.cdf(-c / v.sqrt())).sum::<f64>() / all;
        let one = law.quantile(1.0 - OUTSIDE / 2.0);
        let ends = self.0.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), (_, v)| (l.min(v.sqrt()), h.max(v.sqrt())));
        let (mut low, mut high) = (one * ends.0, one * ends.1);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            (low, high) = if beyond(middle) > OUTSIDE { (middle, high) } else { (low, middle) };
            if high - low < 1e-6 * high {
                break;
            }
        }
        Some(0.5 * (low + high))
    }

    /// The variance and the degrees of freedom whose interval by Student's law is that of the mixture: the geometric mean, as long as
    /// there are such degrees. None where numbers are not finite, or nothing varies.
    fn student(&self, freedom: f64) -> Option<(f64, f64)> {
        let sound = |(_, v): &(f64, f64)| *v > 0.0 && v.is_finite();
        if self.0.is_empty() || !self.0.iter().all(sound) || freedom.is_nan() {
            return None;
        }
        let (variance, reach) = (self.geometric_mean(), self.reach(freedom)?);
        let quantile = |f: f64| Student::new(f).map_or(f64::NAN, |law| law.quantile(1.0 - OUTSIDE / 2.0));
        let [fewest, most] = FREEDOM;
        let ratio = reach / variance.sqrt();
        if ratio >= quantile(fewest) {
            return Some(((reach / quantile(fewest)).powi(2), fewest));
        }
        if ratio <= quantile(most) {
            return Some(((reach / quantile(most)).powi(2), most));
        }
        let (mut low, mut high) = (fewest.ln(), most.ln());
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            (low, high) = if quantile(middle.exp()) > ratio { (middle, high) } else { (low, middle) };
            if high - low < 1e-6 {
                break;
            }
        }
        Some((variance, (0.5 * (low + high)).exp()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_value_is_students_law() {
        let (variance, freedom) = VarianceMixture::known(4.0).student(12.0).expect("finite");
        assert!((variance - 4.0).abs() < 1e-9 && (freedom / 12.0 - 1.0).abs() < 1e-3, "{variance} {freedom}");
        let (variance, freedom) =
            VarianceMixture::known(4.0).plus(&VarianceMixture::known(5.0)).student(1e9).expect("finite");
        assert!((variance - 9.0).abs() < 1e-3 && freedom > 1e5, "{variance} {freedom}");
    }

    #[test]
    fn what_is_not_finite_has_no_interval() {
        for variance in [0.0, f64::NAN, f64::INFINITY] {
            assert_eq!(VarianceMixture::known(variance).student(12.0), None);
        }
        assert_eq!(VarianceMixture::known(1.0).student(f64::NAN), None);
        assert_eq!(VarianceMixture::none().student(12.0), None);
    }

    #[test]
    fn the_interval_is_that_of_the_mixture() {
        for values in [vec![(0.9, 1.0), (0.1, 20.0)], vec![(0.5, 1.0), (0.3, 2.0), (0.2, 3.0)]] {
            let mixture = VarianceMixture::of(values.clone().into_iter());
            let (variance, freedom) = mixture.student(30.0).expect("finite");
            let half = variance.sqrt() * crate::quantile(Some(freedom));
            let law = Student::new(30.0).expect("a law");
            let outside: f64 = values.iter().map(|(w, v)| 2.0 * w * law.cdf(-half / v.sqrt())).sum();
            assert!((outside - 0.05).abs() < 1e-4, "{outside}");
        }
    }

    #[test]
    fn sums_keep_means_and_weights() {
        let one = VarianceMixture::of([(0.7, 1.0), (0.3, 9.0)].into_iter());
        let sum = one.plus(&one);
        let mean = |m: &VarianceMixture| m.0.iter().map(|(w, v)| w * v).sum::<f64>();
        assert!((mean(&sum) - 2.0 * mean(&one)).abs() < 1e-12);
        assert!((sum.0.iter().map(|(w, _)| w).sum::<f64>() - 1.0).abs() < 1e-12 && sum.0.len() == 3);
    }
}
