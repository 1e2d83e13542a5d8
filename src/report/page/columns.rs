//! Columns of numbers as a result folder keeps them: `name [unit]` above each, nothing where nothing was measured.

/// The columns that were read.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Columns {
    pub(crate) columns: Vec<Column>,
}

/// One column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Column {
    pub(crate) name: String,
    pub(crate) unit: Option<String>,
    /// NaN where nothing stands.
    pub(crate) values: Vec<f64>,
}

impl Columns {
    /// Reads what this program wrote; none when it is something else.
    pub(crate) fn read(bytes: &[u8]) -> Option<Self> {
        let mut reader = csv::Reader::from_reader(bytes);
        let heads = reader.headers().ok()?.clone();
        let mut columns: Vec<Column> = heads.iter().map(head).collect();
        let mut record = csv::StringRecord::new();
        while reader.read_record(&mut record).ok()? {
            for (column, cell) in columns.iter_mut().zip(&record) {
                column.values.push(cell.parse().unwrap_or(f64::NAN));
            }
        }
        (!columns.is_empty()).then_some(Self { columns })
    }

    pub(crate) fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|c| c.name == name)
    }
}

fn head(text: &str) -> Column {
    let (name, unit) = match text.strip_suffix(']').and_then(|t| t.rsplit_once(" [")) {
        Some((name, unit)) => (name.to_string(), Some(unit.to_string())),
        None => (text.to_string(), None),
    };
    Column { name, unit, values: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_units_and_gaps_are_read() {
        let table = Columns::read(b"t [s],y [deg],\"a,b\"\n0,1.5,2\n0.1,,3\n").unwrap();
        assert_eq!(table.columns[1].unit.as_deref(), Some("deg"));
        assert!(table.column("y").unwrap().values[1].is_nan());
        assert_eq!(table.column("a,b").unwrap().values, [2.0, 3.0]);
        assert_eq!(Columns::read(b"a\n1,2\n"), None);
    }
}
