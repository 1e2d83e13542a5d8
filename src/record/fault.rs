//! The kinds of problems that a record can have, each with its sentence.

use super::channel::Role;
use super::dialect::Mark;
use super::error::Names;

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
    /// Larger than this version reads.
    #[error("the file is larger than the limit of {} GiB", .0 >> 30)]
    TooLarge(u64),
    /// Bytes that are not UTF-8.
    #[error("the file is not UTF-8 text")]
    NotText,
    /// Nothing but blank lines and comments.
    #[error("the file holds no rows, expected a header with column names and rows of numbers")]
    Empty,
    /// The first row holds numbers.
    #[error("the first row holds numbers ({0}), expected column names such as `t [s], phi [deg]`")]
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
    /// `--hold` of something that is not an input.
    #[error("--hold `{0}`: only inputs are held between samples, this is an output")]
    NotAnInput(String),
    /// `--hold` of an input whose derivative the model takes.
    #[error("--hold `{0}`: an input that is held jumps, and the model takes its derivative `der({0})`")]
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
    /// A number that has no logarithm.
    #[error("found `{0}`, expected a number above zero: its logarithm is read")]
    NotPositive(String),
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
    #[error("the time {} from {before} in line {line} to {found}, expected a later time", if .before == .found { "does not rise" } else { "falls" })]
    NotRising {
        /// Time of the sample before.
        before: String,
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
