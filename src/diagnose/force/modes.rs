//! Lightly damped modes that an input shakes: what rings for longer than a band of lines is wide has a phase that turns within
//! a few lines, and no constant gain and phase follow it. So every frequency is tried, a half bandwidth from the next.

use fdm_grammar::math;
use rustfft::num_complex::Complex;

/// Damping ratios that are tried, and how many lines around a mode's own are looked at on either side.
const DAMPED: [(f64, f64); 2] = [(0.01, 8.0), (0.04, 16.0)];
/// Lowest frequency, in cycles per record.
const LOWEST: f64 = 3.0;
/// Highest, as a part of the sampling frequency.
const HIGHEST: f64 = 0.45;
/// Distance of frequencies that no record tells apart, in cycles per record.
const ALIKE: f64 = 0.3;

/// A mode.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mode {
    /// Cycles per unit of time.
    pub(super) frequency: f64,
    pub(super) damping: f64,
    /// How far around it is looked, in cycles per unit of time.
    pub(super) reach: f64,
}

/// All that are tried for records of this length and interval.
pub(super) fn modes(length: f64, interval: f64) -> Vec<Mode> {
    let mut modes = Vec::new();
    for (damping, lines) in DAMPED {
        let mut frequency = LOWEST / length;
        while frequency < HIGHEST / interval {
            modes.push(Mode { frequency, damping, reach: lines / (2.0 * length) });
            frequency += (damping * frequency).max(ALIKE / length);
        }
    }
    modes
}

impl Mode {
    /// Response to a signal (linear between samples) from rest at its first value, and the same a quarter of a period late.
    pub(super) fn response(&self, signal: &[f64], interval: f64) -> [Vec<f64>; 2] {
        let omega = std::f64::consts::TAU * self.frequency * interval;
        // w' = s w + u, exactly
        let s = Complex::new(-self.damping * omega, omega * (1.0 - self.damping * self.damping).sqrt());
        let keep = Complex::new(math::cos(s.im), math::sin(s.im)) * math::exp(s.re);
        let first = (keep - 1.0) / s;
        let second = (first - 1.0) / s;
        let from = signal.first().copied().unwrap_or_default();
        let (mut w, mut last) = (Complex::new(0.0, 0.0), 0.0);
        let mut both = [Vec::with_capacity(signal.len()), Vec::with_capacity(signal.len())];
        for (k, value) in signal.iter().enumerate() {
            let u = value - from;
            if k > 0 {
                w = keep * w + (first - second) * last + second * u;
            }
            last = u;
            both[0].push(w.re);
            both[1].push(w.im);
        }
        both
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_rings_as_its_equation_says() {
        // a step: x'' + 2 z w x' + w^2 x = 1 from rest, in closed form; Im w is x times the damped frequency
        let (interval, mode) = (0.05, Mode { frequency: 0.4, damping: 0.02, reach: 1.0 });
        let mut step = vec![1.0; 200];
        step[0] = 0.0;
        step[1] = 1.0;
        let [_, x] = mode.response(&step, interval);
        let (omega, zeta) = (std::f64::consts::TAU * 0.4, 0.02_f64);
        let damped = omega * (1.0 - zeta * zeta).sqrt();
        // the ramp from 0 to 1 over the first interval is a step's integral over it
        let at = |t: f64| {
            let decay = (-zeta * omega * t).exp();
            (1.0 - decay * ((damped * t).cos() + zeta * omega / damped * (damped * t).sin())) / (omega * omega)
        };
        let steps = 2000;
        for k in [1_usize, 7, 80, 199] {
            let mean = (0..steps)
                .map(|i| at(k as f64 * interval - (i as f64 + 0.5) / f64::from(steps) * interval))
                .sum::<f64>()
                / f64::from(steps);
            let own = x[k] * interval / damped;
            assert!((own - mean).abs() < 1e-6 * mean.abs().max(0.01), "{k}: {own} {mean}");
        }
    }
}
