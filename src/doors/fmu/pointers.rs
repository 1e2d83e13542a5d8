//! What C hands over, as slices and texts.

use std::ffi::{CStr, c_char};

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
