//! The response of one run at its frequencies: programs kept for the choices of columns ([`Plans`]), run block by block.

use super::dense::Dense;
use super::elimination::units_of;
use super::end_points::{DelayedInput, EndColumn, EndTerms, Ends};
use super::plan::plan;
use super::program::{BLOCK, DATA, Execution, FLAGS, PLANE, Program};
use super::wiring::Leaves;
use super::wiring::Wiring;
use crate::linear::{Structure, Values};
use crate::simulate::{Block, PlaneSink, Planes, Sink};
use crate::spectrum::Spectrum;
use fdm_grammar::graph::Signal;
use num_complex::Complex64;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Programs that runs of one model share: each is made once.
#[derive(Debug, Default)]
pub struct Plans(Mutex<Vec<Arc<Prepared>>>);

/// A wiring and its program; none when the equations are too full for one.
#[derive(Debug)]
pub(super) struct Prepared {
    pub(super) wiring: Wiring,
    pub(super) program: Option<Program>,
    /// Which of the given numbers count as 1 or -1.
    units: Vec<Option<i8>>,
}

impl Plans {
    /// What was prepared for the same question, else what is prepared now.
    fn prepared(&self, wiring: Wiring, units: &[Option<i8>]) -> Arc<Prepared> {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let same = |p: &&Arc<Prepared>| {
            let (a, b) = (&p.wiring, &wiring);
            p.units == units
                && a.asked == b.asked
                && a.known_ends == b.known_ends
                && a.unknown_ends == b.unknown_ends
                && (a.ended, a.sampled) == (b.ended, b.sampled)
                && (Arc::ptr_eq(&a.structure, &b.structure) || a.structure == b.structure)
        };
        if let Some(prepared) = known.iter().find(same) {
            return prepared.clone();
        }
        let program = plan(&wiring, units);
        let prepared = Arc::new(Prepared { wiring, program, units: units.to_vec() });
        known.push(prepared.clone());
        prepared
    }
}

/// A run's inputs and end terms, and the memory for the model's response to them.
///
/// Parameters are the model's p, then those of [`FrequencyResponse::end_columns`].
pub struct FrequencyResponse {
    run: String,
    structure: Arc<Structure>,
    plans: Arc<Plans>,
    omega: Vec<f64>,
    /// Distance of the frequencies where they are even.
    spacing: Option<f64>,
    /// Inputs, then these as outputs see them where that differs (by M).
    inputs: Vec<Complex64>,
    sampled: bool,
    /// Delayed inputs with what the delay brings into the record, for each delayed signal; none where that is left out.
    delayed: Vec<Option<DelayedInput>>,
    ends: Ends,
    /// One for each selection of columns that was asked for lately.
    ready: Vec<Ready>,
    leaves: Option<Leaves>,
    /// Terms, slopes, derivatives of delays, end values.
    given: Vec<f64>,
    /// Which of these count as 1 or -1, so that multiplications by them are left out.
    units: Vec<Option<i8>>,
    scalars: Vec<f64>,
    /// Outputs and rows of a block, for those who want rows.
    rows: (Vec<f64>, Vec<f64>),
}

impl FrequencyResponse {
    /// Prepares the response to the inputs of a spectrum; `values` are any of the model, for coefficients that no parameter
    /// moves. Responses that are given the same `plans` share their programs.
    ///
    /// # Errors
    /// A spectrum that does not belong to the model, frequencies that are not above zero and rising, inputs that are not finite.
    pub fn new(
        structure: &Arc<Structure>,
        values: &Values,
        spectrum: &Spectrum,
        ends: &EndTerms,
        plans: &Arc<Plans>,
    ) -> Result<Self, FrequencyError> {
        checked(structure, values, spectrum, ends)?;
        let ends = Ends::new(structure, values, spectrum, ends);
        let units = units(structure, values, &ends);
        let before = structure.states + structure.inputs;
        let shown = |d: usize| {
            structure.terms.iter().any(|t| t.row as usize >= structure.states && t.signal as usize == before + d)
        };
        let delayed = structure.delayed.iter().enumerate().map(|(d, signal)| match signal {
            Signal::Input(j) if ends.delayed => Some(DelayedInput::new(spectrum, *j as usize, shown(d))),
            _ => None,
        });
        Ok(Self {
            run: spectrum.name.clone(),
            structure: structure.clone(),
            plans: plans.clone(),
            omega: spectrum.omega.clone(),
            spacing: spacing(&spectrum.omega),
            inputs: [&spectrum.inputs[..], &spectrum.sampled_inputs].concat(),
            sampled: !spectrum.sampled_inputs.is_empty(),
            delayed: delayed.collect(),
            ends,
            units,
            ready: Vec::new(),
            leaves: None,
            given: Vec::new(),
            scalars: Vec::new(),
            rows: Default::default(),
        })
    }

    /// Number of frequencies M.
    pub fn frequencies(&self) -> usize {
        self.omega.len()
    }

    /// Number of outputs q.
    pub fn outputs(&self) -> usize {
        self.structure.outputs
    }

    /// The unknown end values of this run: columns behind those of the model's parameters.
    pub fn end_columns(&self) -> &[EndColumn] {
        &self.ends.unknown
    }

    /// Outputs at `values` and the unknown end values `ends`: samples by q, real and imaginary part of each frequency one
    /// after the other.
    ///
    /// # Errors
    /// [`FrequencyError`]; `y` is then of no use.
    pub fn simulate(&mut self, values: &Values, ends: &[f64], y: &mut [f64]) -> Result<(), FrequencyError> {
        self.planes(values, ends, &[], &mut |planes| planes.copy_outputs(y))
    }

    /// Outputs and their derivatives by the `columns` (below p parameters, then end values), in blocks of rows.
    ///
    /// # Errors
    /// As [`FrequencyResponse::simulate`]; blocks before the failure have been handed over.
    pub fn sensitivities(
        &mut self,
        values: &Values,
        ends: &[f64],
        columns: &[usize],
        sink: &mut Sink<'_>,
    ) -> Result<(), FrequencyError> {
        let (mut y, mut rows) = std::mem::take(&mut self.rows);
        let result = self.planes(values, ends, columns, &mut |planes| {
            let samples = 2 * planes.count;
            y.resize(samples * planes.layout.outputs.len(), 0.0);
            rows.resize(samples * planes.layout.length, 0.0);
            planes.copy_to(&mut y, &mut rows);
            sink(Block { first: 2 * planes.first, y: &y, rows: &mut rows, layout: planes.layout });
        });
        self.rows = (y, rows);
        result
    }

    /// Hands over the response in planes: real and imaginary parts of consecutive frequencies.
    ///
    /// # Errors
    /// As [`FrequencyResponse::simulate`].
    pub fn planes(
        &mut self,
        values: &Values,
        ends: &[f64],
        columns: &[usize],
        sink: &mut PlaneSink<'_>,
    ) -> Result<(), FrequencyError> {
        self.take(values, ends)?;
        let at = self.ready(columns);
        let Self { run, omega, spacing, given, scalars, ready, leaves, delayed, .. } = self;
        let (ready, Some(leaves)) = (&mut ready[at], leaves) else { return Ok(()) };
        ready.prepare(values);
        leaves.delay(&ready.prepared.wiring, &values.tau, (omega, *spacing), delayed);
        if let Some(program) = &ready.prepared.program {
            program.scalars.evaluate(given, scalars);
        }
        for (block, omega) in omega.chunks(BLOCK).enumerate() {
            let singular = ready.solve(leaves, (block, omega), values, (ends, scalars)).err();
            if let Some(k) = singular {
                return Err(FrequencyError::Singular {
                    run: run.clone(),
                    frequency: block * BLOCK + k,
                    omega: omega[k],
                });
            }
            sink(ready.planes(leaves, block * BLOCK, omega.len()));
        }
        Ok(())
    }

    /// Takes what the model gives and sees that all of it is finite.
    fn take(&mut self, values: &Values, ends: &[f64]) -> Result<(), FrequencyError> {
        let s = &self.structure;
        let shape = |what, found: usize, wanted: usize| match found == wanted {
            true => Ok(()),
            false => Err(FrequencyError::Shape { run: self.run.clone(), what, found, wanted }),
        };
        shape("coefficients", values.terms.len(), s.terms.len())?;
        shape("derivatives of coefficients", values.slopes.len(), s.slopes.len())?;
        shape("delays", values.tau.len(), s.delayed.len())?;
        shape("derivatives of delays", values.tau_slopes.len(), s.tau_slopes.len())?;
        shape("unknown end values", ends.len(), self.ends.unknown.len())?;
        let bad = |numbers: &[f64]| numbers.iter().position(|v| !v.is_finite());
        let place = |k: usize| (s.terms[k].row as usize, s.terms[k].signal as usize);
        if let Some((row, signal)) = bad(&values.terms).map(place) {
            return Err(FrequencyError::Coefficient { row, signal });
        }
        if let Some(slope) = bad(&values.slopes).map(|k| s.slopes[k]) {
            let (row, signal) = place(slope.term as usize);
            return Err(FrequencyError::Slope { row, signal, param: slope.param as usize });
        }
        let slope = bad(&values.tau_slopes).map(|k| s.tau_slopes[k].delayed as usize);
        if let Some(delayed) = bad(&values.tau).or(slope) {
            return Err(FrequencyError::Delay { delayed });
        }
        if let Some(k) = bad(ends) {
            return Err(FrequencyError::End { state: self.ends.unknown[k].state });
        }
        self.given.clear();
        [&values.terms[..], &values.slopes, &values.tau_slopes, ends].iter().for_each(|v| self.given.extend(*v));
        Ok(())
    }

    /// Program and memory for a selection of columns.
    fn ready(&mut self, columns: &[usize]) -> usize {
        let holds = |(unit, value): (&Option<i8>, &f64)| unit.is_none_or(|u| f64::from(u) == *value);
        if !self.units.iter().zip(&self.given).all(holds) {
            // a number that was 1 no longer is: nothing is taken for granted from now on
            self.units.fill(None);
            self.ready.clear();
        }
        if let Some(at) = self.ready.iter().position(|r| r.prepared.wiring.asked == columns) {
            return at;
        }
        let wiring = Wiring::new(&self.structure, &self.ends, self.sampled, columns);
        let prepared = self.plans.prepared(wiring, &self.units);
        // selections of columns for which memory is kept
        if self.ready.len() == 4 {
            self.ready.remove(0);
        }
        let Self { omega, inputs, ends, leaves, .. } = self;
        let leaves = leaves.get_or_insert_with(|| Leaves::new(&prepared.wiring, omega, inputs, ends));
        self.ready.push(Ready::new(prepared, leaves));
        self.ready.len() - 1
    }
}

/// Numbers that are 1 or -1 and, as far as can be seen, stay so: outputs depend only on coefficients that no parameter
/// moves being among them.
fn units(structure: &Structure, values: &Values, ends: &Ends) -> Vec<Option<i8>> {
    let mut units = units_of(&values.terms);
    structure.slopes.iter().for_each(|slope| units[slope.term as usize] = None);
    units.extend(units_of(&values.slopes));
    units.extend(units_of(&values.tau_slopes));
    units.resize(units.len() + ends.unknown.len(), None);
    units
}

/// Whether the spectrum suits the model.
fn checked(structure: &Structure, values: &Values, spectrum: &Spectrum, ends: &EndTerms) -> Result<(), FrequencyError> {
    let (m, count) = (structure.inputs, spectrum.omega.len());
    let shape = |what, found, wanted| FrequencyError::Shape { run: spectrum.name.clone(), what, found, wanted };
    if values.terms.len() != structure.terms.len() {
        return Err(shape("coefficients", values.terms.len(), structure.terms.len()));
    }
    if spectrum.inputs.len() != m * count {
        return Err(shape("inputs", spectrum.inputs.len(), m * count));
    }
    let sampled = &spectrum.sampled_inputs;
    if !sampled.is_empty() && sampled.len() != m * count {
        return Err(shape("inputs as outputs see them", sampled.len(), m * count));
    }
    let samples = m * (spectrum.samples + 1);
    if !spectrum.input_samples.is_empty()
        && (spectrum.input_samples.len(), spectrum.input_ends[0].len()) != (samples, m)
    {
        return Err(shape("samples of the inputs", spectrum.input_samples.len(), samples));
    }
    let mut last = 0.0;
    for (frequency, omega) in spectrum.omega.iter().copied().enumerate() {
        if !(omega.is_finite() && omega > last) {
            return Err(FrequencyError::Frequency { run: spectrum.name.clone(), frequency, omega });
        }
        last = omega;
    }
    let finite = |u: &Complex64| u.re.is_finite() && u.im.is_finite();
    if let Some(k) = spectrum.inputs.iter().chain(sampled).position(|u| !finite(u)) {
        let (run, omega) = (spectrum.name.clone(), spectrum.omega[k % count]);
        return Err(FrequencyError::Input { run, input: k / count % m, omega });
    }
    if let EndTerms::Given(given) = ends {
        let wanted = structure.states * count;
        if given.len() != wanted {
            return Err(shape("end terms", given.len(), wanted));
        }
        if let Some(k) = given.iter().position(|e| !finite(e)) {
            return Err(FrequencyError::End { state: k / count });
        }
    }
    Ok(())
}

/// The distance of frequencies that are even to rounding.
fn spacing(omega: &[f64]) -> Option<f64> {
    let (first, last) = (*omega.first()?, *omega.last()?);
    let step = (last - first) / (omega.len() - 1).max(1) as f64;
    let even = |(k, w): (usize, &f64)| (first + k as f64 * step - w).abs() <= 4.0 * f64::EPSILON * last;
    omega.iter().enumerate().all(even).then_some(step)
}

/// What keeps a model from having a response in the frequency domain.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FrequencyError {
    /// A pole of the model stands on the imaginary axis at one of the frequencies.
    #[error(
        "run `{run}`: the model has an undamped mode exactly at {omega} rad per unit of time ({} cycles), where its response \
         has no finite value; move the frequencies or begin with other values",
        omega / std::f64::consts::TAU
    )]
    Singular {
        /// Name of the run.
        run: String,
        /// Position of the frequency.
        frequency: usize,
        /// The angular frequency.
        omega: f64,
    },
    /// A coefficient of the linear model is not a finite number.
    #[error("the coefficient of signal {} in equation {} is not a finite number", signal + 1, row + 1)]
    Coefficient {
        /// The equation, as in [`Term`](crate::linear::Term).
        row: usize,
        /// The signal.
        signal: usize,
    },
    /// The derivative of a coefficient is not a finite number.
    #[error("the derivative of the coefficient of signal {} in equation {} by parameter {} is not a finite number",
        signal + 1, row + 1, param + 1)]
    Slope {
        /// The equation.
        row: usize,
        /// The signal.
        signal: usize,
        /// The parameter.
        param: usize,
    },
    /// A delay, or its derivative, is not a finite number.
    #[error("delay {} is not a finite number", delayed + 1)]
    Delay {
        /// Position in [`Structure::delayed`](crate::linear::Structure::delayed).
        delayed: usize,
    },
    /// An end term of a state is not a finite number.
    #[error("an end term of state {} is not a finite number", state + 1)]
    End {
        /// The state.
        state: usize,
    },
    /// Frequencies must be finite, above zero and rising.
    #[error("run `{run}`: frequency {} is {omega}; frequencies must be finite, above zero and rising", frequency + 1)]
    Frequency {
        /// Name of the run.
        run: String,
        /// Its position.
        frequency: usize,
        /// Its value.
        omega: f64,
    },
    /// A spectrum that does not belong to the model.
    #[error("run `{run}`: there are {found} numbers for the {what}, the model and the frequencies need {wanted}")]
    Shape {
        /// Name of the run.
        run: String,
        /// What the numbers are.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many are needed.
        wanted: usize,
    },
    /// An input is not known at a frequency.
    #[error("run `{run}`: input {} is not a finite number at {omega} rad per unit of time", input + 1)]
    Input {
        /// Name of the run.
        run: String,
        /// The input.
        input: usize,
        /// The angular frequency.
        omega: f64,
    },
}

/// A program and its memory.
pub(super) struct Ready {
    pub(super) prepared: Arc<Prepared>,
    /// Registers of the program.
    registers: usize,
    /// Outputs of a block.
    y: Vec<f64>,
    /// What solves by numbers, once it was needed.
    dense: Option<Dense>,
    /// Leaves at one frequency.
    at: Vec<Complex64>,
}

impl Ready {
    /// A program that works in the memory of `leaves`.
    pub(super) fn new(prepared: Arc<Prepared>, leaves: &mut Leaves) -> Self {
        let registers = prepared.program.as_ref().map_or(0, |p| p.registers);
        leaves.reserve(registers + prepared.wiring.planes());
        let y = vec![0.0; prepared.wiring.structure.outputs * PLANE];
        Self { registers, y, dense: None, at: Vec::new(), prepared }
    }

    /// Prepares what all frequencies share where there is no program.
    pub(super) fn prepare(&mut self, values: &Values) {
        if self.prepared.program.is_none() {
            let Self { dense, prepared, .. } = self;
            dense.get_or_insert_with(|| Dense::new(&prepared.wiring)).prepare(&prepared.wiring, values);
        }
    }

    /// Where the planes of derivatives stand.
    fn derivatives(&self, leaves: &Leaves) -> Range<usize> {
        let first = leaves.behind() + self.registers;
        first * PLANE..(first + self.prepared.wiring.planes()) * PLANE
    }

    /// Solves one block of frequencies.
    ///
    /// # Errors
    /// The first frequency, counted in the block, at which there is no solution.
    pub(super) fn solve(
        &mut self,
        leaves: &mut Leaves,
        (block, omega): (usize, &[f64]),
        values: &Values,
        (ends, scalars): (&[f64], &[f64]),
    ) -> Result<(), usize> {
        let Some(program) = &self.prepared.program else { return self.repair(leaves, (block, omega), values, ends) };
        let (first, registers) = (leaves.block(block), leaves.behind());
        let (lanes, memory) = (omega.len().next_multiple_of(8), &mut leaves.memory);
        Execution { program, scalars, memory, leaves: first, registers, lanes }.run();
        for (output, y) in program.outputs.iter().zip(self.y.chunks_exact_mut(PLANE)) {
            let plane = match output {
                Some(plane) if plane & DATA == 0 => registers + *plane as usize,
                Some(leaf) => first + (leaf & !DATA) as usize,
                None => {
                    y.fill(0.0);
                    continue;
                }
            };
            y.copy_from_slice(&leaves.memory[plane * PLANE..][..PLANE]);
        }
        let flags = &leaves.memory[(registers + FLAGS as usize) * PLANE + BLOCK..][..omega.len()];
        if flags.iter().all(|flag| *flag == 0.0) { Ok(()) } else { self.repair(leaves, (block, omega), values, ends) }
    }

    /// Solves flagged frequencies, without a program all, by numbers.
    fn repair(
        &mut self,
        leaves: &mut Leaves,
        (block, omega): (usize, &[f64]),
        values: &Values,
        ends: &[f64],
    ) -> Result<(), usize> {
        let derivatives = self.derivatives(leaves);
        let Self { prepared, dense, at, y, .. } = self;
        let dense = dense.get_or_insert_with(|| Dense::new(&prepared.wiring));
        at.resize(prepared.wiring.leaves(), Complex64::default());
        for (k, w) in omega.iter().enumerate() {
            let program = prepared.program.is_some();
            let flags = (leaves.behind() + FLAGS as usize) * PLANE + k;
            if program && leaves.memory[flags + BLOCK] == 0.0 {
                continue;
            }
            // outputs have the same bits whatever else is asked for
            let outputs = if program && leaves.memory[flags] == 0.0 { 0 } else { dense.y.len() };
            at.iter_mut().enumerate().for_each(|(leaf, at)| *at = leaves.get(leaf as u32, block * BLOCK + k));
            dense.solve(&prepared.wiring, values, ends, *w, at).map_err(|_| k)?;
            let planes = leaves.memory[derivatives.clone()].chunks_exact_mut(PLANE).zip(&dense.derivatives);
            for (plane, value) in planes.chain(y.chunks_exact_mut(PLANE).zip(&dense.y[..outputs])) {
                (plane[k], plane[BLOCK + k]) = (value.re, value.im);
            }
        }
        // what is behind the last frequency repeats it without inputs, and zero times infinity is not zero
        for plane in leaves.memory[derivatives].chunks_exact_mut(PLANE).chain(y.chunks_exact_mut(PLANE)) {
            plane[omega.len()..BLOCK].fill(0.0);
            plane[BLOCK + omega.len()..].fill(0.0);
        }
        Ok(())
    }

    /// The block that was solved last.
    pub(super) fn planes<'p>(&'p self, leaves: &'p mut Leaves, first: usize, count: usize) -> Planes<'p> {
        let derivatives = self.derivatives(leaves);
        let (derivatives, layout) = (&mut leaves.memory[derivatives], &self.prepared.wiring.layout);
        Planes { first, count, lanes: count.next_multiple_of(8), y: &self.y, derivatives, layout }
    }
}
