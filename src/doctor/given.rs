//! Whether a channel was given or measured: what a computer or a steady hand gives is exact, and what is measured has noise.

use crate::record::{Channel, Role};

/// Order of the differences that tell noise from motion: what a motion of w radians a sample leaves in them is w^6 of it, of white noise they
/// have 30 deviations, the root of (12 over 6).
const ORDER: usize = 6;
/// Windows of a moving channel below which it moves only at isolated steps.
const FEWEST: usize = 10;
/// Numbers that are enough to tell how many digits were written.
const DIGITS: usize = 500;

/// Whether the values of a channel that is no output are those of a command: it moves only at isolated steps, or as exactly as its numbers
/// were written.
pub(crate) fn is_given(channel: &Channel) -> bool {
    channel.role != Role::Output && !is_noisy(&channel.values, channel.scale)
}

/// Whether values (N) that were multiplied by `scale` have noise of their own. A motion's differences shrink with their order as long as it
/// turns by less than a radian a sample, and those of white noise grow by `sqrt(4 - 2/k)`; rounding to the digits that were written is no noise.
fn is_noisy(values: &[f64], scale: f64) -> bool {
    let moving = |w: &&[f64]| w.iter().all(|v| v.is_finite()) && w.windows(2).all(|p| p[0] != p[1]);
    let (mut fine, mut coarse) = (Vec::new(), Vec::new());
    for window in values.windows(ORDER + 1).filter(moving) {
        let mut d = [0.0; ORDER + 1];
        d.copy_from_slice(window);
        for order in 0..ORDER {
            if order == ORDER - 1 {
                coarse.push(d[0].abs());
            }
            (0..ORDER - order).for_each(|k| d[k] = d[k + 1] - d[k]);
        }
        fine.push(d[0].abs());
    }
    if fine.len() < FEWEST {
        return false;
    }
    // the median of their magnitude, were they rounding alone: 0.67 of the deviation, and as much again for its scatter
    let rounding = 2.0 * 0.6745 * (924.0_f64 / 12.0).sqrt() * digit(values, scale);
    let (fine, coarse) = (median(&mut fine), median(&mut coarse));
    fine >= coarse && fine > rounding
}

/// The unit of the last digit that was written, in the unit of the values: the median over some of them.
fn digit(values: &[f64], scale: f64) -> f64 {
    let last = |v: f64| -> f64 {
        let written = format!("{:e}", (v / scale).abs());
        let Some((mantissa, exponent)) = written.split_once('e') else { return 0.0 };
        let places = mantissa.len().saturating_sub(2) as i32;
        exponent.parse::<i32>().map_or(0.0, |e| 10f64.powi(e - places))
    };
    let apart = values.len().div_ceil(DIGITS).max(1);
    let some = values.iter().step_by(apart).filter(|v| v.is_finite() && **v != 0.0);
    let mut digits: Vec<f64> = some.map(|v| last(*v)).collect();
    if digits.is_empty() { 0.0 } else { median(&mut digits) * scale.abs() }
}

fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_with_noise_is_measured_and_one_to_the_last_digit_is_given() {
        let motion = |digits: i32, noise: f64| -> Vec<f64> {
            let unit = 10f64.powi(digits);
            let rough = |k: u32| noise * (f64::from(k * k % 997) * 0.731).sin();
            (0..400).map(|k| (((0.1 * f64::from(k)).sin() + rough(k)) * unit).round() / unit).collect()
        };
        assert!(!is_noisy(&motion(9, 0.0), 1.0) && !is_noisy(&motion(3, 0.0), 1.0));
        assert!(is_noisy(&motion(9, 0.02), 1.0) && is_noisy(&motion(4, 0.005), 1.0));
        // levels that are kept
        let levels: Vec<f64> = (0..400).map(|k| f64::from(k / 10 * 7 % 13)).collect();
        assert!(!is_noisy(&levels, 1.0));
    }
}
