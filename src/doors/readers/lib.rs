//! Logs and data files as they come: **in** the bytes of a file, **out** its topics ([`Log`]), each with fields over its own clock, everything
//! that is damaged in the file, and, by a [`RecordMap`], columns over one time for the channels of a model.
//!
//! **Never** knows a model or its units, and never repairs silently: [`open`] tells what was lost, and the caller refuses it or says so.
//! **Start** at [`open`] (bytes to log) and [`take`] (log to columns). One file below a format, each behind the feature of its name.

mod bytes;
#[cfg(feature = "dataflash")]
mod dataflash;
mod format;
pub mod frame;
mod gzip;
#[cfg(feature = "hdf5")]
mod hdf5;
mod input;
#[cfg(feature = "json")]
mod json;
mod log;
mod map;
#[cfg(feature = "mat")]
mod mat;
#[cfg(any(feature = "npz", feature = "hdf5"))]
mod members;
#[cfg(feature = "npz")]
mod npz;
#[cfg(feature = "parquet")]
mod parquet;
#[cfg(test)]
mod samples;
mod take;
#[cfg(test)]
mod tests;
#[cfg(feature = "ulog")]
mod ulog;
#[cfg(feature = "wpilog")]
mod wpilog;
#[cfg(feature = "xlsx")]
mod xlsx;
mod xml;
#[cfg(any(feature = "npz", feature = "xlsx"))]
mod zip;

pub use format::{Format, is_known, open, open_from};
pub use gzip::unzipped;
pub use input::{InputError, open_input};
pub use log::{Damage, Field, Log, ReadError, Sheet, Topic};
pub use map::{ChannelMap, ClockMap, FreeDelay, MapError, RecordMap, TimeMap, shipped};
pub use take::{TakeError, Taken, TakenColumn, take, unwrap};
pub use xml::{MOST_ATTRIBUTES, refuse_endless_xml};
