//! Directions beside what is fitted, in the metric of one noise: what each promises, and how alike two of them are.

use super::metric::Metric;
use super::trace::Point;
use super::way::Way;
use super::whitened::Lens;
use crate::diagnose::screen::{Record, Shape};
use crate::record::Run;

/// Columns with less than this of their energy left beside others are made of them.
const UNDETERMINED: f64 = 1e-10;

/// The residual beside what is fitted.
pub(super) struct Beside {
    /// Orthonormal columns of what is fitted.
    basis: Vec<Vec<f64>>,
    /// The residual without them.
    residual: Vec<f64>,
    lenses: Vec<std::sync::Mutex<Lens>>,
}

impl Beside {
    pub(super) fn new(records: &[Record], runs: &[Run], ways: &[Way], outputs: usize, metric: &Metric) -> Self {
        let lens = |(run, way): (&Run, &Way)| std::sync::Mutex::new(way.lens(run, outputs, metric));
        let lenses: Vec<_> = runs.iter().zip(ways).map(lens).collect();
        let residual: Vec<&[f64]> = records.iter().map(|r| &r.residual[..]).collect();
        let residual = together(&lenses, &residual);
        let mut beside = Self { basis: Vec::new(), residual, lenses };
        let fitted = records.first().map_or(0, |r| r.fitted.len());
        for c in 0..fitted {
            let zeros: Vec<Vec<f64>> = records.iter().map(|r| vec![0.0; r.residual.len()]).collect();
            let parts = records.iter().zip(&zeros).map(|(r, zero)| r.fitted[c].as_ref().unwrap_or(zero).as_slice());
            let column = together(&beside.lenses, &parts.collect::<Vec<_>>());
            if let Some(column) = beside.unit(column) {
                beside.basis.push(column);
            }
        }
        beside.residual = beside.left(beside.residual.clone());
        beside
    }

    /// A signal (one part for each run) without what is fitted.
    pub(super) fn direction(&self, parts: &[&[f64]]) -> Vec<f64> {
        self.left(together(&self.lenses, parts))
    }

    /// Twice the gain that a projected direction promises, and the multiple of it that does.
    pub(super) fn promise(&self, direction: &[f64], point: &Point) -> (f64, f64) {
        let (z, g) = (dot(direction, &self.residual), dot(direction, direction));
        if g <= 0.0 {
            return (0.0, 1.0);
        }
        let amount = match point.shape {
            Shape::Linear | Shape::Joint { .. } => z / g,
            Shape::Finite => (z / g).clamp(0.5, 2.0),
            Shape::Smallest => (z / g).clamp(0.05, 2.0),
        };
        (2.0 * amount * z - amount * amount * g, amount)
    }

    fn left(&self, mut column: Vec<f64>) -> Vec<f64> {
        // twice is enough (Kahan & Parlett)
        for _ in 0..2 {
            for own in &self.basis {
                let part = dot(own, &column);
                column.iter_mut().zip(own).for_each(|(c, o)| *c -= part * o);
            }
        }
        column
    }

    fn unit(&self, column: Vec<f64>) -> Option<Vec<f64>> {
        let whole = dot(&column, &column);
        let mut left = self.left(column);
        let size = dot(&left, &left);
        if whole <= 0.0 || size <= UNDETERMINED * whole {
            return None;
        }
        left.iter_mut().for_each(|v| *v /= size.sqrt());
        Some(left)
    }
}

/// Cosine of the angle between two directions.
pub(super) fn cosine(a: &[f64], b: &[f64]) -> f64 {
    let size = (dot(a, a) * dot(b, b)).sqrt();
    if size > 0.0 { dot(a, b) / size } else { 0.0 }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The parts of all runs through their lenses, one behind the other.
fn together(lenses: &[std::sync::Mutex<Lens>], parts: &[&[f64]]) -> Vec<f64> {
    let seen = |(lens, part): (&std::sync::Mutex<Lens>, &&[f64])| {
        lens.lock().unwrap_or_else(std::sync::PoisonError::into_inner).seen(part)
    };
    lenses.iter().zip(parts).flat_map(seen).collect()
}
