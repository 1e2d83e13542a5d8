//! A column of a table: its numbers, and what stands in its other cells.

use super::clock::{self, Axis, Question, Stamps};
use super::grid::Mark;
use super::heading::Heading;
use super::text::{self, Cell};
use std::collections::HashMap;

/// Longest text of a cell that is kept.
const LONGEST: usize = 200;

/// A column, whatever it was read from.
#[derive(Debug, Default)]
pub(crate) struct Column {
    pub(crate) heading: Heading,
    /// Its values (N); NaN in gaps and where a cell holds no number.
    pub(crate) values: Vec<f64>,
    /// Cells that are neither numbers nor gaps: row, and which of the texts; rows rise.
    odd: Vec<(u32, u32)>,
    texts: Vec<String>,
    /// The first number with a decimal point and the first with a comma: row and cell.
    pub(crate) marks: [Option<(usize, String)>; 2],
    /// Whether commas in its numbers can be told from separated thousands.
    pub(crate) thousands: Thousands,
    /// In which rows its sensor was sampled; nothing where in all of them.
    pub(crate) sampled: Vec<bool>,
    /// Of dates or clock times, of which the values are seconds then: what they are.
    pub(crate) stamps: Option<Stamps>,
    /// What its dates and clock times do not say.
    pub(crate) question: Option<Question>,
}

/// Whether decimal commas can be told from separated thousands where commas stand between cells.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) enum Thousands {
    #[default]
    NotSeen,
    /// Every comma may be either; the first is here.
    Possible(usize, String),
    Excluded,
}

impl Column {
    /// A column of numbers.
    pub(crate) fn of_numbers(heading: Heading, values: Vec<f64>) -> Self {
        Self { heading, values, ..Self::default() }
    }

    /// A column of the cells of a text.
    pub(crate) fn of_cells<'c>(heading: Heading, cells: impl IntoIterator<Item = &'c str>) -> Self {
        let mut builder = Builder::new(heading);
        cells.into_iter().for_each(|cell| builder.push(cell));
        builder.finish()
    }

    /// What stands in a cell that is neither number nor gap.
    pub(crate) fn text(&self, row: usize) -> Option<&str> {
        let at = self.odd.binary_search_by_key(&(row as u32), |(row, _)| *row).ok()?;
        self.texts.get(self.odd[at].1 as usize).map(String::as_str)
    }

    /// The cells that are neither numbers nor gaps.
    pub(crate) fn texts(&self) -> impl Iterator<Item = (usize, &str)> {
        self.odd.iter().map(|(row, text)| (*row as usize, self.texts[*text as usize].as_str()))
    }

    /// Different texts in it.
    pub(crate) fn labels(&self) -> &[String] {
        &self.texts
    }

    /// Whether it holds any number.
    pub(crate) fn has_numbers(&self) -> bool {
        self.values.iter().any(|v| !v.is_nan())
    }

    /// How many cells hold something.
    pub(crate) fn filled(&self) -> usize {
        self.values.iter().filter(|v| !v.is_nan()).count() + self.odd.len()
    }

    /// Whether two rows have the same in it.
    pub(crate) fn same(&self, row: usize, other: usize) -> bool {
        let (a, b) = (self.values[row], self.values[other]);
        (a == b || a.is_nan() && b.is_nan()) && (self.odd.is_empty() || self.text(row) == self.text(other))
    }

    /// These rows of it.
    pub(crate) fn rows(&self, rows: &[usize]) -> Self {
        let pick = |k: &usize| self.values[*k];
        let odd = rows.iter().enumerate().filter_map(|(new, old)| {
            let at = self.odd.binary_search_by_key(&(*old as u32), |(row, _)| *row).ok()?;
            Some((new as u32, self.odd[at].1))
        });
        let moved = |row: usize| rows.iter().position(|k| *k == row);
        let marks = self.marks.clone().map(|mark| mark.and_then(|(row, cell)| Some((moved(row)?, cell))));
        let sampled =
            if self.sampled.is_empty() { Vec::new() } else { rows.iter().map(|k| self.sampled[*k]).collect() };
        Self {
            heading: self.heading.clone(),
            values: rows.iter().map(pick).collect(),
            odd: odd.collect(),
            texts: self.texts.clone(),
            marks,
            thousands: self.thousands.clone(),
            sampled,
            stamps: self.stamps,
            question: self.question,
        }
    }

    /// Dates and clock times in another format than the cells say.
    pub(crate) fn in_format(&mut self, format: &str) {
        self.heading.format = Some(format.into());
        if self.stamps.is_some() {
            self.read_stamps();
        }
    }

    /// Makes seconds of dates and clock times, where its first cell is one.
    fn read_stamps(&mut self) {
        let mut cells: Vec<Option<&str>> = vec![None; self.values.len()];
        self.odd.iter().for_each(|(row, text)| cells[*row as usize] = Some(&self.texts[*text as usize]));
        let Axis { seconds, stamps, question } = clock::axis(&cells, self.heading.format.as_deref());
        (self.values, self.stamps, self.question) = (seconds, Some(stamps), question);
    }

    /// Makes numbers of cells that all have one unit behind their number: `0.02 sec`.
    fn read_quantities(&mut self) {
        let quantity = |text: &str| {
            let (number, unit) = text.trim().split_once(' ')?;
            let Cell::Number(value, _) = text::scan(number) else { return None };
            fdm_grammar::Unit::spelled(unit).is_ok().then(|| (value, unit.trim().to_string()))
        };
        let mut read: Vec<(f64, String)> = Vec::with_capacity(self.texts.len());
        for text in &self.texts {
            match quantity(text) {
                Some(found) if read.first().is_none_or(|(_, unit)| *unit == found.1) => read.push(found),
                _ => return,
            }
        }
        let Some((_, unit)) = read.first().filter(|_| !self.has_numbers() && self.heading.unit.is_none()) else {
            return;
        };
        self.heading.unit = Some(unit.clone());
        self.odd.iter().for_each(|(row, text)| self.values[*row as usize] = read[*text as usize].0);
        self.odd.clear();
        self.texts.clear();
    }

    /// Takes numbers that stand for nothing out of it; gives how many there were.
    pub(crate) fn without(&mut self, is_code: impl Fn(f64) -> bool) -> usize {
        let mut found = 0;
        for value in self.values.iter_mut().filter(|v| is_code(**v)) {
            *value = f64::NAN;
            found += 1;
        }
        found
    }

    /// Takes texts that stand for nothing out of it; gives how many there were.
    pub(crate) fn without_text(&mut self, code: &str) -> usize {
        let Some(text) = self.texts.iter().position(|t| t == code) else { return 0 };
        let before = self.odd.len();
        self.odd.retain(|(_, k)| *k as usize != text);
        before - self.odd.len()
    }
}

/// Makes a column of cells, one after the other.
pub(crate) struct Builder {
    column: Column,
    known: HashMap<String, u32>,
}

impl Builder {
    pub(crate) fn new(heading: Heading) -> Self {
        Self { column: Column { heading, ..Column::default() }, known: HashMap::new() }
    }

    pub(crate) fn push(&mut self, cell: &str) {
        let column = &mut self.column;
        let row = column.values.len();
        let (value, mark) = match text::scan(cell) {
            Cell::Gap => (f64::NAN, None),
            Cell::Number(value, mark) => (value, mark),
            Cell::Infinite | Cell::Vanishing | Cell::Below(_) | Cell::Text => {
                column.values.push(f64::NAN);
                let trimmed = cell.trim();
                let end = trimmed.char_indices().nth(LONGEST).map_or(trimmed.len(), |(at, _)| at);
                let text = self.text(&trimmed[..end]);
                self.column.odd.push((row as u32, text));
                return;
            }
        };
        column.values.push(value);
        if let Some(mark) = mark {
            let place = &mut column.marks[usize::from(mark == Mark::Comma)];
            if place.is_none() {
                *place = Some((row, cell.trim().to_string()));
            }
            if mark == Mark::Comma && column.thousands != Thousands::Excluded {
                if !text::may_be_thousands(cell) {
                    column.thousands = Thousands::Excluded;
                } else if column.thousands == Thousands::NotSeen {
                    column.thousands = Thousands::Possible(row, cell.trim().to_string());
                }
            }
        }
    }

    fn text(&mut self, text: &str) -> u32 {
        if let Some(known) = self.known.get(text) {
            return *known;
        }
        let new = self.column.texts.len() as u32;
        self.column.texts.push(text.to_string());
        self.known.insert(text.to_string(), new);
        new
    }

    pub(crate) fn finish(mut self) -> Column {
        let column = &mut self.column;
        let first = column.odd.first().map(|(row, text)| (*row as usize, &column.texts[*text as usize]));
        let clock =
            first.is_some_and(|(row, text)| column.values[..row].iter().all(|v| v.is_nan()) && clock::is_stamp(text));
        if clock {
            column.read_stamps();
        } else {
            column.read_quantities();
        }
        self.column
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_numbers_gaps_and_texts() {
        let column = Column::of_cells(Heading::new("y"), ["1.5", "", ".", "abc", "<0.5", "abc", "2,5"]);
        let values: Vec<String> = column.values.iter().map(f64::to_string).collect();
        assert_eq!(values, ["1.5", "NaN", "NaN", "NaN", "NaN", "NaN", "2.5"]);
        assert_eq!(column.texts().collect::<Vec<_>>(), [(3, "abc"), (4, "<0.5"), (5, "abc")]);
        assert_eq!((column.text(5), column.text(1), column.labels().len()), (Some("abc"), None, 2));
        assert_eq!(column.marks[1], Some((6, "2,5".into())));
        let part = column.rows(&[5, 6]);
        assert_eq!((part.text(0), part.values[1], part.marks[1].clone()), (Some("abc"), 2.5, Some((1, "2,5".into()))));
    }

    #[test]
    fn quantities_are_numbers_with_a_unit() {
        let column = Column::of_cells(Heading::new("Time"), ["0 sec", "", "0.5 sec", "1 sec"]);
        assert_eq!((column.values[2], column.heading.unit.as_deref(), column.texts().count()), (0.5, Some("sec"), 0));
        assert_eq!(Column::of_cells(Heading::new("y"), ["1 m", "2 ft"]).texts().count(), 2);
    }

    #[test]
    fn dates_and_clock_times_are_seconds() {
        let column = Column::of_cells(Heading::new("Time (hh:mm:ss)"), ["", "23:59:59", "00:00:01", "x"]);
        assert_eq!((column.stamps, column.values[1], column.values[2]), (Some(Stamps::Clock), 86_399.0, 86_401.0));
        assert!(column.values[3].is_nan() && column.text(3) == Some("x"));
        assert_eq!(Column::of_cells(Heading::new("y"), ["1", "08:00"]).stamps, None);
    }
}
