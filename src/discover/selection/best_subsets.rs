//! The best subsets of up to three columns, all of them tried: what a few effects predict together, by the products of their directions.
//!
//! Linear regression on columns that were projected beside what is fitted: a set with products G among its columns and z with the residual predicts
//! the gain a'z - a'G a/2, at the amounts a = G^-1 z that are best without bounds, each brought within its own. Of forty columns there are 780 pairs
//! and 9,880 triples, each a solution of three equations at most.

/// Part of its own energy that a column must have beside those before it.
const DISTINCT: f64 = 1e-3;

/// Columns among which subsets are looked for.
pub(super) struct Columns {
    /// Products of columns, m by m.
    pub(super) gram: Vec<f64>,
    /// Products with the residual (m).
    pub(super) along: Vec<f64>,
    /// What each costs (m).
    pub(super) penalty: Vec<f64>,
}

/// A subset with its amounts.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Subset {
    /// Columns, rising, each with its amount.
    pub(super) members: Vec<(usize, f64)>,
    /// The gain that it predicts, less what it costs.
    pub(super) score: f64,
}

impl Columns {
    /// The best `count` subsets of two or three columns, the best first; `within` brings the amount of a column within its bounds.
    pub(super) fn best_subsets(&self, count: usize, within: impl Fn(usize, f64) -> f64) -> Vec<Subset> {
        let m = self.along.len();
        let mut best: Vec<Subset> = Vec::new();
        let mut offer = |members: &[usize]| {
            let Some(found) = self.subset(members, &within) else { return };
            let place = best.partition_point(|other| other.score >= found.score);
            if place < count {
                best.insert(place, found);
                best.truncate(count);
            }
        };
        for a in 0..m {
            for b in 0..a {
                offer(&[b, a]);
                for c in 0..b {
                    offer(&[c, b, a]);
                }
            }
        }
        best
    }

    /// A subset at its best amounts; none where its columns are nearly made of each other.
    fn subset(&self, members: &[usize], within: &impl Fn(usize, f64) -> f64) -> Option<Subset> {
        let (m, k) = (self.along.len(), members.len());
        let product = |i: usize, j: usize| self.gram[members[i] * m + members[j]];
        // Cholesky's factor, and its solution
        let mut factor = [[0.0; 3]; 3];
        let mut amount = [0.0; 3];
        for i in 0..k {
            for j in 0..=i {
                let before: f64 = (0..j).map(|l| factor[i][l] * factor[j][l]).sum();
                let left = product(i, j) - before;
                if i > j {
                    factor[i][j] = left / factor[j][j];
                } else if left > DISTINCT * product(i, i) {
                    factor[i][i] = left.sqrt();
                } else {
                    return None;
                }
            }
            let before: f64 = (0..i).map(|l| factor[i][l] * amount[l]).sum();
            amount[i] = (self.along[members[i]] - before) / factor[i][i];
        }
        for i in (0..k).rev() {
            let after: f64 = (i + 1..k).map(|l| factor[l][i] * amount[l]).sum();
            amount[i] = (amount[i] - after) / factor[i][i];
        }
        let members_at: Vec<(usize, f64)> = (0..k).map(|i| (members[i], within(members[i], amount[i]))).collect();
        let mut score = 0.0;
        for (i, (own, a)) in members_at.iter().enumerate() {
            let others: f64 = members_at.iter().enumerate().map(|(j, (_, b))| product(i, j) * b).sum();
            score += a * self.along[*own] - 0.5 * a * others - self.penalty[*own];
        }
        score.is_finite().then_some(Subset { members: members_at, score })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns whose residual is three times the second, less twice the fifth and half of the sixth.
    fn columns() -> (Vec<Vec<f64>>, Columns) {
        let column =
            |k: usize| -> Vec<f64> { (0..40).map(|i| ((i * (k + 1)) as f64 * 0.37 + 0.2 * k as f64).sin()).collect() };
        let all: Vec<Vec<f64>> = (0..7).map(column).collect();
        let residual: Vec<f64> = (0..40).map(|i| 3.0 * all[1][i] - 2.0 * all[4][i] - 0.5 * all[5][i]).collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let gram = all.iter().flat_map(|a| all.iter().map(|b| dot(a, b)).collect::<Vec<_>>()).collect();
        let along = all.iter().map(|a| dot(a, &residual)).collect();
        (all, Columns { gram, along, penalty: vec![0.5; 7] })
    }

    #[test]
    fn the_set_that_made_the_residual_is_the_best() {
        let (all, columns) = columns();
        let best = &columns.best_subsets(5, |_, a| a)[0];
        let places: Vec<usize> = best.members.iter().map(|m| m.0).collect();
        assert_eq!(places, [1, 4, 5]);
        for ((_, found), amount) in best.members.iter().zip([3.0, -2.0, -0.5]) {
            assert!((found - amount).abs() < 1e-9, "{best:?}");
        }
        let residual: Vec<f64> = (0..40).map(|i| 3.0 * all[1][i] - 2.0 * all[4][i] - 0.5 * all[5][i]).collect();
        let whole: f64 = residual.iter().map(|r| 0.5 * r * r).sum();
        assert!((best.score - (whole - 1.5)).abs() < 1e-8, "{best:?} {whole}");
        // what is within bounds gains less, and is told as it is
        let bounded = columns.best_subsets(1, |k, a| if k == 4 { a.max(0.0) } else { a });
        assert!(bounded[0].score < best.score, "{bounded:?}");
        // what may not be is tried in every pair and triple
        assert_eq!(columns.best_subsets(1000, |_, a| a).len(), 21 + 35);
    }

    #[test]
    fn a_column_twice_is_no_set() {
        let (_, columns) = columns();
        let m = 7;
        let mut twice = Columns { gram: vec![0.0; 9], along: vec![0.0; 3], penalty: vec![0.0; 3] };
        let of = [1, 1, 4];
        for (i, a) in of.iter().enumerate() {
            for (j, b) in of.iter().enumerate() {
                twice.gram[i * 3 + j] = columns.gram[a * m + b];
            }
            twice.along[i] = columns.along[*a];
        }
        let sets: Vec<Vec<usize>> =
            twice.best_subsets(9, |_, a| a).iter().map(|s| s.members.iter().map(|m| m.0).collect()).collect();
        assert!(sets.len() == 2 && sets.iter().all(|s| s.len() == 2 && s[1] == 2), "{sets:?}");
    }
}
