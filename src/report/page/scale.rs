//! Axes: from the least to the greatest value, round numbers between them, places on paper.

use super::number;

/// An axis from `low` to `high`, never empty; of logarithms both are positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scale {
    pub(crate) low: f64,
    pub(crate) high: f64,
    pub(crate) logarithmic: bool,
}

impl Scale {
    /// Around all finite values, with a margin as a share of their range.
    pub(crate) fn around<'a>(values: impl Iterator<Item = &'a f64>, margin: f64, logarithmic: bool) -> Self {
        let usable = values.filter(|v| v.is_finite() && (!logarithmic || **v > 0.0));
        let (low, high) = usable.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
        if low > high {
            let (low, high) = if logarithmic { (0.1, 10.0) } else { (0.0, 1.0) };
            return Self { low, high, logarithmic };
        }
        if logarithmic {
            let stretch = if high > low { (high / low).powf(margin) } else { 2.0 };
            return Self { low: low / stretch, high: high * stretch, logarithmic };
        }
        let extra = if high > low { margin * (high - low) } else { high.abs().max(1.0) * 0.5 };
        Self { low: low - extra, high: high + extra, logarithmic }
    }

    /// Where a value lies between 0 (low) and 1 (high).
    pub(crate) fn share(&self, v: f64) -> f64 {
        match self.logarithmic {
            true if v > 0.0 => (v / self.low).ln() / (self.high / self.low).ln(),
            true => f64::NAN,
            false => (v - self.low) / (self.high - self.low),
        }
    }

    /// Round numbers on the axis, about `count` of them, with their labels.
    pub(crate) fn ticks(&self, count: usize) -> Vec<(f64, String)> {
        let decades = (self.high / self.low).log10();
        if self.logarithmic && decades > 0.7 {
            let steps: &[f64] = if decades > 2.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
            let powers = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
            let every = (((powers.end() - powers.start()) as usize) / count.max(1) / 2).max(1);
            let all = powers.step_by(every).flat_map(|p| steps.iter().map(move |s| s * 10f64.powi(p)));
            let inside = all.filter(|v| (self.low..=self.high).contains(v));
            return inside.map(|v| (v, number::text(v, 1))).collect();
        }
        let raw = (self.high - self.low) / count.max(1) as f64;
        let power = 10f64.powf(raw.log10().floor());
        let far = |step: f64| (step / raw).ln().abs();
        let round = [1.0, 2.0, 5.0, 10.0].map(|s| s * power);
        let step = round.into_iter().min_by(|a, b| far(*a).total_cmp(&far(*b))).unwrap_or(raw);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        // an axis whose range is rounding of its values has no round numbers
        let count = (last.saturating_sub(first)).clamp(-1, 50);
        (0..=count).map(|k| (first + k) as f64 * step).map(|v| (v, label(v, step))).collect()
    }
}

/// As many decimals as the step has.
fn label(v: f64, step: f64) -> String {
    let size = v.abs().max(step);
    if !(1e-4..1e6).contains(&size) {
        let significant = (size / step).log10().ceil().clamp(0.0, 8.0) as usize + 1;
        return number::text(v, significant).replace(".0e", "e");
    }
    let decimals = (-step.log10().floor()).clamp(0.0, 8.0) as usize;
    format!("{v:.decimals$}").replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64, logarithmic: bool) -> Vec<String> {
        Scale { low, high, logarithmic }.ticks(5).into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(labels(0.0, 66.7, false), ["0", "10", "20", "30", "40", "50", "60"]);
        assert_eq!(labels(-0.13, 0.11, false), ["−0.10", "−0.05", "0.00", "0.05", "0.10"]);
        assert_eq!(labels(0.05, 3.0, true), ["0.05", "0.1", "0.2", "0.5", "1", "2"]);
        assert_eq!(labels(2.0, 3.0, true).len(), 6);
        assert!(labels(1.0, 1.0 + 1e-16, false).len() <= 51);
    }

    #[test]
    fn nothing_and_a_constant_have_axes_too() {
        let none = Scale::around([f64::NAN].iter(), 0.0, false);
        assert_eq!((none.low, none.high), (0.0, 1.0));
        let constant = Scale::around([2.0].iter(), 0.0, false);
        assert!(constant.low < 2.0 && constant.high > 2.0 && constant.share(2.0) == 0.5);
        assert!(Scale::around([0.0, 1.0, 100.0].iter(), 0.0, true).share(10.0) == 0.5);
    }
}
