//! What an effect adds in the frequency domain: the derivative of the response at the null, or its difference from the null; exact, and
//! nothing is integrated.

use super::attached::Attached;
use super::round::Runs;
use super::stage::Stage;
use super::trace::{Point, kept};
use super::way::Way;
use crate::diagnose::screen::Signals;
use crate::estimate::{LineResponse, Response, SpectralLines, SpectralOptions};
use fdm_grammar::graph::Leaf;
use std::sync::Arc;

/// Points, what is added there to each run that is learned from, and the ways to all runs.
type Found = (Vec<Point>, Vec<Vec<Signals>>, Vec<Way>);

/// A candidate at all its points.
///
/// # Errors
/// Why it is left out, in words.
pub(super) fn transfers(
    attached: &Attached,
    mut points: Vec<Point>,
    stage: &Stage,
    runs: Runs<'_>,
    options: &SpectralOptions,
) -> Result<Found, String> {
    let last = points.last().map_or_else(Vec::new, |p| p.values.clone());
    let mut definition = attached.definition.clone();
    definition.params = attached.fitted_params(stage);
    // coefficients that nothing moves are those of a point that is tried
    let theta = attached.theta(stage, 0, &last);
    definition.params.iter_mut().zip(&theta).for_each(|(p, v)| p.value = *v);
    let model = stage.model.sketched(definition);
    let lines = SpectralLines::new(&model, runs.all, options).map_err(|e| e.to_string())?;
    if !lines.carried().is_empty() {
        // what terms are computed with is the same at all points
        let held = |k: usize| attached.params()[k].nuisance && attached.params()[k].fixed;
        points.retain(|p| (0..last.len()).all(|k| !held(k) || p.values[k] == last[k]));
    }
    let lines = Arc::new(lines);
    let mut benches = Vec::new();
    for run in 0..runs.train {
        benches.push(Bench::new(attached, stage, &lines, run).ok_or("the extended model has no frequency response")?);
    }
    let (kept, signals) = kept(points, |point| benches.iter_mut().map(|bench| bench.direction(point)).collect());
    match kept.is_empty() {
        true => Err("it changes nothing in the frequency domain".into()),
        false => Ok((kept, signals, Way::of_lines(&lines, runs.all.len()))),
    }
}

/// One run of a candidate.
struct Bench<'a> {
    attached: &'a Attached,
    stage: &'a Stage,
    run: usize,
    response: LineResponse,
    /// What belongs to the run alone, of the extended model.
    own: Vec<f64>,
}

impl<'a> Bench<'a> {
    fn new(attached: &'a Attached, stage: &'a Stage, lines: &SpectralLines, run: usize) -> Option<Self> {
        let (Way::Lines { lines: base, .. }, theta) = (&stage.ways[run], &stage.theta[run]) else { return None };
        let known = stage.ways[run].own(theta).ok()?;
        let value = |name: &str| match base.own().position(|own| own == name) {
            Some(at) => known[at],
            // a state of the effect that follows a signal ends as that does
            None => followed(attached, name).map_or(0.0, |signal| base.end_like(run, theta, &known, signal, name)),
        };
        let own = lines.own().map(value).collect();
        Some(Self { attached, stage, run, response: lines.response(run).ok()?, own })
    }

    /// What the effect adds at a point; none where that is not finite.
    fn direction(&mut self, point: &Point) -> Option<Signals> {
        if point.is_linear() {
            let theta = self.theta(&point.values);
            let cells = self.response.samples() * self.response.outputs();
            let (mut y, mut found) = (vec![0.0; cells], vec![0.0; cells]);
            let column = [self.attached.new[point.lead]];
            self.response.columns(&theta, &column, &mut y, (&mut found, 1)).ok()?;
            return found.iter().all(|v| v.is_finite()).then_some(found);
        }
        let mut y = self.answer(&point.values)?;
        let mut null = point.values.clone();
        null[point.lead] = self.attached.params()[point.lead].null;
        let null = Some(null).filter(|n| n.iter().all(|v| v.is_finite())).and_then(|null| self.answer(&null));
        let null = null.as_ref().unwrap_or(&self.stage.response[self.run]);
        y.iter_mut().zip(null).for_each(|(y, null)| *y -= null);
        Some(y)
    }

    fn answer(&mut self, values: &[f64]) -> Option<Signals> {
        let theta = self.theta(values);
        let mut y = vec![0.0; self.response.samples() * self.response.outputs()];
        self.response.simulate(&theta, &mut y).ok()?;
        y.iter().all(|v| v.is_finite()).then_some(y)
    }

    fn theta(&self, values: &[f64]) -> Vec<f64> {
        [self.attached.theta(self.stage, self.run, values), self.own.clone()].concat()
    }
}

/// The signal that a state of an effect begins as, by the name of the state's end value.
fn followed<'a>(attached: &'a Attached, end: &str) -> Option<&'a str> {
    let name = end.split_once('(')?.1.strip_suffix(')')?;
    let definition = &attached.definition;
    let state = definition.states.iter().find(|s| s.quantity.name == name)?;
    let begins = |at: usize| definition.graph.depends(|leaf| leaf == Leaf::Param(at as u32))[state.initial.index()];
    let k = attached.new.iter().position(|at| begins(*at))?;
    attached.params()[k].begins_as.as_deref()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::domain::Domain;
    use super::super::measured::Measured;
    use super::super::trace::trace;
    use super::*;
    use crate::model::Model;
    use crate::record::Run;
    use fdm_grammar::effect::{Catalogue, Kind};

    const MODEL: &str = "model m { input u; state x, z, w; param a = -1, b = 2, c = 0.4, d = -0.7;
        der(x) = a*x + z + b*u; der(z) = c*x - z + 0.5*u; der(w) = d*w + z; output x_m = x, z_m = z + 0.3*w, w_m = w; }";

    fn run() -> Run {
        let (n, dt) = (160, 0.05);
        let time: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let wave = |t: f64, f: f64| (f * t + 0.3).sin() + 0.5 * (2.7 * f * t).cos();
        Run {
            name: "r".into(),
            inputs: time.iter().map(|t| wave(*t, 1.3)).collect(),
            measured: time.iter().flat_map(|t| [wave(*t, 0.9), wave(*t, 1.1), wave(*t, 1.7)]).collect(),
            time,
            held: vec![false],
            input_gaps: vec![0],
            output_gaps: vec![0; 3],
        }
    }

    #[test]
    fn derivatives_are_those_of_central_differences() {
        let model = Model::from_text("m.fdm", MODEL).unwrap();
        let all = [run()];
        let domain = Domain::Frequency(Box::default()).settled(&model, &all).unwrap();
        let runs = Runs { all: &all, train: 1, domain: &domain };
        let stage = Stage::new(model.clone(), runs, vec![model.definition().start()]).unwrap();
        let measured = Measured::new(&stage, runs);
        let (mut compared, mut finite, mut tried, mut left_out) = (0, 0, Vec::new(), Vec::new());
        for candidate in Catalogue::standard().places(&stage.subject).candidates {
            if candidate.kind() == Kind::Variance {
                continue;
            }
            let trace = match trace(&candidate, &stage, runs, &measured) {
                Ok(trace) => trace,
                Err(reason) => {
                    left_out.push((super::super::round::place(&candidate).to_string(), reason));
                    continue;
                }
            };
            tried.push(super::super::round::place(&candidate).to_string());
            let Way::Lines { lines, .. } = &trace.ways[0] else { panic!("lines") };
            let mut bench = Bench::new(&trace.attached, &stage, lines, 0).unwrap();
            for (point, found) in trace.points.iter().zip(&trace.signals) {
                if !point.is_linear() {
                    finite += 1;
                    // a whole step is the sum of its halves
                    let null = trace.attached.params()[point.lead].null;
                    let at = |part: f64, values: &mut Vec<f64>| {
                        values[point.lead] = null + part * (values[point.lead] - null)
                    };
                    let mut values = point.values.clone();
                    at(0.5, &mut values);
                    let (half, whole) = (bench.answer(&values).unwrap(), bench.answer(&point.values).unwrap());
                    let base = &stage.response[0];
                    let off = |k: usize| (half[k] - base[k]) + (whole[k] - half[k]) - found[0][k];
                    let size = found[0].iter().fold(0.0_f64, |a, v| a.max(v.abs()));
                    assert!(
                        (0..half.len()).all(|k| off(k).abs() < 1e-6 * size),
                        "{} {:?}",
                        trace.attached.candidate.effect().name(),
                        point
                    );
                    continue;
                }
                compared += 1;
                let (h, mut values) = (1e-4, point.values.clone());
                let null = values[point.lead];
                let mut at = |value: f64| {
                    values[point.lead] = value;
                    bench.answer(&values).unwrap()
                };
                let (above, below) = (at(null + h), at(null - h));
                let size = found[0].iter().fold(0.0_f64, |a, v| a.max(v.abs()));
                for (k, v) in found[0].iter().enumerate() {
                    let central = (above[k] - below[k]) / (2.0 * h);
                    let place = super::super::round::place(&trace.attached.candidate);
                    assert!((central - v).abs() < 1e-5 * size, "{place} {point:?} line {k}: {v} instead of {central}");
                }
            }
        }
        assert!(compared > 20 && finite > 10, "{compared} {finite}");
        let reason = |place: &str| left_out.iter().find(|(name, _)| name == place).map_or("", |(_, why)| why);
        assert!(reason("constant_force(x)").contains("changes nothing"), "{left_out:?}");
        assert!(reason("input_dead_zone(u)").contains("not linear"), "{left_out:?}");
        // z is shown together with w only
        assert!(reason("quadratic_damping(z)").contains("not linear"), "{left_out:?}");
        for carried in ["quadratic_damping(x)", "product_term(x, u, w)", "output_bias_drift(x_m)"] {
            assert!(tried.iter().any(|place| place == carried), "{tried:?}");
        }
    }
}
