//! `fdm study`: a fit repeated with other noise, and whether what is printed beside its estimates holds.

use crate::delivery::{Delivery, Outcome};
use crate::failure::{Failure, NUMBERS, remark};
use crate::fit::title;
use crate::integrator::Integration;
use crate::noise::noise;
use crate::progress::Progress;
use crate::records::{Records, notes};
use crate::repetition::{Patience, Repetition};
use crate::subject::{Estimated, Subject};
use clap::Args;
use fdm::Model;
use fdm::estimate::{Fit, FitOptions, Options, fit};
use fdm::record::Run;
use fdm::report::{fit_json, fit_table, repeat_columns, study_json, study_table};
use fdm::store::{Identity, Manifest};
use fdm::study::{Bootstrap, Colour, Repeat, Study, StudyError, series};
use serde_json::{Value, json};
use std::process::ExitCode;
use std::sync::Arc;

/// What `fdm study` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    subject: Subject,
    #[command(flatten)]
    records: Records,
    #[command(flatten)]
    estimated: Estimated,
    /// Measurement noise, as `fdm fit` takes it
    #[arg(long, value_name = "diagonal|full|OUTPUT=DEVIATION", help_heading = "Estimation")]
    noise: Vec<String>,
    /// How often the fit is repeated
    #[arg(long, value_name = "N", default_value_t = 1000, help_heading = "Repeats",
          allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    repeats: u32,
    #[command(flatten)]
    repetition: Repetition,
    #[command(flatten)]
    integration: Integration,
    #[command(flatten)]
    delivery: Delivery,
}

/// What decides the numbers of the repeats, but not how many there are.
#[derive(Debug)]
#[expect(dead_code, reason = "printed")]
struct Studied<'a> {
    fit: &'a FitOptions,
    noise_colour: Colour,
    seed: u64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let quiet = arguments.delivery.quiet;
    let mut progress = Progress::new(quiet);
    let model = arguments.subject.load()?;
    let records = arguments.records.load(&model, true)?;
    if !quiet {
        notes(&records);
    }
    let runs: Vec<Run> = records.into_iter().map(|(run, _)| run).collect();
    let options = arguments.options(&model)?;
    let (colour, seed) = (arguments.colour()?, arguments.repetition.seed);
    let identity = Identity::of(&model, &runs, &Studied { fit: &options, noise_colour: colour, seed });
    // places that cannot be written are told before the work
    let prepared = arguments.delivery.prepare()?;
    let kept = arguments.repetition.keeping.open(&identity, quiet)?;
    let (live, course) = prepared.live(&model, arguments.repetition.keeping.folder(), &mut progress);
    let first = fit(&model, &runs, &options, &mut progress);
    progress.finish();
    let first = first.map_err(|e| Failure::input([e]))?;
    let bootstrap = match Bootstrap::new(&first, &runs, &options, (colour, seed)) {
        Ok(bootstrap) => bootstrap,
        Err(e) => return refused(&e),
    };
    let mut patience = Patience::new("", arguments.repeats as usize, quiet, progress.interrupted());
    if live.is_told() {
        let so_far = patience.remembering();
        let (name, subjects) = (model.name().to_string(), bootstrap.subjects().to_vec());
        let mut course = course.lock();
        course.doing = "the fit is repeated with other noise".into();
        course.more = Some(Arc::new(move || {
            let (repeats, left) = so_far.read();
            let study = Study::of(name.clone(), (Some(colour), seed), &subjects, &repeats);
            (json!({ "study": study_json(&study) }), left)
        }));
    }
    let once = |k: u64| bootstrap.once(k, &patience);
    let repeats = series(arguments.repeats as usize, kept.keeper(), &patience, &once);
    patience.finish();
    let study = Study::of(model.name(), (Some(colour), seed), bootstrap.subjects(), &repeats);

    let mut manifest = Manifest::new(&model, identity, options.options.noise.clone());
    (manifest.command, manifest.seed) = (std::env::args().collect(), Some(seed));
    if arguments.delivery.describes() {
        arguments.records.describe(&runs, &mut manifest);
    }
    let mut document = fit_json(&first);
    document["study"] = study_json(&study);
    let text = format!("{}\n\n{}", title(&first.model), study_table(&study));
    let outcome = Outcome {
        model: &first.model,
        fit: Some(&first),
        runs: &runs,
        spectra: Vec::new(),
        tables: tables(&first, &study, &bootstrap, &repeats),
        text,
        json: document,
        remarks: Vec::new(),
        manifest,
    };
    let delivered = prepared.deliver(outcome);
    let whole = kept.close();
    let good = study.is_whole() && study.converged > 0 && delivered && whole;
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::from(NUMBERS) })
}

impl Arguments {
    fn colour(&self) -> Result<Colour, Failure> {
        match self.repetition.colours()[..] {
            [] => Ok(Colour::default()),
            [colour] => Ok(colour),
            _ => {
                Err(Failure::input(["--noise-colour: a study of a fit has one colour; repeat the command for another"]))
            }
        }
    }

    fn options(&self, model: &Model) -> Result<FitOptions, Failure> {
        Ok(FitOptions {
            changes: self.subject.changes(&self.estimated),
            options: Options { noise: noise(&self.noise, model)?, ..Options::default() },
            per_interval: self.integration.per_interval(),
            scheme: self.integration.scheme(),
            ..FitOptions::default()
        })
    }
}

fn refused(e: &StudyError) -> Result<ExitCode, Failure> {
    if !e.is_of_numbers() {
        return Err(Failure::input([e]));
    }
    remark(format_args!("error: {e}"));
    Ok(ExitCode::from(NUMBERS))
}

/// Files of a folder: the study, the fit that was repeated, and every repeat.
fn tables(first: &Fit, study: &Study, bootstrap: &Bootstrap, repeats: &[Option<Repeat>]) -> Vec<(String, Vec<u8>)> {
    let columns = repeat_columns(bootstrap.subjects(), repeats);
    let cell = |v: f64| if v.is_nan() { String::new() } else { v.to_string() };
    let quoted = |name: &String| format!("\"{}\"", name.replace('"', "\"\""));
    let mut csv = columns.iter().map(|(name, _)| quoted(name)).collect::<Vec<_>>().join(",");
    for row in 0..columns.first().map_or(0, |(_, values)| values.len()) {
        csv.push('\n');
        csv.push_str(&columns.iter().map(|(_, values)| cell(values[row])).collect::<Vec<_>>().join(","));
    }
    csv.push('\n');
    let study: Value = study_json(study);
    vec![
        ("study.json".into(), format!("{study}\n").into_bytes()),
        ("fit.txt".into(), fit_table(first, false).into_bytes()),
        ("repeats.csv".into(), csv.into_bytes()),
    ]
}
