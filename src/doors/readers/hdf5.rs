//! HDF5, and MATLAB's MAT-files of version 7.3, which are HDF5 with transposed arrays.
//!
//! Only what a writer asked for is protected by checksums (`fletcher32`, packed chunks); other numbers are as they stand.

use crate::bytes::Number;
use crate::log::{Damage, Field, Log, ReadError, Reader, by_length, of_matrix};
use crate::members::{Kind, Member, append_record, empty_columns};
use hdf5_pure::{AttrValue, CompoundMember, DType, Dataset, Datatype, DatatypeByteOrder, File, Group};

/// The reader.
pub(crate) struct Hdf5;

/// Depth of groups, and number of columns.
const DEEPEST: usize = 32;
const WIDEST: usize = 10_000;
/// Bytes of one set.
const LIMIT: u64 = 4 << 30;

struct State {
    fields: Vec<Field>,
    damage: Vec<Damage>,
    remarks: Vec<String>,
    matlab: bool,
    length: u64,
}

impl Reader for Hdf5 {
    fn read(&self, bytes: &[u8]) -> Result<Log, ReadError> {
        let file = File::from_bytes(bytes.to_vec());
        let broken =
            |e: hdf5_pure::Error| ReadError::Broken { format: "HDF5", what: e.to_string(), at: bytes.len() as u64 };
        let file = file.map_err(broken)?;
        let matlab = bytes.starts_with(b"MATLAB 7.3");
        let (fields, damage, remarks) = (Vec::new(), Vec::new(), Vec::new());
        let mut state = State { fields, damage, remarks, matlab, length: bytes.len() as u64 };
        state.group(&file.root(), "", 0);
        Ok(Log { topics: by_length(state.fields), damage: state.damage, remarks: state.remarks, ..Log::default() })
    }
}

impl State {
    fn lost(&mut self, name: &str, what: impl std::fmt::Display) {
        self.damage.push(Damage { at: self.length, what: format!("`{name}` is lost: {what}") });
    }

    fn group(&mut self, group: &Group, path: &str, depth: usize) {
        if depth > DEEPEST || self.fields.len() > WIDEST {
            self.lost(path, "groups are nested too deeply, or hold too much");
            return;
        }
        // MATLAB keeps what its cells refer to beside the variables
        let own = |name: &str| self.matlab && name.starts_with('#');
        let join = |name: &str| match (path, self.matlab) {
            ("", _) => name.to_string(),
            (path, true) => format!("{path}.{name}"),
            (path, false) => format!("{path}/{name}"),
        };
        let (mut sets, mut groups) = (group.datasets(), group.groups());
        sets.iter_mut().chain(groups.iter_mut()).for_each(|names| names.sort());
        let members = |names: Result<Vec<String>, hdf5_pure::Error>| -> Result<Vec<(String, String)>, String> {
            let names = names.map_err(|e| e.to_string())?;
            Ok(names.into_iter().filter(|n| !own(n)).map(|n| (join(&n), n)).collect())
        };
        let (sets, groups) = (members(sets), members(groups));
        match sets {
            Ok(sets) => sets.into_iter().for_each(|(path, name)| match group.dataset(&name) {
                Ok(set) => self.dataset(&set, &path),
                Err(e) => self.lost(&path, e),
            }),
            Err(e) => self.lost(path, e),
        }
        match groups {
            Ok(groups) => groups.into_iter().for_each(|(path, name)| match group.group(&name) {
                Ok(inner) => self.group(&inner, &path, depth + 1),
                Err(e) => self.lost(&path, e),
            }),
            Err(e) => self.lost(path, e),
        }
    }

    fn dataset(&mut self, set: &Dataset, name: &str) {
        let (shape, kind) = match (set.shape(), set.dtype()) {
            (Ok(shape), Ok(kind)) => (shape, kind),
            (Err(e), _) | (_, Err(e)) => return self.lost(name, e),
        };
        let attributes = match set.attrs() {
            Ok(attributes) => attributes,
            Err(e) => return self.lost(name, e),
        };
        let text =
            |key: &str| attributes.get(key).and_then(AttrValue::as_str).map(|t| t.trim_end_matches('\0').to_string());
        if let Some(class) = text("MATLAB_class").filter(|_| attributes.contains_key("MATLAB_object_decode")) {
            self.remarks.push(format!(
                "`{name}` is an object of the class `{class}`, whose layout is not published; in MATLAB, `fdm_export(NAME, 'run.csv')` writes it"
            ));
            return;
        }
        let is_text = text("MATLAB_class").is_some_and(|c| c == "char" || c == "cell");
        let numbers = !is_text
            && matches!(
                kind,
                DType::F32
                    | DType::F64
                    | DType::I8
                    | DType::I16
                    | DType::I32
                    | DType::I64
                    | DType::U8
                    | DType::U16
                    | DType::U32
                    | DType::U64
            );
        if !numbers && !matches!(kind, DType::Compound(_)) {
            self.remarks.push(format!("`{name}` holds no numbers"));
            return;
        }
        // room is made by what the file says of its size: no packing makes more than a thousand bytes of one
        let bytes = |shape: &[u64]| shape.iter().try_fold(set.element_size().unwrap_or(8), |n, d| n.checked_mul(*d));
        let most = LIMIT.min(self.length.saturating_mul(1100));
        let chunk = set.chunk_shape().ok().flatten().unwrap_or_default();
        if [&shape, &chunk].iter().any(|shape| bytes(shape).is_none_or(|n| n > most)) {
            return self.lost(name, format_args!("the shape {shape:?} is larger than the file can hold"));
        }
        if let (DType::Compound(_), Ok(Datatype::Compound { size, members })) = (&kind, set.datatype()) {
            return match records(set, size as usize, &members) {
                Ok(fields) => self.fields.extend(fields),
                Err(what) => self.lost(name, what),
            };
        }
        let values = match set.read_f64() {
            Ok(values) => values,
            Err(e) => return self.lost(name, e),
        };
        let count = shape.iter().try_fold(1_u64, |n, d| n.checked_mul(*d));
        if count != Some(values.len() as u64) {
            return self.lost(name, format_args!("{} numbers for the shape {shape:?}", values.len()));
        }
        let unit = text("units").or_else(|| text("unit"));
        let field = |name: String, values| Field { name, unit: unit.clone(), values, texts: Vec::new() };
        let wide = |n: u64| n as usize <= WIDEST && n > 0;
        match shape[..] {
            [] | [_] => self.fields.push(field(name.into(), values)),
            [1, _] | [_, 1] => self.fields.push(field(name.into(), values)),
            [first, second] if wide(first.min(second)) => {
                // MATLAB writes matrices by columns, which HDF5 shows as rows
                let (rows, columns) = if self.matlab { (second, first) } else { (first, second) };
                let (rows, columns) = (rows as usize, columns as usize);
                let at = |r: usize, c: usize| if self.matlab { values[c * rows + r] } else { values[r * columns + c] };
                let title = |row: Option<usize>, column: Option<usize>| match (row, column, self.matlab) {
                    (Some(row), _, true) => format!("{name}({},:)", row + 1),
                    (Some(row), _, false) => format!("{name}[{row},:]"),
                    (_, column, true) => format!("{name}(:,{})", column.unwrap_or(0) + 1),
                    (_, column, false) => format!("{name}[:,{}]", column.unwrap_or(0)),
                };
                let found = of_matrix((rows, columns), &title, &at);
                self.fields.extend(found.into_iter().map(|f| Field { unit: unit.clone(), ..f }));
            }
            _ => {
                self.remarks.push(format!("`{name}` has the shape {shape:?}; arrays of one or two dimensions are read"))
            }
        }
    }
}

/// The columns of a compound set: what PyTables and pandas call a table. Members of other kinds than numbers and texts are left out.
fn records(set: &Dataset, size: usize, members: &[CompoundMember]) -> Result<Vec<Field>, String> {
    let member = |m: &CompoundMember| {
        let (kind, count) = kind_of(&m.datatype)?;
        Some(Member { name: m.name.clone(), kind, count, at: m.byte_offset as usize })
    };
    let members: Vec<Member> = members.iter().filter_map(member).collect();
    let mut fields = empty_columns(&members);
    let bytes = set.read_raw().map_err(|e| e.to_string())?;
    bytes.chunks_exact(size.max(1)).for_each(|record| append_record(record, &members, &mut fields));
    Ok(fields)
}

/// What a member holds, and how many of it.
fn kind_of(datatype: &Datatype) -> Option<(Kind, usize)> {
    let number = |size: u32, float: bool, signed: bool| {
        Some(match (size, float, signed) {
            (2, true, _) => Number::F16,
            (4, true, _) => Number::F32,
            (8, true, _) => Number::F64,
            (1, _, true) => Number::I8,
            (2, _, true) => Number::I16,
            (4, _, true) => Number::I32,
            (8, _, true) => Number::I64,
            (1, ..) => Number::U8,
            (2, ..) => Number::U16,
            (4, ..) => Number::U32,
            (8, ..) => Number::U64,
            _ => return None,
        })
    };
    let big = |order: &DatatypeByteOrder| matches!(order, DatatypeByteOrder::BigEndian);
    Some(match datatype {
        Datatype::FixedPoint { size, byte_order, layout } => {
            (Kind::Number(number(*size, false, layout.signed)?, big(byte_order)), 1)
        }
        Datatype::FloatingPoint { size, byte_order, .. } => {
            (Kind::Number(number(*size, true, true)?, big(byte_order)), 1)
        }
        Datatype::Enumeration { base_type, .. } => kind_of(base_type)?,
        Datatype::String { size, .. } => (Kind::Text(*size as usize, 1), 1),
        Datatype::Array { base_type, dimensions } => {
            let (kind, count) = kind_of(base_type)?;
            (kind, dimensions.iter().try_fold(count, |n, d| n.checked_mul(*d as usize)).filter(|n| *n <= WIDEST)?)
        }
        _ => return None,
    })
}
