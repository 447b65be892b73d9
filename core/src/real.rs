//! Every float function the core uses, in one place.
//!
//! The arithmetic contract (same bits on every machine) holds because nothing else in the core calls a
//! transcendental function: these forward to `libm`, compiled from the same source everywhere, and the rest
//! is IEEE `+ - * /` in written order. `f32::max` and `f32::min` leave the sign of a zero result to the
//! target, so [`larger`] and [`smaller`] replace them.

/// Mathematics: speed of light in vacuum, metres per second.
pub const SPEED_OF_LIGHT_M_S: f32 = 299_792_458.0;

/// Mathematics: 2 pi.
pub const TAU: f32 = core::f32::consts::TAU;

/// Square root, correctly rounded; NaN for negative arguments.
pub fn sqrt(x: f32) -> f32 {
    libm::sqrtf(x)
}

/// Natural exponential.
pub fn exp(x: f32) -> f32 {
    libm::expf(x)
}

/// exp(x) - 1, without loss of digits near 0.
pub fn expm1(x: f32) -> f32 {
    libm::expm1f(x)
}

/// Complement of the error function, 1 - erf(x).
pub fn erfc(x: f32) -> f32 {
    libm::erfcf(x)
}

/// Natural logarithm; NaN for negative arguments.
pub fn ln(x: f32) -> f32 {
    libm::logf(x)
}

/// Sine of an angle in radians.
pub fn sin(x: f32) -> f32 {
    libm::sinf(x)
}

/// Cosine of an angle in radians.
pub fn cos(x: f32) -> f32 {
    libm::cosf(x)
}

/// Largest integer not above `x`.
pub fn floor(x: f32) -> f32 {
    libm::floorf(x)
}

/// Absolute value: clears the sign bit.
pub fn abs(x: f32) -> f32 {
    libm::fabsf(x)
}

/// Whether `x` is a probability, but for rounding.
pub(crate) fn is_probability(x: f32) -> bool {
    (-1e-3..=1.001).contains(&x)
}

/// `a` where it is greater, else `b` (so `b` on equality and on NaN).
pub fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// `a` where it is less, else `b` (so `b` on equality and on NaN).
pub fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// `x` limited to `low..=high`; `low` for NaN.
pub fn limited(x: f32, low: f32, high: f32) -> f32 {
    smaller(larger(x, low), high)
}
