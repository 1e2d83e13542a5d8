//! What both versions of the standard share: an instance with its logger ([`Unit`]).
//!
//! What C hands over, as slices and texts.

use fdm_exchange::fmu::{Instance, Refused, Resources, Snapshot};
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::{Path, PathBuf};

pub(crate) const OK: c_int = 0;
pub(crate) const ERROR: c_int = 3;

/// The logger of FMI 2.0: environment, name of the instance, status, category, format of the message, ...
pub(crate) type Logger2 = unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char, ...);
/// The logger of FMI 3.0: environment, status, category, message.
pub(crate) type Logger3 = unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char);

/// Where messages go.
pub(crate) enum Logger {
    Two(Option<Logger2>),
    Three(Option<Logger3>),
}

/// An instance as the simulator holds it.
pub(crate) struct Unit {
    pub(crate) instance: Instance,
    name: CString,
    environment: *mut c_void,
    logger: Logger,
}

/// What a unit is made of.
pub(crate) struct Made<'a> {
    pub(crate) name: &'a str,
    /// The token that the simulator read in the description.
    pub(crate) token: &'a str,
    pub(crate) resources: PathBuf,
    pub(crate) environment: *mut c_void,
    pub(crate) logger: Logger,
}

impl Unit {
    /// A unit of the model in its resources; null, and a message, where there is none.
    pub(crate) fn new(made: Made<'_>) -> *mut Self {
        let Made { name, token, resources, environment, logger } = made;
        let name = CString::new(name).unwrap_or_default();
        let (logged, environment) = (&logger, environment);
        match model(&resources, token) {
            Ok(instance) => Box::into_raw(Box::new(Self { instance, name, environment, logger })),
            Err(said) => {
                log(logged, environment, &name, &said);
                std::ptr::null_mut()
            }
        }
    }

    /// Says why something came to nothing.
    pub(crate) fn say(&self, message: &str) {
        log(&self.logger, self.environment, &self.name, message);
    }

    /// The status of a call; what went wrong is said.
    pub(crate) fn status<T>(&self, result: Result<T, Refused>) -> c_int {
        match result {
            Ok(_) => OK,
            Err(refused) => {
                self.say(&refused.to_string());
                ERROR
            }
        }
    }

    /// The bytes of a state.
    pub(crate) fn bytes(&self, state: &Snapshot) -> Vec<u8> {
        state.bytes().unwrap_or_default()
    }
}

/// Does something with an instance that a simulator holds.
///
/// # Safety
/// `c` is null, or came from an instantiation and is not freed.
pub(crate) unsafe fn with(c: *mut c_void, act: impl FnOnce(&mut Unit) -> c_int) -> c_int {
    // SAFETY: as above
    unsafe { c.cast::<Unit>().as_mut() }.map_or(ERROR, act)
}

/// Functions over an instance; each of the standard, with its arguments.
macro_rules! functions {
    ($($(#[$about:meta])* fn $name:ident($unit:ident $(, $argument:ident: $kind:ty)* $(,)?) $body:block)*) => {$(
        $(#[$about])*
        ///
        /// # Safety
        /// Pointers are those that the standard asks for.
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn $name(c: *mut c_void $(, $argument: $kind)*) -> c_int {
            // SAFETY: the instance and the arguments are those that the standard asks for
            unsafe { $crate::unit::with(c, |$unit| $body) }
        }
    )*};
}
pub(crate) use functions;

fn model(resources: &Path, token: &str) -> Result<Instance, String> {
    let model = Resources::read(resources).and_then(|r| r.model()).map_err(|e| e.to_string())?;
    let own = fdm_exchange::Stamp::of(&model).guid();
    if !token.is_empty() && token != own {
        return Err(format!("the description's token {token} is not that of the model in resources, {own}"));
    }
    Ok(Instance::new(&model))
}

fn log(logger: &Logger, environment: *mut c_void, name: &CString, message: &str) {
    let message = CString::new(message.replace('\0', " ")).unwrap_or_default();
    let category = c"logStatusError";
    match logger {
        // SAFETY: the simulator gave this function for this call; the message is an argument, never the format
        Logger::Two(Some(log)) => unsafe {
            log(environment, name.as_ptr(), ERROR, category.as_ptr(), c"%s".as_ptr(), message.as_ptr());
        },
        // SAFETY: as above
        Logger::Three(Some(log)) => unsafe { log(environment, ERROR, category.as_ptr(), message.as_ptr()) },
        _ => {}
    }
}

/// The folder that a URI of FMI 2.0 names: `file:///a%20b/resources`.
pub(crate) fn folder(uri: &str) -> PathBuf {
    let path = uri.strip_prefix("file:").unwrap_or(uri);
    // `file:/a`, `file:///a` and `file://host/a`
    let path = path.strip_prefix("//").map_or(path, |rest| rest.find('/').map_or(rest, |slash| &rest[slash..]));
    let (bytes, mut decoded) = (path.as_bytes(), Vec::with_capacity(path.len()));
    let mut k = 0;
    while k < bytes.len() {
        let hex = (bytes[k] == b'%').then(|| path.get(k + 1..k + 3)).flatten();
        match hex.and_then(|hex| u8::from_str_radix(hex, 16).ok()) {
            Some(byte) => {
                decoded.push(byte);
                k += 3;
            }
            None => {
                decoded.push(bytes[k]);
                k += 1;
            }
        }
    }
    let path = String::from_utf8_lossy(&decoded).into_owned();
    // `/C:/a` on Windows
    let drive = cfg!(windows) && path.starts_with('/') && path.as_bytes().get(2) == Some(&b':');
    PathBuf::from(if drive { &path[1..] } else { &path })
}

/// As many values as C says there are; none for a null pointer.
///
/// # Safety
/// `first` is null, or points to `count` values that live and are not written while the slice is used.
pub(crate) unsafe fn read<'a, T>(first: *const T, count: usize) -> &'a [T] {
    if first.is_null() || count == 0 {
        return &[];
    }
    // SAFETY: as above
    unsafe { std::slice::from_raw_parts(first, count) }
}

/// Values behind a pointer of C, to be written.
///
/// # Safety
/// `first` is null, or points to `count` values that live and are used by nobody else while the slice is.
pub(crate) unsafe fn write<'a, T>(first: *mut T, count: usize) -> &'a mut [T] {
    if first.is_null() || count == 0 {
        return &mut [];
    }
    // SAFETY: as above
    unsafe { std::slice::from_raw_parts_mut(first, count) }
}

/// Writes through a pointer that may be null.
///
/// # Safety
/// `to` is null, or may be written.
pub(crate) unsafe fn put<T>(to: *mut T, value: T) {
    if !to.is_null() {
        // SAFETY: as above
        unsafe { to.write(value) };
    }
}

/// A text of C; empty for a null pointer.
///
/// # Safety
/// `text` is null, or ends with 0.
pub(crate) unsafe fn text(text: *const c_char) -> String {
    if text.is_null() {
        return String::new();
    }
    // SAFETY: as above
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}
