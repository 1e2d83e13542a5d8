//! `--time-limit`: how long a command may work.

use clap::Args;
use std::time::{Duration, Instant};

/// How long a command may work.
#[derive(Debug, Args)]
pub struct TimeLimit {
    /// Longest time to work, such as 60s, 5m or 1h
    ///
    /// Then the best so far is printed and kept, with exit code 1.
    #[arg(long, value_name = "TIME", value_parser = duration, help_heading = "Limits", allow_negative_numbers = true)]
    time_limit: Option<Duration>,
}

impl TimeLimit {
    /// When the time is over, counted from now.
    pub(crate) fn deadline(&self) -> Option<Instant> {
        // a limit beyond what clocks hold is none
        self.time_limit.and_then(|limit| Instant::now().checked_add(limit))
    }
}

/// `90`, `90s`, `1.5m`, `2h`
fn duration(text: &str) -> Result<Duration, String> {
    const WANTED: &str = "expected a time above 0 such as 60s, 5m or 1h";
    let text = text.trim();
    let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let seconds = match &text[number.len()..] {
        "" | "s" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(WANTED.into()),
    };
    let count: f64 = number.trim_end().parse().map_err(|_| WANTED)?;
    let limit = Duration::try_from_secs_f64(count * seconds).map_err(|_| WANTED)?;
    if limit.is_zero() { Err(WANTED.into()) } else { Ok(limit) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_units_and_are_above_zero() {
        assert_eq!(duration("90"), Ok(Duration::from_secs(90)));
        assert_eq!(duration("60s"), Ok(Duration::from_secs(60)));
        assert_eq!(duration("1.5m"), Ok(Duration::from_secs(90)));
        assert_eq!(duration("1h"), Ok(Duration::from_secs(3600)));
        assert_eq!(duration("20 s"), duration("20s"));
        for wrong in ["", "s", "0", "-5s", "5d", "nan", "inf", "1e400", "m5"] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
    }
}
