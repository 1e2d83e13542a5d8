//! What faults of outputs make of a response: an edit of a record, seen from the model's side.
//!
//! The record stays as it is, so that the likelihoods of all hypotheses are those of the same data: a factor needs no Jacobian, and what is read
//! between samples averages no noise. An edit says `z' = e(z)` is comparable with the response y; here y becomes `e^-1(y)`.

use fdm_doctor::{Edit, Slot, lag_weights};
use fdm_system::record::Cursor;

/// Whether an edit concerns outputs alone.
pub(crate) fn is_of_outputs(edit: &Edit) -> bool {
    let output = |s: Slot| matches!(s, Slot::Output(_));
    match *edit {
        Edit::Affine(s, ..) | Edit::Delay(s, _) | Edit::Drift(s, _) | Edit::Step(s, ..) | Edit::Filter(s, _) => {
            output(s)
        }
        Edit::Swap(a, b) => output(a) && output(b),
        Edit::Time(_) | Edit::Hold(..) => false,
    }
}

/// Whether an edit concerns columns alone that no model reads.
pub(crate) fn is_of_others(edit: &Edit) -> bool {
    let other = |s: Slot| matches!(s, Slot::Other(_));
    match *edit {
        Edit::Affine(s, ..) | Edit::Delay(s, _) | Edit::Drift(s, _) | Edit::Step(s, ..) | Edit::Filter(s, _) => {
            other(s)
        }
        Edit::Swap(a, b) => other(a) && other(b),
        Edit::Time(_) | Edit::Hold(..) => false,
    }
}

/// The outputs (of q) whose derivatives edits change.
pub(crate) fn touched(edits: &[Edit], q: usize) -> Vec<bool> {
    let mut found = vec![false; q];
    let mut touch = |slot: Slot| {
        if let Slot::Output(o) = slot {
            found[o] = true;
        }
    };
    for edit in edits {
        match *edit {
            Edit::Affine(s, factor, _) if factor != 1.0 => touch(s),
            Edit::Delay(s, _) | Edit::Drift(s, _) | Edit::Filter(s, _) => touch(s),
            Edit::Swap(a, b) => [a, b].into_iter().for_each(&mut touch),
            Edit::Affine(..) | Edit::Step(..) | Edit::Time(_) | Edit::Hold(..) => (),
        }
    }
    found
}

/// What the inverses of edits make of a response (N by q), the last one first; of a derivative the constants are left out. `time` are the times of the
/// samples as the edits have them. Before the record a response goes on straight as it began; behind it, it stays as it ended, as inputs do.
pub(crate) fn undone(edits: &[Edit], time: &[f64], q: usize, derivative: bool, values: &mut [f64]) {
    for edit in edits.iter().rev() {
        match *edit {
            Edit::Affine(Slot::Output(o), factor, offset) => {
                let offset = if derivative { 0.0 } else { offset };
                values.iter_mut().skip(o).step_by(q).for_each(|v| *v = (*v - offset) / factor);
            }
            Edit::Swap(Slot::Output(a), Slot::Output(b)) => values.chunks_exact_mut(q).for_each(|row| row.swap(a, b)),
            Edit::Delay(Slot::Output(o), by) => moved(time, values, (o, q), |t| t - by),
            Edit::Drift(Slot::Output(o), rate) => moved(time, values, (o, q), |t| t / (1.0 + rate)),
            Edit::Step(Slot::Output(o), at, by) if !derivative => {
                let own = values.iter_mut().skip(o).step_by(q).zip(time);
                own.filter(|(_, t)| **t >= at).for_each(|(v, _)| *v -= by);
            }
            Edit::Filter(Slot::Output(o), lag) => pass(time, values, (o, q), lag),
            _ => (),
        }
    }
}

/// One of `width` interleaved columns at other times: cubic between samples, so that the answer to a delay has a slope everywhere.
fn moved(time: &[f64], values: &mut [f64], (place, width): (usize, usize), at: impl Fn(f64) -> f64) {
    let column: Vec<f64> = values.iter().skip(place).step_by(width).copied().collect();
    let n = column.len();
    if n < 2 {
        return;
    }
    let slope = |k: usize| {
        let (a, b) = (k.saturating_sub(1), (k + 1).min(n - 1));
        (column[b] - column[a]) / (time[b] - time[a])
    };
    let mut cursor = Cursor::default();
    for (k, t) in time.iter().enumerate() {
        let (asked, inside) = (at(*t), at(*t).clamp(time[0], time[n - 1]));
        let left = cursor.at(time, inside).left.min(n - 2);
        let step = time[left + 1] - time[left];
        let part = (inside - time[left]) / step;
        let (a, b) = (column[left], column[left + 1]);
        let (da, db) = (slope(left) * step, slope(left + 1) * step);
        // Hermite's cubic
        let (s, u) = (part, 1.0 - part);
        let beyond = if asked < inside { (asked - inside) / step * da } else { 0.0 };
        values[k * width + place] =
            u * u * ((1.0 + 2.0 * s) * a + s * da) + s * s * ((1.0 + 2.0 * u) * b - u * db) + beyond;
    }
}

/// Sends one of `width` interleaved columns through a first-order lag, linear between samples, which begins as if the first interval's slope had lasted for
/// ever.
fn pass(time: &[f64], values: &mut [f64], (place, width): (usize, usize), lag: f64) {
    if time.len() < 2 {
        return;
    }
    let mut input = values[place];
    let mut own = input - lag / (time[1] - time[0]) * (values[width + place] - input);
    values[place] = own;
    for k in 1..time.len() {
        let (a, c) = lag_weights(lag, time[k] - time[k - 1]);
        let value = &mut values[k * width + place];
        own = a * own + (c - a) * input + (1.0 - c) * *value;
        input = std::mem::replace(value, own);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edit_undone_and_done_is_nothing() {
        let time: Vec<f64> = (0..200).map(|k| 0.1 * f64::from(k)).collect();
        let y: Vec<f64> = time.iter().flat_map(|t| [t.sin(), (0.7 * t).cos()]).collect();
        let mut moved = y.clone();
        undone(&[Edit::Affine(Slot::Output(0), -2.0, 3.0)], &time, 2, false, &mut moved);
        assert!(moved.iter().step_by(2).zip(y.iter().step_by(2)).all(|(a, b)| (-2.0 * a + 3.0 - b).abs() < 1e-12));
        let mut late = y.clone();
        undone(&[Edit::Delay(Slot::Output(0), 0.25)], &time, 2, false, &mut late);
        assert!((10..200).all(|k| (late[2 * k] - (time[k] - 0.25).sin()).abs() < 1e-3));
        let mut slow = y.clone();
        undone(&[Edit::Filter(Slot::Output(1), 1e-6)], &time, 2, false, &mut slow);
        assert!(slow.iter().zip(&y).all(|(a, b)| (a - b).abs() < 1e-4));
    }
}
