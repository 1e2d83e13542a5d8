//! `fdm regress`: regression of measured rates, in the time domain or, with a band, in the frequency domain; recursively with forgetting;
//! and the search for the structure of a rate.

use crate::answer::{Answer, Wanted};
use crate::conduct::Conduct;
use crate::failure::{Failure, OrFailure};
use crate::halt::TimeLimit;
use crate::load::{Estimated, ModelFile};
use crate::methods::given;
use crate::outcome::{Outcome, names};
use crate::records::Records;
use crate::session::Session;
use crate::tables::course_tables;
use crate::value::{band, number};
use crate::verb::{Given, Verb};
use crate::word::one_of;
use clap::Args;
use fdm_estimate::equation_error::{
    Components, Dependence, Detrend, Domain, Limits, Preprocessing, RecursiveOptions, RegressionOptions, Search,
    Smoothing, by_cutoff, by_length, regress, structure,
};
use fdm_estimate::{BestOptions, Criterion, Noise, best_iterate, changed};
use fdm_report::{
    dependence_table, recursive_histories, recursive_table, recursive_times, regression_table, structure_table, svg,
};
use fdm_results::documents::{RecursiveDocument, RegressionDocument, StructureDocument};
use fdm_results::store::Identity;
use fdm_system::record::Run;
use fdm_system::spectrum::Frequencies;
use std::path::PathBuf;

/// What regressions work with.
#[derive(Debug, Args)]
pub struct Options {
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
    /// Search it among all products of up to so many signals, made orthogonal, by the predicted squared error
    #[arg(long, value_name = "ORDER", num_args = 0..=1, default_missing_value = "3", conflicts_with = "stepwise", value_parser = order, help_heading = "Regression", hide_short_help = true)]
    orthogonal: Option<usize>,
    /// Recursive least squares.
    #[command(flatten)]
    pub recursive: Recursive,
    /// Show how the estimates depend on the highest frequency, and on the part of the records that is used
    #[arg(long, conflicts_with_all = ["stepwise", "orthogonal"], help_heading = "Result", hide_short_help = true)]
    dependence: bool,
    #[command(flatten)]
    limit: TimeLimit,
}

/// Recursive least squares, and which of its iterates is taken.
#[derive(Debug, Args)]
#[command(next_help_heading = "Recursive least squares")]
pub struct Recursive {
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
    #[arg(long, value_name = "CRITERION", value_parser = one_of(&BEST), hide_short_help = true)]
    best: Option<Criterion>,
    /// Simulate segments of this length, each from initial values of its own: for unstable vehicles
    #[arg(long, value_parser = number, value_name = "LENGTH", allow_negative_numbers = true, hide_short_help = true)]
    restart: Option<f64>,
    /// Draw the estimates along the record to an SVG file
    #[arg(long, value_name = "FILE.svg", hide_short_help = true)]
    pub plot: Option<PathBuf>,
}

/// What `--best` takes.
const BEST: [(&str, Criterion, &str); 3] = [
    ("simulation", Criterion::Simulation, "The least error of a simulation of the whole record"),
    ("one-step", Criterion::OneStep, "The least one-step prediction error"),
    ("last", Criterion::Last, "The last one"),
];

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
        let criterion = self.best.unwrap_or_default();
        BestOptions { recursion: RecursiveOptions { forgetting, preprocessing }, criterion, restart: self.restart }
    }

    /// Follows the parameters along the record: the best iterate.
    fn answer(&self, session: &Session, detrend: Detrend, wanted: Wanted) -> Result<Answer, Failure> {
        let found = best_iterate(&session.model, &session.runs, &self.options(detrend)).or_failure()?;
        let answer = Answer::of(recursive_table(&found), &RecursiveDocument::of(&found), wanted)?;
        let drawn = || svg(&recursive_histories(&found, &recursive_times(&found)));
        let (plot, good) = (wanted.plot.then(drawn), !found.is_undetermined());
        let remarks = if good { Vec::new() } else { vec![UNDETERMINED.into()] };
        Ok(Answer { plot, remarks, good, ..answer })
    }
}

/// What is said where no parameter was determined.
pub(crate) const UNDETERMINED: &str = "nothing was determined: what the parameters multiply, or the rates that they explain, is zero in all of these \
                            records, or no two neighbouring samples have all values; use records in which inputs and states move";

/// Parts of the band and of the records that `--dependence` shows.
const PARTS: [f64; 5] = [0.2, 0.4, 0.6, 0.8, 1.0];

impl Verb for Options {
    fn given(&self) -> Given<'_> {
        Given { model: &self.model, records: &self.records, limit: &self.limit }
    }

    /// The model has the changes that were asked for.
    fn session(&self, conduct: &Conduct) -> Result<Session, Failure> {
        let changes = self.model.changes(&self.estimated);
        let model = changed(&self.model.load_for(&self.records)?, &changes).or_failure()?;
        self.records.refuse_begin(&model)?;
        self.records.session(model, conduct.quiet)?.refuse_censored("equation error")
    }

    fn names(&self, session: &Session) -> Vec<String> {
        names(&session.model, &session.runs)
    }

    fn answer(&self, session: &Session, conduct: &mut Conduct) -> Result<Answer, Failure> {
        if self.recursive.recursive {
            return self.recursive.answer(session, self.detrend, conduct.wanted);
        }
        if let Some(search) = self.search() {
            let found = structure(&session.model, &session.runs, &self.options(), &search).or_failure()?;
            let (text, model) = (structure_table(&found), session.model.name().into());
            return Answer::of(text, &StructureDocument { model, structures: found }, conduct.wanted);
        }
        self.at_once(session, conduct)
    }
}

impl Options {
    /// All samples at once.
    fn at_once(&self, session: &Session, conduct: &Conduct) -> Result<Answer, Failure> {
        let (model, runs, options) = (&session.model, &session.runs, self.options());
        let found = regress(model, runs, &options).or_failure()?;
        let mut document = RegressionDocument::of(model, runs, &found);
        let mut text = regression_table(&document);
        document.records.clone_from(&session.judged);
        let halt = conduct.progress.halt();
        if self.dependence && halt.goes_on() {
            let (low, high) = self.band.unwrap_or_else(|| (0.0, nyquist(runs) / 4.0));
            let cutoffs = PARTS.map(|part| low + part * (high - low));
            let cutoff: Vec<Dependence> = by_cutoff(model, runs, &options, &cutoffs);
            let length: Vec<Dependence> = by_length(model, runs, &options, &PARTS);
            text.push_str(&format!(
                "\n{}\n{}",
                dependence_table("highest", &cutoff),
                dependence_table("part", &length)
            ));
            document = document.with_dependence(cutoff, length);
        }
        let good = !found.is_undetermined();
        let manifest = session.manifest(Identity::of(model, runs, &options), Noise::Diagonal, conduct.wanted);
        let outcome = Outcome::new((model, runs), text, document.into(), manifest);
        let remarks = if good { Vec::new() } else { vec![UNDETERMINED.into()] };
        let outcome = Outcome { remarks, tables: course_tables(model, runs, &found), ..outcome };
        let answer = Answer { good, ..outcome.answer(conduct.wanted)? };
        Ok(conduct.in_time(answer, "the result is the best so far"))
    }

    /// Options that would be ignored are refused, those of the `places` of its result too.
    ///
    /// # Errors
    /// [`Failure::Input`]
    pub fn refuse(&self, places: Vec<&'static str>) -> Result<(), Failure> {
        let (refused, against, instead) = if self.recursive.recursive {
            let batch = [
                ("--band", self.band.is_some()),
                ("--df", self.df.is_some()),
                ("--smooth", self.smooth != Smoothing::default()),
                ("--components", self.components != Components::default()),
                ("--stepwise", self.stepwise),
                ("--orthogonal", self.orthogonal.is_some()),
                ("--dependence", self.dependence),
            ];
            ([given(&batch), places].concat(), "--recursive", "leave out --recursive")
        } else if self.stepwise {
            ([self.recursive.given(), places].concat(), "--stepwise", "leave out --stepwise")
        } else if self.orthogonal.is_some() {
            ([self.recursive.given(), places].concat(), "--orthogonal", "leave out --orthogonal")
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

    /// The search for a structure that was asked for.
    fn search(&self) -> Option<Search> {
        let stepwise = self.stepwise.then(|| Search::Stepwise(Limits::default()));
        stepwise.or_else(|| self.orthogonal.map(|order| Search::Orthogonal { order }))
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

fn order(text: &str) -> Result<usize, String> {
    let found = text.parse().ok().filter(|order| (1..=5).contains(order));
    found.ok_or_else(|| "expected the number of signals in a product: 1, 2, 3, 4 or 5".into())
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
