//! The directions that a residual follows, one after the other: forward regression (orthogonal least squares; Chen, Billings & Luo,
//! International Journal of Control 50 (1989) 1873).
//!
//! What is taken out of a residual is no measure of its noise any more. All directions together leave next to nothing of three means, nor of
//! the bins below the corner of coloured noise, and whether a zero is off then nobody can tell. But a residual follows few of them. Of d independent
//! ones noise follows the best by 2 ln d (the largest of so many chi-square variates with one degree of freedom), so what is followed by less
//! stays (risk inflation; Foster & George, Annals of Statistics 22 (1994) 1947).

use nalgebra::{DMatrix, DVector};

/// Of a direction's energy, what must lie beside those that were taken out before.
const OWN: f64 = 0.05;
/// Least statistic of a direction that is followed, however few there are: what one more number costs (Akaike).
const LEAST: f64 = 2.0;

/// Directions of unit norm, in coordinates in which the noise is white.
#[derive(Debug, Clone)]
pub(super) struct Pursuit {
    unit: DMatrix<f64>,
    /// The statistic from which one is followed.
    least: f64,
    /// How many are taken out at most.
    most: usize,
}

impl Pursuit {
    /// Of directions beside what is fitted, in columns; at most so many are taken out.
    pub(super) fn new(mut unit: DMatrix<f64>, most: usize) -> Self {
        for mut column in unit.column_iter_mut() {
            column.try_normalize_mut(0.0);
        }
        let independent = unit.nrows().min(unit.ncols()).max(1) as f64;
        Self { least: (2.0 * independent.ln()).max(LEAST), most: most.min(unit.nrows()), unit }
    }

    /// What is taken out of a residual in the same coordinates: orthonormal columns, none where it follows nothing.
    pub(super) fn of(&self, rest: &DVector<f64>) -> DMatrix<f64> {
        let mut taken: Vec<DVector<f64>> = Vec::new();
        let mut along = self.unit.tr_mul(rest);
        let mut left = vec![1.0; self.unit.ncols()];
        while taken.len() < self.most {
            let statistic = |k: usize| if left[k] > OWN { along[k] * along[k] / left[k] } else { 0.0 };
            let best = (0..left.len()).max_by(|a, b| statistic(*a).total_cmp(&statistic(*b)).then(b.cmp(a)));
            let Some(best) = best.filter(|k| statistic(*k) > self.least) else { break };
            let mut own = self.unit.column(best).into_owned();
            // twice is enough (Kahan & Parlett)
            for _ in 0..2 {
                taken.iter().for_each(|known| own.axpy(-known.dot(&own), known, 1.0));
            }
            own.normalize_mut();
            let (seen, amount) = (self.unit.tr_mul(&own), own.dot(rest));
            for (k, seen) in seen.iter().enumerate() {
                along[k] -= amount * seen;
                left[k] -= seen * seen;
            }
            left[best] = 0.0;
            taken.push(own);
        }
        if taken.is_empty() { DMatrix::zeros(rest.len(), 0) } else { DMatrix::from_columns(&taken) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Stream;

    /// Sixty directions of forty coordinates, of which each shares a good part with its neighbours.
    fn directions() -> DMatrix<f64> {
        let mut normal = Stream::seeded(3);
        let apart = DMatrix::from_fn(40, 61, |_, _| normal.normal_of_pair());
        apart.columns(0, 60) + apart.columns(1, 60)
    }

    #[test]
    fn what_is_there_is_taken_out_and_no_more() {
        let (directions, mut normal) = (directions(), Stream::seeded(4));
        let pursuit = Pursuit::new(directions.clone(), 20);
        let (a, b) = (directions.column(7).normalize(), directions.column(41).normalize());
        let mut more = 0;
        for _ in 0..50 {
            let noise = DVector::from_fn(40, |_, _| normal.normal_of_pair());
            let taken = pursuit.of(&(&noise + 12.0 * &a - 9.0 * &b));
            assert!((taken.tr_mul(&taken) - DMatrix::identity(taken.ncols(), taken.ncols())).amax() < 1e-12);
            for own in [&a, &b] {
                assert!(taken.tr_mul(own).norm() > 0.99, "{}", taken.tr_mul(own).norm());
            }
            more += taken.ncols() - 2;
            // neither is a sign nor a unit of the directions of any importance
            let turned = Pursuit::new(-3.0 * &directions, 20).of(&(&noise + 12.0 * &a - 9.0 * &b));
            assert!((&taken * taken.transpose() - &turned * turned.transpose()).amax() < 1e-9);
        }
        assert!(more < 60, "{more}");
    }

    #[test]
    fn noise_follows_little() {
        let (pursuit, mut normal) = (Pursuit::new(directions(), 20), Stream::seeded(5));
        let count = |_| pursuit.of(&DVector::from_fn(40, |_, _| normal.normal_of_pair())).ncols();
        let counts: Vec<usize> = (0..200).map(count).collect();
        assert!(counts.iter().sum::<usize>() < 160, "{counts:?}");
        assert_eq!(Pursuit::new(DMatrix::zeros(4, 0), 9).of(&DVector::zeros(4)).ncols(), 0);
        // no more than may be taken
        assert_eq!(Pursuit::new(DMatrix::identity(9, 9), 3).of(&DVector::from_element(9, 8.0)).ncols(), 3);
    }
}
