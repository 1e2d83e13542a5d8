//! The form in which a state lies on the disk: a header with magic, version, sequence number, length and checksum, then
//! the state itself.

use std::fmt;

const MAGIC: &[u8; 8] = b"fdm-kept";
const VERSION: u32 = 1;
/// Magic, version, sequence number, length, checksum.
const HEADER: usize = 8 + 4 + 8 + 8 + 4;

/// Why bytes are not a state that was kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Damage {
    Foreign,
    Version(u32),
    Length { found: usize, wanted: u64 },
    Checksum,
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Foreign => write!(f, "it does not begin like a file of fdm"),
            Self::Version(v) => write!(f, "its format is version {v}, this program reads version {VERSION}"),
            Self::Length { found, wanted } => write!(f, "it holds {found} of {wanted} bytes"),
            Self::Checksum => write!(f, "its checksum does not fit its content"),
        }
    }
}

/// The bytes of a file that keeps `state` under `name`; the higher the sequence number, the newer.
pub(super) fn seal(name: &str, sequence: u64, state: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEADER + state.len());
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(&sequence.to_le_bytes());
    bytes.extend_from_slice(&(state.len() as u64).to_le_bytes());
    let sum = checksum(name, &bytes, state);
    bytes.extend_from_slice(&sum.to_le_bytes());
    bytes.extend_from_slice(state);
    bytes
}

/// Sequence number and state of a file.
pub(super) fn open(name: &str, bytes: &[u8]) -> Result<(u64, Vec<u8>), Damage> {
    let (header, state) = bytes.split_at_checked(HEADER).ok_or(Damage::Foreign)?;
    if !header.starts_with(MAGIC) {
        return Err(Damage::Foreign);
    }
    let (version, sequence, length, sum) = (four(header, 8), eight(header, 12), eight(header, 20), four(header, 28));
    if version != VERSION {
        return Err(Damage::Version(version));
    }
    if state.len() as u64 != length {
        return Err(Damage::Length { found: state.len(), wanted: length });
    }
    if checksum(name, &header[..HEADER - 4], state) != sum {
        return Err(Damage::Checksum);
    }
    Ok((sequence, state.to_vec()))
}

/// Covers the name too, so that files that changed places are noticed.
fn checksum(name: &str, header: &[u8], state: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    [name.as_bytes(), header, state].iter().for_each(|part| hasher.update(part));
    hasher.finalize()
}

fn four(bytes: &[u8], at: usize) -> u32 {
    let mut number = [0; 4];
    number.copy_from_slice(&bytes[at..at + 4]);
    u32::from_le_bytes(number)
}

fn eight(bytes: &[u8], at: usize) -> u64 {
    let mut number = [0; 8];
    number.copy_from_slice(&bytes[at..at + 8]);
    u64::from_le_bytes(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cut_and_every_flipped_bit_is_noticed() {
        let sealed = seal("start-3", 17, b"the state of a fit");
        assert_eq!(open("start-3", &sealed), Ok((17, b"the state of a fit".to_vec())));
        for length in 0..sealed.len() {
            assert!(open("start-3", &sealed[..length]).is_err(), "cut to {length} bytes");
        }
        for bit in 0..8 * sealed.len() {
            let mut flipped = sealed.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(open("start-3", &flipped).is_err(), "bit {bit}");
        }
        assert_eq!(open("start-4", &sealed), Err(Damage::Checksum), "a file that changed its name");
        assert!(open("start-3", &[&sealed[..], b"x"].concat()).is_err(), "a tail");
        assert_eq!(open("", &seal("", 0, b"")), Ok((0, Vec::new())));
    }
}
