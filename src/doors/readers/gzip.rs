//! Compressed text, `run.csv.gz`: unpacked whole, with its checksum.

use crate::log::ReadError;

/// The bytes of a gzip file; none for what is not one.
///
/// # Errors
/// A file that is cut or whose checksum is another, one larger than `limit` bytes, and a build without the feature `gzip`.
pub fn unzipped(bytes: &[u8], limit: u64) -> Option<Result<Vec<u8>, ReadError>> {
    bytes.starts_with(&[0x1f, 0x8b]).then(|| unpack(bytes, limit))
}

#[cfg(feature = "gzip")]
fn unpack(bytes: &[u8], limit: u64) -> Result<Vec<u8>, ReadError> {
    use std::io::Read;
    let mut text = Vec::new();
    let mut decoder = flate2::read::MultiGzDecoder::new(bytes).take(limit + 1);
    let broken = |what: String| ReadError::Broken { format: "gzip", what, at: bytes.len() as u64 };
    match decoder.read_to_end(&mut text) {
        Ok(_) if text.len() as u64 > limit => Err(ReadError::TooLarge { format: "gzip", limit }),
        Ok(_) => Ok(text),
        Err(e) => Err(broken(format!("{e} after {} bytes of its contents; it may have been cut off", text.len()))),
    }
}

#[cfg(not(feature = "gzip"))]
fn unpack(_: &[u8], _: u64) -> Result<Vec<u8>, ReadError> {
    Err(ReadError::Off { format: "gzip", feature: "gzip" })
}
