//! Runs that repeat each other: what differs between them is noise, whatever the model gets wrong.
//!
//! Runs with equal directions are turned, by a rotation, into their mean (times the root of their number) and differences.
//! A rotation leaves noise as it is; the effects are all in the mean, and the differences tell the noise's spectrum without
//! a projection and without a part of the misfit in it. A record of several periods is such a set of runs when it is cut into
//! periods.

use super::shared::{Part, Shared};
use super::sketch::mixed;
use nalgebra::{DMatrix, DVector};

/// Directions of equal runs differ by less than this share of their energy (inputs may be measured ones).
const EQUAL: f64 = 1e-3;
/// Sums of directions by which runs are compared.
const PROBES: usize = 6;

/// The same lines with repeated runs turned; `None` where no run repeats another.
pub(super) fn turned(shared: &Shared) -> Option<Shared> {
    let groups = groups(shared);
    if groups.iter().all(|g| g.len() < 2) {
        return None;
    }
    let mut turned = shared.clone();
    for group in groups.iter().filter(|g| g.len() > 1) {
        for channel in 0..shared.channels {
            let place = |run: &usize| shared.parts.iter().position(|p| p.run == *run && p.channel == channel);
            let places: Vec<usize> = group.iter().filter_map(place).collect();
            turn(&mut turned.parts, &places);
        }
    }
    Some(turned)
}

/// Mean first, then each run against the mean of those before it (Helmert).
fn turn(parts: &mut [Part], places: &[usize]) {
    let own: Vec<(DMatrix<f64>, DVector<f64>)> =
        places.iter().map(|k| (parts[*k].basis.clone(), parts[*k].residual.clone())).collect();
    let count = own.len();
    for (row, place) in places.iter().enumerate() {
        let weight = |j: usize| match (row, j) {
            (0, _) => (count as f64).sqrt().recip(),
            (_, j) if j < row => ((row * (row + 1)) as f64).sqrt().recip(),
            (_, j) if j == row => -(row as f64) / ((row * (row + 1)) as f64).sqrt(),
            _ => 0.0,
        };
        let part = &mut parts[*place];
        part.basis.fill(0.0);
        part.residual.fill(0.0);
        for (j, (basis, residual)) in own.iter().enumerate() {
            part.basis.zip_apply(basis, |sum, value| *sum += weight(j) * value);
            part.residual.axpy(weight(j), residual, 1.0);
        }
        part.reference = row > 0;
    }
}

/// Runs that have equal directions, in the order of their first.
fn groups(shared: &Shared) -> Vec<Vec<usize>> {
    let mut runs: Vec<usize> = shared.parts.iter().map(|p| p.run).collect();
    runs.dedup();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let probes = probes(shared);
    for run in runs {
        match groups.iter_mut().find(|group| equal(shared, &probes, group[0], run)) {
            Some(group) => group.push(run),
            None => groups.push(vec![run]),
        }
    }
    groups
}

fn equal(shared: &Shared, probes: &DMatrix<f64>, a: usize, b: usize) -> bool {
    let of = |run: usize| shared.parts.iter().filter(move |p| p.run == run);
    if of(a).count() != of(b).count() {
        return false;
    }
    let (mut apart, mut energy) = (0.0, 0.0);
    for (a, b) in of(a).zip(of(b)) {
        if a.channel != b.channel || a.samples != b.samples || a.frequency != b.frequency {
            return false;
        }
        let (a, b) = (&a.basis * probes, &b.basis * probes);
        apart += (&a - b).norm_squared();
        energy += a.norm_squared();
    }
    apart < EQUAL * energy
}

/// Sums of all directions, each of unit energy, with signs: the energy of such a sum is on average that of all of them.
fn probes(shared: &Shared) -> DMatrix<f64> {
    let signs =
        DMatrix::from_fn(
            shared.unit.ncols(),
            PROBES,
            |i, k| {
                if mixed((i * PROBES + k) as u64) & 1 == 0 { 1.0 } else { -1.0 }
            },
        );
    &shared.unit * signs
}
