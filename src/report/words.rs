//! Words of a field: one table, by which sentences written for those who fly and sail are told to chemists.

use crate::page::figure::Figure;
use crate::section::{Part, Report, Section, Verdict};
use fdm_grammar::syntax::{Role, StatementKind, parse};
use fdm_grammar::{Source, Unit};
use std::borrow::Cow;

/// What a chemist calls what others call so. A run has a name too, which may be `run`: it is the word alone as a title, before a number, or behind
/// one of [`COUNTING`].
const KINETICS: &[(&str, &str)] = &[
    ("manoeuvres", "experiments"),
    ("manoeuvre", "experiment"),
    ("doublets", "pulses"),
    ("sweep", "variation"),
    ("motion", "change"),
    ("flown", "set"),
    ("runs", "experiments"),
    ("run", "experiment"),
];

/// Words behind which `run` is no name.
const COUNTING: [&str; 5] = ["1", "a", "every", "next", "per"];

/// Amounts of substance and concentrations: a model that has one is told in a chemist's words.
const OF_SUBSTANCE: [&str; 3] = ["mol", "mol/m^3", "mol/kg"];

/// The words in which a model is told.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Words(&'static [(&'static str, &'static str)]);

impl Words {
    /// Those of the field that a model is of: of reactions where it has some, or states and outputs that are amounts of substance.
    pub fn of(source: &Source) -> Self {
        let Ok(tree) = parse(source) else { return Self::default() };
        let substances: Vec<Unit> = OF_SUBSTANCE.iter().filter_map(|unit| Unit::parse(unit).ok()).collect();
        let is_substance =
            |text: &str| Unit::parse(text).is_ok_and(|u| substances.iter().any(|s| s.same_dimension(&u)));
        let reacts = tree.statements.iter().any(|statement| match &statement.kind {
            StatementKind::Reactions(..) => true,
            StatementKind::Declare(Role::State | Role::Output, list) => {
                list.iter().filter_map(|d| d.unit.as_ref()).any(|unit| is_substance(&unit.text))
            }
            _ => false,
        });
        Self(if reacts { KINETICS } else { &[] })
    }

    /// A sentence in these words; names between backticks are left alone.
    pub fn told(self, said: &str) -> String {
        if self.0.is_empty() {
            return said.into();
        }
        let parts = said.split('`').enumerate();
        parts.map(|(k, part)| if k % 2 == 0 { self.prose(part) } else { part.into() }).collect::<Vec<_>>().join("`")
    }

    fn prose(self, said: &str) -> String {
        let is_letter = |c: char| c.is_alphanumeric() || c == '_';
        let (mut told, mut rest, mut before) = (String::new(), said, "");
        while !rest.is_empty() {
            let ends = |of: bool| rest.find(|c| is_letter(c) != of).unwrap_or(rest.len());
            let (word, behind) = rest.split_at(ends(rest.starts_with(is_letter)));
            let is_name = word == "run"
                && word != said
                && !COUNTING.contains(&before)
                && !behind.strip_prefix(' ').is_some_and(|b| b.starts_with(|c: char| c.is_ascii_digit()));
            let other = self.0.iter().find(|(own, _)| *own == word && !is_name);
            if other.is_some_and(|(_, other)| other.starts_with('e')) && told.ends_with("a ") && before == "a" {
                told.insert(told.len() - 1, 'n');
            }
            told.push_str(other.map_or(word, |(_, other)| other));
            before = if word.starts_with(is_letter) { word } else { before };
            rest = behind;
        }
        told
    }

    /// A section in these words. Cells of tables hold names, and stay.
    pub(crate) fn section(self, section: Section) -> Section {
        let parts = section.parts.into_iter().map(|part| self.part(part)).collect();
        Section { title: Cow::Owned(self.told(&section.title)), parts, ..section }
    }

    /// A report in these words.
    pub(crate) fn report(self, report: Report) -> Report {
        let Report { kind, verdict, sections, .. } = report;
        let mut verdict = Verdict { sentence: self.told(&verdict.sentence), ..verdict };
        verdict.facts = verdict.facts.map(|said| self.told(&said));
        verdict.points.iter_mut().for_each(|point| point.sentence = self.told(&point.sentence));
        let sections = sections.into_iter().map(|section| self.section(section)).collect();
        Report { kind: Cow::Owned(self.told(&kind)), verdict, sections, ..report }
    }

    fn part(self, part: Part) -> Part {
        let all = |parts: Vec<Part>| parts.into_iter().map(|part| self.part(part)).collect();
        match part {
            Part::Line(said) => Part::Line(self.told(&said)),
            Part::Note(said) => Part::Note(self.told(&said)),
            Part::Warning(said) => Part::Warning(self.told(&said)),
            Part::Heading(said) => Part::Heading(self.told(&said)),
            Part::List(items) => Part::List(items.iter().map(|said| self.told(said)).collect()),
            Part::Table(mut table) => {
                table.caption = table.caption.map(|said| self.told(&said));
                table.columns.iter_mut().for_each(|column| column.title = self.told(&column.title));
                Part::Table(table)
            }
            Part::Figure(figure) => Part::Figure(Box::new(self.figure(*figure))),
            Part::Pair(figures) => Part::Pair(figures.into_iter().map(|figure| self.figure(figure)).collect()),
            Part::Folded { summary, open, class, parts } => Part::Folded { summary, open, class, parts: all(parts) },
            Part::Only(medium, part) => Part::Only(medium, Box::new(self.part(*part))),
            Part::Markup(_) | Part::Gap => part,
        }
    }

    fn figure(self, mut figure: Figure) -> Figure {
        figure.caption = self.told(&figure.caption);
        let marks = figure.panels.iter_mut().flat_map(|panel| &mut panel.marks);
        marks.for_each(|mark| mark.name = self.told(&mark.name));
        figure
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Words {
        Words::of(&Source::new("m.fdm", text))
    }

    #[test]
    fn chemists_are_told_of_experiments_and_names_stay() {
        let said = "run 1: `run`, a manoeuvre of run; 2 runs, next run, motion of runs_x";
        let chemist = "experiment 1: `run`, an experiment of run; 2 experiments, next experiment, change of runs_x";
        for text in [
            "model m { state A [mmol/l] = 1; param k = 1 [1/s]; der(A) = -k*A; output y [mmol/l] = A; }",
            "model m { state A = 1, B = 0; param k = 1; reactions { A -> B : k*A; } output y = B; }",
        ] {
            assert_eq!(words(text).told(said), chemist);
            assert_eq!(words(text).told("run"), "experiment");
        }
        let vehicle = words("model m { state p [rad/s] = 1; param k = 1; der(p) = -k*p; output y [rad/s] = p; }");
        assert_eq!(vehicle.told(said), said);
    }
}
