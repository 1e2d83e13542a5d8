//! Least squares by QR and singular values: all principal-component solutions of one regression, and which of them is taken (Klein and Morelli 2006; Black,
//! Murray-Smith and Padfield 1986).

use super::options::Components;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// The solution with the first `count` principal components.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Component {
    /// How many components.
    pub count: usize,
    /// Singular value of the last of them; columns have unit length.
    pub singular_value: f64,
    /// Part of the sum of squares that is explained.
    pub r_squared: f64,
    /// F of the whole regression.
    pub total_f: f64,
    /// Standard deviation of the residual; in weighted rows when several equations share parameters.
    pub deviation: f64,
    /// Parameters.
    pub values: Vec<f64>,
    /// Their standard errors (white residuals).
    pub standard_errors: Vec<f64>,
    /// Partial F of each, `(value/standard error)^2`.
    pub partial_f: Vec<f64>,
    /// Root of the sum of variances of the scaled parameters (on columns of unit length).
    pub total_error: f64,
}

/// Why so many components were taken.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Chosen {
    /// All: the columns can be told apart.
    All,
    /// The caller's number.
    Asked,
    /// Fewer: the others are directions in which columns move together (all the more so the smaller their singular value), that
    /// explain next to nothing and cost much error. Each with the parameters that stand in it.
    Collinear(Vec<Vec<String>>),
}

/// A direction with a singular value below this part of the largest is one in which columns move together (condition index above
/// 30; Belsley, Kuh and Welsch 1980).
const COLLINEAR: f64 = 1.0 / 30.0;

/// R^2 has levelled off when what is left out adds no more than this.
const LEVEL: f64 = 0.005;

/// A direction whose own partial F is larger explains more than chance does, also where residuals are coloured (five times the
/// usual 4; Klein and Morelli 2006).
const CHANCE: f64 = 20.0;

/// A parameter is named in a direction when its weight is at least this.
const NAMED: f64 = 0.3;

/// The number of components: of those solutions that leave out only directions in which columns move together, none of which explains
/// more than chance does, and all of which explain at most 0.5 % of R^2, the one of least total error. Directions that
/// are nothing but rounding are never taken. [`Components::Levelled`] leaves out any direction that fulfils the rest.
pub(super) fn choose(found: &Decomposition, names: &[String], wanted: Components) -> (usize, Chosen) {
    let (p, rank) = (found.singular.len(), found.rank());
    if let Components::Count(count) = wanted {
        return (count.clamp(1, rank), Chosen::Asked);
    }
    let full = found.component(rank);
    let mut best = full.clone();
    for count in (1..rank).rev() {
        let apart = wanted == Components::Auto && found.singular[count] >= COLLINEAR * found.singular[0];
        if apart || found.component_f(count, rank) > CHANCE {
            break;
        }
        let fewer = found.component(count);
        if full.r_squared - fewer.r_squared > LEVEL {
            break;
        }
        if fewer.total_error < best.total_error {
            best = fewer;
        }
    }
    if best.count == p {
        return (p, Chosen::All);
    }
    let dropped = (best.count..p).map(|k| {
        let weights = found.direction(k);
        let named = weights.iter().zip(names).filter(|(w, _)| w.abs() >= NAMED);
        named.map(|(_, name)| name.clone()).collect()
    });
    (best.count, Chosen::Collinear(dropped.collect()))
}

/// Singular values below this part of the largest are rounding.
const ROUNDING: f64 = 1e-11;

/// A regression, decomposed. Columns are scaled to unit length before.
#[derive(Debug, Clone)]
pub(super) struct Decomposition {
    /// Length of each column (p).
    scale: Vec<f64>,
    /// Singular values, falling.
    pub(super) singular: Vec<f64>,
    /// Directions in the scaled parameters, one column each.
    directions: DMatrix<f64>,
    /// What each direction explains of the left side.
    parts: Vec<f64>,
    /// Sum of squares of what all together do not explain.
    rest: f64,
    /// Sum of squares of the left side, about its mean where there is a constant.
    total: f64,
    rows: usize,
    /// Degrees of freedom that were taken before.
    taken: usize,
    /// Factor on variances: rows over independent rows.
    repeated: f64,
    constant: bool,
}

/// What is decomposed.
pub(super) struct System<'a> {
    /// Rows by parameters.
    pub(super) columns: &'a DMatrix<f64>,
    pub(super) left: &'a DVector<f64>,
    /// Sum of squares of the left side that is to be explained.
    pub(super) total: f64,
    pub(super) taken: usize,
    pub(super) repeated: f64,
    /// Whether a column is constant, or a mean was removed.
    pub(super) constant: bool,
}

impl Decomposition {
    /// Decomposes a system of at least as many rows as columns; `None` when a number is not finite.
    pub(super) fn new(system: &System<'_>) -> Option<Self> {
        let p = system.columns.ncols();
        let scale: Vec<f64> = (0..p).map(|j| system.columns.column(j).norm()).collect();
        let finite = scale.iter().all(|s| s.is_finite() && *s > 0.0) && system.left.norm_squared().is_finite();
        if !finite {
            return None;
        }
        let mut scaled = system.columns.clone();
        scale.iter().enumerate().for_each(|(j, s)| scaled.column_mut(j).unscale_mut(*s));
        let qr = scaled.clone().qr();
        let mut projected = system.left.clone();
        qr.q_tr_mul(&mut projected);
        let svd = qr.r().try_svd(true, true, f64::EPSILON, 10_000)?;
        let (u, vt) = (svd.u?, svd.v_t?);
        let parts: Vec<f64> = (u.transpose() * projected.rows(0, p)).iter().copied().collect();
        let singular: Vec<f64> = svd.singular_values.iter().copied().collect();
        // the rest from the residual itself: as a difference of squares it would be rounding where the fit is good
        let kept = |k: usize| singular[k] > ROUNDING * singular[0];
        let mut theta = DVector::zeros(p);
        for k in (0..p).filter(|k| kept(*k)) {
            theta += vt.row(k).transpose() * (parts[k] / singular[k]);
        }
        let rest = (system.left - scaled * theta).norm_squared();
        Some(Self {
            scale,
            directions: vt.transpose(),
            parts,
            rest,
            total: system.total,
            rows: system.left.len(),
            taken: system.taken,
            repeated: system.repeated,
            constant: system.constant,
            singular,
        })
    }

    /// Number of components that are more than rounding.
    pub(super) fn rank(&self) -> usize {
        self.singular.iter().take_while(|s| **s > ROUNDING * self.singular[0]).count()
    }

    /// Partial F of a direction beside the first `rank`.
    pub(super) fn component_f(&self, k: usize, rank: usize) -> f64 {
        let freedom = self.rows.saturating_sub(rank + self.taken).max(1) as f64;
        self.parts[k].powi(2) / (self.rest / freedom * self.repeated)
    }

    /// The solution with the first `count` components.
    pub(super) fn component(&self, count: usize) -> Component {
        let p = self.scale.len();
        let unexplained = self.rest + self.parts[count..self.rank().max(count)].iter().map(|c| c * c).sum::<f64>();
        let freedom = self.rows.saturating_sub(count + self.taken).max(1) as f64;
        let variance = unexplained / freedom * self.repeated;
        let (mut values, mut variances) = (vec![0.0; p], vec![0.0; p]);
        for k in 0..count {
            for j in 0..p {
                let direction = self.directions[(j, k)] / (self.singular[k] * self.scale[j]);
                values[j] += direction * self.parts[k];
                variances[j] += direction * direction;
            }
        }
        let r_squared = 1.0 - unexplained / self.total;
        let explained = if self.constant && self.taken == 0 { count.saturating_sub(1).max(1) } else { count };
        let scaled_variance = variance * self.singular[..count].iter().map(|s| s.powi(-2)).sum::<f64>();
        Component {
            count,
            singular_value: self.singular[count - 1],
            r_squared,
            total_f: (r_squared.max(0.0) / explained as f64) / ((1.0 - r_squared) / freedom),
            deviation: (unexplained / freedom).sqrt(),
            partial_f: values.iter().zip(&variances).map(|(v, s)| v * v / (variance * s)).collect(),
            standard_errors: variances.iter().map(|s| (variance * s).sqrt()).collect(),
            values,
            total_error: scaled_variance.sqrt(),
        }
    }

    /// (X'X)^-1 in the space of the first components, for covariances of any noise.
    pub(super) fn inverse(&self, count: usize) -> DMatrix<f64> {
        let p = self.scale.len();
        let scaled = DMatrix::from_fn(p, count, |j, k| self.directions[(j, k)] / (self.singular[k] * self.scale[j]));
        &scaled * scaled.transpose()
    }

    /// The weights of the scaled parameters in a direction.
    pub(super) fn direction(&self, k: usize) -> Vec<f64> {
        self.directions.column(k).iter().copied().collect()
    }
}
