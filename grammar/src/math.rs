//! The elementary functions: one place for the tape, the machine code, the generated Rust and constant folding.
//!
//! **In** numbers. **Out** numbers, the same bits on every machine: everything that hardware does not round
//! correctly comes from the `libm` crate in Rust, never from the system's C library.
//! **Never** contracts or reorders. **Start** anywhere.

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

/// `tan x`, x in rad.
#[inline(never)]
pub fn tan(x: f64) -> f64 {
    libm::tan(x)
}

/// Inverse sine in rad; NaN outside [-1, 1].
#[inline(never)]
pub fn asin(x: f64) -> f64 {
    libm::asin(x)
}

/// Inverse cosine in rad; NaN outside [-1, 1].
#[inline(never)]
pub fn acos(x: f64) -> f64 {
    libm::acos(x)
}

/// Inverse tangent in rad.
#[inline(never)]
pub fn atan(x: f64) -> f64 {
    libm::atan(x)
}

/// Angle of the point (x, y) in rad.
#[inline(never)]
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// Hyperbolic sine.
#[inline(never)]
pub fn sinh(x: f64) -> f64 {
    libm::sinh(x)
}

/// Hyperbolic cosine.
#[inline(never)]
pub fn cosh(x: f64) -> f64 {
    libm::cosh(x)
}

/// Hyperbolic tangent.
#[inline(never)]
pub fn tanh(x: f64) -> f64 {
    libm::tanh(x)
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

/// Logarithm to base 10; NaN below zero.
#[inline(never)]
pub fn log10(x: f64) -> f64 {
    libm::log10(x)
}

/// `x^y` for a real exponent.
#[inline(never)]
pub fn pow(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}

/// `sqrt(x^2 + y^2)` without overflow.
#[inline(never)]
pub fn hypot(x: f64, y: f64) -> f64 {
    libm::hypot(x, y)
}

/// Square root: correctly rounded by the hardware; NaN below zero.
#[inline(always)]
pub fn sqrt(x: f64) -> f64 {
    x.sqrt()
}

/// Absolute value.
#[inline(always)]
pub fn abs(x: f64) -> f64 {
    x.abs()
}

/// -1, 0 or 1; zero at zero (so that `x*sign(x)` is `abs(x)` everywhere), NaN for NaN.
#[inline(always)]
pub fn sign(x: f64) -> f64 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        x * 0.0
    }
}

/// The lesser; NaN when either is NaN (`f64::min` would hide it).
#[inline(always)]
pub fn min(a: f64, b: f64) -> f64 {
    if a <= b {
        a
    } else if b < a {
        b
    } else {
        a + b
    }
}

/// The greater; NaN when either is NaN (`f64::max` would hide it).
#[inline(always)]
pub fn max(a: f64, b: f64) -> f64 {
    if a >= b {
        a
    } else if b > a {
        b
    } else {
        a + b
    }
}

/// 1 where `a < b`, else 0.
#[inline(always)]
pub fn less(a: f64, b: f64) -> f64 {
    f64::from(u8::from(a < b))
}

/// 1 where `a <= b`, else 0.
#[inline(always)]
pub fn less_equal(a: f64, b: f64) -> f64 {
    f64::from(u8::from(a <= b))
}

/// 1 where `a == b`, else 0.
#[inline(always)]
pub fn equal(a: f64, b: f64) -> f64 {
    f64::from(u8::from(a == b))
}

/// `a` where the condition holds (is not zero), else `b`; a NaN condition chooses `a`, as in IEEE `!=`.
#[inline(always)]
pub fn select(condition: f64, a: f64, b: f64) -> f64 {
    if condition != 0.0 { a } else { b }
}
