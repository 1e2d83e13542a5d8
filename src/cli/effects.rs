//! `fdm effects`: what may be missing from a model, and where.

use crate::failure::{Failure, in_colours, print};
use crate::subject::load_model;
use clap::Args;
use fdm::effect::{Catalogue, Kind, Places, Subject};
use fdm::{Model, ModelError};
use fdm_grammar::diagnostic::nearest;
use fdm_grammar::{Diagnostic, Source};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// The effects that are looked for.
#[derive(Debug, Args)]
pub(crate) struct Effects {
    /// Effects of your own (.fdm), beside those that are always there; one of the same name replaces them
    #[arg(long = "effects", value_name = "FILE")]
    files: Vec<PathBuf>,
}

/// Which of them are looked for.
#[derive(Debug, Args)]
pub(crate) struct Chosen {
    /// Look for these effects only, such as `input_delay,actuator_lag`
    #[arg(long, value_name = "NAMES", value_delimiter = ',', conflicts_with = "without")]
    only: Vec<String>,
    /// Look for all but these; a model with many states has hundreds of places for a `product_term`
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    without: Vec<String>,
}

impl Chosen {
    /// What is left of a catalogue; names that it does not have are refused.
    pub(crate) fn of(&self, mut catalogue: Catalogue) -> Result<Catalogue, Failure> {
        let names: BTreeSet<String> = catalogue.effects().map(|e| e.name().to_string()).collect();
        let unknown = |name: &&String| !names.contains(*name);
        let said = self.only.iter().chain(&self.without).filter(unknown).map(|name| {
            let near = nearest(name, names.iter().map(String::as_str));
            let near = near.map_or(String::new(), |near| format!("; did you mean `{near}`?"));
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
        Ok(catalogue)
    }
}

/// What `fdm effects` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Model file (.fdm)
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    #[command(flatten)]
    effects: Effects,
    #[command(flatten)]
    chosen: Chosen,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let catalogue = arguments.chosen.of(arguments.effects.read()?)?;
    let (_, subject) = subject(&arguments.model)?;
    let places = catalogue.places(&subject);
    let text =
        if arguments.json { format!("{}\n", as_json(&catalogue, &places)) } else { as_text(&catalogue, &places) };
    Ok(if print(&text) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Reads a model for effects.
pub(crate) fn subject(file: &Path) -> Result<(Model, Subject), Failure> {
    let model = load_model(file)?;
    let subject = Subject::new(model.source(), model.definition()).map_err(|f| invalid(model.source(), f))?;
    Ok((model, subject))
}

impl Effects {
    /// The catalogue; a file with a mistake is refused with all of them.
    pub(crate) fn read(&self) -> Result<Catalogue, Failure> {
        let mut catalogue = Catalogue::standard();
        for file in &self.files {
            let text = std::fs::read_to_string(file)
                .map_err(|e| Failure::input([format!("{}: {}", file.display(), fdm::store::reason(&e))]))?;
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

pub(crate) fn invalid(source: &Source, diagnostics: Vec<Diagnostic>) -> Failure {
    Failure::Model(Box::new(ModelError::Invalid { text: source.clone(), diagnostics }))
}

/// A line for each effect that fits anywhere, with its places below.
fn as_text(catalogue: &Catalogue, places: &Places) -> String {
    let mut text = String::new();
    let colour = in_colours(&std::io::stdout());
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
        let _ = writeln!(text, "`{}` fits more places than the {} that are tried", crowded.effect, crowded.limit);
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

fn as_json(catalogue: &Catalogue, places: &Places) -> Value {
    let effects = catalogue.effects().map(|e| {
        let slots: Vec<Value> = e
            .tree()
            .slots
            .iter()
            .map(|s| json!({ "name": s.name.text, "kinds": s.kinds.iter().map(|k| k.word()).collect::<Vec<_>>() }))
            .collect();
        json!({ "effect": e.name(), "doc": e.doc(), "kind": word(e.kind()), "slots": slots })
    });
    let candidates = places.candidates.iter().map(|c| {
        let kinds: Vec<_> = c.kinds().iter().map(|k| k.word()).collect();
        json!({ "effect": c.effect().name(), "targets": c.targets(), "kinds": kinds, "doc": c.doc() })
    });
    let crowded: BTreeMap<_, _> = places.crowded.iter().map(|c| (c.effect.clone(), c.limit)).collect();
    json!({
        "effects": effects.collect::<Vec<_>>(),
        "places": candidates.collect::<Vec<_>>(),
        "limited": crowded,
    })
}
