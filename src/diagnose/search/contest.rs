//! The best candidates of a search fitted jointly with the model, all by one noise.

use super::beside::Beside;
use super::contender::Contender;
use super::gains::responses;
use super::metric::Metric;
use super::options::Watcher;
use super::own_noise::Unlikely;
use super::refit::{Fitting, Posed};
use super::round::{PRICE, Round, shared_from};
use super::search_error::SearchError;
use super::stage::records;
use super::way::Way;
use crate::diagnose::screen::{LogSpectrum, Record, Signals};
use crate::record::Run;
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// Candidates that are refitted, at least.
const FEWEST: usize = 8;
/// And at most.
const MOST: usize = 24;
/// Corrections of the base model's fit.
const WHOLE: usize = 25;
/// Contenders that stay this far behind the best, and below this part of its gain, are not followed to the end.
const BEHIND: f64 = 40.0;
const PART: f64 = 0.25;
/// Contenders whose score is this near to the best are fitted from other starts too.
const CLOSE: f64 = 10.0;
/// Contenders of which the best is found before a noise is.
const LEADERS: usize = 3;
/// Family-wise chance, by what screening promises or by how unlikely the residual is as noise, below which the best candidates are fitted,
/// to see what they gain.
const DOUBTFUL: f64 = 0.1;
/// By how much likelier the base model must be elsewhere.
const ELSEWHERE: f64 = 5.0;
/// Gain from which the noise that the model seemed to have is that of its error too, in part.
const LARGE: f64 = 15.0;

/// The fits of a round, by one noise.
pub(super) struct Contest {
    pub(super) metric: Metric,
    /// The base model on the held-out runs, by it; none without such runs.
    pub(super) base_held: Option<Fitting>,
    /// The candidate without which the residual is likelier as noise, where that is doubtful.
    pub(super) unlikely: Option<Unlikely>,
    /// The best score first.
    pub(super) contenders: Vec<Contender>,
    /// Those that stayed far behind, by the first noise.
    pub(super) far: Vec<Contender>,
    /// Values (all parameters of each run that is learned from) at which the base model itself is likelier than at its fit; none where
    /// that is where it should be.
    pub(super) elsewhere: Option<Vec<Vec<f64>>>,
}

impl Round<'_> {
    /// Fits the best candidates jointly with the model, all by one noise: first that of the saturated residual, then that of the best
    /// model's.
    pub(super) fn contest(&mut self, watcher: &Watcher<'_>) -> Result<Contest, SearchError> {
        self.contest_of(FEWEST..=MOST, watcher)
    }

    /// The same of all candidates, whatever screening promises: where the model is far off, its error passes for noise and promises say
    /// little.
    pub(super) fn contest_of_all(&mut self, watcher: &Watcher<'_>) -> Result<Contest, SearchError> {
        self.contest_of(usize::MAX..=usize::MAX, watcher)
    }

    /// The same of so many candidates, the fewest and the most.
    pub(super) fn contest_of(
        &mut self,
        count: RangeInclusive<usize>,
        watcher: &Watcher<'_>,
    ) -> Result<Contest, SearchError> {
        let (metric, base) = self.begun()?;
        let beside = Beside::new(&self.records, self.runs.train(), &self.stage.ways, self.stage.outputs(), &metric);
        let mut chosen = self.chosen(count, (&beside, &metric, &base));
        let unlikely = self.unlikely_as_noise(&beside).filter(|u| u.chance < DOUBTFUL);
        chosen.extend(unlikely.map(|u| u.trace).filter(|t| !chosen.contains(t)));
        watcher(&format!("fitting the best {} of {} candidates", chosen.len(), self.traces.len()));
        let fitted = |t: &usize| self.contender(*t, &beside, &metric, &base);
        let mut contenders: Vec<Contender> = chosen.par_iter().filter_map(fitted).collect();
        drop(beside);
        sort(&mut contenders);
        let leaders = contenders.len().min(LEADERS);
        contenders[..leaders].par_iter_mut().for_each(|c| c.finish(self, &metric, &base));
        sort(&mut contenders);
        let likeliest = self.likeliest(&contenders);
        if let Some(k) = likeliest {
            contenders[k].finish(self, &metric, &base);
        }
        let Some(best) = contenders.first() else {
            return Ok(Contest { metric, base_held: None, unlikely, contenders, far: Vec::new(), elsewhere: None });
        };
        // the noise that the best model leaves judges all; that of the one without which the residual is no noise, where gains tell less
        let own = unlikely.filter(|u| u.nats > best.gain).and_then(|u| contenders.iter().find(|c| c.trace == u.trace));
        let own = own.or(likeliest.map(|k| &contenders[k]));
        let renewed = if own.is_some() || best.gain > LARGE { self.renewed(own.unwrap_or(best)) } else { None };
        let metric = renewed.unwrap_or(metric);
        let base = self.base(&metric, &base.theta)?;
        let near = (contenders[0].gain - BEHIND).min(PART * contenders[0].gain);
        let (mut contenders, far): (Vec<_>, Vec<_>) = contenders.into_iter().partition(|c| c.gain >= near);
        let mut base_held = self.base_held(&metric, &base);
        contenders.par_iter_mut().for_each(|c| {
            c.finish(self, &metric, &base);
            c.compare(self, &metric, base_held.as_ref());
        });
        let mut metric = metric;
        if let Some(raised) = self.with_surplus(&metric, base_held.as_ref(), &contenders) {
            metric = raised;
            base_held = self.base_held(&metric, &base);
            contenders.par_iter_mut().for_each(|c| c.compare(self, &metric, base_held.as_ref()));
        }
        sort(&mut contenders);
        // a name is worth looking for other minima
        let least = contenders[0].score() - CLOSE;
        contenders.par_iter_mut().filter(|c| c.score() > least).for_each(|c| {
            if c.again(self, &metric, &base) {
                c.compare(self, &metric, base_held.as_ref());
            }
        });
        sort(&mut contenders);
        let elsewhere = self.elsewhere(&contenders, &metric, &base);
        Ok(Contest { metric, base_held, unlikely, contenders, far, elsewhere })
    }

    /// Whether something may be there: by what screening promises, or as the residual is likelier as noise without a candidate.
    pub(super) fn is_doubtful(&mut self) -> bool {
        if self.screening.family_wise < DOUBTFUL {
            return true;
        }
        let Ok((metric, _)) = self.begun() else { return false };
        let beside = Beside::new(&self.records, self.runs.train(), &self.stage.ways, self.stage.outputs(), &metric);
        self.unlikely_as_noise(&beside).is_some_and(|u| u.chance < DOUBTFUL)
    }

    /// The first noise, and the base model by it.
    fn begun(&mut self) -> Result<(Metric, Fitting), SearchError> {
        let metric = Metric::new(&self.screening.spectra, self.options.dropped).within(self.left());
        let base = self.base(&metric, &self.stage.theta[..self.runs.train])?;
        Ok((metric, base))
    }

    /// The base model by a noise.
    fn base(&self, metric: &Metric, starts: &[Vec<f64>]) -> Result<Fitting, SearchError> {
        let fitted = self.base_posed(metric).fit(starts, WHOLE);
        fitted.ok_or_else(|| SearchError::NoFit("its fit by the noise found has no end".into()))
    }

    fn base_posed<'c>(&'c self, metric: &'c Metric) -> Posed<'c> {
        let (stage, runs) = (&self.stage, self.runs.train());
        let (params, ways) = (stage.params().to_vec(), &stage.ways[..self.runs.train]);
        Posed { params, dynamics: stage.model.dynamics(), runs, ways, metric }
    }

    /// Where the base model is likelier than at its fit, begun from what contenders have found of its parameters: of a delay there may be
    /// several minima, and a fit by another noise may have ended at the wrong one. What effects gain beside that says nothing of them.
    fn elsewhere(&self, contenders: &[Contender], metric: &Metric, base: &Fitting) -> Option<Vec<Vec<f64>>> {
        contenders.first().filter(|best| best.gain > LARGE)?;
        let mut bench = self.base_posed(metric).bench()?;
        let of = |c: &Contender| -> Vec<Vec<f64>> {
            let attached = &self.traces[c.trace].attached;
            c.fitting.theta.iter().map(|theta| attached.base(theta)).collect()
        };
        let starts = contenders.iter().filter_map(|c| Some((bench.look(&of(c))?, of(c))));
        let (_, starts) = starts.min_by(|a, b| a.0.total_cmp(&b.0))?;
        drop(bench);
        let found = self.base(metric, &starts).ok()?;
        (found.cost < base.cost - ELSEWHERE).then_some(found.theta)
    }

    /// The base model on the held-out runs.
    fn base_held(&self, metric: &Metric, base: &Fitting) -> Option<Fitting> {
        let stage = &self.stage;
        let starts = shared_from(stage.params(), base.theta.first()?, &stage.theta[self.runs.train..]);
        let (params, ways) = (stage.params().to_vec(), &stage.ways[self.runs.train..]);
        let (runs, metric) = (self.runs.held(), metric.for_held());
        Posed { params, dynamics: stage.model.dynamics(), runs, ways, metric }.held().fit(&starts, WHOLE)
    }

    /// What the base model leaves: noise, and whatever is missing; none where no spectrum can be had.
    fn left(&mut self) -> Vec<LogSpectrum> {
        let directions: Vec<_> = self.records.iter_mut().map(|r| std::mem::take(&mut r.directions)).collect();
        let found = self.stage.noise(&self.records, &self.options);
        self.records.iter_mut().zip(directions).for_each(|(record, own)| record.directions = own);
        found.unwrap_or_default()
    }

    /// The contender that leaves what is likeliest as noise of any smooth spectrum, where that is not the best one, by far: where the model
    /// is far off, its error passes for noise, by which gains say little.
    fn likeliest(&self, contenders: &[Contender]) -> Option<usize> {
        contenders.first().filter(|best| best.gain > LARGE)?;
        let train = self.runs.train;
        let of = |c: &Contender| -> Option<f64> {
            let answers = responses(&c.model, self.runs.train(), &c.ways[..train], &c.fitting.theta)?;
            let left = |((way, run), y): ((&Way, &Run), &Signals)| -> Signals {
                way.measured(run).iter().zip(y).map(|(z, y)| z - y).collect()
            };
            let left: Vec<Signals> = c.ways.iter().zip(self.runs.train()).zip(&answers).map(left).collect();
            Some(self.likelihood(&left) - PRICE * c.cost as f64)
        };
        let all: Vec<Option<f64>> = contenders.par_iter().map(of).collect();
        let first = all[0]?;
        let known = all.iter().enumerate().filter_map(|(k, own)| own.map(|own| (k, own)));
        let (k, most) = known.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))?;
        (most > first + LARGE).then_some(k)
    }

    /// The noise that is left by a contender, all directions taken out; where these leave too little to tell, what it leaves itself.
    fn renewed(&mut self, best: &Contender) -> Option<Metric> {
        let mut records = records(&best.model, self.runs.train(), &best.ways, &best.fitting.theta).ok()?;
        let left = self.stage.noise(&records, &self.options).unwrap_or_default();
        // directions are large: they are lent
        let lend = |a: &mut [Record], b: &mut [Record]| {
            a.iter_mut().zip(b).for_each(|(a, b)| std::mem::swap(&mut a.directions, &mut b.directions));
        };
        lend(&mut records, &mut self.records);
        let found = self.stage.noise(&records, &self.options);
        lend(&mut records, &mut self.records);
        Some(Metric::new(&found.ok()?, self.options.dropped).within(left))
    }
}

fn sort(contenders: &mut [Contender]) {
    contenders.sort_by(|a, b| b.score().total_cmp(&a.score()).then(a.trace.cmp(&b.trace)));
}
