//! Elementary functions with the same bits on every machine, by the `libm` crate: for numbers that users compare between machines
//! (drawn noise, windows, records). The language has its own table of operations in `fdm_grammar::math`.

/// `sin x`, x in rad.
#[inline(never)]
pub fn sin(x: f64) -> f64 {
    libm::sin(x)
}

/// `cos x`, x in rad.
#[inline(never)]
pub fn cos(x: f64) -> f64 {
    libm::cos(x)
}

/// Exponential.
#[inline(never)]
pub fn exp(x: f64) -> f64 {
    libm::exp(x)
}

/// Natural logarithm; NaN below zero.
#[inline(never)]
pub fn log(x: f64) -> f64 {
    libm::log(x)
}

/// Arc sine, in radians.
#[inline]
pub fn asin(x: f64) -> f64 {
    libm::asin(x)
}

/// The angle of a point from the first axis, in radians.
#[inline]
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}
