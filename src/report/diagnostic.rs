//! Findings about a model in the look of rustc: code, place, the line with carets, the hint as help.

use annotate_snippets::{Annotation, AnnotationKind, Group, Level, Renderer, Snippet};
use fdm_grammar::{Diagnostic, Source, Span, Text};
use std::ops::Range;

/// Most bytes under which carets stand; what is longer is recognised by its beginning.
const MARKED_LENGTH: usize = 80;
/// Most findings shown; nobody reads more before mending these.
const MOST_SHOWN: usize = 50;
/// Two places further apart than this, in lines or in bytes of one line, are shown one after the other.
const SHOWN_TOGETHER: usize = 500;

/// The first findings in the order given, and a line that counts all of them ("2 errors, 1 warning"); empty without
/// findings. `colour` adds ANSI escapes. Errors come before warnings when not all can be shown. Long lines and long places are cut, so that the text stays short whatever the model.
pub fn render(source: &Source, diagnostics: &[Diagnostic], colour: bool) -> String {
    let renderer = if colour { Renderer::styled() } else { Renderer::plain() };
    let mut text = String::new();
    for diagnostic in shown(diagnostics) {
        text.push_str(renderer.render(&[group(source, diagnostic)]).trim_end());
        text.push_str("\n\n");
    }
    if !diagnostics.is_empty() {
        text.push_str(&count(diagnostics));
        if diagnostics.len() > MOST_SHOWN {
            text.push_str(&format!("; {MOST_SHOWN} are shown"));
        }
        text.push('\n');
    }
    text
}

fn shown(diagnostics: &[Diagnostic]) -> Vec<&Diagnostic> {
    if diagnostics.len() <= MOST_SHOWN {
        return diagnostics.iter().collect();
    }
    let (errors, warnings): (Vec<_>, Vec<_>) = diagnostics.iter().partition(|d| d.is_error());
    errors.into_iter().chain(warnings).take(MOST_SHOWN).collect()
}

fn count(diagnostics: &[Diagnostic]) -> String {
    let errors = diagnostics.iter().filter(|d| d.is_error()).count();
    let some = |n: usize, what: &str| (n > 0).then(|| format!("{n} {what}{}", if n == 1 { "" } else { "s" }));
    let parts = [some(errors, "error"), some(diagnostics.len() - errors, "warning")];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// One finding: its own place, labels near it in the same excerpt, labels far from it in excerpts of their own.
fn group<'a>(source: &'a Source, diagnostic: &'a Diagnostic) -> Group<'a> {
    let level = if diagnostic.is_error() { Level::ERROR } else { Level::WARNING };
    let place = Place::new(source, diagnostic.span);
    let mut together = vec![(AnnotationKind::Primary, place.clone(), None)];
    let mut apart = Vec::new();
    for label in &diagnostic.labels {
        let other = Place::new(source, label.span);
        let near = place.is_near(&other);
        let annotation = (AnnotationKind::Context, other, Some(label.text.as_str()));
        if near { together.push(annotation) } else { apart.push(annotation) }
    }
    let mut group =
        level.primary_title(diagnostic.message.as_str()).id(diagnostic.code.text()).element(excerpt(source, together));
    for annotation in apart {
        group = group.element(excerpt(source, vec![annotation]));
    }
    match &diagnostic.hint {
        Some(hint) => group.element(Level::HELP.message(hint.as_str())),
        None => group,
    }
}

/// What carets mark, in one of the texts of a source.
#[derive(Clone)]
struct Place<'a> {
    text: &'a Text,
    /// Bytes of that text.
    range: Range<usize>,
}

impl<'a> Place<'a> {
    /// The part of a span that is marked: on its first line, not too long, on character boundaries.
    fn new(source: &'a Source, span: Span) -> Self {
        let text = source.text_at(span.start);
        let local = |offset: u32| offset.saturating_sub(text.start()) as usize;
        let start = text.text().floor_char_boundary(local(span.start));
        let end = text.text().floor_char_boundary(local(span.end).min(start + MARKED_LENGTH)).max(start);
        let line = text.text()[start..end].split(['\n', '\r']).next().unwrap_or("");
        Self { text, range: start..start + line.trim_end().len() }
    }

    fn is_near(&self, other: &Self) -> bool {
        if self.text.start() != other.text.start() {
            return false;
        }
        let (a, b) = (self.range.start, other.range.start);
        let between = &self.text.text()[a.min(b)..a.max(b)];
        let lines = between.bytes().filter(|c| *c == b'\n').take(SHOWN_TOGETHER).count();
        lines < SHOWN_TOGETHER && (lines > 0 || between.len() < SHOWN_TOGETHER / 5)
    }
}

type Marked<'a> = (AnnotationKind, Place<'a>, Option<&'a str>);

/// The whole lines that hold some places of one text, with carets; the renderer folds the lines between and cuts long
/// ones.
fn excerpt<'a>(source: &'a Source, places: Vec<Marked<'a>>) -> Snippet<'a, Annotation<'a>> {
    let whole = places.first().map_or(&source.texts()[0], |p| p.1.text);
    let text = whole.text();
    let first = places.iter().map(|p| p.1.range.start).min().unwrap_or(0);
    let last = places.iter().map(|p| p.1.range.end).max().unwrap_or(first);
    let start = text[..first].rfind('\n').map_or(0, |k| k + 1);
    let end = text[last..].find('\n').map_or(text.len(), |k| last + k);
    let end = end - usize::from(text[last..end].ends_with('\r'));
    let annotations = places.into_iter().map(|(kind, place, label)| {
        let Range { start: from, end: to } = place.range;
        kind.span(from - start..to - start).label(label)
    });
    Snippet::source(&text[start..end])
        .path(whole.name())
        .line_start(source.position(whole.start() + start as u32).line)
        .annotations(annotations)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use fdm_grammar::Code;

    fn span_of(text: &str, part: &str) -> Span {
        let start = text.find(part).unwrap();
        Span::new(start, start + part.len())
    }

    #[test]
    fn a_finding_shows_code_place_line_labels_and_help() {
        let text = "model m {\r\n\tstate α \"ä\", x;\r\n  param x = 1;\r\n}\r\n";
        let first = span_of(text, "x;");
        let second = span_of(text, "x = 1");
        let found = [
            Diagnostic::new(Code::DeclaredTwice, second, "`x` is declared a second time")
                .label(Span::new(first.start as usize, first.start as usize + 1), "first declared here")
                .hint("choose another name"),
            Diagnostic::new(Code::Unused, span_of(text, "α"), "nothing uses `α`"),
        ];
        let expected = "\
error[E0202]: `x` is declared a second time
 --> dir/m.fdm:3:9
  |
2 |     state α \"ä\", x;
  |                  - first declared here
3 |   param x = 1;
  |         ^^^^^
  |
  = help: choose another name

warning[W0702]: nothing uses `α`
 --> dir/m.fdm:2:8
  |
2 |     state α \"ä\", x;
  |           ^

1 error, 1 warning
";
        assert_eq!(render(&Source::new("dir/m.fdm", text), &found, false), expected);
    }

    #[test]
    fn places_in_a_used_file_are_shown_in_that_file() {
        let mut source = Source::new("m.fdm", "model m { use \"a.fdm\" as a; }");
        source.append("a.fdm", "model a {\n  input x [deg];\n}", Span::new(10, 28));
        let start = source.texts()[1].start() as usize;
        let found = [Diagnostic::new(Code::UnitMismatch, Span::new(14, 21), "no")
            .label(Span::new(start + 12, start + 25), "declared here")];
        let shown = render(&source, &found, false);
        assert!(
            shown.contains("m.fdm:1:15") && shown.contains("a.fdm:2:3") && shown.contains("2 |   input x [deg];"),
            "{shown}"
        );
    }

    #[test]
    fn colour_adds_escapes_and_nothing_else() {
        let source = Source::new("m", "state x;");
        let found = [Diagnostic::new(Code::Unexpected, Span::new(0, 5), "no")];
        let plain = render(&source, &found, false);
        let mut coloured = render(&source, &found, true);
        assert!(coloured.contains("\u{1b}[") && !plain.contains('\u{1b}'));
        while let Some(start) = coloured.find('\u{1b}') {
            let end = start + coloured[start..].find('m').unwrap();
            coloured.replace_range(start..=end, "");
        }
        assert_eq!(coloured, plain);
    }

    #[test]
    fn counts_are_in_words_and_nothing_is_said_about_nothing() {
        let source = Source::new("m", "");
        let at = |code| Diagnostic::new(code, Span::default(), "no");
        let last = |found: &[Diagnostic]| render(&source, found, false).lines().last().map(String::from);
        assert_eq!(last(&[]), None);
        assert_eq!(last(&[at(Code::Unused)]).as_deref(), Some("1 warning"));
        assert_eq!(last(&[at(Code::Cycle), at(Code::Unused), at(Code::Cycle)]).as_deref(), Some("2 errors, 1 warning"));
    }

    #[test]
    fn of_very_many_findings_the_first_errors_are_shown() {
        let source = Source::new("m", "state x;");
        let mut found = vec![Diagnostic::new(Code::Unused, Span::new(6, 7), "nothing uses `x`")];
        found.extend((0..10_000).map(|_| Diagnostic::new(Code::UnknownName, Span::new(6, 7), "no")));
        let shown = render(&source, &found, false);
        assert!(shown.ends_with("\n10000 errors, 1 warning; 50 are shown\n") && !shown.contains("nothing uses"));
        assert!(shown.len() < 5_000, "{}", shown.len());
    }

    #[test]
    fn long_lines_and_long_places_are_cut() {
        let text = format!("model m {{ x = {} y {}; }}", "a + ".repeat(100_000), "+ b".repeat(100_000));
        let source = Source::new("m", text.as_str());
        let y = span_of(&text, "y");
        let all = Span::new(10, text.len());
        let found = [
            Diagnostic::new(Code::UnknownName, y, "short"),
            Diagnostic::new(Code::UnitMismatch, all, "long").label(y, "far").label(Span::new(0, 5), "near"),
        ];
        let shown = render(&source, &found, false);
        assert!(shown.len() < 3_000, "{}", shown.len());
        assert!(shown.contains(" --> m:1:400016\n") && shown.contains("- far") && shown.contains(" near"), "{shown}");
    }

    #[test]
    fn distant_lines_are_shown_apart() {
        let text = format!("first{}second", "\n".repeat(100_000));
        let found = [Diagnostic::new(Code::DeclaredTwice, span_of(&text, "second"), "twice")
            .label(span_of(&text, "first"), "here")];
        let shown = render(&Source::new("m", text), &found, false);
        assert!(shown.contains("100001 | second") && shown.contains("1 | first"), "{shown}");
    }

    #[test]
    fn places_outside_the_text_or_inside_a_character_do_not_panic() {
        for text in ["", "ä", "ä\n", "\0\u{1b}[31m\u{202e}"] {
            let source = Source::new("m", text);
            for (start, end) in [(0, 0), (0, 1), (1, 1), (1, 2), (0, 99), (98, 99), (9, 3)] {
                let found =
                    [Diagnostic::new(Code::Unexpected, Span::new(start, end), "no").label(Span::new(end, start), "l")];
                let shown = render(&source, &found, false);
                assert!(!shown.contains(['\0', '\u{1b}', '\u{202e}']), "{shown:?}");
            }
        }
    }
}
