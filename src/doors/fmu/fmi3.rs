//! The functions of FMI 3.0.

use crate::fmi2::{
    fmi2DeSerializeFMUstate, fmi2EnterContinuousTimeMode, fmi2EnterEventMode, fmi2ExitInitializationMode,
    fmi2FreeFMUstate, fmi2FreeInstance, fmi2GetContinuousStates, fmi2GetDerivatives, fmi2GetEventIndicators,
    fmi2GetFMUstate, fmi2GetNominalsOfContinuousStates, fmi2Reset, fmi2SerializeFMUstate, fmi2SerializedFMUstateSize,
    fmi2SetContinuousStates, fmi2SetFMUstate, fmi2SetTime,
};
use crate::unit::{ERROR, Logger, Logger3, Made, OK, Unit, functions};
use crate::unit::{put, read, text, write};
use std::ffi::{c_char, c_int, c_uint, c_void};
use std::path::PathBuf;

/// Functions that are the same as in FMI 2.0.
macro_rules! same {
    ($($(#[$about:meta])* fn $name:ident($($argument:ident: $kind:ty),*) = $other:ident;)*) => {$(
        $(#[$about])*
        ///
        /// # Safety
        /// Pointers are those that the standard asks for.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(c: *mut c_void $(, $argument: $kind)*) -> c_int {
            // SAFETY: as above
            unsafe { $other(c $(, $argument)*) }
        }
    )*};
}

/// Getters and setters of types that no unit has.
macro_rules! no_variables {
    ($($get:ident, $set:ident: $kind:ty;)*) => {$(
        functions! {
            /// There are no variables of this type.
            fn $get(unit, _references: *const c_uint, count: usize, _values: *mut $kind, _value_count: usize) { none(unit, count) }
            /// There are no variables of this type.
            fn $set(unit, _references: *const c_uint, count: usize, _values: *const $kind, _value_count: usize) { none(unit, count) }
        }
    )*};
}

/// The version of the standard.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

unsafe fn made(
    name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    environment: *mut c_void,
    logger: Option<Logger3>,
) -> *mut c_void {
    // SAFETY: the texts are those that the standard asks for
    let (name, token, resources) = unsafe { (text(name), text(token), text(resources)) };
    let resources = PathBuf::from(resources);
    Unit::new(Made { name: &name, token: &token, resources, environment, logger: Logger::Three(logger) }).cast()
}

/// Makes an instance; null where the resources cannot be read.
///
/// # Safety
/// Pointers are those that the standard asks for.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateModelExchange(
    name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging: bool,
    environment: *mut c_void,
    logger: Option<Logger3>,
) -> *mut c_void {
    // SAFETY: as above
    unsafe { made(name, token, resources, environment, logger) }
}

/// Makes an instance; null where the resources cannot be read.
///
/// # Safety
/// Pointers are those that the standard asks for.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3InstantiateCoSimulation(
    name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging: bool,
    _event_mode: bool,
    _early_return: bool,
    _intermediate: *const c_uint,
    _intermediate_count: usize,
    environment: *mut c_void,
    logger: Option<Logger3>,
    _update: *const c_void,
) -> *mut c_void {
    // SAFETY: as above
    unsafe { made(name, token, resources, environment, logger) }
}

/// No unit is scheduled.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateScheduledExecution(
    _name: *const c_char,
    _token: *const c_char,
    _resources: *const c_char,
    _visible: bool,
    _logging: bool,
    _environment: *mut c_void,
    _logger: Option<Logger3>,
    _clock: *const c_void,
    _lock: *const c_void,
    _unlock: *const c_void,
) -> *mut c_void {
    std::ptr::null_mut()
}

/// Frees an instance.
///
/// # Safety
/// `c` is null, or came from an instantiation and is not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(c: *mut c_void) {
    // SAFETY: as above
    unsafe { fmi2FreeInstance(c) };
}

same! {
    /// States get their initial values.
    fn fmi3ExitInitializationMode() = fmi2ExitInitializationMode;
    /// Back to the values of the unit.
    fn fmi3Reset() = fmi2Reset;
    /// An event begins.
    fn fmi3EnterEventMode() = fmi2EnterEventMode;
    /// An event is over.
    fn fmi3EnterContinuousTimeMode() = fmi2EnterContinuousTimeMode;
    /// Copies the state of the instance.
    fn fmi3GetFMUState(state: *mut *mut c_void) = fmi2GetFMUstate;
    /// Goes back to a state.
    fn fmi3SetFMUState(state: *mut c_void) = fmi2SetFMUstate;
    /// Frees a state.
    fn fmi3FreeFMUState(state: *mut *mut c_void) = fmi2FreeFMUstate;
    /// Bytes of a state.
    fn fmi3SerializedFMUStateSize(state: *mut c_void, size: *mut usize) = fmi2SerializedFMUstateSize;
    /// A state as bytes.
    fn fmi3SerializeFMUState(state: *mut c_void, to: *mut c_char, size: usize) = fmi2SerializeFMUstate;
    /// A state from bytes.
    fn fmi3DeserializeFMUState(bytes: *const c_char, size: usize, state: *mut *mut c_void) = fmi2DeSerializeFMUstate;
    /// Moves the time.
    fn fmi3SetTime(time: f64) = fmi2SetTime;
    /// Sets the states.
    fn fmi3SetContinuousStates(x: *const f64, count: usize) = fmi2SetContinuousStates;
    /// Derivatives of the states.
    fn fmi3GetContinuousStateDerivatives(derivatives: *mut f64, count: usize) = fmi2GetDerivatives;
    /// Event indicators.
    fn fmi3GetEventIndicators(indicators: *mut f64, count: usize) = fmi2GetEventIndicators;
    /// The states.
    fn fmi3GetContinuousStates(x: *mut f64, count: usize) = fmi2GetContinuousStates;
    /// Sizes of the states: nothing is known of them.
    fn fmi3GetNominalsOfContinuousStates(nominals: *mut f64, count: usize) = fmi2GetNominalsOfContinuousStates;
}

functions! {
    /// Nothing is logged but errors.
    fn fmi3SetDebugLogging(_unit, _on: bool, _count: usize, _categories: *const *const c_char) { OK }
    /// Where the run begins.
    fn fmi3EnterInitializationMode(unit, defined: bool, tolerance: f64, start: f64, _stop_defined: bool, _stop: f64) {
        unit.instance.set_up(start, defined.then_some(tolerance));
        OK
    }
    /// Nothing has to be done.
    fn fmi3Terminate(_unit) { OK }
    /// Values of variables.
    fn fmi3GetFloat64(unit, references: *const c_uint, count: usize, values: *mut f64, value_count: usize) {
        let got = read(references, count).iter().zip(write(values, value_count)).try_for_each(|(r, value)| {
            unit.instance.get(*r).map(|found| *value = found)
        });
        unit.status(got)
    }
    /// Values of inputs and parameters.
    fn fmi3SetFloat64(unit, references: *const c_uint, count: usize, values: *const f64, value_count: usize) {
        let mut all = read(references, count).iter().zip(read(values, value_count));
        let set = all.try_for_each(|(r, value)| unit.instance.set(*r, *value));
        unit.status(set)
    }
    /// Exact derivatives in a direction.
    fn fmi3GetDirectionalDerivative(
        unit,
        unknowns: *const c_uint,
        unknown_count: usize,
        knowns: *const c_uint,
        known_count: usize,
        seed: *const f64,
        seed_count: usize,
        sensitivity: *mut f64,
        sensitivity_count: usize,
    ) {
        let (unknowns, knowns) = (read(unknowns, unknown_count), read(knowns, known_count));
        let (seed, out) = (read(seed, seed_count), write(sensitivity, sensitivity_count));
        let found = unit.instance.directional(unknowns, knowns, seed, out);
        unit.status(found)
    }
    /// Exact derivatives from the other side.
    fn fmi3GetAdjointDerivative(
        unit,
        unknowns: *const c_uint,
        unknown_count: usize,
        knowns: *const c_uint,
        known_count: usize,
        seed: *const f64,
        seed_count: usize,
        sensitivity: *mut f64,
        sensitivity_count: usize,
    ) {
        let (unknowns, knowns) = (read(unknowns, unknown_count), read(knowns, known_count));
        let (seed, out) = (read(seed, seed_count), write(sensitivity, sensitivity_count));
        let found = unit.instance.adjoint(unknowns, knowns, seed, out);
        unit.status(found)
    }
    /// There is nothing to configure.
    fn fmi3EnterConfigurationMode(_unit) { ERROR }
    /// There is nothing to configure.
    fn fmi3ExitConfigurationMode(_unit) { ERROR }
    /// There are no discrete states.
    fn fmi3EvaluateDiscreteStates(_unit) { OK }
    /// What an event changes.
    fn fmi3UpdateDiscreteStates(
        unit,
        again: *mut bool,
        terminate: *mut bool,
        nominals_changed: *mut bool,
        values_changed: *mut bool,
        next_defined: *mut bool,
        next: *mut f64,
    ) {
        let events = match unit.instance.update() {
            Ok(events) => events,
            Err(refused) => return unit.status::<()>(Err(refused)),
        };
        put(again, false);
        put(terminate, false);
        put(nominals_changed, false);
        put(values_changed, events.states_changed);
        put(next_defined, events.next.is_some());
        put(next, events.next.unwrap_or(0.0));
        OK
    }
    /// A step of the simulator is finished.
    fn fmi3CompletedIntegratorStep(unit, _no_set_before: bool, enter_event: *mut bool, terminate: *mut bool) {
        put(enter_event, false);
        put(terminate, false);
        let completed = unit.instance.completed_step();
        unit.status(completed)
    }
    /// How many event indicators there are.
    fn fmi3GetNumberOfEventIndicators(unit, count: *mut usize) {
        put(count, unit.instance.indicators());
        OK
    }
    /// How many states there are.
    fn fmi3GetNumberOfContinuousStates(unit, count: *mut usize) {
        put(count, unit.instance.states());
        OK
    }
    /// Steps may begin.
    fn fmi3EnterStepMode(_unit) { OK }
    /// Derivatives of outputs by time are not given.
    fn fmi3GetOutputDerivatives(
        unit,
        _references: *const c_uint,
        count: usize,
        _orders: *const i32,
        _values: *mut f64,
        _value_count: usize,
    ) { none(unit, count) }
    /// A step of a co-simulation.
    fn fmi3DoStep(
        unit,
        begins: f64,
        length: f64,
        _no_set_before: bool,
        event_needed: *mut bool,
        terminate: *mut bool,
        early_return: *mut bool,
        last_time: *mut f64,
    ) {
        let stepped = unit.instance.step(begins, length);
        put(event_needed, false);
        put(terminate, false);
        put(early_return, false);
        put(last_time, unit.instance.time());
        unit.status(stepped)
    }
    /// Dependencies do not change.
    fn fmi3GetNumberOfVariableDependencies(_unit, _reference: c_uint, _count: *mut usize) { ERROR }
    /// Dependencies do not change.
    fn fmi3GetVariableDependencies(
        _unit,
        _dependent: c_uint,
        _elements: *mut usize,
        _independents: *mut c_uint,
        _independent_elements: *mut usize,
        _kinds: *mut c_int,
        _count: usize,
    ) { ERROR }
    /// There is no binary variable.
    fn fmi3GetBinary(
        unit,
        _references: *const c_uint,
        count: usize,
        _sizes: *mut usize,
        _values: *mut *const u8,
        _value_count: usize,
    ) { none(unit, count) }
    /// There is no binary variable.
    fn fmi3SetBinary(
        unit,
        _references: *const c_uint,
        count: usize,
        _sizes: *const usize,
        _values: *const *const u8,
        _value_count: usize,
    ) { none(unit, count) }
    /// There is no clock.
    fn fmi3GetClock(unit, _references: *const c_uint, count: usize, _values: *mut bool) { none(unit, count) }
    /// There is no clock.
    fn fmi3SetClock(unit, _references: *const c_uint, count: usize, _values: *const bool) { none(unit, count) }
    /// There is no clock.
    fn fmi3GetIntervalDecimal(unit, _references: *const c_uint, count: usize, _intervals: *mut f64, _qualifiers: *mut c_int) { none(unit, count) }
    /// There is no clock.
    fn fmi3GetIntervalFraction(unit, _references: *const c_uint, count: usize, _counters: *mut u64, _resolutions: *mut u64, _qualifiers: *mut c_int) { none(unit, count) }
    /// There is no clock.
    fn fmi3GetShiftDecimal(unit, _references: *const c_uint, count: usize, _shifts: *mut f64) { none(unit, count) }
    /// There is no clock.
    fn fmi3GetShiftFraction(unit, _references: *const c_uint, count: usize, _counters: *mut u64, _resolutions: *mut u64) { none(unit, count) }
    /// There is no clock.
    fn fmi3SetIntervalDecimal(unit, _references: *const c_uint, count: usize, _intervals: *const f64) { none(unit, count) }
    /// There is no clock.
    fn fmi3SetIntervalFraction(unit, _references: *const c_uint, count: usize, _counters: *const u64, _resolutions: *const u64) { none(unit, count) }
    /// There is no clock.
    fn fmi3SetShiftDecimal(unit, _references: *const c_uint, count: usize, _shifts: *const f64) { none(unit, count) }
    /// There is no clock.
    fn fmi3SetShiftFraction(unit, _references: *const c_uint, count: usize, _counters: *const u64, _resolutions: *const u64) { none(unit, count) }
    /// No unit is scheduled.
    fn fmi3ActivateModelPartition(_unit, _clock: c_uint, _time: f64) { ERROR }
}

no_variables! {
    fmi3GetFloat32, fmi3SetFloat32: f32;
    fmi3GetInt8, fmi3SetInt8: i8;
    fmi3GetUInt8, fmi3SetUInt8: u8;
    fmi3GetInt16, fmi3SetInt16: i16;
    fmi3GetUInt16, fmi3SetUInt16: u16;
    fmi3GetInt32, fmi3SetInt32: i32;
    fmi3GetUInt32, fmi3SetUInt32: u32;
    fmi3GetInt64, fmi3SetInt64: i64;
    fmi3GetUInt64, fmi3SetUInt64: u64;
    fmi3GetBoolean, fmi3SetBoolean: bool;
    fmi3GetString, fmi3SetString: *const c_char;
}

/// Refuses variables of a type that no unit has.
fn none(unit: &Unit, count: usize) -> c_int {
    if count == 0 {
        return OK;
    }
    unit.say("all variables are of the type Float64, and have no such property");
    ERROR
}
