//! Measurement noise: how large, of what colour, of which law. The same on every machine.

use fdm_grammar::math;
use fdm_numeric::random::Stream;
use serde::Deserialize;

/// Noise of one output: a number is the standard deviation of white noise in the output's unit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Noise {
    /// Its standard deviation.
    pub deviation: f64,
    /// What the deviation is a part of.
    pub of: Of,
    /// Its spectrum.
    pub colour: Colour,
    /// Whether it multiplies: the logarithm of the output is what has the noise.
    pub logarithm: bool,
}

/// What a standard deviation is a part of.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Of {
    /// The output's unit.
    #[default]
    Unit,
    /// The largest magnitude in the record.
    Largest,
    /// The root mean square about the mean of the record.
    Rms,
    /// The value at the same time: relative noise.
    Value,
}

/// The spectrum of noise.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum Colour {
    /// Flat.
    #[default]
    White,
    /// What a lag of this time constant leaves of white noise: AR(1) at the samples.
    Lag(f64),
    /// Falling as one over the frequency.
    Pink,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "noise is a number, or a table with `deviation` and `of`, `lag`, `pink`, `logarithm`")]
enum Written {
    Number(f64),
    Table(Described),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Described {
    deviation: f64,
    #[serde(default)]
    of: Of,
    lag: Option<f64>,
    #[serde(default)]
    pink: bool,
    #[serde(default)]
    logarithm: bool,
}

impl<'de> Deserialize<'de> for Noise {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Ok(match Written::deserialize(from)? {
            Written::Number(deviation) => Self { deviation, ..Self::default() },
            Written::Table(d) => {
                let colour = match (d.lag, d.pink) {
                    (Some(lag), _) => Colour::Lag(lag),
                    (None, true) => Colour::Pink,
                    (None, false) => Colour::White,
                };
                Self { deviation: d.deviation, of: d.of, colour, logarithm: d.logarithm }
            }
        })
    }
}

impl Noise {
    /// Adds noise to the values of an output, `dt` apart.
    pub fn add(&self, values: &mut [f64], dt: f64, chance: &mut Stream) {
        let n = values.len() as f64;
        let scale = match self.of {
            Of::Unit | Of::Value => 1.0,
            Of::Largest => values.iter().fold(0.0, |a: f64, v| a.max(v.abs())),
            Of::Rms => {
                let mean = values.iter().sum::<f64>() / n;
                (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n).sqrt()
            }
        };
        let drawn = self.drawn(values.len(), dt, chance);
        for (value, z) in values.iter_mut().zip(drawn) {
            let part = scale * self.deviation * z;
            *value = match (self.logarithm, self.of) {
                (true, _) => *value * math::exp(part),
                (false, Of::Value) => *value * (1.0 + part),
                (false, _) => *value + part,
            };
        }
    }

    /// Noise of deviation 1 at samples `dt` apart.
    pub fn drawn(&self, samples: usize, dt: f64, chance: &mut Stream) -> Vec<f64> {
        match self.colour {
            Colour::White => (0..samples).map(|_| chance.normal()).collect(),
            Colour::Lag(lag) => lagged(samples, dt, lag, chance),
            Colour::Pink => pink(samples, dt, chance),
        }
    }
}

/// Octaves of lags of equal variance.
fn pink(samples: usize, dt: f64, chance: &mut Stream) -> Vec<f64> {
    let octaves = (samples.max(2) as f64).log2().ceil() as u32;
    let mut sum = vec![0.0; samples];
    for octave in 0..octaves {
        let part = lagged(samples, dt, dt * f64::from(1u32 << octave.min(30)), chance);
        sum.iter_mut().zip(part).for_each(|(s, z)| *s += z);
    }
    let scale = 1.0 / f64::from(octaves.max(1)).sqrt();
    sum.iter().map(|s| scale * s).collect()
}

/// What a lag leaves of white noise, scaled to deviation 1 (a first-order Gauss-Markov process); it begins in its stationary state.
pub(super) fn lagged(samples: usize, dt: f64, lag: f64, chance: &mut Stream) -> Vec<f64> {
    let keep = if lag > 0.0 { math::exp(-dt / lag) } else { 0.0 };
    let fresh = (1.0 - keep * keep).sqrt();
    let mut state = chance.normal();
    let mut drawn = Vec::with_capacity(samples);
    for _ in 0..samples {
        drawn.push(state);
        state = keep * state + fresh * chance.normal();
    }
    drawn
}
