//! How inputs go between samples: held or in straight lines, as a text, a map or an option states it, or as the samples themselves show it.
//!
//! What a controller commands stays until its next sample (zero-order hold); what a sensor records moves on between samples. Nothing in a table
//! of samples says which, so that an input about which nobody said anything is *unknown*: straight lines are assumed, unless it moves only at
//! samples, all at once.

use super::channel::Channels;
use super::run::Run;

/// What is known of the declared inputs of a run (m).
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Holds {
    /// Whether the input keeps its value until the next sample.
    pub(super) held: Vec<bool>,
    /// Whether somebody said so, or said that it does not.
    pub(super) stated: Vec<bool>,
    /// Inputs (by index) that nobody stated and that were taken for held.
    pub(super) taken: Vec<usize>,
}

impl Holds {
    /// As stated by name (held, linear), else by a map (channel, and whether it holds), else by the model's text; as `inputs` (N by m row-major, NaN
    /// where there is no value) show it where nobody said anything.
    pub(super) fn of(
        channels: &Channels,
        (hold, linear): (&[String], &[String]),
        mapped: &[(String, bool)],
        inputs: &[f64],
    ) -> Self {
        let m = channels.inputs.len();
        let mut holds = Self::default();
        for (k, channel) in channels.inputs.iter().enumerate() {
            let typed = match (hold.contains(&channel.name), linear.contains(&channel.name)) {
                (true, _) => Some(true),
                (false, true) => Some(false),
                (false, false) => None,
            };
            let by_map = || mapped.iter().find(|(name, _)| *name == channel.name).map(|(_, held)| *held);
            let of_known = channel.known.then_some(false);
            // an input that jumps has no derivative
            let differentiated = channels.slopes.iter().any(|s| s.of as usize == k).then_some(false);
            let stated = typed.or_else(by_map).or(channel.held).or(of_known).or(differentiated);
            let moves = || moves_at_samples(inputs.iter().skip(k).step_by(m.max(1)).copied().filter(|v| !v.is_nan()));
            let taken = stated.is_none() && channels.timed && moves();
            holds.taken.extend(taken.then_some(k));
            holds.held.push(stated.unwrap_or(taken));
            holds.stated.push(stated.is_some());
        }
        holds
    }
}

impl Run {
    /// With those inputs held that move only at samples, all at once, where nobody stated how they go: as a record of this run is read.
    #[must_use]
    pub fn with_moves_held(mut self) -> Self {
        let m = self.held.len();
        for input in (0..m).filter(|input| !self.stated.get(*input).is_some_and(|stated| *stated)) {
            self.held[input] |= moves_at_samples(self.inputs.iter().skip(input).step_by(m).copied());
        }
        self
    }
}

/// Whether a signal moves only at samples, all at once: steps between stretches in which it stays.
///
/// A signal that is straight between its corners, or smooth, is seen on its way: between two values it passes others, sample by sample. A signal
/// that was held never is. So a held one stays in most intervals, and no sample of it lies inside a rise or a fall. A sensor with a coarse
/// resolution looks alike: it goes up and down by one unit over many levels. A staircase does so too, but stays on each tread for the same
/// time, within a sample of rounding.
pub fn moves_at_samples(values: impl Iterator<Item = f64>) -> bool {
    let values: Vec<f64> = values.collect();
    let changes: Vec<(usize, f64)> =
        values.windows(2).enumerate().map(|(k, w)| (k, w[1] - w[0])).filter(|(_, change)| *change != 0.0).collect();
    if changes.is_empty() || 2 * changes.len() > values.len() - 1 {
        return false;
    }
    let on_its_way = changes.windows(2).any(|w| w[0].0 + 1 == w[1].0 && (w[0].1 > 0.0) == (w[1].1 > 0.0));
    !on_its_way && !is_quantised(&values, &changes)
}

/// Whether all changes (place, size) are by one unit of a resolution: over more than two levels, with treads of different lengths.
fn is_quantised(values: &[f64], changes: &[(usize, f64)]) -> bool {
    let (least, greatest) = extent(changes.iter().map(|(_, change)| change.abs()));
    let (low, high) = extent(values.iter().copied());
    // differences of decimal numbers are equal up to their rounding
    let rounding = 4.0 * f64::EPSILON * low.abs().max(high.abs());
    if greatest - least > rounding || high - low < 1.5 * least {
        return false;
    }
    let (shortest, longest) = extent(changes.windows(2).map(|w| (w[1].0 - w[0].0) as f64));
    longest - shortest > 1.0
}

fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(values: &[f64]) -> bool {
        moves_at_samples(values.iter().copied())
    }

    /// `(value, samples)` one behind the other.
    fn stretches(of: &[(f64, usize)]) -> Vec<f64> {
        of.iter().flat_map(|(value, samples)| std::iter::repeat_n(*value, *samples)).collect()
    }

    #[test]
    fn commands_that_step_move_at_samples() {
        assert!(taken(&stretches(&[(0.0, 20), (1.0, 30), (-1.0, 20), (1.0, 10), (-1.0, 10), (0.0, 50)])), "3-2-1-1");
        let bits = (0..400).map(|k: usize| if (k / 2 * 7919) % 13 < 6 { 1.0 } else { -1.0 });
        assert!(taken(&bits.collect::<Vec<_>>()), "binary sequence");
        assert!(taken(&stretches(&[(0.0, 10), (0.1, 10), (0.2, 11), (0.3, 10), (0.4, 10)])), "staircase");
        assert!(taken(&stretches(&[(20.0, 50), (60.0, 200)])), "a step");
        // two steps one behind the other, back
        assert!(taken(&stretches(&[(0.0, 10), (1.0, 1), (0.0, 10)])), "a pulse of one sample");
    }

    #[test]
    fn what_is_seen_on_its_way_does_not() {
        let sine: Vec<f64> = (0..200).map(|k| (0.1 * f64::from(k)).sin()).collect();
        let ramps: Vec<f64> = (0..200).map(|k| (0.25 * (f64::from(k) - 40.0)).clamp(0.0, 1.0)).collect();
        let noise: Vec<f64> = (0..200).map(|k| (f64::from(k * k) * 0.7).sin()).collect();
        let coarse: Vec<f64> = sine.iter().map(|v| (v * 6.0).round() / 10.0).collect();
        let noisy: Vec<f64> =
            stretches(&[(0.0, 100), (1.0, 100)]).iter().zip(&noise).map(|(v, n)| v + 0.01 * n).collect();
        for (what, signal) in
            [("sine", sine), ("ramps", ramps), ("noise", noise), ("resolution", coarse), ("noisy", noisy)]
        {
            assert!(!taken(&signal), "{what}");
        }
        assert!(!taken(&[3.0; 50]) && !taken(&[1.0]) && !taken(&[]), "nothing moves");
    }
}
