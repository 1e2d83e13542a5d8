//! Arrays of records (structured NumPy arrays, compound sets of HDF5): columns of their members.

use crate::bytes::Number;
use crate::log::Field;

/// A member of a record: its name, what it holds, how many of it, and where it begins.
pub(crate) struct Member {
    pub(crate) name: String,
    pub(crate) kind: Kind,
    pub(crate) count: usize,
    pub(crate) at: usize,
}

/// What a member holds.
pub(crate) enum Kind {
    /// A number, and whether its first byte is the highest.
    Number(Number, bool),
    /// Bytes of a text, of one or four for a character.
    Text(usize, usize),
    /// So many bytes that say nothing.
    Nothing(usize),
}

impl Member {
    /// Bytes of one of it.
    pub(crate) fn size(&self) -> usize {
        match self.kind {
            Kind::Number(number, _) => number.size(),
            Kind::Text(bytes, _) | Kind::Nothing(bytes) => bytes,
        }
    }

    fn says_something(&self) -> bool {
        !matches!(self.kind, Kind::Nothing(_))
    }
}

/// Columns without rows, one for each member, or for each element of one.
pub(crate) fn empty_columns(members: &[Member]) -> Vec<Field> {
    let names = |m: &Member| -> Vec<String> {
        match m.count {
            1 => vec![m.name.clone()],
            n => (0..n).map(|k| format!("{}[{k}]", m.name)).collect(),
        }
    };
    let named = members.iter().filter(|m| m.says_something()).flat_map(names);
    named.map(|name| Field::new(name, None, Vec::new())).collect()
}

/// Adds a record to the columns of its members.
pub(crate) fn append_record(record: &[u8], members: &[Member], columns: &mut [Field]) {
    let mut columns = columns.iter_mut();
    for member in members.iter().filter(|m| m.says_something()) {
        for (k, column) in (0..member.count).zip(&mut columns) {
            let at = member.at + k * member.size();
            let bytes = record.get(at..at + member.size()).unwrap_or_default();
            match member.kind {
                Kind::Number(number, big_endian) => {
                    column.values.push(number.read(bytes, big_endian).unwrap_or(f64::NAN))
                }
                Kind::Text(_, 1) => {
                    let text = String::from_utf8_lossy(bytes);
                    column.texts.push(text.trim_end_matches('\0').trim_end().to_string());
                }
                Kind::Text(..) => {
                    let letters = bytes.chunks_exact(4).filter_map(|b| b.try_into().ok().map(u32::from_le_bytes));
                    column.texts.push(letters.filter(|c| *c > 0).filter_map(char::from_u32).collect());
                }
                Kind::Nothing(_) => {}
            }
        }
    }
}
