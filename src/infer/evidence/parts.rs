//! Whether the parts of the records agree on a number: the size of a fault, the amount of an effect.
//!
//! Where no model is true its errors are no noise of any spectrum: a flexible cause gains from them as much as their likelihood believes, in one part of
//! the record and against another. So its size is estimated from parts that know equally much of it, in which what all parameters explain is left out.
//! Their scatter says how much larger its error is than the noise lets it be (Birge 1932; of many parts White 1982, of few Ibragimov and Mueller 2010),
//! and what is gained is the gain of that scatter:
//!
//! ```text
//! s_k(a) = d_k' W (r - a d)_k      I_k = d_k' W d_k      c(a) = max(1, mean of s_k^2/I_k)
//! gain = K/2 [ln c(0) + S(0)/c(0) - ln c(a) - S(a)/c(a)],   S the mean itself
//! ```

use crate::evidence::binning::Binning;
use crate::evidence::gram::Grams;
use crate::evidence::prior::{DECADES, Sign, of_amount};
use crate::evidence::question::{Evidence, Question};
use std::f64::consts::PI;

/// Parts of all records together: 8 to 16 (Ibragimov and Mueller 2010).
const PARTS: usize = 16;

/// What the parts of the records say of a size.
pub(crate) struct Parts {
    /// Score at the size that all parts together have, and information.
    parts: Vec<(f64, f64)>,
    /// Where all parts together have the size, and how far it is from there.
    size: f64,
    away: f64,
}

impl Parts {
    /// Mean of squared scores in their variances, so far from the size.
    fn scatter(&self, away: f64) -> f64 {
        let squares = self.parts.iter().map(|(score, information)| (score + away * information).powi(2) / information);
        squares.sum::<f64>() / self.parts.len().max(1) as f64
    }

    /// How far they are apart at the size, in what noise lets them be.
    pub(crate) fn disagreement(&self) -> Disagreement {
        Disagreement { scatter: self.scatter(0.0), parts: self.parts.len() as f64 }
    }

    /// By how much the square of the size's error is larger than that of the noise.
    pub(crate) fn dispersion(&self) -> f64 {
        let free = self.parts.len().max(2) as f64;
        (self.scatter(0.0) * free / (free - 1.0)).max(1.0)
    }

    /// What the size gains over none as it is, in nats, its prior and its error included.
    pub(crate) fn gain(&self) -> f64 {
        let cost = |away: f64| {
            let scatter = self.scatter(away);
            let dispersion = scatter.max(1.0);
            0.5 * self.parts.len() as f64 * (dispersion.ln() + scatter / dispersion)
        };
        let information: f64 = self.parts.iter().map(|p| p.1).sum();
        let error = (self.dispersion() / information).sqrt();
        cost(self.size) - cost(self.away)
            + of_amount(self.size, error, Sign::Either)
            + error.ln()
            + 0.5 * (2.0 * PI).ln()
    }
}

/// How far parts of the records are apart on a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Disagreement {
    /// Mean square of what they say against it, in that of noise.
    pub(crate) scatter: f64,
    parts: f64,
}

impl Disagreement {
    /// Evidence that the model errs by more than noise in the direction of the number, its scatter log-uniform over three decades (Laplace).
    pub(crate) fn of_misfit(&self) -> f64 {
        let scatter = self.scatter.max(1.0);
        0.5 * self.parts * (scatter - 1.0 - scatter.ln()) + 0.5 * (4.0 * PI / self.parts).ln() - DECADES.ln()
    }

    /// That without the number, which gains so much (nats).
    pub(crate) fn without(&self, gain: f64) -> Self {
        Self { scatter: self.scatter + 2.0 * gain.max(0.0) / self.parts, ..*self }
    }
}

/// A hypothesis linearised, and its evidence.
#[derive(Clone, Copy)]
pub(crate) struct Linearised<'a> {
    /// Columns in bins, run by run: so many of its own, the residual, the shared ones.
    pub(crate) columns: &'a [Vec<Vec<f64>>],
    pub(crate) own: usize,
    pub(crate) evidence: &'a Evidence,
    pub(crate) binning: &'a Binning,
}

impl Linearised<'_> {
    /// Parts for the shared unknown at this place, which is so large; none where it moves no response, or in the frequency domain.
    pub(crate) fn parts(&self, at: usize, size: f64) -> Option<Parts> {
        let Self { columns, own, evidence, binning } = *self;
        // what all others leave of its column
        let others = columns.iter().map(|columns| {
            let mut others = columns.clone();
            let column = others.remove(own + 1 + at);
            others[own] = column;
            others
        });
        let others: Vec<Vec<Vec<f64>>> = others.collect();
        let shared = others.first().map_or(0, |c| c.len() - own - 1);
        let mut grams = Grams::new(binning.outputs, binning.bands, shared);
        others.iter().zip(&binning.runs).for_each(|(columns, bins)| grams.add(own, &bins.segments, columns));
        let precision = vec![0.0; shared];
        let question = Question { grams: &grams, noise: &binning.noise, precision: &precision, own: &[] };
        let explained = question.step(&evidence.weights)?;
        let mut rows = Vec::new();
        for (r, run) in binning.runs.iter().enumerate() {
            let left = |columns: &[Vec<f64>], steps: &[f64], shared: &[f64]| {
                let mut left = columns[own].clone();
                let shares = steps.iter().zip(columns).chain(shared.iter().zip(&columns[own + 1..]));
                for (share, column) in shares {
                    left.iter_mut().zip(column).for_each(|(l, v)| *l -= share * v);
                }
                run.whitened(&left, &evidence.weights)
            };
            let column = left(&others[r], &explained.own[r], &explained.mean);
            let residual = left(&columns[r], &evidence.own[r], &evidence.mean);
            let samples = column.iter().filter_map(|(_, samples, _)| samples.last()).max().map_or(0, |last| last + 1);
            let mut own_rows = vec![(0.0, 0.0); samples];
            for ((_, samples, d), (_, _, r)) in column.iter().zip(&residual) {
                for (k, (d, r)) in samples.iter().zip(d.iter().zip(r)) {
                    own_rows[*k].0 += d * r;
                    own_rows[*k].1 += d * d;
                }
            }
            rows.extend(own_rows);
        }
        let away = evidence.mean[at];
        let parts = equal_parts(&rows);
        (!parts.is_empty()).then_some(Parts { parts, size: size + away, away })
    }
}

/// Sums of rows (score, information) in parts that know equally much: each is closed when it has its share, and what is left at the end belongs to the last.
fn equal_parts(rows: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let share = rows.iter().map(|r| r.1).sum::<f64>() / PARTS as f64;
    let (mut parts, mut open) = (Vec::new(), (0.0, 0.0));
    for (score, information) in rows {
        open = (open.0 + score, open.1 + information);
        if share > 0.0 && open.1 >= share {
            parts.push(std::mem::take(&mut open));
        }
    }
    if let Some(last) = parts.last_mut() {
        *last = (last.0 + open.0, last.1 + open.1);
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_numeric::random::Stream;

    /// Parts of noise of unit deviation beside an amount, with an error of the model of so many deviations in each.
    fn parts(size: f64, wrong: f64, seed: u64) -> Parts {
        let mut stream = Stream::seeded(seed);
        let parts = (0..PARTS).map(|_| (stream.normal() * (1.0 + wrong * wrong).sqrt(), 1.0)).collect();
        Parts { parts, size, away: 0.0 }
    }

    #[test]
    fn parts_that_agree_gain_what_noise_lets_them_and_parts_that_do_not_gain_little() {
        let sure = parts(3.0, 0.0, 3);
        assert!(sure.dispersion() < 2.0 && sure.gain() > 10.0, "{} {}", sure.dispersion(), sure.gain());
        let doubtful = parts(3.0, 8.0, 3);
        assert!(doubtful.dispersion() > 20.0 && doubtful.gain() < 0.0, "{} {}", doubtful.dispersion(), doubtful.gain());
    }

    #[test]
    fn a_misfit_is_likelier_than_noise_where_parts_are_apart_and_not_where_they_agree() {
        let agreed = parts(3.0, 0.0, 3).disagreement();
        assert!((-3.0..0.0).contains(&agreed.of_misfit()), "{agreed:?} {}", agreed.of_misfit());
        let apart = parts(3.0, 3.0, 3).disagreement();
        assert!(apart.of_misfit() > 10.0, "{apart:?} {}", apart.of_misfit());
        // what the number explains is left in the parts without it: half of its mean square over all parts is its gain
        let without = agreed.without(40.0);
        assert!((without.scatter - agreed.scatter - 5.0).abs() < 1e-12 && without.of_misfit() > 10.0, "{without:?}");
        assert!(without.of_misfit() < 40.0, "no more than the number itself");
    }

    #[test]
    fn parts_know_equally_much() {
        let rows: Vec<(f64, f64)> = (0..1000).map(|k| (1.0, if k < 100 { 9.0 } else { 1.0 })).collect();
        let parts = equal_parts(&rows);
        let share = 1800.0 / PARTS as f64;
        assert!((PARTS - 1..=PARTS).contains(&parts.len()), "{}", parts.len());
        assert!(parts.iter().all(|p| p.1 >= share && p.1 < 2.0 * share));
        // one sample that knows nearly all is one part, not a part beside those that know nothing
        let one: Vec<(f64, f64)> = (0..100).map(|k| (1.0, if k == 50 { 1e6 } else { 1e-6 })).collect();
        assert_eq!(equal_parts(&one).len(), 1);
    }
}
