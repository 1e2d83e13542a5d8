//! Measurement noise as it is typed.

use crate::failure::{Failure, did_you_mean};
use crate::value::assignment;
use clap::Args;
use fdm_estimate::Noise;
use fdm_system::Model;

/// Measurement noise as it is typed.
#[derive(Debug, Args)]
#[command(next_help_heading = "Estimation")]
pub(crate) struct MeasurementNoise {
    /// Measurement noise: `diagonal`, `full`, or `OUTPUT=DEVIATION`
    ///
    /// `diagonal` (one variance for each output, estimated), `full` (their covariance, estimated), or the known standard deviation of an
    /// output [default: as the model declares; the rest is estimated].
    #[arg(long = "noise", value_name = "NOISE")]
    words: Vec<String>,
}

impl MeasurementNoise {
    /// Whether anything was typed.
    pub(crate) fn is_given(&self) -> bool {
        !self.words.is_empty()
    }

    /// The words that were typed.
    pub(crate) fn words(&self) -> &[String] {
        &self.words
    }

    /// What was typed, and what the model declares.
    pub(crate) fn of(&self, model: &Model) -> Result<Noise, Failure> {
        noise(&self.words, model)
    }
}

/// What the words of `--noise` say; each is `diagonal`, `full` or `OUTPUT=DEVIATION`.
pub(crate) fn noise(words: &[String], model: &Model) -> Result<Noise, Failure> {
    let outputs = &model.definition().outputs;
    let (mut given, mut kind) = (vec![None; outputs.len()], None);
    let mut wrong = Vec::new();
    for word in words {
        match word.as_str() {
            "diagonal" | "full" => {
                let wanted = if word == "full" { Noise::Full } else { Noise::Diagonal };
                if kind.replace(wanted.clone()).is_some_and(|other| other != wanted) {
                    wrong.push("--noise diagonal and --noise full exclude each other".into());
                }
            }
            _ => match assignment(word) {
                Ok((name, deviation)) => match outputs.iter().position(|o| o.quantity.name == name) {
                    Some(k) => {
                        if let Some(other) = given[k].replace(deviation).filter(|other| *other != deviation) {
                            wrong.push(format!(
                                "--noise {name}={other} and --noise {word}: give one deviation of `{name}`"
                            ));
                        }
                    }
                    None => {
                        let hint = did_you_mean(&name, outputs.iter().map(|o| o.quantity.name.as_str()));
                        wrong.push(format!("--noise {word}: the model has no output `{name}`{hint}"));
                    }
                },
                Err(e) => wrong.push(format!("--noise {word}: {e}, `diagonal` or `full`")),
            },
        }
    }
    let any = given.iter().any(Option::is_some);
    let declared = outputs.iter().any(|o| o.noise.is_some());
    // deviations without a number put the model's expressions aside
    let aside = kind == Some(Noise::Diagonal) && outputs.iter().any(|o| o.noise_model.is_some());
    if any && kind == Some(Noise::Full) {
        wrong.push("--noise full estimates the whole covariance: deviations cannot be given beside it".into());
    }
    if !wrong.is_empty() {
        return Err(Failure::Input(wrong));
    }
    if kind.is_none() {
        given.iter_mut().zip(outputs).for_each(|(given, output)| *given = given.or(output.noise));
    }
    Ok(match kind {
        Some(Noise::Full) => Noise::Full,
        _ if any || declared || aside => Noise::Given(given),
        _ => Noise::Diagonal,
    })
}
