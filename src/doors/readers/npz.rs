//! NumPy's archives: a zip of arrays, each with a checksum; and single arrays, which have none. Numbers go from the file into their columns in
//! small parts, so that a large archive stands in memory once.
//!
//! Source: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>.

use crate::bytes::Number;
use crate::log::{Damage, Field, Log, ReadError, Reader, Source, by_length, of_matrix};
use crate::members::{Kind, Member, append_record, empty_columns};
use crate::zip::directory;
use std::io::{self, Cursor, Read, SeekFrom};

/// The reader.
pub(crate) struct NumPy;

/// Largest array that is unpacked, and all of them together.
const LIMIT: u64 = 4 << 30;
/// Most columns that one array is split into.
const WIDEST: usize = 10_000;
/// Bytes that are read at once; a multiple of the size of every number.
const PART: usize = 1 << 16;
/// Longest header of an array.
const HEADER: usize = 1 << 20;

impl Reader for NumPy {
    fn read(&self, bytes: &[u8]) -> Result<Log, ReadError> {
        self.read_from(&mut Cursor::new(bytes))
    }

    fn read_from(&self, source: &mut dyn Source) -> Result<Log, ReadError> {
        let mut log = Log::default();
        let mut fields = Vec::new();
        if begins_as_array(source) {
            let broken = |what| ReadError::Broken { format: "NPY", what, at: 0 };
            let size = source.seek(SeekFrom::End(0)).and_then(|size| source.rewind().map(|()| size));
            let size = size.map_err(|e| broken(e.to_string()))?;
            fields = array("value", &mut *source, (size, size), &mut log.remarks).map_err(broken)?;
        } else {
            let mut unpacked = 0;
            let entries = directory(source, "NPZ")?;
            if !entries.iter().any(|entry| entry.name.ends_with(".npy")) {
                let what = "there is no array in the archive".into();
                return Err(ReadError::Broken { format: "NPZ", what, at: 0 });
            }
            for entry in entries {
                let Some(name) = entry.name.strip_suffix(".npy") else {
                    log.remarks.push(format!("`{}` is no array", entry.name.escape_debug()));
                    continue;
                };
                let mut remarks = Vec::new();
                let read = |content: &mut dyn Read, sizes| array(name, content, sizes, &mut remarks);
                match entry.unpack(source, LIMIT - unpacked, read).flatten() {
                    Ok(found) => {
                        fields.extend(found);
                        log.remarks.append(&mut remarks);
                    }
                    Err(what) => {
                        let what = format!("the array `{name}` is lost: {what}");
                        log.damage.push(Damage { at: entry.at, what });
                    }
                }
                unpacked += entry.size.min(LIMIT - unpacked);
            }
        }
        Ok(Log { topics: by_length(fields), ..log })
    }
}

fn begins_as_array(source: &mut dyn Source) -> bool {
    let mut magic = [0; 6];
    let read = source.rewind().and_then(|()| source.read_exact(&mut magic)).and_then(|()| source.rewind());
    read.is_ok() && magic == *b"\x93NUMPY"
}

/// The columns of an array: one dimension is a column, of two each column is one. It has `size` bytes, of which there may be fewer than are
/// said, but not more than `possible`.
fn array(
    name: &str,
    reader: &mut dyn Read,
    (size, possible): (u64, u64),
    remarks: &mut Vec<String>,
) -> Result<Vec<Field>, String> {
    let mut preamble = [0; 10];
    let begun = reader.read_exact(&mut preamble).is_ok() && preamble.starts_with(b"\x93NUMPY");
    let mut length = u32::from(u16::from_le_bytes([preamble[8], preamble[9]]));
    let mut before = preamble.len() as u64;
    match preamble[6] {
        1 if begun => {}
        2 | 3 if begun => {
            let mut more = [0; 2];
            reader.read_exact(&mut more).map_err(|_| "its header is cut off")?;
            (length, before) = (length | u32::from(u16::from_le_bytes(more)) << 16, 12);
        }
        _ => return Err("it does not begin as an array".into()),
    }
    let mut header = vec![0; (length as usize).min(HEADER)];
    let whole = length as usize <= HEADER && reader.read_exact(&mut header).is_ok();
    let header = str::from_utf8(&header).ok().filter(|_| whole).ok_or("its header is cut off")?;
    let value = |key: &str| {
        let rest = header.split_once(&format!("'{key}':"))?.1.trim_start();
        Some(rest)
    };
    let bad = || {
        format!(
            "its header `{}` is not understood",
            header.trim_end().chars().take(80).collect::<String>().escape_debug()
        )
    };
    let record = value("descr").and_then(|v| v.strip_prefix('[')).and_then(|v| v.split_once(']'));
    let descr = value("descr").and_then(|v| v.strip_prefix('\'')).and_then(|v| v.split_once('\''));
    let shape = value("shape").and_then(|v| v.strip_prefix('(')).and_then(|v| v.split_once(')'));
    let fortran = value("fortran_order").map(|v| v.starts_with("True"));
    let (Some((shape, _)), Some(fortran)) = (shape, fortran) else { return Err(bad()) };
    let dimensions: Option<Vec<usize>> =
        shape.split(',').map(str::trim).filter(|d| !d.is_empty()).map(|d| d.parse().ok()).collect();
    let dimensions = dimensions.ok_or_else(bad)?;
    let count = dimensions.iter().try_fold(1_usize, |n, d| n.checked_mul(*d));
    if let Some((record, _)) = record {
        let Some(members) = members_of(record) else {
            remarks.push(format!("`{name}` holds records of other than numbers and texts, which are not read"));
            return Ok(Vec::new());
        };
        let left = size.saturating_sub(u64::from(length) + before);
        return records(reader, count.ok_or_else(bad)?, &members, left)
            .map_err(|what| format!("{what} (shape {shape})"));
    }
    let Some((descr, _)) = descr else { return Err(bad()) };
    let Some((number, big_endian)) = number_of(descr) else {
        remarks.push(format!("`{name}` holds `{descr}`, and no numbers"));
        return Ok(Vec::new());
    };
    let expected = count.and_then(|n| n.checked_mul(number.size())).ok_or_else(bad)?;
    let left = size.saturating_sub(u64::from(length) + before);
    if left != expected as u64 {
        return Err(format!("it has {left} bytes of numbers, and its shape ({shape}) has {expected}"));
    }
    let (rows, names) = match dimensions[..] {
        [] => (1, vec![name.to_string()]),
        [n] | [n, 1] | [1, n] => (n, vec![name.to_string()]),
        [rows, columns] if columns <= WIDEST => (rows, (0..columns).map(|c| format!("{name}[:,{c}]")).collect()),
        _ => {
            remarks.push(format!("`{name}` has the shape ({shape}); arrays of one or two dimensions are read"));
            return Ok(Vec::new());
        }
    };
    let room = rows.min((possible / number.size() as u64) as usize / names.len().max(1) + 1);
    let mut columns: Vec<Vec<f64>> = names.iter().map(|_| Vec::with_capacity(room)).collect();
    let mut next = 0;
    in_parts(reader, expected, |bytes| {
        if fortran || columns.len() == 1 {
            let mut numbers = bytes;
            while let Some(column) = columns.get_mut(next).filter(|_| !numbers.is_empty()) {
                let wanted = ((rows - column.len()) * number.size()).min(numbers.len());
                let (own, rest) = numbers.split_at(wanted);
                number.append(own, big_endian, column);
                numbers = rest;
                next += usize::from(column.len() == rows);
            }
        } else {
            for bytes in bytes.chunks_exact(number.size()) {
                columns[next].extend(number.read(bytes, big_endian));
                next = (next + 1) % columns.len();
            }
        }
    })
    .map_err(|e| format!("its numbers are cut off: {e}"))?;
    let rows = columns.first().map_or(0, Vec::len);
    if rows > 1 && columns.len() > 1 {
        let titled = |row: Option<usize>, column: Option<usize>| match (row, column) {
            (Some(row), _) => format!("{name}[{row},:]"),
            (_, column) => names[column.unwrap_or(0)].clone(),
        };
        return Ok(of_matrix((rows, columns.len()), &titled, &|r, c| columns[c][r]));
    }
    Ok(names.into_iter().zip(columns).map(|(name, values)| Field::new(name, None, values)).collect())
}

/// The members of records, as `('time', '<f8'), ('name', '<U8')` lists them; they lie one behind the other.
fn members_of(list: &str) -> Option<Vec<Member>> {
    let (mut members, mut at) = (Vec::new(), 0_usize);
    for part in list.split("('").skip(1) {
        let (name, rest) = part.split_once('\'')?;
        let (descr, rest) = rest.split_once('\'')?.1.split_once('\'')?;
        let count = match rest.trim_start().strip_prefix(", (").and_then(|r| r.split_once(')')) {
            Some((shape, _)) => {
                let sizes = shape.split(',').map(str::trim).filter(|d| !d.is_empty());
                sizes.map(|d| d.parse::<usize>().ok()).product::<Option<usize>>()?
            }
            None => 1,
        };
        let width = |letter: char| descr.split_once(letter).and_then(|(_, n)| n.parse::<usize>().ok());
        let kind = match number_of(descr) {
            Some((number, big_endian)) => Kind::Number(number, big_endian),
            None => match (width('S'), width('U'), width('V')) {
                (Some(n), _, _) => Kind::Text(n, 1),
                (_, Some(n), _) if !descr.starts_with('>') => Kind::Text(n.checked_mul(4)?, 4),
                // what fills a record up
                (_, _, Some(n)) => Kind::Nothing(n),
                _ => return None,
            },
        };
        (count <= WIDEST).then_some(())?;
        let member = Member { name: name.into(), kind, count, at };
        at = member.size().checked_mul(count)?.checked_add(at)?;
        members.push(member);
    }
    (!members.is_empty()).then_some(members)
}

/// The columns of an array of records.
fn records(reader: &mut dyn Read, rows: usize, members: &[Member], left: u64) -> Result<Vec<Field>, String> {
    let width = members.last().map_or(0, |m| m.at + m.count * m.size());
    if rows.checked_mul(width).map(|n| n as u64) != Some(left) {
        return Err(format!("it has {left} bytes, and {rows} records of {width} bytes"));
    }
    let mut fields = empty_columns(members);
    let mut record = vec![0; width];
    for _ in 0..rows {
        reader.read_exact(&mut record).map_err(|e| format!("its records are cut off: {e}"))?;
        append_record(&record, members, &mut fields);
    }
    Ok(fields)
}

/// Reads so many bytes, in parts of whole numbers.
fn in_parts(reader: &mut dyn Read, mut left: usize, mut with: impl FnMut(&[u8])) -> io::Result<()> {
    let mut buffer = vec![0; PART.min(left)];
    while left > 0 {
        let part = &mut buffer[..PART.min(left)];
        reader.read_exact(part)?;
        with(part);
        left -= part.len();
    }
    Ok(())
}

fn number_of(descr: &str) -> Option<(Number, bool)> {
    let big_endian = descr.starts_with('>');
    let number = match descr.trim_start_matches(['<', '>', '|', '=']) {
        "f8" => Number::F64,
        "f4" => Number::F32,
        "f2" => Number::F16,
        "i8" => Number::I64,
        "i4" => Number::I32,
        "i2" => Number::I16,
        "i1" => Number::I8,
        "u8" => Number::U64,
        "u4" => Number::U32,
        "u2" => Number::U16,
        "u1" | "b1" => Number::U8,
        _ => return None,
    };
    Some((number, big_endian))
}
