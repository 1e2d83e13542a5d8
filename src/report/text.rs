//! Sections as text for a terminal: tables in columns, each below a blank line, sentences one a line.

use super::section::{Cell, Column, Kind, Mark, Medium, Part, Rows, Section, Table};

/// Sections below each other.
pub(crate) fn sections(sections: &[Section]) -> String {
    below(String::new(), sections)
}

/// Sections below a text that ends with its line.
pub(crate) fn below(mut text: String, sections: &[Section]) -> String {
    sections.iter().flat_map(|s| &s.parts).for_each(|p| add(&mut text, p));
    text
}

fn add(text: &mut String, part: &Part) {
    match part {
        Part::Line(said) | Part::Note(said) | Part::Warning(said) => text.push_str(&format!("{said}\n")),
        Part::Heading(said) => {
            gap(text);
            text.push_str(&format!("{said}\n"));
        }
        Part::List(items) => items.iter().for_each(|item| text.push_str(&format!("   {item}\n"))),
        Part::Table(own) => {
            gap(text);
            own.caption.iter().for_each(|said| text.push_str(&format!("{said}\n")));
            text.push_str(&columns(own));
        }
        Part::Folded { parts, .. } => parts.iter().for_each(|p| add(text, p)),
        Part::Gap => gap(text),
        Part::Only(Medium::Text, part) => add(text, part),
        Part::Only(Medium::Page, _) | Part::Figure(_) | Part::Pair(_) | Part::Markup(_) => {}
    }
}

/// A blank line, where something stands above it.
fn gap(text: &mut String) {
    if !text.is_empty() && !text.ends_with("\n\n") {
        text.push('\n');
    }
}

/// A table in columns, numbers on the right of theirs.
pub(crate) fn table<R>(rows: Rows<R>) -> String {
    columns(&rows.table())
}

fn columns(table: &Table) -> String {
    let shown: Vec<Shown> = table.columns.iter().filter(|c| c.only != Some(Medium::Page)).map(Shown::new).collect();
    let line = |k: usize, h: usize| shown.iter().map(|c| c.line(k, h)).collect::<String>();
    let height = |k: usize| shown.iter().map(|c| c.cells[k].split('\n').count()).max().unwrap_or_default();
    let lines = (0..=table.rows).flat_map(|k| (0..height(k)).map(move |h| (k, h)));
    lines.map(|(k, h)| format!("{}\n", line(k, h).trim_end())).collect()
}

/// A column with its title above its cells.
struct Shown {
    cells: Vec<String>,
    /// Of its widest line.
    width: usize,
    is_number: bool,
}

impl Shown {
    fn new(column: &Column) -> Self {
        let mark = |cell: &Cell| if cell.mark == Mark::Warned { "!" } else { "" };
        let cells = column.cells.iter().map(|cell| format!("{}{}", cell.text, mark(cell)));
        let cells: Vec<String> = std::iter::once(column.title.clone()).chain(cells).collect();
        let width = cells.iter().flat_map(|cell| cell.split('\n')).map(|line| line.chars().count()).max();
        Self { cells, width: width.unwrap_or_default().max(1), is_number: column.kind == Kind::Number }
    }

    /// A line of a cell between two blanks.
    fn line(&self, row: usize, line: usize) -> String {
        let (text, width) = (self.cells[row].split('\n').nth(line).unwrap_or_default(), self.width);
        if self.is_number { format!(" {text:>width$} ") } else { format!(" {text:<width$} ") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_stand_below_their_titles_and_marks_behind_their_numbers() {
        let mut rows = Rows::over([("k", 12.5, "stiffness\nof the spring"), ("damper", -0.04, "")]);
        rows.name("name", |row| row.0);
        rows.number("value", |row| Cell::warned(row.1.to_string(), row.1 < 0.0));
        rows.words("", |_| "");
        rows.number("on a page", |row| row.1).on_page();
        rows.words("meaning", |row| row.2);
        let section =
            Section::new("a", "A").line("first").with(rows).note("last").with(Part::Note("page".into()).on_page());
        let expected = "\
first

 name     value     meaning
 k         12.5     stiffness
                    of the spring
 damper  -0.04!
last
";
        assert_eq!(sections(&[section]), expected);
    }
}
