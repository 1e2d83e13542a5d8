//! JSON: an array of objects is a table of rows, an object of arrays one of columns; lines with an object each are an array. Tables may stand inside
//! objects; the names on the way to a value are joined by points.

use crate::log::by_length;
use crate::log::{Field, Log, ReadError, Reader, Sheet};
use serde_json::{Map, Value};

/// The reader.
pub(crate) struct Json;

/// Depth of objects and arrays.
const DEEPEST: usize = 16;
/// Most columns of a table.
const WIDEST: usize = 10_000;

impl Reader for Json {
    fn read(&self, bytes: &[u8]) -> Result<Log, ReadError> {
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let broken =
            |e: &serde_json::Error| ReadError::Broken { format: "JSON", what: e.to_string(), at: bytes.len() as u64 };
        let mut values = Vec::new();
        for value in serde_json::Deserializer::from_slice(bytes).into_iter::<Value>() {
            values.push(value.map_err(|e| broken(&e))?);
        }
        let whole = if values.len() == 1 { values.swap_remove(0) } else { Value::Array(values) };
        let mut found = Found::default();
        found.value("", &whole, 0);
        found.remarks.dedup();
        Ok(Log { topics: by_length(found.fields), sheets: found.sheets, remarks: found.remarks, ..Log::default() })
    }
}

/// Tables and columns that were found.
#[derive(Default)]
struct Found {
    fields: Vec<Field>,
    sheets: Vec<Sheet>,
    remarks: Vec<String>,
}

fn joined(path: &str, name: &str) -> String {
    if path.is_empty() { name.into() } else { format!("{path}.{name}") }
}

/// A single value as the text of a cell.
fn cell(value: &Value) -> Option<String> {
    Some(match value {
        Value::Null => String::new(),
        Value::Bool(value) => u8::from(*value).to_string(),
        Value::Number(value) => value.to_string(),
        Value::String(text) => text.clone(),
        _ => return None,
    })
}

impl Found {
    fn value(&mut self, path: &str, value: &Value, depth: usize) {
        if depth > DEEPEST || self.fields.len() > WIDEST {
            return;
        }
        match value {
            Value::Array(items) if items.iter().all(Value::is_object) && !items.is_empty() => self.rows(path, items),
            Value::Array(items) if items.iter().all(|i| cell(i).is_some()) => self.column(path, items),
            // rows of a matrix, the first of them perhaps its names
            Value::Array(items) if items.iter().all(Value::is_array) => self.matrix(path, items),
            Value::Object(map) => {
                map.iter().for_each(|(name, inner)| self.value(&joined(path, name), inner, depth + 1))
            }
            Value::Array(_) => self.remarks.push(format!("`{path}` holds other than numbers, objects or rows of them")),
            _ => {}
        }
    }

    fn column(&mut self, path: &str, items: &[Value]) {
        let number = |v: &Value| v.as_f64().or_else(|| v.as_bool().map(|b| f64::from(u8::from(b)))).unwrap_or(f64::NAN);
        let name = if path.is_empty() { "value" } else { path };
        if items.iter().any(Value::is_string) {
            self.fields.push(Field::of_texts(name, items.iter().filter_map(cell).collect()));
        } else {
            self.fields.push(Field::new(name, None, items.iter().map(number).collect()));
        }
    }

    /// Objects, each a row.
    fn rows(&mut self, path: &str, items: &[Value]) {
        let mut names: Vec<String> = Vec::new();
        let mut places = std::collections::HashMap::new();
        let rows: Vec<Vec<(usize, String)>> = items
            .iter()
            .filter_map(Value::as_object)
            .map(|object| {
                let mut own = Vec::new();
                flat("", object, 0, &mut |name, text| {
                    let at = *places.entry(name.to_string()).or_insert_with(|| {
                        names.push(name.to_string());
                        names.len() - 1
                    });
                    own.push((at, text));
                });
                own
            })
            .collect();
        if names.len() > WIDEST {
            self.remarks.push(format!("`{path}` has more than {WIDEST} names"));
            return;
        }
        let mut sheet = Sheet { name: path.into(), titled: true, ..Sheet::default() };
        sheet.push(names.iter().map(String::as_str));
        for row in rows {
            let mut cells = vec![""; names.len()];
            row.iter().for_each(|(at, text)| cells[*at] = text);
            sheet.push(cells);
        }
        self.sheets.push(sheet);
    }

    fn matrix(&mut self, path: &str, items: &[Value]) {
        let mut sheet = Sheet { name: path.into(), ..Sheet::default() };
        for row in items.iter().filter_map(Value::as_array) {
            let cells: Vec<String> = row.iter().map(|v| cell(v).unwrap_or_default()).collect();
            sheet.push(cells.iter().map(String::as_str));
        }
        self.sheets.push(sheet);
    }
}

/// The single values of an object, by their names.
fn flat(path: &str, object: &Map<String, Value>, depth: usize, with: &mut dyn FnMut(&str, String)) {
    for (name, value) in object {
        let path = joined(path, name);
        match value {
            Value::Object(inner) if depth < DEEPEST => flat(&path, inner, depth + 1, with),
            Value::Array(items) => {
                for (k, text) in items.iter().enumerate().filter_map(|(k, v)| Some((k, cell(v)?))) {
                    with(&format!("{path}[{k}]"), text);
                }
            }
            value => cell(value).into_iter().for_each(|text| with(&path, text)),
        }
    }
}
