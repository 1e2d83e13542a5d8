//! MATLAB's MAT-files of version 5 to 7: elements with a tag, packed ones with the checksum of zlib.
//!
//! Numbers, structs of numbers and cells of them are read. `table`, `timetable` and `iddata` are objects whose layout MathWorks does not
//! publish: they are named, and `fdm_export.m` writes them as plain arrays.
//! Source: MathWorks, MAT-File Format.

use crate::bytes::Number;
use crate::log::{Damage, Field, Log, ReadError, Reader, by_length, of_matrix};
use std::io::Read;

/// The reader.
pub(crate) struct Mat;

/// Bytes that all packed variables unpack to.
const LIMIT: u64 = 4 << 30;
/// Depth to which structs stand in structs.
const DEEPEST: usize = 16;
/// Most columns that one array is split into, and most fields of a file.
const WIDEST: usize = 10_000;

struct State {
    big_endian: bool,
    fields: Vec<Field>,
    remarks: Vec<String>,
}

impl Reader for Mat {
    fn read(&self, bytes: &[u8]) -> Result<Log, ReadError> {
        let broken = |what: &str, at: usize| ReadError::Broken { format: "MAT", what: what.into(), at: at as u64 };
        let big_endian = match bytes.get(124..128) {
            Some([0, 1, b'I', b'M']) => false,
            Some([1, 0, b'M', b'I']) => true,
            Some(_) => return Err(broken("its header names no version that is read", 124)),
            None => return Err(broken("it ends within its header", bytes.len())),
        };
        let mut state = State { big_endian, fields: Vec::new(), remarks: Vec::new() };
        let (mut damage, mut at, mut unpacked) = (Vec::new(), 128, 0);
        while at < bytes.len() {
            let lost = |what: String| Damage { at: at as u64, what: format!("a variable is lost: {what}") };
            let Some(element) = element(bytes, at, big_endian) else {
                damage.push(lost(format!("it reaches beyond the end of the file, which has {} bytes", bytes.len())));
                break;
            };
            let read = match element.kind {
                COMPRESSED => inflate(element.content, LIMIT - unpacked).and_then(|content| {
                    unpacked += content.len() as u64;
                    let inner = self::element(&content, 0, big_endian).filter(|e| e.kind == MATRIX);
                    let inner = inner.ok_or("it holds no variable")?;
                    if inner.end != content.len() {
                        return Err("it holds more than a variable".into());
                    }
                    state.matrix(inner.content, None, 0)
                }),
                MATRIX => state.matrix(element.content, None, 0),
                other => Err(format!("an element of type {other}")),
            };
            damage.extend(read.err().map(lost));
            // packed elements are not padded
            at = element.end;
        }
        Ok(Log { topics: by_length(state.fields), damage, remarks: state.remarks, ..Log::default() })
    }
}

const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;

/// A tagged piece of a file.
struct Element<'a> {
    kind: u32,
    content: &'a [u8],
    /// Offset behind it and its padding.
    end: usize,
}

fn element(bytes: &[u8], at: usize, big_endian: bool) -> Option<Element<'_>> {
    let word = |at: usize| {
        let four: [u8; 4] = bytes.get(at..at.checked_add(4)?)?.try_into().ok()?;
        Some(if big_endian { u32::from_be_bytes(four) } else { u32::from_le_bytes(four) })
    };
    let first = word(at)?;
    if first >> 16 != 0 {
        // a small element stands in its own tag
        let (size, kind) = ((first >> 16) as usize, first & 0xffff);
        let content = bytes.get(at + 4..at + 4 + size).filter(|_| size <= 4)?;
        return Some(Element { kind, content, end: at.checked_add(8)? }).filter(|e| e.end <= bytes.len());
    }
    let size = word(at + 4)? as usize;
    let content = bytes.get(at + 8..at.checked_add(8)?.checked_add(size)?)?;
    let end = at + 8 + size;
    let padded = if first == COMPRESSED { end } else { end.next_multiple_of(8) };
    (padded <= bytes.len()).then_some(Element { kind: first, content, end: padded })
}

fn inflate(packed: &[u8], limit: u64) -> Result<Vec<u8>, String> {
    let mut content = Vec::new();
    let mut decoder = flate2::read::ZlibDecoder::new(packed).take(limit + 1);
    decoder.read_to_end(&mut content).map_err(|e| e.to_string())?;
    if content.len() as u64 > limit {
        return Err(format!("more than {} GiB", LIMIT >> 30));
    }
    if decoder.get_ref().total_in() != packed.len() as u64 {
        return Err("bytes behind the packed ones".into());
    }
    Ok(content)
}

fn number_of(kind: u32) -> Option<Number> {
    Some(match kind {
        1 => Number::I8,
        2 => Number::U8,
        3 => Number::I16,
        4 => Number::U16,
        5 => Number::I32,
        6 => Number::U32,
        7 => Number::F32,
        9 => Number::F64,
        12 => Number::I64,
        13 => Number::U64,
        _ => return None,
    })
}

/// The elements of a variable, one after the other.
struct Parts<'a> {
    bytes: &'a [u8],
    at: usize,
    big_endian: bool,
}

impl<'a> Parts<'a> {
    fn next(&mut self) -> Result<Element<'a>, String> {
        let found = element(self.bytes, self.at, self.big_endian).ok_or("it is cut off")?;
        self.at = found.end;
        Ok(found)
    }

    fn numbers(&mut self) -> Result<Vec<f64>, String> {
        let part = self.next()?;
        let number = number_of(part.kind).ok_or_else(|| format!("numbers of type {}", part.kind))?;
        if part.content.len() % number.size() != 0 {
            return Err("a part of a number".into());
        }
        Ok(number.read_all(part.content, self.big_endian))
    }
}

impl State {
    /// Reads a variable, or a part of one whose name is known.
    fn matrix(&mut self, bytes: &[u8], name: Option<String>, depth: usize) -> Result<(), String> {
        if depth > DEEPEST || self.fields.len() > WIDEST {
            return Err("it is nested too deeply, or has too many parts".into());
        }
        if bytes.is_empty() {
            return Ok(());
        }
        let mut parts = Parts { bytes, at: 0, big_endian: self.big_endian };
        let flags = parts.next()?;
        // what a class has without a published layout follows its flags at once
        let class = if self.big_endian { flags.content.get(3) } else { flags.content.first() };
        let class = *class.filter(|_| flags.kind == 6 && flags.content.len() == 8).ok_or("its flags are missing")?;
        let complex = flags.content.get(if self.big_endian { 2 } else { 1 }).is_some_and(|f| f & 0x08 != 0);
        if class == 17 {
            let own = parts.next().ok().and_then(|p| str::from_utf8(p.content).ok()).unwrap_or_default();
            let class_name = parts.next().and_then(|_| parts.next()).ok();
            let class_name = class_name.and_then(|p| str::from_utf8(p.content).ok()).unwrap_or_default();
            self.opaque(name.as_deref().unwrap_or(own), class_name);
            return Ok(());
        }
        let dimensions: Vec<usize> = parts.numbers()?.iter().map(|d| *d as usize).collect();
        let own = parts.next()?;
        let own = str::from_utf8(own.content).ok().filter(|n| own.kind == 1 && n.bytes().all(|b| b.is_ascii_graphic()));
        let own = own.ok_or("its name is no text")?;
        let name = name.unwrap_or_else(|| own.to_string());
        let count = dimensions.iter().try_fold(1_usize, |n, d| n.checked_mul(*d)).filter(|_| dimensions.len() >= 2);
        let count = count.ok_or("its dimensions")?;
        let outside = |at: usize| if at == bytes.len() { Ok(()) } else { Err("bytes behind its end".to_string()) };
        match class {
            1 => {
                for k in 0..count {
                    let part = parts.next()?;
                    let path = if count == 1 { name.clone() } else { format!("{name}{{{}}}", k + 1) };
                    if part.kind != MATRIX {
                        return Err("a cell that holds no variable".into());
                    }
                    self.matrix(part.content, Some(path), depth + 1)?;
                }
                outside(parts.at)
            }
            2 | 3 => {
                if class == 3 {
                    let class_name = parts.next()?;
                    self.opaque(&name, str::from_utf8(class_name.content).unwrap_or_default());
                }
                self.structure(&mut parts, &name, count, depth, class == 2)?;
                outside(parts.at)
            }
            4 => {
                self.remarks.push(format!("`{name}` is text"));
                Ok(())
            }
            6..=15 => {
                let values = parts.numbers()?;
                if values.len() != count {
                    return Err(format!("`{name}` has {} numbers, and its dimensions have {count}", values.len()));
                }
                if complex {
                    self.remarks.push(format!("`{name}` is complex; its real part is read"));
                    parts.next()?;
                }
                outside(parts.at)?;
                self.columns(name, &dimensions, values);
                Ok(())
            }
            5 => {
                self.remarks.push(format!("`{name}` is a sparse matrix, which is not read"));
                Ok(())
            }
            other => Err(format!("`{name}` is of class {other}")),
        }
    }

    fn structure(
        &mut self,
        parts: &mut Parts<'_>,
        name: &str,
        count: usize,
        depth: usize,
        read: bool,
    ) -> Result<(), String> {
        let length =
            parts.numbers()?.first().copied().filter(|n| (1.0..=1024.0).contains(n)).ok_or("its names")? as usize;
        let names = parts.next()?.content;
        let names: Vec<&str> = names
            .chunks(length)
            .map(|n| crate::bytes::name(n).ok_or("its names are no text"))
            .collect::<Result<_, _>>()?;
        for k in 0..count {
            let element = if count == 1 { name.to_string() } else { format!("{name}({})", k + 1) };
            for field in &names {
                let part = parts.next()?;
                if part.kind != MATRIX {
                    return Err("a field that holds no variable".into());
                }
                if read {
                    self.matrix(part.content, Some(format!("{element}.{field}")), depth + 1)?;
                }
            }
        }
        Ok(())
    }

    fn opaque(&mut self, name: &str, class: &str) {
        self.remarks.push(format!(
            "`{name}` is an object of the class `{class}`, whose layout is not published; in MATLAB, `fdm_export(NAME, 'run.csv')` writes it"
        ));
    }

    /// A vector is a column; of a matrix each column is one.
    fn columns(&mut self, name: String, dimensions: &[usize], values: Vec<f64>) {
        match dimensions {
            [_, 1] | [1, _] => self.fields.push(Field::new(name, None, values)),
            [rows, columns] if *columns <= WIDEST && *rows > 0 => {
                let title = |row: Option<usize>, column: Option<usize>| match (row, column) {
                    (Some(row), _) => format!("{name}({},:)", row + 1),
                    (_, column) => format!("{name}(:,{})", column.unwrap_or(0) + 1),
                };
                self.fields.extend(of_matrix((*rows, *columns), &title, &|r, c| values[c * rows + r]));
            }
            _ if values.is_empty() => self.remarks.push(format!("`{name}` is empty")),
            _ => self.remarks.push(format!("`{name}` has {} dimensions; arrays of two are read", dimensions.len())),
        }
    }
}
