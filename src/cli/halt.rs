//! `--time-limit`, and what is said of work that ended before it was done.

use crate::failure::remark;
use clap::Args;
use fdm_estimate::Halt;
use std::time::{Duration, Instant};

/// How long a command may work.
#[derive(Debug, Args)]
pub(crate) struct TimeLimit {
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

/// Says so where an interrupt has ended work that does not tell it itself; says whether none has.
pub(crate) fn uninterrupted(halt: &Halt) -> bool {
    let interrupted = halt.is_interrupted();
    if interrupted {
        remark(format_args!("interrupted: the result is the best so far"));
    }
    !interrupted
}

/// Says so where the time limit has ended the work, and what it means for the result; says whether it has not.
pub(crate) fn in_time_or(halt: &Halt, result: &str) -> bool {
    let over = halt.ran_out_of_time();
    if over {
        remark(format_args!("stopped by --time-limit: {result}"));
    }
    !over
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
