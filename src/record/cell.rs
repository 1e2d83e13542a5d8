//! One cell of a table: a number, a gap, or something that is neither.

use super::dialect::Mark;

/// What a cell holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Cell {
    /// Nothing was measured: see [`GAPS`].
    Gap,
    /// A finite number, and the decimal mark that it shows.
    Number(f64, Option<Mark>),
    /// Infinite, or larger than double precision holds.
    Infinite,
    /// Anything else.
    Text,
}

/// Words that instruments and programs write where nothing was measured, in any case; an empty cell as well, and
/// every NaN with or without sign.
const GAPS: [&str; 15] = [
    "na", "n/a", "#n/a", "null", "none", "missing", "-", "--", "?", "nan(ind)", "1.#qnan", "1.#ind", "1.#snan", "#nan",
    "",
];
const INFINITE: [&str; 4] = ["inf", "infinity", "1.#inf", "∞"];
/// Longest text that is looked at twice; no number is written with more characters.
const LONGEST: usize = 1100;

/// Reads a cell. Numbers may have a decimal point or comma, an exponent with `e` or `d`, and any minus sign.
pub(crate) fn scan(cell: &str) -> Cell {
    let text = cell.trim();
    match text.parse::<f64>() {
        Ok(value) if value.is_nan() => Cell::Gap,
        Ok(value) if value.is_infinite() => Cell::Infinite,
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
    let mark = if lower.contains(',') { Some(Mark::Comma) } else { lower.contains('.').then_some(Mark::Point) };
    if mark == Some(Mark::Comma) && !is_decimal_comma(&lower) {
        return Cell::Text;
    }
    // Fortran writes 1.5D+03
    let plain = lower.replace(',', ".").replace('d', "e");
    match plain.parse::<f64>() {
        Ok(value) if value.is_finite() => Cell::Number(value, mark),
        Ok(value) if value.is_infinite() && plain.contains(|c: char| c.is_ascii_digit()) => Cell::Infinite,
        _ => Cell::Text,
    }
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
        for text in
            ["", "  ", "NaN", "nan", "-NaN", "-nan(ind)", "NA", "n/a", "#N/A", "null", "-", "--", "1.#QNAN", "\"\""]
        {
            assert_eq!(scan(text), Cell::Gap, "{text}");
        }
        for text in ["inf", "-Inf", "Infinity", "1e999", "-1.#INF", "1,5e999"] {
            assert_eq!(scan(text), Cell::Infinite, "{text}");
        }
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
