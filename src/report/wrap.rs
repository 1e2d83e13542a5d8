//! Text that fits a terminal: sentences are wrapped, and a table gets narrower before its columns go below each other.

use std::collections::BTreeSet;

/// Columns between two columns of a table.
const GAP: usize = 2;
/// A column of words is not made narrower than this.
const LEAST: usize = 12;
/// How much further the lines below the first of a sentence stand.
const HANG: usize = 2;

/// The text with no line longer than `width` columns, as far as words are not longer. Excerpts of a model's text, drawings, and lines that fit
/// stay as they are. Escapes of colours (ISO 6429) take no column.
pub fn wrapped(text: &str, width: usize) -> String {
    let lines: Vec<&str> = text.split('\n').collect();
    if lines.iter().all(|line| columns(line) <= width) {
        return text.into();
    }
    let (mut out, mut k): (Vec<String>, usize) = (Vec::new(), 0);
    while k < lines.len() {
        let rows = table_at(&lines[k..]);
        let table = Table::of(&lines[k..k + rows]).filter(|_| rows > 1);
        match table {
            Some(table) if lines[k..k + rows].iter().any(|line| columns(line) > width) => {
                out.extend(table.narrowed(width))
            }
            Some(_) => out.extend(lines[k..k + rows].iter().map(ToString::to_string)),
            None => out.extend(lines[k..k + rows.max(1)].iter().flat_map(|line| sentence(line, width))),
        }
        k += rows.max(1);
    }
    out.join("\n")
}

/// Columns that a line takes.
fn columns(line: &str) -> usize {
    if !line.contains('\u{1b}') {
        return line.chars().count();
    }
    let (mut count, mut escaped) = (0, false);
    for c in line.chars() {
        match (escaped, c) {
            (true, c) => escaped = !c.is_ascii_alphabetic(),
            (false, '\u{1b}') => escaped = true,
            (false, _) => count += 1,
        }
    }
    count
}

/// A line of an excerpt, of a difference between texts, or of a drawing.
fn is_as_it_is(line: &str) -> bool {
    let behind = line.trim_start().trim_start_matches(|c: char| c.is_ascii_digit()).trim_start();
    let excerpt = ["|", "-->", ":::", "~~~", "@@"].iter().any(|mark| behind.starts_with(mark));
    let drawn = |c: char| ('\u{2500}'..='\u{259f}').contains(&c) || ('\u{2800}'..='\u{28ff}').contains(&c);
    excerpt || line.chars().any(drawn)
}

/// A sentence in lines; those below the first stand further in, or below what follows a label.
fn sentence(line: &str, width: usize) -> Vec<String> {
    if columns(line) <= width || is_as_it_is(line) {
        return vec![line.into()];
    }
    let indent = line.chars().take_while(|c| *c == ' ').count();
    let label = gaps(line).next().filter(|(from, to)| to > from && *to <= width / 3).map(|(_, to)| to);
    wrapped_words(line, width, label.unwrap_or(indent + HANG))
}

/// Words in lines of at most `width` columns; those below the first stand `hang` columns further in.
fn wrapped_words(line: &str, width: usize, hang: usize) -> Vec<String> {
    let text = line.trim_start_matches(' ');
    let (mut all, mut current) = (Vec::new(), " ".repeat(line.len() - text.len()));
    // blanks in a row are words of no length
    for (k, word) in text.split(' ').enumerate() {
        if k > 0 && !word.is_empty() && columns(&current) + 1 + columns(word) > width {
            all.push(current.trim_end().to_string());
            current = " ".repeat(hang);
        } else if k > 0 {
            current.push(' ');
        }
        current.push_str(word);
    }
    all.push(current.trim_end().to_string());
    all
}

/// Where text of a line is interrupted by two blanks or more: from, to.
fn gaps(line: &str) -> impl Iterator<Item = (usize, usize)> {
    let characters: Vec<char> = line.trim_end().chars().collect();
    let first = characters.iter().position(|c| *c != ' ').unwrap_or(characters.len());
    let (mut found, mut k) = (Vec::new(), first);
    while k < characters.len() {
        let blanks = characters[k..].iter().take_while(|c| **c == ' ').count();
        if blanks >= GAP {
            found.push((k, k + blanks));
        }
        k += blanks.max(1);
    }
    found.into_iter()
}

/// How many lines from the first on may be rows of one table.
fn table_at(lines: &[&str]) -> usize {
    let Some((first, _)) = lines.first().and_then(|line| gaps(line).next()) else { return 0 };
    let is_row = |line: &&&str| {
        let (empty, plain) = (line.trim().is_empty(), !is_as_it_is(line) && !line.contains('\u{1b}'));
        plain && !empty && (gaps(line).next().is_some() || columns(line) <= first)
    };
    lines.iter().take_while(is_row).count()
}

/// A table as it was laid out.
struct Table {
    /// Blanks in front of every row.
    indent: usize,
    /// Rows of cells, each with the blanks that align it.
    rows: Vec<Vec<String>>,
    widths: Vec<usize>,
}

impl Table {
    /// Columns are parted where every row has blanks; none where there is no such place.
    fn of(lines: &[&str]) -> Option<Self> {
        let rows: Vec<Vec<char>> = lines.iter().map(|line| line.trim_end().chars().collect()).collect();
        let length = rows.iter().map(Vec::len).max().unwrap_or_default();
        let is_blank = |c: usize| rows.iter().all(|row| row.get(c).is_none_or(|c| *c == ' '));
        let indent = (0..length).take_while(|c| is_blank(*c)).count();
        let (mut places, mut from, mut c) = (Vec::new(), indent, indent);
        while c < length {
            let blanks = (c..length).take_while(|c| is_blank(*c)).count();
            if blanks >= GAP {
                places.push((from, c));
                from = c + blanks;
            }
            c += blanks.max(1);
        }
        places.push((from, length));
        let cell = |row: &Vec<char>, (from, to): (usize, usize)| -> String {
            row.iter().take(to).skip(from).collect::<String>().trim_end().to_string()
        };
        let cells = rows.iter().map(|row| places.iter().map(|place| cell(row, *place)).collect()).collect();
        let widths = places.iter().map(|(from, to)| to - from).collect();
        (places.len() > 1).then_some(Self { indent, rows: cells, widths })
    }

    /// Columns of words get narrower where the table fits then, the widest first; else columns stand in a table below, with the first one again.
    fn narrowed(mut self, width: usize) -> Vec<String> {
        let least: Vec<usize> = (0..self.widths.len()).map(|k| self.least(k)).collect();
        let own = std::mem::replace(&mut self.widths, least.clone());
        if self.total() <= width {
            self.widths = own;
            self.shrink(&least, width);
        } else {
            let names = self.names();
            let beside = width.saturating_sub(self.indent + names.iter().map(|k| own[*k] + GAP).sum::<usize>());
            let fitting = own.iter().zip(&least).enumerate();
            let fitting =
                fitting.map(|(k, (own, least))| if k < names.len() { *own } else { beside.clamp(*least, *own) });
            self.widths = fitting.collect();
        }
        let mut lines = Vec::new();
        for part in self.parts(width) {
            if !lines.is_empty() {
                lines.push(String::new());
            }
            lines.extend(self.rows.iter().flat_map(|row| self.row(row, &part)));
        }
        lines
    }

    /// Takes from the widest column, down to the next one or to its least width, until the table fits.
    fn shrink(&mut self, least: &[usize], width: usize) {
        while let excess = self.total().saturating_sub(width)
            && excess > 0
        {
            let able = (0..least.len()).filter(|k| self.widths[*k] > least[*k]);
            let Some(k) = able.max_by_key(|k| self.widths[*k]) else { break };
            let next = (0..least.len()).filter(|j| *j != k).map(|j| self.widths[j]).max().unwrap_or_default();
            let own = self.widths[k];
            self.widths[k] = own.saturating_sub(excess).max(least[k]).max(next.min(own - 1));
        }
    }

    fn total(&self) -> usize {
        self.indent + self.widths.iter().sum::<usize>() + GAP * (self.widths.len() - 1)
    }

    /// The least width of a column: that of its longest word, or its own where it has no words.
    fn least(&self, k: usize) -> usize {
        let cells = || self.rows.iter().map(|row| row[k].trim());
        // numbers are not taken apart, whatever their title
        let letters = |cell: &str| cell.chars().filter(|c| c.is_alphabetic()).count();
        if !cells().skip(1).any(|cell| cell.contains(' ') && 2 * letters(cell) > columns(cell)) {
            return self.widths[k];
        }
        let longest = cells().flat_map(|cell| cell.split(' ')).map(columns).max().unwrap_or_default();
        longest.max(LEAST).min(self.widths[k])
    }

    /// The columns that name a row: the first, and the second where that does not do.
    fn names(&self) -> Vec<usize> {
        let firsts: BTreeSet<&str> = self.rows.iter().map(|row| row[0].trim()).collect();
        (0..self.widths.len().min(1 + usize::from(firsts.len() < self.rows.len()))).collect()
    }

    /// Columns that stand beside each other, each part with those that name a row.
    fn parts(&self, width: usize) -> Vec<Vec<usize>> {
        let names = self.names();
        let begun = self.indent + names.iter().map(|k| self.widths[*k]).sum::<usize>() + GAP * (names.len() - 1);
        let (mut parts, mut used) = (vec![names.clone()], begun);
        for (k, own) in self.widths.iter().enumerate().skip(names.len()) {
            if used + GAP + own > width && parts.last().is_some_and(|part| part.len() > names.len()) {
                parts.push(names.clone());
                used = begun;
            }
            used += GAP + own;
            parts.last_mut().into_iter().for_each(|part| part.push(k));
        }
        parts
    }

    fn row(&self, row: &[String], part: &[usize]) -> Vec<String> {
        let cell = |k: usize| match columns(&row[k]) > self.widths[k] {
            true => wrapped_words(row[k].trim(), self.widths[k], 0),
            false => vec![row[k].clone()],
        };
        let cells: Vec<Vec<String>> = part.iter().map(|k| cell(*k)).collect();
        let height = cells.iter().map(Vec::len).max().unwrap_or_default();
        let line = |h: usize| {
            let mut line = " ".repeat(self.indent);
            for (cell, k) in cells.iter().zip(part) {
                let text = cell.get(h).map_or("", String::as_str);
                let fill = " ".repeat(GAP + self.widths[*k].saturating_sub(columns(text)));
                line.push_str(&format!("{text}{fill}"));
            }
            line.trim_end().to_string()
        };
        (0..height).map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_are_wrapped_and_hang() {
        let said = "note: the input `elevator` moves only at samples and all at once, so it is taken for held";
        let expected =
            "note: the input `elevator` moves only at\n  samples and all at once, so it is\n  taken for held";
        assert_eq!(wrapped(said, 40), expected);
        assert_eq!(wrapped(said, 200), said);
        assert_eq!(wrapped("  a b c\n\nd", 5), "  a b\n    c\n\nd");
        let label = "  fit        estimate the parameters";
        assert_eq!(wrapped(label, 39), label);
        assert_eq!(wrapped(label, 33), "  fit        estimate the\n    parameters");
        assert_eq!(wrapped("fit      estimate the parameters", 30), "fit      estimate the\n         parameters");
        // colours take no place, and words are not broken
        assert_eq!(wrapped("\u{1b}[1mone\u{1b}[0m two", 7), "\u{1b}[1mone\u{1b}[0m two");
        assert_eq!(wrapped("one unbreakable", 6), "one\n  unbreakable");
    }

    #[test]
    fn excerpts_and_drawings_stay() {
        for text in ["12 |   der(v) = -k*x - c*v + b*u;", " --> some/very/long/path/model.fdm:3:9", "⣀⣀⣀⣀ ⣀⣀⣀⣀⣀ ⣀⣀⣀⣀"]
        {
            assert_eq!(wrapped(text, 10), text);
        }
    }

    #[test]
    fn a_table_gets_narrower_and_then_breaks() {
        let table = "\
name      value  meaning
k       1.25e+1  stiffness of the spring
damper     0.04  viscous friction in the bearing";
        let narrow = "\
name      value  meaning
k       1.25e+1  stiffness of
                 the spring
damper     0.04  viscous
                 friction in
                 the bearing";
        assert_eq!(wrapped(table, 29), narrow);
        let numbers = "\
k    a1000  b1000  c1000
one  1.000  2.000  3.000";
        let broken = "\
k    a1000  b1000
one  1.000  2.000

k    c1000
one  3.000";
        assert_eq!(wrapped(numbers, 18), broken);
        assert_eq!(wrapped(table, 49), table);
    }
}
