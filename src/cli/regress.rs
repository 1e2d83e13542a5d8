//! `fdm regress` and `fdm fit --method equation-error`: regression of measured rates, in the time domain or, with a band, in the
//! frequency domain; recursively with forgetting; and the search for the structure of a rate.

use crate::deliver::{Delivery, Outcome, Output, Places, Prepared, prepare, write};
use crate::failure::{Ending, Failure, OrFailure, ended, remark};
use crate::halt::{TimeLimit, in_time_or};
use crate::load::{Campaign, Estimated, ModelFile, Records, band, number};
use crate::methods::given;
use clap::{Args, ValueEnum};
use fdm_estimate::equation_error::{
    Components, Dependence, Detrend, Domain, Limits, Preprocessing, RecursiveOptions, RegressionError,
    RegressionOptions, Smoothing, by_cutoff, by_length, regress, structure,
};
use fdm_estimate::{BestOptions, Changes, Criterion, Halt, Noise, best_iterate, changed};
use fdm_report::{
    dependence_table, recursive_histories, recursive_table, recursive_times, regression_table, structure_table, svg,
};
use fdm_results::documents::{RecursiveDocument, RegressionDocument, ResultDocument, StructureDocument};
use fdm_results::store::{Identity, Manifest};
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::spectrum::Frequencies;
use std::path::PathBuf;

/// What `fdm regress` takes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    model: ModelFile,
    #[command(flatten)]
    records: Records,
    #[command(flatten)]
    estimated: Estimated,
    /// Frequency domain: compare Fourier transforms in this band, in cycles per unit of time
    #[arg(long, value_name = "LO:HI", value_parser = band, help_heading = "Regression")]
    band: Option<(f64, f64)>,
    /// Frequency spacing [default: the record's own bins]
    #[arg(long, value_parser = number, value_name = "STEP", requires = "band", help_heading = "Regression", hide_short_help = true)]
    df: Option<f64>,
    /// Rates in the time domain: `local`, `fourier`
    ///
    /// Or `local:POINTS` (a polynomial through so many neighbours), `fourier` (optimal Fourier smoothing), or `fourier:CUTOFF`.
    #[arg(long, value_name = "HOW", default_value = "local", value_parser = smoothing, conflicts_with = "band", help_heading = "Regression")]
    smooth: Smoothing,
    /// Remove `none`, the `mean` or the linear trend (`line`) of rates and regressors of every run
    #[arg(long, value_name = "WHAT", default_value = "none", value_parser = detrend, conflicts_with = "band", help_heading = "Regression", hide_short_help = true)]
    detrend: Detrend,
    /// Principal components of the solution: `auto` leaves out collinear directions, `level` stops where R^2 levels off and errors
    /// are least; or their number
    #[arg(long, value_name = "auto|level|K", default_value = "auto", value_parser = components, help_heading = "Regression", hide_short_help = true)]
    components: Components,
    /// Search the structure of every measured rate by stepwise regression among signals, squares and products
    #[arg(long, help_heading = "Regression")]
    stepwise: bool,
    #[command(flatten)]
    recursive: Recursive,
    /// Show how the estimates depend on the highest frequency, and on the part of the records that is used
    #[arg(long, conflicts_with = "stepwise", help_heading = "Result", hide_short_help = true)]
    dependence: bool,
    #[command(flatten)]
    limit: TimeLimit,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    places: Places,
}

/// Recursive least squares, and which of its iterates is taken.
#[derive(Debug, Args)]
#[command(next_help_heading = "Recursive least squares")]
struct Recursive {
    /// Recursive least squares, sample by sample
    ///
    /// With forgetting, instead of all samples at once.
    #[arg(long)]
    recursive: bool,
    /// Forgetting factor: weight of a sample relative to the one after it, above 0, at most 1 [default: 0.99]
    #[arg(long, value_parser = number, value_name = "G", allow_negative_numbers = true, hide_short_help = true)]
    forgetting: Option<f64>,
    /// Zero-phase low-pass of all channels, with this cut-off frequency, in cycles per unit of time
    #[arg(long, value_parser = number, value_name = "F", allow_negative_numbers = true, hide_short_help = true)]
    lowpass: Option<f64>,
    /// Smooth all channels by polynomials of degree four through so many neighbours
    #[arg(long, value_name = "POINTS", hide_short_help = true)]
    polynomial: Option<usize>,
    /// Which iterate is taken [default: simulation]
    #[arg(long, value_name = "CRITERION", value_enum, hide_short_help = true)]
    best: Option<Best>,
    /// Simulate segments of this length, each from initial values of its own: for unstable vehicles
    #[arg(long, value_parser = number, value_name = "LENGTH", allow_negative_numbers = true, hide_short_help = true)]
    restart: Option<f64>,
    /// Draw the estimates along the record to an SVG file
    #[arg(long, value_name = "FILE.svg", hide_short_help = true)]
    plot: Option<PathBuf>,
}

/// What `--best` takes.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Best {
    /// The least error of a simulation of the whole record
    Simulation,
    /// The least one-step prediction error
    OneStep,
    /// The last one
    Last,
}

impl Recursive {
    fn given(&self) -> Vec<&'static str> {
        given(&[
            ("--forgetting", self.forgetting.is_some()),
            ("--lowpass", self.lowpass.is_some()),
            ("--polynomial", self.polynomial.is_some()),
            ("--best", self.best.is_some()),
            ("--restart", self.restart.is_some()),
            ("--plot", self.plot.is_some()),
        ])
    }

    fn options(&self, detrend: Detrend) -> BestOptions {
        let preprocessing = Preprocessing { cutoff: self.lowpass, detrend, points: self.polynomial };
        let forgetting = self.forgetting.unwrap_or(RecursiveOptions::default().forgetting);
        let criterion = match self.best {
            None | Some(Best::Simulation) => Criterion::Simulation,
            Some(Best::OneStep) => Criterion::OneStep,
            Some(Best::Last) => Criterion::Last,
        };
        BestOptions { recursion: RecursiveOptions { forgetting, preprocessing }, criterion, restart: self.restart }
    }

    /// Follows the parameters along the record, and prints the best iterate.
    fn run(&self, model: &Model, runs: &[Run], detrend: Detrend, output: &Output) -> Ending {
        let found = best_iterate(model, runs, &self.options(detrend)).or_failure()?;
        let printed = output.print(|| recursive_table(&found), || RecursiveDocument::of(&found))?;
        if let Some(path) = &self.plot {
            let time = recursive_times(&found);
            write(path, svg(&recursive_histories(&found, &time)))?;
        }
        if found.is_undetermined() {
            remark(format_args!("{UNDETERMINED}"));
        }
        ended(printed && !found.is_undetermined())
    }
}

/// What is said where no parameter was determined.
const UNDETERMINED: &str = "nothing was determined: what the parameters multiply, or the rates that they explain, is zero in all of these \
                            records, or no two neighbouring samples have all values; use records in which inputs and states move";

/// Parts of the band and of the records that `--dependence` shows.
const PARTS: [f64; 5] = [0.2, 0.4, 0.6, 0.8, 1.0];

impl Arguments {
    /// Options that would be ignored are refused.
    fn refuse(&self) -> Result<(), Failure> {
        let places = [("--out", self.places.out.is_some()), ("--report", self.places.report.is_some())];
        let (refused, against, instead) = if self.recursive.recursive {
            let batch = [
                ("--band", self.band.is_some()),
                ("--df", self.df.is_some()),
                ("--smooth", self.smooth != Smoothing::default()),
                ("--components", self.components != Components::default()),
                ("--stepwise", self.stepwise),
                ("--dependence", self.dependence),
            ];
            ([given(&batch), given(&places)].concat(), "--recursive", "leave out --recursive")
        } else if self.stepwise {
            ([self.recursive.given(), given(&places)].concat(), "--stepwise", "leave out --stepwise")
        } else {
            (self.recursive.given(), "least squares of all samples at once", "use --recursive")
        };
        match &refused[..] {
            [] => Ok(()),
            _ => Err(Failure::input([format!(
                "{} cannot be combined with {against}: leave it out, or {instead}",
                refused.join(", ")
            )])),
        }
    }

    fn options(&self) -> RegressionOptions {
        let domain = match (self.band, self.df) {
            (None, _) => Domain::Time,
            (Some((low, high)), None) => {
                Domain::Frequency(Frequencies::Grid { lowest: Some(low), highest: Some(high) })
            }
            (Some((lowest, highest)), spacing) => Domain::Frequency(Frequencies::Band { lowest, highest, spacing }),
        };
        RegressionOptions { domain, smoothing: self.smooth, detrend: self.detrend, components: self.components }
    }
}

/// A model with its changes, and the runs; both are ready for a regression.
fn loaded(model: &ModelFile, changes: &Changes, records: &Records, quiet: bool) -> Result<(Model, Campaign), Failure> {
    let model = changed(&model.load_for(records)?, changes).or_failure()?;
    records.refuse_begin(&model)?;
    let campaign = records.read(&model, quiet)?;
    Ok((model, campaign))
}

pub(crate) fn run(arguments: &Arguments) -> Ending {
    arguments.refuse()?;
    let halt = Halt::default().at(arguments.limit.deadline());
    let (records, output) = (&arguments.records, &arguments.output);
    let changes = arguments.model.changes(&arguments.estimated);
    let (model, campaign) = loaded(&arguments.model, &changes, records, output.manner.quiet)?;
    let runs = &campaign.runs[..];
    if arguments.recursive.recursive {
        return arguments.recursive.run(&model, runs, arguments.detrend, output);
    }
    let options = arguments.options();
    if arguments.stepwise {
        let found = structure(&model, runs, &options, &Limits::default()).or_failure()?;
        let document = || StructureDocument { model: model.name().into(), structures: found.clone() };
        return ended(output.print(|| structure_table(&found), document)?);
    }
    // places that cannot be written are told before the work
    let prepared = prepare(output, None, &arguments.places, (&model, runs))?;
    let (mut text, mut document, determined) = estimates(&model, runs, &options).or_failure()?;
    document.records.clone_from(&campaign.judged);
    if arguments.dependence && halt.goes_on() {
        let (low, high) = arguments.band.unwrap_or_else(|| (0.0, nyquist(runs) / 4.0));
        let cutoffs = PARTS.map(|part| low + part * (high - low));
        let cutoff: Vec<Dependence> = by_cutoff(&model, runs, &options, &cutoffs);
        let length: Vec<Dependence> = by_length(&model, runs, &options, &PARTS);
        text.push_str(&format!("\n{}\n{}", dependence_table("highest", &cutoff), dependence_table("part", &length)));
        document = document.with_dependence(cutoff, length);
    }
    let ending = deliver(&prepared, &model, &campaign, &options, (text, document.into()), determined)?;
    if in_time_or(&halt, "the result is the best so far") { Ok(ending) } else { ended(false) }
}

/// `fdm fit --method equation-error`: all samples at once, in the time domain or at these frequencies.
pub(crate) fn equation_error(
    (model, estimated, records): (&ModelFile, &Estimated, &Records),
    delivery: &Delivery,
    frequencies: Option<Frequencies>,
) -> Ending {
    let (model, campaign) = loaded(model, &model.changes(estimated), records, delivery.output.manner.quiet)?;
    let options = at_once(frequencies);
    let prepared = delivery.prepare(&model, &campaign.runs)?;
    let (text, mut document, determined) = estimates(&model, &campaign.runs, &options).or_failure()?;
    document.records.clone_from(&campaign.judged);
    deliver(&prepared, &model, &campaign, &options, (text, document.into()), determined)
}

/// The options of `fdm fit --method equation-error`.
pub(crate) fn at_once(frequencies: Option<Frequencies>) -> RegressionOptions {
    RegressionOptions { domain: frequencies.map_or(Domain::Time, Domain::Frequency), ..RegressionOptions::default() }
}

/// Tables, the same for programs, and whether a parameter was determined.
pub(crate) fn estimates(
    model: &Model,
    runs: &[Run],
    options: &RegressionOptions,
) -> Result<(String, RegressionDocument, bool), RegressionError> {
    let found = regress(model, runs, options)?;
    let document = RegressionDocument::of(model.name(), &found);
    Ok((regression_table(&document), document, !found.is_undetermined()))
}

fn deliver(
    prepared: &Prepared<'_>,
    model: &Model,
    campaign: &Campaign,
    options: &RegressionOptions,
    (text, json): (String, ResultDocument),
    determined: bool,
) -> Ending {
    let runs = &campaign.runs[..];
    let manifest = prepared.manifest(model, Identity::of(model, runs, options), Noise::Diagonal, campaign);
    ended(prepared.deliver(outcome(model, runs, (text, json, determined), manifest)) && determined)
}

/// What is printed and written of regressions.
pub(crate) fn outcome<'a>(
    model: &'a Model,
    runs: &'a [Run],
    (text, json, determined): (String, ResultDocument, bool),
    manifest: Manifest,
) -> Outcome<'a> {
    let remarks = if determined { Vec::new() } else { vec![UNDETERMINED.to_string()] };
    let (spectra, tables) = (Vec::new(), Vec::new());
    Outcome { model, fit: None, runs, spectra, tables, bands: Vec::new(), text, whole: None, json, remarks, manifest }
}

/// Half the mean sampling rate of the slowest record.
fn nyquist(runs: &[Run]) -> f64 {
    let rate = |run: &Run| 0.5 * (run.len() as f64 - 1.0) / (run.time[run.len() - 1] - run.time[0]);
    runs.iter().filter(|r| r.len() > 1).map(rate).fold(f64::INFINITY, f64::min)
}

fn smoothing(text: &str) -> Result<Smoothing, String> {
    match text.split_once(':') {
        None if text == "local" => Ok(Smoothing::default()),
        None if text == "fourier" => Ok(Smoothing::Optimal),
        Some(("local", points)) => {
            let points = points.trim().parse().map_err(|_| format!("`{points}` is not a number of samples"))?;
            Ok(Smoothing::Local { points })
        }
        Some(("fourier", cutoff)) => Ok(Smoothing::Fixed { cutoff: number(cutoff)? }),
        _ => Err("expected local, local:POINTS, fourier or fourier:CUTOFF".into()),
    }
}

fn detrend(text: &str) -> Result<Detrend, String> {
    match text {
        "none" => Ok(Detrend::None),
        "mean" => Ok(Detrend::Mean),
        "line" => Ok(Detrend::Line),
        _ => Err("expected none, mean or line".into()),
    }
}

fn components(text: &str) -> Result<Components, String> {
    match text {
        "auto" => Ok(Components::Auto),
        "level" => Ok(Components::Levelled),
        _ => text
            .parse()
            .ok()
            .filter(|k| *k > 0)
            .map(Components::Count)
            .ok_or_else(|| "expected auto, level or a number from 1 on".into()),
    }
}
