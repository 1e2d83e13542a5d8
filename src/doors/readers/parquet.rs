//! Apache Parquet: flat columns of numbers, packed by Snappy, gzip or LZ4; with checksums of pages where the writer made them.

use crate::log::{Damage, Field, Log, ReadError, Reader, by_length};
use parquet::basic::{LogicalType, TimeUnit};
use parquet::column::reader::ColumnReader;
use parquet::data_type::{ByteArray, Int96};
use parquet::file::reader::{FileReader, SerializedFileReader};

/// The reader.
pub(crate) struct Parquet;

impl Reader for Parquet {
    fn read(&self, bytes: &[u8]) -> Result<Log, ReadError> {
        let broken = |e: parquet::errors::ParquetError| ReadError::Broken {
            format: "Parquet",
            what: e.to_string(),
            at: bytes.len() as u64,
        };
        let file = SerializedFileReader::new(bytes::Bytes::copy_from_slice(bytes)).map_err(broken)?;
        let about = file.metadata().file_metadata();
        let schema = about.schema_descr();
        let (mut fields, mut damage, mut remarks) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..schema.num_columns() {
            let column = schema.column(k);
            let name = column.path().string();
            if column.max_rep_level() > 0 {
                remarks.push(format!("`{name}` holds lists, which are not read"));
                continue;
            }
            let (mut values, mut texts) = (Vec::new(), Vec::new());
            let read = (0..file.num_row_groups()).try_for_each(|group| {
                let group = file.get_row_group(group).map_err(|e| e.to_string())?;
                let rows = usize::try_from(group.metadata().num_rows()).map_err(|e| e.to_string())?;
                let reader = group.get_column_reader(k).map_err(|e| e.to_string())?;
                append(reader, rows, column.max_def_level(), (&mut values, &mut texts))
            });
            match read {
                Ok(()) => {
                    let unit = match column.logical_type_ref() {
                        Some(LogicalType::Timestamp(t)) => Some(unit(t.unit)),
                        _ => None,
                    };
                    let expected = about.num_rows();
                    if (values.len() + texts.len()) as i64 == expected {
                        fields.push(Field { name, unit, values, texts });
                    } else {
                        let what = format!("`{name}` is lost: {} values in a table of {expected} rows", values.len());
                        damage.push(Damage { at: bytes.len() as u64, what });
                    }
                }
                Err(what) if what.is_empty() => remarks.push(format!("`{name}` holds no numbers")),
                Err(what) => damage.push(Damage { at: bytes.len() as u64, what: format!("`{name}` is lost: {what}") }),
            }
        }
        Ok(Log { topics: by_length(fields), damage, remarks, ..Log::default() })
    }
}

fn unit(unit: TimeUnit) -> String {
    match unit {
        TimeUnit::MILLIS => "ms",
        TimeUnit::MICROS => "us",
        TimeUnit::NANOS => "ns",
    }
    .into()
}

/// Reads the values of a group of rows, numbers or texts; an empty error stands for a column of neither.
fn append(
    reader: ColumnReader,
    rows: usize,
    most: i16,
    (values, texts): (&mut Vec<f64>, &mut Vec<String>),
) -> Result<(), String> {
    macro_rules! read {
        ($reader:expr, $convert:expr) => {
            read!($reader, $convert, values, f64::NAN)
        };
        ($reader:expr, $convert:expr, $values:ident, $missing:expr) => {{
            let mut reader = $reader;
            let (mut found, mut levels) = (Vec::new(), Vec::new());
            let mut left = rows;
            while left > 0 {
                let (records, _, _) =
                    reader.read_records(left, Some(&mut levels), None, &mut found).map_err(|e| e.to_string())?;
                if records == 0 {
                    return Err(format!("{left} of {rows} rows are missing"));
                }
                left -= records;
            }
            let mut numbers = found.iter().map($convert);
            if most == 0 {
                $values.extend(numbers);
            } else {
                // a value that is null has no number
                for level in &levels {
                    $values.push(if *level == most { numbers.next().ok_or("a value is missing")? } else { $missing });
                }
            }
            Ok(())
        }};
    }
    match reader {
        ColumnReader::BoolColumnReader(r) => read!(r, |v: &bool| f64::from(u8::from(*v))),
        ColumnReader::Int32ColumnReader(r) => read!(r, |v: &i32| f64::from(*v)),
        ColumnReader::Int64ColumnReader(r) => read!(r, |v: &i64| *v as f64),
        ColumnReader::Int96ColumnReader(r) => read!(r, |v: &Int96| v.to_nanos() as f64),
        ColumnReader::FloatColumnReader(r) => read!(r, |v: &f32| f64::from(*v)),
        ColumnReader::DoubleColumnReader(r) => read!(r, |v: &f64| *v),
        ColumnReader::ByteArrayColumnReader(r) => {
            read!(r, |v: &ByteArray| String::from_utf8_lossy(v.data()).into_owned(), texts, String::new())
        }
        ColumnReader::FixedLenByteArrayColumnReader(_) => Err(String::new()),
    }
}
