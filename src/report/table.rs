//! Tables in columns, as the terminal shows them.

use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, Table};

/// A table under these titles.
pub(super) fn plain(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(NOTHING).set_header(header.iter().copied());
    table
}

/// Numbers stand on the right of their column.
pub(super) fn aligned_right(table: &mut Table, column: usize) {
    if let Some(column) = table.column_mut(column) {
        column.set_cell_alignment(CellAlignment::Right);
    }
}

/// Without the blanks that fill the last column.
pub(super) fn trimmed(table: &Table) -> String {
    table.to_string().lines().map(|l| format!("{}\n", l.trim_end())).collect()
}
