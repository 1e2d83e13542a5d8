//! Windows that segments of a record are multiplied with.

use fdm_grammar::math;
use std::f64::consts::TAU;

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
