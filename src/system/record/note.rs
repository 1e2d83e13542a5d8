//! What a careful reader of a record would mention.

use super::channel::Role;
use super::clock::Question;
use std::fmt;

/// Something true and cheap to find that may explain a poor fit.
#[derive(Debug, Clone, PartialEq)]
pub enum Note {
    /// Only one of column and channel states a unit; the numbers are taken as they are.
    UnitAssumed {
        /// What the channel is to the model.
        role: Role,
        /// The channel.
        channel: String,
        /// Title of the column.
        column: String,
        /// The unit that one of them states.
        unit: String,
        /// Whether the column states it and the model does not.
        stated_by_column: bool,
    },
    /// An output that the file does not have, or that has no value in it, where it need not.
    NotMeasured {
        /// The output.
        output: String,
    },
    /// A channel with one value in all samples.
    Constant {
        /// What the channel is to the model.
        role: Role,
        /// The channel.
        channel: String,
        /// The value, in the model's unit.
        value: f64,
        /// Samples that have it.
        samples: usize,
    },
    /// An input that moves only at samples, all at once, about which nobody said how it goes between them.
    TakenForHeld {
        /// The input.
        input: String,
    },
    /// Samples that are not compared, because a column says so.
    Masked {
        /// The output.
        output: String,
        /// The column.
        column: String,
        /// Values that are left out.
        samples: usize,
    },
    /// An angle whose jumps were taken out.
    Unwrapped {
        /// The output.
        output: String,
        /// The period.
        period: f64,
        /// How many jumps.
        jumps: usize,
    },
    /// Rows that repeat the row before to the letter; they are used once.
    Repeated {
        /// How many.
        rows: usize,
        /// Line of the first.
        line: usize,
    },
    /// The last line has no line end: the file may have been cut in its last number.
    OpenEnd,
    /// Inputs without a value in some samples: bridged in time, or the sample is not compared where time is no matter.
    Bridged {
        /// The input.
        input: String,
        /// Samples.
        gaps: usize,
        /// Whether the values come from the neighbours in time; otherwise these samples are not compared.
        in_time: bool,
    },
    /// What was done to take a run from a log, or left out.
    Taken(String),
    /// How the table stands in its file.
    Layout(String),
    /// A unit that is read as another spelling, or by what is wanted.
    Spelled {
        /// Title of the column.
        column: String,
        /// As the file has it.
        unit: String,
        /// What it was taken for.
        taken_for: String,
        /// What else it might be, and how that is said.
        or_else: Option<String>,
    },
    /// The unit of the time, where the file does not state it.
    TimeUnit {
        /// Title of the column.
        column: String,
        /// The unit.
        unit: String,
        /// Whether its size told it: it counts from 1970. Its name did otherwise.
        since: bool,
    },
    /// The times of a record that has none.
    Rate {
        /// Samples per second.
        rate: f64,
        /// Title of the column that counts them.
        column: Option<String>,
    },
    /// Rows of the instant before, whose values stand in one sample.
    Merged {
        /// How many.
        rows: usize,
    },
    /// One of the repeats, or of the runs, of a file.
    Part {
        /// Which, from 1.
        number: usize,
        /// Of how many.
        of: usize,
        /// What tells them apart: the column and its value; rows of one time otherwise.
        by: Option<(String, String)>,
    },
    /// Pauses behind which the run goes on as another one.
    Segments {
        /// How many pauses.
        pauses: usize,
        /// Runs that they leave.
        runs: usize,
        /// Samples of pieces too short for a beginning of their own.
        lost: usize,
    },
    /// Numbers or words that stand for missing values.
    Code {
        /// Title of the column.
        column: String,
        /// The number or word.
        code: String,
        /// How many.
        cells: usize,
        /// Whether nobody said so.
        guessed: bool,
    },
    /// Values below a limit.
    BelowLimit {
        /// Title of the column.
        column: String,
        /// How many.
        cells: usize,
    },
    /// Dates or clock times that were read as seconds.
    Clock {
        /// Title of the column.
        column: String,
        /// What times of two numbers were taken for.
        two: Option<Question>,
    },
    /// The run begins before the first sample that is compared.
    Begins {
        /// Where, as it stands in the file.
        begin: f64,
        /// Time of the first row of the file that is used.
        first: f64,
        /// Unit of both; empty where it is not known.
        unit: String,
        /// Whether inputs between the two have the values of that row.
        kept: bool,
        /// Rows of the file that drive the model and are not compared.
        rows: usize,
    },
    /// The first row is the model's time 0, though the file has it at another time.
    FirstRow {
        /// The time of that row in the file.
        first: f64,
        /// Its unit; empty where it is not known.
        unit: String,
        /// The states whose stated initial values hold there.
        states: Vec<String>,
        /// Whether the model's equations know the time.
        explicit: bool,
    },
    /// A pause much longer than the usual interval.
    Pause {
        /// Its length in the model's time unit.
        length: f64,
        /// When it begins, since the run began.
        at: f64,
        /// The usual interval.
        median: f64,
    },
}

impl Note {
    /// Its kind as one word, for programs.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::UnitAssumed { .. } => "unit",
            Self::NotMeasured { .. } => "not_measured",
            Self::Constant { .. } => "constant",
            Self::Masked { .. } => "masked",
            Self::Unwrapped { .. } => "unwrapped",
            Self::Repeated { .. } => "repeated",
            Self::TakenForHeld { .. } => "taken_for_held",
            Self::OpenEnd => "open_end",
            Self::Bridged { .. } => "bridged",
            Self::Taken(_) => "taken",
            Self::Clock { .. } => "clock",
            Self::Layout(_) | Self::Merged { .. } => "layout",
            Self::Spelled { .. } => "unit",
            Self::TimeUnit { .. } | Self::Rate { .. } => "time",
            Self::Part { .. } => "part",
            Self::Code { .. } | Self::BelowLimit { .. } => "missing",
            Self::Begins { .. } | Self::FirstRow { .. } => "begin",
            Self::Pause { .. } | Self::Segments { .. } => "pause",
        }
    }

    /// The channel that it is about, where it is about one.
    pub fn channel(&self) -> Option<&str> {
        match self {
            Self::UnitAssumed { channel, .. } | Self::Constant { channel, .. } => Some(channel),
            Self::NotMeasured { output } | Self::Masked { output, .. } | Self::Unwrapped { output, .. } => Some(output),
            Self::Bridged { input, .. } | Self::TakenForHeld { input } => Some(input),
            _ => None,
        }
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnitAssumed { role, channel, column, unit, stated_by_column: true } => {
                write!(
                    f,
                    "the {role} `{channel}` has no unit in the model; column `{column}` is taken as it is, in {unit}"
                )
            }
            Self::UnitAssumed { role, channel, column, unit, stated_by_column: false } => {
                write!(
                    f,
                    "column `{column}` states no unit; it is taken to be in {unit}, the unit of the {role} `{channel}`"
                )
            }
            Self::NotMeasured { output } => write!(f, "the output `{output}` is not measured in this run"),
            Self::Constant { role, channel, value, samples } => {
                write!(f, "the {role} `{channel}` never changes: {value} in all {samples} samples")
            }
            Self::TakenForHeld { input } => {
                write!(
                    f,
                    "the input `{input}` moves only at samples, all at once: it is taken for held between them (`--linear {input}` for straight lines)"
                )
            }
            Self::Masked { output, column, samples } => {
                write!(f, "{samples} value(s) of the output `{output}` are not compared: column `{column}` says so")
            }
            Self::Unwrapped { output, period, jumps } => {
                write!(f, "the output `{output}` wraps at {period}: {jumps} jump(s) are taken out")
            }
            Self::Repeated { rows, line } => {
                write!(f, "{rows} row(s) repeat the row before, first in line {line}; they are used once")
            }
            Self::OpenEnd => {
                write!(f, "the last line has no line end; if the file was cut, its last number may be short")
            }
            Self::Bridged { input, gaps, in_time: true } => {
                write!(f, "the input `{input}` has no value in {gaps} sample(s); its neighbours in time bridge them")
            }
            Self::Bridged { input, gaps, in_time: false } => {
                write!(f, "the input `{input}` has no value in {gaps} sample(s), which are not compared")
            }
            Self::Taken(what) => f.write_str(what),
            Self::Clock { column, two } => clock(f, column, *two),
            Self::Layout(what) => f.write_str(what),
            Self::Spelled { column, unit, taken_for, or_else } => {
                write!(f, "column `{column}`: `{unit}` is read as {taken_for}")?;
                or_else.as_ref().map_or(Ok(()), |other| write!(f, "; {other}"))
            }
            Self::TimeUnit { column, unit, since: false } => {
                write!(f, "column `{column}` is read in {unit}, as its name says")
            }
            Self::TimeUnit { column, unit, since: true } => {
                write!(f, "column `{column}` counts {unit} since 1970, as the size of its numbers says")
            }
            Self::Rate { rate, column: None } => write!(f, "the rows are {rate} samples a second (--rate)"),
            Self::Rate { rate, column: Some(column) } => {
                write!(f, "column `{column}` counts the samples, {rate} a second (--rate)")
            }
            Self::Merged { rows } => {
                write!(f, "{rows} row(s) have the time of the row before and values that it lacks: they are one sample")
            }
            Self::Part { number, of, by: Some((column, value)) } => {
                write!(f, "run {number} of {of}: rows whose column `{column}` holds {value}")
            }
            Self::Part { number, of, by: None } => {
                write!(f, "rows of one time are repeats: this is run {number} of {of}, each with one of them")
            }
            Self::Segments { pauses, runs, lost } => {
                let behind = "what drove the model meanwhile is not known";
                write!(f, "cut at {pauses} pause(s) into {runs} run(s) with beginnings of their own: {behind}")?;
                if *lost > 0 { write!(f, "; {lost} sample(s) between pauses are too few for one") } else { Ok(()) }
            }
            Self::Code { column, code, cells, guessed } => {
                write!(f, "column `{column}`: {cells} cell(s) hold {code}, read as missing")?;
                if *guessed { write!(f, " (--missing none keeps them)") } else { Ok(()) }
            }
            Self::BelowLimit { column, cells } => {
                write!(
                    f,
                    "column `{column}`: {cells} value(s) are below their limit, and nothing else is known of them (censored)"
                )
            }
            Self::Begins { begin, first, unit, kept, rows } => begins(f, (*begin, *first, unit), *kept, *rows),
            Self::FirstRow { first, unit, states, explicit } => first_row(f, (*first, unit), states, *explicit),
            Self::Pause { length, at, median } => {
                write!(f, "no sample for {length:.6} from {at:.6} on, where the usual interval is {median:.6}")
            }
        }
    }
}

fn clock(f: &mut fmt::Formatter<'_>, column: &str, two: Option<Question>) -> fmt::Result {
    write!(f, "column `{column}` holds dates or clock times, read as seconds since the first midnight")?;
    match two {
        Some(Question::HoursAndMinutes) => {
            write!(f, "; two numbers are hours and minutes (--map \"t={column} [mm:ss]\" for minutes and seconds)")
        }
        Some(Question::MinutesAndSeconds) => write!(f, "; two numbers are minutes and seconds"),
        _ => Ok(()),
    }
}

/// A time with its unit.
fn at(time: f64, unit: &str) -> String {
    if unit.is_empty() { time.to_string() } else { format!("{time} {unit}") }
}

fn begins(f: &mut fmt::Formatter<'_>, (begin, first, unit): (f64, f64, &str), kept: bool, rows: usize) -> fmt::Result {
    write!(f, "the run begins at {}, its first row is at {}", at(begin, unit), at(first, unit))?;
    if kept {
        write!(f, "; until then inputs have the values of that row")?;
    }
    if rows > 0 { write!(f, "; {rows} row(s) drive the model and are not compared") } else { Ok(()) }
}

fn first_row(f: &mut fmt::Formatter<'_>, (first, unit): (f64, &str), states: &[String], explicit: bool) -> fmt::Result {
    /// Most states that are named.
    const NAMED: usize = 3;
    let named: Vec<String> = states.iter().take(NAMED).map(|s| format!("`{s}`")).collect();
    let more = if states.len() > NAMED { ", ..." } else { "" };
    let holds = match (named.is_empty(), explicit) {
        (true, _) => "from which `t` counts".into(),
        (false, counts) => {
            let counts = if counts { ", and from which `t` counts" } else { "" };
            format!("where the stated initial values of {}{more} hold{counts}", named.join(", "))
        }
    };
    let option = if first > 0.0 { "--begin 0" } else { "--from 0" };
    write!(
        f,
        "its first row, at {}, is taken for the model's time 0, {holds}; if 0 of the record is meant, write {option}",
        at(first, unit)
    )
}
