//! The gain in likelihood that each direction predicts beside everything that was fitted.

use nalgebra::{DMatrix, DVector};

/// How a direction depends on the size of its effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// In proportion, of either sign: a derivative at the null value.
    Linear,
    /// In proportion, where the null is the least value that there can be: a friction is none below zero.
    Rising,
    /// The whole difference that this size makes: believed from half to twice as much.
    Finite,
    /// The whole difference that the smallest size makes that was tried on its side of the null, below which the effect
    /// fades to nothing.
    Smallest,
    /// Linear together with the candidate's other directions of the same group: two or more parameters at once.
    Joint {
        /// Which of the candidate's groups.
        group: usize,
    },
}

/// One simulated direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// The candidate that it belongs to (0, 1, ... without gaps, in order).
    pub candidate: usize,
    /// What the effect's parameter was there; the unit of linear directions.
    pub size: f64,
    /// How it scales.
    pub shape: Shape,
}

/// Below this share of its energy a direction is what was fitted already.
pub(super) const ABSORBED: f64 = 1e-5;

/// What is scored at once: a direction, or all of a group.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Trial {
    pub(super) candidate: usize,
    pub(super) shape: Shape,
    /// Directions.
    pub(super) members: Vec<usize>,
    /// Real numbers by which the noise under it is known.
    pub(super) freedom: f64,
}

impl Trial {
    /// All trials of directions that are not absorbed.
    pub(super) fn all(directions: &[Direction], usable: &[bool]) -> Vec<Self> {
        let mut trials: Vec<Self> = Vec::new();
        for (k, direction) in directions.iter().enumerate().filter(|(k, _)| usable[*k]) {
            let same = |t: &&mut Self| t.candidate == direction.candidate && t.shape == direction.shape;
            let joined = matches!(direction.shape, Shape::Joint { .. });
            match trials.iter_mut().find(same).filter(|_| joined) {
                Some(trial) => trial.members.push(k),
                None => trials.push(Self {
                    candidate: direction.candidate,
                    shape: direction.shape,
                    members: vec![k],
                    freedom: f64::INFINITY,
                }),
            }
        }
        trials
    }

    /// From products of the residual with the directions and of these with each other.
    pub(super) fn score(&self, z: &[f64], product: impl Fn(usize, usize) -> f64) -> Score {
        if let [k] = self.members[..] {
            return Score::single(self.shape, z[k], product(k, k));
        }
        let gram =
            DMatrix::from_fn(self.members.len(), self.members.len(), |i, j| product(self.members[i], self.members[j]));
        let own = DVector::from_fn(self.members.len(), |i, _| z[self.members[i]]);
        Score::joint(gram, own)
    }

    /// The statistic alone of the score.
    pub(super) fn statistic(&self, z: &[f64], product: impl Fn(usize, usize) -> f64) -> f64 {
        match self.members[..] {
            [k] => Score::amount(self.shape, z[k], product(k, k)).1,
            _ => self.score(z, product).statistic,
        }
    }

    /// What chi-square would have to be to be as unlikely as a statistic is when the noise is known by so many numbers only
    /// (Wallace 1959, normal approximation of Student's t).
    pub(super) fn equivalent(&self, statistic: f64) -> f64 {
        let nu = self.freedom;
        if nu > 1e6 {
            return statistic;
        }
        ((8.0 * nu + 1.0) / (8.0 * nu + 3.0)).powi(2) * nu * (statistic / nu).ln_1p()
    }
}

/// A trial against the residual.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Score {
    /// Twice the predicted gain in log-likelihood.
    pub(super) statistic: f64,
    /// The multiple of each direction that predicts it.
    pub(super) amounts: Vec<f64>,
}

impl Score {
    /// From z = d'r and G = d'd.
    fn single(shape: Shape, z: f64, g: f64) -> Self {
        let (amount, statistic) = Self::amount(shape, z, g);
        Self { statistic, amounts: vec![amount] }
    }

    fn amount(shape: Shape, z: f64, g: f64) -> (f64, f64) {
        if g <= 0.0 {
            return (0.0, 0.0);
        }
        let amount = match shape {
            Shape::Linear | Shape::Joint { .. } => z / g,
            Shape::Rising => (z / g).max(0.0),
            Shape::Finite => (z / g).clamp(0.5, 2.0),
            Shape::Smallest => (z / g).clamp(0.0, 2.0),
        };
        // a whole step that would do harm is not taken
        (amount, (2.0 * amount * z - amount * amount * g).max(0.0))
    }

    /// T = z' G^-1 z; parameters that cannot be told apart count as one.
    fn joint(mut gram: DMatrix<f64>, z: DVector<f64>) -> Self {
        let scale = gram.diagonal().map(|v| if v > 0.0 { 1.0 / v.sqrt() } else { 0.0 });
        for i in 0..z.len() {
            for j in 0..z.len() {
                gram[(i, j)] *= scale[i] * scale[j];
            }
            gram[(i, i)] += 1e-9;
        }
        let unit = z.component_mul(&scale);
        let Some(factor) = gram.cholesky() else {
            return Self { statistic: 0.0, amounts: vec![0.0; z.len()] };
        };
        let solved = factor.solve(&unit);
        Self { statistic: solved.dot(&unit).max(0.0), amounts: solved.component_mul(&scale).iter().copied().collect() }
    }
}

/// The best trial of every candidate, by the equivalent of its statistic.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Best {
    /// Which trial; none where no direction of the candidate counts.
    pub(super) trial: Option<usize>,
    pub(super) score: Score,
    pub(super) equivalent: f64,
}

/// Scores all trials of all candidates, by products of the residual with the directions and of these with each other.
pub(super) fn best(trials: &[Trial], candidates: usize, z: &[f64], product: impl Fn(usize, usize) -> f64) -> Vec<Best> {
    let mut best = vec![Best::default(); candidates];
    for (k, trial) in trials.iter().enumerate() {
        let score = trial.score(z, &product);
        let equivalent = trial.equivalent(score.statistic);
        let place = &mut best[trial.candidate];
        if place.trial.is_none() || equivalent > place.equivalent {
            *place = Best { trial: Some(k), score, equivalent };
        }
    }
    best
}

/// The largest equivalent of every candidate: the same without the sizes.
pub(super) fn equivalents(
    trials: &[Trial],
    candidates: usize,
    z: &[f64],
    product: impl Fn(usize, usize) -> f64,
) -> Vec<f64> {
    let mut best = vec![0.0; candidates];
    for trial in trials {
        let equivalent = trial.equivalent(trial.statistic(z, &product));
        if equivalent > best[trial.candidate] {
            best[trial.candidate] = equivalent;
        }
    }
    best
}
