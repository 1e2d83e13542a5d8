//! How model and records are compared: method, domain, optimizer; and the one table of what can be combined.

use crate::failure::Failure;
use crate::value::number;
use crate::word::{one_of, word_of};
use clap::Args;
use fdm_estimate::{Domain, METHODS as RUNS, Method, Noise, Optimizer, Options, SmoothBy, StartValues, takes_option};

/// What `--method` takes.
const METHODS: [(&str, Method, &str); 4] = [
    (
        "output-error",
        Method::OutputError,
        "Maximum likelihood for measurement noise: simulated outputs against measured ones",
    ),
    (
        "filter-error",
        Method::FilterError,
        "Maximum likelihood for process noise too (turbulence), by a Kalman filter; declare it with `noise der(x) = q;`",
    ),
    (
        "equation-error",
        Method::EquationError,
        "Linear regression of measured rates; `fdm regress` has all of its options",
    ),
    (
        "frequency-response",
        Method::FrequencyResponse,
        "Least squares of magnitudes and phases of frequency responses, weighted by coherence",
    ),
];

/// What `--domain` takes.
pub(crate) const DOMAINS: [(&str, Domain, &str); 2] = [
    ("time", Domain::Time, "Samples in time"),
    ("frequency", Domain::Frequency, "Spectra of the records, at their frequency bins"),
];

/// What `--optimizer` takes.
const OPTIMIZERS: [(&str, Optimizer, &str); 3] = [
    ("gauss-newton", Optimizer::GaussNewton, "Damped Gauss-Newton steps"),
    ("nelder-mead", Optimizer::NelderMead, "The Nelder-Mead simplex, without derivatives; Gauss-Newton steps finish"),
    ("lbfgs", Optimizer::Lbfgs, "Limited-memory BFGS; Gauss-Newton steps finish"),
];

/// What `--start-values` takes.
const STARTS: [(&str, StartValues, &str); 2] = [
    ("model", StartValues::Model, "At the values of the model, and of `--set`"),
    (
        "equation-error",
        StartValues::EquationError,
        "At equation-error estimates: in the time domain, of all iterates of recursive least squares the one that simulates best",
    ),
];

/// Method, domain, optimizer, and the limits of the iteration.
#[derive(Debug, Args)]
#[command(next_help_heading = "Estimation")]
pub struct Methods {
    /// What is minimised
    #[arg(long, value_name = "METHOD", value_parser = one_of(&METHODS), default_value = "output-error")]
    method: Method,
    /// Where model and records are compared [default: time; frequency for frequency responses]
    #[arg(long, value_name = "DOMAIN", value_parser = one_of(&DOMAINS))]
    domain: Option<Domain>,
    /// How the minimum is found [default: gauss-newton]
    #[arg(long, value_name = "OPTIMIZER", value_parser = one_of(&OPTIMIZERS), hide_short_help = true)]
    optimizer: Option<Optimizer>,
    #[command(flatten)]
    start: Start,
    /// Most iterations, those of fallback strategies included; 0 judges the start values [default: 100 of each estimation]
    #[arg(long, value_name = "N", allow_negative_numbers = true, hide_short_help = true)]
    iterations: Option<usize>,
    /// Converged when every relative step is smaller than this
    #[arg(long, value_parser = number, value_name = "T", default_value = "1e-9", allow_negative_numbers = true, hide_short_help = true)]
    tolerance: f64,
    /// Factor on every step, above 0, at most 1; steps that are too long are damped anyway
    #[arg(long, value_parser = number, value_name = "G", default_value_t = 1.0, allow_negative_numbers = true, hide_short_help = true)]
    gain: f64,
    /// How the smoothness of tables (`smooth CL by order 2;`) is chosen: `likelihood`, `validation` (left-out runs are predicted), or a weight for each
    /// axis
    #[arg(long, value_name = "likelihood|validation|W1,..", value_parser = smooth_by, default_value = "likelihood", hide_short_help = true)]
    smooth_by: SmoothBy,
}

fn smooth_by(text: &str) -> Result<SmoothBy, String> {
    match text.trim() {
        "likelihood" => Ok(SmoothBy::Likelihood),
        "validation" => Ok(SmoothBy::Validation),
        weights => {
            let list: Result<Vec<f64>, String> = weights.split(',').map(number).collect();
            let list = list.map_err(|e| format!("{e}; expected `likelihood`, `validation` or weights above 0"))?;
            match list.iter().find(|w| w.is_nan() || **w <= 0.0) {
                Some(weight) => Err(format!("a weight is above 0, {weight} was given")),
                None => Ok(SmoothBy::Weights(list)),
            }
        }
    }
}

/// Where the iteration begins.
#[derive(Debug, Args)]
pub struct Start {
    /// Where the iteration begins [default: model; in the frequency domain equation-error]
    #[arg(long, value_name = "START", value_parser = one_of(&STARTS), hide_short_help = true)]
    pub(crate) start_values: Option<StartValues>,
}

impl Start {
    /// The options that were given.
    pub fn given(&self) -> Vec<&'static str> {
        given(&[("--start-values", self.start_values.is_some())])
    }
}

/// The names of those options that were given.
pub fn given(options: &[(&'static str, bool)]) -> Vec<&'static str> {
    options.iter().filter(|(_, given)| *given).map(|(name, _)| *name).collect()
}

/// One cell of the table: what is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Question {
    /// What is minimised.
    pub method: Method,
    /// Where model and records are compared.
    pub domain: Domain,
    /// How the minimum is found.
    pub optimizer: Optimizer,
}

impl Methods {
    /// What is asked for, unless it cannot be combined with itself or with the other options that were given.
    ///
    /// # Errors
    /// [`Failure`]
    pub fn question(&self, others: &[&'static str]) -> Result<Question, Failure> {
        let usual = if self.method == Method::FrequencyResponse { Domain::Frequency } else { Domain::Time };
        let question = Question {
            method: self.method,
            domain: self.domain.unwrap_or(usual),
            optimizer: self.optimizer.unwrap_or(Optimizer::GaussNewton),
        };
        let mut options = self.start.given();
        let iteration = [("--iterations", self.iterations.is_some()), ("--tolerance", self.tolerance != 1e-9)];
        options.extend(given(&iteration));
        options.extend(given(&[("--gain", self.gain != 1.0)]));
        options.extend(given(&[("--smooth-by", self.smooth_by != SmoothBy::Likelihood)]));
        options.extend(others);
        let refusals = question.refusals(&options);
        match &refusals[..] {
            [] => Ok(question),
            _ => Err(Failure::input(refusals.iter().map(|r| r.said(self.domain.is_some())))),
        }
    }

    /// Where the iteration begins, when that was said.
    pub fn start(&self) -> Option<StartValues> {
        self.start.start_values
    }

    /// The options of an estimation with this noise.
    pub fn options(&self, question: Question, noise: Noise) -> Options {
        let optimizer = question.optimizer;
        let (tolerance, gain, total) = (self.tolerance, self.gain, self.iterations);
        let iterations = total.unwrap_or(Options::default().iterations);
        let smooth_by = self.smooth_by.clone();
        Options { noise, iterations, total, tolerance, gain, optimizer, smooth_by, ..Options::default() }
    }
}

const Y: bool = true;
const N: bool = false;

/// Which options of the command alone have a part in which column of [`RUNS`]: output error in time and frequency, filter error, equation
/// error in time and frequency, frequency responses. Of all others the library knows it ([`takes_option`]); optimizers are among these.
const OPTIONS: [(&str, [bool; 6]); 11] = [
    ("--start-values", [Y, Y, Y, N, N, N]),
    ("--noise", [Y, Y, Y, N, N, N]),
    ("--checkpoint", [Y, N, N, N, N, N]),
    ("--df", [N, Y, N, N, Y, Y]),
    ("--validation", [Y, Y, Y, N, N, Y]),
    ("--intervals", [Y, Y, Y, N, N, Y]),
    ("--history", [Y, Y, Y, N, N, Y]),
    ("--watch", [Y, Y, Y, N, N, Y]),
    ("--plot", [Y, Y, Y, N, N, Y]),
    ("--out", [Y, Y, Y, Y, Y, Y]),
    ("--report", [Y, Y, Y, Y, Y, Y]),
];

/// Something that cannot be combined, and the nearest question that it can be combined with.
#[derive(Debug, PartialEq, Eq)]
struct Refusal {
    asked: Question,
    /// An option; none where the question itself is refused.
    option: Option<&'static str>,
    nearest: Question,
}

impl Question {
    /// All questions that can be asked, the usual ones first.
    fn all() -> impl Iterator<Item = Self> {
        let optimizers = [Optimizer::GaussNewton, Optimizer::NelderMead, Optimizer::Lbfgs];
        RUNS.into_iter()
            .flat_map(move |(method, domain)| optimizers.map(|optimizer| Self { method, domain, optimizer }))
            .filter(|q| q.takes(&optimizer_word(q.optimizer)))
    }

    /// Whether an option has a part in this question.
    fn takes(self, option: &str) -> bool {
        let Some(column) = RUNS.iter().position(|run| *run == (self.method, self.domain)) else { return false };
        let own = OPTIONS.iter().find(|(name, _)| *name == option).map(|(_, runs)| runs[column]);
        own.or_else(|| takes_option(option, self.method, self.domain)).unwrap_or(true)
    }

    /// How much a user has to change to ask another question: the method counts more than the rest.
    fn distance(self, other: Self) -> usize {
        3 * usize::from(self.method != other.method)
            + usize::from(self.domain != other.domain)
            + usize::from(self.optimizer != other.optimizer)
    }

    fn nearest(self, option: Option<&str>) -> Option<Self> {
        Self::all().filter(|q| option.is_none_or(|o| q.takes(o))).min_by_key(|q| self.distance(*q))
    }

    /// What cannot be combined: the question with itself, or else options with the question.
    fn refusals(self, options: &[&'static str]) -> Vec<Refusal> {
        if !Self::all().any(|q| q == self) {
            let nearest = self.nearest(None);
            return nearest.map(|nearest| Refusal { asked: self, option: None, nearest }).into_iter().collect();
        }
        let refused = options.iter().filter(|option| !self.takes(option));
        refused
            .filter_map(|option| {
                self.nearest(Some(option)).map(|nearest| Refusal { asked: self, option: Some(option), nearest })
            })
            .collect()
    }
}

impl Refusal {
    /// What is said; `domain_typed` where the domain was not left to the method.
    fn said(&self, domain_typed: bool) -> String {
        let (from, to) = (self.asked, self.nearest);
        let single = |method| RUNS.iter().filter(|(m, _)| *m == method).count() == 1;
        let (method, domain) = (from.method != to.method, from.domain != to.domain);
        // the method alone says where frequency responses and filters work
        let domain = domain && (!method || domain_typed || !single(to.method));
        let describe = |q: Question| {
            let mut words = Vec::new();
            if method {
                words.push(format!("--method {}", word_of(&METHODS, q.method)));
            }
            if domain {
                words.push(format!("--domain {}", word_of(&DOMAINS, q.domain)));
            }
            if from.optimizer != to.optimizer {
                words.push(optimizer_word(q.optimizer));
            }
            words.join(" ")
        };
        let (against, use_) = (describe(from), describe(to));
        match self.option {
            Some(option) => {
                // results of every method are validated by a command of its own
                let validate = match option {
                    "--validation" => " (or `fdm validate` with the result that `--out` writes)",
                    _ => "",
                };
                format!("{option} cannot be combined with {against}: leave it out, or use {use_}{validate}")
            }
            None => {
                let method = word_of(&METHODS, from.method);
                format!("{against} cannot be combined with --method {method}: use {use_}")
            }
        }
    }
}

/// `--optimizer` and its word.
fn optimizer_word(optimizer: Optimizer) -> String {
    format!("--optimizer {}", word_of(&OPTIMIZERS, optimizer))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every option of the command.
    fn options() -> impl Iterator<Item = &'static str> {
        OPTIONS.iter().map(|(name, _)| *name).chain(fdm_estimate::option_names())
    }

    fn questions() -> impl Iterator<Item = Question> {
        METHODS.into_iter().flat_map(|(_, method, _)| {
            DOMAINS.into_iter().flat_map(move |(_, domain, _)| {
                OPTIMIZERS.into_iter().map(move |(_, optimizer, _)| Question { method, domain, optimizer })
            })
        })
    }

    #[test]
    fn every_cell_runs_or_names_the_nearest_choice() {
        let (mut run, mut refused) = (0, 0);
        for question in questions() {
            for option in options().filter(|name| !name.starts_with("--optimizer")) {
                match &question.refusals(&[option])[..] {
                    [] => {
                        assert!(question.takes(option), "{question:?} {option}");
                        run += 1;
                    }
                    [refusal] => {
                        let (near, text) = (refusal.nearest, refusal.said(true));
                        // what is proposed runs, and names what it replaces
                        assert!(near.refusals(refusal.option.as_slice()).is_empty(), "{text}");
                        assert!(text.contains("cannot be combined with --") && text.contains("use --"), "{text}");
                        let whole = format!(
                            "--method {} --domain {} {}",
                            word_of(&METHODS, near.method),
                            word_of(&DOMAINS, near.domain),
                            optimizer_word(near.optimizer)
                        );
                        let proposed = text.split("use ").nth(1).unwrap();
                        let words = proposed.split(" (").next().unwrap().split(" --");
                        for word in words.map(|w| w.trim_start_matches("--")) {
                            assert!(whole.contains(word), "{text} / {whole}");
                        }
                        refused += 1;
                    }
                    more => panic!("{question:?} {option}: {more:?}"),
                }
            }
        }
        assert_eq!(run + refused, 24 * (options().count() - 3));
        assert_eq!(Question::all().count(), 12);
    }

    #[test]
    fn refusals_read_well() {
        let said = |method, domain, optimizer, option: &'static str| {
            let question = Question { method, domain, optimizer };
            question.refusals(&[option]).first().map_or(String::new(), |r| r.said(false))
        };
        use {Domain::*, Method::*, Optimizer::*};
        let all = [
            said(OutputError, Time, GaussNewton, "--coherence"),
            said(OutputError, Frequency, GaussNewton, "--shooting"),
            said(FilterError, Frequency, GaussNewton, "--steps"),
            said(FilterError, Time, Lbfgs, "--steps"),
            said(EquationError, Time, GaussNewton, "--validation"),
        ];
        let expected = [
            "--coherence cannot be combined with --method output-error: leave it out, or use --method frequency-response",
            "--shooting cannot be combined with --domain frequency: leave it out, or use --domain time",
            "--domain frequency cannot be combined with --method filter-error: use --domain time",
            "--optimizer lbfgs cannot be combined with --method filter-error: use --optimizer gauss-newton",
            "--validation cannot be combined with --method equation-error: leave it out, or use --method output-error \
             (or `fdm validate` with the result that `--out` writes)",
        ];
        assert_eq!(all, expected);
    }
}
