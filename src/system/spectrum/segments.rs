//! How records are cut into segments, and the windows that these are multiplied with.

use super::error::SpectrumError;
use fdm_grammar::math;
use std::f64::consts::TAU;

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

#[cfg(test)]
mod tests {
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
