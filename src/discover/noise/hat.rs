//! Functions that are linear between knots.

use fdm_numeric::dense::Pentadiagonal;
use nalgebra::DVector;

/// The two hat functions that are not zero at a frequency.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hat {
    /// The knot below.
    pub(super) below: usize,
    /// Weight of the knot above; 0 where there is none.
    pub(super) above: f64,
}

impl Hat {
    pub(super) fn at(knots: &[f64], log_frequency: f64) -> Self {
        let last = knots.len() - 1;
        if last == 0 {
            return Self { below: 0, above: 0.0 };
        }
        let place = ((log_frequency - knots[0]) / (knots[1] - knots[0])).clamp(0.0, last as f64);
        let below = (place as usize).min(last - 1);
        Self { below, above: place - below as f64 }
    }

    /// Knots with their weights.
    pub(super) fn parts(self) -> impl Iterator<Item = (usize, f64)> {
        let parts = [(self.below, 1.0 - self.above), (self.below + 1, self.above)];
        parts.into_iter().filter(|(_, part)| *part > 0.0)
    }

    /// The value between the knots of these.
    pub(super) fn of(self, values: &[f64]) -> f64 {
        self.parts().map(|(k, part)| part * values[k]).sum()
    }

    /// Adds what a bin at this place tells of the knots.
    pub(super) fn add(self, weight: f64, score: f64, information: &mut Pentadiagonal, gradient: &mut DVector<f64>) {
        self.parts().for_each(|(k, part)| gradient[k] += part * score);
        self.add_weight(weight, information);
    }

    /// Adds what a bin at this place tells of the knots' precision alone.
    pub(super) fn add_weight(self, weight: f64, information: &mut Pentadiagonal) {
        self.parts().for_each(|(k, part)| information.add(k, k, weight * part * part));
        if self.above > 0.0 {
            information.add(self.below + 1, self.below, weight * self.above * (1.0 - self.above));
        }
    }
}
