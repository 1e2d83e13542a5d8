//! One delayed state as the step that is being taken sees it.

use super::super::moments::StageValues;
use super::hermite::{Four, Share, sum};
use super::history::History;

/// A delayed state that the rates see.
#[derive(Debug, Clone)]
pub(super) struct Lag {
    /// Which of the model's delayed signals it is.
    pub(super) delayed: usize,
    /// Its place in the history.
    pub(super) slot: usize,
    /// Its place among the states that a step can see of itself.
    pub(super) unknown: usize,
    /// What the past alone contributes.
    past: StageValues,
    /// The share of the step that is being taken; zero when the delay is not shorter.
    pub(super) own: Share,
    /// Where the window began last; windows only move forward.
    cursor: usize,
}

impl Lag {
    pub(super) fn new(delayed: usize, slot: usize, unknown: usize) -> Self {
        let past = StageValues { value: [0.0; 3], slope: [0.0; 3] };
        Self { delayed, slot, unknown, past, own: Share::default(), cursor: 0 }
    }

    /// Back to the beginning of a run.
    pub(super) fn begin(&mut self) {
        self.cursor = 0;
    }

    /// Looks through the window of the step from t to t + h, delayed by tau; writes the sensitivities of the three
    /// stage values to `rows` (3 rows of lanes), as far as they come from nodes up to t. Whether the window reaches into
    /// the step itself.
    #[inline(always)]
    pub(super) fn look(&mut self, history: &History, (t, h): (f64, f64), tau: f64, rows: &mut [f64]) -> bool {
        let window = (t - tau, h);
        let (newest, lanes) = (history.newest(), rows.len() / 3);
        rows.fill(0.0);
        self.past = StageValues { value: [0.0; 3], slope: [0.0; 3] };
        let end = (window.0 + h).min(t);
        let mut from = window.0;
        let first = history.first();
        self.cursor = self.cursor.max(history.oldest());
        if from < first {
            let weights = Share::constant((from, end.min(first)), window);
            for (stage, weight) in weights.into_iter().enumerate() {
                self.past.value[stage] += weight * history.value(0, self.slot);
                history.add_value(0, self.slot, weight, &mut rows[stage * lanes..][..lanes]);
            }
            from = first;
        }
        while self.cursor < newest && history.time(self.cursor + 1) <= from {
            self.cursor += 1;
        }
        let mut node = self.cursor;
        while from < end && node < newest {
            let (begin, next) = (history.time(node), history.time(node + 1));
            let to = next.min(end);
            let share = Share::new((begin, next - begin), (from, to), window);
            let four = history.four(node, self.slot);
            for stage in 0..3 {
                self.past.value[stage] += sum(&share.value[stage], &four);
                self.past.slope[stage] += sum(&share.slope[stage], &four);
                history.add_four(node, self.slot, &share.value[stage], &mut rows[stage * lanes..][..lanes]);
            }
            (from, node) = (to, node + 1);
        }
        self.look_ahead(history, (t, h), window, rows)
    }

    /// The part of the window that lies in the step itself.
    #[inline(always)]
    fn look_ahead(&mut self, history: &History, (t, h): (f64, f64), window: (f64, f64), rows: &mut [f64]) -> bool {
        let end = window.0 + h;
        // what rounding alone moves across t is not worth an implicit step
        let short = end - t > 8.0 * f64::EPSILON * (t.abs() + h);
        self.own = if short { Share::new((t, h), (window.0.max(t), end), window) } else { Share::default() };
        if short {
            let (newest, lanes) = (history.newest(), rows.len() / 3);
            for stage in 0..3 {
                let weight = self.own.value[stage][0];
                history.add_value(newest, self.slot, weight, &mut rows[stage * lanes..][..lanes]);
            }
        }
        short
    }

    /// Stage values and slopes when the step's own cubic has these four.
    #[inline]
    pub(super) fn seen(&self, own: &Four) -> StageValues {
        let mut seen = self.past;
        for stage in 0..3 {
            seen.value[stage] += sum(&self.own.value[stage], own);
            seen.slope[stage] += sum(&self.own.slope[stage], own);
        }
        seen
    }
}
