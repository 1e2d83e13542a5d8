//! One run through the extended Kalman filter: the likelihood of its innovations, with the exact gradient and information by all
//! unknowns in the same pass.
//!
//! Between samples states and covariance are integrated together by classical Runge-Kutta steps, `x' = f`, `P' = A P + P A' + Q`, and their
//! derivatives by the same steps, so that the gradient is that of the discrete filter. At a sample measured outputs are taken one
//! after the other about the prediction, which is the update by all of them at once (Maine and Iliff 1985, Jategaonkar 2015, ch. 5).

use super::jacobians::{Programs, Totals, add};
use fdm_grammar::derive::Pattern;
use fdm_system::record::Run;
use fdm_system::simulate::{Course, Divergence, Steps, Unsuited};

/// What one run says about the unknowns.
#[derive(Debug, Clone, Default)]
pub(super) struct Score {
    /// Minus the logarithm of the likelihood, without its constant.
    pub(super) cost: f64,
    /// Its derivatives (lanes).
    pub(super) gradient: Vec<f64>,
    /// Their expected covariance (lanes by lanes): `sum v_i v_j / S + S_i S_j / (2 S^2)`.
    pub(super) information: Vec<f64>,
}

/// States, covariance and their derivatives, one row behind the other, as the integrator moves them.
#[derive(Debug, Clone, Copy)]
struct Shape {
    n: usize,
    lanes: usize,
}

impl Shape {
    /// x, P, derivatives of x (n by lanes), of P (n by n by lanes).
    fn split(self, all: &[f64]) -> [&[f64]; 4] {
        let (x, rest) = all.split_at(self.n);
        let (p, rest) = rest.split_at(self.n * self.n);
        let (s, ps) = rest.split_at(self.n * self.lanes);
        [x, p, s, ps]
    }

    fn split_mut(self, all: &mut [f64]) -> [&mut [f64]; 4] {
        let (x, rest) = all.split_at_mut(self.n);
        let (p, rest) = rest.split_at_mut(self.n * self.n);
        let (s, ps) = rest.split_at_mut(self.n * self.lanes);
        [x, p, s, ps]
    }

    fn len(self) -> usize {
        (self.n + self.n * self.n) * (1 + self.lanes)
    }
}

/// The filter of one run, with all its memory.
pub(super) struct Kalman<'a> {
    course: Course<'a>,
    programs: &'a Programs,
    flow: Totals<'a>,
    sight: Totals<'a>,
    shape: Shape,
    /// The lane of each output's deviation, if that is unknown (q).
    noise: Vec<Option<usize>>,
    theta: Vec<f64>,
    /// The state of the integration, its four slopes, and where they are taken.
    now: Vec<f64>,
    slopes: Vec<f64>,
    stage: Vec<f64>,
    /// A P and its derivatives.
    product: Vec<f64>,
    /// States and derivatives before an update.
    before: Vec<f64>,
    /// P c' and its derivatives, and those of the innovation, its variance and the gain.
    column: Vec<f64>,
    columns: Vec<f64>,
    innovation: Vec<f64>,
    variance: Vec<f64>,
    /// One-step predictions of the outputs (N by q) of the last pass.
    pub(super) predicted: Vec<f64>,
    pub(super) score: Score,
}

impl<'a> Kalman<'a> {
    /// `columns` are the unknowns of the lanes: parameters, and behind the model's own ones the deviations of outputs, whose lanes `noise`
    /// names.
    ///
    /// # Errors
    /// [`Unsuited`] for a run of another model.
    pub(super) fn new(
        programs: &'a Programs,
        run: &'a Run,
        steps: &Steps,
        columns: &[usize],
        noise: Vec<Option<usize>>,
    ) -> Result<Self, Unsuited> {
        let lanes = columns.len();
        let (flow, sight) = (programs.flow.dynamics(), programs.sight.dynamics());
        let (flow, sight) = (Totals::new(flow, columns, lanes), Totals::new(sight, columns, lanes));
        let n = programs.flow.layout().states;
        let shape = Shape { n, lanes };
        Ok(Self {
            course: Course::new(programs.sight.layout(), run, steps)?,
            programs,
            flow,
            sight,
            shape,
            theta: Vec::with_capacity(programs.flow.layout().params),
            now: vec![0.0; shape.len()],
            slopes: vec![0.0; 4 * shape.len()],
            stage: vec![0.0; shape.len()],
            product: vec![0.0; n * n * (1 + lanes)],
            before: vec![0.0; n * (1 + lanes)],
            column: vec![0.0; n],
            columns: vec![0.0; n * lanes],
            innovation: vec![0.0; lanes],
            variance: vec![0.0; lanes],
            predicted: vec![f64::NAN; run.len() * noise.len()],
            score: Score { cost: 0.0, gradient: vec![0.0; lanes], information: vec![0.0; lanes * lanes] },
            noise,
        })
    }

    /// The whole run at the parameters theta (p) and the deviations of the measurement noise (q); gradient and information too where
    /// these are wanted. Nothing is allocated.
    ///
    /// # Errors
    /// [`Divergence`] where a number is not finite, or the variance of an innovation not above 0.
    pub(super) fn run(&mut self, theta: &[f64], deviations: &[f64], wanted: bool) -> Result<(), Divergence> {
        let shape = Shape { lanes: if wanted { self.shape.lanes } else { 0 }, ..self.shape };
        self.begin(theta, shape)?;
        for node in 0..=self.course.steps() {
            if let Some(sample) = self.course.sample_at(node) {
                self.update(sample, deviations, shape)?;
            }
            if node < self.course.steps() {
                self.advance(node, shape)?;
            }
        }
        let l = shape.lanes;
        for i in 0..l {
            for j in 0..i {
                self.score.information[i * l + j] = self.score.information[j * l + i];
            }
        }
        Ok(())
    }

    fn begin(&mut self, theta: &[f64], shape: Shape) -> Result<(), Divergence> {
        let run = self.course.run();
        self.theta.clear();
        self.theta.extend_from_slice(theta);
        for (param, input) in &self.flow.layout().first {
            self.theta[*param as usize] = run.inputs.get(*input as usize).copied().unwrap_or(f64::NAN);
        }
        self.flow.prepare(&self.theta);
        self.sight.prepare(&self.theta);
        let failed = Divergence { time: 0.0, state: None, sample: 0, event: None };
        if self.flow.delays().iter().any(|tau| !tau.is_finite()) {
            return Err(failed);
        }
        self.course.delay(self.flow.delays());
        self.score.cost = 0.0;
        self.score.gradient.fill(0.0);
        self.score.information.fill(0.0);
        let [x, p, s, ps] = shape.split_mut(&mut self.now[..shape.len()]);
        self.flow.begin(x, s);
        p.fill(0.0);
        ps.fill(0.0);
        if x.iter().all(|x| x.is_finite()) { Ok(()) } else { Err(failed) }
    }

    /// One Runge-Kutta step of everything.
    fn advance(&mut self, step: usize, shape: Shape) -> Result<(), Divergence> {
        let ((t, h), size) = (self.course.step(step), shape.len());
        for (k, (row, reach)) in [(0, 0.0), (1, 0.5), (1, 0.5), (2, 1.0)].into_iter().enumerate() {
            self.stage[..size].copy_from_slice(&self.now[..size]);
            if k > 0 {
                add(reach * h, &self.slopes[(k - 1) * size..k * size], &mut self.stage[..size]);
            }
            self.slope(t + reach * h, (step, row), k, shape);
        }
        for (k, part) in [(0, 1.0), (1, 2.0), (2, 2.0), (3, 1.0)] {
            add(part * h / 6.0, &self.slopes[k * size..(k + 1) * size], &mut self.now[..size]);
        }
        let [x, p, ..] = shape.split(&self.now[..size]);
        if x.iter().chain(p).all(|v| v.is_finite()) {
            return Ok(());
        }
        let state = x.iter().position(|v| !v.is_finite());
        let sample = (0..=step).rev().find_map(|k| self.course.sample_at(k)).unwrap_or(0);
        Err(Divergence { time: t + h, state, sample, event: None })
    }

    /// The slope of everything at the stage of a step.
    fn slope(&mut self, t: f64, (step, row): (usize, usize), k: usize, shape: Shape) {
        let Self { course, programs, flow, stage, slopes, product, .. } = self;
        let (n, l, size) = (shape.n, shape.lanes, shape.len());
        let [x, p, s, ps] = shape.split(&stage[..size]);
        let [dx, dp, ds, dps] = shape.split_mut(&mut slopes[k * size..(k + 1) * size]);
        let (drive, delayed) = course.stage(step, row);
        let (values, rows): (&[f64], &[f64]) = match l {
            0 => (flow.values(t, x, drive), &[]),
            _ => flow.linearise(t, (x, s), (drive, delayed)),
        };
        dx.copy_from_slice(&values[..n]);
        ds.copy_from_slice(&rows[..n * l]);
        let (entries, intensities) = values[n..].split_at(programs.transition.len());
        let (entry_rows, intensity_rows) = rows[n * l..].split_at(programs.transition.len() * l);
        let (ap, aps) = product[..n * n * (1 + l)].split_at_mut(n * n);
        ap.fill(0.0);
        aps.fill(0.0);
        for (e, i, j) in programs.transition.entries() {
            let a = entries[e];
            add(a, &p[j * n..][..n], &mut ap[i * n..][..n]);
            if l > 0 {
                add(a, &ps[j * n * l..][..n * l], &mut aps[i * n * l..][..n * l]);
                for k in 0..n {
                    add(p[j * n + k], &entry_rows[e * l..][..l], &mut aps[(i * n + k) * l..][..l]);
                }
            }
        }
        for i in 0..n {
            for k in 0..n {
                dp[i * n + k] = ap[i * n + k] + ap[k * n + i];
                let (one, other) = (&aps[(i * n + k) * l..][..l], &aps[(k * n + i) * l..][..l]);
                let sum = &mut dps[(i * n + k) * l..][..l];
                sum.iter_mut().zip(one.iter().zip(other)).for_each(|(d, (a, b))| *d = a + b);
            }
        }
        for (k, state) in programs.noisy.iter().enumerate() {
            let (q, at) = (intensities[k], state * n + state);
            dp[at] += q * q;
            if l > 0 {
                add(2.0 * q, &intensity_rows[k * l..][..l], &mut dps[at * l..][..l]);
            }
        }
    }

    /// Takes what was measured at a sample, one output after the other.
    fn update(&mut self, sample: usize, deviations: &[f64], shape: Shape) -> Result<(), Divergence> {
        let Self { course, programs, sight, now, before, predicted, .. } = self;
        let run = course.run();
        let (n, l, q, t) = (shape.n, shape.lanes, deviations.len(), run.time[sample]);
        let [x, _, s, _] = shape.split(&now[..shape.len()]);
        let (drive, slopes) = course.sample(sample);
        let (values, rows): (&[f64], &[f64]) = match l {
            0 => (sight.values(t, x, drive), &[]),
            _ => sight.linearise(t, (x, s), (drive, slopes)),
        };
        before[..n].copy_from_slice(x);
        before[n..n * (1 + l)].copy_from_slice(s);
        let predicted = &mut predicted[sample * q..][..q];
        predicted.copy_from_slice(&values[..q]);
        run.turn(&programs.sight.layout().wraps, sample, predicted);
        let measured = &run.measured[sample * q..][..q];
        for (o, z) in measured.iter().enumerate().filter(|(_, z)| !z.is_nan()) {
            let output = Output {
                shape,
                entries: (&programs.observation, o),
                values: &values[q..],
                rows: &rows[(q * l).min(rows.len())..],
                offset: z - predicted[o],
                offsets: &rows[(o * l).min(rows.len())..],
                deviation: deviations[o],
                lane: self.noise[o].filter(|_| l > 0),
            };
            let room = Room {
                now: &mut now[..shape.len()],
                before,
                column: &mut self.column,
                columns: &mut self.columns,
                innovation: &mut self.innovation[..l],
                variance: &mut self.variance[..l],
            };
            if !output.take(room, &mut self.score) {
                return Err(Divergence { time: t, state: None, sample, event: None });
            }
        }
        Ok(())
    }
}

/// One measured output at a sample.
struct Output<'r> {
    shape: Shape,
    /// The pattern of h_x, and the row of this output.
    entries: (&'r Pattern, usize),
    values: &'r [f64],
    rows: &'r [f64],
    /// Measured minus predicted, and the derivatives of the prediction.
    offset: f64,
    offsets: &'r [f64],
    deviation: f64,
    lane: Option<usize>,
}

/// What an update changes and works in.
struct Room<'r> {
    now: &'r mut [f64],
    before: &'r [f64],
    column: &'r mut [f64],
    columns: &'r mut [f64],
    innovation: &'r mut [f64],
    variance: &'r mut [f64],
}

impl Output<'_> {
    /// The update; false when the variance of the innovation is not a number above 0.
    fn take(&self, room: Room<'_>, score: &mut Score) -> bool {
        let (n, l) = (self.shape.n, self.shape.lanes);
        let Room { now, before, column, columns, innovation, variance } = room;
        let [x, p, s, ps] = self.shape.split_mut(now);
        let columns = &mut columns[..n * l];
        // P c'
        column.fill(0.0);
        columns.fill(0.0);
        let (mut v, mut big) = (self.offset, self.deviation * self.deviation);
        innovation.iter_mut().zip(self.offsets).for_each(|(v, h)| *v = -h);
        variance.fill(0.0);
        if let Some(lane) = self.lane {
            variance[lane] = 2.0 * self.deviation;
        }
        for (e, j) in self.entries.0.row(self.entries.1) {
            let (c, moved) = (self.values[e], x[j] - before[j]);
            v -= c * moved;
            add(c, &p[j * n..][..n], column);
            if l > 0 {
                let by = &self.rows[e * l..][..l];
                add(c, &ps[j * n * l..][..n * l], columns);
                (0..n).for_each(|k| add(p[j * n + k], by, &mut columns[k * l..][..l]));
                add(-moved, by, innovation);
                add(-c, &s[j * l..][..l], innovation);
                add(c, &before[n + j * l..][..l], innovation);
            }
        }
        for (e, j) in self.entries.0.row(self.entries.1) {
            big += self.values[e] * column[j];
            if l > 0 {
                add(self.values[e], &columns[j * l..][..l], variance);
                add(column[j], &self.rows[e * l..][..l], variance);
            }
        }
        if !(big > 0.0 && big.is_finite() && v.is_finite()) {
            return false;
        }
        score.cost += 0.5 * (v * v / big + big.ln());
        for i in 0..l {
            score.gradient[i] += v * innovation[i] / big + 0.5 * variance[i] * (1.0 - v * v / big) / big;
            let (a, b) = (innovation[i] / big, 0.5 * variance[i] / (big * big));
            let row = &mut score.information[i * l..][..l];
            for j in i..l {
                row[j] += a * innovation[j] + b * variance[j];
            }
        }
        // x + K v, P - K S K' with K = P c'/S
        for k in 0..n {
            let gain = column[k] / big;
            x[k] += gain * v;
            for i in 0..l {
                let slope = (columns[k * l + i] - gain * variance[i]) / big;
                s[k * l + i] += slope * v + gain * innovation[i];
            }
            for m in 0..n {
                p[k * n + m] -= gain * column[m];
                let to = &mut ps[(k * n + m) * l..][..l];
                for i in 0..l {
                    let both = columns[k * l + i] * column[m] + column[k] * columns[m * l + i];
                    to[i] -= (both - gain * column[m] * variance[i]) / big;
                }
            }
        }
        true
    }
}
