//! A delayed input as a step sees it: stage values with the moments of the true signal.
//!
//! A recorded input has kinks (jumps, with zero-order hold) at its samples, and a delay carries them into the middle of steps,
//! where sampling the input at three points would leave an error of second order and a response that bends whenever a
//! stage crosses a kink. For a linear system the classical Runge-Kutta step sees its input u(s), s in [0, 1], through
//!
//! `(u0 + 4 um + u1)/6 = M0`, `u0/6 + um/3 = M1`, `(u0 + um)/12 = M2`, with `Mk = integral of (1 - s)^k/k! u(s) ds`
//!
//! up to its own order. Three stage values that have the true moments therefore lose nothing to kinks; where there is none they
//! are the signal's values. A collocation method integrates a quadratic exactly: it gets the stage values of the one quadratic that has
//! these moments. Where the model is so fast that it follows its input, a kink inside a step then costs an error of the first order,
//! which halving the steps shows. The moments are smooth in the delay, jumps included, and so is the response: the derivative
//! by the delay is that of the same moments.
//!
//! Where a delay is a whole number of sampling intervals, kinks stand on the ends of steps and on samples. What is seen there at
//! a point bends with the delay, and its derivative is the mean of those on both sides, as a central difference has it: a jump
//! counts by half for the step that it ends, and by half for the one that it begins; a slope at a sample is the mean of its sides.
//!
//! Where samples stand at equal intervals, every step sees the record through the same three weights of three neighbouring samples
//! ([`DelayFilter`]): the window of a step, moved back by the delay, lies in the same place among the samples around it. The weights are
//! found by giving the general rule ([`Follower`]) a record that is 1 at one sample and 0 at the others.

use super::steps::{NODES, Scheme};
use crate::record::{Cursor, Place, Run};

/// Where a method's stages stand in a step, and their values for given moments.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rule {
    nodes: [f64; 3],
    /// Stages by moments.
    weights: [[f64; 3]; 3],
}

impl Rule {
    pub(super) fn of(integrator: Scheme) -> Self {
        match integrator {
            Scheme::RungeKutta | Scheme::ExactDiscretisation { .. } => {
                let weights = [[0.0, -6.0, 24.0], [0.0, 6.0, -12.0], [6.0, -18.0, 24.0]];
                Self { nodes: [0.0, 0.5, 1.0], weights }
            }
            Scheme::Radau => Self { nodes: NODES, weights: NODES.map(quadratic) },
        }
    }

    /// Parts of the step at which the stages stand.
    pub(super) fn nodes(&self) -> [f64; 3] {
        self.nodes
    }

    fn stages(&self, moments: [f64; 3]) -> [f64; 3] {
        self.weights.map(|[a, b, c]| a * moments[0] + b * moments[1] + c * moments[2])
    }
}

/// Weights of the moments for the value at s of the quadratic that has them: in powers of 1 - s its coefficients
/// follow from the inverse of Hilbert's matrix.
fn quadratic(s: f64) -> [f64; 3] {
    let rest = 1.0 - s;
    let sum = |a: f64, b: f64, c: f64| a + rest * (b + rest * c);
    [sum(9.0, -36.0, 30.0), sum(-36.0, 192.0, -180.0), 2.0 * sum(30.0, -180.0, 180.0)]
}

/// Values and slopes at the three stages of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StageValues {
    pub(super) value: [f64; 3],
    pub(super) slope: [f64; 3],
}

/// Follows a delayed input from step to step.
#[derive(Debug, Default)]
pub(super) struct Follower {
    cursor: Cursor,
}

/// Times that differ by less, as a part of the largest, are the same.
pub(super) const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Abscissae of the two-point Gauss rule on [0, 1]: exact for a linear signal times a moment's weight.
const GAUSS: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];

impl Follower {
    /// The input over `from..from + h`, both already delayed.
    pub(super) fn step(&mut self, run: &Run, input: usize, (from, h): (f64, f64), rule: &Rule) -> StageValues {
        let (time, to) = (&run.time, from + h);
        self.cursor.at(time, from);
        let count = self.cursor.count();
        if count == time.len() || time[count] >= to {
            let at = |t: f64| run.input(input, Place::after(time, count, t));
            let [(a, p), (b, q), (c, r)] = rule.nodes.map(|node| at(if node == 1.0 { to } else { from + node * h }));
            let slope = if run.held[input] { self.jumps(run, input, (from, h), rule) } else { [p, q, r] };
            return StageValues { value: [a, b, c], slope };
        }
        let (mut value, mut slope) = ([0.0; 3], [0.0; 3]);
        let (mut k, mut begin) = (count, from);
        let held = run.held[input];
        loop {
            let end = time.get(k).map_or(to, |t| t.min(to));
            for x in GAUSS {
                let t = begin + x * (end - begin);
                let (u, du) = run.input(input, Place::after(time, k, t));
                let weight = 0.5 * (end - begin) / h;
                add(&mut value, (t - from) / h, weight * u);
                add(&mut slope, (t - from) / h, weight * du);
            }
            if end >= to {
                break;
            }
            (k, begin) = (k + 1, end);
        }
        let slope = if held { self.jumps(run, input, (from, h), rule) } else { rule.stages(slope) };
        StageValues { value: rule.stages(value), slope }
    }

    /// The slope of a held input over `from..from + h`: its jumps, each concentrated where it stands, those on either end by half.
    fn jumps(&self, run: &Run, input: usize, (from, h): (f64, f64), rule: &Rule) -> [f64; 3] {
        let (time, to, mut slope) = (&run.time, from + h, [0.0; 3]);
        let farthest = time.last().copied().unwrap_or(0.0).abs().max(from.abs()).max(to.abs());
        let rounding = ROUNDING * farthest;
        // a jump that rounding has put before the beginning stands on it
        let near = |k: &usize| time[*k] >= from - rounding;
        let first = self.cursor.count().checked_sub(1).filter(near).unwrap_or(self.cursor.count());
        let width = run.held.len();
        for k in (first..time.len()).take_while(|k| time[*k] <= to + rounding).filter(|k| *k > 0) {
            let at_an_end = time[k] - from <= rounding || to - time[k] <= rounding;
            let jump = run.inputs[k * width + input] - run.inputs[(k - 1) * width + input];
            let part = if at_an_end { 0.5 } else { 1.0 };
            add(&mut slope, ((time[k] - from) / h).clamp(0.0, 1.0), part * jump / h);
        }
        rule.stages(slope)
    }
}

/// Adds the moments of an amount at s.
#[inline(always)]
pub(super) fn add(moments: &mut [f64; 3], s: f64, amount: f64) {
    let rest = 1.0 - s;
    moments[0] += amount;
    moments[1] += rest * amount;
    moments[2] += 0.5 * rest * rest * amount;
}

/// The stage values that have these moments.
#[inline(always)]
pub(super) fn stages([m0, m1, m2]: [f64; 3]) -> [f64; 3] {
    let middle = 6.0 * m1 - 12.0 * m2;
    let first = 24.0 * m2 - 6.0 * m1;
    [first, middle, 6.0 * m0 - first - 4.0 * middle]
}

/// Neighbouring samples that a step can touch.
pub(super) const TAPS: usize = 3;

/// Weights of neighbouring samples for what a step sees.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Weights {
    /// The first of the samples, from the one at the beginning of the interval.
    pub(super) first: i64,
    /// Stages by samples: values, and slopes.
    pub(super) value: [[f64; TAPS]; 3],
    pub(super) slope: [[f64; TAPS]; 3],
}

/// Finds the weights of delays on one even grid.
#[derive(Debug, Clone)]
pub(super) struct DelayFilter {
    interval: f64,
    /// Steps in every interval.
    pub(super) per: usize,
    samples: usize,
    rule: Rule,
    /// Unit samples as linear inputs, and as held ones, one apart.
    units: Run,
}

impl DelayFilter {
    /// None where the samples are not at equal intervals to rounding.
    pub(super) fn new(time: &[f64], per: usize, rule: Rule) -> Option<Self> {
        let (first, last) = (*time.first()?, *time.last()?);
        let interval = (last - first) / (time.len() - 1) as f64;
        let rounding = 8.0 * f64::EPSILON * first.abs().max(last.abs());
        let even = |(k, t): (usize, &f64)| (first + k as f64 * interval - t).abs() <= rounding;
        let suits = interval > 0.0 && interval.is_finite() && time.iter().enumerate().all(even);
        suits.then(|| Self { interval, per, samples: time.len(), rule, units: units() })
    }

    /// Weights for step j of every interval.
    pub(super) fn step(&self, tau: f64, j: usize, held: bool) -> Weights {
        let (mut first, mut part) = self.window(j as f64 / self.per as f64 - tau / self.interval);
        if held && part == 0.0 {
            // the jump at the beginning is seen from the sample before it
            (first, part) = (first - 1, 1.0);
        }
        let mut weights = Weights { first, ..Weights::default() };
        for tap in 0..TAPS {
            let window = (part, 1.0 / self.per as f64);
            let StageValues { value, slope } =
                Follower::default().step(&self.units, self.unit(tap, held), window, &self.rule);
            for stage in 0..3 {
                weights.value[stage][tap] = value[stage];
                weights.slope[stage][tap] = slope[stage] / self.interval;
            }
        }
        weights
    }

    /// Weights at the samples: the first stage counts.
    pub(super) fn sample(&self, tau: f64, held: bool) -> Weights {
        let (first, part) = self.window(-tau / self.interval);
        if part == 0.0 && !held {
            let mut weights = Weights { first: first - 1, ..Weights::default() };
            weights.value[0] = [0.0, 1.0, 0.0];
            weights.slope[0] = [-0.5, 0.0, 0.5].map(|w| w / self.interval);
            return weights;
        }
        let mut weights = Weights { first, ..Weights::default() };
        for tap in 0..TAPS {
            let (value, slope) = self.units.input(self.unit(tap, held), Place::after(&self.units.time, 1, part));
            (weights.value[0][tap], weights.slope[0][tap]) = (value, slope / self.interval);
        }
        weights
    }

    /// Sample and part of an interval at a distance in intervals; a sample that is missed by rounding is met.
    fn window(&self, distance: f64) -> (i64, f64) {
        let near = distance.round();
        let distance =
            if (distance - near).abs() <= 8.0 * f64::EPSILON * near.abs().max(1.0) { near } else { distance };
        // further back everything is the first sample, further ahead the last
        let farthest = self.samples as f64 + TAPS as f64;
        let distance = distance.clamp(-farthest, farthest);
        let first = distance.floor();
        (first as i64, distance - first)
    }

    fn unit(&self, tap: usize, held: bool) -> usize {
        tap + if held { TAPS } else { 0 }
    }
}

impl Weights {
    /// Value and slope at a stage of what stands in three neighbouring samples.
    #[inline(always)]
    pub(super) fn at(&self, stage: usize, u: [f64; TAPS]) -> (f64, f64) {
        let sum = |w: &[f64; TAPS]| w[0] * u[0] + w[1] * u[1] + w[2] * u[2];
        (sum(&self.value[stage]), sum(&self.slope[stage]))
    }
}

/// A record of three samples one apart; input k, linear, is 1 at sample k, the same held behind them.
fn units() -> Run {
    let inputs = (0..TAPS).flat_map(|sample| (0..2 * TAPS).map(move |unit| f64::from(u8::from(unit % TAPS == sample))));
    Run {
        name: String::new(),
        time: (0..TAPS).map(|k| k as f64).collect(),
        inputs: inputs.collect(),
        measured: Vec::new(),
        held: (0..2 * TAPS).map(|unit| unit >= TAPS).collect(),
        input_gaps: vec![0; 2 * TAPS],
        stated: Vec::new(),
        output_gaps: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Model;
    use crate::simulate::{Scheme, Simulator};

    fn run(held: bool) -> Run {
        let (time, inputs) = (vec![0.0, 1.0, 2.5, 3.0], vec![1.0, 3.0, -1.0, 2.0]);
        let (held, measured) = (vec![held], Vec::new());
        Run {
            name: "r".into(),
            time,
            inputs,
            held,
            measured,
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: Vec::new(),
        }
    }

    const RULES: [Scheme; 2] = [Scheme::RungeKutta, Scheme::Radau];

    #[test]
    fn without_kinks_the_stages_are_the_values() {
        for rule in RULES.map(Rule::of) {
            let got = Follower::default().step(&run(false), 0, (0.2, 0.5), &rule);
            let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-14);
            assert!(near(got.value, rule.nodes.map(|s| 1.4 + s)) && near(got.slope, [2.0; 3]), "{got:?}");
            // the same from the moments of the same signal
            let mut moments = [0.0; 3];
            GAUSS.iter().for_each(|s| add(&mut moments, *s, 0.5 * (1.4 + s)));
            assert!(near(rule.stages(moments), got.value), "{moments:?}");
        }
    }

    #[test]
    fn moments_are_those_of_the_signal() {
        for held in [false, true] {
            let (run, from, h) = (run(held), -0.4, 3.7);
            let StageValues { value: [a, b, c], .. } =
                Follower::default().step(&run, 0, (from, h), &Rule::of(Scheme::RungeKutta));
            let (n, mut moments) = (200_000, [0.0; 3]);
            for k in 0..n {
                let s = (f64::from(k) + 0.5) / f64::from(n);
                add(&mut moments, s, run.input_at(0, from + s * h).0 / f64::from(n));
            }
            let got = [(a + 4.0 * b + c) / 6.0, a / 6.0 + b / 3.0, (a + b) / 12.0];
            for (got, want) in got.iter().zip(moments) {
                assert!((got - want).abs() < 2e-5, "{held}: {got} {want}");
            }
        }
    }

    #[test]
    fn slopes_are_derivatives_by_the_shift_also_across_jumps() {
        for (held, rule) in [false, true].into_iter().flat_map(|held| RULES.map(|r| (held, Rule::of(r)))) {
            let (run, from, h, step) = (run(held), 0.7, 2.1, 1e-5);
            let at = |from: f64| Follower::default().step(&run, 0, (from, h), &rule);
            let (low, high, middle) = (at(from - step), at(from + step), at(from));
            for k in 0..3 {
                let difference = (high.value[k] - low.value[k]) / (2.0 * step);
                assert!((difference - middle.slope[k]).abs() < 1e-6, "{held} {k}: {difference} {}", middle.slope[k]);
            }
        }
    }

    /// Jumps on the ends of a step count by half for it, so that all steps together see each of them once.
    #[test]
    fn slopes_at_whole_intervals_are_means_of_both_sides() {
        let mut run = run(true);
        run.time = vec![0.0, 0.1, 0.2, 0.3];
        for rule in RULES.map(Rule::of) {
            for k in 1..3 {
                let (from, h, step) = (0.1 * f64::from(k), 0.1, 1e-7);
                let at = |from: f64| Follower::default().step(&run, 0, (from, h), &rule);
                let (low, high, middle) = (at(from - step), at(from + step), at(from));
                for stage in 0..3 {
                    let mean = 0.5 * (low.slope[stage] + high.slope[stage]);
                    let got = middle.slope[stage];
                    assert!((got - mean).abs() < 1e-3 * mean.abs().max(1.0), "{k} {stage}: {got} {mean}");
                }
            }
        }
    }

    /// The general rule at a step, however it lies.
    fn general(run: &Run, (from, h): (f64, f64), rule: &Rule) -> StageValues {
        Follower::default().step(run, 0, (from, h), rule)
    }

    #[test]
    fn weights_give_what_the_general_rule_gives() {
        let n = 12;
        let values: Vec<f64> = (0..n).map(|k| f64::from(k * k % 7) - 2.0).collect();
        for (held, scheme, per) in [false, true].into_iter().flat_map(|held| {
            [Scheme::RungeKutta, Scheme::Radau].into_iter().flat_map(move |s| [1, 3].map(|per| (held, s, per)))
        }) {
            let time: Vec<f64> = (0..n).map(|k| 1.5 + 0.25 * f64::from(k)).collect();
            let run = Run {
                name: "r".into(),
                inputs: values.clone(),
                held: vec![held],
                measured: Vec::new(),
                input_gaps: vec![0],
                stated: Vec::new(),
                output_gaps: Vec::new(),
                time: time.clone(),
            };
            let rule = Rule::of(scheme);
            let filter = DelayFilter::new(&time, per, rule).expect("even");
            for tau in [0.03, 0.31, 0.7, 2.74, 50.0, 0.0, 0.25, 1.0] {
                for (k, begin) in time.iter().enumerate().take(n as usize - 1) {
                    let at = |i: i64| values[i.clamp(0, i64::from(n) - 1) as usize];
                    let seen = |w: &Weights| [0, 1, 2].map(|tap| at(k as i64 + w.first + tap));
                    for j in 0..per {
                        let (h, w) = (0.25 / per as f64, filter.step(tau, j, held));
                        let want = general(&run, (begin + j as f64 * h - tau, h), &rule);
                        for stage in 0..3 {
                            let (value, slope) = w.at(stage, seen(&w));
                            assert!((value - want.value[stage]).abs() < 1e-12, "{held} {tau} {k} {j} {stage}");
                            assert!((slope - want.slope[stage]).abs() < 1e-10, "{held} {tau} {k} {j} {stage}");
                        }
                    }
                    let w = filter.sample(tau, held);
                    let (value, slope) = w.at(0, seen(&w));
                    let side = |step: f64| run.input_at(0, time[k] - tau + step).1;
                    // on a sample the mean of both sides
                    let want = (run.input_at(0, time[k] - tau).0, 0.5 * (side(-1e-9) + side(1e-9)));
                    assert!((value - want.0).abs() < 1e-12 && (slope - want.1).abs() < 1e-10, "{held} {tau} {k}");
                }
            }
        }
    }

    /// Derivative of all outputs by a delay at this value, and the central difference over a hundredth of the interval.
    fn by_delay(text: &str, (held, uneven): (bool, f64), tau: f64) -> (Vec<f64>, Vec<f64>) {
        let model = Model::from_text("m.fdm", text).expect("a model");
        let dt = 0.1;
        let time: Vec<f64> = (0..60).map(|k| dt * (f64::from(k) + if k == 59 { uneven } else { 0.0 })).collect();
        let inputs = (0..60).map(|k| [0.0, 1.0, -0.5, 2.0, 0.3][k / 7 % 5]).collect();
        let (measured, input_gaps, output_gaps) = (vec![0.0; 60], vec![0], vec![0]);
        let run = Run {
            name: "r".into(),
            inputs,
            held: vec![held],
            measured,
            input_gaps,
            stated: Vec::new(),
            output_gaps,
            time,
        };
        let mut simulator = Simulator::new(model.dynamics(), &run, 1).expect("suited");
        let place = model.definition().params.iter().position(|p| p.quantity.name == "tau").expect("a delay");
        let mut theta = model.definition().start();
        let mut at = |tau: f64| {
            theta[place] = tau;
            let (mut y, mut rows) = (vec![0.0; 60], vec![0.0; 60 * 8]);
            simulator.sensitivities(&theta, &[place], &mut y, &mut rows).expect("finite");
            (y, rows.iter().step_by(8).copied().collect::<Vec<f64>>())
        };
        let step = 0.01 * dt;
        let (low, high) = (at(tau - step).0, at(tau + step).0);
        (at(tau).1, high.iter().zip(&low).map(|(h, l)| (h - l) / (2.0 * step)).collect())
    }

    #[test]
    fn the_derivative_by_a_delay_of_whole_intervals_is_that_of_both_sides() {
        let gain = "model m { input u; param tau = 0.5 in [0, 2]; output y = 2*delay(u, tau); }";
        let lag = "model m { input u; state x = 0; param tau = 0.5 in [0, 2]; der(x) = 3*(delay(u, tau) - x); output y = x; }";
        let bent = "model m { input u; state x = 0; param tau = 0.5 in [0, 2]; \
                    der(x) = 3*(delay(u, tau) - x) - x^3; output y = x; }";
        for (text, held) in [(gain, false), (lag, false), (bent, false), (lag, true), (bent, true)] {
            for uneven in [0.0, 0.3] {
                for tau in [0.5, 0.5 * (1.0 + 1e-6), 0.53] {
                    let (got, want) = by_delay(text, (held, uneven), tau);
                    let size = want.iter().fold(0.0_f64, |s, w| s.max(w.abs()));
                    let off = got.iter().zip(&want).map(|(g, w)| (g - w).abs()).fold(0.0, f64::max);
                    // just beside a kink the difference is taken across it
                    let allowed = if tau == 0.5 || tau == 0.53 { 0.02 * size } else { f64::INFINITY };
                    assert!(size > 0.1 && off <= allowed, "{text} {held} {uneven} {tau}: {off} of {size}");
                    assert!(got.iter().any(|g| g.abs() > 0.1), "{text} {held} {tau}");
                }
            }
        }
    }

    #[test]
    fn uneven_samples_have_no_common_weights() {
        let rule = Rule::of(Scheme::RungeKutta);
        assert!(DelayFilter::new(&[0.0, 1.0, 2.1], 1, rule).is_none());
        assert!(DelayFilter::new(&[0.0], 1, rule).is_none() && DelayFilter::new(&[], 1, rule).is_none());
    }
}
