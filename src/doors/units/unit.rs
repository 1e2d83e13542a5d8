//! A unit's functions ([`Unit`]): values from its code, derivatives from its code where it has them, else from differences.
//!
//! Derivatives from values: differences of five values around a point ([`Stencil`]).

use crate::archive::Files;
use crate::description::{Description, Variable};
use crate::folders::unpacked;
use crate::functions::Functions;
use crate::instance::{Instance, Trouble};
use fdm_grammar::external::External;
use std::cell::RefCell;
use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

/// Points whose values and derivatives a thread remembers for a unit.
const POINTS: usize = 8;

/// Lengths of steps that differences try at the start values, relative to the size of the argument.
const STEPS: [f64; 4] = [1e-3, 1e-4, 1e-5, 1e-6];

/// How far a unit's own derivatives may be from differences at the beginning, relative to the greatest of the column.
const AGREED: f64 = 1e-5;

/// What rounding makes of a difference of equal values, over the step and relative to these, is below this.
const NOISE: f64 = 1e-11;

/// Times on the way on which a unit is tried for a memory, since its beginning.
const WAY: [f64; 12] = [1e-3, 1e-2, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0];

/// A unit that a model uses.
pub(crate) struct Unit {
    name: String,
    description: Description,
    files: Files,
    /// References of the outputs, and of rates and outputs.
    outputs: Vec<u32>,
    unknowns: Vec<u32>,
    number: usize,
    loaded: OnceLock<Result<Loaded, String>>,
    /// Of each argument the step of its differences, relative to its size.
    steps: Vec<OnceLock<f64>>,
    complaint: Mutex<Option<String>>,
}

/// Its code.
struct Loaded {
    functions: &'static Functions,
    resources: String,
    /// Whether derivatives by states and inputs are the unit's own.
    directional: OnceLock<bool>,
}

thread_local! {
    static POOLS: RefCell<HashMap<usize, Pool>> = RefCell::new(HashMap::new());
}

/// What a thread has of a unit.
#[derive(Default)]
struct Pool {
    instances: Vec<Instance>,
    clock: u64,
    points: Vec<Point>,
    next: usize,
}

/// Where a unit was asked, and what it said.
struct Point {
    arguments: Vec<f64>,
    /// By function.
    values: Vec<f64>,
    /// By argument, then by function; empty where nobody asked.
    columns: Vec<Vec<f64>>,
}

impl Unit {
    pub(crate) fn new(name: &str, description: Description, files: Files) -> Self {
        static NUMBER: AtomicUsize = AtomicUsize::new(0);
        let d = &description;
        let outputs: Vec<u32> = d.outputs.iter().map(|v| v.reference).collect();
        let unknowns = d.states.iter().map(|s| s.rate).chain(outputs.iter().copied()).collect();
        let arguments = 1 + d.states.len() + d.inputs.len() + d.parameters.len();
        Self {
            name: name.into(),
            files,
            outputs,
            unknowns,
            number: NUMBER.fetch_add(1, Ordering::Relaxed),
            loaded: OnceLock::new(),
            steps: (0..arguments).map(|_| OnceLock::new()).collect(),
            complaint: Mutex::new(None),
            description,
        }
    }

    fn count(&self) -> usize {
        2 * self.description.states.len() + self.outputs.len()
    }

    /// Where the parameters begin among the arguments.
    fn moving(&self) -> usize {
        1 + self.description.states.len() + self.description.inputs.len()
    }

    /// The variable of an argument; none of time.
    fn variable(&self, argument: usize) -> Option<&Variable> {
        let d = &self.description;
        let all = d.states.iter().map(|s| &s.variable).chain(&d.inputs).chain(&d.parameters);
        argument.checked_sub(1).and_then(|k| all.clone().nth(k))
    }

    fn complain(&self, trouble: &str) {
        if trouble.is_empty() {
            return;
        }
        let mut complaint = self.complaint.lock().unwrap_or_else(PoisonError::into_inner);
        *complaint = Some(format!("the unit `{}`: {trouble}", self.name));
    }

    /// Its code, loaded once; none where that failed, which was told.
    fn code(&self) -> Option<&Loaded> {
        self.loaded.get_or_init(|| self.load()).as_ref().ok()
    }

    fn load(&self) -> Result<Loaded, String> {
        let folder = unpacked(&self.files).map_err(|e| format!("its files cannot be unpacked: {e}"))?;
        let d = &self.description;
        let functions = Functions::load(&folder.join(&d.library), d.version, d.indicators > 0)?;
        let resources = format!("{}{}", folder.join("resources").display(), std::path::MAIN_SEPARATOR);
        let loaded = Loaded { functions: Box::leak(Box::new(functions)), resources, directional: OnceLock::new() };
        let (n, own) = (d.states.len(), d.directional && loaded.functions.differentiates());
        let mut pool = Pool::default();
        let first = self.start(&mut pool, &loaded)?;
        let event = pool.instances.first().and_then(|instance| instance.next_event);
        if let Some(at) = event.filter(|_| !d.dependences.iter().all(|on| on.time) && d.indicators == 0) {
            return Err(format!("it has an event at time {at}, and events of units are not followed"));
        }
        // somewhere beside, where no kink of a resting point is
        let mut second = first.clone();
        for (k, value) in second.iter_mut().enumerate().take(self.moving()).skip(1) {
            let (lower, upper) = self.bounds(k);
            let moved = *value + 0.0137 * self.size(k, &first) * (1.0 + 0.1 * (k % 7) as f64);
            *value = if (lower..=upper).contains(&moved) { moved } else { *value };
        }
        let mut values = [0, 1, 2].map(|_| vec![f64::NAN; self.count()]);
        for (out, at) in values.iter_mut().zip([&first, &second, &first]) {
            // what cannot be computed there is no fault yet
            let _ = self.fresh(&mut pool, &loaded, at, out);
        }
        if !same(&values[0], &values[2]) {
            return Err("asked twice for the same it gives different numbers: it remembers what it was asked (a delay, an iteration), and no \
                        derivative of it would hold"
                .into());
        }
        if let Some(difference) = self.remembers(&mut pool, &loaded, &first, &second) {
            return Err(format!(
                "what it gives depends on the way that led there (by {difference:.1e}): it holds a delay or something else of the past; write a \
                 delay in the model (`delay(x, tau)`)"
            ));
        }
        if !d.moves() {
            for later in [1.234, 17.9] {
                let mut moved = first.clone();
                moved[0] += later;
                let mut out = vec![f64::NAN; self.count()];
                if self.fresh(&mut pool, &loaded, &moved, &mut out).is_ok()
                    && !same(&values[0][..n + self.outputs.len()], &out[..n + self.outputs.len()])
                {
                    return Err("it depends on time, and its description says that it does not".into());
                }
            }
        }
        let at = if values[1].iter().all(|v| v.is_finite()) { &second } else { &first };
        let _ = loaded.directional.set(own && self.agrees(&mut pool, &loaded, at));
        Ok(loaded)
    }

    /// How far the values at the end of a way are from those that an instance gives which is asked there at once; none where they are the
    /// same.
    fn remembers(&self, pool: &mut Pool, loaded: &Loaded, first: &[f64], second: &[f64]) -> Option<f64> {
        let (moving, mut end) = (self.moving(), first.to_vec());
        end[0] += WAY[WAY.len() - 1];
        let mut walked = Instance::new(loaded.functions, &self.description, &loaded.resources).ok()?;
        walked.begin(&self.description, &first[moving..], true).ok()?;
        for (k, time) in WAY.iter().enumerate() {
            let mut at = if k % 2 == 0 { second.to_vec() } else { first.to_vec() };
            at[0] = first[0] + time;
            // events end the way, and are told where they happen
            walked.step(&self.description, &at[..moving]).ok()?;
        }
        let count = self.unknowns.len();
        let (mut there, mut at_once) = (vec![f64::NAN; count], vec![f64::NAN; self.count()]);
        walked.values(&self.description, &self.outputs, &end[..moving], &mut there).ok()?;
        self.fresh(pool, loaded, &end, &mut at_once).ok()?;
        let far = there.iter().zip(&at_once).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        (!same(&there, &at_once[..count])).then_some(far)
    }

    /// Whether the unit's own derivatives are those of differences.
    fn agrees(&self, pool: &mut Pool, loaded: &Loaded, at: &[f64]) -> bool {
        let count = self.count();
        (1..self.moving()).all(|argument| {
            let (mut own, mut other) = (vec![0.0; count], vec![0.0; count]);
            if self.own(pool, loaded, at, argument, &mut own).is_err() {
                return false;
            }
            self.differences(pool, loaded, at, argument, &mut other);
            let greatest = other.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            own.iter().zip(&other).all(|(a, b)| (a - b).abs() <= AGREED * greatest.max(1e-3) || !b.is_finite())
        })
    }

    /// The arguments that the unit itself begins with.
    fn start(&self, pool: &mut Pool, loaded: &Loaded) -> Result<Vec<f64>, String> {
        let d = &self.description;
        let of = |v: &Variable| v.start.unwrap_or(0.0);
        let parameters: Vec<f64> = d.parameters.iter().map(of).collect();
        let initial = self
            .instance(pool, loaded, &parameters)
            .map_err(|e| format!("it cannot be initialised: {e}"))?
            .initial
            .clone();
        Ok([d.start_time].into_iter().chain(initial).chain(d.inputs.iter().map(of)).chain(parameters).collect())
    }

    fn bounds(&self, argument: usize) -> (f64, f64) {
        match self.variable(argument) {
            Some(v) => v.bounds,
            None => (self.description.start_time, f64::INFINITY),
        }
    }

    /// The size of an argument, at least that of its start value: what steps are relative to. Time has none that would matter.
    fn size(&self, argument: usize, at: &[f64]) -> f64 {
        let Some(v) = self.variable(argument) else { return 1.0 };
        let usual = v.nominal.or(v.start).map_or(1.0, f64::abs);
        at[argument].abs().max(if usual > 0.0 { usual } else { 1.0 })
    }

    /// The instance with these parameters.
    fn instance<'p>(
        &self,
        pool: &'p mut Pool,
        loaded: &Loaded,
        parameters: &[f64],
    ) -> Result<&'p mut Instance, String> {
        pool.clock += 1;
        let found = pool.instances.iter().position(|i| i.has(parameters));
        let k = match found {
            Some(k) => k,
            None => {
                // instances that a thread keeps of a unit at most: each has parameters of its own
                let most = (1 + 4 * parameters.len()).clamp(2, 256);
                let oldest = (0..pool.instances.len()).min_by_key(|k| pool.instances[*k].used);
                let spare = oldest.filter(|_| pool.instances.len() >= most).map(|k| pool.instances.swap_remove(k));
                let (mut instance, fresh) = match spare {
                    Some(instance) => (instance, false),
                    None => (Instance::new(loaded.functions, &self.description, &loaded.resources)?, true),
                };
                instance.begin(&self.description, parameters, fresh).map_err(|e| e.to_string())?;
                pool.instances.push(instance);
                pool.instances.len() - 1
            }
        };
        pool.instances[k].used = pool.clock;
        Ok(&mut pool.instances[k])
    }

    /// All functions at a point; NaN where they cannot be computed.
    fn fresh(&self, pool: &mut Pool, loaded: &Loaded, at: &[f64], out: &mut [f64]) -> Result<(), String> {
        out.fill(f64::NAN);
        if !at.iter().all(|a| a.is_finite()) {
            // what came before has been told
            return Err(String::new());
        }
        let (moving, parameters) = at.split_at(self.moving());
        let count = self.unknowns.len();
        let instance = self.instance(pool, loaded, parameters)?;
        out[count..].copy_from_slice(&instance.initial);
        let done = instance.values(&self.description, &self.outputs, moving, &mut out[..count]);
        done.map_err(|trouble| {
            out[..count].fill(f64::NAN);
            self.trouble(pool, parameters, &trouble)
        })
    }

    /// What went wrong; an instance that came to an error is given up.
    fn trouble(&self, pool: &mut Pool, parameters: &[f64], trouble: &Trouble) -> String {
        if matches!(trouble, Trouble::Refused(_)) {
            pool.instances.retain(|i| !i.has(parameters));
        }
        trouble.to_string()
    }

    /// The unit's own derivatives of all functions by a state or an input.
    fn own(
        &self,
        pool: &mut Pool,
        loaded: &Loaded,
        at: &[f64],
        argument: usize,
        out: &mut [f64],
    ) -> Result<(), String> {
        let (moving, parameters) = at.split_at(self.moving());
        out.fill(0.0);
        let count = self.unknowns.len();
        let known = self.variable(argument).map_or(u32::MAX, |v| v.reference);
        let instance = self.instance(pool, loaded, parameters)?;
        let done = instance.along(&self.description, &self.unknowns, known, moving, &mut out[..count]);
        done.map_err(|trouble| {
            out.fill(f64::NAN);
            self.trouble(pool, parameters, &trouble)
        })
    }

    /// The derivatives of all functions by an argument, from their values.
    fn differences(&self, pool: &mut Pool, loaded: &Loaded, at: &[f64], argument: usize, out: &mut [f64]) {
        let step = self.step(pool, loaded, argument) * self.size(argument, at);
        if let Some(trouble) = self.stepped(pool, loaded, at, argument, step, out) {
            self.complain(&trouble);
        }
    }

    fn stepped(
        &self,
        pool: &mut Pool,
        loaded: &Loaded,
        at: &[f64],
        argument: usize,
        step: f64,
        out: &mut [f64],
    ) -> Option<String> {
        let (mut moved, mut troubled) = (at.to_vec(), None);
        let stencil = Stencil::new(at[argument], step, self.bounds(argument));
        stencil.derivative(at[argument], out, |a, values| {
            moved[argument] = a;
            if let Err(trouble) = self.fresh(pool, loaded, &moved, values) {
                troubled = Some(trouble);
            }
        });
        troubled
    }

    /// The relative length of the steps of an argument: that behind which differences change least, at the start values.
    fn step(&self, pool: &mut Pool, loaded: &Loaded, argument: usize) -> f64 {
        if let Some(step) = self.steps[argument].get() {
            return *step;
        }
        let best = self.start(pool, loaded).ok().and_then(|start| {
            let size = self.size(argument, &start);
            let columns = STEPS.map(|step| {
                let mut out = vec![0.0; self.count()];
                // what cannot be computed here is told where it is wanted
                let _ = self.stepped(pool, loaded, &start, argument, step * size, &mut out);
                out
            });
            let greatest =
                columns.iter().flatten().filter(|v| v.is_finite()).fold(f64::MIN_POSITIVE, |a, b| a.max(b.abs()));
            let changes = columns.windows(2).map(|pair| {
                let changes = pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b).abs() / greatest);
                changes.filter(|c| c.is_finite()).fold(0.0, f64::max)
            });
            let changes: Vec<f64> = changes.collect();
            (0..changes.len()).min_by(|a, b| changes[*a].total_cmp(&changes[*b])).map(|k| STEPS[k])
        });
        *self.steps[argument].get_or_init(|| best.unwrap_or(STEPS[0]))
    }

    /// What is known at these arguments, on this thread.
    fn point(&self, pool: &mut Pool, loaded: &Loaded, arguments: &[f64]) -> usize {
        if let Some(k) = pool.points.iter().position(|p| same(&p.arguments, arguments)) {
            return k;
        }
        if pool.points.len() < POINTS {
            let columns = vec![Vec::new(); arguments.len()];
            pool.points.push(Point { arguments: Vec::new(), values: vec![f64::NAN; self.count()], columns });
        }
        let k = pool.next % POINTS;
        pool.next += 1;
        let mut values = std::mem::take(&mut pool.points[k].values);
        if let Err(trouble) = self.fresh(pool, loaded, arguments, &mut values) {
            self.complain(&trouble);
        }
        let point = &mut pool.points[k];
        point.values = values;
        point.arguments.clear();
        point.arguments.extend_from_slice(arguments);
        point.columns.iter_mut().for_each(Vec::clear);
        k
    }

    /// The derivative of a function by an argument at a point.
    fn entry(&self, pool: &mut Pool, loaded: &Loaded, point: usize, function: usize, argument: usize) -> f64 {
        if pool.points[point].columns[argument].is_empty() {
            let mut column = std::mem::take(&mut pool.points[point].columns[argument]);
            let at = std::mem::take(&mut pool.points[point].arguments);
            column.resize(self.count(), 0.0);
            if self.is_own(loaded, argument) {
                if let Err(trouble) = self.own(pool, loaded, &at, argument, &mut column) {
                    self.complain(&trouble);
                }
            } else {
                self.differences(pool, loaded, &at, argument, &mut column);
                silenced(&mut column, &pool.points[point].values, self.size(argument, &at));
            }
            pool.points[point].arguments = at;
            pool.points[point].columns[argument] = column;
        }
        pool.points[point].columns[argument][function]
    }

    /// Whether derivatives by an argument come from the unit.
    fn is_own(&self, loaded: &Loaded, argument: usize) -> bool {
        (1..self.moving()).contains(&argument) && loaded.directional.get() == Some(&true)
    }

    fn along(&self, pool: &mut Pool, loaded: &Loaded, function: u32, arguments: &[f64], direction: &[f64]) -> f64 {
        let point = self.point(pool, loaded, arguments);
        let mut sum = 0.0;
        for (argument, seed) in direction.iter().enumerate().filter(|(_, seed)| **seed != 0.0) {
            if self.depends(function, argument) {
                sum += seed * self.entry(pool, loaded, point, function as usize, argument);
            }
        }
        sum
    }

    fn asked(&self, act: impl FnOnce(&mut Pool, &Loaded) -> f64) -> f64 {
        let Some(loaded) = self.code() else { return f64::NAN };
        POOLS.with_borrow_mut(|pools| act(pools.entry(self.number).or_default(), loaded))
    }
}

/// What rounding alone makes of equal values is no slope: it would stand where nothing depends on anything.
fn silenced(slopes: &mut [f64], values: &[f64], size: f64) {
    for (slope, value) in slopes.iter_mut().zip(values) {
        if (*slope * size).abs() <= NOISE * value.abs() {
            *slope = 0.0;
        }
    }
}

/// Equal to the bit.
fn same(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

impl External for Unit {
    fn name(&self, function: u32) -> String {
        let (d, k) = (&self.description, function as usize);
        let (n, q) = (d.states.len(), d.outputs.len());
        let stem =
            Path::new(&self.name).file_stem().map_or_else(|| d.name.clone(), |s| s.to_string_lossy().into_owned());
        match k {
            _ if k < n => format!("{stem}:der_{}", d.states[k].variable.name),
            _ if k < n + q => format!("{stem}:{}", d.outputs[k - n].name),
            _ => format!("{stem}:initial_{}", d.states[k - n - q].variable.name),
        }
    }

    fn functions(&self) -> u32 {
        self.count() as u32
    }

    fn arguments(&self) -> usize {
        self.steps.len()
    }

    fn depends(&self, function: u32, argument: usize) -> bool {
        let n = self.description.states.len();
        if argument >= self.moving() {
            return true;
        }
        let Some(on) = self.description.dependences.get(function as usize) else { return false };
        match argument {
            0 => on.time,
            k if k <= n => on.states[k - 1],
            k => on.inputs[k - 1 - n],
        }
    }

    fn value(&self, function: u32, arguments: &[f64]) -> f64 {
        self.asked(|pool, loaded| {
            let point = self.point(pool, loaded, arguments);
            pool.points[point].values[function as usize]
        })
    }

    fn slope(&self, function: u32, arguments: &[f64], direction: &[f64]) -> f64 {
        self.asked(|pool, loaded| self.along(pool, loaded, function, arguments, direction))
    }

    fn curvature(&self, function: u32, arguments: &[f64], [first, second]: [&[f64]; 2]) -> f64 {
        self.asked(|pool, loaded| {
            let exact = second.iter().enumerate().all(|(k, seed)| *seed == 0.0 || self.is_own(loaded, k));
            // a difference of differences has fewer digits, and wants longer steps
            let longer = if exact { 1.0 } else { 10.0 };
            let mut sum = 0.0;
            for (argument, seed) in first.iter().enumerate().filter(|(_, seed)| **seed != 0.0) {
                if !self.depends(function, argument) {
                    continue;
                }
                let step = longer * self.step(pool, loaded, argument) * self.size(argument, arguments);
                let (mut moved, mut out) = (arguments.to_vec(), [0.0]);
                let stencil = Stencil::new(arguments[argument], step, self.bounds(argument));
                stencil.derivative(arguments[argument], &mut out, |a, value| {
                    moved[argument] = a;
                    value[0] = self.along(pool, loaded, function, &moved, second);
                });
                sum += seed * out[0];
            }
            sum
        })
    }

    fn difference(&self, function: u32, arguments: &[f64], argument: usize) -> f64 {
        self.asked(|pool, loaded| {
            let mut out = vec![0.0; self.count()];
            self.differences(pool, loaded, arguments, argument, &mut out);
            let point = self.point(pool, loaded, arguments);
            let size = self.size(argument, arguments);
            silenced(&mut out, &pool.points[point].values, size);
            out[function as usize]
        })
    }

    fn ready(&self) -> Result<(), String> {
        match self.loaded.get_or_init(|| self.load()) {
            Ok(_) => Ok(()),
            Err(reason) => Err(format!("the unit `{}`: {reason}", self.name)),
        }
    }

    fn complaint(&self) -> Option<String> {
        let last = || self.complaint.lock().unwrap_or_else(PoisonError::into_inner).clone();
        self.loaded.get().and_then(|loaded| match loaded {
            Ok(_) => last(),
            Err(reason) => Some(format!("the unit `{}`: {reason}", self.name)),
        })
    }
}

/// Which values a difference is made of: places in steps from the point, and their weights over the step.
pub(crate) struct Stencil {
    places: &'static [f64],
    weights: &'static [f64],
    step: f64,
}

/// Of fourth order; Abramowitz and Stegun (1972), table 25.2.
const CENTRAL: (&[f64], &[f64]) = (&[-2.0, -1.0, 1.0, 2.0], &[1.0 / 12.0, -2.0 / 3.0, 2.0 / 3.0, -1.0 / 12.0]);
const FORWARD: (&[f64], &[f64]) = (&[0.0, 1.0, 2.0, 3.0, 4.0], &[-25.0 / 12.0, 4.0, -3.0, 4.0 / 3.0, -1.0 / 4.0]);

impl Stencil {
    /// Around `at`, within bounds where there are any; steps become powers of two, so that they are exact.
    pub(crate) fn new(at: f64, step: f64, (lower, upper): (f64, f64)) -> Self {
        let step = step.abs().max(f64::MIN_POSITIVE).log2().round().exp2();
        if at - 2.0 * step >= lower && at + 2.0 * step <= upper {
            return Self { places: CENTRAL.0, weights: CENTRAL.1, step };
        }
        // away from the bound that is near, as far as there is room
        let (room, side) = if upper - at >= at - lower { (upper - at, 1.0) } else { (at - lower, -1.0) };
        let least = step.min((room / 4.0).max(f64::MIN_POSITIVE));
        Self { places: FORWARD.0, weights: FORWARD.1, step: side * least }
    }

    /// The derivative of several functions at once; `value` writes them for the argument that it is given.
    pub(crate) fn derivative(&self, at: f64, out: &mut [f64], mut value: impl FnMut(f64, &mut [f64])) {
        let mut values = vec![0.0; out.len()];
        out.fill(0.0);
        for (place, weight) in self.places.iter().zip(self.weights) {
            value(at + place * self.step, &mut values);
            out.iter_mut().zip(&values).for_each(|(o, v)| *o += weight * v);
        }
        out.iter_mut().for_each(|o| *o /= self.step);
    }
}

#[cfg(test)]
mod differences_tests {
    use super::Stencil;

    fn of(at: f64, step: f64, bounds: (f64, f64), f: impl Fn(f64) -> f64) -> f64 {
        let mut out = [0.0];
        Stencil::new(at, step, bounds).derivative(at, &mut out, |x, values| {
            assert!(x >= bounds.0 && x <= bounds.1, "{x}");
            values[0] = f(x);
        });
        out[0]
    }

    #[test]
    fn differences_are_exact_for_polynomials_of_fourth_degree() {
        let all = (f64::NEG_INFINITY, f64::INFINITY);
        for bounds in [all, (1.5, f64::INFINITY), (0.0, 1.5), (1.5, 1.6)] {
            let d = of(1.5, 1e-2, bounds, |x| x.powi(4) - 3.0 * x);
            assert!((d - (4.0 * 1.5_f64.powi(3) - 3.0)).abs() < 1e-11, "{bounds:?} {d}");
        }
        assert!((of(0.3, 1e-3, all, f64::sin) - 0.3_f64.cos()).abs() < 1e-12);
    }
}
