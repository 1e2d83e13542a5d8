//! Dates and clock times in a column of times: seconds since the midnight of the first day.

/// Seconds of a day.
const DAY: f64 = 86_400.0;

/// What a cell says of the time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stamp {
    /// Days since 1970-01-01; none for a clock time alone.
    pub(crate) day: Option<i64>,
    /// Seconds since midnight, of UTC where the cell says its offset.
    pub(crate) seconds: f64,
}

/// Makes one axis of the cells of a column.
#[derive(Debug, Default)]
pub(crate) struct Axis {
    first: Option<i64>,
    before: f64,
    midnights: f64,
}

impl Axis {
    /// Seconds since the midnight of the first day. A clock time that falls by more than half a day is one of the next day.
    pub(crate) fn seconds(&mut self, stamp: Stamp) -> f64 {
        match stamp.day {
            Some(day) => (day - *self.first.get_or_insert(day)) as f64 * DAY + stamp.seconds,
            None => {
                if stamp.seconds < self.before - DAY / 2.0 {
                    self.midnights += 1.0;
                }
                self.before = stamp.seconds;
                self.midnights * DAY + stamp.seconds
            }
        }
    }
}

/// Reads `2026-05-01T12:34:56.7+02:00`, `2026-05-01 12:34:56`, `2026/05/01 ..`, `01.05.2026 ..` and `12:34:56.7`; none for anything else, such
/// as dates whose day and month cannot be told apart.
pub(crate) fn stamp(cell: &str) -> Option<Stamp> {
    let text = cell.trim().trim_matches('"').trim();
    if !text.is_ascii() || text.len() > 40 {
        return None;
    }
    let Some((date, rest)) = text.split_once(['T', 't', ' ']) else {
        return match date(text) {
            Some(day) => Some(Stamp { day: Some(day), seconds: 0.0 }),
            None => clock(text).map(|seconds| Stamp { day: None, seconds }),
        };
    };
    let day = date_of(date)?;
    let rest = rest.trim().strip_suffix(" UTC").unwrap_or(rest.trim());
    let (time, offset) = match rest.strip_suffix(['Z', 'z']) {
        Some(time) => (time, 0.0),
        None => match rest.rfind(['+', '-']) {
            Some(at) => (&rest[..at], offset(&rest[at..])?),
            None => (rest, 0.0),
        },
    };
    Some(Stamp { day: Some(day), seconds: clock(time)? - offset })
}

fn date(text: &str) -> Option<i64> {
    (text.len() >= 8).then(|| date_of(text)).flatten()
}

fn whole(text: &str, digits: std::ops::RangeInclusive<usize>) -> Option<i64> {
    (digits.contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit())).then(|| text.parse().ok()).flatten()
}

fn date_of(text: &str) -> Option<i64> {
    let mark = ['-', '/', '.'].into_iter().find(|mark| text.matches(*mark).count() == 2)?;
    let mut parts = text.split(mark);
    let (first, second, third) = (parts.next()?, parts.next()?, parts.next()?);
    let (year, month, day) = if first.len() == 4 {
        (whole(first, 4..=4)?, whole(second, 1..=2)?, whole(third, 1..=2)?)
    } else if mark == '.' {
        (whole(third, 4..=4)?, whole(second, 1..=2)?, whole(first, 1..=2)?)
    } else {
        return None;
    };
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let length = match month {
        4 | 6 | 9 | 11 => 30,
        2 if leap => 29,
        2 => 28,
        1..=12 => 31,
        _ => return None,
    };
    (1..=length).contains(&day).then(|| days(year, month, day))
}

/// Days since 1970-01-01 of a date of the Gregorian calendar (Howard Hinnant's `days_from_civil`).
fn days(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let of_era = year.rem_euclid(400);
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

/// `12:34:56.7`, with a point or comma; hours and minutes alone where a date stands before them is all that some loggers write.
fn clock(text: &str) -> Option<f64> {
    let mut parts = text.split(':');
    let (hours, minutes, seconds) = (parts.next()?, parts.next()?, parts.next()?);
    let (hours, minutes) = (whole(hours, 1..=2)?, whole(minutes, 2..=2)?);
    let (full, fraction) = seconds.split_once(['.', ',']).map_or((seconds, ""), |(full, fraction)| (full, fraction));
    let digits = |t: &str| t.bytes().all(|b| b.is_ascii_digit());
    if parts.next().is_some() || !digits(fraction) || hours > 23 || minutes > 59 {
        return None;
    }
    let seconds: f64 = format!("{}.{fraction}0", whole(full, 2..=2).filter(|s| *s <= 60)?).parse().ok()?;
    Some((hours * 3600 + minutes * 60) as f64 + seconds)
}

/// `+02:00`, `+0200`, `+02` in seconds.
fn offset(text: &str) -> Option<f64> {
    let sign = if text.starts_with('-') { -1.0 } else { 1.0 };
    let plain = text[1..].replace(':', "");
    let hours = whole(plain.get(..2)?, 2..=2)?;
    let minutes = if plain.len() == 2 { 0 } else { whole(plain.get(2..)?, 2..=2)? };
    (hours <= 14 && minutes < 60).then(|| sign * (hours * 3600 + minutes * 60) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_and_clock_times_are_read() {
        let read = |text: &str| stamp(text).map(|s| (s.day, s.seconds));
        let day = 20_574;
        for (text, seconds) in [
            ("2026-05-01T12:34:56.25", 45_296.25),
            ("2026-05-01 12:34:56,25", 45_296.25),
            ("\"2026/05/01 12:34:56.25Z\"", 45_296.25),
            ("2026-05-01T12:34:56.25+02:00", 38_096.25),
            ("2026-05-01T12:34:56-0130", 50_696.0),
            ("01.05.2026 00:00:01", 1.0),
            ("2026-05-01", 0.0),
        ] {
            assert_eq!(read(text), Some((Some(day), seconds)), "{text}");
        }
        assert_eq!(read("23:59:59.5"), Some((None, 86_399.5)));
        assert_eq!(days(1970, 1, 1), 0);
        assert_eq!(days(2000, 2, 29) + 1, days(2000, 3, 1));
        for text in [
            "05/01/2026 12:00:00",
            "12:34",
            "1.5",
            "1.2.3",
            "2026-13-01",
            "2026-02-29",
            "24:00:00",
            "12:60:00",
            "a:b:c",
            "",
            "-",
        ] {
            assert_eq!(read(text), None, "{text}");
        }
    }

    #[test]
    fn clock_times_go_over_midnight() {
        let mut axis = Axis::default();
        let seconds: Vec<f64> =
            ["23:59:59", "00:00:01", "00:00:03"].iter().map(|t| axis.seconds(stamp(t).unwrap())).collect();
        assert_eq!(seconds, [86_399.0, 86_401.0, 86_403.0]);
        let mut axis = Axis::default();
        assert_eq!(axis.seconds(stamp("2026-05-01 23:00:00").unwrap()), 82_800.0);
        assert_eq!(axis.seconds(stamp("2026-05-02 01:00:00").unwrap()), 90_000.0);
    }
}
