//! The functions of a unit's library, as the standard declares them ([`Functions`]).

#![allow(unsafe_code, reason = "the functions of the standard take pointers")]

use crate::archive::Version;
use crate::description::Description;
use libloading::Library;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::mem::ManuallyDrop;
use std::path::Path;
use std::ptr::{null, null_mut};

/// An instance, as the library knows it.
type Handle = *mut c_void;
type Plain = unsafe extern "C" fn(Handle) -> c_int;
type SetTime = unsafe extern "C" fn(Handle, f64) -> c_int;
type Put = unsafe extern "C" fn(Handle, *const f64, usize) -> c_int;
type Take = unsafe extern "C" fn(Handle, *mut f64, usize) -> c_int;
type Logger2 = unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char);
type Logger3 = unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char);

/// fmi2CallbackFunctions
#[repr(C)]
struct Callbacks {
    logger: Logger2,
    allocate: unsafe extern "C" fn(usize, usize) -> *mut c_void,
    free: unsafe extern "C" fn(*mut c_void),
    finished: *const c_void,
    environment: *mut c_void,
}

// SAFETY: functions, and null pointers that nobody follows
unsafe impl Sync for Callbacks {}

unsafe extern "C" {
    fn calloc(count: usize, size: usize) -> *mut c_void;
    fn free(memory: *mut c_void);
}

/// For the whole life of the process: instances keep its address.
static CALLBACKS: Callbacks =
    Callbacks { logger: said2, allocate: calloc, free, finished: null(), environment: null_mut() };

thread_local! {
    /// What a unit said last on this thread.
    static SAID: RefCell<String> = const { RefCell::new(String::new()) };
}

/// The format of what a unit says; what follows is not put in.
unsafe extern "C" fn said2(_: *mut c_void, _: *const c_char, _: c_int, _: *const c_char, message: *const c_char) {
    // SAFETY: the standard promises a text with an end
    unsafe { keep(message) }
}

unsafe extern "C" fn said3(_: *mut c_void, _: c_int, _: *const c_char, message: *const c_char) {
    // SAFETY: as above
    unsafe { keep(message) }
}

unsafe fn keep(message: *const c_char) {
    if !message.is_null() {
        // SAFETY: it is no null pointer, and has an end
        let text = unsafe { CStr::from_ptr(message) }.to_string_lossy().trim().to_string();
        SAID.with_borrow_mut(|said| *said = text);
    }
}

/// fmi2EventInfo
#[repr(C)]
#[derive(Default)]
struct EventInfo {
    more: c_int,
    terminate: c_int,
    nominals: c_int,
    values: c_int,
    next_defined: c_int,
    next: f64,
}

/// What differs between the versions.
enum Own {
    Two {
        instantiate: unsafe extern "C" fn(
            *const c_char,
            c_int,
            *const c_char,
            *const c_char,
            *const Callbacks,
            c_int,
            c_int,
        ) -> Handle,
        set_up: unsafe extern "C" fn(Handle, c_int, f64, f64, c_int, f64) -> c_int,
        enter: Plain,
        set: unsafe extern "C" fn(Handle, *const u32, usize, *const f64) -> c_int,
        get: unsafe extern "C" fn(Handle, *const u32, usize, *mut f64) -> c_int,
        update: unsafe extern "C" fn(Handle, *mut EventInfo) -> c_int,
        along:
            Option<unsafe extern "C" fn(Handle, *const u32, usize, *const u32, usize, *const f64, *mut f64) -> c_int>,
        completed: Option<unsafe extern "C" fn(Handle, c_int, *mut c_int, *mut c_int) -> c_int>,
    },
    Three {
        instantiate: unsafe extern "C" fn(
            *const c_char,
            *const c_char,
            *const c_char,
            bool,
            bool,
            *mut c_void,
            Logger3,
        ) -> Handle,
        enter: unsafe extern "C" fn(Handle, bool, f64, f64, bool, f64) -> c_int,
        set: unsafe extern "C" fn(Handle, *const u32, usize, *const f64, usize) -> c_int,
        get: unsafe extern "C" fn(Handle, *const u32, usize, *mut f64, usize) -> c_int,
        update: unsafe extern "C" fn(Handle, *mut bool, *mut bool, *mut bool, *mut bool, *mut bool, *mut f64) -> c_int,
        #[allow(clippy::type_complexity, reason = "the standard's own arguments")]
        along: Option<
            unsafe extern "C" fn(
                Handle,
                *const u32,
                usize,
                *const u32,
                usize,
                *const f64,
                usize,
                *mut f64,
                usize,
            ) -> c_int,
        >,
        completed: Option<unsafe extern "C" fn(Handle, bool, *mut bool, *mut bool) -> c_int>,
    },
}

/// A loaded library.
pub(crate) struct Functions {
    own: Own,
    release: unsafe extern "C" fn(Handle),
    reset: Plain,
    leave: Plain,
    run: Plain,
    time: SetTime,
    put: Put,
    rates: Take,
    states: Take,
    indicators: Option<Take>,
    /// Never unloaded: many libraries do not survive it.
    _library: ManuallyDrop<Library>,
}

/// What a call said that came to nothing.
pub(crate) struct Refused {
    /// The function.
    pub(crate) function: &'static str,
    /// fmi2Status, fmi3Status
    pub(crate) status: c_int,
    /// What the unit said last.
    pub(crate) said: String,
}

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let status = match self.status {
            2 => "discard",
            3 => "error",
            _ => "fatal",
        };
        write!(f, "{} returned `{status}`", self.function)?;
        if self.said.is_empty() { Ok(()) } else { write!(f, ": {}", self.said) }
    }
}

/// After this an instance must not be touched.
const FATAL: c_int = 4;
/// Errors from here on; a warning is none.
const DISCARD: c_int = 2;

fn good(function: &'static str, status: c_int) -> Result<(), Refused> {
    if status < DISCARD {
        return Ok(());
    }
    Err(Refused { function, status, said: SAID.take() })
}

impl Functions {
    /// Loads a library. Its code runs from here on.
    pub(crate) fn load(path: &Path, version: Version, indicators: bool) -> Result<Self, String> {
        // SAFETY: the user names the unit in the model, as for a simulator, and the reference says that its code runs
        let library = unsafe { Library::new(path) }.map_err(|e| format!("its library cannot be loaded: {e}"))?;
        // SAFETY: the types are those that the standard declares for these names
        unsafe {
            let lacks = |name: &str| format!("its library has no function `{name}`");
            macro_rules! function {
                ($name:expr) => {
                    *library.get($name.as_bytes()).map_err(|_| lacks($name))?
                };
            }
            macro_rules! maybe {
                ($name:expr) => {
                    library.get($name.as_bytes()).ok().map(|f| *f)
                };
            }
            Ok(match version {
                Version::Two => Self {
                    own: Own::Two {
                        instantiate: function!("fmi2Instantiate"),
                        set_up: function!("fmi2SetupExperiment"),
                        enter: function!("fmi2EnterInitializationMode"),
                        set: function!("fmi2SetReal"),
                        get: function!("fmi2GetReal"),
                        update: function!("fmi2NewDiscreteStates"),
                        along: maybe!("fmi2GetDirectionalDerivative"),
                        completed: maybe!("fmi2CompletedIntegratorStep"),
                    },
                    release: function!("fmi2FreeInstance"),
                    reset: function!("fmi2Reset"),
                    leave: function!("fmi2ExitInitializationMode"),
                    run: function!("fmi2EnterContinuousTimeMode"),
                    time: function!("fmi2SetTime"),
                    put: function!("fmi2SetContinuousStates"),
                    rates: function!("fmi2GetDerivatives"),
                    states: function!("fmi2GetContinuousStates"),
                    indicators: if indicators { Some(function!("fmi2GetEventIndicators")) } else { None },
                    _library: ManuallyDrop::new(library),
                },
                Version::Three => Self {
                    own: Own::Three {
                        instantiate: function!("fmi3InstantiateModelExchange"),
                        enter: function!("fmi3EnterInitializationMode"),
                        set: function!("fmi3SetFloat64"),
                        get: function!("fmi3GetFloat64"),
                        update: function!("fmi3UpdateDiscreteStates"),
                        along: maybe!("fmi3GetDirectionalDerivative"),
                        completed: maybe!("fmi3CompletedIntegratorStep"),
                    },
                    release: function!("fmi3FreeInstance"),
                    reset: function!("fmi3Reset"),
                    leave: function!("fmi3ExitInitializationMode"),
                    run: function!("fmi3EnterContinuousTimeMode"),
                    time: function!("fmi3SetTime"),
                    put: function!("fmi3SetContinuousStates"),
                    rates: function!("fmi3GetContinuousStateDerivatives"),
                    states: function!("fmi3GetContinuousStates"),
                    indicators: if indicators { Some(function!("fmi3GetEventIndicators")) } else { None },
                    _library: ManuallyDrop::new(library),
                },
            })
        }
    }

    /// Whether it can differentiate.
    pub(crate) fn differentiates(&self) -> bool {
        matches!(self.own, Own::Two { along: Some(_), .. } | Own::Three { along: Some(_), .. })
    }

    /// Makes an instance; `resources` is a folder, with the separator at its end.
    pub(crate) fn instantiate(&self, description: &Description, resources: &str) -> Result<Raw<'_>, String> {
        let text = |text: &str| CString::new(text).unwrap_or_default();
        let (name, token) = (text(&description.identifier), text(&description.token));
        SAID.take();
        // SAFETY: texts live during the call; what it keeps of them it copies, as the standard says
        let handle = unsafe {
            match &self.own {
                Own::Two { instantiate, .. } => {
                    let address = text(&address(resources.trim_end_matches(['/', '\\'])));
                    instantiate(name.as_ptr(), 0, token.as_ptr(), address.as_ptr(), &raw const CALLBACKS, 0, 0)
                }
                Own::Three { instantiate, .. } => {
                    let folder = text(resources);
                    instantiate(name.as_ptr(), token.as_ptr(), folder.as_ptr(), false, false, null_mut(), said3)
                }
            }
        };
        if handle.is_null() {
            let said = SAID.take();
            let said = if said.is_empty() { "without a word".into() } else { said };
            return Err(format!("it made no instance: {said}"));
        }
        Ok(Raw { functions: self, handle, dead: false })
    }
}

/// A path as an address of a file.
fn address(path: &str) -> String {
    let mut text = String::from(if path.starts_with('/') { "file://" } else { "file:///" });
    for byte in path.bytes() {
        match byte {
            b'\\' => text.push('/'),
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'/' | b'-' | b'_' | b'.' | b'~' | b':' => {
                text.push(char::from(byte))
            }
            other => text.push_str(&format!("%{other:02X}")),
        }
    }
    text
}

/// What updating the discrete states brought.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Updated {
    pub(crate) more: bool,
    pub(crate) terminate: bool,
    pub(crate) next: Option<f64>,
}

/// An instance that is freed in the end. Calls belong to one thread at a time.
pub(crate) struct Raw<'a> {
    functions: &'a Functions,
    handle: Handle,
    /// After a fatal error nothing may be called any more.
    dead: bool,
}

impl Drop for Raw<'_> {
    fn drop(&mut self) {
        if !self.dead {
            // SAFETY: made by this library, and used by nobody behind this
            unsafe { (self.functions.release)(self.handle) }
        }
    }
}

// SAFETY (of all calls here): the handle is that of a living instance, arrays are as long as is said, and modes follow each other as the
// standard wants it: see `Instance`.
impl Raw<'_> {
    fn done(&mut self, function: &'static str, status: c_int) -> Result<(), Refused> {
        self.dead |= status >= FATAL;
        good(function, status)
    }

    pub(crate) fn reset(&mut self) -> Result<(), Refused> {
        let status = unsafe { (self.functions.reset)(self.handle) };
        self.done("Reset", status)
    }

    /// Begins to initialise; parameters are set before.
    pub(crate) fn enter(&mut self, start: f64) -> Result<(), Refused> {
        let status = match &self.functions.own {
            Own::Two { enter, .. } => unsafe { enter(self.handle) },
            Own::Three { enter, .. } => unsafe { enter(self.handle, false, 0.0, start, false, 0.0) },
        };
        self.done("EnterInitializationMode", status)
    }

    /// What 2.0 wants to know before anything is set.
    pub(crate) fn set_up(&mut self, start: f64) -> Result<(), Refused> {
        let status = match &self.functions.own {
            Own::Two { set_up, .. } => unsafe { set_up(self.handle, 0, 0.0, start, 0, 0.0) },
            Own::Three { .. } => 0,
        };
        self.done("SetupExperiment", status)
    }

    pub(crate) fn leave(&mut self) -> Result<(), Refused> {
        let status = unsafe { (self.functions.leave)(self.handle) };
        self.done("ExitInitializationMode", status)
    }

    pub(crate) fn update(&mut self) -> Result<Updated, Refused> {
        let (updated, status) = match &self.functions.own {
            Own::Two { update, .. } => {
                let mut info = EventInfo::default();
                let status = unsafe { update(self.handle, &raw mut info) };
                let next = (info.next_defined != 0).then_some(info.next);
                (Updated { more: info.more != 0, terminate: info.terminate != 0, next }, status)
            }
            Own::Three { update, .. } => {
                let mut flags = [false; 5];
                let mut next = 0.0;
                let status = unsafe {
                    let at = flags.as_mut_ptr();
                    update(self.handle, at, at.add(1), at.add(2), at.add(3), at.add(4), &raw mut next)
                };
                (Updated { more: flags[0], terminate: flags[1], next: flags[4].then_some(next) }, status)
            }
        };
        self.done("updating the discrete states", status)?;
        Ok(updated)
    }

    pub(crate) fn run(&mut self) -> Result<(), Refused> {
        let status = unsafe { (self.functions.run)(self.handle) };
        self.done("EnterContinuousTimeMode", status)
    }

    pub(crate) fn time(&mut self, t: f64) -> Result<(), Refused> {
        let status = unsafe { (self.functions.time)(self.handle, t) };
        self.done("SetTime", status)
    }

    pub(crate) fn put_states(&mut self, x: &[f64]) -> Result<(), Refused> {
        if x.is_empty() {
            return Ok(());
        }
        let status = unsafe { (self.functions.put)(self.handle, x.as_ptr(), x.len()) };
        self.done("SetContinuousStates", status)
    }

    pub(crate) fn take_states(&mut self, x: &mut [f64]) -> Result<(), Refused> {
        if x.is_empty() {
            return Ok(());
        }
        let status = unsafe { (self.functions.states)(self.handle, x.as_mut_ptr(), x.len()) };
        self.done("GetContinuousStates", status)
    }

    pub(crate) fn rates(&mut self, rates: &mut [f64]) -> Result<(), Refused> {
        if rates.is_empty() {
            return Ok(());
        }
        let status = unsafe { (self.functions.rates)(self.handle, rates.as_mut_ptr(), rates.len()) };
        self.done("the derivatives of the states", status)
    }

    pub(crate) fn indicators(&mut self, values: &mut [f64]) -> Result<(), Refused> {
        let Some(indicators) = self.functions.indicators.filter(|_| !values.is_empty()) else { return Ok(()) };
        let status = unsafe { indicators(self.handle, values.as_mut_ptr(), values.len()) };
        self.done("GetEventIndicators", status)
    }

    /// Says that a step of an integrator ended here.
    pub(crate) fn complete(&mut self) -> Result<(), Refused> {
        let status = match &self.functions.own {
            Own::Two { completed: Some(completed), .. } => {
                let mut flags = [0; 2];
                unsafe { completed(self.handle, 1, flags.as_mut_ptr(), flags.as_mut_ptr().add(1)) }
            }
            Own::Three { completed: Some(completed), .. } => {
                let mut flags = [false; 2];
                unsafe { completed(self.handle, true, flags.as_mut_ptr(), flags.as_mut_ptr().add(1)) }
            }
            _ => 0,
        };
        self.done("CompletedIntegratorStep", status)
    }

    pub(crate) fn set(&mut self, references: &[u32], values: &[f64]) -> Result<(), Refused> {
        if references.is_empty() {
            return Ok(());
        }
        let (r, v, count) = (references.as_ptr(), values[..references.len()].as_ptr(), references.len());
        let status = match &self.functions.own {
            Own::Two { set, .. } => unsafe { set(self.handle, r, count, v) },
            Own::Three { set, .. } => unsafe { set(self.handle, r, count, v, count) },
        };
        self.done("setting variables", status)
    }

    pub(crate) fn get(&mut self, references: &[u32], values: &mut [f64]) -> Result<(), Refused> {
        if references.is_empty() {
            return Ok(());
        }
        let (r, v, count) = (references.as_ptr(), values[..references.len()].as_mut_ptr(), references.len());
        let status = match &self.functions.own {
            Own::Two { get, .. } => unsafe { get(self.handle, r, count, v) },
            Own::Three { get, .. } => unsafe { get(self.handle, r, count, v, count) },
        };
        self.done("getting variables", status)
    }

    /// The derivatives of the unknowns by one known variable.
    pub(crate) fn along(&mut self, unknowns: &[u32], known: u32, out: &mut [f64]) -> Result<(), Refused> {
        if unknowns.is_empty() {
            return Ok(());
        }
        let (u, count, k, seed, o) =
            (unknowns.as_ptr(), unknowns.len(), &raw const known, &raw const ONE, out[..unknowns.len()].as_mut_ptr());
        let status = match &self.functions.own {
            Own::Two { along: Some(along), .. } => unsafe { along(self.handle, u, count, k, 1, seed, o) },
            Own::Three { along: Some(along), .. } => unsafe { along(self.handle, u, count, k, 1, seed, 1, o, count) },
            _ => DISCARD,
        };
        self.done("the directional derivative", status)
    }
}

static ONE: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::address;

    #[test]
    fn folders_become_addresses() {
        assert_eq!(address("/tmp/a b/ü%"), "file:///tmp/a%20b/%C3%BC%25");
        assert_eq!(address("C:\\a"), "file:///C:/a");
    }
}
