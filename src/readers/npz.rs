//! NumPy's archives: a zip of arrays, each with a checksum; and single arrays, which have none.
//!
//! The reader is our own: the crates for zip bring archives of every other kind and a second copy of crates that are here already.
//! Sources: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>, PKWARE's APPNOTE.

use crate::bytes::{Bytes, Number};
use crate::log::{Damage, Field, Log, ReadError, Reader, by_length};
use std::borrow::Cow;
use std::io::Read;

/// The reader.
pub(crate) struct NumPy;

/// Largest array that is unpacked, and all of them together.
const LIMIT: u64 = 4 << 30;
/// Most columns that one array is split into.
const WIDEST: usize = 10_000;

impl Reader for NumPy {
    fn read(&self, bytes: &[u8]) -> Result<Log, ReadError> {
        if bytes.starts_with(b"\x93NUMPY") {
            let broken = |what| ReadError::Broken { format: "NPY", what, at: 0 };
            let mut remarks = Vec::new();
            let fields = array("value", bytes, &mut remarks).map_err(broken)?;
            return Ok(Log { topics: by_length(fields), remarks, ..Log::default() });
        }
        let mut found = Found::default();
        for (k, entry) in directory(bytes)?.into_iter().enumerate() {
            found.take(k, &entry, bytes);
        }
        Ok(found.log())
    }

    fn read_whole(&self, mut bytes: Vec<u8>) -> Result<Log, ReadError> {
        if bytes.starts_with(b"\x93NUMPY") {
            return self.read(&bytes);
        }
        let mut entries: Vec<(usize, Entry)> = directory(&bytes)?.into_iter().enumerate().collect();
        // the last of the file first: what stands behind the others is not needed any more
        entries.sort_by_key(|(_, entry)| std::cmp::Reverse(entry.at));
        let mut found = Found::default();
        for (k, entry) in entries {
            found.take(k, &entry, &bytes);
            bytes.truncate(entry.at);
            bytes.shrink_to_fit();
        }
        Ok(found.log())
    }
}

/// What was found in an archive, by the place in its directory.
#[derive(Default)]
struct Found {
    fields: Vec<(usize, Vec<Field>)>,
    damage: Vec<(usize, Damage)>,
    remarks: Vec<(usize, String)>,
    /// Bytes that were unpacked.
    size: u64,
}

impl Found {
    fn take(&mut self, place: usize, entry: &Entry, bytes: &[u8]) {
        let Some(name) = entry.name.strip_suffix(".npy") else {
            self.remarks.push((place, format!("`{}` is no array", entry.name.escape_debug())));
            return;
        };
        let mut remarks = Vec::new();
        let found = entry.unpacked(bytes, LIMIT - self.size).and_then(|content| {
            self.size += content.len() as u64;
            array(name, &content, &mut remarks)
        });
        self.remarks.extend(remarks.into_iter().map(|remark| (place, remark)));
        match found {
            Ok(found) => self.fields.push((place, found)),
            Err(what) => {
                let damage = Damage { at: entry.at as u64, what: format!("the array `{name}` is lost: {what}") };
                self.damage.push((place, damage));
            }
        }
    }

    /// All of it in the order of the directory.
    fn log(mut self) -> Log {
        fn ordered<T>(list: &mut Vec<(usize, T)>) -> impl Iterator<Item = T> + use<'_, T> {
            list.sort_by_key(|(place, _)| *place);
            list.drain(..).map(|(_, of)| of)
        }
        let fields = ordered(&mut self.fields).flatten().collect();
        let (damage, remarks) = (ordered(&mut self.damage).collect(), ordered(&mut self.remarks).collect());
        Log { topics: by_length(fields), damage, remarks, ..Log::default() }
    }
}

/// A file in the archive, as its directory says.
struct Entry {
    name: String,
    method: u16,
    crc: u32,
    packed: u64,
    size: u64,
    at: usize,
}

/// The directory at the end of a zip file.
fn directory(bytes: &[u8]) -> Result<Vec<Entry>, ReadError> {
    let broken = |what: &str, at: usize| ReadError::Broken { format: "NPZ", what: what.into(), at: at as u64 };
    let tail = bytes.len().saturating_sub(22 + 0xffff);
    let end = bytes[tail..].windows(4).rposition(|w| w == b"PK\x05\x06").map(|k| k + tail);
    let end = end.ok_or_else(|| broken("the archive has no directory; it may have been cut off", bytes.len()))?;
    let mut reader = Bytes { all: bytes, at: end + 8 };
    let (_, count, size, start, comment) =
        (|| Some((reader.u16()?, reader.u16()?, reader.u32()?, reader.u32()?, reader.u16()?)))()
            .ok_or_else(|| broken("the directory is cut off", end))?;
    let (mut count, mut start, mut size) = (u64::from(count), u64::from(start), u64::from(size));
    if end + 22 + usize::from(comment) != bytes.len() {
        return Err(broken("there are bytes behind the end of the archive", end));
    }
    let mut behind = end;
    if start == u64::from(u32::MAX) || count == 0xffff {
        let large = end.checked_sub(20).filter(|at| bytes[*at..].starts_with(b"PK\x06\x07"));
        let place = large.and_then(|at| Bytes { all: bytes, at: at + 8 }.u64()).and_then(|at| usize::try_from(at).ok());
        let record = place.filter(|at| bytes.get(*at..).is_some_and(|b| b.starts_with(b"PK\x06\x06")));
        let at = record.ok_or_else(|| broken("the directory of a large archive is not there", end))?;
        let mut reader = Bytes { all: bytes, at: at + 32 };
        (count, size, start) = (|| Some((reader.u64()?, reader.u64()?, reader.u64()?)))()
            .ok_or_else(|| broken("the directory is cut off", at))?;
        behind = at;
    }
    if start.checked_add(size) != Some(behind as u64) {
        return Err(broken("the directory is not where the archive says", end));
    }
    let mut reader = Bytes { all: bytes, at: start as usize };
    let mut entries = Vec::new();
    for _ in 0..count {
        let at = reader.at;
        entries.push(entry(&mut reader).ok_or_else(|| broken("an entry of the directory is damaged", at))?);
    }
    if reader.at != behind {
        Err(broken("the directory has another length than the archive says", reader.at))
    } else {
        Ok(entries)
    }
}

fn entry(reader: &mut Bytes<'_>) -> Option<Entry> {
    if reader.take(4)? != b"PK\x01\x02" {
        return None;
    }
    reader.take(4)?;
    let (flags, method) = (reader.u16()?, reader.u16()?);
    reader.take(4)?;
    let crc = reader.u32()?;
    let (mut packed, mut size) = (u64::from(reader.u32()?), u64::from(reader.u32()?));
    let (name, extra, comment) = (reader.u16()?, reader.u16()?, reader.u16()?);
    reader.take(8)?;
    let mut at = u64::from(reader.u32()?);
    let name = String::from_utf8(reader.take(name.into())?.to_vec()).ok()?;
    let mut extra = Bytes::new(reader.take(extra.into())?);
    reader.take(comment.into())?;
    while extra.left() >= 4 {
        let (kind, length) = (extra.u16()?, extra.u16()?);
        let mut content = Bytes::new(extra.take(length.into())?);
        if kind == 1 {
            for number in [&mut size, &mut packed, &mut at] {
                if *number == u64::from(u32::MAX) {
                    *number = content.u64()?;
                }
            }
        }
    }
    // what is encrypted is not read
    (flags & 1 == 0).then_some(Entry { name, method, crc, packed, size, at: usize::try_from(at).ok()? })
}

impl Entry {
    fn unpacked<'a>(&self, all: &'a [u8], limit: u64) -> Result<Cow<'a, [u8]>, String> {
        let mut reader = Bytes { all, at: self.at.min(all.len()) };
        let head = |reader: &mut Bytes<'_>| {
            let signed = reader.take(4)? == b"PK\x03\x04";
            reader.take(4)?;
            let method = reader.u16()?;
            reader.take(16)?;
            let (name, extra) = (reader.u16()?, reader.u16()?);
            let name = reader.take(name.into())?;
            reader.take(extra.into())?;
            (signed && method == self.method && name == self.name.as_bytes()).then_some(())
        };
        head(&mut reader).ok_or("its header is not that of the directory")?;
        let packed = usize::try_from(self.packed).ok().and_then(|n| reader.take(n));
        let packed = packed.ok_or("it reaches beyond the end of the file")?;
        if self.size > limit {
            return Err(format!("it has {} bytes, and {} GiB are read", self.size, LIMIT >> 30));
        }
        let content = match self.method {
            0 => Cow::Borrowed(packed),
            8 => {
                let mut content = Vec::new();
                let mut inflate = flate2::read::DeflateDecoder::new(packed).take(self.size + 1);
                inflate.read_to_end(&mut content).map_err(|e| e.to_string())?;
                Cow::Owned(content)
            }
            other => return Err(format!("it is packed by the method {other}, and 0 and 8 are read")),
        };
        if content.len() as u64 != self.size || crc32fast::hash(&content) != self.crc {
            return Err("its checksum is another".into());
        }
        Ok(content)
    }
}

/// The columns of an array: one dimension is a column, of two each column is one.
fn array(name: &str, bytes: &[u8], remarks: &mut Vec<String>) -> Result<Vec<Field>, String> {
    let mut reader = Bytes::new(bytes);
    let magic = reader.take(6).filter(|m| *m == b"\x93NUMPY").and_then(|_| reader.u16());
    let length = match magic.map(|v| v & 0xff) {
        Some(1) => reader.u16().map(u32::from),
        Some(2 | 3) => reader.u32(),
        _ => return Err("it does not begin as an array".into()),
    };
    let header = length.and_then(|n| reader.take(n as usize)).and_then(|h| str::from_utf8(h).ok());
    let header = header.ok_or("its header is cut off")?;
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
    let descr = value("descr").and_then(|v| v.strip_prefix('\'')).and_then(|v| v.split_once('\''));
    let shape = value("shape").and_then(|v| v.strip_prefix('(')).and_then(|v| v.split_once(')'));
    let fortran = value("fortran_order").map(|v| v.starts_with("True"));
    let (Some((shape, _)), Some(fortran)) = (shape, fortran) else { return Err(bad()) };
    let dimensions: Option<Vec<usize>> =
        shape.split(',').map(str::trim).filter(|d| !d.is_empty()).map(|d| d.parse().ok()).collect();
    let dimensions = dimensions.ok_or_else(bad)?;
    let Some((descr, _)) = descr else {
        remarks.push(format!("`{name}` is an array of records, which are not read"));
        return Ok(Vec::new());
    };
    let Some((number, big_endian)) = number_of(descr) else {
        remarks.push(format!("`{name}` holds `{descr}`, and no numbers"));
        return Ok(Vec::new());
    };
    let count = dimensions.iter().try_fold(1_usize, |n, d| n.checked_mul(*d));
    let expected = count.and_then(|n| n.checked_mul(number.size())).ok_or_else(bad)?;
    if reader.left() != expected {
        return Err(format!("it has {} bytes of numbers, and its shape ({shape}) has {expected}", reader.left()));
    }
    let values = number.read_all(reader.take(expected).unwrap_or_default(), big_endian);
    Ok(match dimensions[..] {
        [] | [_] => vec![Field::new(name, None, values)],
        [n, 1] | [1, n] if values.len() == n => vec![Field::new(name, None, values)],
        [rows, columns] if columns <= WIDEST => {
            let at = |row: usize, column: usize| if fortran { column * rows + row } else { row * columns + column };
            let column =
                |c: usize| Field::new(format!("{name}[:,{c}]"), None, (0..rows).map(|r| values[at(r, c)]).collect());
            (0..columns).map(column).collect()
        }
        _ => {
            remarks.push(format!("`{name}` has the shape ({shape}); arrays of one or two dimensions are read"));
            Vec::new()
        }
    })
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
