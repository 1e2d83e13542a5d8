//! Zip archives, as NumPy and Excel use them: entries that are stored or deflated, each with a checksum.
//!
//! The reader is our own: the crates for zip bring archives of every other kind and a second copy of crates that are here already.
//! Source: PKWARE's APPNOTE.

use crate::bytes::Bytes;
use crate::log::{ReadError, Source};
use std::io::{self, Read, SeekFrom};

/// Most bytes that one packed byte becomes.
const DENSEST: u64 = 1100;

/// A file in an archive, as its directory says.
pub(crate) struct Entry {
    pub(crate) name: String,
    method: u16,
    crc: u32,
    packed: u64,
    /// Bytes of its contents.
    pub(crate) size: u64,
    /// Its place in the archive.
    pub(crate) at: u64,
}

/// Bytes of a source from `at` on, as many as `length` or as there are.
fn part(source: &mut dyn Source, at: u64, length: u64) -> io::Result<Vec<u8>> {
    source.seek(SeekFrom::Start(at))?;
    let mut bytes = Vec::new();
    source.take(length).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The directory at the end of an archive of this format.
pub(crate) fn directory(source: &mut dyn Source, format: &'static str) -> Result<Vec<Entry>, ReadError> {
    let broken = |what: &str, at: u64| ReadError::Broken { format, what: what.into(), at };
    let unread = |e: io::Error| broken(&e.to_string(), 0);
    let length = source.seek(SeekFrom::End(0)).map_err(unread)?;
    let first = length.saturating_sub(22 + 0xffff);
    let tail = part(source, first, length - first).map_err(unread)?;
    let end = tail.windows(4).rposition(|w| w == b"PK\x05\x06");
    let end = end.ok_or_else(|| broken("the archive has no directory; it may have been cut off", length))?;
    let mut reader = Bytes { all: &tail, at: end + 8 };
    let mut behind = first + end as u64;
    let (_, count, size, start, comment) =
        (|| Some((reader.u16()?, reader.u16()?, reader.u32()?, reader.u32()?, reader.u16()?)))()
            .ok_or_else(|| broken("the directory is cut off", behind))?;
    let (mut count, mut start, mut size) = (u64::from(count), u64::from(start), u64::from(size));
    if behind + 22 + u64::from(comment) != length {
        return Err(broken("there are bytes behind the end of the archive", behind));
    }
    if start == u64::from(u32::MAX) || count == 0xffff {
        let large = end.checked_sub(20).filter(|at| tail[*at..].starts_with(b"PK\x06\x07"));
        let place = large.and_then(|at| Bytes { all: &tail, at: at + 8 }.u64());
        let record = place.and_then(|at| part(source, at, 56).ok().map(|record| (at, record)));
        let (at, record) = record
            .filter(|(_, record)| record.starts_with(b"PK\x06\x06"))
            .ok_or_else(|| broken("the directory of a large archive is not there", behind))?;
        let mut reader = Bytes { all: &record, at: 32 };
        (count, size, start) = (|| Some((reader.u64()?, reader.u64()?, reader.u64()?)))()
            .ok_or_else(|| broken("the directory is cut off", at))?;
        behind = at;
    }
    if start.checked_add(size) != Some(behind) {
        return Err(broken("the directory is not where the archive says", behind));
    }
    let listed = part(source, start, size).map_err(unread)?;
    let mut reader = Bytes::new(&listed);
    let mut entries = Vec::new();
    for _ in 0..count {
        let at = start + reader.at as u64;
        entries.push(entry(&mut reader).ok_or_else(|| broken("an entry of the directory is damaged", at))?);
    }
    // entries that share bytes would become more than any of them could
    let packed = entries.iter().fold(0_u64, |sum, entry| sum.saturating_add(entry.packed));
    if packed > length {
        return Err(broken("the files in the archive have more bytes than it: they share them", start));
    }
    if reader.left() > 0 {
        Err(broken("the directory has another length than the archive says", start + reader.at as u64))
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
    (flags & 1 == 0).then_some(Entry { name, method, crc, packed, size, at })
}

/// Bytes that are counted and summed up while they are read.
struct Checked<R> {
    inner: R,
    crc: crc32fast::Hasher,
    count: u64,
}

impl<R: Read> Read for Checked<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.inner.read(buffer)?;
        self.crc.update(&buffer[..n]);
        self.count += n as u64;
        Ok(n)
    }
}

impl Entry {
    /// Gives its contents, of not more than `limit` bytes, to `with`, and looks at their checksum afterwards. `with` is told their size, and
    /// how many bytes they can have at most, which differs where the directory is damaged.
    ///
    /// # Errors
    /// What is wrong with the entry, in words.
    pub(crate) fn unpack<T>(
        &self,
        source: &mut dyn Source,
        limit: u64,
        with: impl FnOnce(&mut dyn Read, (u64, u64)) -> T,
    ) -> Result<T, String> {
        let told = |e: io::Error| e.to_string();
        let head = part(source, self.at, 30).map_err(told)?;
        let mut reader = Bytes::new(&head);
        let lengths = (|| {
            let signed = reader.take(4)? == b"PK\x03\x04";
            reader.take(4)?;
            let method = reader.u16()?;
            reader.take(16)?;
            (signed && method == self.method).then_some((reader.u16()?, reader.u16()?))
        })();
        let other = "its header is not that of the directory";
        let (name_length, extra) = lengths.ok_or(other)?;
        if part(source, self.at + 30, name_length.into()).map_err(told)? != self.name.as_bytes() {
            return Err(other.into());
        }
        let begin = self.at + 30 + u64::from(name_length) + u64::from(extra);
        let length = source.seek(SeekFrom::End(0)).map_err(told)?;
        if begin.checked_add(self.packed).is_none_or(|end| end > length) {
            return Err("it reaches beyond the end of the file".into());
        }
        if self.size > limit {
            return Err(format!("it has {} bytes, and {limit} more are read", self.size));
        }
        source.seek(SeekFrom::Start(begin)).map_err(told)?;
        let packed = source.take(self.packed);
        let inner: Box<dyn Read + '_> = match self.method {
            0 => Box::new(packed),
            8 => Box::new(flate2::read::DeflateDecoder::new(packed)),
            other => return Err(format!("it is packed by the method {other}, and 0 and 8 are read")),
        };
        // what a damaged entry says of its size costs no memory
        let possible = if self.method == 0 { self.packed } else { self.packed.saturating_mul(DENSEST) };
        let mut content = Checked { inner: inner.take(self.size + 1), crc: crc32fast::Hasher::new(), count: 0 };
        let found = with(&mut content, (self.size, possible));
        io::copy(&mut content, &mut io::sink()).map_err(told)?;
        if content.count != self.size || content.crc.finalize() != self.crc {
            return Err("its checksum is another".into());
        }
        Ok(found)
    }
}
