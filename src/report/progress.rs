//! Work that goes on: what is being done, for how long, and how much is left.

use super::section::{Section, Trust, Verdict};
use crate::page::number::{shown, text};
use crate::page::subject::{Content, Subject};
use crate::study;
use fdm_results::documents::ProgressDocument;
use maud::html;

/// What is known so far, in a sentence.
pub(crate) fn verdict(report: &ProgressDocument, silent: Option<f64>) -> Verdict {
    if let Some(silent) = silent {
        let said = format!(
            "Nothing was heard of this work for {}: the program was killed, or the machine stood still. Its last report:",
            duration(silent)
        );
        return Verdict::new(Trust::Bad, said);
    }
    let doing = Some(report.progress.doing.as_str()).filter(|d| !d.is_empty()).unwrap_or("it has begun");
    let study = report.result.study.as_ref().filter(|study| study.trusted().is_some());
    let so_far = study.map(|study| format!("So far: {}", study::verdict(study).sentence));
    Verdict::new(Trust::Open, format!("At work: {doing}.")).with_points(so_far, "coverage")
}

pub(crate) fn section(subject: &Subject) -> Option<Section> {
    let Content::AtWork(report, _) = &subject.content else { return None };
    let (done, asked, what) = match &report.result.study {
        Some(study) => (study.done, Some(study.asked), "repeats"),
        None => (subject.starts().len(), report.result.starts_asked, "starts"),
    };
    let last = subject.history().last();
    let content = html! {
        @if let Some(asked) = asked {
            progress max=(asked) value=(done) {}
            p { (done) " of " (asked) " " (what) " have ended." }
        }
        div.scroll { table { tbody {
            tr { th scope="row" { "at work for" } td.number { (duration(report.progress.elapsed)) } }
            @if let Some(left) = report.progress.left { tr { th scope="row" { "time left" } td.number { (duration(left)) } } }
            @if let Some(last) = last {
                tr { th scope="row" { "iteration" } td.number { (last.number) } }
                tr { th scope="row" { "cost" } td.number { (shown(last.cost, 10)) } }
                tr { th scope="row" { "largest step [standard errors]" } td.number { (shown(last.step, 3)) } }
            }
        } } }
        p.note { "The page follows the work by itself, and becomes that of the result." }
    };
    Some(Section::drawn("progress", "How far it is", content))
}

/// A time in words, from seconds.
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() => "–".into(),
        s if s < 0.0995 => format!("{} ms", text(1e3 * s, 2)),
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
        assert_eq!(duration(0.0123), "12 ms");
    }
}
