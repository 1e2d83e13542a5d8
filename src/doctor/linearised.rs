//! A fit about its estimates: the response itself to an edit of the record, and one Gauss-Newton step of the parameters to what is left (as the
//! score test of Rao 1948 does). A hypothesis that nothing speaks for costs one simulation in the place of a fit.

use crate::filtered::pass;
use crate::hypothesis::{Edit, lags_of};
use crate::likelihood::{Evidence, Trial, is_plain, parameters_of_runs};
use fdm_estimate::{Changes, Noise, starts};
use fdm_numeric::active_set::{StepBounds, constrained};
use fdm_numeric::lanes::VECTOR;
use fdm_numeric::quadratic::Quadratic;
use fdm_system::Model;
use fdm_system::record::Run;
use fdm_system::simulate::Simulator;

/// Numbers of a Jacobian beyond which hypotheses are fitted: 256 MB.
const MOST: usize = 1 << 25;

/// The response of a fit at its estimates, and its derivatives by the free parameters.
pub(crate) struct Linearised<'a> {
    evidence: &'a Evidence<'a>,
    model: &'a Model,
    fit: &'a Trial,
    /// All parameters of each run.
    thetas: Vec<Vec<f64>>,
    /// Free parameters, those that all runs share first.
    columns: Vec<usize>,
    shared: usize,
    /// The runs as they were fitted.
    runs: Vec<Run>,
    /// Outputs of each run (N by q) before any lag.
    responses: Vec<Vec<f64>>,
    /// Derivatives of each run, N q rows of `stride`, before any lag.
    jacobians: Vec<Vec<f64>>,
    stride: usize,
}

impl<'a> Linearised<'a> {
    /// About a fit of the record with these edits. None where there is no fit, or its derivatives would not fit into memory.
    pub(crate) fn of(evidence: &'a Evidence<'a>, fit: &'a Trial, edits: &[Edit]) -> Option<Self> {
        let estimate = fit.estimate.as_ref()?;
        Self::at(evidence, fit, edits, |model, runs| parameters_of_runs(model, runs, estimate))
    }

    /// About the start values of the text, on the steps of a fit. None where derivatives would not fit into memory.
    pub(crate) fn of_text(evidence: &'a Evidence<'a>, fit: &'a Trial, edits: &[Edit]) -> Option<Self> {
        Self::at(evidence, fit, edits, |model, runs| starts(model, runs, &Changes::default()))
    }

    fn at(
        evidence: &'a Evidence<'a>,
        fit: &'a Trial,
        edits: &[Edit],
        values: impl Fn(&Model, &[Run]) -> Vec<Vec<f64>>,
    ) -> Option<Self> {
        let model = evidence.model.filter(|model| is_plain(model))?;
        let runs = evidence.edited_runs(model, edits)?;
        let free = |per_run: bool| {
            let params = model.definition().params.iter().enumerate();
            params.filter(move |(_, p)| !p.fixed && p.per_run == per_run).map(|(k, _)| k)
        };
        let mut columns: Vec<usize> = free(false).collect();
        let shared = columns.len();
        columns.extend(free(true));
        let stride = columns.len().next_multiple_of(VECTOR);
        let numbers: usize = runs.iter().map(|r| r.measured.len() * stride).sum();
        if numbers > MOST || fit.steps.of_runs.len() != runs.len() {
            return None;
        }
        let thetas = values(model, &runs);
        let (mut responses, mut jacobians) = (Vec::new(), Vec::new());
        for ((run, theta), steps) in runs.iter().zip(&thetas).zip(&fit.steps.of_runs) {
            let mut simulator = Simulator::new(model.dynamics(), run, steps.clone()).ok()?;
            simulator.suits(theta).ok()?;
            let (mut y, mut jacobian) = (vec![0.0; run.measured.len()], vec![0.0; run.measured.len() * stride]);
            simulator.sensitivities(theta, &columns, &mut y, &mut jacobian).ok()?;
            responses.push(y);
            jacobians.push(jacobian);
        }
        Some(Self { evidence, model, fit, thetas, columns, shared, runs, responses, jacobians, stride })
    }

    /// The record with these edits in the place of those of the fit. None where it cannot be simulated.
    pub(crate) fn trial(&self, edits: &[Edit]) -> Option<Trial> {
        if !self.evidence.work.goes_on() {
            return None;
        }
        let new = self.evidence.edited_runs(self.model, edits)?;
        let lags = lags_of(edits);
        let q = self.model.layout().outputs;
        let mut residuals = Vec::with_capacity(new.len());
        for (r, run) in new.iter().enumerate() {
            let mut y = self.response(r, run)?;
            for (output, lag) in &lags {
                pass(&run.time, &mut y, (*output, q), *lag);
            }
            residuals.push(fdm_estimate::residuals::residuals(&run.measured, &y));
        }
        let lagged: Option<Vec<Vec<f64>>> = (!lags.is_empty()).then(|| {
            let behind = |(run, jacobian): (&Run, &Vec<f64>)| {
                let mut jacobian = jacobian.clone();
                for (output, lag) in &lags {
                    for lane in 0..self.columns.len() {
                        pass(&run.time, &mut jacobian, (output * self.stride + lane, q * self.stride), *lag);
                    }
                }
                jacobian
            };
            new.iter().zip(&self.jacobians).map(behind).collect()
        });
        let jacobians = lagged.as_ref().unwrap_or(&self.jacobians);
        let declared = match Evidence::options(self.model, 0).options.noise {
            Noise::Given(given) => given,
            _ => vec![None; q],
        };
        let known = |left: &[Vec<f64>]| -> Vec<f64> {
            let squares = mean_squares(left, q).into_iter().zip(&declared);
            squares.map(|(square, declared)| declared.map_or(square, |d| d * d)).collect()
        };
        // the variances are those of what is left: two steps
        let mut left = residuals.clone();
        for _ in 0..2 {
            let step = self.step(&residuals, jacobians, &known(&left))?;
            for (r, (left, residuals)) in left.iter_mut().zip(&residuals).enumerate() {
                let own = |lane: usize| step[self.position(r, lane)];
                let moves: Vec<f64> = (0..self.columns.len()).map(own).collect();
                for ((left, e), row) in left.iter_mut().zip(residuals).zip(jacobians[r].chunks(self.stride.max(1))) {
                    *left = e - row.iter().zip(&moves).map(|(j, s)| j * s).sum::<f64>();
                }
            }
        }
        self.evidence.unestimated(left, &new, edits, self.fit)
    }

    /// The outputs of a run (N by q) at the estimates, before any lag.
    fn response(&self, r: usize, run: &Run) -> Option<Vec<f64>> {
        let layout = self.model.layout();
        let own = &self.runs[r];
        if layout.wraps.is_empty() && own.inputs == run.inputs && own.time == run.time {
            return Some(self.responses[r].clone());
        }
        let mut theta = self.thetas[r].clone();
        for (param, input) in &layout.first {
            theta[*param as usize] = *run.inputs.get(*input as usize)?;
        }
        let mut simulator = Simulator::new(self.model.dynamics(), run, self.fit.steps.of_runs[r].clone()).ok()?;
        simulator.suits(&theta).ok()?;
        let mut y = vec![0.0; run.measured.len()];
        simulator.simulate(&theta, &mut y).ok()?;
        Some(y)
    }

    /// Place of a run's column among the unknowns.
    fn position(&self, run: usize, lane: usize) -> usize {
        let own = self.columns.len() - self.shared;
        if lane < self.shared { lane } else { run * own + lane }
    }

    /// The step of the unknowns to these residuals, within bounds and with what is known beforehand.
    fn step(&self, residuals: &[Vec<f64>], jacobians: &[Vec<f64>], variances: &[f64]) -> Option<Vec<f64>> {
        /// Of the scaled information: what is not determined stays.
        const DAMPING: f64 = 1e-9;
        let (width, q) = (self.columns.len(), variances.len());
        let size = self.shared + self.runs.len() * (width - self.shared);
        if size == 0 {
            return Some(Vec::new());
        }
        let (mut information, mut descent) = (vec![0.0; size * size], vec![0.0; size]);
        for (r, (residuals, jacobian)) in residuals.iter().zip(jacobians).enumerate() {
            // the sums of one run by its own columns, which are few
            let (mut products, mut sums) = (vec![0.0; width * width], vec![0.0; width]);
            for (k, (e, row)) in residuals.iter().zip(jacobian.chunks(self.stride.max(1))).enumerate() {
                let weight = 1.0 / variances[k % q];
                if !e.is_finite() || !weight.is_finite() {
                    continue;
                }
                for (i, (own, sum)) in row.iter().zip(&mut sums).enumerate() {
                    let weighted = weight * own;
                    if weighted != 0.0 {
                        *sum += weighted * e;
                        products[i * width..][..width].iter_mut().zip(row).for_each(|(h, j)| *h += weighted * j);
                    }
                }
            }
            for (i, sum) in sums.iter().enumerate() {
                let at = self.position(r, i);
                descent[at] += sum;
                (0..width).for_each(|j| information[at * size + self.position(r, j)] += products[i * width + j]);
            }
        }
        let params = &self.model.definition().params;
        let (mut values, mut lower, mut upper) = (vec![0.0; size], vec![0.0; size], vec![0.0; size]);
        for r in 0..self.runs.len() {
            for (lane, column) in self.columns.iter().enumerate() {
                let (at, param) = (self.position(r, lane), &params[*column]);
                (values[at], lower[at], upper[at]) = (self.thetas[r][*column], param.lower, param.upper);
                if let Some(prior) = param.prior.filter(|_| r == 0 || lane >= self.shared) {
                    let weight = prior.deviation.powi(-2);
                    information[at * size + at] += weight;
                    descent[at] += weight * (prior.mean - values[at]);
                }
            }
        }
        let mut quadratic = Quadratic::default();
        quadratic.set(&information, &descent);
        if !quadratic.is_finite() {
            return None;
        }
        let bounds = StepBounds::at(&values, &lower, &upper, &quadratic.scale);
        let mut step = Vec::new();
        if !constrained(&quadratic, &bounds, DAMPING, &mut step) {
            return None;
        }
        let scaled = step.iter().zip(&quadratic.scale);
        Some(scaled.map(|(s, scale)| if *scale > 0.0 { s / scale } else { 0.0 }).collect())
    }
}

/// Mean squares of each output of all runs together; of what was not measured infinite.
fn mean_squares(residuals: &[Vec<f64>], outputs: usize) -> Vec<f64> {
    let one = |output: usize| {
        let all = residuals.iter().flat_map(|r| r.iter().skip(output).step_by(outputs)).filter(|e| e.is_finite());
        let (sum, count) = all.fold((0.0, 0.0), |(s, n), e| (s + e * e, n + 1.0));
        if count > 0.0 { f64::max(sum / count, f64::MIN_POSITIVE) } else { f64::INFINITY }
    };
    (0..outputs).map(one).collect()
}
