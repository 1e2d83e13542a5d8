//! Noise of sensors with a known covariance: drawn from it, and whitened by it exactly (Durbin and Levinson's predictor), which
//! is the metric in which the true structure is judged.

use crate::chance::Chance;
use nalgebra::DMatrix;
use std::f64::consts::PI;

/// What noise sounds like.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Colour {
    White,
    /// 70 % of its power falls with frequency, the rest is white.
    Pink,
    /// An autoregression of second order with a resonance.
    Resonance,
    /// Channels share a slow part.
    Crossed,
}

impl Colour {
    pub(crate) const ALL: [Self; 4] = [Self::White, Self::Pink, Self::Resonance, Self::Crossed];

    pub(crate) fn name(self) -> &'static str {
        ["white", "pink", "resonance", "crossed"][self as usize]
    }

    pub(crate) fn named(name: &str) -> Self {
        Self::ALL.into_iter().find(|c| c.name() == name).unwrap_or_else(|| panic!("no noise is called {name}"))
    }

    /// Autocovariance at lags 0 to n - 1, of variance 1.
    fn autocovariance(self, n: usize, chance: &mut Chance) -> Vec<f64> {
        match self {
            Self::White => std::iter::once(1.0).chain(std::iter::repeat_n(0.0, n - 1)).collect(),
            Self::Pink => pink(n).enumerate().map(|(k, r)| 0.7 * r + if k == 0 { 0.3 } else { 0.0 }).collect(),
            Self::Resonance => {
                let (radius, angle) = (chance.between(0.85, 0.97), PI * chance.log_between(0.05, 0.6));
                let (a1, a2) = (2.0 * radius * angle.cos(), -radius * radius);
                let mut r = vec![1.0, a1 / (1.0 - a2)];
                while r.len() < n {
                    r.push(a1 * r[r.len() - 1] + a2 * r[r.len() - 2]);
                }
                r.truncate(n);
                r
            }
            Self::Crossed => (0..n).map(|k| 0.7_f64.powi(k as i32)).collect(),
        }
    }
}

/// A sum of lines whose power is one over their frequency, the first at a quarter of a line of the record.
fn pink(n: usize) -> impl Iterator<Item = f64> {
    let period = 4 * n;
    let total: f64 = (1..=period / 2).map(|k| 1.0 / k as f64).sum();
    // cosines of a table: lines times lags are too many to compute one by one
    let cosine: Vec<f64> = (0..period).map(|k| (2.0 * PI * k as f64 / period as f64).cos()).collect();
    (0..n).map(move |lag| (1..=period / 2).map(|k| cosine[k * lag % period] / k as f64).sum::<f64>() / total)
}

/// The best prediction of each sample from those before it.
struct Predictor {
    /// Coefficients of sample t, the oldest first; shorter than t where the rest is zero.
    rows: Vec<Vec<f64>>,
    deviations: Vec<f64>,
}

impl Predictor {
    fn new(r: &[f64]) -> Self {
        let (mut row, mut variance): (Vec<f64>, f64) = (Vec::new(), r[0]);
        let mut predictor = Self { rows: vec![Vec::new()], deviations: vec![variance.sqrt()] };
        for n in 1..r.len() {
            let known: f64 = row.iter().enumerate().map(|(j, a)| a * r[n - 1 - j]).sum();
            let last = (r[n] - known) / variance;
            let next: Vec<f64> = (0..row.len()).map(|j| row[j] - last * row[row.len() - 1 - j]).collect();
            row = next;
            row.push(last);
            variance *= 1.0 - last * last;
            let used = row.iter().rposition(|a| a.abs() > 1e-9).map_or(0, |k| k + 1);
            predictor.rows.push(row[..used].iter().rev().copied().collect());
            predictor.deviations.push(variance.sqrt());
        }
        predictor
    }

    fn predicted(&self, t: usize, before: &[f64]) -> f64 {
        let row = &self.rows[t];
        let past = &before[t - row.len()..t];
        // four sums, so that they need not wait for each other
        let mut sums = [0.0; 4];
        let (rows, rest) = row.as_chunks::<4>();
        let (pasts, past_rest) = past.as_chunks::<4>();
        for (a, x) in rows.iter().zip(pasts) {
            for k in 0..4 {
                sums[k] += a[k] * x[k];
            }
        }
        let tail: f64 = rest.iter().zip(past_rest).map(|(a, x)| a * x).sum();
        sums.iter().sum::<f64>() + tail
    }
}

/// Noise of all channels of a case.
pub(crate) struct Noise {
    predictor: Predictor,
    /// Standard deviation of each channel.
    pub(crate) sigma: Vec<f64>,
    /// Independent channels to those of the record, and back.
    mixing: Option<(DMatrix<f64>, DMatrix<f64>)>,
}

impl Noise {
    /// Noise for runs of up to `samples` samples.
    pub(crate) fn new(colour: Colour, sigma: Vec<f64>, samples: usize, chance: &mut Chance) -> Self {
        let predictor = Predictor::new(&colour.autocovariance(samples, chance));
        let mixing = (colour == Colour::Crossed && sigma.len() > 1).then(|| {
            let share = chance.between(0.5, 0.85);
            let signs: Vec<f64> = sigma.iter().map(|_| chance.sign()).collect();
            let entry = |i: usize, j: usize| if i == j { 1.0 } else { share * signs[i] * signs[j] };
            let lower = DMatrix::from_fn(sigma.len(), sigma.len(), entry).cholesky().expect("positive").l();
            let inverse = lower.clone().try_inverse().expect("triangular");
            (lower, inverse)
        });
        Self { predictor, sigma, mixing }
    }

    /// One run, N by q.
    pub(crate) fn draw(&self, samples: usize, chance: &mut Chance) -> Vec<f64> {
        let q = self.sigma.len();
        let channels: Vec<Vec<f64>> = (0..q)
            .map(|_| {
                let mut x: Vec<f64> = Vec::with_capacity(samples);
                for t in 0..samples {
                    x.push(self.predictor.predicted(t, &x) + self.predictor.deviations[t] * chance.normal());
                }
                x
            })
            .collect();
        let mut rows = vec![0.0; samples * q];
        for t in 0..samples {
            for c in 0..q {
                let mixed = match &self.mixing {
                    Some((lower, _)) => (0..=c).map(|j| lower[(c, j)] * channels[j][t]).sum(),
                    None => channels[c][t],
                };
                rows[t * q + c] = self.sigma[c] * mixed;
            }
        }
        rows
    }

    /// N by q to as many numbers that are independent and of variance 1 if the rows are noise, channel by channel.
    pub(crate) fn whiten(&self, rows: &[f64]) -> Vec<f64> {
        let q = self.sigma.len();
        let samples = rows.len() / q;
        let mut white = vec![0.0; rows.len()];
        let mut channel = vec![0.0; samples];
        for c in 0..q {
            for (t, x) in channel.iter_mut().enumerate() {
                let scaled = |j: usize| rows[t * q + j] / self.sigma[j];
                *x = match &self.mixing {
                    Some((_, inverse)) => (0..=c).map(|j| inverse[(c, j)] * scaled(j)).sum(),
                    None => scaled(c),
                };
            }
            for t in 0..samples {
                white[c * samples + t] =
                    (channel[t] - self.predictor.predicted(t, &channel)) / self.predictor.deviations[t];
            }
        }
        white
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_drawn_is_whitened_again() {
        for colour in Colour::ALL {
            let mut chance = Chance::new(&format!("noise {}", colour.name()));
            let noise = Noise::new(colour, vec![0.5, 2.0], 300, &mut chance);
            let white: Vec<f64> = (0..20).flat_map(|_| noise.whiten(&noise.draw(300, &mut chance))).collect();
            let n = white.len() as f64;
            let power = white.iter().map(|x| x * x).sum::<f64>() / n;
            let next = white.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / n;
            // standard deviations of both are 0.013 and 0.009
            assert!((power - 1.0).abs() < 0.06 && next.abs() < 0.045, "{}: {power} {next}", colour.name());
        }
    }

    #[test]
    fn variances_are_those_asked_for() {
        for colour in Colour::ALL {
            let mut chance = Chance::new(colour.name());
            let noise = Noise::new(colour, vec![3.0], 400, &mut chance);
            let power: f64 =
                (0..60).map(|_| noise.draw(400, &mut chance).iter().map(|x| x * x).sum::<f64>() / 400.0).sum::<f64>()
                    / 60.0;
            assert!((power / 9.0 - 1.0).abs() < 0.25, "{}: {power}", colour.name());
        }
    }
}
