//! Bytes read with a look at their end: no offset from a file is believed.
#![allow(dead_code, reason = "which of these are used depends on the formats that are built")]

/// A place in bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bytes<'a> {
    pub(crate) all: &'a [u8],
    pub(crate) at: usize,
}

impl<'a> Bytes<'a> {
    pub(crate) fn new(all: &'a [u8]) -> Self {
        Self { all, at: 0 }
    }

    pub(crate) fn left(&self) -> usize {
        self.all.len() - self.at
    }

    /// The next bytes, or nothing where there are not so many.
    pub(crate) fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let taken = self.all.get(self.at..self.at.checked_add(n)?)?;
        self.at += n;
        Some(taken)
    }

    pub(crate) fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.array::<1>().map(|b| b[0])
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }
}

/// Types of numbers that occur in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
}

impl Number {
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 | Self::F16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// One number of as many bytes as this has.
    pub(crate) fn read(self, bytes: &[u8], big_endian: bool) -> Option<f64> {
        macro_rules! of {
            ($t:ty) => {{
                let array = bytes.try_into().ok()?;
                if big_endian { <$t>::from_be_bytes(array) } else { <$t>::from_le_bytes(array) }
            }};
        }
        Some(match self {
            Self::I8 => f64::from(of!(i8)),
            Self::U8 => f64::from(of!(u8)),
            Self::I16 => f64::from(of!(i16)),
            Self::U16 => f64::from(of!(u16)),
            Self::I32 => f64::from(of!(i32)),
            Self::U32 => f64::from(of!(u32)),
            Self::I64 => of!(i64) as f64,
            Self::U64 => of!(u64) as f64,
            Self::F16 => half(of!(u16)),
            Self::F32 => f64::from(of!(f32)),
            Self::F64 => of!(f64),
        })
    }

    /// Adds all numbers of bytes that hold nothing else.
    pub(crate) fn append(self, bytes: &[u8], big_endian: bool, to: &mut Vec<f64>) {
        if self == Self::F64 && !big_endian {
            // the usual case, without a look at each number
            to.extend(bytes.as_chunks().0.iter().map(|number| f64::from_le_bytes(*number)));
        } else {
            to.extend(bytes.chunks_exact(self.size()).filter_map(|number| self.read(number, big_endian)));
        }
    }

    /// All numbers of bytes that hold nothing else.
    pub(crate) fn read_all(self, bytes: &[u8], big_endian: bool) -> Vec<f64> {
        let mut values = Vec::with_capacity(bytes.len() / self.size());
        self.append(bytes, big_endian, &mut values);
        values
    }
}

/// A number of half precision.
fn half(bits: u16) -> f64 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let (exponent, fraction) = ((bits >> 10) & 0x1f, f64::from(bits & 0x3ff));
    sign * match exponent {
        0 => fraction * f64::powi(2.0, -24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        e => (1.0 + fraction / 1024.0) * f64::powi(2.0, i32::from(e) - 15),
    }
}

/// Text up to the first zero, as far as it is text.
pub(crate) fn name(bytes: &[u8]) -> Option<&str> {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    str::from_utf8(&bytes[..end]).ok()
}
