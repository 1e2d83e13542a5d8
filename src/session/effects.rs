//! `fdm effects`: what may be missing from a model, and where; `fdm extend`: a model's own text with effects in it.

use crate::failure::{Failure, did_you_mean};
use crate::load::load_model;
use crate::value::number;
use clap::Args;
use fdm_effects::{Beginning, Catalogue, Choice, Field, Kind, Nominal, Places, Scales, Subject};
use fdm_grammar::{Diagnostic, Source};
use fdm_results::store::read_input_text;
use fdm_system::record::{Run, Topic, open_log};
use fdm_system::{Model, ModelError};
use similar::TextDiff;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Catalogues of effects.
#[derive(Debug, Args)]
#[command(next_help_heading = "Search")]
pub struct Effects {
    /// Effects of your own (.fdm), beside the built-in ones; one of the same name replaces a built-in one
    #[arg(long = "effects", value_name = "FILE", hide_short_help = true)]
    files: Vec<PathBuf>,
}

/// Which effects of the catalogue.
#[derive(Debug, Args)]
#[command(next_help_heading = "Search")]
pub struct Chosen {
    /// Search these effects only, such as `input_delay,actuator_lag`
    #[arg(long, value_name = "NAMES", value_delimiter = ',', conflicts_with = "without")]
    only: Vec<String>,
    /// Search all effects but these
    ///
    /// A model with many states has hundreds of places for a `product_term`.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    without: Vec<String>,
    /// Of the effects that belong to a field, those of these
    ///
    /// Fields are aircraft, rotorcraft, ship, mechanism, process, kinetics. Without it all of which a model has few places.
    #[arg(long, value_name = "FIELDS", value_delimiter = ',', value_parser = field, hide_short_help = true)]
    catalogue: Vec<Field>,
}

fn field(text: &str) -> Result<Field, String> {
    let words = Field::ALL.map(Field::word);
    Field::ALL.into_iter().find(|f| f.word() == text).ok_or_else(|| {
        let near = did_you_mean(text, words);
        format!("there is no such field{near}; there are {}", words.join(", "))
    })
}

impl Chosen {
    /// The part of a catalogue that was chosen; names that it does not have are refused.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn of(&self, mut catalogue: Catalogue) -> Result<Catalogue, Failure> {
        let own = catalogue.effects().map(|e| e.name().to_string());
        let names: BTreeSet<String> = own.collect();
        let unknown = |name: &&String| !names.contains(*name);
        let said = self.only.iter().chain(&self.without).filter(unknown).map(|name| {
            let near = did_you_mean(name, names.iter().map(String::as_str));
            format!("there is no effect `{name}`{near} (`fdm effects` lists them)")
        });
        let said: Vec<String> = said.collect();
        if !said.is_empty() {
            return Err(Failure::input(said));
        }
        catalogue.retain(|name| match self.only.is_empty() {
            true => !self.without.iter().any(|n| n == name),
            false => self.only.iter().any(|n| n == name),
        });
        if !self.catalogue.is_empty() {
            catalogue.restrict(&self.catalogue);
        }
        Ok(catalogue)
    }
}

/// The effects whose places are listed.
#[derive(Debug, Args)]
pub struct Options {
    /// Model file (.fdm)
    #[arg(value_name = "MODEL")]
    pub model: PathBuf,
    #[command(flatten)]
    effects: Effects,
    #[command(flatten)]
    chosen: Chosen,
}

impl Options {
    /// The effects that were chosen.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn catalogue(&self) -> Result<Catalogue, Failure> {
        self.chosen.of(self.effects.read()?)
    }
}

/// Reads a model for effects.
///
/// # Errors
/// [`Failure`]
pub fn subject(file: &Path) -> Result<(Model, Subject), Failure> {
    let model = load_model(file)?;
    let subject = subject_of(&model)?;
    Ok((model, subject))
}

/// A model as effects are put into it.
///
/// # Errors
/// [`Failure::Model`]
pub fn subject_of(model: &Model) -> Result<Subject, Failure> {
    Subject::new(model.source(), model.definition()).map_err(|f| invalid(model.source(), f))
}

impl Effects {
    /// The catalogue; a file with a mistake is refused with all of them.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn read(&self) -> Result<Catalogue, Failure> {
        let mut catalogue = Catalogue::standard();
        for file in &self.files {
            let text = read_input_text(file).map_err(|e| Failure::at(file, &e))?;
            let source = Source::new(file.display().to_string(), text);
            let (own, findings) = Catalogue::read(&source);
            if findings.iter().any(Diagnostic::is_error) {
                return Err(invalid(&source, findings));
            }
            catalogue.extend(own);
        }
        Ok(catalogue)
    }
}

/// What is wrong with a text.
pub fn invalid(source: &Source, diagnostics: Vec<Diagnostic>) -> Failure {
    Failure::Model(Box::new(ModelError::Invalid { text: source.clone(), diagnostics }))
}

/// A line for each effect that fits anywhere, with its places below.
pub fn as_text(catalogue: &Catalogue, places: &Places, colour: bool) -> String {
    let mut text = String::new();
    let (bold, plain) = if colour { ("\x1b[1m", "\x1b[0m") } else { ("", "") };
    for effect in catalogue.effects() {
        let signature = effect.signature();
        let list: Vec<_> = places.candidates.iter().filter(|c| c.effect().signature() == signature).collect();
        let kind = word(effect.kind());
        let _ = writeln!(text, "{bold}{signature}{plain}  {kind}  {}", effect.doc());
        if list.is_empty() {
            text.push_str("    fits nowhere in this model\n");
        }
        for line in list.chunks(6) {
            let shown: Vec<_> = line.iter().map(ToString::to_string).collect();
            let _ = writeln!(text, "    {}", shown.join("  "));
        }
    }
    for crowded in &places.crowded {
        let _ = writeln!(text, "{crowded}");
    }
    for untried in &places.untried {
        let _ = writeln!(text, "{untried}");
    }
    let _ = writeln!(text, "{} places", places.candidates.len());
    text
}

fn word(kind: Kind) -> &'static str {
    match kind {
        Kind::Smooth => "smooth",
        Kind::Finite => "finite",
        Kind::Variance => "noise",
    }
}

/// Effects that are written into a model.
#[derive(Debug, Args)]
pub struct Extend {
    /// Model file (.fdm)
    #[arg(value_name = "MODEL")]
    pub model: PathBuf,
    /// An effect at its place, such as `input_delay(stick)`; several are applied one after the other
    #[arg(long = "effect", value_name = "EFFECT", required = true)]
    effect: Vec<String>,
    #[command(flatten)]
    effects: Effects,
    /// A record whose times say interval and length
    #[arg(long, value_name = "RUN")]
    data: Option<PathBuf>,
    /// Sampling interval of the records; start values and bounds of lags and delays follow from it [default: that of --data, or 0.01]
    #[arg(long, value_parser = number, value_name = "TIME")]
    step: Option<f64>,
    /// Length of the records [default: that of --data, or 10]
    #[arg(long, value_parser = number, value_name = "TIME")]
    duration: Option<f64>,
}

/// How records are sampled; signals are of size 1.
#[derive(Debug, Clone, Copy)]
pub struct Sampling {
    /// Time between samples.
    pub step: f64,
    /// Length of the longest run.
    pub duration: f64,
}

impl Sampling {
    /// That of the longest of runs.
    pub fn of(runs: &[Run]) -> Self {
        Self::of_times(runs.iter().map(|run| &run.time[..]))
    }

    fn of_times<'t>(times: impl Iterator<Item = &'t [f64]> + Clone) -> Self {
        let span = |time: &[f64]| time.last().zip(time.first()).map_or(0.0, |(end, begin)| end - begin);
        let duration = times.clone().map(span).fold(0.0, f64::max);
        let step = times.map(|time| span(time) / time.len().saturating_sub(1).max(1) as f64).fold(0.0, f64::max);
        let positive = |v: f64, otherwise: f64| if v > 0.0 && v.is_finite() { v } else { otherwise };
        Self { step: positive(step, 0.01), duration: positive(duration, 10.0) }
    }
}

impl Scales for Sampling {
    fn size(&self, signal: &str, q: f64) -> f64 {
        Nominal.size(signal, q)
    }

    fn speed(&self, signal: &str, q: f64) -> f64 {
        Nominal.speed(signal, q)
    }

    fn level(&self, signal: &str, q: f64) -> f64 {
        Nominal.level(signal, q)
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

impl Extend {
    /// A model with the effects in it.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn applied(&self, at: Subject) -> Result<Subject, Failure> {
        let positive = |v: f64| v > 0.0 && v.is_finite();
        let seen = self.data.as_deref().map(|path| times(path, &at)).transpose()?;
        let seen =
            seen.map_or(Sampling { step: 0.01, duration: 10.0 }, |time| Sampling::of_times([&time[..]].into_iter()));
        let (step, duration) = (self.step.unwrap_or(seen.step), self.duration.unwrap_or(seen.duration));
        if !positive(step) || !positive(duration) {
            return Err(Failure::input(["`--step` and `--duration` must be above zero"]));
        }
        with_effects(at, &self.effect, &self.effects.read()?, Sampling { step, duration })
    }
}

/// The times of the longest table of a record, in the unit of the model.
fn times(path: &Path, at: &Subject) -> Result<Vec<f64>, Failure> {
    let (log, _) = open_log(path, false, None).map_err(|e| Failure::Records(vec![e]))?;
    let longest = log.topics.iter().filter_map(Topic::seconds).max_by_key(Vec::len);
    let Some(seconds) = longest else {
        return Err(Failure::input([format!(
            "{}: no column holds the time; say --step and --duration",
            path.display()
        )]));
    };
    let compiled = fdm_grammar::compile(at.source()).map_err(|f| invalid(at.source(), f))?;
    let unit = compiled.model.time.factor;
    Ok(seconds.into_iter().map(|t| t / unit).collect())
}

/// A model with effects in it, one after the other.
///
/// # Errors
/// [`Failure`]
pub fn with_effects(
    mut at: Subject,
    wanted: &[String],
    catalogue: &Catalogue,
    sampling: Sampling,
) -> Result<Subject, Failure> {
    for wanted in wanted {
        let places = catalogue.places(&at);
        let candidate = places.find(wanted).ok_or_else(|| nowhere(wanted, &places))?;
        let extension =
            candidate.apply(&at, &sampling, &Choice::new()).map_err(|d| Failure::input([d.message.clone()]))?;
        let compiled = fdm_grammar::compile(extension.source()).map_err(|f| invalid(extension.source(), f))?;
        at = Subject::new(extension.source(), &compiled.model).map_err(|f| invalid(extension.source(), f))?;
    }
    Ok(at)
}

/// What changes in the text of a model.
pub fn difference(old: &str, new: &str, model: &Path) -> String {
    let name = model.display().to_string();
    TextDiff::from_lines(old, new).unified_diff().context_radius(1).header(&name, "extended").to_string()
}

fn nowhere(wanted: &str, places: &Places) -> Failure {
    let all: Vec<String> = places.candidates.iter().map(ToString::to_string).collect();
    let name = wanted.split('(').next().unwrap_or("").trim();
    let same: Vec<&String> = all.iter().filter(|c| c.split('(').next() == Some(name)).collect();
    let near = did_you_mean(wanted, all.iter().map(String::as_str));
    let hint = match same.is_empty() {
        _ if !near.is_empty() => near,
        true => "; `fdm effects MODEL` lists the effects that fit".into(),
        false => {
            let shown: Vec<_> = same.iter().take(8).map(|c| format!("`{c}`")).collect();
            format!("; `{name}` fits as {}", shown.join(", "))
        }
    };
    Failure::input([format!("`{wanted}` fits nowhere in this model{hint}")])
}
