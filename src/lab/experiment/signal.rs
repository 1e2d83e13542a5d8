//! Forms of inputs: what pilots, rigs and papers use to move a system.
//!
//! Measurement noise: how large, of what colour, of which law. The same on every machine.

use super::amount::Amount;
use fdm_grammar::{Unit, math};
use fdm_numeric::random::Stream;
use serde::Deserialize;
use std::f64::consts::{PI, TAU};

/// A part of an input over time. Times are in the model's unit, frequencies in cycles per it, heights in the channel's unit or their own.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "form", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Signal {
    /// A constant from a time on.
    Step {
        /// When.
        at: f64,
        /// How much.
        height: Amount,
    },
    /// A step whose rate is limited, as a rudder's: `rate` per unit of time.
    Ramp {
        /// When it begins to move.
        at: f64,
        /// Where it ends.
        height: Amount,
        /// How quickly; positive.
        rate: Amount,
    },
    /// Up and back again.
    Pulse {
        /// When.
        at: f64,
        /// How much.
        height: Amount,
        /// How long.
        length: f64,
    },
    /// Up and down.
    Doublet {
        /// When.
        at: f64,
        /// How much.
        height: Amount,
        /// How long each half is.
        half: f64,
    },
    /// The DFVLR's 3, 2, 1 and 1 units of time, up and down in turn.
    #[serde(rename = "3211")]
    ThreeTwoOneOne {
        /// When.
        at: f64,
        /// How much.
        height: Amount,
        /// One unit.
        unit: f64,
    },
    /// Steps one after the other: heights and durations.
    Steps {
        /// When.
        at: f64,
        /// All heights are multiplied by this.
        height: Amount,
        /// Heights and durations.
        pattern: Vec<[f64; 2]>,
    },
    /// Sines of equal height, equally spaced in a band.
    Multisine {
        /// Lowest and highest frequency.
        band: [f64; 2],
        /// How many lines.
        lines: usize,
        /// Root mean square.
        rms: Amount,
        /// How they begin.
        #[serde(default)]
        phases: Phases,
        /// Of a comb with `[k, n]` teeth every n-th line from the k-th (0 first), so that n inputs share no line.
        #[serde(default)]
        comb: Option<[usize; 2]>,
        /// Zero before.
        #[serde(default)]
        at: Option<f64>,
        /// Zero from then on.
        #[serde(default)]
        to: Option<f64>,
    },
    /// A sine whose frequency goes through a band.
    Sweep {
        /// When.
        at: f64,
        /// How long.
        length: f64,
        /// First and last frequency.
        band: [f64; 2],
        /// Amplitude.
        height: Amount,
        /// How the frequency goes.
        #[serde(default)]
        law: Law,
    },
    /// A column of a measured record, linear between its samples; before and behind them it keeps its end values.
    Record {
        /// The file, beside the experiment's.
        file: String,
        /// Its column.
        column: String,
    },
    /// Chance: a gust. White at the samples, or what a lag of this time constant leaves of white noise.
    Chance {
        /// Standard deviation.
        deviation: Amount,
        /// Time constant.
        #[serde(default)]
        lag: f64,
    },
}

/// How the lines of a multisine begin.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Phases {
    /// So that peaks are low (Schroeder 1970).
    #[default]
    Schroeder,
    /// By chance.
    Random,
}

/// How the frequency of a sweep goes from its first to its last value.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    /// By equal factors in equal times.
    #[default]
    Log,
    /// By equal steps in equal times.
    Linear,
}

/// Times within this part of a sampling interval are the same.
const SAME: f64 = 1e-6;

impl Signal {
    /// Its values at samples `dt` apart, in the unit of the channel; none when its own unit does not fit that. `time` is the unit of time.
    pub fn sampled(
        &self,
        samples: usize,
        dt: f64,
        unit: Option<&Unit>,
        time: &Unit,
        chance: &mut Stream,
    ) -> Option<Vec<f64>> {
        let at_each = |of: &dyn Fn(f64) -> f64| (0..samples).map(|k| of(dt * k as f64)).collect();
        let since = |t: f64, at: f64| t - at > -SAME * dt;
        let patterned =
            |at: f64, height: f64, pattern: &[[f64; 2]]| at_each(&|t| height * stepped(t - at + SAME * dt, pattern));
        Some(match self {
            Self::Step { at, height } => {
                let height = height.within(unit)?;
                at_each(&|t| if since(t, *at) { height } else { 0.0 })
            }
            Self::Ramp { at, height, rate } => {
                let speed = unit.and_then(|u| u.quotient(time));
                let (height, rate) = (height.within(unit)?, rate.within(speed.as_ref())?);
                at_each(&|t| ((t - at).max(0.0) * rate).min(height.abs()).copysign(height))
            }
            Self::Pulse { at, height, length } => patterned(*at, height.within(unit)?, &[[1.0, *length]]),
            Self::Doublet { at, height, half } => patterned(*at, height.within(unit)?, &[[1.0, *half], [-1.0, *half]]),
            Self::ThreeTwoOneOne { at, height, unit: one } => {
                let pattern = [[1.0, 3.0 * one], [-1.0, 2.0 * one], [1.0, *one], [-1.0, *one]];
                patterned(*at, height.within(unit)?, &pattern)
            }
            Self::Steps { at, height, pattern } => patterned(*at, height.within(unit)?, pattern),
            Self::Multisine { band, lines, rms, phases, comb, at, to } => {
                let height = rms.within(unit)? / (0.5 * *lines as f64).sqrt();
                let sines = sines(*band, *lines, comb.unwrap_or([0, 1]), *phases, chance);
                let (from, to) = (at.unwrap_or(0.0), to.unwrap_or(f64::INFINITY));
                at_each(&|t| match since(t, from) && !since(t, to) {
                    true => height * sines.iter().map(|(f, p)| math::cos(TAU * f * (t - from) + p)).sum::<f64>(),
                    false => 0.0,
                })
            }
            Self::Sweep { at, length, band: [low, high], height, law } => {
                let height = height.within(unit)?;
                let turns = |t: f64| match law {
                    Law::Linear => low * t + 0.5 * (high - low) * t * t / length,
                    Law::Log => {
                        let rate = math::log(high / low) / length;
                        low * (math::exp(rate * t) - 1.0) / rate
                    }
                };
                at_each(&|t| match (0.0..=*length).contains(&(t - at)) {
                    true => height * math::sin(TAU * turns(t - at)),
                    false => 0.0,
                })
            }
            // known where the files are: `flight`
            Self::Record { .. } => return None,
            Self::Chance { deviation, lag } => {
                let deviation = deviation.within(unit)?;
                lagged(samples, dt, *lag, chance).iter().map(|z| deviation * z).collect()
            }
        })
    }
}

/// Heights one after the other, `t` since the first begins.
fn stepped(t: f64, pattern: &[[f64; 2]]) -> f64 {
    let mut end = 0.0;
    for [height, duration] in pattern {
        let begin = end;
        end += duration;
        if (begin..end).contains(&t) {
            return *height;
        }
    }
    0.0
}

/// Frequencies and phases.
fn sines(
    band: [f64; 2],
    lines: usize,
    [first, teeth]: [usize; 2],
    phases: Phases,
    chance: &mut Stream,
) -> Vec<(f64, f64)> {
    let all = lines * teeth.max(1);
    let apart = (band[1] - band[0]) / (all.max(2) - 1) as f64;
    let one = |j: usize| {
        let frequency = band[0] + apart * (j * teeth.max(1) + first) as f64;
        let phase = match phases {
            Phases::Schroeder => -PI * ((j + 1) * (j + 1)) as f64 / lines as f64,
            Phases::Random => TAU * chance.uniform(),
        };
        (frequency, phase)
    };
    (0..lines).map(one).collect()
}

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
