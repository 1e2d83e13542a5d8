//! Which of the principal-component solutions is taken.

use super::options::Components;
use super::solution::Decomposition;
use serde::Serialize;

/// The solution with the first `count` principal components.
#[derive(Debug, Clone, PartialEq, Serialize)]
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
#[derive(Debug, Clone, PartialEq, Serialize)]
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
