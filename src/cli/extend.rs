//! `fdm extend`: a model's own text with effects in it.

use crate::effects::{Effects, invalid, subject};
use crate::failure::{Failure, print};
use clap::Args;
use fdm::effect::{Beginning, Choice, Nominal, Places, Scales, Subject};
use fdm_grammar::diagnostic::nearest;
use similar::TextDiff;
use std::path::PathBuf;
use std::process::ExitCode;

/// What `fdm extend` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Model file (.fdm)
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    /// An effect at its place, such as `input_delay(stick)`; several are applied one after the other
    #[arg(long = "effect", value_name = "EFFECT", required = true)]
    effect: Vec<String>,
    #[command(flatten)]
    effects: Effects,
    /// Sampling interval of the records, from which start values and bounds of lags and delays follow
    #[arg(long, value_name = "TIME", default_value_t = 0.01)]
    step: f64,
    /// Length of the records
    #[arg(long, value_name = "TIME", default_value_t = 10.0)]
    duration: f64,
    /// Write the extended model here
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
}

/// What was typed about the records; signals are of size 1.
struct Typed {
    step: f64,
    duration: f64,
}

impl Scales for Typed {
    fn size(&self, signal: &str, q: f64) -> f64 {
        Nominal.size(signal, q)
    }

    fn speed(&self, signal: &str, q: f64) -> f64 {
        Nominal.speed(signal, q)
    }

    fn beginning(&self, signal: &str) -> Beginning {
        Nominal.beginning(signal)
    }

    fn step(&self) -> f64 {
        self.step
    }

    fn duration(&self) -> f64 {
        self.duration
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let positive = |v: f64| v > 0.0 && v.is_finite();
    if !positive(arguments.step) || !positive(arguments.duration) {
        return Err(Failure::input(["`--step` and `--duration` are times above zero"]));
    }
    let catalogue = arguments.effects.read()?;
    let (model, mut at) = subject(&arguments.model)?;
    let scales = Typed { step: arguments.step, duration: arguments.duration };
    for wanted in &arguments.effect {
        let places = catalogue.places(&at);
        let candidate = places.find(wanted).ok_or_else(|| unknown(wanted, &places))?;
        let extension =
            candidate.apply(&at, &scales, &Choice::new()).map_err(|d| Failure::input([d.message.clone()]))?;
        let compiled = fdm_grammar::compile(extension.source()).map_err(|f| invalid(extension.source(), f))?;
        at = Subject::new(extension.source(), &compiled.model).map_err(|f| invalid(extension.source(), f))?;
    }
    let (old, new) = (model.source().text(), at.source().text());
    let name = arguments.model.display().to_string();
    let diff = TextDiff::from_lines(old, new).unified_diff().context_radius(1).header(&name, "extended").to_string();
    if let Some(file) = &arguments.write {
        std::fs::write(file, new)
            .map_err(|e| Failure::input([format!("{}: {}", file.display(), fdm::store::reason(&e))]))?;
    }
    Ok(if print(&diff) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn unknown(wanted: &str, places: &Places) -> Failure {
    let all: Vec<String> = places.candidates.iter().map(ToString::to_string).collect();
    let name = wanted.split('(').next().unwrap_or("").trim();
    let same: Vec<&String> = all.iter().filter(|c| c.split('(').next() == Some(name)).collect();
    let message = match nearest(wanted, all.iter().map(String::as_str)) {
        Some(near) => format!("`{wanted}` fits nowhere in this model; did you mean `{near}`?"),
        None if same.is_empty() => {
            format!("`{wanted}` fits nowhere in this model; `fdm effects MODEL` lists what does")
        }
        None => {
            let shown: Vec<_> = same.iter().take(8).map(|c| format!("`{c}`")).collect();
            format!("`{wanted}` fits nowhere in this model; `{name}` does as {}", shown.join(", "))
        }
    };
    Failure::input([message])
}
