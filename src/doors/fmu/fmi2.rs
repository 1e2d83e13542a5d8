//! The functions of FMI 2.0.

use crate::unit::{ERROR, Logger, Logger2, Made, OK, Unit, folder, functions};
use crate::unit::{put, read, text, write};
use fdm_exchange::fmu::Snapshot;
use std::ffi::{c_char, c_int, c_uint, c_void};

/// fmi2Boolean, which is an `int`.
type Bool = c_int;

/// fmi2CallbackFunctions
#[repr(C)]
#[derive(Debug)]
pub struct Callbacks {
    logger: Option<Logger2>,
    allocate_memory: Option<unsafe extern "C" fn(usize, usize) -> *mut c_void>,
    free_memory: Option<unsafe extern "C" fn(*mut c_void)>,
    step_finished: Option<unsafe extern "C" fn(*mut c_void, c_int)>,
    environment: *mut c_void,
}

/// fmi2EventInfo
#[repr(C)]
#[derive(Debug)]
pub struct EventInfo {
    new_discrete_states_needed: Bool,
    terminate_simulation: Bool,
    nominals_changed: Bool,
    values_changed: Bool,
    next_event_time_defined: Bool,
    next_event_time: f64,
}

/// The platform's types.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

/// The version of the standard.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

/// Makes an instance; null where the resources cannot be read.
///
/// # Safety
/// Pointers are those that the standard asks for.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2Instantiate(
    name: *const c_char,
    _kind: c_int,
    guid: *const c_char,
    resources: *const c_char,
    callbacks: *const Callbacks,
    _visible: Bool,
    _logging: Bool,
) -> *mut c_void {
    // SAFETY: as above
    let (name, token, resources, callbacks) = unsafe { (text(name), text(guid), text(resources), callbacks.as_ref()) };
    let made = Made {
        name: &name,
        token: &token,
        resources: folder(&resources),
        environment: callbacks.map_or(std::ptr::null_mut(), |c| c.environment),
        logger: Logger::Two(callbacks.and_then(|c| c.logger)),
    };
    Unit::new(made).cast()
}

/// Frees an instance.
///
/// # Safety
/// `c` is null, or came from `fmi2Instantiate` and is not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi2FreeInstance(c: *mut c_void) {
    if !c.is_null() {
        // SAFETY: as above
        drop(unsafe { Box::from_raw(c.cast::<Unit>()) });
    }
}

functions! {
    /// Nothing is logged but errors.
    fn fmi2SetDebugLogging(_unit, _on: Bool, _count: usize, _categories: *const *const c_char) { OK }
    /// Where the run begins.
    fn fmi2SetupExperiment(unit, defined: Bool, tolerance: f64, start: f64, _stop_defined: Bool, _stop: f64) {
        unit.instance.set_up(start, (defined != 0).then_some(tolerance));
        OK
    }
    /// Nothing has to be done.
    fn fmi2EnterInitializationMode(_unit) { OK }
    /// States get their initial values.
    fn fmi2ExitInitializationMode(unit) {
        let begun = unit.instance.begin();
        unit.status(begun)
    }
    /// Nothing has to be done.
    fn fmi2Terminate(_unit) { OK }
    /// Back to the values of the unit.
    fn fmi2Reset(unit) {
        unit.instance.reset();
        OK
    }
    /// Values of variables.
    fn fmi2GetReal(unit, references: *const c_uint, count: usize, values: *mut f64) {
        let got = read(references, count).iter().zip(write(values, count)).try_for_each(|(r, value)| {
            unit.instance.get(*r).map(|found| *value = found)
        });
        unit.status(got)
    }
    /// Values of inputs and parameters.
    fn fmi2SetReal(unit, references: *const c_uint, count: usize, values: *const f64) {
        let mut all = read(references, count).iter().zip(read(values, count));
        let set = all.try_for_each(|(r, value)| unit.instance.set(*r, *value));
        unit.status(set)
    }
    /// There are no integers.
    fn fmi2GetInteger(unit, references: *const c_uint, count: usize, _values: *mut c_int) { none(unit, references, count) }
    /// There are no Booleans.
    fn fmi2GetBoolean(unit, references: *const c_uint, count: usize, _values: *mut Bool) { none(unit, references, count) }
    /// There are no strings.
    fn fmi2GetString(unit, references: *const c_uint, count: usize, _values: *mut *const c_char) { none(unit, references, count) }
    /// There are no integers.
    fn fmi2SetInteger(unit, references: *const c_uint, count: usize, _values: *const c_int) { none(unit, references, count) }
    /// There are no Booleans.
    fn fmi2SetBoolean(unit, references: *const c_uint, count: usize, _values: *const Bool) { none(unit, references, count) }
    /// There are no strings.
    fn fmi2SetString(unit, references: *const c_uint, count: usize, _values: *const *const c_char) { none(unit, references, count) }
    /// Copies the state of the instance.
    fn fmi2GetFMUstate(unit, state: *mut *mut c_void) {
        if let Some(old) = state.as_mut().filter(|old| !old.is_null()) {
            // SAFETY: a state that is handed in is one of ours, to be used again
            *old.cast::<Snapshot>() = unit.instance.snapshot();
        } else {
            put(state, Box::into_raw(Box::new(unit.instance.snapshot())).cast());
        }
        OK
    }
    /// Goes back to a state.
    fn fmi2SetFMUstate(unit, state: *mut c_void) {
        let restored = state.cast::<Snapshot>().as_ref().map(|state| unit.instance.restore(state));
        restored.map_or(ERROR, |restored| unit.status(restored))
    }
    /// Frees a state.
    fn fmi2FreeFMUstate(_unit, state: *mut *mut c_void) {
        if let Some(old) = state.as_mut().filter(|old| !old.is_null()) {
            drop(Box::from_raw(old.cast::<Snapshot>()));
            *old = std::ptr::null_mut();
        }
        OK
    }
    /// Bytes of a state.
    fn fmi2SerializedFMUstateSize(unit, state: *mut c_void, size: *mut usize) {
        let Some(state) = state.cast::<Snapshot>().as_ref() else { return ERROR };
        put(size, unit.bytes(state).len());
        OK
    }
    /// A state as bytes.
    fn fmi2SerializeFMUstate(unit, state: *mut c_void, to: *mut c_char, size: usize) {
        let Some(state) = state.cast::<Snapshot>().as_ref() else { return ERROR };
        let bytes = unit.bytes(state);
        let to = write(to.cast::<u8>(), size);
        if to.len() < bytes.len() {
            return ERROR;
        }
        to[..bytes.len()].copy_from_slice(&bytes);
        OK
    }
    /// A state from bytes.
    fn fmi2DeSerializeFMUstate(unit, bytes: *const c_char, size: usize, state: *mut *mut c_void) {
        match Snapshot::from_bytes(read(bytes.cast::<u8>(), size)) {
            Ok(found) => {
                put(state, Box::into_raw(Box::new(found)).cast());
                OK
            }
            Err(refused) => unit.status::<()>(Err(refused)),
        }
    }
    /// Exact derivatives in a direction.
    fn fmi2GetDirectionalDerivative(
        unit,
        unknowns: *const c_uint,
        unknown_count: usize,
        knowns: *const c_uint,
        known_count: usize,
        seed: *const f64,
        sensitivity: *mut f64,
    ) {
        let (unknowns, knowns) = (read(unknowns, unknown_count), read(knowns, known_count));
        let (seed, out) = (read(seed, known_count), write(sensitivity, unknown_count));
        let found = unit.instance.directional(unknowns, knowns, seed, out);
        unit.status(found)
    }
    /// An event begins.
    fn fmi2EnterEventMode(unit) {
        let entered = unit.instance.enter_event();
        unit.status(entered)
    }
    /// What the event changes.
    fn fmi2NewDiscreteStates(unit, info: *mut EventInfo) {
        let events = match unit.instance.update() {
            Ok(events) => events,
            Err(refused) => return unit.status::<()>(Err(refused)),
        };
        put(info, EventInfo {
            new_discrete_states_needed: 0,
            terminate_simulation: 0,
            nominals_changed: 0,
            values_changed: Bool::from(events.states_changed),
            next_event_time_defined: Bool::from(events.next.is_some()),
            next_event_time: events.next.unwrap_or(0.0),
        });
        OK
    }
    /// An event is over.
    fn fmi2EnterContinuousTimeMode(unit) {
        let entered = unit.instance.enter_continuous();
        unit.status(entered)
    }
    /// A step of the simulator is finished.
    fn fmi2CompletedIntegratorStep(unit, _no_set_before: Bool, enter_event: *mut Bool, terminate: *mut Bool) {
        put(enter_event, 0);
        put(terminate, 0);
        let completed = unit.instance.completed_step();
        unit.status(completed)
    }
    /// Moves the time.
    fn fmi2SetTime(unit, time: f64) {
        unit.instance.set_time(time);
        OK
    }
    /// Sets the states.
    fn fmi2SetContinuousStates(unit, x: *const f64, count: usize) {
        let set = unit.instance.set_states(read(x, count));
        unit.status(set)
    }
    /// Derivatives of the states.
    fn fmi2GetDerivatives(unit, derivatives: *mut f64, count: usize) {
        let out = write(derivatives, count);
        let found = unit.instance.rates().map(|rates| out.iter_mut().zip(rates).for_each(|(to, rate)| *to = *rate));
        unit.status(found)
    }
    /// Event indicators.
    fn fmi2GetEventIndicators(unit, indicators: *mut f64, count: usize) {
        let found = unit.instance.all_indicators(write(indicators, count));
        unit.status(found)
    }
    /// The states.
    fn fmi2GetContinuousStates(unit, x: *mut f64, count: usize) {
        write(x, count).iter_mut().zip(unit.instance.state_values()).for_each(|(to, x)| *to = *x);
        OK
    }
    /// Sizes of the states: nothing is known of them.
    fn fmi2GetNominalsOfContinuousStates(_unit, nominals: *mut f64, count: usize) {
        write(nominals, count).fill(1.0);
        OK
    }
    /// How fast inputs move in the next step; of the first order.
    fn fmi2SetRealInputDerivatives(
        unit,
        references: *const c_uint,
        count: usize,
        orders: *const c_int,
        values: *const f64,
    ) {
        for ((reference, order), value) in read(references, count).iter().zip(read(orders, count)).zip(read(values, count)) {
            if *order != 1 && *value != 0.0 {
                unit.say("inputs are interpolated by their first derivative: one of a higher order is not used");
                return ERROR;
            }
            if *order == 1
                && let Err(refused) = unit.instance.set_slope(*reference, *value)
            {
                return unit.status::<()>(Err(refused));
            }
        }
        OK
    }
    /// Derivatives of outputs by time are not given.
    fn fmi2GetRealOutputDerivatives(
        unit,
        references: *const c_uint,
        count: usize,
        _orders: *const c_int,
        _values: *mut f64,
    ) { none(unit, references, count) }
    /// A step of a co-simulation.
    fn fmi2DoStep(unit, begins: f64, length: f64, _no_set_before: Bool) {
        let stepped = unit.instance.step(begins, length);
        unit.status(stepped)
    }
    /// Steps are done at once: there is nothing to cancel.
    fn fmi2CancelStep(_unit) { ERROR }
    /// Steps are done at once.
    fn fmi2GetStatus(_unit, _kind: c_int, status: *mut c_int) {
        put(status, OK);
        OK
    }
    /// The time to which all went well.
    fn fmi2GetRealStatus(unit, _kind: c_int, value: *mut f64) {
        put(value, unit.instance.time());
        OK
    }
    /// There is none.
    fn fmi2GetIntegerStatus(_unit, _kind: c_int, value: *mut c_int) {
        put(value, 0);
        ERROR
    }
    /// The unit never ends a run.
    fn fmi2GetBooleanStatus(_unit, _kind: c_int, value: *mut Bool) {
        put(value, 0);
        OK
    }
    /// There is none.
    fn fmi2GetStringStatus(_unit, _kind: c_int, value: *mut *const c_char) {
        put(value, c"".as_ptr());
        ERROR
    }
}

/// Refuses variables of a type that no unit has.
unsafe fn none(unit: &Unit, _references: *const c_uint, count: usize) -> c_int {
    if count == 0 {
        return OK;
    }
    unit.say("all variables are of the type Real, and have no such property");
    ERROR
}
