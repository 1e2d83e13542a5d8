//! Dates and clock times in columns: seconds since the midnight of the first day.

/// Seconds of a day.
pub(crate) const DAY: f64 = 86_400.0;

/// What a cell says of the time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Stamp {
    /// Days since 1970-01-01; none for a clock time alone.
    pub(crate) day: Option<i64>,
    /// Seconds since midnight, of UTC where the cell says its offset; none for a date alone.
    pub(crate) clock: Option<f64>,
}

/// What of a date such as `03/04/2026`, or of a time such as `08:15`, the cells do not say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Reading {
    /// Whether the day stands before the month.
    pub(crate) day_first: bool,
    /// Whether two numbers are minutes and seconds, not hours and minutes.
    pub(crate) minutes: bool,
}

impl Reading {
    /// What a format says, where it says anything: `dd/mm/yyyy`, `mm:ss`.
    pub(crate) fn of_format(format: &str) -> (Option<bool>, bool) {
        let lower = format.to_lowercase();
        let place = |what: &str| lower.find(what);
        let months =
            lower.match_indices("mm").find(|(k, _)| !lower[..*k].ends_with(':') && !lower[k + 2..].starts_with(':'));
        let day_first = match (place("dd"), months.map(|(k, _)| k)) {
            (Some(day), Some(month)) => Some(day < month),
            _ => None,
        };
        (day_first, lower.contains("mm:ss") && !lower.contains("hh") && !lower.contains("h:"))
    }
}

/// What a column of dates or clock times holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stamps {
    /// Dates with clock times.
    Both,
    /// Clock times.
    Clock,
    /// Dates.
    Dates,
}

/// Cells as seconds (N), NaN where a cell is none; and what they are.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Axis {
    pub(crate) seconds: Vec<f64>,
    pub(crate) stamps: Stamps,
    /// What the cells do not say, and was taken or asked.
    pub(crate) question: Option<Question>,
}

/// Two readings of cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Question {
    /// Day or month may stand first, and it matters.
    Order,
    /// Two numbers are read as hours and minutes.
    HoursAndMinutes,
    /// Two numbers are read as minutes and seconds: they have a fraction.
    MinutesAndSeconds,
}

/// The cells of a column as one axis. A clock time that falls by more than half a day is one of the next day.
pub(crate) fn axis(cells: &[Option<&str>], format: Option<&str>) -> Axis {
    let (order, minutes) = format.map_or((None, false), Reading::of_format);
    let read = |day_first: bool| -> Vec<Option<Stamp>> {
        cells.iter().map(|c| c.and_then(|c| stamp(c, Reading { day_first, minutes }))).collect()
    };
    let count = |stamps: &[Option<Stamp>]| stamps.iter().flatten().count();
    let (month_first, day_first) = (read(order.unwrap_or(false)), order.is_none().then(|| read(true)));
    let mut question = None;
    let stamps = match day_first {
        Some(other) if count(&other) > count(&month_first) => other,
        Some(other) if count(&other) == count(&month_first) && seconds(&other) != seconds(&month_first) => {
            // both are dates: the one whose times rise is meant
            let rises = |stamps: &[Option<Stamp>]| {
                let times: Vec<f64> = seconds(stamps).into_iter().filter(|t| !t.is_nan()).collect();
                times.windows(2).all(|w| w[0] <= w[1])
            };
            match (rises(&month_first), rises(&other)) {
                (true, false) => month_first,
                (false, true) => other,
                _ => {
                    question = Some(Question::Order);
                    month_first
                }
            }
        }
        _ => month_first,
    };
    let first = stamps.iter().flatten().next();
    let kind = match first {
        Some(Stamp { day: Some(_), clock: None }) => Stamps::Dates,
        Some(Stamp { day: None, .. }) => Stamps::Clock,
        _ => Stamps::Both,
    };
    let two = |c: &str| c.trim().matches(':').count() == 1 && !c.contains(['-', '/', ' ']);
    let alone = kind == Stamps::Clock && format.is_none();
    if let Some(cell) = cells.iter().flatten().next().filter(|c| alone && two(c)) {
        question =
            Some(if cell.contains(['.', ',']) { Question::MinutesAndSeconds } else { Question::HoursAndMinutes });
    }
    Axis { seconds: seconds(&stamps), stamps: kind, question }
}

/// Seconds since the midnight of the first day (N).
fn seconds(stamps: &[Option<Stamp>]) -> Vec<f64> {
    let (mut first, mut before, mut midnights) = (None, 0.0, 0.0);
    let mut one = |stamp: &Option<Stamp>| {
        let Some(Stamp { day, clock }) = *stamp else { return f64::NAN };
        let clock = clock.unwrap_or(0.0);
        match day {
            Some(day) => (day - *first.get_or_insert(day)) as f64 * DAY + clock,
            None => {
                if clock < before - DAY / 2.0 {
                    midnights += 1.0;
                }
                before = clock;
                midnights * DAY + clock
            }
        }
    };
    stamps.iter().map(&mut one).collect()
}

/// Whether a cell is a date or a clock time.
pub(crate) fn is_stamp(cell: &str) -> bool {
    let read = |day_first| stamp(cell, Reading { day_first, minutes: false }).is_some();
    read(false) || read(true)
}

/// Reads `2026-05-01T12:34:56.7+02:00`, `2026-05-01 12:34:56`, `2026/05/01 ..`, `01.05.2026 ..`, `05/01/2026 1:23:45 PM`, `1-May-2026 ..`, `12:34:56.7`
/// and `12:34`; none for anything else.
pub(crate) fn stamp(cell: &str, reading: Reading) -> Option<Stamp> {
    let text = cell.trim().trim_matches('"').trim();
    if !text.is_ascii() || text.len() > 40 || !text.contains([':', '-', '/', '.', ' ']) {
        return None;
    }
    if let Some((days, clock)) = text.split_once(" days ") {
        return Some(Stamp { day: Some(whole(days, 1..=6)?), clock: Some(clock_with_zone(clock, reading, false)?) });
    }
    let words: Vec<&str> = text.split([' ', 'T', 't', ',']).filter(|w| !w.is_empty()).collect();
    if let Some(stamp) = date_of(text, reading).filter(|_| text.len() >= 8) {
        return Some(Stamp { day: Some(stamp), clock: None });
    }
    if let Some(clock) = clock_with_zone(text, reading, false) {
        return Some(Stamp { day: None, clock: Some(clock) });
    }
    // the date is what stands before the first word with a colon
    let at = words.iter().position(|w| w.contains(':'))?;
    if at == 0 || words.len() > 6 {
        return None;
    }
    let split = text.find(words[at]).filter(|k| *k > 0)?;
    let (date, rest) = (text[..split].trim_end_matches([' ', 'T', 't', ',']), &text[split..]);
    Some(Stamp { day: Some(date_of(date, reading)?), clock: Some(clock_with_zone(rest, reading, true)?) })
}

/// A clock time and what may stand behind it: half of the day, zone.
fn clock_with_zone(text: &str, reading: Reading, dated: bool) -> Option<f64> {
    let (mut rest, mut shift) = (text.trim(), 0.0);
    let lower = rest.to_ascii_lowercase();
    let half = [("am", 0.0), ("pm", 43_200.0), ("a.m.", 0.0), ("p.m.", 43_200.0)];
    let half = half.iter().find(|(word, _)| lower.ends_with(word));
    if let Some((word, _)) = half {
        rest = rest[..rest.len() - word.len()].trim_end();
    } else if dated {
        if let Some((time, zone)) = rest.split_once(' ') {
            let name = !zone.is_empty() && zone.len() <= 5 && zone.bytes().all(|b| b.is_ascii_alphabetic());
            if !name && !zone.starts_with(['+', '-']) {
                return None;
            }
            shift = if name { 0.0 } else { offset(zone)? };
            rest = time;
        } else if let Some(time) = rest.strip_suffix(['Z', 'z']) {
            rest = time;
        } else if let Some(at) = rest.rfind(['+', '-']) {
            shift = offset(&rest[at..])?;
            rest = &rest[..at];
        }
    } else if let Some(time) = rest.strip_suffix(['Z', 'z']) {
        rest = time;
    }
    let seconds = clock(rest, reading)?;
    Some(match half {
        // 12:30 AM is half past midnight
        Some(_) if seconds >= 46_800.0 => return None,
        Some((_, later)) => seconds % 43_200.0 + later,
        None => seconds - shift,
    })
}

fn whole(text: &str, digits: std::ops::RangeInclusive<usize>) -> Option<i64> {
    (digits.contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit())).then(|| text.parse().ok()).flatten()
}

const MONTHS: [&str; 12] = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];

fn month_of(word: &str) -> Option<i64> {
    let lower = word.get(..3)?.to_ascii_lowercase();
    let letters = word.bytes().all(|b| b.is_ascii_alphabetic());
    MONTHS.iter().position(|m| *m == lower).filter(|_| letters).map(|k| k as i64 + 1)
}

fn date_of(text: &str, reading: Reading) -> Option<i64> {
    let words: Vec<&str> = text.split(['-', '/', '.', ' ', ',']).filter(|w| !w.is_empty()).collect();
    let [first, second, third] = words[..] else { return None };
    let year = |text: &str| whole(text, 4..=4).or_else(|| whole(text, 2..=2).map(|y| 2000 + y));
    let (year, month, day) = if let Some(month) = month_of(second) {
        // 1-May-2026
        (year(third)?, month, whole(first, 1..=2)?)
    } else if let Some(month) = month_of(first) {
        (year(third)?, month, whole(second, 1..=2)?)
    } else {
        let mark = ['-', '/', '.'].into_iter().find(|mark| text.matches(*mark).count() == 2)?;
        if first.len() == 4 {
            (whole(first, 4..=4)?, whole(second, 1..=2)?, whole(third, 1..=2)?)
        } else if mark == '.' {
            (whole(third, 4..=4)?, whole(second, 1..=2)?, whole(first, 1..=2)?)
        } else {
            let (one, other) = (whole(first, 1..=2)?, whole(second, 1..=2)?);
            let (day, month) = if reading.day_first { (one, other) } else { (other, one) };
            (year(third)?, month, day)
        }
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

/// `12:34:56.7`, with a point or comma, `12:34`, and `61:02.5` in minutes and seconds. Elapsed hours may be more than a day.
fn clock(text: &str, reading: Reading) -> Option<f64> {
    let parts: Vec<&str> = text.split(':').collect();
    let (hours, minutes, seconds) = match parts[..] {
        [hours, minutes, seconds] => (whole(hours, 1..=4)?, whole(minutes, 1..=2)?, seconds),
        [hours, minutes] if !reading.minutes && !minutes.contains(['.', ',']) => {
            (whole(hours, 1..=2)?, whole(minutes, 2..=2)?, "00")
        }
        [minutes, seconds] => return Some(whole(minutes, 1..=4)? as f64 * 60.0 + parts_of_minute(seconds)?),
        _ => return None,
    };
    (minutes <= 59).then_some(())?;
    Some((hours * 3600 + minutes * 60) as f64 + parts_of_minute(seconds)?)
}

fn parts_of_minute(text: &str) -> Option<f64> {
    let (full, fraction) = text.split_once(['.', ',']).unwrap_or((text, ""));
    let digits = fraction.bytes().all(|b| b.is_ascii_digit());
    let full = whole(full, 1..=2).filter(|s| *s <= 60 && digits)?;
    format!("{full}.{fraction}0").parse().ok()
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

    fn read(text: &str) -> Option<(Option<i64>, Option<f64>)> {
        stamp(text, Reading::default()).map(|s| (s.day, s.clock))
    }

    #[test]
    fn dates_and_clock_times_are_read() {
        let day = 20_574;
        for (text, seconds) in [
            ("2026-05-01T12:34:56.25", 45_296.25),
            ("2026-05-01 12:34:56,25", 45_296.25),
            ("\"2026/05/01 12:34:56.25Z\"", 45_296.25),
            ("2026-05-01T12:34:56.25+02:00", 38_096.25),
            ("2026-05-01T12:34:56-0130", 50_696.0),
            ("2026-05-01 12:34:56 UTC", 45_296.0),
            ("2026-05-01 12:34", 45_240.0),
            ("01.05.2026 00:00:01", 1.0),
            ("05/01/2026 1:23:45 PM", 48_225.0),
            ("05/01/26 12:00:01 AM", 1.0),
            ("1-May-2026 00:00:02", 2.0),
            ("May 1, 2026 00:00:02", 2.0),
        ] {
            assert_eq!(read(text), Some((Some(day), Some(seconds))), "{text}");
        }
        assert_eq!(read("2026-05-01"), Some((Some(day), None)));
        assert_eq!(read("3 days 00:00:01.5"), Some((Some(3), Some(1.5))));
        for (text, seconds) in
            [("23:59:59.5", 86_399.5), ("08:15", 29_700.0), ("1:02.5", 62.5), ("30:00:01", 108_001.0)]
        {
            assert_eq!(read(text), Some((None, Some(seconds))), "{text}");
        }
        assert_eq!(days(1970, 1, 1), 0);
        assert_eq!(days(2000, 2, 29) + 1, days(2000, 3, 1));
        for text in [
            "1.5",
            "1.2.3",
            "2026-13-01",
            "2026-02-29",
            "12:60:00",
            "a:b:c",
            "",
            "-",
            "-08:00",
            "3D",
            "1 2 3",
            "10-11",
            "1e-3",
        ] {
            assert_eq!(read(text), None, "{text}");
        }
    }

    #[test]
    fn clock_times_go_over_midnight_and_dates_of_two_readings_ask() {
        let of =
            |cells: &[&str], format: Option<&str>| axis(&cells.iter().map(|c| Some(*c)).collect::<Vec<_>>(), format);
        assert_eq!(of(&["23:59:59", "00:00:01", "00:00:03"], None).seconds, [86_399.0, 86_401.0, 86_403.0]);
        assert_eq!(of(&["2026-05-01 23:00:00", "2026-05-02 01:00:00"], None).seconds, [82_800.0, 90_000.0]);
        assert_eq!(of(&["03/04/2026 00:00", "04/04/2026 00:00"], None).question, Some(Question::Order));
        assert_eq!(of(&["03/04/2026 00:00", "04/04/2026 00:00"], Some("dd/mm/yyyy")).seconds, [0.0, DAY]);
        assert_eq!(of(&["03/14/2026 00:00", "03/15/2026 00:00"], None).seconds, [0.0, DAY]);
        // on one day it does not matter
        assert_eq!(of(&["03/04/2026 00:00", "03/04/2026 01:00"], None).question, None);
        assert_eq!(of(&["00:10", "00:20"], Some("mm:ss")).seconds, [10.0, 20.0]);
        assert_eq!(of(&["08:00", "08:15"], None).question, Some(Question::HoursAndMinutes));
    }
}
