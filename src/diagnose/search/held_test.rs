//! What held-out runs say of an effect by themselves, and what they and the first runs say together.
//!
//! Fitted to noise, an effect adds d to the base model's answer to a held-out run, in lines of unit noise. Of what the base model leaves
//! there, r, it gains r'd - d'd/2. Noise gives r'd a mean of zero and the variance d'd; the error of the base model's parameters, of covariance C
//! from the first runs, adds d'J C J'd. As the run took no part in the fit, this chance is independent of the one that the first runs
//! give, and both are one by the sum of their normal deviates (Stouffer). Their product (Fisher) forgets a held-out run that contradicts: a first
//! chance of 0.001 would stay below 0.01 whatever the run says, and first chances that small are known least well.

use super::beside::{Beside, dot};
use super::contender::Contender;
use super::contest::Contest;
use super::gains::responses;
use super::round::Round;
use super::stage::records;
use statrs::distribution::{ContinuousCDF, Normal};

/// Least square of an effect's answer in units of noise, below which held-out runs say nothing of it.
const HEARD: f64 = 1.0;
/// Held-out runs are believed down to this chance, and up to one less it: their noise is known from other runs.
const LEAST: f64 = 0.01;

/// The chance that noise makes an effect match the held-out runs as well as it does; none without such runs, or where they say nothing
/// of it.
pub(super) fn held_chance(round: &Round<'_>, contest: &Contest, contender: &Contender) -> Option<f64> {
    let (held, train) = (round.runs.held(), round.runs.train);
    let (base, (_, extended)) = (contest.base_held.as_ref()?, contender.held.as_ref()?);
    let (stage, metric) = (&round.stage, contest.metric.for_held());
    let (ways, q) = (&stage.ways[train..], stage.outputs());
    let own = records(&stage.model, held, ways, &base.theta).ok()?;
    let after = responses(&contender.model, held, &contender.ways[train..], &extended.theta)?;
    let beside = Beside::new(&round.records, round.runs.train(), &stage.ways, q, &contest.metric);
    let mut along = vec![0.0; round.free.0.len()];
    let (mut product, mut square, mut left, mut count) = (0.0, 0.0, 0.0, 0);
    for (((run, way), record), after) in held.iter().zip(ways).zip(&own).zip(&after) {
        let mut lens = way.lens(run, q, metric);
        let residual = lens.seen(&record.residual);
        let rest: Vec<f64> = way.measured(run).iter().zip(after).map(|(z, y)| z - y).collect();
        let rest = lens.seen(&rest);
        let added: Vec<f64> = residual.iter().zip(&rest).map(|(before, after)| before - after).collect();
        product += dot(&residual, &added);
        square += dot(&added, &added);
        left += dot(&rest, &rest);
        count += rest.len();
        for (along, column) in along.iter_mut().zip(&record.fitted) {
            *along += column.as_ref().map_or(0.0, |column| dot(&lens.seen(column), &added));
        }
    }
    if !(square > HEARD && product.is_finite()) {
        return None;
    }
    // where even the effect leaves more than that noise, there is more of it
    let noise = (left / count.max(1) as f64).max(1.0);
    let z = product / (noise * (square + beside.variance(&along))).sqrt();
    Some(Normal::standard().sf(z).clamp(LEAST, 1.0 - LEAST))
}

/// Two independent chances as one.
pub(super) fn both(first: f64, second: f64) -> f64 {
    let normal = Normal::standard();
    let deviate = |p: f64| -normal.inverse_cdf(p.clamp(f64::MIN_POSITIVE, 1.0));
    normal.sf((deviate(first) + deviate(second)) / std::f64::consts::SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_chances_are_one() {
        assert!((both(0.5, 0.5) - 0.5).abs() < 1e-12 && both(1e-300, 0.99) < 1e-100 && both(0.0, 0.5) < 1e-100);
        assert_eq!((both(1.0, 0.01), both(0.03, 0.2)), (1.0, both(0.2, 0.03)));
        // what is confirmed is less likely, what is contradicted more
        assert!(both(0.05, 0.01) < 0.004 && both(0.001, 0.99) > 0.2);
    }

    /// Chances of noise alone stay what they say.
    #[test]
    fn chances_of_noise_are_evenly_spread() {
        let even = |k: usize| (k as f64 + 0.5) / 400.0;
        let below = |level: f64| {
            let pairs = (0..400).flat_map(|a| (0..400).map(move |b| both(even(a), even(b).clamp(LEAST, 1.0 - LEAST))));
            pairs.filter(|p| *p < level).count() as f64 / 160_000.0
        };
        for level in [0.01, 0.05, 0.5] {
            let share = below(level);
            assert!(share < 1.02 * level && share > 0.6 * level, "{level} {share}");
        }
    }
}
