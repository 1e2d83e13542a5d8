//! The text of a file: read whole, without byte order mark and comments, checked to be text; and its cells, each a number, a gap, or
//! something that is neither.

use super::error::{Fault, Problem};
use super::grid::Mark;
use fdm_readers::{InputError, open_input, unzipped};
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::OnceLock;

/// Largest file that is read; everything else costs memory in proportion to the file.
const LIMIT: u64 = 4 << 30;
/// Longest line that is read as a row: splitting costs ten times the memory of the cells of one row.
const LONGEST_LINE: usize = 1 << 20;

/// Reads a file or pipe whole.
pub(crate) fn load(path: &Path) -> Result<Vec<u8>, Problem> {
    let refused = |e: std::io::Error| Fault::Unreadable(reason(&e)).anywhere();
    if path == Path::new("-") {
        return standard_input().map(<[u8]>::to_vec).map_err(|e| Fault::Unreadable(e.clone()).anywhere());
    }
    let file = open_input(path).map_err(|e| match e {
        InputError::System(e) => refused(e),
        InputError::Directory => Fault::Directory.anywhere(),
        InputError::NamedPipe => Fault::NamedPipe.anywhere(),
        InputError::Device => Fault::Device.anywhere(),
    })?;
    let length = file.metadata().map_or(0, |about| about.len().min(LIMIT));
    let mut bytes = Vec::with_capacity(length as usize);
    file.take(LIMIT + 1).read_to_end(&mut bytes).map_err(refused)?;
    if bytes.len() as u64 > LIMIT { Err(Fault::TooLarge(LIMIT).anywhere()) } else { unpacked(bytes) }
}

/// A file on a disk, of a size that is read; none for pipes, and for what cannot be opened.
pub(crate) fn regular(path: &Path) -> Option<File> {
    let about = std::fs::metadata(path).ok()?;
    if about.is_file() && about.len() <= LIMIT { File::open(path).ok() } else { None }
}

/// The bytes of a text, also of a compressed one.
fn unpacked(bytes: Vec<u8>) -> Result<Vec<u8>, Problem> {
    match unzipped(&bytes, LIMIT) {
        None => Ok(bytes),
        Some(text) => text.map_err(|e| Fault::Unopened(e.to_string()).anywhere()),
    }
}

/// All of standard input, which can be read once only.
fn standard_input() -> Result<&'static [u8], &'static String> {
    static INPUT: OnceLock<Result<Vec<u8>, String>> = OnceLock::new();
    let read = || {
        let mut bytes = Vec::new();
        std::io::stdin().lock().take(LIMIT + 1).read_to_end(&mut bytes).map_err(|e| reason(&e))?;
        if bytes.len() as u64 > LIMIT {
            return Err(Fault::TooLarge(LIMIT).to_string());
        }
        unpacked(bytes).map_err(|p| p.to_string())
    };
    INPUT.get_or_init(read).as_deref()
}

/// What the operating system says, without its number.
pub(crate) fn reason(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "there is no such file".into(),
        std::io::ErrorKind::PermissionDenied => "permission denied".into(),
        _ => error.to_string(),
    }
}

/// Text with its comment lines blank, so that lines keep their numbers.
#[derive(Debug, Default)]
pub(crate) struct Decoded {
    pub(crate) text: String,
    /// Comments in front of the first rows, without their signs, by line.
    pub(crate) comments: Vec<(usize, String)>,
    /// How the file was written, where that is not UTF-8.
    pub(crate) encoding: Option<&'static str>,
}

/// Comments that may be headers stand in front of a table; more are never looked at.
const COMMENTS: usize = 400;

/// Bytes to text: UTF-8, UTF-16 by its mark, Latin-1 as Windows writes it.
pub(crate) fn decode(bytes: Vec<u8>) -> Result<Decoded, Problem> {
    let (mut text, encoding) = characters(bytes)?;
    if text.trim().is_empty() {
        return Err(Fault::Empty.anywhere());
    }
    let comments = blank_comments(&mut text)?;
    if text.trim().is_empty() {
        return Err(Fault::Empty.anywhere());
    }
    Ok(Decoded { text, comments, encoding })
}

fn characters(mut bytes: Vec<u8>) -> Result<(String, Option<&'static str>), Problem> {
    match bytes[..] {
        [0xff, 0xfe, ..] => return Ok((of_pairs(&bytes, u16::from_le_bytes), Some("UTF-16"))),
        [0xfe, 0xff, ..] => return Ok((of_pairs(&bytes, u16::from_be_bytes), Some("UTF-16"))),
        [0xef, 0xbb, 0xbf, ..] => drop(bytes.drain(..3)),
        _ => {}
    }
    match String::from_utf8(bytes) {
        Ok(text) => Ok((text, None)),
        Err(e) => {
            let (valid, bytes) = (e.utf8_error().valid_up_to(), e.as_bytes());
            // text has no bytes below the blank but tabulators, line ends and form feeds
            let binary = bytes.iter().any(|b| *b < b' ' && !matches!(b, b'\t' | b'\n' | b'\r' | 0x0c | 0x1a));
            if binary {
                let hint = "it looks like a binary file; export the record as CSV";
                return Err(Fault::NotText.at(line_of(bytes, valid)).hint(hint));
            }
            Ok((bytes.iter().map(|b| char::from(*b)).collect(), Some("Latin-1")))
        }
    }
}

/// UTF-16 behind its mark.
fn of_pairs(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> String {
    let units: Vec<u16> = bytes.as_chunks().0.iter().skip(1).map(|pair| unit(*pair)).collect();
    String::from_utf16_lossy(&units)
}

/// Makes comment lines spaces; gives the first of them.
fn blank_comments(text: &mut String) -> Result<Vec<(usize, String)>, Problem> {
    let mut bytes = std::mem::take(text).into_bytes();
    let (mut start, mut line, mut comments) = (0, 1, Vec::new());
    while start < bytes.len() {
        let end = bytes[start..].iter().position(|b| matches!(b, b'\n' | b'\r')).map_or(bytes.len(), |n| start + n);
        if end - start > LONGEST_LINE {
            return Err(Fault::LongLine(LONGEST_LINE).at(line));
        }
        let content = &mut bytes[start..end];
        let sign = content.iter().position(|b| !b.is_ascii_whitespace());
        if let Some(sign) = sign.filter(|sign| is_comment(&content[*sign..])) {
            if comments.len() < COMMENTS {
                let behind =
                    content[sign..].iter().position(|b| !matches!(b, b'#' | b'%')).map_or(end - start, |n| sign + n);
                comments.push((line, String::from_utf8_lossy(&content[behind..]).into_owned()));
            }
            content.fill(b' ');
        }
        let both = bytes.get(end) == Some(&b'\r') && bytes.get(end + 1) == Some(&b'\n');
        start = end + if both { 2 } else { 1 };
        line += 1;
    }
    // lines that were blanked are whole characters
    *text = String::from_utf8(bytes).map_err(|_| Fault::NotText.anywhere())?;
    Ok(comments)
}

/// `#N/A` at the beginning of a row is a cell.
fn is_comment(line: &[u8]) -> bool {
    match line.first() {
        Some(b'#') => {
            !line[1..].to_ascii_uppercase().starts_with(b"N/A") && !line[1..].to_ascii_uppercase().starts_with(b"NAN")
        }
        Some(b'%') => true,
        _ => false,
    }
}

/// Line, from 1, of a byte offset; `\n`, `\r\n` and `\r` end a line.
pub(crate) fn line_of(bytes: &[u8], offset: usize) -> usize {
    let before = &bytes[..offset.min(bytes.len())];
    let ends = before.iter().enumerate();
    1 + ends.filter(|(i, b)| **b == b'\n' || (**b == b'\r' && bytes.get(i + 1) != Some(&b'\n'))).count()
}

/// What a cell holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Cell {
    /// Nothing was measured: see [`GAPS`].
    Gap,
    /// A finite number, and the decimal mark that it shows.
    Number(f64, Option<Mark>),
    /// Infinite, or larger than double precision holds.
    Infinite,
    /// Below the limit that an instrument can tell, and that limit where it stands there: `<0.5`, `BLQ`.
    Below(Option<f64>),
    /// Not zero, but nearer to it than double precision holds.
    Vanishing,
    /// Anything else.
    Text,
}

/// Whether a text is that of a model: its first word that is no comment is `model`, with a name and a brace behind it.
pub(crate) fn is_model(text: &str) -> bool {
    let mut rest = text.trim_start();
    while let Some(comment) = rest.strip_prefix("//") {
        rest = comment.split_once('\n').map_or("", |(_, behind)| behind).trim_start();
    }
    let Some(named) = rest.strip_prefix("model ") else { return false };
    let behind = named.trim_start().trim_start_matches(|c: char| c.is_alphanumeric() || c == '_').trim_start();
    behind.starts_with('{') || behind.starts_with('"') && behind.contains('{')
}

/// Words that instruments and programs write where nothing was measured, in any case; an empty cell as well, and
/// every NaN with or without sign.
const GAPS: [&str; 17] = [
    ".", "n.a.", "na", "n/a", "#n/a", "null", "none", "missing", "-", "--", "?", "nan(ind)", "1.#qnan", "1.#ind",
    "1.#snan", "#nan", "",
];
/// Words that laboratories write where an amount was below what they can tell, in any case; so are numbers behind `<`.
const BELOW: [&str; 10] = ["blq", "bql", "bloq", "blod", "bdl", "nd", "n.d.", "<lod", "<loq", "<lloq"];
const INFINITE: [&str; 4] = ["inf", "infinity", "1.#inf", "∞"];
/// Longest text that is looked at twice; no number is written with more characters.
const LONGEST: usize = 1100;

/// Reads a cell. Numbers may have a decimal point or comma, an exponent with `e` or `d`, and any minus sign.
pub(crate) fn scan(cell: &str) -> Cell {
    let text = cell.trim();
    match text.parse::<f64>() {
        Ok(value) if value.is_nan() => Cell::Gap,
        Ok(value) if value.is_infinite() => Cell::Infinite,
        Ok(0.0) if vanishes(text) => Cell::Vanishing,
        Ok(value) => Cell::Number(value, text.contains('.').then_some(Mark::Point)),
        Err(_) if text.len() <= LONGEST => scan_unusual(text),
        Err(_) => Cell::Text,
    }
}

fn scan_unusual(text: &str) -> Cell {
    let unquoted = text.strip_prefix('"').and_then(|t| t.strip_suffix('"')).unwrap_or(text).trim();
    let lower = unquoted.to_lowercase().replace('\u{2212}', "-");
    let unsigned = lower.strip_prefix(['+', '-']).unwrap_or(&lower);
    if GAPS.contains(&lower.as_str()) || GAPS.contains(&unsigned) && !unsigned.is_empty() {
        return Cell::Gap;
    }
    if INFINITE.contains(&unsigned) {
        return Cell::Infinite;
    }
    if let Some(Cell::Number(limit, _)) = lower.strip_prefix('<').map(scan) {
        return Cell::Below(Some(limit));
    }
    if BELOW.contains(&lower.as_str()) {
        return Cell::Below(None);
    }
    let mark = if lower.contains(',') { Some(Mark::Comma) } else { lower.contains('.').then_some(Mark::Point) };
    if mark == Some(Mark::Comma) && !is_decimal_comma(&lower) {
        return Cell::Text;
    }
    // Fortran writes 1.5D+03
    let plain = lower.replace(',', ".").replace('d', "e");
    match plain.parse::<f64>() {
        Ok(0.0) if vanishes(&plain) => Cell::Vanishing,
        Ok(value) if value.is_finite() => Cell::Number(value, mark),
        Ok(value) if value.is_infinite() && plain.contains(|c: char| c.is_ascii_digit()) => Cell::Infinite,
        _ => Cell::Text,
    }
}

/// Whether a text that was read as zero stands for something else: 1e-400.
fn vanishes(text: &str) -> bool {
    let mantissa = text.split(['e', 'E']).next().unwrap_or_default();
    mantissa.contains(|c: char| ('1'..='9').contains(&c))
}

/// One comma with a digit behind it, and no point.
fn is_decimal_comma(text: &str) -> bool {
    let mut parts = text.split(',');
    let fraction = parts.nth(1).unwrap_or("");
    parts.next().is_none() && !text.contains('.') && fraction.starts_with(|c: char| c.is_ascii_digit())
}

/// Whether the cell can only be meant as a number.
pub(crate) fn is_number(cell: &str) -> bool {
    matches!(scan(cell), Cell::Number(..))
}

/// Whether the comma of a number may separate thousands: `1,234`, and not `0,234` or `1,2`.
pub(crate) fn may_be_thousands(cell: &str) -> bool {
    let digits = cell.trim().trim_matches('"').trim_start_matches(['+', '-', '\u{2212}']);
    let Some((whole, rest)) = digits.split_once(',') else { return false };
    let all_digits = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
    (1..=3).contains(&whole.len())
        && !whole.starts_with('0')
        && rest.len() == 3
        && all_digits(whole)
        && all_digits(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_and_comments_are_blank_and_lines_keep_their_numbers() {
        let decoded = decode(b"\xef\xbb\xbf# by a logger\r\n\r\n % more\r\nt,x\r\n#N/A,1\r\n".to_vec()).unwrap();
        assert_eq!(decoded.text.trim_start(), "t,x\r\n#N/A,1\r\n");
        assert_eq!(decoded.comments, [(1, " by a logger".to_string()), (3, " more".to_string())]);
        assert_eq!(line_of(decoded.text.as_bytes(), decoded.text.find('t').unwrap()), 4);
        assert_eq!([2, 5, 99].map(|offset| line_of(b"a\rb\r\nc\nd", offset)), [2, 3, 4]);
    }

    #[test]
    fn other_encodings_are_read_and_told() {
        let read = |bytes: &[u8]| decode(bytes.to_vec()).map(|d| (d.text, d.encoding));
        assert_eq!(read(b"t,\xb0C\n0,1\n").unwrap(), ("t,°C\n0,1\n".to_string(), Some("Latin-1")));
        let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain("t,x\n".bytes().flat_map(|b| [b, 0])).collect();
        assert_eq!(read(&wide).unwrap(), ("t,x\n".to_string(), Some("UTF-16")));
        let problem = decode(b"t,x\n0,1\n0,\xb0\x00\n".to_vec()).unwrap_err();
        assert_eq!((problem.line, *problem.fault), (Some(3), Fault::NotText));
        assert_eq!(decode(b" \n\r\n# only\n".to_vec()).unwrap_err().fault.as_ref(), &Fault::Empty);
        assert_eq!(decode(Vec::new()).unwrap_err().fault.as_ref(), &Fault::Empty);
    }

    #[test]
    fn numbers_gaps_and_text_are_told_apart() {
        let number = |text| match scan(text) {
            Cell::Number(value, mark) => (value, mark),
            other => panic!("{text}: {other:?}"),
        };
        for (text, value) in
            [("1", 1.0), (" +2e3\t", 2000.0), ("-0", 0.0), ("\u{2212}7", -7.0), ("\"4\"", 4.0), ("1d2", 100.0)]
        {
            assert_eq!(number(text), (value, None), "{text}");
        }
        for (text, value) in [("1.5", 1.5), (".5", 0.5), ("5.", 5.0), ("1.5D-03", 0.0015), ("4.9e-324", 4.9e-324)] {
            assert_eq!(number(text), (value, Some(Mark::Point)), "{text}");
        }
        for (text, value) in [("1,5", 1.5), ("-,5", -0.5), ("1,5e-3", 0.0015), ("1,234", 1.234)] {
            assert_eq!(number(text), (value, Some(Mark::Comma)), "{text}");
        }
        for text in [
            "",
            "  ",
            "NaN",
            "nan",
            "-NaN",
            "-nan(ind)",
            "NA",
            "n/a",
            "#N/A",
            "null",
            "-",
            "--",
            "1.#QNAN",
            "\"\"",
            ".",
        ] {
            assert_eq!(scan(text), Cell::Gap, "{text}");
        }
        for text in ["inf", "-Inf", "Infinity", "1e999", "-1.#INF", "1,5e999"] {
            assert_eq!(scan(text), Cell::Infinite, "{text}");
        }
        for text in ["1e-400", "-0.1e-330", "1,5e-400", "1.5d-400"] {
            assert_eq!(scan(text), Cell::Vanishing, "{text}");
        }
        assert!(matches!(scan("0.0e-400"), Cell::Number(..)) && matches!(scan("1e-310"), Cell::Number(..)));
        for text in
            ["abc", "1.2.3", "1,2,3", "1,234.5", "0,", "1e", "12:30", "2024-01-01", "0x1F", "1 2", "e5", "+", "1_0"]
        {
            assert_eq!(scan(text), Cell::Text, "{text}");
        }
        assert_eq!(scan(&"9,".repeat(1 << 20)), Cell::Text);
    }

    #[test]
    fn thousands_are_suspected_only_where_they_can_be() {
        assert!(["1,234", "-12,345", "\"999,000\""].into_iter().all(may_be_thousands));
        assert!(!["0,234", "1,2", "1,2345", "1234,567", "1.5", "1,23e"].into_iter().any(may_be_thousands));
    }
}
