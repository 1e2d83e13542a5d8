//! Gaps of inputs: a simulation needs a value at every sample.

/// Fills the gaps (NaN) of input `k` of `width` and gives their number. Between two values linearly in time, or with
/// the value before when the input is held; before the first and after the last value with that value. Samples
/// stay NaN when there is no value at all.
pub(crate) fn bridge(time: &[f64], inputs: &mut [f64], width: usize, k: usize, held: bool) -> usize {
    let mut gaps = 0;
    let mut before: Option<usize> = None;
    let mut sample = 0;
    while sample < time.len() {
        if !inputs[sample * width + k].is_nan() {
            before = Some(sample);
            sample += 1;
            continue;
        }
        let after = (sample..time.len()).find(|s| !inputs[s * width + k].is_nan());
        let end = after.unwrap_or(time.len());
        for s in sample..end {
            let value = |s: usize| inputs[s * width + k];
            inputs[s * width + k] = match (before, after) {
                (Some(b), Some(a)) if !held => {
                    let part = (time[s] - time[b]) / (time[a] - time[b]);
                    value(b) + part * (value(a) - value(b))
                }
                (Some(b), _) => value(b),
                (None, Some(a)) => value(a),
                (None, None) => f64::NAN,
            };
        }
        gaps += end - sample;
        sample = end;
    }
    gaps
}

/// Where samples have no neighbours in time, a value of an input cannot be bridged: such samples are not compared.
pub(crate) fn compare_not(inputs: &[f64], width: usize, measured: &mut [f64], outputs: usize) {
    if width == 0 || outputs == 0 {
        return;
    }
    for (row, compared) in inputs.chunks_exact(width).zip(measured.chunks_exact_mut(outputs)) {
        if row.iter().any(|v| v.is_nan()) {
            compared.fill(f64::NAN);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_bridged_between_neighbours_and_filled_at_the_ends() {
        const NAN: f64 = f64::NAN;
        let time = [0.0, 1.0, 2.0, 4.0, 5.0, 6.0];
        let both = [NAN, NAN, 1.0, 7.0, NAN, 7.0, NAN, 9.0, 4.0, NAN, NAN, NAN];
        let mut inputs = both;
        assert_eq!(bridge(&time, &mut inputs, 2, 0, false), 4);
        assert_eq!(inputs.iter().step_by(2).copied().collect::<Vec<_>>(), [1.0, 1.0, 1.75, 3.25, 4.0, 4.0]);
        assert_eq!(bridge(&time, &mut inputs, 2, 1, true), 3);
        assert_eq!(inputs.iter().skip(1).step_by(2).copied().collect::<Vec<_>>(), [7.0, 7.0, 7.0, 9.0, 9.0, 9.0]);
        let mut held = both;
        bridge(&time, &mut held, 2, 0, true);
        assert_eq!(held.iter().step_by(2).copied().collect::<Vec<_>>(), [1.0, 1.0, 1.0, 1.0, 4.0, 4.0]);
    }
}
