//! Gain and phase of the record against the model's response, in bands where the response has power.

use super::distribution::{OutputResidual, frequency};
use crate::bins::{cosine_lines, late};
use serde::{Deserialize, Serialize};

/// Ratio of the ends of a band, and its fewest bins.
const WIDTH: f64 = 1.6;
const FEWEST: usize = 12;
/// Share of the response's power that a band must hold.
const POWER: f64 = 0.005;
/// Deviations from none that a difference must have to be told.
const CLEAR: f64 = 4.0;

/// Gain and phase in one band.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Gain {
    /// Middle of the band, in cycles per unit of time.
    pub frequency: f64,
    /// Measured over modelled size.
    pub gain: f64,
    /// How far the record is behind the model, in degrees; negative where it is ahead.
    pub late: f64,
    /// Standard deviation of the gain, and of the phase in radians.
    pub deviation: f64,
    /// Runs that show it, of those with power in the band.
    pub runs: usize,
    /// Runs with power in the band.
    pub of: usize,
}

/// Signals of a run: record, response, response a quarter of a period late.
pub(crate) struct Signals {
    pub(crate) frequency: Vec<f64>,
    pub(crate) measured: Vec<f64>,
    pub(crate) response: Vec<f64>,
    pub(crate) late: Vec<f64>,
}

impl Signals {
    fn of(channel: &OutputResidual<'_>) -> Self {
        let seen: Vec<f64> = channel.response.iter().copied().filter(|y| !y.is_nan()).collect();
        let mean = seen.iter().sum::<f64>() / seen.len().max(1) as f64;
        let fill = |v: f64| if v.is_nan() { 0.0 } else { v - mean };
        let response: Vec<f64> = channel.response.iter().map(|y| fill(*y)).collect();
        let late = late(&response);
        Self {
            frequency: (0..response.len()).map(|k| frequency(channel, k)).collect(),
            measured: cosine_lines(channel.measured.iter().map(|z| fill(*z))),
            response: cosine_lines(response.into_iter()),
            late: cosine_lines(late.into_iter()),
        }
    }
}

/// In-phase and late part of the record, and what is known of them.
#[derive(Debug, Clone, Copy, Default)]
struct Parts {
    /// Products of the response with itself, with the late response, and of that with itself.
    squares: [f64; 3],
    in_phase: f64,
    late: f64,
    total: f64,
    count: usize,
}

impl Parts {
    fn of(bins: &Signals, low: f64, high: f64) -> Self {
        let rows = bins.frequency.partition_point(|f| *f < low)..bins.frequency.partition_point(|f| *f < high);
        let mut parts = Self { count: rows.len(), ..Self::default() };
        for k in rows {
            let (z, y, h) = (bins.measured[k], bins.response[k], bins.late[k]);
            parts.squares.iter_mut().zip([y * y, y * h, h * h]).for_each(|(sum, v)| *sum += v);
            parts.in_phase += z * y;
            parts.late += z * h;
            parts.total += z * z;
        }
        parts
    }

    fn with(self, other: Self) -> Self {
        Self {
            squares: std::array::from_fn(|k| self.squares[k] + other.squares[k]),
            in_phase: self.in_phase + other.in_phase,
            late: self.late + other.late,
            total: self.total + other.total,
            count: self.count + other.count,
        }
    }

    /// Multiples of the response and of the late response that make the record, and their deviation.
    fn solved(self) -> (f64, f64, f64) {
        let [own, cross, late] = self.squares;
        let determinant = own * late - cross * cross;
        let a = (late * self.in_phase - cross * self.late) / determinant;
        let b = (own * self.late - cross * self.in_phase) / determinant;
        let left = (self.total - a * self.in_phase - b * self.late).max(0.0);
        let free = self.count.saturating_sub(2).max(1) as f64;
        (a, b, (left / free * (own + late) / 2.0 / determinant).sqrt())
    }

    /// Power of the response.
    fn power(self) -> f64 {
        self.squares[0]
    }

    fn is_off(self) -> Option<(bool, bool)> {
        let (a, b, deviation) = self.solved();
        let far = |value: f64| value.abs() > CLEAR * deviation;
        (deviation.is_finite() && (far(a - 1.0) || far(b))).then_some((a > 1.0, b > 0.0))
    }
}

/// Where gain or phase differ clearly.
pub(crate) fn gains(channels: &[OutputResidual<'_>]) -> Vec<Gain> {
    gains_of(&channels.iter().map(Signals::of).collect::<Vec<_>>())
}

/// Where gain or phase of bins differ clearly.
pub(crate) fn gains_of(bins: &[Signals]) -> Vec<Gain> {
    let Some(longest) = bins.iter().max_by_key(|l| l.frequency.len()) else { return Vec::new() };
    let power: f64 = bins.iter().flat_map(|l| &l.response).map(|y| y * y).sum();
    let mut gains = Vec::new();
    let mut first = 2;
    while first + FEWEST <= longest.frequency.len() {
        let f = &longest.frequency;
        let last = f.partition_point(|v| *v < f[first] * WIDTH).max(first + FEWEST).min(f.len());
        let (low, high) = (f[first], f.get(last).copied().unwrap_or(f64::INFINITY));
        let runs: Vec<Parts> = bins.iter().map(|l| Parts::of(l, low, high)).collect();
        let all = runs.iter().fold(Parts::default(), |a, b| a.with(*b));
        if all.power() > POWER * power
            && let Some(sides) = all.is_off()
        {
            let (a, b, deviation) = all.solved();
            let powerful: Vec<&Parts> =
                runs.iter().filter(|r| r.power() > 0.1 * all.power() / runs.len() as f64).collect();
            let (by_gain, by_phase) = ((a - 1.0).abs() > b.abs(), sides);
            let agrees = |parts: &&&Parts| {
                let (own, late, _) = parts.solved();
                if by_gain { (own > 1.0) == by_phase.0 } else { (late > 0.0) == by_phase.1 }
            };
            gains.push(Gain {
                frequency: (f[first] * f[last - 1]).sqrt(),
                gain: a.hypot(b),
                late: fdm_grammar::math::atan2(b, a).to_degrees(),
                deviation,
                runs: powerful.iter().filter(agrees).count(),
                of: powerful.len(),
            });
        }
        first = last;
    }
    gains
}
