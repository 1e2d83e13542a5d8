//! Outputs whose noise has a standard deviation s that is an expression: residuals v as e = v/s, and what s adds to the likelihood.
//!
//! What is simulated is p = 1/s, so that an infinite deviation, of a sample that says nothing, is a number. Minus the logarithm of the likelihood is the sum of `e^2/2 + log s`, with the gradient `-(dy/s) e - (ds/s)(e^2 - 1)` and Fisher's information
//! `(dy/s)(dy/s)' + 2 (ds/s)(ds/s)'` (Davidian and Carroll 1987). So two outputs of unit noise stand for one: the first has the residual e and the row dy/s, the
//! second the residual `(e^2 - 1)/sqrt 2` and the row `sqrt 2 ds/s`. Gradient and information are then those of least squares; the cost is not, and
//! [`Response::surcharge`] makes up for it.
//!
//! Of an output with samples [below a limit](super::censored) the expectation over the values alone is not what it is over all samples. Its rows are the derivatives
//! of `(y - z) p` by everything, p among it, and of `log p`, whose second derivative is `(dp/p)(dp/p)'`.

use super::censored::Below;
use crate::problem::response::{Response, StandardisedResponse, TimeResponse};
use fdm_system::simulate::{Block, Divergence, RowLayout, Simulator, Sink};
use std::collections::BTreeSet;
use std::f64::consts::SQRT_2;

/// The response of a model that has one over its deviations as outputs behind its own.
pub(crate) struct Standardised<'a> {
    simulator: Simulator<'a>,
    /// Measured outputs of the model (N by q); NaN where nothing is compared.
    measured: Vec<f64>,
    /// Limits below which samples without a value lie (N by q), NaN where there are none; empty where no sample has one.
    limits: Vec<f64>,
    /// Number of outputs of the model q.
    outputs: usize,
    parts: Vec<Part>,
    surcharge: f64,
}

/// One over a deviation.
#[derive(Debug, Clone, Copy)]
pub(super) enum Precision {
    /// A simulated output.
    Simulated(usize),
    /// A number.
    Known(f64),
}

/// An output of the standardised response.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part {
    /// As it was simulated.
    Plain(usize),
    /// Residual over deviation: output and p.
    Residual(usize, usize),
    /// The score of the deviation.
    Score(usize, usize),
    /// Residual over deviation of an output with samples below a limit.
    Limited(usize, Precision),
    /// Minus the logarithm of p of such an output.
    Level(usize, usize),
}

impl Part {
    /// The outputs of a model one by one, by where one over the deviation of each is found (q) and whether it has samples below a limit.
    ///
    /// Of an output with such samples the deviation is always known: a number or an expression.
    pub(super) fn of_outputs(precisions: &[Option<Precision>], limited: impl Fn(usize) -> bool) -> Vec<Self> {
        let of = |(o, precision): (usize, &Option<Precision>)| match precision {
            Some(p) if limited(o) => {
                let level = if let Precision::Simulated(s) = p { Some(Self::Level(o, *s)) } else { None };
                [Self::Limited(o, *p)].into_iter().chain(level).collect()
            }
            Some(Precision::Simulated(s)) => vec![Self::Residual(o, *s), Self::Score(o, *s)],
            _ => vec![Self::Plain(o)],
        };
        precisions.iter().enumerate().flat_map(of).collect()
    }

    /// The output of the model that it belongs to.
    pub(super) fn output(self) -> usize {
        let (Self::Plain(o) | Self::Residual(o, _) | Self::Score(o, _) | Self::Limited(o, _) | Self::Level(o, _)) =
            self;
        o
    }

    /// Whether it is the one to be looked at of its output.
    pub(super) fn is_shown(self) -> bool {
        !matches!(self, Self::Score(..) | Self::Level(..))
    }

    /// What is compared with zero of a sample with the simulated numbers y, the value z and the limit, and what the cost has beside half its square.
    fn value(self, y: &[f64], z: f64, limit: f64) -> (f64, f64) {
        match self {
            Self::Plain(o) => (y[o], 0.0),
            Self::Residual(o, s) => ((y[o] - z) * y[s], 0.0),
            Self::Score(o, s) => {
                let e = (z - y[o]) * y[s];
                let score = (e * e - 1.0) / SQRT_2;
                let beside = if z.is_nan() { 0.0 } else { y[s].abs().ln() + 0.5 * score * score };
                (-score, -beside)
            }
            Self::Limited(o, p) if z.is_nan() && !limit.is_nan() => {
                let below = Below::new((limit - y[o]) * p.of(y));
                (below.residual(), -below.logarithm - 0.5 * below.residual().powi(2))
            }
            Self::Limited(o, Precision::Simulated(s)) => ((y[o] - z) * y[s], 0.0),
            Self::Limited(o, Precision::Known(p)) => ((y[o] - z) * p, if z.is_nan() { 0.0 } else { -p.ln() }),
            Self::Level(..) if z.is_nan() => (0.0, 0.0),
            Self::Level(_, s) => (-1.0, -y[s].abs().ln() - 0.5),
        }
    }

    /// Its row as a sum over rows of simulated numbers: which, and the factor.
    fn terms(self, y: &[f64], z: f64, limit: f64) -> [Option<(usize, f64)>; 2] {
        match self {
            Self::Plain(o) => [Some((o, 1.0)), None],
            Self::Residual(o, s) => [Some((o, y[s])), None],
            // ds/s is -dp/p
            Self::Score(_, s) => [Some((s, -SQRT_2 / y[s])), None],
            Self::Limited(o, p) => {
                let (weight, z) = match z.is_nan() && !limit.is_nan() {
                    true => (Below::new((limit - y[o]) * p.of(y)).weight(), limit),
                    false => (1.0, z),
                };
                let by_precision = |s: usize| (s, weight * (y[o] - z));
                let simulated = if let Precision::Simulated(s) = p { Some(by_precision(s)) } else { None };
                [Some((o, weight * p.of(y))), simulated]
            }
            Self::Level(_, s) if z.is_nan() => [Some((s, 0.0)), None],
            Self::Level(_, s) => [Some((s, 1.0 / y[s])), None],
        }
    }

    /// The columns of its row.
    fn columns(self, known: &RowLayout) -> Vec<u32> {
        let of = |k: usize| known.outputs[k].columns.iter().copied();
        match self {
            Self::Plain(k) | Self::Residual(k, _) | Self::Score(_, k) | Self::Level(_, k) => of(k).collect(),
            Self::Limited(o, Precision::Known(_)) => of(o).collect(),
            Self::Limited(o, Precision::Simulated(s)) => {
                of(o).chain(of(s)).collect::<BTreeSet<u32>>().into_iter().collect()
            }
        }
    }

    /// The simulated output that is one over its deviation.
    fn simulated(self) -> Option<usize> {
        match self {
            Self::Residual(_, s) | Self::Limited(_, Precision::Simulated(s)) => Some(s),
            _ => None,
        }
    }
}

impl Precision {
    fn of(self, y: &[f64]) -> f64 {
        match self {
            Self::Simulated(s) => y[s],
            Self::Known(p) => p,
        }
    }
}

impl<'a> Standardised<'a> {
    /// The run's outputs by `simulator`, those of the model (`measured`, N by q) and then p of each that has one simulated; with the limits of samples.
    pub(super) fn new(simulator: Simulator<'a>, (measured, limits): (Vec<f64>, Vec<f64>), parts: Vec<Part>) -> Self {
        let outputs = measured.len() / simulator.samples().max(1);
        Self { simulator, measured, limits, outputs, parts, surcharge: 0.0 }
    }

    /// What is compared with the outputs (N by their number): zero for residuals.
    pub(crate) fn targets(&self) -> Vec<f64> {
        let target = |k: usize, part: &Part| {
            let at = k * self.outputs + part.output();
            match part {
                Part::Plain(_) => self.measured[at],
                _ if self.measured[at].is_nan() && self.limit(at).is_nan() => f64::NAN,
                _ => 0.0,
            }
        };
        (0..self.simulator.samples()).flat_map(|k| self.parts.iter().map(move |part| target(k, part))).collect()
    }

    fn limit(&self, cell: usize) -> f64 {
        self.limits.get(cell).copied().unwrap_or(f64::NAN)
    }

    /// The parts of a sample, and what the cost has beside their squares, added to `surcharge`.
    fn outputs_of(&self, sample: usize, y: &[f64], to: &mut [f64], surcharge: &mut f64) {
        for (to, part) in to.iter_mut().zip(&self.parts) {
            let cell = sample * self.outputs + part.output();
            let beside;
            (*to, beside) = part.value(y, self.measured[cell], self.limit(cell));
            *surcharge += beside;
        }
    }
}

impl Response for Standardised<'_> {
    fn samples(&self) -> usize {
        self.simulator.samples()
    }

    fn outputs(&self) -> usize {
        self.parts.len()
    }

    fn simulate(&mut self, theta: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        let simulated = self.simulator.outputs();
        let mut all = vec![0.0; self.simulator.samples() * simulated];
        self.simulator.simulate(theta, &mut all)?;
        let negative = |(k, all): (usize, &[f64])| {
            self.parts.iter().any(|part| {
                let cell = k * self.outputs + part.output();
                let is_compared = !self.measured[cell].is_nan() || !self.limit(cell).is_nan();
                is_compared && part.simulated().is_some_and(|s| all[s] < 0.0)
            })
        };
        // beyond zero the likelihood would be that of the absolute value, and the estimate no deviation
        if let Some(sample) = all.chunks_exact(simulated).enumerate().position(negative) {
            let time = self.simulator.run().time[sample];
            return Err(Divergence { time, state: None, sample: sample.saturating_sub(1), event: None });
        }
        let mut surcharge = 0.0;
        for (k, (all, y)) in all.chunks_exact(simulated).zip(y.chunks_exact_mut(self.parts.len())).enumerate() {
            self.outputs_of(k, all, y, &mut surcharge);
        }
        self.surcharge = surcharge;
        Ok(())
    }

    fn sensitivities(&mut self, theta: &[f64], columns: &[usize], sink: &mut Sink<'_>) -> Result<(), Divergence> {
        let simulated = self.simulator.outputs();
        let (mut known, mut layout) = (RowLayout::default(), RowLayout::default());
        let (mut y, mut rows, mut surcharge) = (Vec::new(), Vec::new(), 0.0);
        // the simulator's own memory aside, the response is read only
        let Self { simulator, measured, limits, outputs, parts, .. } = self;
        let limit = |cell: usize| limits.get(cell).copied().unwrap_or(f64::NAN);
        simulator.stream(theta, columns, &mut |block| {
            if known != *block.layout {
                known = block.layout.clone();
                layout = RowLayout::new(parts.iter().map(|part| part.columns(&known)));
            }
            y.clear();
            y.resize(block.samples() * parts.len(), 0.0);
            rows.clear();
            rows.resize(block.samples() * layout.length, 0.0);
            for sample in 0..block.samples() {
                let all = &block.y[sample * simulated..][..simulated];
                for (k, (part, place)) in parts.iter().zip(&layout.outputs).enumerate() {
                    let cell = (block.first + sample) * *outputs + part.output();
                    let (z, limit) = (measured[cell], limit(cell));
                    let (value, beside) = part.value(all, z, limit);
                    y[sample * parts.len() + k] = value;
                    surcharge += beside;
                    let row = &mut rows[sample * layout.length + place.start..][..place.columns.len()];
                    for (from, factor) in part.terms(all, z, limit).into_iter().flatten() {
                        let values = known.outputs[from].columns.iter().zip(block.row(sample, from));
                        // columns rise in both
                        let mut at = 0;
                        for (column, value) in values {
                            at += place.columns[at..].iter().take_while(|c| *c < column).count();
                            row[at] += factor * value;
                        }
                    }
                }
            }
            sink(Block { first: block.first, y: &y, rows: &mut rows, layout: &layout });
        })?;
        self.surcharge = surcharge;
        Ok(())
    }
}

impl StandardisedResponse for Standardised<'_> {
    fn surcharge(&self) -> f64 {
        self.surcharge
    }
}

impl TimeResponse for Standardised<'_> {
    fn time(&self) -> Option<&[f64]> {
        Some(&self.simulator.run().time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_grammar::Source;
    use fdm_system::model::Model;
    use fdm_system::record::Run;
    use fdm_system::simulate::{Scheme, Steps};

    /// Cost, its gradient, and the products of the rows.
    fn evaluated(response: &mut Standardised<'_>, theta: &[f64]) -> (f64, Vec<f64>, Vec<f64>) {
        let (columns, n) = ([0, 1, 2], theta.len());
        let targets = response.targets();
        let (mut half, mut gradient, mut products) = (0.0, vec![0.0; n], vec![0.0; n * n]);
        let sink = &mut |block: Block<'_>| {
            let q = block.layout.outputs.len();
            for (k, y) in block.y.iter().enumerate().filter(|(k, _)| !targets[block.first * q + k].is_nan()) {
                let mut row = vec![0.0; n];
                let of = block.layout.outputs[k % q].columns.iter().zip(block.row(k / q, k % q));
                of.for_each(|(column, value)| row[*column as usize] = *value);
                half += 0.5 * y * y;
                (0..n).for_each(|i| gradient[i] += row[i] * y);
                (0..n * n).for_each(|i| products[i] += row[i / n] * row[i % n]);
            }
        };
        response.sensitivities(theta, &columns, sink).expect("a response");
        let with_sensitivities = half + response.surcharge();
        let mut y = vec![0.0; targets.len()];
        response.simulate(theta, &mut y).expect("a response");
        let squares: f64 = y.iter().zip(&targets).filter(|(_, t)| !t.is_nan()).map(|(y, _)| 0.5 * y * y).sum();
        assert!((with_sensitivities - squares - response.surcharge()).abs() < 1e-12);
        (with_sensitivities, gradient, products)
    }

    #[test]
    fn gradient_and_curvature_of_samples_below_a_limit_are_those_of_their_likelihood() {
        // by y/s and 1/s the likelihood has no other second derivative than that of the rows, and this model is linear in both
        let text = "model m { input u; param a = 1, b = -0.3, p = 2; output y = (a + b*u)/p; noise y = 1/p; }";
        let model = Model::from_source(Source::new("m", text)).expect("a model");
        let whole = model.altered(model.definition().with_precisions().expect("an expression"));
        let (time, gap): (Vec<f64>, f64) = ((0..6).map(f64::from).collect(), f64::NAN);
        let measured = vec![0.6, 0.2, gap, 0.3, gap, gap];
        let run = Run {
            name: "r".into(),
            inputs: time.clone(),
            time,
            held: vec![false],
            stated: Vec::new(),
            measured: measured.clone(),
            input_gaps: vec![0],
            output_gaps: vec![3],
        };
        let limits = vec![gap, gap, 0.25, gap, -0.1, gap];
        for precision in [Precision::Simulated(1), Precision::Known(1.5)] {
            let simulator = Simulator::new(whole.dynamics(), &run, Steps::equal(Scheme::default(), 1)).expect("suits");
            let parts = Part::of_outputs(&[Some(precision)], |_| true);
            let mut response = Standardised::new(simulator, (measured.clone(), limits.clone()), parts);
            let theta = [0.9, -0.2, 1.7];
            let (_, gradient, products) = evaluated(&mut response, &theta);
            for k in 0..3 {
                let mut beside = |h: f64| {
                    let mut theta = theta;
                    theta[k] += h;
                    evaluated(&mut response, &theta)
                };
                let (up, down) = (beside(1e-5), beside(-1e-5));
                let slope = (up.0 - down.0) / 2e-5;
                assert!(
                    (gradient[k] - slope).abs() < 1e-8 * (1.0 + slope.abs()),
                    "{precision:?} {k}: {gradient:?} {slope}"
                );
                let is_linear = matches!(precision, Precision::Simulated(_));
                for i in (0..3).filter(|_| is_linear) {
                    let bend = (up.1[i] - down.1[i]) / 2e-5;
                    assert!(
                        (products[3 * k + i] - bend).abs() < 1e-7 * (1.0 + bend.abs()),
                        "{k} {i}: {products:?} {bend}"
                    );
                }
            }
        }
    }
}
