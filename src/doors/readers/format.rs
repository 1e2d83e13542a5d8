//! Formats, recognised by their first bytes, never by the name of the file.

use crate::log::{Log, ReadError, Reader};
use std::io::{Read, Seek};

/// As many of the first bytes as tell every format.
const FIRST: u64 = 1024;

/// A format of logs or data files that is not text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// NumPy's archive of arrays.
    Npz,
    /// One array of NumPy.
    Npy,
    /// MATLAB's MAT-file, version 5 to 7.
    Mat,
    /// PX4's log.
    ULog,
    /// ArduPilot's log.
    DataFlash,
    /// WPILib's log.
    WpiLog,
    /// HDF5, and MATLAB's MAT-file of version 7.3.
    Hdf5,
    /// Apache Parquet.
    Parquet,
    /// A workbook of Excel.
    Xlsx,
    /// JSON: arrays of objects, objects of arrays.
    Json,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 10] = [
        Self::Npz,
        Self::Npy,
        Self::Mat,
        Self::ULog,
        Self::DataFlash,
        Self::WpiLog,
        Self::Hdf5,
        Self::Parquet,
        Self::Xlsx,
        Self::Json,
    ];

    /// The name that people use.
    pub fn name(self) -> &'static str {
        match self {
            Self::Npz => "NPZ",
            Self::Npy => "NPY",
            Self::Mat => "MAT",
            Self::ULog => "ULog",
            Self::DataFlash => "DataFlash",
            Self::WpiLog => "WPILOG",
            Self::Hdf5 => "HDF5",
            Self::Parquet => "Parquet",
            Self::Xlsx => "XLSX",
            Self::Json => "JSON",
        }
    }

    /// The feature of Cargo that switches its reader on.
    pub fn feature(self) -> &'static str {
        match self {
            Self::Npz | Self::Npy => "npz",
            Self::Mat => "mat",
            Self::ULog => "ulog",
            Self::DataFlash => "dataflash",
            Self::WpiLog => "wpilog",
            Self::Hdf5 => "hdf5",
            Self::Parquet => "parquet",
            Self::Xlsx => "xlsx",
            Self::Json => "json",
        }
    }

    /// The format of a file with these bytes; none for what is none of them, such as text.
    pub fn of(bytes: &[u8]) -> Option<Self> {
        let begins = |magic: &[u8]| bytes.starts_with(magic);
        // a MAT-file of version 7.3 is HDF5 behind 512 bytes of MATLAB's own
        let hdf5 = |at: usize| bytes.get(at..).is_some_and(|b| b.starts_with(b"\x89HDF\r\n\x1a\n"));
        // the first part of a zip says whose it is; its name stands behind thirty bytes
        let workbook = |name: &[u8]| bytes.get(30..).is_some_and(|b| b.starts_with(name));
        let workbook = [&b"[Content_Types].xml"[..], b"_rels/", b"docProps/", b"xl/"].into_iter().any(workbook);
        match () {
            () if begins(b"PK\x03\x04") && workbook => Some(Self::Xlsx),
            () if begins(b"PK\x03\x04") || begins(b"PK\x05\x06") => Some(Self::Npz),
            () if begins(b"\x93NUMPY") => Some(Self::Npy),
            () if begins(b"ULog\x01\x12\x35") => Some(Self::ULog),
            () if begins(&[0xa3, 0x95]) => Some(Self::DataFlash),
            () if begins(b"WPILOG") => Some(Self::WpiLog),
            () if hdf5(0) || hdf5(512) => Some(Self::Hdf5),
            () if begins(b"PAR1") => Some(Self::Parquet),
            () if begins(b"MATLAB 5.0 MAT-file") || begins(b"MATLAB 7.3 MAT-file") => Some(Self::Mat),
            () if matches!(bytes.get(124..128), Some([0, 1, b'I', b'M'] | [1, 0, b'M', b'I'])) => Some(Self::Mat),
            () if is_json(bytes) => Some(Self::Json),
            () => None,
        }
    }

    fn reader(self) -> Option<&'static dyn Reader> {
        match self {
            #[cfg(feature = "npz")]
            Self::Npz | Self::Npy => Some(&crate::npz::NumPy),
            #[cfg(feature = "mat")]
            Self::Mat => Some(&crate::mat::Mat),
            #[cfg(feature = "ulog")]
            Self::ULog => Some(&crate::ulog::ULog),
            #[cfg(feature = "dataflash")]
            Self::DataFlash => Some(&crate::dataflash::DataFlash),
            #[cfg(feature = "wpilog")]
            Self::WpiLog => Some(&crate::wpilog::WpiLog),
            #[cfg(feature = "hdf5")]
            Self::Hdf5 => Some(&crate::hdf5::Hdf5),
            #[cfg(feature = "parquet")]
            Self::Parquet => Some(&crate::parquet::Parquet),
            #[cfg(feature = "xlsx")]
            Self::Xlsx => Some(&crate::xlsx::Xlsx),
            #[cfg(feature = "json")]
            Self::Json => Some(&crate::json::Json),
            #[allow(unreachable_patterns, reason = "a build with all readers leaves none over")]
            _ => None,
        }
    }

    /// Whether this build reads it.
    pub fn is_read(self) -> bool {
        self.reader().is_some()
    }
}

/// Whether a file with these bytes is a log or data file, read or refused by its name; what is none of them is text.
pub fn is_known(bytes: &[u8]) -> bool {
    Format::of(bytes).is_some() || foreign(bytes).is_some()
}

/// Formats that are not read, by their first bytes, with what writes them as one that is.
fn foreign(bytes: &[u8]) -> Option<ReadError> {
    // their messages are of types that other files define, and packed by libraries of C
    const EXPORTED: [(&[u8], &str, &str); 5] = [
        (
            b"\x89MCAP",
            "MCAP",
            "write its topics as CSV, each by `ros2 topic echo --csv TOPIC > topic.csv` while `ros2 bag play FILE` runs, or all by PlotJuggler or Foxglove",
        ),
        (
            b"#ROSBAG",
            "a bag of ROS 1",
            "write its topics as CSV, each by `rostopic echo -b FILE.bag -p TOPIC > topic.csv`",
        ),
        (
            b"SQLite format 3\0",
            "a database of SQLite, such as bags of ROS 2",
            "write its topics as CSV, each by `ros2 topic echo --csv TOPIC > topic.csv` while `ros2 bag play FOLDER` runs",
        ),
        (
            b"TDSm",
            "TDMS",
            "write it as CSV, in Python by `nptdms.TdmsFile.read(FILE).as_dataframe().to_csv(\"run.csv\")`",
        ),
        (b"MDF     ", "MDF", "write it as CSV, in Python by `asammdf.MDF(FILE).export(\"csv\")`"),
    ];
    let of = |(first, format, how): (&[u8], &'static str, &'static str)| {
        bytes.starts_with(first).then_some(ReadError::Foreign { format, how })
    };
    EXPORTED.into_iter().find_map(of)
}

/// Reads a log or data file.
///
/// What is damaged stands in [`Log::damage`]; who goes on with such a log must say so.
///
/// # Errors
/// [`ReadError`] of a format that is unknown or switched off, and of a file of which nothing can be read.
pub fn open(bytes: &[u8]) -> Result<Log, ReadError> {
    let (format, reader) = reader_of(bytes)?;
    Ok(Log { format: format.name(), ..reader.read(bytes)? })
}

/// As [`open`], of a file: numbers of large archives go from it into their columns and do not stand in memory twice. None for a file of
/// no format that is known, such as text.
///
/// # Errors
/// As [`open`].
pub fn open_from(source: &mut (impl Read + Seek)) -> Option<Result<Log, ReadError>> {
    let mut first = Vec::new();
    let read = source.rewind().and_then(|()| source.by_ref().take(FIRST).read_to_end(&mut first));
    if let Err(e) = read {
        return Some(Err(ReadError::Unread(e.to_string())));
    }
    is_known(&first).then_some(())?;
    Some(reader_of(&first).and_then(|(format, reader)| Ok(Log { format: format.name(), ..reader.read_from(source)? })))
}

fn reader_of(bytes: &[u8]) -> Result<(Format, &'static dyn Reader), ReadError> {
    if let Some(foreign) = foreign(bytes) {
        return Err(foreign);
    }
    let Some(format) = Format::of(bytes) else {
        let names: Vec<_> = Format::ALL.iter().map(|f| f.name()).collect();
        return Err(ReadError::Unknown(names.join(", ")));
    };
    let off = ReadError::Off { format: format.name(), feature: format.feature() };
    Ok((format, format.reader().ok_or(off)?))
}

/// Whether bytes are JSON, by how they begin: a text table may begin with a bracket too, and no object or row of numbers.
fn is_json(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut signs = bytes.iter().filter(|b| !b.is_ascii_whitespace());
    match (signs.next(), signs.next()) {
        (Some(b'{'), Some(b'"')) => true,
        (Some(b'['), Some(b'{' | b'[')) => true,
        // a line of a text ends with the bracket of a name or a unit; an array has commas within
        (Some(b'['), Some(b'0'..=b'9' | b'-' | b'"')) => {
            bytes.iter().take_while(|b| **b != b']').filter(|b| **b == b',').count() > 1
        }
        _ => false,
    }
}
