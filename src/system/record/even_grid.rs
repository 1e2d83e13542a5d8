//! Whether a record is sampled evenly, gaps allowed: only then do lags in samples mean lags in time, and sums over samples
//! transforms.

/// Part of an interval by which single samples may be early or late: the jitter of ordinary loggers.
const JITTER: f64 = 0.2;
/// Longest gap that is kept, in intervals: noise on both sides of a longer one has nothing in common.
pub const LONGEST_GAP: usize = 1000;
/// Most places per sample; beyond, the record is bursts with nothing between them.
const SPARSEST: usize = 16;

/// Why there is no even grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotEven {
    /// Intervals are no multiples of one.
    Uneven,
    /// Fewer than three samples.
    TooFew,
}

/// Samples on an even grid.
#[derive(Debug, Clone, PartialEq)]
pub struct EvenGrid {
    /// Time between neighbouring places.
    pub interval: f64,
    /// The place of each sample (N), rising.
    pub place: Vec<usize>,
}

impl EvenGrid {
    /// The grid of rising times; missing samples leave places empty, very long gaps are shortened.
    ///
    /// # Errors
    /// [`NotEven::Uneven`] when intervals are no multiples of one, [`NotEven::TooFew`] for fewer than
    /// three samples.
    pub fn of(time: &[f64]) -> Result<Self, NotEven> {
        if time.len() < 3 {
            return Err(NotEven::TooFew);
        }
        let interval = interval(time);
        if !(interval > 0.0 && interval.is_finite()) {
            return Err(NotEven::Uneven);
        }
        let mut place = Vec::with_capacity(time.len());
        place.push(0);
        let (mut last, mut late) = (0, 0.0);
        for pair in time.windows(2) {
            let steps = (pair[1] - pair[0]) / interval;
            let whole = (steps + late).round().max(1.0);
            late += steps - whole;
            // over a long gap an interval known to a few digits adds up to more than jitter
            let allowed = JITTER + 1e-3 * whole;
            if late.is_nan() || late.abs() > allowed {
                return Err(NotEven::Uneven);
            }
            // what is left after one sample must not add up over the record: the clock may drift
            late = late.clamp(-JITTER, JITTER) * 0.5;
            last += (whole as usize).min(LONGEST_GAP);
            place.push(last);
        }
        if last >= SPARSEST * time.len() + LONGEST_GAP {
            return Err(NotEven::Uneven);
        }
        Ok(Self { interval, place })
    }

    /// The even grid of samples of which some are not compared (N), such as the edges of an input that was held on
    /// another clock: where they do not fit the grid of the others, each has the place of the next one that is
    /// compared, behind which it is of no account.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn of_compared(time: &[f64], compared: impl Fn(usize) -> bool) -> Result<Self, NotEven> {
        let own = Self::of(time);
        if own != Err(NotEven::Uneven) {
            return own;
        }
        let kept: Vec<usize> = (0..time.len()).filter(|k| compared(*k)).collect();
        if kept.len() == time.len() {
            return own;
        }
        let grid = Self::of(&kept.iter().map(|k| time[*k]).collect::<Vec<f64>>())?;
        let (mut place, mut next) = (Vec::with_capacity(time.len()), 0);
        for k in 0..time.len() {
            // behind the last one there is nothing that they could be mistaken for
            place.push(grid.place.get(next).copied().unwrap_or(grid.length()));
            next += usize::from(kept.get(next) == Some(&k));
        }
        Ok(Self { place, ..grid })
    }

    /// As many places as there are samples, one apart: rows whose order is all that is known.
    pub fn counted(samples: usize) -> Self {
        Self { interval: 1.0, place: (0..samples).collect() }
    }

    /// Number of places.
    pub fn length(&self) -> usize {
        self.place.last().map_or(0, |last| last + 1)
    }

    /// Values of the samples at their places (mean taken off when `centred`), NaN where there is none.
    pub fn spread(&self, values: impl Iterator<Item = f64>) -> Vec<f64> {
        let mut grid = vec![f64::NAN; self.length()];
        self.place.iter().zip(values).for_each(|(k, v)| grid[*k] = v);
        grid
    }
}

/// The mean of those intervals that are about the median one.
fn interval(time: &[f64]) -> f64 {
    let mut steps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
    let middle = steps.len() / 2;
    let median = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    let near = || steps.iter().filter(|s| (*s - median).abs() <= 2.0 * JITTER * median.abs());
    near().sum::<f64>() / near().count().max(1) as f64
}

/// Spacing of the samples in the model's time unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// The shortest interval.
    pub least: f64,
    /// As many intervals are longer as are shorter.
    pub median: f64,
    /// The longest interval.
    pub greatest: f64,
    /// Time at which the longest interval begins, since the run began.
    pub greatest_at: f64,
}

impl Sampling {
    /// The intervals of rising times; `None` for fewer than two.
    pub fn new(time: &[f64]) -> Option<Self> {
        let mut intervals: Vec<_> = time.windows(2).map(|w| w[1] - w[0]).collect();
        let (at, greatest) =
            intervals.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))?;
        let least = intervals.iter().copied().fold(f64::INFINITY, f64::min);
        let middle = intervals.len() / 2;
        let (_, median, _) = intervals.select_nth_unstable_by(middle, f64::total_cmp);
        Some(Self { least, median: *median, greatest, greatest_at: time[at] })
    }

    /// Whether every interval is within one percent of the median, as clocks with rounded times are.
    pub fn is_even(&self) -> bool {
        self.greatest <= 1.01 * self.median && self.least >= 0.99 * self.median
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampling_is_measured() {
        let s = Sampling::new(&[0.0, 1.0, 2.0, 5.0, 6.5]).unwrap();
        assert_eq!((s.least, s.median, s.greatest, s.greatest_at), (1.0, 1.5, 3.0, 2.0));
        assert!(!s.is_even());
        assert!(Sampling::new(&[0.0, 0.01, 0.02001, 0.03]).unwrap().is_even());
        assert_eq!(Sampling::new(&[0.0]), None);
    }

    #[test]
    fn gaps_and_jitter_are_allowed_and_uneven_steps_are_not() {
        let even: Vec<f64> = (0..200).map(|k| 0.1 * f64::from(k)).collect();
        assert_eq!(EvenGrid::of(&even).map(|s| s.place), Ok((0..200).collect()));
        let gappy: Vec<f64> = even.iter().copied().filter(|t| !(3.0..7.0).contains(t)).collect();
        let grid = EvenGrid::of(&gappy).expect("even with a gap");
        assert_eq!((grid.length(), grid.place[29], grid.place[30]), (200, 29, 70));
        let jittered: Vec<f64> = (0..200).map(|k| 0.1 * f64::from(k) + 0.008 * f64::from(k * 7919 % 3 - 1)).collect();
        assert_eq!(EvenGrid::of(&jittered).map(|s| s.length()), Ok(200));
        let growing: Vec<f64> = (0..200).map(|k| 1.05f64.powi(k)).collect();
        assert_eq!(EvenGrid::of(&growing), Err(NotEven::Uneven));
        let random: Vec<f64> = (0..200).map(|k| f64::from(k) + 0.49 * (f64::from(k) * 1.7).sin()).collect();
        assert_eq!(EvenGrid::of(&random), Err(NotEven::Uneven));
    }

    #[test]
    fn a_clock_that_drifts_is_even_and_a_rounded_one_too() {
        let drifting: Vec<f64> = (0..5000).map(|k| 0.01 * f64::from(k) * (1.0 + 1e-6 * f64::from(k))).collect();
        assert_eq!(EvenGrid::of(&drifting).map(|s| s.length()), Ok(5000));
        // 30 Hz written with two decimals
        let rounded: Vec<f64> = (0..300).map(|k| (f64::from(k) / 30.0 * 100.0).round() / 100.0).collect();
        assert_eq!(EvenGrid::of(&rounded).map(|s| s.length()), Ok(300));
    }

    #[test]
    fn edges_between_the_samples_do_not_make_them_uneven() {
        let time = [0.0, 0.3, 1.0, 2.0, 2.05, 2.4, 3.0, 4.0, 4.1];
        let compared = [true, false, true, true, false, false, true, true, false];
        let grid = EvenGrid::of_compared(&time, |k| compared[k]).expect("even where compared");
        assert_eq!((grid.interval, grid.place), (1.0, vec![0, 1, 1, 2, 3, 3, 3, 4, 5]));
        assert_eq!(EvenGrid::of_compared(&time, |_| true), Err(NotEven::Uneven));
    }

    #[test]
    fn hostile_times_cost_no_memory() {
        let far = [0.0, 1e-9, 2e-9, 1e9, 1e9 + 1.0, 1e300];
        assert!(EvenGrid::of(&far).is_err() || EvenGrid::of(&far).is_ok_and(|s| s.length() < 10_000));
        for time in [&[0.0, 0.0, 0.0, 0.0][..], &[0.0, f64::INFINITY, f64::NAN, 1.0], &[], &[1.0], &[3.0, 2.0, 1.0]] {
            assert!(EvenGrid::of(time).is_err());
        }
    }
}
