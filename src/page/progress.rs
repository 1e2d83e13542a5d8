//! Work that goes on: what is being done, for how long, and how much is left.

use super::document::Section;
use super::headline::Trust;
use super::number::{shown, text};
use super::study;
use super::subject::{Subject, list};
use maud::html;
use serde_json::Value;

/// What is known so far, in a sentence.
pub(super) fn verdict(told: &Value, result: &Value) -> (Trust, String, Vec<(String, &'static str)>) {
    if let Some(silent) = told["silent"].as_f64() {
        let said = format!(
            "Nothing was heard of this work for {}: the program was killed, or the machine stood still. What it told last:",
            duration(silent)
        );
        return (Trust::Bad, said, Vec::new());
    }
    let doing = told["doing"].as_str().filter(|d| !d.is_empty()).unwrap_or("it has begun");
    let mut points = Vec::new();
    if list(&result["study"]["pooled"]).last().is_some() {
        points.push((format!("So far: {}", study::verdict(&result["study"]).1), "coverage"));
    }
    (Trust::Open, format!("At work: {doing}."), points)
}

pub(super) fn section(subject: &Subject) -> Option<Section> {
    let (told, result) = (subject.progress.as_ref()?, &subject.result);
    let (done, asked) = match result["study"]["asked"].as_u64() {
        Some(asked) => (result["study"]["done"].as_u64(), Some(asked)),
        None => (Some(subject.list("starts").len() as u64), result["starts_asked"].as_u64()),
    };
    let what = if result["study"].is_object() { "repeats" } else { "starts" };
    let last = subject.list("history").last();
    let content = html! {
        @if let Some((done, asked)) = done.zip(asked) {
            progress max=(asked) value=(done) {}
            p { (done) " of " (asked) " " (what) " have ended." }
        }
        div.scroll { table { tbody {
            tr { th scope="row" { "at work for" } td.number { (told["elapsed"].as_f64().map_or("–".into(), duration)) } }
            @if let Some(left) = told["left"].as_f64() { tr { th scope="row" { "time left" } td.number { (duration(left)) } } }
            @if let Some(last) = last {
                tr { th scope="row" { "correction" } td.number { (last["number"]) } }
                tr { th scope="row" { "cost" } td.number { (shown(&last["cost"], 10)) } }
                tr { th scope="row" { "largest step [standard errors]" } td.number { (shown(&last["step"], 3)) } }
            }
        } } }
        p.note { "The page follows the work by itself, and becomes that of the result." }
    };
    Some(Section::new("progress", "How far it is", content))
}

/// A time in words, from seconds.
fn duration(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() => "–".into(),
        s if s < 100.0 => format!("{} s", text(s, 2)),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s if s < 172_800.0 => format!("{:.1} h", s / 3600.0),
        s => format!("{:.1} days", s / 86_400.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_told_in_their_own_measure() {
        assert_eq!([12.0, 600.0, 7200.0, 864_000.0].map(duration), ["12 s", "10 min", "2.0 h", "10.0 days"]);
        assert_eq!(duration(f64::NAN), "–");
    }
}
