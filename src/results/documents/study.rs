//! A Monte-Carlo study: bias, scatter and coverage of every parameter over repeats, each with what chance leaves open.

use super::requirement::{Assessment, By};
use fdm_estimate::{Estimate, ParameterEstimate, Status, quantile};
use fdm_numeric::statistics::beta_quantile;
use serde::{Deserialize, Serialize};

/// The colour of the noise that repeats get.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Colour {
    /// No sample knows of another.
    #[default]
    White,
    /// As the residuals of the fit have it: an autoregression for each output.
    Fitted,
    /// AR(1) noise, rho = 0.9.
    Ar1,
    /// Power falls as one over the frequency.
    Pink,
}

/// What came of a series of repeats.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Study {
    /// The model or the system.
    pub name: String,
    /// The colour of the noise; none where it is as an experiment describes it.
    pub colour: Option<Colour>,
    /// Decides all noise.
    pub seed: u64,
    /// Repeats that were asked for.
    pub asked: usize,
    /// Repeats that are done; fewer when the series was interrupted.
    pub done: usize,
    /// Repeats that converged.
    pub converged: usize,
    /// Why the others have not, and how many of each.
    pub astray: Vec<(String, usize)>,
    /// Of each parameter.
    pub parameters: Vec<Coverage>,
    /// Of all parameters together, by kind of errors.
    pub pooled: Vec<Pooled>,
    /// Of each requirement of the text.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub requirements: Vec<GoalCoverage>,
    /// Why requirements of the text are not studied.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_requirements: Option<String>,
}

/// A requirement that is studied.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Goal {
    /// Its name.
    pub name: String,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// Its value at the parameters that the records were made with; none where it has none there.
    pub truth: Option<f64>,
}

/// What a repeat says of a requirement.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
pub struct Judged {
    /// Its value; not a number where there is none.
    pub value: f64,
    /// Its interval of 95 %; not numbers where there is none.
    pub interval: [f64; 2],
    /// Whether the interval is one of draws.
    pub drawn: bool,
}

impl Judged {
    /// Nothing came out.
    pub const NONE: Self = Self { value: f64::NAN, interval: [f64::NAN; 2], drawn: false };

    /// What an assessment says.
    pub fn of(assessment: &Assessment) -> Self {
        Self {
            value: assessment.value.unwrap_or(f64::NAN),
            interval: assessment.interval.unwrap_or([f64::NAN; 2]),
            drawn: assessment.by == Some(By::Draws),
        }
    }

    fn is_there(&self) -> bool {
        self.interval.iter().all(|v| v.is_finite())
    }

    fn holds(&self, truth: f64) -> bool {
        self.interval[0] <= truth && truth <= self.interval[1]
    }
}

/// One requirement over all repeats.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct GoalCoverage {
    /// Which.
    #[serde(flatten)]
    pub goal: Goal,
    /// Repeats in which it has a value.
    pub repeats: usize,
    /// Mean of these values.
    pub mean: Option<f64>,
    /// Their standard deviation.
    pub scatter: Option<f64>,
    /// Mean half width of the intervals.
    pub half_width: Option<f64>,
    /// Intervals that hold the truth, of those repeats that have one.
    pub coverage: Share,
    /// Intervals that hold the truth, of all repeats: one without an interval does not hold the truth.
    pub of_all: Share,
    /// Truths above the interval, and below it.
    pub missed: [usize; 2],
    /// Intervals by draws, since the requirement is not linear within the errors.
    pub drawn: usize,
}

impl GoalCoverage {
    fn of(goal: &Goal, all: &[Judged]) -> Self {
        let values: Vec<f64> = all.iter().map(|j| j.value).filter(|v| v.is_finite()).collect();
        let there: Vec<&Judged> = all.iter().filter(|j| j.is_there()).collect();
        let (n, truth) = (values.len() as f64, goal.truth.unwrap_or(f64::NAN));
        let finite = |v: f64| v.is_finite().then_some(v);
        let mean = values.iter().sum::<f64>() / n;
        let scatter = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        let hits = there.iter().filter(|j| j.holds(truth)).count();
        let above = there.iter().filter(|j| truth > j.interval[1]).count();
        let below = there.iter().filter(|j| truth < j.interval[0]).count();
        let half = there.iter().map(|j| 0.5 * (j.interval[1] - j.interval[0])).sum::<f64>() / there.len() as f64;
        Self {
            goal: goal.clone(),
            repeats: values.len(),
            mean: finite(mean),
            scatter: finite(scatter),
            half_width: finite(half),
            coverage: Share::new(hits, there.len()),
            of_all: Share::new(hits, all.len()),
            missed: [above, below],
            drawn: there.iter().filter(|j| j.drawn).count(),
        }
    }
}

/// The errors of one kind over all parameters.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Pooled {
    /// Which.
    pub kind: Kind,
    /// Nominal 95 % intervals that hold the truth, of all that were printed.
    pub coverage: f64,
    /// What chance leaves open: its interval of 95 %, by the scatter between repeats, whose parameters are not independent.
    pub interval: [f64; 2],
    /// Nominal 95 % intervals that hold the truth, of all parameters of all repeats: one without an interval does not
    /// hold the truth.
    pub of_all: f64,
    /// The parameter whose coverage is furthest from 95 %, and its coverage.
    pub worst: (String, f64),
    /// Least and greatest scatter over printed error.
    pub ratios: [f64; 2],
}

/// Reasons that are counted apart.
const REASONS: usize = 8;

impl Study {
    /// Of repeats; those that are missing were interrupted.
    pub fn of(
        name: impl Into<String>,
        (colour, seed): (Option<Colour>, u64),
        subjects: &[Subject],
        repeats: &[Option<Repeat>],
    ) -> Self {
        let done: Vec<&Repeat> = repeats.iter().flatten().collect();
        let converged = done.iter().filter(|r| r.is_good()).count();
        let column = |k: usize| done.iter().map(|r| r.figures[k]).collect::<Vec<Figure>>();
        let parameters: Vec<Coverage> = subjects.iter().enumerate().map(|(k, s)| Coverage::of(s, &column(k))).collect();
        let kinds = [Kind::CramerRao, Kind::Corrected].into_iter().enumerate();
        let pooled = kinds.filter_map(|(k, kind)| Pooled::of(kind, k, subjects, &parameters, &done)).collect();
        let astray = reasons(&done);
        Self {
            name: name.into(),
            colour,
            seed,
            asked: repeats.len(),
            done: done.len(),
            converged,
            astray,
            parameters,
            pooled,
            requirements: Vec::new(),
            no_requirements: None,
        }
    }

    /// With the requirements that repeats have judged.
    #[must_use]
    pub fn with_requirements(mut self, goals: &[Goal], repeats: &[Option<Repeat>]) -> Self {
        let column = |k: usize| -> Vec<Judged> {
            repeats.iter().flatten().map(|r| r.requirements.get(k).copied().unwrap_or(Judged::NONE)).collect()
        };
        let known = goals.iter().enumerate().filter(|(_, goal)| goal.truth.is_some());
        self.requirements = known.map(|(k, goal)| GoalCoverage::of(goal, &column(k))).collect();
        let none: Vec<&str> = goals.iter().filter(|g| g.truth.is_none()).map(|g| g.name.as_str()).collect();
        self.no_requirements = (!none.is_empty()).then(|| format!("no value at the estimates: {}", none.join(", ")));
        self
    }

    /// Without the requirements of the text, and why.
    #[must_use]
    pub fn without_requirements(mut self, why: &impl std::fmt::Display) -> Self {
        self.no_requirements = Some(why.to_string());
        self
    }

    /// Whether all repeats that were asked for are there.
    pub fn is_whole(&self) -> bool {
        self.done == self.asked
    }

    /// The requirement whose coverage is furthest from 95 %.
    pub fn worst_requirement(&self) -> Option<&GoalCoverage> {
        let off = |r: &GoalCoverage| (r.coverage.share - 0.95).abs();
        self.requirements.iter().filter(|r| r.coverage.of > 0).max_by(|a, b| off(a).total_cmp(&off(b)))
    }

    /// The errors of all parameters that are to be trusted: corrected where there are any.
    pub fn trusted(&self) -> Option<&Pooled> {
        self.pooled.last()
    }
}

/// Why repeats went astray, the most frequent reason first.
fn reasons(done: &[&Repeat]) -> Vec<(String, usize)> {
    let mut counts: Vec<(String, usize)> = Vec::new();
    for (step, reason) in done.iter().flat_map(|r| &r.astray) {
        let said = if step.is_empty() { reason.clone() } else { format!("{step}: {reason}") };
        match counts.iter_mut().find(|(known, _)| *known == said) {
            Some((_, count)) => *count += 1,
            None => counts.push((said, 1)),
        }
    }
    counts.sort_by_key(|count| std::cmp::Reverse(count.1));
    if counts.len() > REASONS {
        let rest = counts.drain(REASONS - 1..).map(|(_, count)| count).sum();
        counts.push(("other reasons".into(), rest));
    }
    counts
}

impl Pooled {
    fn of(kind: Kind, k: usize, subjects: &[Subject], parameters: &[Coverage], done: &[&Repeat]) -> Option<Self> {
        let known: Vec<(&Coverage, &Interval)> =
            parameters.iter().filter_map(|p| Some((p, p.interval(kind)?))).collect();
        let off = |i: &Interval| (i.coverage.share - 0.95).abs();
        let worst = known.iter().max_by(|a, b| off(a.1).total_cmp(&off(b.1)))?;
        // hits and printed intervals of each repeat: ratio of two sums over independent repeats
        let counted = |repeat: &&Repeat| -> (f64, f64) {
            let figures = || repeat.figures.iter().zip(subjects).filter(|(f, _)| f.errors[k].is_finite());
            (figures().filter(|(f, s)| f.holds(k, s.truth)).count() as f64, figures().count() as f64)
        };
        let counts: Vec<(f64, f64)> = done.iter().map(counted).collect();
        let (hits, printed) = counts.iter().fold((0.0, 0.0), |(h, p), (a, b)| (h + a, p + b));
        let coverage = hits / printed;
        let spread = counts.iter().map(|(h, p)| (h - coverage * p).powi(2)).sum::<f64>().sqrt() / printed;
        let ratio = |pick: fn(f64, f64) -> f64| known.iter().map(|(_, i)| i.ratio).reduce(pick).unwrap_or(f64::NAN);
        Some(Self {
            kind,
            coverage,
            interval: [coverage - NOMINAL * spread, coverage + NOMINAL * spread].map(|c| c.clamp(0.0, 1.0)),
            of_all: hits / (done.len() * known.len()) as f64,
            worst: (worst.0.subject.label(), worst.1.coverage.share),
            ratios: [ratio(f64::min), ratio(f64::max)],
        })
    }
}

impl Subject {
    /// What it is called where several steps and runs stand together.
    pub fn label(&self) -> String {
        let of = |what: &str, name: &str| if name.is_empty() { String::new() } else { format!("{what}{name}") };
        let run = of(" of ", self.run.as_deref().unwrap_or_default());
        format!("{}{run}{}", self.name, of(", ", &self.step))
    }
}

/// Standard deviations of chance on both sides of a mean.
pub const NOMINAL: f64 = 1.959_963_984_540_054;

/// Kinds of standard errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The bound of Cramer and Rao.
    CramerRao,
    /// Corrected for the colour of the residuals.
    Corrected,
}

/// What the errors of one kind are worth.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Interval {
    /// Which.
    pub kind: Kind,
    /// Root mean square of the printed errors.
    pub error: f64,
    /// Scatter of the estimates over that error.
    pub ratio: f64,
    /// Nominal 95 % intervals that hold the truth, of those repeats that converged and have an interval.
    pub coverage: Share,
    /// Nominal 95 % intervals that hold the truth, of all repeats: one without an interval does not hold the truth.
    pub of_all: Share,
}

/// One parameter over all repeats.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Coverage {
    /// Which.
    #[serde(flatten)]
    pub subject: Subject,
    /// Repeats that converged.
    pub repeats: usize,
    /// Mean of their estimates.
    pub mean: f64,
    /// Mean minus truth, in printed errors (the corrected ones where there are any).
    pub bias: f64,
    /// What chance alone gives to the bias in 95 % of cases: plus or minus this.
    pub bias_chance: f64,
    /// Standard deviation of the estimates.
    pub scatter: f64,
    /// By kind of errors; a kind that was never printed is missing.
    pub intervals: Vec<Interval>,
}

impl Coverage {
    /// Of the figures of all repeats.
    pub fn of(subject: &Subject, figures: &[Figure]) -> Self {
        let values: Vec<f64> = figures.iter().map(|f| f.value).filter(|v| v.is_finite()).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let scatter = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        let intervals: Vec<Interval> = [Kind::CramerRao, Kind::Corrected]
            .into_iter()
            .enumerate()
            .filter_map(|(k, kind)| Interval::of(kind, k, subject.truth, figures, scatter))
            .collect();
        let error = intervals.last().map_or(f64::NAN, |i| i.error);
        Self {
            subject: subject.clone(),
            repeats: values.len(),
            mean,
            bias: (mean - subject.truth) / error,
            bias_chance: NOMINAL * scatter / n.sqrt() / error,
            scatter,
            intervals,
        }
    }

    /// What the errors of this kind are worth.
    pub fn interval(&self, kind: Kind) -> Option<&Interval> {
        self.intervals.iter().find(|i| i.kind == kind)
    }

    /// The errors to be trusted: corrected where there are any.
    pub fn trusted(&self) -> Option<&Interval> {
        self.intervals.last()
    }

    /// Whether there is more bias than chance explains.
    pub fn is_biased(&self) -> bool {
        self.bias.abs() > self.bias_chance
    }
}

impl Interval {
    fn of(kind: Kind, k: usize, truth: f64, figures: &[Figure], scatter: f64) -> Option<Self> {
        let errors: Vec<f64> = figures.iter().map(|f| f.errors[k]).filter(|e| e.is_finite()).collect();
        if errors.is_empty() {
            return None;
        }
        let error = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        let hits = figures.iter().filter(|f| f.holds(k, truth)).count();
        let (coverage, of_all) = (Share::new(hits, errors.len()), Share::new(hits, figures.len()));
        Some(Self { kind, error, ratio: scatter / error, coverage, of_all })
    }
}

impl Figure {
    /// Whether the nominal interval by errors of a kind holds a value.
    pub fn holds(&self, kind: usize, truth: f64) -> bool {
        (self.value - truth).abs() <= self.factors[kind] * self.errors[kind]
    }
}

/// So many of so many.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
pub struct Share {
    /// How often it happened.
    pub hits: usize,
    /// Of so many.
    pub of: usize,
    /// The share; 0 of none.
    pub share: f64,
    /// The interval that holds the true share in 95 % of cases or more (Clopper and Pearson).
    pub interval: [f64; 2],
}

/// Probability on each side of the interval.
const TAIL: f64 = 0.025;

impl Share {
    /// `hits` of `of`.
    pub fn new(hits: usize, of: usize) -> Self {
        let (k, n) = (hits as f64, of as f64);
        let quantile = |a: f64, b: f64, p: f64| beta_quantile(p, [a, b]).unwrap_or(f64::NAN);
        let lower = if hits == 0 { 0.0 } else { quantile(k, n - k + 1.0, TAIL) };
        let upper = if hits >= of { 1.0 } else { quantile(k + 1.0, n - k, 1.0 - TAIL) };
        Self { hits, of, share: if of > 0 { k / n } else { 0.0 }, interval: [lower, upper] }
    }
}

/// A parameter that is studied.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Subject {
    /// The step of an experiment that estimates it; empty where there is one only.
    pub step: String,
    /// Its name.
    pub name: String,
    /// The run that it belongs to; none when all runs share it.
    pub run: Option<String>,
    /// Its unit, as text.
    pub unit: Option<String>,
    /// The value that the records were made with.
    pub truth: f64,
}

/// What came out for one parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// The estimate; not a number where there is none.
    pub value: f64,
    /// Cramer-Rao and corrected standard error; not a number where there is none (a parameter at its bound, or not determined).
    pub errors: [f64; 2],
    /// How many of these errors on both sides make the interval of 95 %: more than two where the noise is poorly known.
    pub factors: [f64; 2],
}

impl Figure {
    /// Nothing came out.
    pub const NONE: Self = Self { value: f64::NAN, errors: [f64::NAN; 2], factors: [f64::NAN; 2] };

    /// What an estimate says.
    pub fn of(p: &ParameterEstimate) -> Self {
        let error = |e: Option<f64>| e.filter(|e| e.is_finite() && *e > 0.0).unwrap_or(f64::NAN);
        Self {
            value: p.value,
            errors: [error(p.standard_error), error(p.corrected_error)],
            factors: [quantile(None), quantile(p.degrees_of_freedom)],
        }
    }
}

/// One repeat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Repeat {
    /// Steps that have no minimum, and why; empty when all have converged. Their figures are not numbers.
    pub astray: Vec<(String, String)>,
    /// What came out, in the order of the subjects.
    pub figures: Vec<Figure>,
    /// What came out for the requirements, where they are studied.
    pub requirements: Vec<Judged>,
}

impl Repeat {
    /// Whether every fit of it converged.
    pub fn is_good(&self) -> bool {
        self.astray.is_empty()
    }

    /// Nothing came out, for this reason.
    pub fn gone(reason: impl ToString, subjects: usize) -> Self {
        Self {
            astray: vec![(String::new(), reason.to_string())],
            figures: vec![Figure::NONE; subjects],
            requirements: Vec::new(),
        }
    }

    /// What an estimation says of the subjects.
    pub fn of(estimate: &Estimate, subjects: &[Subject]) -> Self {
        if !estimate.termination.is_good() {
            return Self::gone(&estimate.termination, subjects.len());
        }
        let of = |s: &Subject| estimate.parameter(&s.name, s.run.as_deref()).map_or(Figure::NONE, Figure::of);
        Self { astray: Vec::new(), figures: subjects.iter().map(of).collect(), requirements: Vec::new() }
    }
}

/// Whether a parameter was estimated, or follows from some that were.
pub fn is_estimated(p: &ParameterEstimate) -> bool {
    match p.status {
        Status::Estimated | Status::AtLowerBound | Status::AtUpperBound | Status::NotDetermined => true,
        Status::Derived | Status::Tied => p.standard_error.is_some(),
        Status::Unvisited | Status::Fixed | Status::NotEstimated => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_of_requirements_are_counted_with_the_side_on_which_they_miss() {
        let judged =
            |low: f64, high: f64| Judged { value: 0.5 * (low + high), interval: [low, high], drawn: low < 0.5 };
        let repeat = |j: Judged| Some(Repeat { astray: Vec::new(), figures: Vec::new(), requirements: vec![j] });
        let goal = |truth: Option<f64>| Goal { name: "damping".into(), unit: None, truth };
        let repeats = [
            repeat(judged(0.0, 2.0)),
            repeat(judged(0.5, 0.9)),
            repeat(judged(1.1, 1.2)),
            repeat(Judged::NONE),
            Some(Repeat::gone("lost", 0)),
            None,
        ];
        let study = || Study::of("m", (None, 0), &[], &repeats);
        let found = study().with_requirements(&[goal(Some(1.0))], &repeats);
        let r = &found.requirements[0];
        assert_eq!((r.repeats, r.coverage.hits, r.coverage.of, r.of_all.of), (3, 1, 3, 5));
        assert_eq!((r.missed, r.drawn), ([1, 1], 1));
        assert!((r.half_width.unwrap() - (1.0 + 0.2 + 0.05) / 3.0).abs() < 1e-12);
        let none = study().with_requirements(&[goal(None)], &repeats);
        assert!(none.requirements.is_empty() && none.no_requirements.unwrap().contains("damping"));
        let why = study().without_requirements(&"runs differ").no_requirements;
        assert_eq!(why.as_deref(), Some("runs differ"));
    }

    #[test]
    fn intervals_are_those_of_the_tables() {
        let close = |got: [f64; 2], want: [f64; 2]| {
            assert!((got[0] - want[0]).abs() < 1e-4 && (got[1] - want[1]).abs() < 1e-4, "{got:?} {want:?}");
        };
        // Clopper and Pearson (1934); 0 of 10 has the closed form 1 - 0.025^(1/10)
        close(Share::new(0, 10).interval, [0.0, 1.0 - 0.025f64.powf(0.1)]);
        close(Share::new(10, 10).interval, [0.025f64.powf(0.1), 1.0]);
        close(Share::new(3, 10).interval, [0.066_740, 0.652_453]);
        close(Share::new(950, 1000).interval, [0.934_597, 0.962_678]);
        assert_eq!(Share::new(0, 0).interval, [0.0, 1.0]);
    }
}
