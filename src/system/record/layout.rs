//! Where the table of a text is: its header is the line above the first long run of rows with one number of cells, whatever a logger writes above.
//! Rows of units, second rows of names and comments that are headers are told by what stands in them.

use super::clock;
use super::grid::{Delimiter, Rows, collapse};
use super::heading::{Heading, is_row_of_units, time_name};
use super::note::Note;
use super::text::{self, Cell};
use csv::ByteRecord;
use std::borrow::Cow;

/// Lines that are looked at: the longest heads of loggers have about 200.
const LOOKED_AT: usize = 500;
/// Bytes of these lines.
const BYTES: usize = 1 << 20;
/// Rows that make a run long.
const LONG: usize = 5;
/// Rows of names and units above the table.
const ROWS_OF_HEADER: usize = 4;
/// Lines of another kind between the header and the table, such as `[data]`.
const BETWEEN: usize = 2;

/// What the beginning of a text says.
#[derive(Debug)]
pub(crate) struct Layout {
    pub(crate) delimiter: Delimiter,
    /// Titles of the columns; empty where no line holds them.
    pub(crate) headings: Vec<Heading>,
    /// Line of the header, or of the first row where there is none.
    pub(crate) header_line: usize,
    /// Line of the first row.
    pub(crate) first_line: usize,
    /// Cells of most rows.
    pub(crate) width: usize,
    /// `name: value` lines above the header.
    pub(crate) about: Vec<(String, String)>,
    pub(crate) notes: Vec<Note>,
}

/// A line of the beginning.
struct Line {
    number: usize,
    cells: Vec<String>,
    comment: bool,
    /// Cells that hold numbers, dates or clock times.
    numbers: usize,
    texts: usize,
    /// Whether the first cell with anything in it is a number, date or clock time.
    begins_with_number: bool,
    units: bool,
}

impl Line {
    fn new(number: usize, cells: Vec<String>, comment: bool) -> Self {
        let mut line = Self { number, cells, comment, numbers: 0, texts: 0, begins_with_number: false, units: false };
        let mut first = true;
        for cell in &line.cells {
            let is_number = match text::scan(cell) {
                Cell::Gap if cell.trim().is_empty() => continue,
                Cell::Gap | Cell::Below(_) => false,
                Cell::Number(..) | Cell::Infinite | Cell::Vanishing => true,
                Cell::Text if clock::is_stamp(cell) => true,
                Cell::Text => {
                    line.texts += 1;
                    false
                }
            };
            line.numbers += usize::from(is_number);
            line.begins_with_number |= first && is_number;
            first = false;
        }
        line.units = line.texts > 0 && is_row_of_units(&line.cells);
        line
    }

    /// Cells up to the last with anything in it.
    fn trimmed(&self) -> usize {
        self.cells.len() - self.cells.iter().rev().take_while(|c| c.trim().is_empty()).count()
    }

    fn filled(&self) -> usize {
        self.cells.iter().filter(|c| !c.trim().is_empty()).count()
    }

    /// Whether it may be a row of a table: words in it are fewer than numbers, or stand behind one.
    fn is_row(&self) -> bool {
        !self.comment && !self.units && self.numbers > 0 && (self.begins_with_number || 2 * self.texts < self.filled())
    }

    /// Whether it may hold names or units: words, and no numbers but the unit 1.
    fn is_words(&self) -> bool {
        self.texts > 0 && (self.numbers == 0 || self.units)
    }

    /// Different names in it.
    fn distinct(&self) -> usize {
        let mut names: Vec<&str> = self.cells.iter().map(|c| c.trim()).filter(|c| !c.is_empty()).collect();
        names.sort_unstable();
        names.dedup();
        names.len()
    }
}

/// A run of rows with one number of cells.
struct Run {
    /// Among the lines of the beginning.
    start: usize,
    width: usize,
    rows: usize,
    numbers: usize,
}

/// One reading of the beginning.
struct Reading {
    delimiter: Delimiter,
    lines: Vec<Line>,
    run: Option<Run>,
    header: Header,
}

/// The lines of the header, by index.
#[derive(Default)]
struct Header {
    names: Vec<usize>,
    units: Option<usize>,
    aliases: Vec<usize>,
}

/// Finds the table in a text whose comments are blank and stand beside it, by line.
pub(crate) fn find(text: &str, comments: &[(usize, String)], only: Option<Delimiter>) -> Layout {
    let beginning = beginning(text);
    let delimiters = only.map_or(Delimiter::ALL.to_vec(), |d| vec![d]);
    let occurring = delimiters.into_iter().filter(|d| only.is_some() || *d == Delimiter::Comma || d.occurs(beginning));
    let mut readings: Vec<Reading> = occurring.map(|d| Reading::of(beginning, comments, d)).collect();
    let score = |r: &Reading| {
        let (numbers, rows, width) = r.run.as_ref().map_or((0, 0, 0), |run| (run.numbers, run.rows, run.width));
        // blanks stand beside other separators too
        (width > 1, !r.header.names.is_empty(), r.delimiter != Delimiter::Spaces, numbers, rows, width)
    };
    let best = readings.iter().map(score).max().unwrap_or_default();
    let by_rows = readings.iter().position(|r| score(r) == best).filter(|_| best.3 > 0);
    // nothing looks like rows: the first line decides, words with spaces between them last
    let widths = |r: &Reading| r.lines.iter().find(|l| !l.comment).map_or(0, Line::trimmed);
    let split = |r: &Reading| r.lines.iter().filter(|l| !l.comment).nth(1).is_none_or(|l| l.cells.len() > 1);
    let by_header = || readings.iter().position(|r| widths(r) > 1 && (r.delimiter != Delimiter::Spaces || split(r)));
    let plain = || readings.iter().position(|r| r.delimiter == Delimiter::Comma);
    let single = by_rows.filter(|_| best.0 || only.is_some()).or_else(by_header).or_else(plain).unwrap_or(0);
    readings.swap_remove(single).layout()
}

/// The lines that are looked at.
fn beginning(text: &str) -> &str {
    let (mut rows, mut end) = (0, 0);
    for line in text.split_inclusive(['\n', '\r']) {
        end += line.len();
        rows += usize::from(!line.trim().is_empty());
        if rows == LOOKED_AT || (rows > 1 && end > BYTES) {
            break;
        }
    }
    &text[..end]
}

/// The cells of one line.
fn cells(line: &str, delimiter: Delimiter) -> Vec<String> {
    let line = if delimiter == Delimiter::Spaces { Cow::Owned(collapse(line)) } else { Cow::Borrowed(line) };
    let mut record = ByteRecord::new();
    match Rows::new(&line, 0, delimiter).read(&mut record) {
        Ok(Some(_)) => text_of(&record),
        _ => Vec::new(),
    }
}

fn text_of(record: &ByteRecord) -> Vec<String> {
    record.iter().map(|c| String::from_utf8_lossy(c).trim().to_string()).collect()
}

impl Reading {
    fn of(beginning: &str, comments: &[(usize, String)], delimiter: Delimiter) -> Self {
        let text =
            if delimiter == Delimiter::Spaces { Cow::Owned(collapse(beginning)) } else { Cow::Borrowed(beginning) };
        let (mut lines, mut record) = (Vec::new(), ByteRecord::new());
        let mut rows = Rows::new(&text, 0, delimiter);
        while let Ok(Some(row)) = rows.read(&mut record) {
            lines.push(Line::new(row.line, text_of(&record), false));
        }
        let run = first_long_run(&lines);
        let below = run.as_ref().map_or(usize::MAX, |run| lines[run.start].number);
        let above = comments.iter().filter(|(number, _)| *number < below);
        let above: Vec<Line> = above.map(|(n, line)| Line::new(*n, cells(line, delimiter), true)).collect();
        let start = run.as_ref().map(|run| lines[run.start].number);
        lines.extend(above);
        lines.sort_by_key(|line| line.number);
        let run = run.map(|run| Run { start: lines.iter().position(|l| Some(l.number) == start).unwrap_or(0), ..run });
        let header = run.as_ref().map_or_else(Header::default, |run| header(&lines, run));
        Self { delimiter, lines, run, header }
    }

    fn layout(self) -> Layout {
        let Self { delimiter, lines, run, header } = self;
        let Some(run) = run else {
            // names and no rows, or rows without a number
            let first = lines.iter().find(|l| !l.comment);
            let headings: Vec<Heading> = first.iter().flat_map(|l| &l.cells).map(|c| Heading::new(c)).collect();
            let number = first.map_or(1, |l| l.number);
            let (width, about, notes) = (headings.len(), Vec::new(), Vec::new());
            return Layout { delimiter, headings, header_line: number, first_line: number + 1, width, about, notes };
        };
        let first_line = lines[run.start].number;
        let top = header.names.iter().chain(&header.units).chain(&header.aliases).copied().min().unwrap_or(run.start);
        let used = |k: &usize| header.names.contains(k) || header.aliases.contains(k) || header.units == Some(*k);
        let about: Vec<(String, String)> = lines[..top].iter().filter_map(said).collect();
        let mut notes = Vec::new();
        let below = |k: &usize| header.names.last().is_some_and(|names| k > names);
        let unused = |k: &usize| !used(k) && !lines[*k].comment;
        for k in (0..run.start).filter(unused).filter(below) {
            let line = lines[k].number;
            notes.push(Note::Layout(format!(
                "line {line}, below the names, holds neither units nor numbers and is left out"
            )));
        }
        let left = (0..run.start).filter(unused).filter(|k| !below(k)).count();
        if left > 0 {
            notes.push(Note::Layout(left_out(left, &about)));
        }
        let mut headings = titles(&lines, &header);
        for (heading, unit) in headings.iter_mut().zip(header.units.iter().flat_map(|k| &lines[*k].cells)) {
            *heading = std::mem::take(heading).with_unit(unit);
        }
        for upper in &header.aliases {
            for (heading, cell) in headings.iter_mut().zip(&lines[*upper].cells).filter(|(_, c)| !c.is_empty()) {
                let second = Heading::new(cell);
                heading.unit = heading.unit.take().or(second.unit);
                heading.format = heading.format.take().or(second.format);
                heading.alias = Some(second.name);
            }
        }
        if let Some(k) = header.units {
            notes.push(Note::Layout(format!("line {} holds the units of the columns", lines[k].number)));
        }
        if let Some(k) = header.aliases.first() {
            notes.push(Note::Layout(format!("line {} holds second names of the columns", lines[*k].number)));
        }
        if let Some(k) = header.names.iter().find(|k| lines[**k].comment) {
            notes
                .push(Note::Layout(format!("the comment in line {} holds the names of the columns", lines[*k].number)));
        }
        let header_line = header.names.last().map_or(first_line, |k| lines[*k].number);
        while headings.last().is_some_and(|h| h.title.is_empty()) {
            headings.pop();
        }
        Layout { delimiter, headings, header_line, first_line, width: run.width, about, notes }
    }
}

fn left_out(lines: usize, about: &[(String, String)]) -> String {
    const SHOWN: usize = 6;
    let told: Vec<String> = about.iter().take(SHOWN).map(|(name, value)| format!("{name}: {value}")).collect();
    let told = if told.is_empty() { String::new() } else { format!(" ({})", told.join("; ")) };
    format!("{lines} line(s) above the header are left out{told}")
}

/// What a line above the header says: a name and its value.
fn said(line: &Line) -> Option<(String, String)> {
    const LONGEST: usize = 60;
    let short = |text: &str| text.trim().chars().take(LONGEST).collect::<String>();
    let filled: Vec<&str> = line.cells.iter().map(String::as_str).filter(|c| !c.trim().is_empty()).collect();
    let (name, value) = match filled[..] {
        [one] => one.split_once([':', '=']).map(|(n, v)| (n.to_string(), v.to_string()))?,
        [name, ..] if text::scan(name) == Cell::Text => {
            (name.trim_end_matches([':', '=']).to_string(), filled[1..].join(" "))
        }
        _ => return None,
    };
    let (name, value) = (short(&name), short(&value));
    (!name.is_empty() && !value.is_empty()).then_some((name, value))
}

/// The first run of rows that is long, or as long as any.
fn first_long_run(lines: &[Line]) -> Option<Run> {
    let mut runs: Vec<Run> = Vec::new();
    // the runs that go on, by their number of cells
    let mut open: Vec<(usize, usize)> = Vec::new();
    for (k, line) in lines.iter().enumerate().filter(|(_, l)| !l.comment) {
        let width = line.cells.len();
        if line.is_row() {
            let at = open.iter().find(|(w, _)| *w == width).map(|(_, at)| *at);
            let at = at.unwrap_or_else(|| {
                runs.push(Run { start: k, width, rows: 0, numbers: 0 });
                open.push((width, runs.len() - 1));
                runs.len() - 1
            });
            runs[at].rows += 1;
            runs[at].numbers += line.numbers;
        } else if line.is_words() && (line.texts > 1 || line.filled() == width) {
            open.retain(|(w, _)| *w != width);
        }
    }
    let wide = runs.iter().any(|r| r.width > 1);
    runs.retain(|r| r.width > 1 || !wide);
    let best = runs.iter().map(|r| (r.numbers, r.rows)).max()?;
    let long = |r: &Run| r.rows >= LONG.min(best.1) && 4 * r.numbers >= best.0;
    let at = runs.iter().position(long)?;
    Some(runs.swap_remove(at))
}

/// The lines of the header above a run.
fn header(lines: &[Line], run: &Run) -> Header {
    let rows = || lines[run.start..].iter().filter(|l| l.is_row() && l.cells.len() == run.width);
    let width = rows().map(Line::trimmed).max().unwrap_or(run.width);
    let fits = |l: &Line| {
        l.is_words() && l.cells.len() >= width && l.trimmed() <= run.width.max(width) && (l.trimmed() > 1 || width == 1)
    };
    let (mut block, mut between) = (Vec::new(), 0);
    for k in (0..run.start).rev() {
        let line = &lines[k];
        // names of channels may be numbers where units stand below them
        let above_units = || block.last().is_some_and(|k: &usize| lines[*k].units) && line.cells.len() >= width;
        if fits(line) || line.texts > 0 && !line.begins_with_number && !line.comment && above_units() {
            block.push(k);
            if block.len() == ROWS_OF_HEADER {
                break;
            }
        } else if !line.comment {
            between += 1;
            if !block.is_empty() || between > BETWEEN {
                break;
            }
        }
    }
    if block.is_empty() {
        // a header of another length than the rows, which are then told
        let above = lines[..run.start].iter().rposition(|l| !l.comment);
        let near = |k: &usize| {
            let l = &lines[*k];
            l.is_words()
                && l.trimmed() > 1
                && (l.trimmed().abs_diff(width) <= 2 || k + 1 == run.start && l.trimmed() > width)
        };
        return Header { names: above.filter(near).into_iter().collect(), ..Header::default() };
    }
    of_block(lines, block, width)
}

/// Tells names from units in the lines above a table, the nearest first.
fn of_block(lines: &[Line], mut block: Vec<usize>, width: usize) -> Header {
    let of_units = (0..block.len()).filter(|at| block.len() > 1 && lines[block[*at]].units);
    let units = of_units.min_by_key(|at| (usize::MAX - lines[block[*at]].filled(), *at)).map(|at| block.remove(at));
    // a row of units ends the header: a line above names and units belongs to it where it is one of names
    let full = |k: &usize| lines[*k].filled() >= width && lines[*k].trimmed() >= width;
    let unique = |k: &usize| full(k) && lines[*k].distinct() >= width;
    let Some(nearest) = block.first().copied() else { return Header { units, ..Header::default() } };
    let upper = block.get(1).copied();
    let timed = |k: &usize| lines[*k].cells.iter().any(|c| time_name(c).is_some_and(|t| t.rank < 4));
    let (names, others) = match (unique(&nearest), block.iter().copied().find(|k| unique(k))) {
        (true, _) => (vec![nearest], &block[1..]),
        // two columns of one name below a line that says something else
        (false, Some(other)) if full(&nearest) && timed(&nearest) && !timed(&other) => (vec![nearest], &block[..0]),
        (false, Some(other)) => (vec![other], &block[..0]),
        // titles over several columns
        (false, _) => match upper.filter(|k| !unique(k) && !lines[*k].comment && lines[*k].filled() > 1) {
            Some(upper) => (vec![upper, nearest], &block[..0]),
            None => (vec![nearest], &block[..0]),
        },
    };
    let has_units = |k: &usize| lines[*k].cells.iter().any(|c| Heading::new(c).unit.is_some());
    let second = |k: &&usize| unique(k) && (width >= 4 || has_units(k));
    Header { names, units, aliases: others.iter().filter(second).take(1).copied().collect() }
}

/// The titles of the columns; those over several columns stand before the ones below.
fn titles(lines: &[Line], header: &Header) -> Vec<Heading> {
    let [upper, lower] = header.names[..] else {
        return header.names.iter().flat_map(|k| &lines[*k].cells).map(|c| Heading::new(c)).collect();
    };
    let mut over = "";
    let pairs = lines[lower].cells.iter().enumerate().map(|(k, below)| {
        let above = lines[upper].cells.get(k).map_or("", |c| c.trim());
        over = if above.is_empty() { over } else { above };
        match (over, below.trim()) {
            ("", below) => Heading::new(below),
            (_, "") => Heading::new(above),
            (over, below) => {
                Heading { alias: Some(Heading::new(below).name), ..Heading::new(&format!("{over} {below}")) }
            }
        }
    });
    pairs.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::text::decode;

    fn found(text: &str) -> Layout {
        let decoded = decode(text.as_bytes().to_vec()).unwrap();
        find(&decoded.text, &decoded.comments, None)
    }

    fn names(text: &str) -> (usize, Vec<String>) {
        let layout = found(text);
        (layout.first_line, layout.headings.iter().map(|h| h.name.clone()).collect())
    }

    #[test]
    fn delimiters_are_recognised() {
        let cases = [
            ("t,x\n0,1\n1,2\n", Delimiter::Comma),
            ("t;x\n1,5;2,5\n", Delimiter::Semicolon),
            ("t;x\n1;2\n", Delimiter::Semicolon),
            ("t\tx, y\tz\n0,5\t1\t2\n", Delimiter::Tab),
            ("t x\n0,1 2,5\n", Delimiter::Spaces),
            ("  t [s]   roll angle\n 0.0   1.0  3\n", Delimiter::Spaces),
            ("t|x\n0|1\n", Delimiter::Bar),
            ("Time (sec), Heater 1 (%)\n0,0\n1.5,0\n", Delimiter::Comma),
            ("t, x\n0, 1\n1, 2\n", Delimiter::Comma),
            ("t,x\n0,1\n1,2,3\nabc,4\n,\n5,\n", Delimiter::Comma),
            ("\"a;b\",t\n1,2\n", Delimiter::Comma),
            ("t,comment\n0,ok; x; y\n1,no; 5; 6\n", Delimiter::Comma),
            ("roll angle\n1\n2\n", Delimiter::Comma),
            ("t x\n", Delimiter::Spaces),
            ("a b;c\nx;y\n", Delimiter::Semicolon),
        ];
        for (text, expected) in cases {
            assert_eq!(found(text).delimiter, expected, "{text:?}");
        }
    }

    #[test]
    fn the_header_stands_above_the_first_long_run_of_rows() {
        let rows: String = (0..20).map(|k| format!("{},1,2\n", 0.1 * f64::from(k))).collect();
        for head in [
            "",
            "\"Product\",\"recorder\"\n\"rollPID\",\"45,80,40\"\n\"looptime\",\"125\"\n",
            "Starting...\nBeacons,1.5,2.5\nRate,100,Hz\n\n",
            "# made by hand\n",
            "[header]\nsatellites\n[column names]\n",
        ] {
            let (line, found) = names(&format!("{head}t,u,y\n{rows}"));
            assert_eq!(found, ["t", "u", "y"], "{head:?}");
            assert_eq!(line, head.lines().count() + 2, "{head:?}");
        }
        let (_, found) = names("[column names]\nt u y\n[data]\n0 1 2\n1 2 3\n");
        assert_eq!(found, ["t", "u", "y"]);
        // nothing holds names
        assert!(names("0,1,1\n1,1,2\n").1.is_empty());
    }

    #[test]
    fn rows_of_units_and_second_names_are_told_apart() {
        let heads =
            |text: &str| found(text).headings.into_iter().map(|h| (h.name, h.unit, h.alias)).collect::<Vec<_>>();
        let text = |t: &str| t.to_string();
        let some = |t: &str| Some(t.to_string());
        let expected = [(text("t"), some("s"), None), (text("V"), some("m/s"), None)];
        assert_eq!(heads("t,V\ns,m/s\n0,1\n1,2\n"), expected);
        assert_eq!(heads("t,V\n[s],[m/s]\n0,1\n1,2\n"), expected);
        let toa = "\"TOA5\",\"x\",\"CR1000\",\"1\"\n\"TIMESTAMP\",\"RECORD\",\"Batt\"\n\"TS\",\"RN\",\"Volts\"\n\"\",\"\",\"Min\"\n\"2026-01-01 00:00:00\",0,13.1\n\"2026-01-01 00:01:00\",1,13.2\n";
        let found = heads(toa);
        assert_eq!(
            (found[0].0.as_str(), found[2].0.as_str(), found[2].1.as_deref()),
            ("TIMESTAMP", "Batt", Some("Volts"))
        );
        let g1000 = "#yyy-mm-dd, hh:mm:ss, kt, deg\nLcl Date, Lcl Time, IAS, Pitch\n2026-03-04,23:55:00,100,1\n2026-03-04,23:55:01,101,1\n";
        assert_eq!(heads(g1000)[2], (text("IAS"), some("kt"), None));
        let merged = "A,,B,\ntime,conc,time,conc\n0,1,0,2\n1,1,1,2\n";
        assert_eq!(
            heads(merged).iter().map(|h| h.0.as_str()).collect::<Vec<_>>(),
            ["A time", "A conc", "B time", "B conc"]
        );
    }

    #[test]
    fn a_comment_above_the_rows_may_be_the_header() {
        assert_eq!(names("# made by\n# t x\n0 1\n").1, ["t", "x"]);
        assert_eq!(names("% t [s], phi [deg]\n0, 1\n").1, ["t", "phi"]);
        assert_eq!(names("%time,id,speed\n165,base,1\n166,base,2\n").1, ["time", "id", "speed"]);
        assert!(names("# made on Monday by hand\n0 1\n").1.is_empty());
    }
}
