//! Optimal input design: what the next runs would determine.

use fdm_estimate::Direction;
use serde::{Deserialize, Serialize};
use std::fmt;

/// What the next runs would determine.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Design {
    /// What is known of each parameter: now, after each planned run, and by which manoeuvre it would be known best.
    pub outlook: Vec<Outlook>,
    /// Combinations that the runs so far do not determine.
    pub undetermined_now: Vec<Direction>,
    /// The planned runs in their order.
    pub steps: Vec<Step>,
    /// Every manoeuvre as the next run, the most telling first.
    pub gains: Vec<Gain>,
    /// Manoeuvres after which the response cannot be followed.
    pub lost: Vec<(Manoeuvre, String)>,
    /// Combinations that nothing here would determine.
    pub undetermined_then: Vec<Direction>,
}

/// What is known of a parameter.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Outlook {
    /// Its name.
    pub parameter: String,
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: Option<String>,
    /// Its standard error by the runs so far; none where they do not determine it.
    pub now: Option<f64>,
    /// After each planned run.
    pub then: Vec<Option<f64>>,
    /// The manoeuvre that as the next run would determine it best (its place in `gains`), and the error that it would leave.
    pub best: Option<(usize, f64)>,
}

/// A planned run.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Step {
    /// What is flown.
    pub manoeuvre: Manoeuvre,
    /// Bits of information that it adds.
    pub bits: f64,
}

/// A manoeuvre as the next run.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Gain {
    /// What is flown.
    pub manoeuvre: Manoeuvre,
    /// Bits of information that it adds to what is known.
    pub bits: f64,
    /// Standard error of each parameter after it.
    pub errors: Vec<Option<f64>>,
    /// Largest distance of each output from its first value (q): whether the model still holds there is the user's to know.
    pub excursions: Vec<f64>,
}

/// What the next runs would say for one of two models.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Distinction {
    /// Their names.
    pub models: [String; 2],
    /// The planned runs in their order, with the odds after each.
    pub steps: Vec<Separation>,
    /// Every manoeuvre as the next run, the most telling first.
    pub separations: Vec<Separation>,
    /// Manoeuvres that cannot be followed, or that keep no limit.
    pub lost: Vec<(Manoeuvre, String)>,
}

/// A manoeuvre that separates two models.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Separation {
    /// What is flown.
    pub manoeuvre: Manoeuvre,
    /// Expected logarithm of the odds for the true model, if that is the first, and if it is the second.
    pub log_odds: [f64; 2],
    /// Largest distance of each output from its first value by either model (q).
    pub excursions: Vec<f64>,
}

impl Separation {
    /// The logarithm of the odds, the mean over both models being true: half of Jeffreys' divergence. (The less of both would be zero
    /// wherever one model contains the other.)
    pub fn mean(&self) -> f64 {
        0.5 * (self.log_odds[0] + self.log_odds[1])
    }
}

/// One input, moved in one way.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Manoeuvre {
    /// The input's name.
    pub input: String,
    /// How it moves.
    pub form: Form,
    /// Half of a doublet, or one of the 3211's units of time; none of the others.
    pub unit: Option<f64>,
    /// First and last frequency of a sweep.
    pub band: Option<[f64; 2]>,
    /// How far the input moves.
    pub height: f64,
}

/// How an input moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// Up, and it stays there.
    Step,
    /// Up and down.
    Doublet,
    /// Three, two, one and one units, up and down in turn.
    #[serde(rename = "3211")]
    ThreeTwoOneOne,
    /// A sine through a band.
    Sweep,
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Step => "step",
            Self::Doublet => "doublet",
            Self::ThreeTwoOneOne => "3211",
            Self::Sweep => "sweep",
        })
    }
}

impl Manoeuvre {
    /// In words; `time` is the unit of time.
    pub fn words(&self, time: &str) -> String {
        let short = |v: f64| format!("{:.3}", v).trim_end_matches('0').trim_end_matches('.').to_string();
        match (self.unit, self.band) {
            (Some(unit), _) => format!("{} of {} {time}", self.form, short(unit)),
            (_, Some([low, high])) => format!("{} {} to {} 1/{time}", self.form, short(low), short(high)),
            _ => self.form.to_string(),
        }
    }
}

/// Experiments that are planned together: what they are set to, and when samples are taken.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Experiments {
    /// What is known of each parameter: now, and after each planned experiment.
    pub outlook: Vec<Outlook>,
    /// The covariance of the parameters (P by P): now, and after all of them; none of what is not determined.
    pub covariance: [Vec<Vec<Option<f64>>>; 2],
    /// Combinations that the runs so far do not determine.
    pub undetermined_now: Vec<Direction>,
    /// The planned experiments in their order.
    pub experiments: Vec<Experiment>,
    /// Combinations that they would not determine.
    pub undetermined_then: Vec<Direction>,
}

/// A planned experiment.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Experiment {
    /// What it is set to.
    pub levels: Vec<Level>,
    /// When samples are taken, rising.
    pub times: Vec<f64>,
    /// Bits of information that it adds to the ones before it.
    pub bits: f64,
    /// Largest distance of each output from its first value (q).
    pub excursions: Vec<f64>,
}

/// A condition or an initial amount, and what it is set to.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Level {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: Option<String>,
    /// What it is set to.
    pub value: f64,
}
