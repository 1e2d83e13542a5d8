//! A unit, loaded and asked as a simulator would.

#![allow(unsafe_code, reason = "the functions of the standard take pointers")]

use super::VerifyError;
use super::{Numbers, Site};
use crate::Stamp;
use crate::fmu::{Kind, Variables, Version, library_path};
use fdm_grammar::graph::Signal;
use fdm_grammar::model::Param;
use fdm_system::Model;
use fdm_system::code::Tape;
use fdm_system::dynamics::{Dynamics, Point, Workspace};
use libloading::Library;
use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::path::Path;

type Environment = *mut c_void;
type Instantiate2 = unsafe extern "C" fn(
    *const c_char,
    c_int,
    *const c_char,
    *const c_char,
    *const Callbacks,
    c_int,
    c_int,
) -> *mut c_void;
type Instantiate3 = unsafe extern "C" fn(
    *const c_char,
    *const c_char,
    *const c_char,
    bool,
    bool,
    Environment,
    *const c_void,
) -> *mut c_void;
type Free = unsafe extern "C" fn(*mut c_void);
type Plain = unsafe extern "C" fn(*mut c_void) -> c_int;
type SetUp2 = unsafe extern "C" fn(*mut c_void, c_int, f64, f64, c_int, f64) -> c_int;
type EnterInitialization3 = unsafe extern "C" fn(*mut c_void, bool, f64, f64, bool, f64) -> c_int;
type SetReal2 = unsafe extern "C" fn(*mut c_void, *const c_uint, usize, *const f64) -> c_int;
type SetReal3 = unsafe extern "C" fn(*mut c_void, *const c_uint, usize, *const f64, usize) -> c_int;
type GetReal2 = unsafe extern "C" fn(*mut c_void, *const c_uint, usize, *mut f64) -> c_int;
type GetReal3 = unsafe extern "C" fn(*mut c_void, *const c_uint, usize, *mut f64, usize) -> c_int;
type SetTime = unsafe extern "C" fn(*mut c_void, f64) -> c_int;
type SetStates = unsafe extern "C" fn(*mut c_void, *const f64, usize) -> c_int;
type GetStates = unsafe extern "C" fn(*mut c_void, *mut f64, usize) -> c_int;
type Directional2 =
    unsafe extern "C" fn(*mut c_void, *const c_uint, usize, *const c_uint, usize, *const f64, *mut f64) -> c_int;
type Directional3 = unsafe extern "C" fn(
    *mut c_void,
    *const c_uint,
    usize,
    *const c_uint,
    usize,
    *const f64,
    usize,
    *mut f64,
    usize,
) -> c_int;

/// fmi2CallbackFunctions, of which a unit of ours needs none.
#[repr(C)]
struct Callbacks([*const c_void; 5]);

/// A unit's library, with the model that it should compute.
pub(super) struct Unit {
    library: Library,
    version: Version,
    /// The model with derivatives by all parameters, as the unit makes them.
    model: Model,
    variables: Variables,
    token: CString,
    resources: CString,
}

/// An instance that is freed in the end.
struct Instance<'a> {
    unit: &'a Unit,
    component: *mut c_void,
}

impl Drop for Instance<'_> {
    fn drop(&mut self) {
        let name = self.unit.named(("fmi2FreeInstance", "fmi3FreeInstance"));
        // SAFETY: it was made by this library, and nobody uses it behind this
        if let Ok(free) = unsafe { self.unit.library.get::<Free>(name.as_bytes()) } {
            unsafe { free(self.component) };
        }
    }
}

impl Unit {
    pub(super) fn load(version: Version, model: &Model, folder: &Path) -> Result<Self, VerifyError> {
        let freed = model.definition().params.iter().map(|p| Param { fixed: false, ..p.clone() }).collect();
        let path = folder.join(library_path(version, model));
        // SAFETY: the user names the unit, as for a simulator; its library is that of fdm
        let library = unsafe { Library::new(&path) }?;
        let resources = folder.join("resources").display().to_string();
        let resources = match version {
            Version::Two => format!("file://{}", resources.replace('%', "%25").replace(' ', "%20")),
            Version::Three => resources,
        };
        Ok(Self {
            library,
            version,
            variables: Variables::of(model),
            token: CString::new(Stamp::of(model).guid()).unwrap_or_default(),
            resources: CString::new(resources).unwrap_or_default(),
            model: model.with_params(freed),
        })
    }

    fn named(&self, (two, three): (&'static str, &'static str)) -> &'static str {
        if self.version == Version::Two { two } else { three }
    }

    fn instance(&self) -> Result<Instance<'_>, VerifyError> {
        let (name, null) = (c"verified", std::ptr::null_mut());
        // SAFETY: functions and arguments are those of the standard
        let component = unsafe {
            match self.version {
                Version::Two => {
                    let make = self.library.get::<Instantiate2>(b"fmi2Instantiate")?;
                    let callbacks = Callbacks([std::ptr::null(); 5]);
                    make(name.as_ptr(), 0, self.token.as_ptr(), self.resources.as_ptr(), &raw const callbacks, 0, 0)
                }
                Version::Three => {
                    let make = self.library.get::<Instantiate3>(b"fmi3InstantiateModelExchange")?;
                    make(
                        name.as_ptr(),
                        self.token.as_ptr(),
                        self.resources.as_ptr(),
                        false,
                        false,
                        null,
                        null.cast_const(),
                    )
                }
            }
        };
        if component.is_null() {
            return Err(VerifyError::Status {
                function: self.named(("fmi2Instantiate", "fmi3InstantiateModelExchange")),
                status: 3,
            });
        }
        Ok(Instance { unit: self, component })
    }

    /// What should be, and what the unit says, at a point.
    pub(super) fn at(&mut self, seed: u64) -> Result<(Numbers, Numbers), VerifyError> {
        let (model, layout) = (&self.model, self.model.layout());
        let mut site = Site::new(model, seed);
        for (param, input) in &layout.first {
            site.theta[*param as usize] = site.drive[*input as usize];
        }
        let tape = Tape::new(model.schedule());
        let mut work = Workspace::new(&tape);
        let mut known = vec![0.0; layout.known];
        tape.prepare(&site.theta, &mut known, &mut work);
        let tau = &known[layout.tau.clone()];
        if !tau.is_empty() {
            // of the past there is the first value
            site.t = 0.0;
            site.x.copy_from_slice(&known[layout.initial.clone()]);
            for (d, signal) in layout.delayed.iter().enumerate() {
                site.drive[layout.inputs + d] = match *signal {
                    Signal::Input(k) if layout.vanishing.contains(&k) && tau[d] > 0.0 => 0.0,
                    Signal::Input(k) => site.drive[k as usize],
                    Signal::State(k) => site.x[k as usize],
                };
            }
        }
        // a delay of 0 sees the signal of now, whose derivatives the tape does not join
        let joined = !tau.contains(&0.0);
        let at = Point { t: site.t, x: &site.x, drive: &site.drive, known: &known };
        let expected = dense(&tape, at, &mut work, joined);
        let got = self.ask(&site, joined)?;
        Ok((expected, got))
    }

    /// What the unit says.
    fn ask(&self, site: &Site, joined: bool) -> Result<Numbers, VerifyError> {
        let (layout, instance) = (self.model.layout(), self.instance()?);
        let reference = |kind| self.variables.of_kind(kind).unwrap_or(u32::MAX);
        let parameters: Vec<(u32, f64)> = (0..layout.params)
            .filter_map(|k| Some((self.variables.of_kind(Kind::Parameter(k))?, site.theta[k])))
            .collect();
        let inputs: Vec<(u32, f64)> = (0..layout.inputs)
            .filter_map(|k| {
                let kind = if self.model.definition().inputs[k].known { Kind::Known(k) } else { Kind::Input(k) };
                Some((self.variables.of_kind(kind)?, site.drive[k]))
            })
            .collect();
        instance.begin()?;
        instance.set(&parameters)?;
        instance.set(&inputs)?;
        instance.plain(("fmi2ExitInitializationMode", "fmi3ExitInitializationMode"))?;
        instance.plain(("fmi2EnterContinuousTimeMode", "fmi3EnterContinuousTimeMode"))?;
        if layout.delayed.is_empty() {
            instance.time(site.t)?;
            instance.states(&site.x)?;
        }
        let rates: Vec<u32> = (0..layout.states).map(|k| reference(Kind::Rate(k))).collect();
        let outputs: Vec<u32> = (0..layout.outputs).map(|k| reference(Kind::Output(k))).collect();
        let all = [&rates[..], &outputs].concat();
        let values = instance.get(&all)?;
        let mut numbers = vec![(RATES, instance.rates(layout.states)?), (OUTPUTS, values[layout.states..].to_vec())];
        if joined {
            let states: Vec<u32> = (0..layout.states).map(|k| reference(Kind::State(k))).collect();
            let moving: Vec<u32> = inputs.iter().map(|(r, _)| *r).collect();
            let open: Vec<u32> = parameters.iter().map(|(r, _)| *r).collect();
            for (what, knowns) in [(BY_STATES, &states), (BY_INPUTS, &moving), (BY_PARAMETERS, &open)] {
                let mut columns = Vec::new();
                for known in knowns {
                    columns.extend(instance.directional(&all, *known)?);
                }
                numbers.push((what, columns));
            }
        }
        Ok(numbers)
    }
}

const RATES: &str = "derivatives of the states";
const OUTPUTS: &str = "outputs";
const BY_STATES: &str = "directional derivatives by states";
const BY_INPUTS: &str = "directional derivatives by inputs";
const BY_PARAMETERS: &str = "directional derivatives by parameters";

/// What the tape says, derivatives of rates and outputs column by column.
fn dense(tape: &Tape, at: Point<'_>, work: &mut Workspace, joined: bool) -> Numbers {
    let (layout, p) = (tape.layout(), &tape.layout().patterns);
    let (n, q) = (layout.states, layout.outputs);
    let mut row = vec![0.0; layout.rate_slots()];
    tape.rates_and_partials(at, &mut row, work);
    let mut out = vec![0.0; layout.output_slots()];
    tape.outputs_and_partials(at, &mut out, work);
    let mut by_input = vec![0.0; layout.input_slots()];
    tape.by_input(at, &mut by_input, work);
    let mut numbers = vec![(RATES, row[..n].to_vec()), (OUTPUTS, out[..q].to_vec())];
    if !joined {
        return numbers;
    }
    let rows = n + q;
    let mut columns = [vec![0.0; rows * n], vec![0.0; rows * layout.inputs], vec![0.0; rows * layout.params]];
    for ((_, i, j), slot) in p.rates_by_state.entries().zip(&layout.stage.by_state) {
        columns[0][j * rows + i] = row[*slot as usize];
    }
    p.outputs_by_state.entries().for_each(|(k, i, j)| columns[0][j * rows + n + i] = out[q + k]);
    p.rates_by_input.entries().for_each(|(k, i, j)| columns[1][j * rows + i] = by_input[k]);
    let first = p.rates_by_input.len();
    p.outputs_by_input.entries().for_each(|(k, i, j)| columns[1][j * rows + n + i] = by_input[first + k]);
    for (_, i, j) in p.rates_by_param.entries() {
        columns[2][j * rows + i] = layout.stage.by_param(i, j).map_or(0.0, |slot| row[slot]);
    }
    let first = q + p.outputs_by_state.len() + p.outputs_by_delayed.len();
    p.outputs_by_param.entries().for_each(|(k, i, j)| columns[2][j * rows + n + i] = out[first + k]);
    let [by_states, by_inputs, by_parameters] = columns;
    // first samples of inputs are no parameters of a unit
    let recorded = |k: usize| layout.first.iter().any(|(param, _)| *param as usize == k);
    let open = (0..layout.params).filter(|k| !recorded(*k));
    let by_parameters = open.flat_map(|k| by_parameters[k * rows..][..rows].to_vec()).collect();
    numbers.extend([(BY_STATES, by_states), (BY_INPUTS, by_inputs), (BY_PARAMETERS, by_parameters)]);
    numbers
}

fn good(function: &'static str, status: c_int) -> Result<(), VerifyError> {
    if status == 0 { Ok(()) } else { Err(VerifyError::Status { function, status }) }
}

/// Calls of the standard, in both versions.
impl Instance<'_> {
    fn two(&self) -> bool {
        self.unit.version == Version::Two
    }

    fn begin(&self) -> Result<(), VerifyError> {
        let library = &self.unit.library;
        // SAFETY: functions and arguments are those of the standard
        unsafe {
            if self.two() {
                let set_up = library.get::<SetUp2>(b"fmi2SetupExperiment")?;
                good("fmi2SetupExperiment", set_up(self.component, 0, 0.0, 0.0, 0, 0.0))?;
                return self.plain(("fmi2EnterInitializationMode", ""));
            }
            let enter = library.get::<EnterInitialization3>(b"fmi3EnterInitializationMode")?;
            good("fmi3EnterInitializationMode", enter(self.component, false, 0.0, 0.0, false, 0.0))
        }
    }

    fn plain(&self, names: (&'static str, &'static str)) -> Result<(), VerifyError> {
        let name = self.unit.named(names);
        // SAFETY: as above
        unsafe { good(name, self.unit.library.get::<Plain>(name.as_bytes())?(self.component)) }
    }

    fn set(&self, values: &[(u32, f64)]) -> Result<(), VerifyError> {
        let (references, values): (Vec<u32>, Vec<f64>) = values.iter().copied().unzip();
        let (r, v, count) = (references.as_ptr(), values.as_ptr(), values.len());
        // SAFETY: as above; both arrays are as long as is said
        unsafe {
            match self.two() {
                true => {
                    good("fmi2SetReal", self.unit.library.get::<SetReal2>(b"fmi2SetReal")?(self.component, r, count, v))
                }
                false => {
                    let set = self.unit.library.get::<SetReal3>(b"fmi3SetFloat64")?;
                    good("fmi3SetFloat64", set(self.component, r, count, v, count))
                }
            }
        }
    }

    fn get(&self, references: &[u32]) -> Result<Vec<f64>, VerifyError> {
        let mut values = vec![f64::NAN; references.len()];
        let (r, v, count) = (references.as_ptr(), values.as_mut_ptr(), references.len());
        // SAFETY: as above
        unsafe {
            match self.two() {
                true => good(
                    "fmi2GetReal",
                    self.unit.library.get::<GetReal2>(b"fmi2GetReal")?(self.component, r, count, v),
                )?,
                false => {
                    let get = self.unit.library.get::<GetReal3>(b"fmi3GetFloat64")?;
                    good("fmi3GetFloat64", get(self.component, r, count, v, count))?;
                }
            }
        }
        Ok(values)
    }

    fn time(&self, time: f64) -> Result<(), VerifyError> {
        let name = self.unit.named(("fmi2SetTime", "fmi3SetTime"));
        // SAFETY: as above
        unsafe { good(name, self.unit.library.get::<SetTime>(name.as_bytes())?(self.component, time)) }
    }

    fn states(&self, x: &[f64]) -> Result<(), VerifyError> {
        let name = self.unit.named(("fmi2SetContinuousStates", "fmi3SetContinuousStates"));
        // SAFETY: as above
        unsafe { good(name, self.unit.library.get::<SetStates>(name.as_bytes())?(self.component, x.as_ptr(), x.len())) }
    }

    fn rates(&self, states: usize) -> Result<Vec<f64>, VerifyError> {
        let name = self.unit.named(("fmi2GetDerivatives", "fmi3GetContinuousStateDerivatives"));
        let mut rates = vec![f64::NAN; states];
        // SAFETY: as above
        unsafe {
            let get = self.unit.library.get::<GetStates>(name.as_bytes())?;
            good(name, get(self.component, rates.as_mut_ptr(), states))?;
        }
        Ok(rates)
    }

    fn directional(&self, unknowns: &[u32], known: u32) -> Result<Vec<f64>, VerifyError> {
        let name = self.unit.named(("fmi2GetDirectionalDerivative", "fmi3GetDirectionalDerivative"));
        let (mut out, seed, count) = (vec![f64::NAN; unknowns.len()], 1.0, unknowns.len());
        let (u, k, s, o) = (unknowns.as_ptr(), &raw const known, &raw const seed, out.as_mut_ptr());
        // SAFETY: as above
        let status = unsafe {
            match self.two() {
                true => self.unit.library.get::<Directional2>(name.as_bytes())?(self.component, u, count, k, 1, s, o),
                false => {
                    let get = self.unit.library.get::<Directional3>(name.as_bytes())?;
                    get(self.component, u, count, k, 1, s, 1, o, count)
                }
            }
        };
        good(name, status)?;
        Ok(out)
    }
}
