//! What was expected of a step beside what came out.

use super::amount::Tolerance;
use super::description::{Answer, Expected, Stage};
use super::flight::rounded;
use super::setting::Found;
use super::setting::Setting;
use fdm_estimate::{ParameterEstimate, Status};
use fdm_results::documents::reproduction::Check;

/// How far estimates may be off where nothing is said, in standard errors.
const WITHIN: [Tolerance; 1] = [Tolerance::Errors(4.0)];
/// Standard errors from zero from which on a parameter is determined, and within which it is not.
const DETERMINED: f64 = 4.0;
const UNDETERMINED: f64 = 2.0;
/// Standard errors from which on an estimate is biased.
const BIASED: f64 = 3.0;

/// All checks of a step.
pub(super) fn checks(stage: &Stage, setting: &Setting, found: &Found) -> Vec<Check> {
    let mut checks = Vec::new();
    if stage.says.astray {
        let got = found.astray.clone().unwrap_or_else(|| "a minimum".into());
        checks.push(said(stage, "the fit", "goes astray".into(), got, found.astray.is_some()));
    } else if let Some(reason) = &found.astray {
        checks.push(said(stage, "the fit", "a minimum".into(), reason.clone(), false));
    }
    checks.extend(modes(stage, found));
    let truth = |p: &ParameterEstimate| setting.truth(&p.name, p.run.as_deref());
    for p in &found.parameters {
        let expected = stage.expected.get(&p.name);
        let estimated = !matches!(p.status, Status::Fixed | Status::Derived | Status::Tied);
        let compared = stage.compared.unwrap_or(true) && !stage.except.contains(&p.name) && estimated;
        let wanted = match (expected, truth(p)) {
            (Some(expected), truth) => {
                Some(Expected { value: expected.value.or(truth.filter(|_| expected.is_bare())), ..expected.clone() })
            }
            (None, Some(truth)) if compared => Some(Expected { value: Some(truth), ..Expected::default() }),
            _ => None,
        };
        let what = p
            .run
            .as_ref()
            .filter(|_| setting.runs.len() > 1)
            .map_or(p.name.clone(), |run| format!("{} of {run}", p.name));
        if let Some(wanted) = wanted {
            checks.push(figure(stage, what, &p.name, p.value, p.error(), &wanted));
        }
    }
    let figures = with_errors(setting, found);
    for (name, wanted) in &stage.expected {
        if found.parameters.iter().any(|p| p.name == *name) {
            continue;
        }
        match figures.iter().find(|(own, _)| own == name) {
            Some((_, value)) => checks.push(figure(stage, name.clone(), name, *value, None, wanted)),
            None if found.parameters.is_empty() && found.astray.is_some() => {}
            None => checks.push(said(
                stage,
                name,
                range(wanted, &within(stage, wanted)),
                "there is no such figure".into(),
                false,
            )),
        }
    }
    checks.extend(statements(stage, setting, found));
    checks
}

impl Expected {
    /// Whether it is about a tolerance only.
    fn is_bare(&self) -> bool {
        self.value.is_none() && self.least.is_none() && self.most.is_none()
    }
}

/// The figures with the mean and the largest relative error of shared parameters, in percent.
fn with_errors(setting: &Setting, found: &Found) -> Vec<(String, f64)> {
    let part = |p: &ParameterEstimate| {
        let truth = setting.truth(&p.name, None).filter(|t| *t != 0.0 && p.run.is_none())?;
        (p.status != Status::Fixed).then(|| 100.0 * (p.value / truth - 1.0).abs())
    };
    let parts: Vec<f64> = found.parameters.iter().filter_map(part).collect();
    let mut figures: Vec<(String, f64)> = found.figures.iter().map(|(n, v)| (n.clone(), *v)).collect();
    if !parts.is_empty() {
        figures.push(("mean error %".into(), parts.iter().sum::<f64>() / parts.len() as f64));
        figures.push(("largest error %".into(), parts.iter().fold(0.0, |a: f64, b| a.max(*b))));
    }
    figures
}

fn within(stage: &Stage, wanted: &Expected) -> Vec<Tolerance> {
    let chosen = if wanted.within.is_empty() { &stage.within } else { &wanted.within };
    if chosen.is_empty() { WITHIN.to_vec() } else { chosen.clone() }
}

fn figure(stage: &Stage, what: String, name: &str, value: f64, error: Option<f64>, wanted: &Expected) -> Check {
    let within = within(stage, wanted);
    let mut passed =
        wanted.least.is_none_or(|l| value >= l) && wanted.most.is_none_or(|m| value <= m) && value.is_finite();
    let mut off = None;
    if let Some(want) = wanted.value {
        let miss = (value - want).abs();
        for tolerance in &within {
            passed &= match tolerance {
                Tolerance::Errors(count) => {
                    off = error.filter(|e| *e > 0.0).map(|e| (value - want) / e);
                    off.is_some_and(|z| z.abs() <= *count)
                }
                Tolerance::Part(part) => miss <= part * want.abs(),
                Tolerance::Absolute(limit) => miss <= *limit,
            };
        }
    }
    Check {
        step: stage.name.clone(),
        what,
        paper: stage.paper.get(name).map(printed),
        expected: range(wanted, &within),
        got: short(value),
        standard_error: error,
        off,
        passed,
    }
}

/// What was expected, in words.
fn range(wanted: &Expected, within: &[Tolerance]) -> String {
    match (wanted.value, wanted.least, wanted.most) {
        (Some(value), ..) => {
            let special = within != &WITHIN[..];
            let words: Vec<String> = within.iter().filter(|_| special).map(words).collect();
            if words.is_empty() { short(value) } else { format!("{} within {}", short(value), words.join(", ")) }
        }
        (None, Some(least), Some(most)) => format!("{} to {}", short(least), short(most)),
        (None, Some(least), None) => format!("at least {}", short(least)),
        (None, None, Some(most)) => format!("at most {}", short(most)),
        (None, None, None) => String::from("a figure"),
    }
}

fn words(tolerance: &Tolerance) -> String {
    match tolerance {
        Tolerance::Errors(count) => format!("{count} se"),
        Tolerance::Part(part) => format!("{} %", short(100.0 * part)),
        Tolerance::Absolute(limit) => short(*limit),
    }
}

fn printed(answer: &Answer) -> String {
    match answer {
        Answer::Value(value) => short(*value),
        Answer::WithError([value, error]) => format!("{} ± {}", short(*value), short(*error)),
    }
}

/// Five significant digits, without zeros behind them.
fn short(v: f64) -> String {
    if v == 0.0 || !v.is_finite() {
        return format!("{v}");
    }
    let rounded = rounded(v, 5);
    if (1e-4..1e6).contains(&v.abs()) { rounded.to_string() } else { format!("{rounded:e}") }
}

fn said(stage: &Stage, what: &str, expected: String, got: String, passed: bool) -> Check {
    let (step, what, paper) = (stage.name.clone(), what.to_string(), stage.paper.get(what).map(printed));
    Check { step, what, paper, expected, got, standard_error: None, off: None, passed }
}

/// Each expected eigenvalue beside the nearest that is there.
fn modes(stage: &Stage, found: &Found) -> Vec<Check> {
    let within = if stage.within.is_empty() { vec![Tolerance::Part(0.005)] } else { stage.within.clone() };
    let text = |re: f64, im: f64| if im == 0.0 { short(re) } else { format!("{} ± {}j", short(re), short(im.abs())) };
    let one = |[re, im]: &[f64; 2]| {
        let distance = |s: &&num_complex::Complex64| (s.re - re).hypot(s.im - im);
        let nearest = found.modes.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let passed = nearest.is_some_and(|s| {
            within.iter().all(|tolerance| match tolerance {
                Tolerance::Part(part) => distance(&s) <= part * re.hypot(*im),
                Tolerance::Absolute(limit) => distance(&s) <= *limit,
                Tolerance::Errors(_) => false,
            })
        });
        let expected = format!("{} within {}", text(*re, *im), within.iter().map(words).collect::<Vec<_>>().join(", "));
        said(stage, "eigenvalue", expected, nearest.map_or("none".into(), |s| text(s.re, s.im)), passed)
    };
    stage.modes.iter().map(one).collect()
}

fn statements(stage: &Stage, setting: &Setting, found: &Found) -> Vec<Check> {
    let says = &stage.says;
    let mut checks = Vec::new();
    let of = |name: &str| found.parameters.iter().find(|p| p.name == name);
    for name in &says.undetermined {
        let (got, passed) = of(name).map_or(("not estimated".into(), false), undetermined);
        checks.push(said(stage, name, "not determined by this record".into(), got, passed));
    }
    for name in &says.determined {
        let ratio = of(name).filter(|p| p.status == Status::Estimated).and_then(|p| Some(p.value.abs() / p.error()?));
        let got = ratio.map_or("not determined".into(), |r| format!("{} errors from zero", short(r)));
        checks.push(said(stage, name, "determined".into(), got, ratio.is_some_and(|r| r > DETERMINED)));
    }
    for name in &says.biased {
        let off = of(name).and_then(|p| Some((p.value - setting.truth(name, None)?) / p.error()?));
        let got = off.map_or("no error".into(), |z| format!("{} errors off the truth", short(z)));
        checks.push(said(stage, name, "biased".into(), got, off.is_some_and(|z| z.abs() > BIASED)));
    }
    for names in &says.not_identifiable {
        let has = |moves: &[(String, f64)]| names.iter().all(|n| moves.iter().any(|(own, _)| own == n));
        let direction = found.directions.iter().find(|d| has(&d.moves));
        let got = match (direction, found.directions.first()) {
            (Some(d), _) | (None, Some(d)) => d.sentence.clone(),
            (None, None) => "every combination is determined".into(),
        };
        let expected = format!("a combination of {} is not determined", names.join(", "));
        checks.push(said(stage, "what is not identifiable", expected, got, direction.is_some()));
    }
    checks.extend(says.weak.iter().map(|names| weak(stage, found, names)));
    checks.extend(order(stage, found));
    checks
}

/// The combination that is known least has these parameters, and is known worse than to its own size.
fn weak(stage: &Stage, found: &Found, names: &[String]) -> Check {
    let expected = format!("a combination of {} is not determined", names.join(", "));
    let Some(weakest) = &found.weakest else {
        return said(stage, "the least known", expected, "nothing is known of it".into(), false);
    };
    let has = names.iter().all(|n| weakest.parts.iter().any(|(own, _)| own == n));
    let parts: Vec<String> = weakest.parts.iter().map(|(name, part)| format!("{name} {:+.2}", part)).collect();
    let got = format!(
        "together, relative to their values: {}; known to {} %",
        parts.join(", "),
        short(100.0 * weakest.error)
    );
    said(stage, "the least known", expected, got, has && weakest.error > 1.0)
}

/// What is known of a parameter that is not determined, and whether it is not.
fn undetermined(p: &ParameterEstimate) -> (String, bool) {
    match p.error().filter(|_| p.status == Status::Estimated) {
        None => ("not determined, no bound".into(), p.status == Status::NotDetermined),
        Some(error) if p.value.abs() <= UNDETERMINED * error => {
            (format!("not determined, magnitude below {}", short(p.value.abs() + UNDETERMINED * error)), true)
        }
        Some(error) => (format!("{} ± {}", short(p.value), short(error)), false),
    }
}

/// Groups of parameters by confidence: the last of one stands before the first of the next.
fn order(stage: &Stage, found: &Found) -> Option<Check> {
    let groups = &stage.says.order;
    if groups.is_empty() {
        return None;
    }
    let place = |name: &String| found.order.iter().position(|n| n == name);
    let last = |group: &[String]| group.iter().map(|n| place(n).unwrap_or(usize::MAX)).max();
    let first = |group: &[String]| group.iter().map(|n| place(n).unwrap_or(0)).min();
    let passed = !found.order.is_empty() && groups.windows(2).all(|pair| last(&pair[0]) < first(&pair[1]));
    let expected = groups.iter().map(|g| g.join(", ")).collect::<Vec<_>>().join(" before ");
    Some(said(stage, "order of confidence", expected, found.order.join(", "), passed))
}
