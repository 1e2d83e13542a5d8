//! Values as they are typed behind options.

use fdm_grammar::number::held;
use fdm_readers::{RecordMap, shipped};
use fdm_results::store::{read_input_text, reason};
use fdm_system::record::BelowLimit;
use std::path::Path;

/// `NAME=VALUE`
pub fn assignment(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.rsplit_once('=').ok_or("expected NAME=VALUE")?;
    Ok((name.trim().to_string(), number(value)?))
}

/// `LO:HI`
pub fn band(text: &str) -> Result<(f64, f64), String> {
    let (low, high) = text.split_once(':').ok_or("expected LO:HI, such as 0.1:3")?;
    Ok((number(low)?, number(high)?))
}

/// A number as it is typed.
pub fn number(text: &str) -> Result<f64, String> {
    let text = text.trim();
    held(text).map_err(|unheld| format!("`{text}` {unheld}: {}", unheld.hint()))
}

/// An instant as it is typed.
pub(crate) fn instant(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value.is_nan() { Err(format!("`{text}` is no time: write a number such as 0 or 2.5")) } else { Ok(value) }
}

/// A number above 0 as it is typed.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value > 0.0 { Ok(value) } else { Err(format!("`{text}` is not above 0")) }
}

/// A number between 0 and 1.
pub fn probability(text: &str) -> Result<f64, String> {
    let value = number(text)?;
    if value > 0.0 && value < 1.0 { Ok(value) } else { Err("a probability is between 0 and 1".into()) }
}

/// A map of channels: a file, or one that comes with the program.
pub fn map_file(text: &str) -> Result<RecordMap, String> {
    let (known, names) = shipped(text);
    let map = match read_input_text(Path::new(text)) {
        Ok(map) => map,
        Err(_) if known.is_some() => known.unwrap_or_default().into(),
        Err(e) => return Err(format!("{}; maps that come with fdm are {}", reason(&e), names.join(", "))),
    };
    RecordMap::parse(&map).map_err(|e| e.to_string())
}

/// What is made of values below a limit.
pub(crate) fn below_limit(text: &str) -> Result<BelowLimit, String> {
    match text {
        "censored" => Ok(BelowLimit::Censored),
        "missing" => Ok(BelowLimit::Missing),
        _ => match number(text) {
            Ok(limit) if limit.is_finite() => Ok(BelowLimit::Limit(limit)),
            _ => Err(format!("`{text}` is none of `censored`, `missing`, and a limit such as 0.5")),
        },
    }
}

/// `CHANNEL=COLUMN`
pub fn pair(text: &str) -> Result<(String, String), String> {
    let (channel, column) = text.split_once('=').ok_or("expected CHANNEL=COLUMN")?;
    Ok((channel.trim().to_string(), column.trim().to_string()))
}
