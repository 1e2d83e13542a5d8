//! What a user is told about a record that cannot be used: file, line, column, what was found, what was expected.

use super::fault::Fault;
use std::fmt;

/// Everything that is wrong with one file, in the order in which it was found; at least one problem.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordError {
    /// The file as the user named it.
    pub file: String,
    /// The problems, independent of each other.
    pub problems: Vec<Problem>,
}

/// One problem and where it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Line as an editor counts them, from 1; `None` when the problem is not in one line.
    pub line: Option<usize>,
    /// Title of the column.
    pub column: Option<String>,
    /// What is wrong.
    pub fault: Box<Fault>,
    /// Lines of the next few places with a problem of this kind in this column.
    pub also: Vec<usize>,
    /// How many such places there are beyond those named.
    pub more: usize,
    /// What would mend it.
    pub hint: Option<String>,
}

impl Fault {
    /// The problem at no particular place.
    pub(crate) fn anywhere(self) -> Problem {
        Problem { line: None, column: None, fault: Box::new(self), also: Vec::new(), more: 0, hint: None }
    }

    /// The problem in a line.
    pub(crate) fn at(self, line: usize) -> Problem {
        Problem { line: Some(line), ..self.anywhere() }
    }
}

impl Problem {
    /// Names the column.
    #[must_use]
    pub(crate) fn column(mut self, title: &str) -> Self {
        self.column = Some(excerpt(title));
        self
    }

    /// Adds what would mend it.
    #[must_use]
    pub(crate) fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }

    /// Adds what would mend it, when that is known.
    #[must_use]
    pub(crate) fn maybe_hint(mut self, hint: Option<String>) -> Self {
        self.hint = hint.or(self.hint);
        self
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.line, &self.column) {
            (Some(line), Some(column)) => write!(f, "line {line}, column `{column}`: ")?,
            (Some(line), None) => write!(f, "line {line}: ")?,
            (None, Some(column)) => write!(f, "column `{column}`: ")?,
            (None, None) => {}
        }
        write!(f, "{}", self.fault)?;
        if !self.also.is_empty() {
            let lines: Vec<_> = self.also.iter().map(usize::to_string).collect();
            write!(f, "; also in line{} {}", if lines.len() == 1 { "" } else { "s" }, lines.join(", "))?;
            if self.more > 0 {
                write!(f, " and {} more", self.more)?;
            }
        }
        self.hint.as_ref().map_or(Ok(()), |hint| write!(f, " ({hint})"))
    }
}

impl fmt::Display for RecordError {
    /// One line for each problem: `run.csv: line 7, column `phi`: found `abc`, expected a number (hint)`; of very many the
    /// first, and how many there are beyond.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const SHOWN: usize = 20;
        for (k, problem) in self.problems.iter().take(SHOWN).enumerate() {
            let newline = if k == 0 { "" } else { "\n" };
            write!(f, "{newline}{}: {problem}", self.file)?;
        }
        match self.problems.len().saturating_sub(SHOWN) {
            0 => Ok(()),
            1 => write!(f, "\n{}: 1 more problem", self.file),
            more => write!(f, "\n{}: {more} more problems", self.file),
        }
    }
}

impl std::error::Error for RecordError {}

/// What there is to choose from, for a message: the first dozen names, or fewer long ones, and how many there are beyond.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Names {
    /// The first names.
    pub shown: Vec<String>,
    /// How many follow.
    pub more: usize,
}

impl Names {
    pub(crate) fn new<'a>(names: impl IntoIterator<Item = &'a str>) -> Self {
        const SHOWN: usize = 12;
        const LENGTH: usize = 300;
        let (mut shown, mut more, mut length) = (Vec::new(), 0, 0);
        for name in names {
            let name = if more == 0 && shown.len() < SHOWN { excerpt(name) } else { String::new() };
            length += name.chars().count();
            if more == 0 && shown.len() < SHOWN && length <= LENGTH { shown.push(name) } else { more += 1 }
        }
        Self { shown, more }
    }
}

impl fmt::Display for Names {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.shown.is_empty() {
            return f.write_str("none");
        }
        write!(f, "`{}`", self.shown.join("`, `"))?;
        if self.more > 0 { write!(f, " and {} more", self.more) } else { Ok(()) }
    }
}

/// Text from a file as a message may show it: short, in one line, without control characters.
pub(crate) fn excerpt(text: &str) -> String {
    const LONGEST: usize = 40;
    let text = text.trim();
    let mut shown: String =
        text.chars().take(LONGEST).map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c }).collect();
    if text.chars().nth(LONGEST).is_some() {
        shown.push('…');
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_problem_reads_as_one_line() {
        let mut problem = Fault::NotANumber("abc".into()).at(7).column("phi [deg]").hint("write NaN for a gap");
        problem.also = vec![9, 12];
        problem.more = 40;
        let error = RecordError { file: "run.csv".into(), problems: vec![problem, Fault::NoRows.anywhere()] };
        assert_eq!(
            error.to_string(),
            "run.csv: line 7, column `phi [deg]`: found `abc`, expected a number; also in lines 9, 12 and 40 more \
             (write NaN for a gap)\nrun.csv: there are no rows below the header"
        );
    }

    #[test]
    fn text_of_a_file_is_shown_short_and_harmless() {
        assert_eq!(excerpt(" a\u{1b}[31m\n "), "a\u{fffd}[31m");
        assert_eq!(excerpt(&"x".repeat(1000)).chars().count(), 41);
    }
}
