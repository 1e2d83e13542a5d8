//! What the code that `model!` writes stands on: slices as arrays, and the Runge-Kutta step over them.
//!
//! **In** slices whose lengths rustc does not know. **Out** arrays whose lengths it knows, so that states stay in
//! registers and no index is checked. **Never** a formula of its own: [`runge_kutta`] repeats, operation by operation,
//! the step of [`crate::dynamics`]. **Start** at [`runge_kutta`].

use crate::dynamics::Step;

/// The first N numbers.
///
/// # Panics
/// When there are fewer: the caller broke the contract of [`crate::dynamics::Dynamics`].
#[inline(always)]
pub fn front<const N: usize>(slice: &[f64]) -> &[f64; N] {
    match slice.first_chunk() {
        Some(front) => front,
        None => too_short(slice.len(), N),
    }
}

/// The first N numbers, to be written.
///
/// # Panics
/// As [`front`].
#[inline(always)]
pub fn front_mut<const N: usize>(slice: &mut [f64]) -> &mut [f64; N] {
    let len = slice.len();
    match slice.first_chunk_mut() {
        Some(front) => front,
        None => too_short(len, N),
    }
}

/// Four rows of S numbers, one for each stage of a step.
///
/// # Panics
/// As [`front`].
#[inline(always)]
pub fn stages_of<const S: usize>(stages: &mut [f64]) -> [&mut [f64; S]; 4] {
    let (len, wanted) = (stages.len(), 4 * S);
    if len < wanted {
        too_short(len, wanted)
    }
    let (begin, end) = stages.split_at_mut(2 * S);
    let ((first, second), (third, fourth)) = (begin.split_at_mut(S), end.split_at_mut(S));
    [front_mut(first), front_mut(second), front_mut(third), front_mut(fourth)]
}

#[cold]
#[inline(never)]
fn too_short(len: usize, wanted: usize) -> ! {
    panic!("a model was handed {len} numbers where it needs {wanted}")
}

/// One step. `program` writes, from time, states, drive and known, a row that begins with the N rates.
#[inline(always)]
pub fn runge_kutta<const N: usize, const D: usize, const K: usize, const S: usize>(
    step: Step<'_>,
    next: &mut [f64; N],
    stages: [&mut [f64; S]; 4],
    program: impl Fn(f64, &[f64; N], &[f64; D], &[f64; K], &mut [f64; S]),
) {
    let Step { t, h, x, drive, known } = step;
    let (x, known) = (front(x), front(known));
    let (begin, middle, end) = (front(drive), front(&drive[D..]), front(&drive[2 * D..]));
    let [s1, s2, s3, s4] = stages;
    let half = 0.5 * h;
    program(t, x, begin, known, s1);
    let k1 = *front::<N>(s1);
    program(t + half, &reached(x, half, &k1), middle, known, s2);
    let k2 = *front::<N>(s2);
    program(t + half, &reached(x, half, &k2), middle, known, s3);
    let k3 = *front::<N>(s3);
    program(t + h, &reached(x, h, &k3), end, known, s4);
    let k4 = front::<N>(s4);
    let (sixth, third) = (h / 6.0, h / 3.0);
    for i in 0..N {
        next[i] = ((x[i] + sixth * k1[i]) + third * (k2[i] + k3[i])) + sixth * k4[i];
    }
}

/// The states of the next stage.
#[inline(always)]
fn reached<const N: usize>(x: &[f64; N], reach: f64, slope: &[f64; N]) -> [f64; N] {
    let mut states = *x;
    for i in 0..N {
        states[i] = x[i] + reach * slope[i];
    }
    states
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_the_rows_in_order() {
        let mut numbers: Vec<f64> = (0..9).map(f64::from).collect();
        assert_eq!(stages_of::<2>(&mut numbers).map(|row| *row), [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0], [6.0, 7.0]]);
        assert_eq!(stages_of::<0>(&mut []).map(|row| row.len()), [0; 4]);
    }

    #[test]
    #[should_panic(expected = "handed 2 numbers where it needs 3")]
    fn a_short_slice_says_so() {
        front::<3>(&[1.0, 2.0]);
    }
}
