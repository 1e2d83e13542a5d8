//! Sections as text for a terminal: tables in columns, each below a blank line, sentences one a line.

use super::section::{Kind, Mark, Medium, Part, Rows, Section, Table};
use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, Table as Grid};

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
    let columns: Vec<_> = table.columns.iter().filter(|c| c.only != Some(Medium::Page)).collect();
    let mut grid = Grid::new();
    grid.load_style(NOTHING).set_header(columns.iter().map(|c| c.title.as_str()));
    for row in 0..table.rows {
        grid.add_row(columns.iter().map(|c| {
            let cell = &c.cells[row];
            format!("{}{}", cell.text, if cell.mark == Mark::Warned { "!" } else { "" })
        }));
    }
    for (k, _) in columns.iter().enumerate().filter(|(_, c)| c.kind == Kind::Number) {
        if let Some(column) = grid.column_mut(k) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    // without the blanks that fill the last column
    grid.to_string().lines().map(|l| format!("{}\n", l.trim_end())).collect()
}
