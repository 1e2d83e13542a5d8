//! Runs as cosine bins: every output of every run by itself, at the samples where it was measured, in bands common to all.

use crate::bins::{MeasuredRows, Signals, ordinal};
use crate::candidates::fitted_model::FittedModel;
use crate::candidates::runs::Runs;
use crate::evidence::bands::{BandCounts, Bands};
use crate::evidence::gram::{Segment, segments};
use crate::evidence::noise::NoisePrior;
use fdm_numeric::fourier::CosineTransform;
use std::f64::consts::FRAC_1_SQRT_2;

/// Fewest samples of an output of a run that say something of its noise.
const LEAST: usize = 8;

/// How signals of each run become bins.
#[derive(Clone)]
pub(crate) struct Binning {
    pub(crate) outputs: usize,
    pub(crate) bands: usize,
    pub(crate) runs: Vec<RunBins>,
    /// The noise of each output before anything is seen.
    pub(crate) noise: Vec<NoisePrior>,
}

/// One run.
#[derive(Clone)]
pub(crate) struct RunBins {
    places: Vec<OutputBins>,
    /// All bins of the run.
    pub(crate) length: usize,
    pub(crate) segments: Vec<Segment>,
    /// Deviation of the noise at each sample in that of its output (N by q), where it is not even.
    pub(crate) deviations: Option<Signals>,
    outputs: usize,
}

#[derive(Clone)]
struct OutputBins {
    output: usize,
    /// Samples at which it was measured, and where they stand among the rows that directions keep.
    samples: Vec<usize>,
    places: Vec<usize>,
    transform: Option<CosineTransform>,
    offset: usize,
}

impl Binning {
    /// Of these runs as a model answers them.
    pub(crate) fn new(current: &FittedModel, runs: Runs<'_>) -> Self {
        let q = current.outputs();
        let mut planned = Vec::new();
        for (r, run) in runs.all.iter().enumerate() {
            let predictor = &current.predictors[r];
            let measured = predictor.measured(run);
            let rows = match predictor.steps() {
                Some(_) => MeasuredRows::of(&run.measured, q, &run.time),
                None => None,
            };
            let given = predictor.frequencies();
            for output in 0..q {
                let samples: Vec<usize> =
                    (0..measured.len() / q).filter(|k| !measured[k * q + output].is_nan()).collect();
                if samples.len() < LEAST {
                    continue;
                }
                let interval = MeasuredRows::between(rows.as_ref(), &samples, crate::candidates::runs::interval(run));
                let n = samples.len();
                let frequency: Vec<f64> = match &given {
                    Some(own) => samples.iter().map(|k| own[*k]).collect(),
                    None => (0..n).map(|k| ordinal(k) / (2.0 * n as f64 * interval)).collect(),
                };
                let places = MeasuredRows::places(rows.as_ref(), &samples);
                planned.push((r, output, samples, places, frequency, given.is_none()));
            }
        }
        // the first bin of the longest record is the unit of frequency
        let first = planned.iter().filter_map(|p| p.4.get(1)).copied().fold(f64::INFINITY, f64::min);
        let longest = planned.iter().map(|p| p.2.len()).max().unwrap_or(1);
        let bands = Bands::new(longest);
        let mut found: Vec<RunBins> = runs.all.iter().map(|_| RunBins::empty(q)).collect();
        let mut of_output: Vec<Vec<f64>> = vec![Vec::new(); q];
        for (r, output, samples, places, frequency, sampled) in planned {
            let relative: Vec<f64> = frequency.iter().map(|f| f / first).collect();
            let run = &mut found[r];
            run.segments.extend(segments(&bands, output, &relative, run.length));
            of_output[output].extend(relative);
            let (offset, transform) = (run.length, sampled.then(|| CosineTransform::new(samples.len())));
            run.length += samples.len();
            run.places.push(OutputBins { output, samples, places, transform, offset });
        }
        let noise = of_output
            .iter()
            .map(|own| NoisePrior::new(&BandCounts::of(&bands, own.iter().copied()), longest))
            .collect();
        Self { outputs: q, bands: bands.count(), runs: found, noise }
    }
}

impl Binning {
    /// With noise of one output whose deviation has these sizes over the samples of each run (N each); the level is the noise's own.
    pub(crate) fn shaped(&self, output: usize, sizes: &[Vec<f64>]) -> Self {
        let (mut shaped, q) = (self.clone(), self.outputs);
        let places = |run: &RunBins| run.places.iter().position(|p| p.output == output && p.transform.is_some());
        let (mut logs, mut samples) = (0.0, 0_usize);
        for (run, sizes) in shaped.runs.iter().zip(sizes) {
            let Some(place) = places(run) else { continue };
            logs += run.places[place].samples.iter().map(|k| sizes[*k].ln()).sum::<f64>();
            samples += run.places[place].samples.len();
        }
        let level = logs / samples.max(1) as f64;
        for (run, sizes) in shaped.runs.iter_mut().zip(sizes) {
            if places(run).is_none() {
                continue;
            }
            let own = run.deviations.get_or_insert_with(|| vec![1.0; sizes.len() * q]);
            sizes.iter().enumerate().for_each(|(k, size)| own[k * q + output] *= (size.ln() - level).exp());
        }
        shaped
    }

    /// Bins of an output over all runs.
    pub(crate) fn noise_bins(&self, output: usize) -> f64 {
        let own = self.runs.iter().flat_map(|r| &r.segments).filter(|s| s.place / self.bands == output);
        own.map(|s| s.end - s.begin).sum::<usize>() as f64
    }
}

impl RunBins {
    fn empty(outputs: usize) -> Self {
        Self { places: Vec::new(), length: 0, segments: Vec::new(), deviations: None, outputs }
    }

    /// A signal (N by q) in bins, output by output; `kept` of which only rows are kept at which something was measured.
    pub(crate) fn of(&self, signal: &[f64], kept: bool) -> Vec<f64> {
        let mut bins = vec![0.0; self.length];
        self.put(signal, kept, &|_| true, &mut bins);
        bins
    }

    /// As [`Self::of`], for some outputs alone, in the place of what stands in the bins.
    pub(crate) fn put(&self, signal: &[f64], kept: bool, wanted: &dyn Fn(usize) -> bool, bins: &mut [f64]) {
        let q = self.outputs;
        for OutputBins { output, samples, places, transform, offset } in self.places.iter().filter(|p| wanted(p.output))
        {
            let own = &mut bins[*offset..][..samples.len()];
            for (value, (k, place)) in own.iter_mut().zip(samples.iter().zip(places)) {
                let deviation = self.deviations.as_ref().map_or(1.0, |d| d[k * q + output]);
                *value = signal[if kept { *place } else { *k } * q + output] / deviation;
            }
            if let Some(transform) = transform {
                transform.clone().forward(own);
                let scale = (2.0 / samples.len() as f64).sqrt();
                own.iter_mut().for_each(|v| *v *= scale);
                own[0] *= FRAC_1_SQRT_2;
            }
        }
    }

    /// Bins as samples of unit deviation under these weights (1/S of every output and band): each output with the samples they belong to; nothing in the
    /// frequency domain.
    pub(crate) fn whitened(&self, bins: &[f64], weights: &[f64]) -> Vec<(usize, Vec<usize>, Vec<f64>)> {
        let mut scaled = bins.to_vec();
        for s in &self.segments {
            scaled[s.begin..s.end].iter_mut().for_each(|v| *v *= weights[s.place].sqrt());
        }
        let back = |place: &OutputBins| {
            let mut own = scaled[place.offset..][..place.samples.len()].to_vec();
            own[0] /= FRAC_1_SQRT_2;
            place.transform.clone()?.backward(&mut own);
            let scale = (2.0 / place.samples.len() as f64).sqrt();
            own.iter_mut().for_each(|v| *v *= scale);
            Some((place.output, place.samples.clone(), own))
        };
        self.places.iter().filter_map(back).collect()
    }
}
