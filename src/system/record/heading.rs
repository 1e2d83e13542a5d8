//! Titles of columns: a name, a unit in brackets, behind a comma or in a row of its own, a second name; and units that stand in names of times.

use fdm_grammar::Unit;

/// The title of a column.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Heading {
    /// As it stands in the file.
    pub(crate) title: String,
    /// The title without the unit.
    pub(crate) name: String,
    /// What stands in the brackets at the end, or in a row of units.
    pub(crate) unit: Option<String>,
    /// How its dates or clock times are written, where the file says it.
    pub(crate) format: Option<String>,
    /// Its name in another row of names.
    pub(crate) alias: Option<String>,
}

impl Heading {
    /// Longest title that is accepted.
    pub(crate) const LONGEST: usize = 1000;

    /// A name with a unit that is known already.
    pub(crate) fn plain(name: &str, unit: Option<String>) -> Self {
        Self { title: name.into(), name: name.into(), unit, ..Self::default() }
    }

    /// `name [unit]`, `name (unit)`, or `name, unit` where that is one; brackets alone are a name, and so is an index at a name: `y[2]`,
    /// `A[1,2]`. Words for dates and clock times in brackets are their format.
    pub(crate) fn new(title: &str) -> Self {
        let title = title.trim();
        let title = title.strip_prefix('"').and_then(|t| t.strip_suffix('"')).unwrap_or(title).trim();
        if let Some((name, unit)) = behind_comma(title) {
            return Self { title: title.into(), name: name.into(), unit, ..Self::default() };
        }
        if let Some((name, unit)) = in_words(title).or_else(|| behind_bar(title)) {
            return Self { title: title.into(), name: name.into(), ..Self::default() }.with_unit(unit);
        }
        let split = opening(title).map(|at| (title[..at].trim_end(), title[at + 1..title.len() - 1].trim()));
        match split {
            // serial numbers and the like are no units
            Some((name, remark)) if !name.is_empty() && remark.contains(':') && !is_format(remark) => {
                Self { title: title.into(), ..Self::new(name) }
            }
            Some((name, unit)) if !name.is_empty() && !is_element(title, name, unit) => {
                let own = Self { title: title.into(), name: name.into(), ..Self::default() };
                own.with_unit(unit)
            }
            _ => Self { title: title.into(), name: title.into(), ..Self::default() },
        }
    }

    /// With what stands in brackets, or in a row of units.
    pub(crate) fn with_unit(self, unit: &str) -> Self {
        let unit = bare(unit);
        match unit {
            "" => self,
            unit if is_format(unit) => Self { format: self.format.or_else(|| Some(unit.into())), ..self },
            unit => Self { unit: self.unit.or_else(|| Some(unit.into())), ..self },
        }
    }

    /// Whether a text names the column: its title, name or second name.
    pub(crate) fn is(&self, text: &str) -> bool {
        self.title == text || self.name == text || self.alias.as_deref() == Some(text)
    }
}

/// Without the brackets around it.
fn bare(unit: &str) -> &str {
    let unit = unit.trim();
    let inside = |open, close| unit.strip_prefix(open).and_then(|u| u.strip_suffix(close));
    inside('[', ']').or_else(|| inside('(', ')')).filter(|u| !u.contains(['(', ')', '[', ']'])).unwrap_or(unit).trim()
}

/// `Temp, °F (LGR S/N: 1)`: a name, and behind the comma a unit that is known; a zone of time is none and left out.
fn behind_comma(title: &str) -> Option<(&str, Option<String>)> {
    let (name, rest) = title.split_once(", ")?;
    let unit = rest.split_once(" (").map_or(rest, |(unit, _)| unit).trim();
    let zone = ["GMT", "UTC"].iter().any(|z| unit.starts_with(z));
    let known = || !unit.starts_with(|c: char| c.is_ascii_digit()) && Unit::spelled(unit).is_ok();
    let plain = !name.is_empty() && !name.contains(['[', '(']);
    (plain && (zone || known())).then(|| (name.trim(), Some(unit.to_string()).filter(|_| !zone)))
}

/// `CH1 in V`, `in s`: a name, and a unit that is known.
fn in_words(title: &str) -> Option<(&str, &str)> {
    let (name, unit) = title.rsplit_once(" in ").or_else(|| Some((title, title.strip_prefix("in ")?)))?;
    (!unit.contains(' ') && Unit::spelled(unit).is_ok()).then(|| (name.trim(), unit))
}

/// `speed|"m/s"|0|50|10`: a name and a unit before the range and the rate of a channel.
fn behind_bar(title: &str) -> Option<(&str, &str)> {
    let mut parts = title.split('|').map(|p| p.trim().trim_matches('"'));
    let (name, unit) = (parts.next().filter(|n| !n.is_empty())?, parts.next()?);
    (parts.count() > 1).then_some((name, unit))
}

/// Whether a title is that of an element of a vector or matrix: no unit stands close to its name and is a number.
fn is_element(title: &str, name: &str, index: &str) -> bool {
    let part = |p: &str| !p.trim().is_empty() && p.trim().bytes().all(|b| b.is_ascii_digit());
    title[name.len()..].starts_with('[') && index.split(',').all(part)
}

/// Offset of the bracket that is closed by the last character.
fn opening(title: &str) -> Option<usize> {
    let (open, close) = match title.chars().last()? {
        ']' => ('[', ']'),
        ')' => ('(', ')'),
        _ => return None,
    };
    let mut depth = 0_usize;
    for (at, c) in title.char_indices().rev() {
        if c == close {
            depth += 1;
        } else if c == open {
            depth -= 1;
            if depth == 0 {
                return Some(at);
            }
        }
    }
    None
}

/// Words that say how dates and clock times are written, and no unit: `hh:mm:ss`, `yyyy-mm-dd`, `UTC`.
pub(crate) fn is_format(text: &str) -> bool {
    let lower = text.trim().to_lowercase();
    let words =
        ["utc", "gmt", "local", "local time", "timestamp", "datetime", "date", "ts", "iso", "iso8601", "iso 8601"];
    let letters = || lower.chars().filter(|c| c.is_alphabetic());
    let pattern = lower.contains([':', '/', '-', '.', ' '])
        && letters().all(|c| matches!(c, 'h' | 'm' | 's' | 'y' | 'd' | 'f' | 'x' | 't' | 'z' | 'p' | 'a' | 'n' | 'o'))
        && ["hh", "mm", "yy", "dd", "ss"].iter().filter(|w| lower.contains(**w)).count() >= 2;
    words.contains(&lower.as_str()) || lower.starts_with("utc") || lower.starts_with("gmt") || pattern
}

/// Words in a row of units that are none and say so: kinds of values.
const KINDS: [&str; 12] =
    ["-", "--", "n/a", "bool", "boolean", "enum", "text", "string", "ident", "int", "float", "rn"];

/// What a row of units holds in a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum UnitCell {
    Nothing,
    /// In brackets, or a unit that is known.
    Unit,
    /// A unit of time, or the format of one.
    Time,
    Kind,
    Other,
}

fn unit_cell(cell: &str) -> UnitCell {
    let (own, inside) = (cell.trim(), bare(cell));
    let lower = inside.to_lowercase();
    match Unit::spelled(inside) {
        _ if inside.is_empty() => UnitCell::Nothing,
        _ if is_format(inside) => UnitCell::Time,
        _ if KINDS.contains(&lower.as_str()) => UnitCell::Kind,
        Ok(unit) if unit.unit.same_dimension(&Unit::second()) && inside != "t" => UnitCell::Time,
        Ok(_) => UnitCell::Unit,
        // words that stand beside units, such as those of temperatures and counts
        Err(_) if own.len() != inside.len() => UnitCell::Unit,
        Err(_) => UnitCell::Other,
    }
}

/// Whether cells are a row of units: none is anything else, and one is a unit or format of time, or all are in brackets, or the first is
/// empty. Names of channels such as `t,V,A` are units too.
pub(crate) fn is_row_of_units(cells: &[String]) -> bool {
    let kinds: Vec<UnitCell> = cells.iter().map(|c| unit_cell(c)).collect();
    let count = |kind| kinds.iter().filter(|k| **k == kind).count();
    let (units, times) = (count(UnitCell::Unit), count(UnitCell::Time));
    let others = count(UnitCell::Other) + count(UnitCell::Kind);
    let filled = kinds.len() - count(UnitCell::Nothing);
    let bracketed = || cells.iter().filter(|c| !c.trim().is_empty()).all(|c| bare(c).len() < c.trim().len());
    let unlabelled = || kinds.first() == Some(&UnitCell::Nothing) && count(UnitCell::Other) == 0;
    units + times > 0 && (units + times) > others && filled > 0 && (times > 0 || bracketed() || unlabelled())
}

/// What a name says of a column of times.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TimeName {
    /// `t` and `time` go before what is only like them: 0, 1, ...
    pub(crate) rank: usize,
    /// The unit that the name ends with.
    pub(crate) unit: Option<&'static str>,
}

/// Endings of names that are units of time, the longer ones first.
const ENDINGS: [(&str, &str); 28] = [
    ("nanoseconds", "ns"),
    ("microseconds", "us"),
    ("milliseconds", "ms"),
    ("seconds", "s"),
    ("minutes", "min"),
    ("micros", "us"),
    ("millis", "ms"),
    ("nanos", "ns"),
    ("hours", "h"),
    ("days", "d"),
    ("nsecs", "ns"),
    ("usecs", "us"),
    ("msecs", "ms"),
    ("nsec", "ns"),
    ("usec", "us"),
    ("msec", "ms"),
    ("secs", "s"),
    ("mins", "min"),
    ("sec", "s"),
    ("min", "min"),
    ("hrs", "h"),
    ("hr", "h"),
    ("ns", "ns"),
    ("us", "us"),
    ("µs", "us"),
    ("ms", "ms"),
    ("s", "s"),
    ("h", "h"),
];

/// What columns of times are called.
const TIMES: [&str; 21] = [
    "time",
    "timestamp",
    "time_stamp",
    "times",
    "elapsed",
    "elapsed_time",
    "time_elapsed",
    "totaltime",
    "datetime",
    "date_time",
    "timeofday",
    "gps_time",
    "gpstime",
    "utc_time",
    "utc",
    "zeit",
    "temps",
    "stamp",
    "lcl_time",
    "log_time",
    "clock",
];

/// Whether a column of this name holds times, and in what unit.
pub(crate) fn time_name(name: &str) -> Option<TimeName> {
    let lower =
        name.trim().trim_start_matches(['%', '#', '_', '$', '.']).to_lowercase().replace([' ', '-', '.', '/'], "_");
    let lower = lower.trim_end_matches('_');
    let rank = |base: &str| match base {
        "t" => Some(3),
        "time" => Some(3),
        _ if TIMES.contains(&base) => Some(4),
        _ => None,
    };
    if name == "t" {
        return Some(TimeName { rank: 0, unit: None });
    }
    if lower == "time" {
        return Some(TimeName { rank: 1, unit: None });
    }
    if name == "T" {
        return Some(TimeName { rank: 2, unit: None });
    }
    if let Some(rank) = rank(lower).filter(|_| lower != "t") {
        return Some(TimeName { rank, unit: None });
    }
    for (ending, unit) in ENDINGS {
        let Some(base) = lower.strip_suffix(ending) else { continue };
        let joined = base.strip_suffix('_');
        if base.is_empty() && ending.len() > 4 {
            return Some(TimeName { rank: 4, unit: Some(unit) });
        }
        let found = joined.and_then(rank).or_else(|| rank(base).filter(|_| base.len() > 1 && ending.len() > 1));
        if let Some(rank) = found {
            return Some(TimeName { rank, unit: Some(unit) });
        }
    }
    None
}

/// Names of columns that count rows.
pub(crate) fn counts_rows(name: &str) -> bool {
    let lower = name.trim().to_lowercase().replace(' ', "_");
    let names = [
        "sample",
        "samples",
        "index",
        "idx",
        "frame",
        "frames",
        "count",
        "counter",
        "n",
        "no",
        "no.",
        "nr",
        "row",
        "scan",
        "record",
        "rec",
        "point",
        "tick",
        "ticks",
        "loopiteration",
        "iteration",
        "step",
        "seq",
        "id",
        "sample_no",
        "sample_number",
        "sampleno",
        "recnbr",
        "rn",
        "frame_number",
        "line",
    ];
    names.contains(&lower.as_str())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heading(title: &str) -> (String, Option<String>) {
        let h = Heading::new(title);
        (h.name, h.unit)
    }

    #[test]
    fn titles_split_into_name_and_unit() {
        let pair = |name: &str, unit: Option<&str>| (name.to_string(), unit.map(str::to_string));
        assert_eq!(heading("phi [deg]"), pair("phi", Some("deg")));
        assert_eq!(heading(" Heater 1 (%) "), pair("Heater 1", Some("%")));
        assert_eq!(heading("a(m/s^(2))"), pair("a", Some("m/s^(2)")));
        assert_eq!(heading(" \"q [rad/s]\""), pair("q", Some("rad/s")));
        assert_eq!(heading("[s]"), pair("[s]", None));
        assert_eq!(heading("CH1 in V"), pair("CH1", Some("V")));
        assert_eq!(heading("change in speed"), pair("change in speed", None));
        assert_eq!(heading("speed|\"m/s\"|0.0|50.0|10"), pair("speed", Some("m/s")));
        assert_eq!(heading("a|b"), pair("a|b", None));
        assert_eq!(heading("x []"), pair("x", None));
        assert_eq!(heading("t_s"), pair("t_s", None));
        assert_eq!(heading("y[2]"), pair("y[2]", None));
        assert_eq!(heading("y[2] [deg]"), pair("y[2]", Some("deg")));
        assert_eq!(heading("act.Y[1,2] (m)"), pair("act.Y[1,2]", Some("m")));
        assert_eq!(heading("n [1]"), pair("n", Some("1")));
        assert_eq!(heading("a) b]"), pair("a) b]", None));
        assert_eq!(heading("Temp, °F (LGR S/N: 9, LBL: a)"), pair("Temp", Some("°F")));
        assert_eq!(heading("Date Time, GMT-05:00"), pair("Date Time", None));
        assert_eq!(heading("y [deg] (LGR S/N: 9)"), pair("y", Some("deg")));
        assert_eq!(heading("y, z [deg]"), pair("y, z", Some("deg")));
    }

    #[test]
    fn formats_are_no_units() {
        for text in ["hh:mm:ss", "yyyy-mm-dd", "HH:MM", "UTC", "dd/mm/yyyy hh:mm:ss", "mm:ss.fff"] {
            assert!(is_format(text), "{text}");
        }
        for text in ["m/s", "ms", "mm", "h", "1/h", "deg/s", "mm/s"] {
            assert!(!is_format(text), "{text}");
        }
        let time = Heading::new("Time (hh:mm:ss)");
        assert_eq!((time.name.as_str(), time.unit, time.format.as_deref()), ("Time", None, Some("hh:mm:ss")));
    }

    #[test]
    fn rows_of_units_are_told_from_rows_of_names() {
        let row = |text: &str| is_row_of_units(&text.split(',').map(String::from).collect::<Vec<_>>());
        for text in [
            "s,V,°C",
            "[s],[rad/s],[1]",
            "TS,RN,Volts,Deg C",
            "yyy-mm-dd,hh:mm:ss,ident,kt",
            "h,mg/L",
            ",V,A",
            "s,-,deg",
        ] {
            assert!(row(text), "{text}");
        }
        for text in ["t,V,A", "time,u,y", "t,x", "Lcl Date,Lcl Time,IAS", "Smp,Avg", "a,b", "T,V"] {
            assert!(!row(text), "{text}");
        }
    }

    #[test]
    fn times_are_known_by_their_names() {
        let unit = |name: &str| time_name(name).map(|t| t.unit);
        for (name, expected) in [
            ("time_ms", "ms"),
            ("t_us", "us"),
            ("TimeUS", "us"),
            ("timestamp_ns", "ns"),
            ("millis", "ms"),
            ("elapsed_sec", "s"),
            ("t_s", "s"),
            ("time_usec", "us"),
        ] {
            assert_eq!(unit(name), Some(Some(expected)), "{name}");
        }
        for name in ["time", "Timestamp", "times", "%time", "T"] {
            assert_eq!(unit(name), Some(None), "{name}");
        }
        for name in ["mean", "ns", "alphas", "terms", "torque_s", "u", "ms"] {
            assert_eq!(unit(name), None, "{name}");
        }
    }
}
