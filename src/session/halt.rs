//! When work ends before it is done: by an interrupt, or when the time that was given is over.

use clap::Args;
use fdm_estimate::Stop;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
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

/// Tells work that it is to end.
#[derive(Debug, Clone, Default)]
pub struct Halt {
    interrupted: Arc<AtomicBool>,
    deadline: Option<Instant>,
    /// Whether anything was told that the time is over.
    over: Arc<AtomicBool>,
}

impl Halt {
    /// Ends work when this is set.
    pub fn interrupted(&self) -> &Arc<AtomicBool> {
        &self.interrupted
    }

    /// Ends work at this time too.
    pub fn at(self, deadline: Option<Instant>) -> Self {
        Self { deadline, ..self }
    }

    /// Why work is to end; none while it may go on.
    pub fn stop(&self) -> Option<Stop> {
        if self.interrupted.load(Ordering::Relaxed) {
            return Some(Stop::Interrupt);
        }
        let over = self.deadline.is_some_and(|deadline| Instant::now() >= deadline);
        over.then(|| {
            self.over.store(true, Ordering::Relaxed);
            Stop::TimeLimit
        })
    }

    /// Whether work was asked to end.
    pub(crate) fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Whether work may go on.
    pub fn goes_on(&self) -> bool {
        self.stop().is_none()
    }

    /// Whether there is time for what a result can do without: it ends with the time, and is not told to have run out of it.
    pub(crate) fn has_time(&self) -> bool {
        let over = self.deadline.is_some_and(|deadline| Instant::now() >= deadline);
        !over && !self.interrupted.load(Ordering::Relaxed)
    }

    /// Whether work was ended by the time limit.
    pub(crate) fn ran_out_of_time(&self) -> bool {
        self.over.load(Ordering::Relaxed)
    }

    /// What is said where the time limit has ended the work: what it means for the result.
    pub fn late(&self, result: &str) -> Option<String> {
        self.ran_out_of_time().then(|| format!("stopped by --time-limit: {result}"))
    }
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

    #[test]
    fn work_ends_when_the_time_is_over_and_only_then() {
        let halt = Halt::default().at(Instant::now().checked_add(Duration::from_secs(1000)));
        assert!(halt.goes_on() && !halt.ran_out_of_time());
        let halt = Halt::default().at(Some(Instant::now()));
        // nothing was ended as long as nothing has asked
        assert!(!halt.ran_out_of_time());
        assert_eq!(halt.stop(), Some(Stop::TimeLimit));
        assert!(halt.clone().ran_out_of_time());
        halt.interrupted().store(true, Ordering::Relaxed);
        assert_eq!(halt.stop(), Some(Stop::Interrupt));
    }
}
