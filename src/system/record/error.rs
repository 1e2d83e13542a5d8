//! What a user is told about a record that cannot be used: file, line, column, what was found, what was expected.

use super::channel::Role;
use super::grid::Mark;
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
    /// Line as an editor counts them, from 1, or sample of a file that has no lines; `None` when the problem is not in one of them.
    pub line: Option<usize>,
    /// What is counted: `line`, or `sample`.
    pub place: &'static str,
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
        Problem {
            line: None,
            place: "line",
            column: None,
            fault: Box::new(self),
            also: Vec::new(),
            more: 0,
            hint: None,
        }
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
            (Some(line), Some(column)) => write!(f, "{} {line}, column `{column}`: ", self.place)?,
            (Some(line), None) => write!(f, "{} {line}: ", self.place)?,
            (None, Some(column)) => write!(f, "column `{column}`: ")?,
            (None, None) => {}
        }
        write!(f, "{}", self.fault)?;
        if !self.also.is_empty() {
            let lines: Vec<_> = self.also.iter().map(usize::to_string).collect();
            write!(f, "; also in {}{} {}", self.place, if lines.len() == 1 { "" } else { "s" }, lines.join(", "))?;
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

/// The kinds of problems.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Fault {
    /// The operating system refuses.
    #[error("the file cannot be read: {0}")]
    Unreadable(String),
    /// The operating system refuses.
    #[error("the file cannot be written: {0}")]
    Unwritable(String),
    /// A directory where a file is wanted.
    #[error("this is a directory, expected a file with columns of numbers")]
    Directory,
    /// A device or socket: it might never end.
    #[error("this is neither a file nor a pipe")]
    Device,
    /// A pipe with a name: reading waits until somebody writes.
    #[error(
        "this is a named pipe, from which reading may wait for ever, expected a file; `cat PIPE | fdm .. /dev/stdin` reads one"
    )]
    NamedPipe,
    /// Larger than this version reads.
    #[error("the file is larger than the limit of {} GiB", .0 >> 30)]
    TooLarge(u64),
    /// Bytes that are not UTF-8.
    #[error("the file is not UTF-8 text")]
    NotText,
    /// A log or data file of which nothing can be read.
    #[error("{0}")]
    Unopened(String),
    /// A log or data file that is damaged.
    #[error("the {format} file is damaged: {places}; {rows} samples of {topics} topics were read")]
    Damaged {
        /// The format.
        format: &'static str,
        /// What is wrong, and where.
        places: String,
        /// Samples that were read, of all topics together.
        rows: usize,
        /// Topics that were read.
        topics: usize,
    },
    /// A log of several topics, and no map.
    #[error("this {format} file holds {count} tables with clocks of their own: {names}")]
    SeveralClocks {
        /// The format.
        format: &'static str,
        /// How many.
        count: usize,
        /// Their names.
        names: String,
    },
    /// A map that does not fit the file.
    #[error("--map-file: {0}")]
    Map(String),
    /// Nothing but blank lines and comments.
    #[error("the file holds no rows, expected a header with column names and rows of numbers")]
    Empty,
    /// No line holds names of the columns.
    #[error("no line above the rows holds names of the columns ({0}), expected such as `t [s], phi [deg]`")]
    NoHeader(String),
    /// A line too long to be a row, by the limit in bytes.
    #[error("the line is longer than the limit of {} KiB, expected rows of numbers", .0 >> 10)]
    LongLine(usize),
    /// A title of a column too long to be one, by its number of characters.
    #[error("a column name of {0} characters, expected a table with short names in its first row")]
    LongName(usize),
    /// Nothing below the header.
    #[error("there are no rows below the header")]
    NoRows,
    /// The model needs a channel that the file does not have.
    #[error("no column for the {role} `{channel}`; the columns are {columns}")]
    Missing {
        /// What the channel is to the model.
        role: Role,
        /// Name of the channel.
        channel: String,
        /// Names of all columns.
        columns: Names,
    },
    /// A column of nearly the name of an output that other runs measure.
    #[error("no column for the output `{output}`, and `{column}` looks like it")]
    Misspelt {
        /// Name of the output.
        output: String,
        /// Title of the column.
        column: String,
    },
    /// A value of the run that changes within it.
    #[error("`{0}` is a value that the run brings (`known`), and changes from {1} to {2}")]
    KnownChanges(String, String, String),
    /// A value for what the model does not have.
    #[error("the model has no `known {name}`; {}", if .there.shown.is_empty() { "it declares none".to_string() } else { format!("it declares {there}") })]
    UnknownKnown {
        /// The name.
        name: String,
        /// What there is.
        there: Names,
    },
    /// A value that is no number.
    #[error("the value {value} of `{name}` is not finite")]
    KnownValue {
        /// The name.
        name: String,
        /// The value.
        value: String,
    },
    /// A unit that is none, or of another kind.
    #[error("`{name}` is given in `{unit}`, and the model has it in `{expected}`")]
    KnownUnit {
        /// The name.
        name: String,
        /// The unit that was given.
        unit: String,
        /// That of the model.
        expected: String,
    },
    /// A run without the group that a param of the model is shared within.
    #[error("the run has no `{grouping}`, and the model has values `per group {grouping}`; {groups} are known")]
    NoGroup {
        /// The name of the grouping.
        grouping: String,
        /// The groups.
        groups: Names,
    },
    /// A group that no value of the model belongs to.
    #[error("the run is of the {grouping} `{group}`, of which the model has no value; {groups} are known")]
    UnknownGroup {
        /// The name of the grouping.
        grouping: String,
        /// The group.
        group: String,
        /// The groups.
        groups: Names,
    },
    /// Two columns of the same name.
    #[error("`{name}` stands for {count} columns, expected one")]
    Ambiguous {
        /// The name.
        name: String,
        /// How many columns have it.
        count: usize,
    },
    /// An option names a channel that the model does not have.
    #[error("{option} names the channel `{channel}`, which the model does not have; its channels are {channels}")]
    UnknownChannel {
        /// The option, as it is typed.
        option: &'static str,
        /// What it names.
        channel: String,
        /// What there is.
        channels: Names,
    },
    /// An option names an output that the model does not have.
    #[error("{option} {output}: the model has no such output; its outputs are {outputs}")]
    UnknownOutput {
        /// The option, as it is typed.
        option: &'static str,
        /// What it names.
        output: String,
        /// What there is.
        outputs: Names,
    },
    /// `--without-output` of one whose record drives the model.
    #[error("--without-output {0}: `measured({0})` drives the model, so that its record is needed")]
    LeftOutDrives(String),
    /// An option names a column that the file does not have.
    #[error("--map {channel}={column}: the file has no such column; the columns are {columns}")]
    UnknownColumn {
        /// The channel of the option.
        channel: String,
        /// The column of the option.
        column: String,
        /// Names of all columns.
        columns: Names,
    },
    /// Two `--map` for one channel.
    #[error("--map names the channel `{0}` more than once")]
    MappedTwice(String),
    /// `--zoh` or `--linear` of something that is not an input.
    #[error("{option} `{channel}`: only inputs go between samples, this is an output")]
    NotAnInput {
        /// The option.
        option: &'static str,
        /// What it names.
        channel: String,
    },
    /// `--zoh` and `--linear` of one input.
    #[error(
        "--zoh `{0}` and --linear `{0}`: an input is held between samples or goes in straight lines; leave one of them out"
    )]
    HeldAndLinear(String),
    /// A hold, by `--zoh` or the text, of an input whose derivative the model takes.
    #[error("`{0}` held between samples: an input that is held jumps, and the model takes its derivative `der({0})`")]
    HeldDerivative(String),
    /// `--every 0`.
    #[error("--every 0 would use no sample, expected 1 or more")]
    EveryNone,
    /// `--from` not below `--to`.
    #[error("--from {from} --to {to} holds no time")]
    Window {
        /// Lower end, as text.
        from: String,
        /// Upper end, as text.
        to: String,
    },
    /// `--begin` behind the first sample.
    #[error("--begin {begin} lies behind the first sample, at {first}: a run begins at its first sample or before")]
    BeginBehind {
        /// The beginning, as text.
        begin: String,
        /// Time of the first sample, as text.
        first: String,
    },
    /// `--begin` further in front of the record than can be meant.
    #[error(
        "--begin {begin} lies {times} times the length of the record in front of its first sample, at {first}: nothing of what begins there is left in it"
    )]
    BeginFar {
        /// The beginning, as text.
        begin: String,
        /// Time of the first sample, as text.
        first: String,
        /// The distance over the length of the record, as text.
        times: String,
    },
    /// `--begin` of a model without states and without time.
    #[error("--begin: the model has no states and does not know the time, so that its runs have no beginning")]
    BeginUntimed,
    /// A unit that cannot be understood.
    #[error("`{unit}` is not a unit that is known, and the {role} `{channel}` is to be read in `{expected}`")]
    UnknownUnit {
        /// What stands in the brackets.
        unit: String,
        /// What the channel is to the model.
        role: Role,
        /// The channel to be read from this column.
        channel: String,
        /// Its unit in the model.
        expected: String,
    },
    /// A unit of another kind of quantity.
    #[error(
        "the column is in `{found}`, which cannot be converted to `{expected}`, the unit of the {role} `{channel}`"
    )]
    Incompatible {
        /// Unit of the column.
        found: String,
        /// Unit of the channel.
        expected: String,
        /// What the channel is to the model.
        role: Role,
        /// The channel.
        channel: String,
    },
    /// The logarithm of a column for a channel that has a unit.
    #[error("a logarithm is a pure number, and the {role} `{channel}` is in `{unit}`")]
    LogarithmOfUnit {
        /// What the channel is to the model.
        role: Role,
        /// The channel.
        channel: String,
        /// Its unit in the model.
        unit: String,
    },
    /// The logarithm of a column that has a unit, without a word of the unit that it is taken in.
    #[error("the {role} `{channel}` is the logarithm of a column in `{unit}`, and a logarithm hangs on the unit")]
    LogarithmInWhich {
        /// What the channel is to the model.
        role: Role,
        /// The channel.
        channel: String,
        /// Unit of the column.
        unit: String,
    },
    /// A unit inside `log(...)` that cannot be understood.
    #[error("`{unit}` is not a unit that is known; the {role} `{channel}` is to be the logarithm of numbers in it")]
    UnitOfLogarithm {
        /// What the channel is to the model.
        role: Role,
        /// The channel.
        channel: String,
        /// What stands in the brackets.
        unit: String,
    },
    /// A row with too many or too few cells.
    #[error("found {found} cells, expected {expected} as in the header")]
    Ragged {
        /// Cells in the row.
        found: usize,
        /// Cells in the header.
        expected: usize,
    },
    /// Text where a number is wanted.
    #[error("found `{0}`, expected a number")]
    NotANumber(String),
    /// Something else in a column of dates or clock times.
    #[error(
        "found `{0}`, expected a date with a time as in `2026-05-01T12:34:56.7`, or a time as in `12:34:56.7`, as above it"
    )]
    NotAStamp(String),
    /// A value below what the instrument can tell.
    #[error("found `{0}`, a value below a limit, expected a number")]
    BelowLimit(String),
    /// The text of a model.
    #[error("this is a model, expected a record")]
    IsModel,
    /// A dose of a kind that is not read.
    #[error("found {found}: {why}")]
    Dose {
        /// What stands there.
        found: String,
        /// What it is.
        why: &'static str,
    },
    /// A column for the time that counts rows.
    #[error("column `{0}` counts rows, and nothing says how many there are in a second")]
    Counter(String),
    /// A column for the time whose unit is open.
    #[error(
        "column `{column}` states no unit, and its steps are {step}: too long for seconds, as for a clock in parts of them"
    )]
    DoubtfulUnit {
        /// Its title.
        column: String,
        /// The usual step.
        step: String,
    },
    /// Dates whose day and month cannot be told apart.
    #[error("the dates in column `{0}` may have the day or the month first")]
    DayOrMonth(String),
    /// A rate that is none.
    #[error("--rate {0}: expected a number above zero, in samples per second")]
    Rate(String),
    /// A rate beside times.
    #[error("--rate: column `{0}` holds the time")]
    RateBesideTime(String),
    /// A column of runs that is not there.
    #[error("--runs-by {column}: the file has no such column; the columns are {columns}")]
    UnknownRuns {
        /// The column.
        column: String,
        /// What there is.
        columns: Names,
    },
    /// Several runs where one is wanted.
    #[error("the file holds {0} runs, expected one")]
    SeveralRuns(usize),
    /// A number that has no logarithm.
    #[error("found `{0}`, expected a number above zero: its logarithm is read")]
    NotPositive(String),
    /// A number that would be read as zero.
    #[error("found `{0}`, which is not 0 but nearer to it than numbers reach (about 4.9e-324)")]
    Vanishing(String),
    /// A channel whose numbers are so large or so small that their squares are no numbers any more.
    #[error(
        "the {role} `{channel}` reaches {value}; squares and products of such values are no numbers any more, so that sizes from 1e-100 to \
         1e100 are read; use another unit, or look whether the values are right"
    )]
    Size {
        /// What the channel is to the model.
        role: Role,
        /// The channel.
        channel: String,
        /// Its largest absolute value, as text.
        value: String,
    },
    /// A number without bound.
    #[error("found `{0}`, expected a finite number")]
    Infinite(String),
    /// A decimal comma among decimal points, or the reverse.
    #[error("found `{found}`, expected a decimal {} as in line {line}", .mark.word())]
    MixedMarks {
        /// The cell.
        found: String,
        /// The mark used so far.
        mark: Mark,
        /// Where it was used first.
        line: usize,
    },
    /// `"1,234"` in a file with commas between its cells.
    #[error("found `{0}`, which may be a decimal comma or separate thousands; nothing in the file says which")]
    Thousands(String),
    /// An empty cell in the time column.
    #[error("the time is missing")]
    NoTime,
    /// Time that stands still or falls.
    #[error("the time {} from {before} in {place} {line} to {found}, expected a later time", if .before == .found { "does not rise" } else { "falls" })]
    NotRising {
        /// Time of the sample before.
        before: String,
        /// What is counted: lines of a text, samples of a log.
        place: &'static str,
        /// Its line.
        line: usize,
        /// Time in this line.
        found: String,
    },
    /// Times that differ in the file and not after conversion.
    #[error("the times cannot be told apart in double precision, expected steps that are not tiny against the record")]
    TimeResolution,
    /// No sample between `--from` and `--to`.
    #[error("no sample lies between --from and --to; the record goes from {first} to {last}")]
    NothingSelected {
        /// First time in the file.
        first: String,
        /// Last time in the file.
        last: String,
    },
    /// Fewer samples than a simulation needs.
    #[error("{found} sample selected, expected at least {expected} to simulate a model with states")]
    TooFew {
        /// Samples selected.
        found: usize,
        /// Samples needed.
        expected: usize,
    },
    /// A channel without a single value.
    #[error("the {role} `{channel}` has no value in any selected row")]
    NoValues {
        /// What the channel is to the model.
        role: Role,
        /// The channel.
        channel: String,
    },
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
