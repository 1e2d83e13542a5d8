//! Averaged power and cross spectra of the channels of records.
//!
//! How records are cut into segments, and the windows that these are multiplied with.
//!
//! How coefficients of one noise go together at frequencies that are closer than one cycle in the record.
//!
//! Of white noise of unit variance `E[x(w) x(v)*] = rho(w - v)/N` and `E[x(w) x(v)] = rho(w + v)/N` with the kernel of Dirichlet,
//! `rho(d) = 1/N sum_k exp(-j d k dt)`: on the record's own grid each coefficient goes with itself alone, elsewhere neighbours repeat each other.

use super::even_rows::EvenRows;
use super::frequencies::SpectrumError;
use super::frequencies::{Comb, Frequencies, MOST};
use super::held_edges::HeldEdge;
use super::spectrum::SpectrumOptions;
use super::transform::Transform;
use crate::record::Run;
use fdm_grammar::math;
use fdm_numeric::fourier::ComplexFft;
use num_complex::Complex64;
use std::f64::consts::TAU;

/// Part of an input's power below which a band holds none of it.
pub(super) const NO_POWER: f64 = 1e-12;

/// One-sided spectral densities of all pairs of channels, inputs before outputs, per cycle per unit of time.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossSpectra {
    /// Angular frequencies (M), rising.
    pub omega: Vec<f64>,
    /// Number of inputs m.
    pub inputs: usize,
    /// Number of outputs q.
    pub outputs: usize,
    /// Segments that were averaged.
    pub segments: usize,
    /// How many independent segments they are worth: overlapping ones share samples.
    pub averages: f64,
    /// Length of the longest segment in time.
    pub length: f64,
    /// `conj(X_i) X_j` for i up to j, one pair after the other, M each.
    density: Vec<Complex64>,
    /// Mean squares of the channels in the segments, their means taken off.
    power: Vec<f64>,
}

impl CrossSpectra {
    /// Averages over the segments of all runs, which must have the same channels. Every segment loses its mean and is windowed; longer ones
    /// weigh more. Of inputs, what lies between the samples is transformed, as for [`Spectrum`](super::Spectrum).
    ///
    /// # Errors
    /// [`SpectrumError`]: runs that cannot be transformed, bands that the segments cannot show, no segment in any run.
    pub fn of(
        runs: &[Run],
        choice: &Frequencies,
        segmentation: &Segmentation,
        window: Window,
        options: &SpectrumOptions,
    ) -> Result<Self, SpectrumError> {
        let mut average: Option<Average> = None;
        for run in runs {
            let even = EvenRows::of(run).map_err(|e| e.in_run(&run.name))?;
            let inputs = run.inputs.len() / run.len();
            let average = match &mut average {
                Some(average) => average,
                None => average.insert(Average::new(&even, inputs, choice, segmentation)?),
            };
            let even = with_means(even, run, inputs, options);
            average.add(run, &even, segmentation, window, options).map_err(|e| e.in_run(&run.name))?;
        }
        let average = average.ok_or(SpectrumError::TooFewSamples { found: 0, needed: 8 })?;
        average.finish(segmentation)
    }

    /// The density of `conj(X_i) X_j` over all frequencies, for channels i up to j.
    fn pair(&self, i: usize, j: usize) -> &[Complex64] {
        let (n, count) = (self.inputs + self.outputs, self.omega.len());
        &self.density[pair_at(n, i, j) * count..][..count]
    }

    /// Cross density of two channels at frequency `k`: `conj(X_i) X_j`.
    pub fn density(&self, i: usize, j: usize, k: usize) -> Complex64 {
        if i <= j { self.pair(i, j)[k] } else { self.pair(j, i)[k].conj() }
    }

    /// Power density of a channel over all frequencies.
    pub fn power(&self, channel: usize) -> Vec<f64> {
        self.pair(channel, channel).iter().map(|d| d.re).collect()
    }

    /// Ordinary coherence of two channels over all frequencies, 0 where one has no power.
    pub fn coherence(&self, i: usize, j: usize) -> Vec<f64> {
        let of = |k: usize| {
            let powers = self.density(i, i, k).re * self.density(j, j, k).re;
            if powers > 0.0 { (self.density(i, j, k).norm_sqr() / powers).min(1.0) } else { 0.0 }
        };
        (0..self.omega.len()).map(of).collect()
    }

    /// Whether a channel has power at these frequencies, compared with all it has.
    pub(super) fn has_power(&self, channel: usize) -> bool {
        let power = self.pair(channel, channel);
        let resolution = 1.0 / self.length;
        let largest = power.iter().map(|d| d.re).fold(0.0, f64::max);
        largest * resolution > NO_POWER * self.power[channel]
    }
}

/// With the means of held inputs over intervals in the place of their samples, where edges are between these: alike up to (w dt)^2/8, beside a
/// window that changes little within an interval.
fn with_means(mut even: EvenRows, run: &Run, inputs: usize, options: &SpectrumOptions) -> EvenRows {
    for channel in 0..inputs {
        let edges = options.course(channel, inputs, &run.held).edges(even.edges_of(channel));
        for (place, area) in edges.iter().map(HeldEdge::area) {
            even.rows[place * even.width + channel] += area;
        }
    }
    even
}

/// Place of the pair i, j (i up to j) of n channels.
fn pair_at(n: usize, i: usize, j: usize) -> usize {
    i * n + j - i * (i + 1) / 2
}

/// Sums over segments.
struct Average {
    /// The choice with its spacing resolved, so that segments of all lengths have the same frequencies.
    choice: Frequencies,
    omega: Vec<f64>,
    inputs: usize,
    width: usize,
    density: Vec<Complex64>,
    power: Vec<f64>,
    /// Time in segments.
    weight: f64,
    segments: usize,
    averages: f64,
    /// Plans by length and sampling interval.
    plans: Vec<(usize, f64, Transform)>,
}

impl Average {
    fn new(
        even: &EvenRows,
        inputs: usize,
        choice: &Frequencies,
        segmentation: &Segmentation,
    ) -> Result<Self, SpectrumError> {
        let samples = (segmentation.longest() / even.dt).round().clamp(8.0, u32::MAX.into()) as usize;
        let pairs = even.width * (even.width + 1) / 2;
        let comb = choice.of(samples, even.dt, pairs).map_err(SpectrumError::of_segments)?;
        let spacing = 1.0 / (samples as f64 * even.dt);
        let resolved = match choice {
            Frequencies::Grid { .. } => {
                let bins = comb.bins.clone().unwrap_or(1..2);
                let at = |bin: usize| bin as f64 * spacing;
                Frequencies::Band { lowest: at(bins.start), highest: at(bins.end - 1), spacing: Some(spacing) }
            }
            Frequencies::Band { lowest, highest, spacing: given } => {
                Frequencies::Band { lowest: *lowest, highest: *highest, spacing: Some(given.unwrap_or(spacing)) }
            }
            Frequencies::List(list) => Frequencies::List(list.clone()),
        };
        debug_assert!(pairs * comb.len() <= MOST);
        Ok(Self {
            choice: resolved,
            inputs,
            width: even.width,
            density: vec![Complex64::ZERO; pairs * comb.len()],
            power: vec![0.0; even.width],
            weight: 0.0,
            segments: 0,
            averages: 0.0,
            plans: Vec::new(),
            omega: comb.omega,
        })
    }

    fn add(
        &mut self,
        run: &Run,
        even: &EvenRows,
        segmentation: &Segmentation,
        window: Window,
        options: &SpectrumOptions,
    ) -> Result<(), SpectrumError> {
        if even.width != self.width || run.inputs.len() / run.len() != self.inputs {
            return Err(SpectrumError::OtherChannels { run: run.name.clone() });
        }
        let highest = self.omega.last().map_or(0.0, |w| w / TAU);
        for c in 0..even.width {
            if even.never_measured(c) {
                return Err(SpectrumError::NeverMeasured(options.name(c, self.inputs)));
            }
            even.check_gap(c, highest, options.name(c, self.inputs))?;
        }
        let cut = segmentation.cut(even.places, even.dt, run.time[0], window)?;
        self.averages += cut.independent;
        for (first, samples) in cut.segments {
            let rows = &even.rows[first * even.width..][..samples * even.width];
            let factors: Vec<Vec<Complex64>> = self.factors(even.dt, run, options);
            self.segment(rows, samples, even.dt, window, &factors)?;
        }
        Ok(())
    }

    /// What the sums of each channel's samples are multiplied with to be transforms of what lies between them; none for 1.
    fn factors(&self, dt: f64, run: &Run, options: &SpectrumOptions) -> Vec<Vec<Complex64>> {
        let of = |c: usize| {
            let course = options.course(c, self.inputs, &run.held);
            self.omega.iter().map(|w| course.factor(w * dt)).collect()
        };
        (0..self.inputs).map(of).collect()
    }

    fn segment(
        &mut self,
        rows: &[f64],
        samples: usize,
        dt: f64,
        window: Window,
        factors: &[Vec<Complex64>],
    ) -> Result<(), SpectrumError> {
        let (width, count) = (self.width, self.omega.len());
        let weights = window.weights(samples);
        let energy: f64 = weights.iter().map(|w| w * w).sum();
        let mut windowed = rows.to_vec();
        for c in 0..width {
            let column = || rows.iter().skip(c).step_by(width);
            let mean = column().sum::<f64>() / samples as f64;
            self.power[c] += dt * column().map(|v| (v - mean).powi(2)).sum::<f64>();
            windowed.iter_mut().skip(c).step_by(width).zip(&weights).for_each(|(v, w)| *v = (*v - mean) * w);
        }
        let plan = match self.plans.iter().position(|p| p.0 == samples && p.1 == dt) {
            Some(k) => k,
            None => {
                let comb: Comb = self.choice.of(samples, dt, width)?;
                self.plans.push((samples, dt, Transform::new(samples, width, &comb)));
                self.plans.len() - 1
            }
        };
        let mut sums = self.plans[plan].2.apply(&windowed);
        for (sums, factors) in sums.chunks_exact_mut(count).zip(factors) {
            sums.iter_mut().zip(factors).for_each(|(sum, factor)| *sum *= factor);
        }
        // one-sided density 2 |X|^2 dt/sum of squared weights, averaged by length
        let scale = 2.0 * dt / energy * (samples as f64 * dt);
        let mut densities = self.density.chunks_exact_mut(count);
        for i in 0..width {
            for j in i..width {
                let (a, b) = (&sums[i * count..][..count], &sums[j * count..][..count]);
                let Some(density) = densities.next() else { return Ok(()) };
                density.iter_mut().zip(a).zip(b).for_each(|((d, a), b)| *d += a.conj() * b * scale);
            }
        }
        self.weight += samples as f64 * dt;
        self.segments += 1;
        Ok(())
    }

    fn finish(mut self, segmentation: &Segmentation) -> Result<CrossSpectra, SpectrumError> {
        if self.segments == 0 {
            return Err(SpectrumError::NoneFits { length: segmentation.longest() });
        }
        self.density.iter_mut().for_each(|d| *d /= self.weight);
        self.power.iter_mut().for_each(|p| *p /= self.weight);
        Ok(CrossSpectra {
            omega: self.omega,
            inputs: self.inputs,
            outputs: self.width - self.inputs,
            segments: self.segments,
            averages: self.averages,
            length: segmentation.longest(),
            density: self.density,
            power: self.power,
        })
    }
}

/// Segments over which spectra are averaged, lengths and times in the records' unit of time.
#[derive(Debug, Clone, PartialEq)]
pub enum Segmentation {
    /// Of one length, every one beginning before the end of the one before by a part of its length; as many as fit.
    Equal {
        /// Length.
        length: f64,
        /// Part that is shared with the one before, from 0 to below 1.
        overlap: f64,
    },
    /// From and to these times of every record that holds them, of any lengths.
    Between(Vec<(f64, f64)>),
}

/// The segments of one record, in samples.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cut {
    /// First sample and length of each.
    pub(super) segments: Vec<(usize, usize)>,
    /// How many independent ones of the first one's length they are worth.
    pub(super) independent: f64,
}

impl Segmentation {
    /// The length of the longest segment.
    pub(super) fn longest(&self) -> f64 {
        match self {
            Self::Equal { length, .. } => *length,
            Self::Between(times) => times.iter().map(|(from, to)| to - from).fold(0.0, f64::max),
        }
    }

    /// The segments of a record of `places` samples `dt` apart that begins at time `start`.
    ///
    /// # Errors
    /// [`SpectrumError::NoOverlap`], [`SpectrumError::NoSegment`] for what is no segmentation.
    pub(super) fn cut(&self, places: usize, dt: f64, start: f64, window: Window) -> Result<Cut, SpectrumError> {
        match self {
            Self::Equal { length, overlap } => {
                if !(0.0..1.0).contains(overlap) {
                    return Err(SpectrumError::NoOverlap(*overlap));
                }
                let samples = (length / dt).round();
                if !(samples >= FEWEST && samples <= u32::MAX.into()) {
                    return Err(SpectrumError::NoSegment { length: *length, least: FEWEST * dt });
                }
                let samples = samples as usize;
                let shift = ((samples as f64 * (1.0 - overlap)).round() as usize).max(1);
                let count = if places < samples { 0 } else { (places - samples) / shift + 1 };
                let segments = (0..count).map(|k| (k * shift, samples)).collect();
                Ok(Cut { segments, independent: window.independent(samples, shift, count) })
            }
            Self::Between(times) => {
                let mut segments = Vec::new();
                for (from, to) in times {
                    let place = |t: f64| ((t - start) / dt).round();
                    let (first, end) = (place(*from), place(*to));
                    if (end - first).is_nan() || end - first < FEWEST {
                        return Err(SpectrumError::NoSegment { length: to - from, least: FEWEST * dt });
                    }
                    if first >= 0.0 && end <= places as f64 {
                        segments.push((first as usize, (end - first) as usize));
                    }
                }
                // longer ones weigh more
                let total = |power: i32| segments.iter().map(|s| (s.1 as f64).powi(power)).sum::<f64>();
                let independent = if segments.is_empty() { 0.0 } else { total(1).powi(2) / total(2) };
                Ok(Cut { segments, independent })
            }
        }
    }
}

/// Fewest samples of a segment.
const FEWEST: f64 = 8.0;

/// Weights of the samples of a segment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Window {
    /// All alike: the best resolution, and power that leaks far.
    Rectangular,
    /// Raised cosine: power leaks to the next two resolved frequencies only.
    #[default]
    Hann,
    /// Raised cosine on a small step.
    Hamming,
}

impl Window {
    /// The weights of `samples` samples, of a period of the window that many samples long.
    pub fn weights(self, samples: usize) -> Vec<f64> {
        let cosine = |k: usize| math::cos(TAU * (k as f64 + 0.5) / samples as f64);
        let weight = |k: usize| match self {
            Self::Rectangular => 1.0,
            Self::Hann => 0.5 - 0.5 * cosine(k),
            Self::Hamming => 0.54 - 0.46 * cosine(k),
        };
        (0..samples).map(weight).collect()
    }

    /// How many independent segments `count` overlapping ones are worth, each `shift` samples behind the one before
    /// (Welch 1967).
    pub fn independent(self, samples: usize, shift: usize, count: usize) -> f64 {
        let weights = self.weights(samples);
        let energy: f64 = weights.iter().map(|w| w * w).sum();
        let mut shared = 1.0;
        for lag in (1..count).take_while(|lag| lag * shift.max(1) < samples) {
            let common: f64 = weights.iter().zip(&weights[lag * shift.max(1)..]).map(|(a, b)| a * b).sum();
            shared += 2.0 * (1.0 - lag as f64 / count as f64) * (common / energy).powi(2);
        }
        count as f64 / shared
    }
}

/// Largest |rho| between different frequencies that counts as none.
const APART: f64 = 1e-6;
/// Most frequencies at unequal distances.
const MOST_UNEVEN: usize = 4096;

/// How many independent frequencies these (M, rising, in radians per unit of time) are worth in a record of this duration: closer than one cycle
/// in the record they repeat each other.
pub fn independent(omega: &[f64], duration: f64) -> f64 {
    let span = |pair: &[f64]| match (pair[1] - pair[0]) * duration / TAU {
        // part of a cycle by which frequencies that are one cycle apart may miss it
        apart if apart > 1.0 - 1e-6 => 1.0,
        apart => apart,
    };
    omega.first().map_or(0.0, |_| 1.0) + omega.windows(2).map(span).sum::<f64>()
}

/// Sums over neighbouring frequencies, `sum_l rho(w_k - w_l) g_l + rho(w_k + w_l) g_l*`.
#[derive(Debug)]
pub struct Overlap {
    omega: Vec<f64>,
    samples: usize,
    dt: f64,
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    /// Nothing overlaps.
    Apart,
    /// Equal distances: both sums are convolutions.
    Even(Box<Convolution>),
    Uneven,
}

impl Overlap {
    /// Frequencies (M, rising, in radians per unit of time) of a record of `samples` samples, `dt` apart. None where there are
    /// more than 4096 of them at unequal distances.
    pub fn new(omega: &[f64], samples: usize, dt: f64) -> Option<Self> {
        let mut overlap = Self { omega: omega.to_vec(), samples, dt, kind: Kind::Uneven };
        let Some((first, last)) = omega.first().zip(omega.last()) else {
            overlap.kind = Kind::Apart;
            return Some(overlap);
        };
        let step = (last - first) / (omega.len().max(2) - 1) as f64;
        let even = omega.iter().enumerate().all(|(k, w)| (first + step * k as f64 - w).abs() <= 1e-9 * last);
        let own = |w: f64| {
            let cycles = w * samples as f64 * dt / TAU;
            (cycles - cycles.round()).abs() <= APART && cycles.round() >= 1.0
        };
        if omega.iter().all(|w| own(*w)) {
            overlap.kind = Kind::Apart;
        } else if even {
            overlap.kind = Kind::Even(Box::new(Convolution::new(omega.len(), |d, sum| {
                overlap.kernel(step * d as f64 + if sum { 2.0 * first } else { 0.0 })
            })));
        } else if omega.len() > MOST_UNEVEN {
            return None;
        }
        Some(overlap)
    }

    /// Whether every coefficient goes with itself alone.
    pub fn is_none(&self) -> bool {
        matches!(self.kind, Kind::Apart)
    }

    /// rho at a distance.
    fn kernel(&self, distance: f64) -> Complex64 {
        let (n, angle) = (self.samples as f64, 0.5 * distance * self.dt);
        let below = n * angle.sin();
        let size = if below.abs() < 1e-12 * n { (n * angle).cos() / angle.cos() } else { (n * angle).sin() / below };
        Complex64::cis(-(n - 1.0) * angle) * size
    }

    /// The sums for one plane `g` (M), written to `out` (M).
    pub fn gather(&mut self, g: &[Complex64], out: &mut [Complex64]) {
        match &mut self.kind {
            Kind::Apart => out.copy_from_slice(g),
            Kind::Even(convolution) => convolution.apply(g, out),
            Kind::Uneven => {
                for (k, to) in out.iter_mut().enumerate() {
                    let w = self.omega[k];
                    let of = |(l, g): (usize, &Complex64)| {
                        let v = self.omega[l];
                        self.kernel(w - v) * g + self.kernel(w + v) * g.conj()
                    };
                    *to = g.iter().enumerate().map(of).sum();
                }
            }
        }
    }
}

/// Both sums by fast transforms.
#[derive(Debug)]
struct Convolution {
    fft: ComplexFft,
    /// Transforms of rho(w_k - w_l) by k - l, and of rho(w_k + w_l) by k + l.
    difference: Vec<Complex64>,
    sum: Vec<Complex64>,
    memory: [Vec<Complex64>; 2],
}

impl Convolution {
    /// `kernel(d, false)` is rho of d steps, `kernel(d, true)` of d steps more than twice the first frequency.
    fn new(count: usize, kernel: impl Fn(i64, bool) -> Complex64) -> Self {
        let length = (4 * count).next_power_of_two();
        let mut fft = ComplexFft::new(length);
        let (mut difference, mut sum) = (vec![Complex64::ZERO; length], vec![Complex64::ZERO; length]);
        for d in 0..count as i64 {
            difference[d as usize] = kernel(d, false);
            difference[(length as i64 - d) as usize % length] = kernel(-d, false);
        }
        (0..2 * count - 1).for_each(|d| sum[d] = kernel(d as i64, true));
        fft.forward(&mut difference);
        fft.forward(&mut sum);
        let scale = 1.0 / length as f64;
        difference.iter_mut().chain(&mut sum).for_each(|v| *v *= scale);
        let memory = [vec![Complex64::ZERO; length], vec![Complex64::ZERO; length]];
        Self { fft, difference, sum, memory }
    }

    fn apply(&mut self, g: &[Complex64], out: &mut [Complex64]) {
        let (count, length) = (g.len(), self.difference.len());
        let [plain, mirrored] = &mut self.memory;
        plain.fill(Complex64::ZERO);
        mirrored.fill(Complex64::ZERO);
        for (l, g) in g.iter().enumerate() {
            plain[l] = *g;
            // k + l = k - (-l)
            mirrored[(length - l) % length] = g.conj();
        }
        self.fft.forward(plain);
        self.fft.forward(mirrored);
        plain.iter_mut().zip(mirrored).zip(&self.difference).zip(&self.sum).for_each(|(((p, m), d), s)| {
            *p = *p * d + *m * s;
        });
        self.fft.backward(plain);
        out.copy_from_slice(&plain[..count]);
    }
}

#[cfg(test)]
mod segments_tests {
    use super::*;

    #[test]
    fn segments_fill_the_record() {
        let half = Segmentation::Equal { length: 10.0, overlap: 0.5 };
        let cut = half.cut(350, 0.1, 0.0, Window::Hann).expect("segments");
        assert_eq!(cut.segments, [(0, 100), (50, 100), (100, 100), (150, 100), (200, 100), (250, 100)]);
        assert!(cut.independent > 5.5 && cut.independent < 6.0);
        assert!(half.cut(99, 0.1, 0.0, Window::Hann).expect("none").segments.is_empty());
        let times = Segmentation::Between(vec![(5.0, 15.0), (20.0, 40.0), (90.0, 95.0)]);
        let cut = times.cut(350, 0.1, 5.0, Window::Hann).expect("segments");
        assert_eq!(cut.segments, [(0, 100), (150, 200)]);
        assert!((cut.independent - 1.8).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_segment_is_told() {
        let of = |length, overlap| Segmentation::Equal { length, overlap }.cut(100, 0.1, 0.0, Window::Hann);
        assert!(of(5.0, 1.0).unwrap_err().to_string().contains("overlap by 1 "));
        assert!(of(0.3, 0.5).unwrap_err().to_string().contains("0.3 long"));
        assert!(of(f64::NAN, 0.5).is_err() && of(1e300, 0.5).is_err());
        assert!(Segmentation::Between(vec![(3.0, 1.0)]).cut(100, 0.1, 0.0, Window::Hann).is_err());
    }

    #[test]
    fn overlapping_segments_are_worth_less_than_separate_ones() {
        assert_eq!(Window::Hann.independent(1000, 1000, 7), 7.0);
        // half overlapped Hann windows share a sixth of their energy: 1/(1 + 2/36) of many
        let half = Window::Hann.independent(1000, 500, 1001) / 1001.0;
        assert!((half - 18.0 / 19.0).abs() < 1e-3, "{half}");
        let plain = Window::Rectangular.independent(1000, 500, 1001) / 1001.0;
        assert!((plain - 1.0 / 1.5).abs() < 1e-3, "{plain}");
        // more overlap gives more segments, and no more information
        let worth = |shift: usize| Window::Hann.independent(1000, shift, 20_000 / shift - 1000 / shift + 1);
        assert!(worth(200) > worth(500) && worth(100) < 1.1 * worth(200));
    }

    #[test]
    fn windows_are_symmetric_and_of_known_energy() {
        for (window, energy) in [(Window::Rectangular, 1.0), (Window::Hann, 0.375), (Window::Hamming, 0.3974)] {
            let weights = window.weights(64);
            assert!((weights.iter().map(|w| w * w).sum::<f64>() / 64.0 - energy).abs() < 1e-12);
            assert!((0..64).all(|k| (weights[k] - weights[63 - k]).abs() < 1e-15));
        }
    }
}

#[cfg(test)]
mod overlap_tests {
    use super::*;

    fn directly(omega: &[f64], samples: usize, dt: f64, g: &[Complex64]) -> Vec<Complex64> {
        let rho = |d: f64| {
            let terms = (0..samples).map(|k| Complex64::cis(-d * k as f64 * dt));
            terms.sum::<Complex64>() / samples as f64
        };
        let sum = |w: &f64| omega.iter().zip(g).map(|(v, g)| rho(w - v) * g + rho(w + v) * g.conj()).sum();
        omega.iter().map(sum).collect()
    }

    #[test]
    fn sums_are_those_of_the_definition() {
        let (samples, dt) = (97, 0.13);
        let own = TAU / (samples as f64 * dt);
        let combs: [Vec<f64>; 4] = [
            (1..20).map(|k| own * f64::from(k)).collect(),
            (0..23).map(|k| 0.31 + 0.17 * f64::from(k)).collect(),
            (0..9).map(|k| 0.5 + 0.3 * f64::from(k * k)).collect(),
            vec![1.234],
        ];
        for omega in combs {
            let g: Vec<Complex64> =
                (0..omega.len()).map(|k| Complex64::new((k as f64).sin(), (1.7 * k as f64).cos())).collect();
            let mut overlap = Overlap::new(&omega, samples, dt).expect("few frequencies");
            let mut out = vec![Complex64::ZERO; g.len()];
            overlap.gather(&g, &mut out);
            for (got, want) in out.iter().zip(directly(&omega, samples, dt, &g)) {
                assert!((got - want).norm() < 1e-11, "{got} {want}");
            }
        }
    }
}
