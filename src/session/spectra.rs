//! `fdm spectra`: frequency responses estimated from records alone; the model only names the channels.

use crate::answer::{Answer, Wanted};
use crate::campaign::Role;
use crate::failure::{Failure, OrFailure};
use crate::load::load_model;
use crate::records::{Records, read_records, say_notes};
use crate::session::{Record, Session};
use crate::value::{band, number};
use clap::Args;
use fdm_report::page::responses_page;
use fdm_report::{response_svg, response_table};
use fdm_results::documents::{ResponseNames, SpectraDocument};
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::spectrum::{Frequencies, FrequencyResponseEstimate, SpectrumError, SpectrumOptions, Window};
use std::path::PathBuf;

/// What frequency responses are estimated with.
#[derive(Debug, Args)]
pub struct Options {
    /// Model file (.fdm), which says what the channels are called
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    /// The records.
    #[command(flatten)]
    pub records: Records,
    /// Inputs; the response to each is conditioned on the others [default: all]
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', help_heading = "Frequency responses")]
    inputs: Vec<String>,
    /// Outputs [default: all]
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', help_heading = "Frequency responses")]
    outputs: Vec<String>,
    /// Frequencies from LO to HI, in cycles per unit of time [default: two cycles in a segment to a quarter of the sampling rate]
    #[arg(long, value_name = "LO:HI", value_parser = band, help_heading = "Frequency responses")]
    band: Option<(f64, f64)>,
    /// Frequency spacing [default: one cycle in a segment]
    #[arg(long, value_parser = number, value_name = "STEP", requires = "band", help_heading = "Frequency responses")]
    df: Option<f64>,
    /// Length of the averaged segments (windows); several are combined to a composite response [default: a fifth of the record]
    #[arg(long, value_parser = number, value_name = "TIME", help_heading = "Frequency responses")]
    segment: Vec<f64>,
    /// Overlap of neighbouring segments, as a fraction
    #[arg(long, value_parser = number, value_name = "PART", default_value_t = 0.5, help_heading = "Frequency responses")]
    overlap: f64,
}

/// Segments in a record when nothing else is asked for.
const SEGMENTS: f64 = 5.0;

/// Estimates the frequency responses of the runs of a session; their page is the file `page.html`.
///
/// # Errors
/// [`Failure`]
pub fn answer(asked: &Options, session: &Session, wanted: Wanted) -> Result<Answer, Failure> {
    let Channels { inputs, outputs } = asked.channels(&session.model)?;
    let runs: Vec<Run> = session.runs.iter().map(|run| run.with_channels(&inputs, &outputs)).collect();
    let names = names(&session.model, &inputs, &outputs);
    let found = asked.estimate(&runs, &names)?;
    let answer = Answer::of(response_table(&found, &names), &SpectraDocument::of(&found, &names), wanted)?;
    let page = || ("page.html".to_string(), responses_page(session.model.name(), &found, &names).into_bytes());
    let files = wanted.files.then(page).into_iter().collect();
    Ok(Answer { plot: wanted.plot.then(|| response_svg(&found, &names)), files, ..answer })
}

/// The numbers of the channels that were asked for; of all when none was.
fn chosen(wanted: &[String], all: Vec<&str>, role: &str) -> Result<Vec<usize>, Failure> {
    if all.is_empty() {
        return Err(Failure::input([format!("the model has no {role}, so that there is no frequency response")]));
    }
    if wanted.is_empty() {
        return Ok((0..all.len()).collect());
    }
    let place = |name: &String| {
        let unknown = || format!("the model has no {role} `{name}`; it has {}", all.join(", "));
        all.iter().position(|n| n == name).ok_or_else(unknown)
    };
    wanted.iter().map(place).collect::<Result<_, _>>().or_failure()
}

fn names(model: &Model, inputs: &[usize], outputs: &[usize]) -> ResponseNames {
    let definition = model.definition();
    let time = definition.time.to_string();
    ResponseNames {
        inputs: inputs.iter().map(|i| definition.inputs[*i].quantity.name.clone()).collect(),
        outputs: outputs.iter().map(|o| definition.outputs[*o].quantity.name.clone()).collect(),
        frequency: if time == "s" { "Hz".into() } else { format!("1/{time}") },
    }
}

/// The numbers of those channels whose responses are estimated.
struct Channels {
    inputs: Vec<usize>,
    outputs: Vec<usize>,
}

impl Options {
    /// The model and the runs that are named.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn session(&self, quiet: bool) -> Result<Session, Failure> {
        let model = self.records.grouped(&load_model(&self.model)?)?;
        self.channels(&model)?;
        let files = self.records.files(Role::Fit, &self.records.selection.options(false), &model)?;
        self.records.say_left(&model, quiet)?;
        let read = read_records(&files, &model, &[])?;
        if !quiet {
            say_notes(&read);
        }
        let limited = read.iter().find(|((_, summary), _)| !summary.censored.is_empty());
        if let Some(((run, _), _)) = limited {
            return Err(Failure::input([format!(
                "run `{}` has samples below a limit, of which there are no spectra; --below-limit missing leaves them out",
                run.name
            )]));
        }
        let runs: Vec<Run> = read.into_iter().map(|((run, _), _)| run).collect();
        self.records.refuse(&model, runs.iter())?;
        Ok(Session::new(model, runs.into_iter().map(Record::in_memory).collect(), Vec::new()))
    }

    fn channels(&self, model: &Model) -> Result<Channels, Failure> {
        let definition = model.definition();
        let declared = definition.inputs.iter().filter(|i| i.is_declared()).map(|i| i.quantity.name.as_str()).collect();
        let shown = definition.outputs.iter().map(|o| o.quantity.name.as_str()).collect();
        let inputs = chosen(&self.inputs, declared, "input")?;
        let mut outputs = chosen(&self.outputs, shown, "output")?;
        let options = self.records.selection.options(false);
        outputs.retain(|o| !options.without.contains(&definition.outputs[*o].quantity.name));
        if outputs.is_empty() {
            return Err(Failure::input(["--without-output leaves no output"]));
        }
        Ok(Channels { inputs, outputs })
    }

    fn estimate(&self, runs: &[Run], names: &ResponseNames) -> Result<FrequencyResponseEstimate, Failure> {
        let duration = |run: &Run| run.time.last().copied().unwrap_or(0.0) - run.time.first().copied().unwrap_or(0.0);
        let shortest = runs.iter().map(duration).fold(f64::INFINITY, f64::min);
        let segments = if self.segment.is_empty() { vec![shortest / SEGMENTS] } else { self.segment.clone() };
        let longest = segments.iter().copied().fold(0.0, f64::max);
        let rate = |run: &Run| (run.len() as f64 - 1.0) / duration(run);
        let highest = runs.iter().map(rate).fold(f64::INFINITY, f64::min) / 4.0;
        let (lowest, highest) = self.band.unwrap_or((2.0 / longest, highest));
        let frequencies = Frequencies::Band { lowest, highest, spacing: self.df.or(Some(1.0 / longest)) };
        let options = SpectrumOptions {
            inputs: names.inputs.clone(),
            outputs: names.outputs.clone(),
            ..SpectrumOptions::default()
        };
        let found =
            FrequencyResponseEstimate::composite(runs, &frequencies, &segments, self.overlap, Window::Hann, &options);
        found.map_err(|error| {
            // the length was not typed: it follows from the shortest run
            let blamed = runs.iter().find(|run| duration(run) <= shortest);
            let blamed =
                blamed.filter(|_| self.segment.is_empty() && matches!(error, SpectrumError::ShortSegments { .. }));
            let why = blamed.map_or(String::new(), |run| {
                format!(
                    " (they are a fifth of the shortest run, or eight samples: run `{}` is {shortest} long)",
                    run.name
                )
            });
            Failure::input([format!("{error}{why}")])
        })
    }
}
