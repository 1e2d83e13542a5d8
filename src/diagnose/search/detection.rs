//! What screening says of each candidate: its rank, and how small it could have been and still be seen.

use super::round::{Round, place};
use super::trace::Point;
use crate::diagnose::diagnosis::{Detectable, Screened};

/// Normal quantile of the power with which an effect of the smallest size is seen: four times in five.
const POWER: f64 = 0.84;
/// What is left of a direction beside the fitted parameters below which nobody could see it.
const ABSORBED: f64 = 1e-3;
/// Of chi-square with one degree of freedom, once in a hundred times.
const SINGLE: f64 = 6.63;

impl Round<'_> {
    /// Candidates by rank.
    pub(super) fn ranking(&self) -> Vec<Screened> {
        self.screening.ranking.iter().map(|t| self.screened(*t)).collect()
    }

    fn screened(&self, t: usize) -> Screened {
        let (candidate, attached) = (&self.screening.candidates[t], &self.traces[t].attached);
        let point = candidate.direction.map(|d| &self.traces[t].points[self.owner[d].1]);
        let lead = point.map_or(attached.size(), |p| p.lead);
        let size = point.map_or(f64::NAN, |p| p.at(candidate.amount, attached.params())[p.lead]);
        Screened {
            place: place(&attached.candidate),
            gain: 0.5 * candidate.statistic,
            chance: candidate.chance,
            distinct: candidate.distinct,
            size,
            parameter: attached.params().get(lead).map_or(String::new(), |p| p.name.clone()),
        }
    }

    /// The smallest sizes that would be found by a search of this kind at one in a hundred.
    pub(super) fn detectable(&self) -> Vec<Detectable> {
        let width = self.width();
        (0..self.traces.len()).map(|t| self.smallest(t, width)).collect()
    }

    /// How many independent candidates the search is worth: from the chance of the best of all and that of the best alone.
    fn width(&self) -> f64 {
        let least = self.screening.candidates.iter().map(|c| c.chance).fold(1.0, f64::min);
        let all = self.screening.family_wise.clamp(1e-12, 0.999);
        let width = (-all).ln_1p() / (-least.clamp(1e-12, 0.999)).ln_1p();
        width.clamp(1.0, self.traces.len() as f64)
    }

    fn smallest(&self, t: usize, width: f64) -> Detectable {
        let (candidate, trace) = (&self.screening.candidates[t], &self.traces[t]);
        let own = (candidate.statistic - candidate.lead).max(SINGLE);
        let needed = (own + 2.0 * width.ln()).sqrt() + POWER;
        let directions = (0..self.owner.len()).filter(|d| self.owner[*d].0 == t);
        let sizes = directions.filter_map(|d| {
            let norm = self.screening.gram[(d, d)].max(0.0).sqrt();
            let point = &trace.points[self.owner[d].1];
            (norm > 0.0).then(|| (point, needed / norm))
        });
        let absorbed = candidate.direction.is_none() || candidate.distinct < ABSORBED;
        let lead = candidate.direction.map_or(trace.attached.size(), |d| trace.points[self.owner[d].1].lead);
        let param = &trace.attached.params()[lead];
        let reach = |(point, multiple): (&Point, f64)| {
            let value = if point.is_linear() {
                param.null + multiple
            } else if param.null.is_finite() {
                param.null + multiple * (point.values[lead] - param.null)
            } else {
                point.values[lead] / multiple
            };
            // a finite direction is believed near its own size: the trial that needs the least stretching speaks
            let stretch = if point.is_linear() { multiple } else { multiple.ln().abs() };
            (stretch, value)
        };
        let of_lead = sizes.filter(|(point, _)| point.lead == lead).map(reach);
        let best = of_lead.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, value)| value);
        Detectable {
            place: place(&trace.attached.candidate),
            parameter: param.name.clone(),
            smallest: best.filter(|v| v.is_finite() && !absorbed),
            unit: param.unit.as_ref().map(|u| u.text().to_string()),
            distinct: candidate.distinct,
        }
    }
}
