//! Trends taken off a series: its mean, or the line that fits best.

use super::options::Detrend;

/// Takes the trend off; `time` belongs to the values.
pub(super) fn detrend(time: &[f64], values: &mut [f64], what: Detrend) {
    if what == Detrend::None || values.is_empty() {
        return;
    }
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let level = mean(values);
    values.iter_mut().for_each(|v| *v -= level);
    if what == Detrend::Mean {
        return;
    }
    let middle = mean(time);
    let above: f64 = time.iter().zip(values.iter()).map(|(t, v)| (t - middle) * v).sum();
    let below: f64 = time.iter().map(|t| (t - middle).powi(2)).sum();
    if below > 0.0 {
        let slope = above / below;
        values.iter_mut().zip(time).for_each(|(v, t)| *v -= slope * (t - middle));
    }
}

impl Detrend {
    /// Degrees of freedom that each run loses.
    pub(super) fn taken(self) -> usize {
        match self {
            Self::None => 0,
            Self::Mean => 1,
            Self::Line => 2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_lines_are_taken_off() {
        let time = [0.0, 1.0, 3.0, 4.0];
        let mut line = time.map(|t| 2.0 - 3.0 * t);
        detrend(&time, &mut line, Detrend::Line);
        assert!(line.iter().all(|v| v.abs() < 1e-14));
        let mut values = [1.0, 2.0, 3.0, 6.0];
        detrend(&time, &mut values, Detrend::Mean);
        assert_eq!(values, [-2.0, -1.0, 0.0, 3.0]);
    }
}
