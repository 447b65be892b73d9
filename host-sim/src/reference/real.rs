//! The number type.
//!
//! Square roots and transcendental functions come from `libm` for both types, but for exponential, sine and cosine of `f32`, which are the
//! core's own (checked against double precision there): so the `f32` reference meets the very functions of the core. Everything else is
//! IEEE `+ - * /`. The three comparisons [`larger`], [`smaller`] and [`limited`] say which operand wins on equality and on NaN, which decides signs of zero.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A real number: `f32` to match the core, `f64` to see its errors.
pub trait Real:
    Copy
    + Debug
    + PartialEq
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;

    /// A constant or an input, both of which the core holds as `f32`.
    fn of(value: f32) -> Self;
    /// A count or an index, rounded where it has too many digits.
    fn of_count(count: usize) -> Self;
    /// The integer part, towards zero.
    fn whole(self) -> i64;
    /// The value in double precision.
    fn to_f64(self) -> f64;

    /// See [`sqrt`].
    fn square_root(self) -> Self;
    /// See [`exp`].
    fn exponential(self) -> Self;
    /// See [`exp_m1`].
    fn exponential_less_one(self) -> Self;
    /// See [`erfc`].
    fn complementary_error(self) -> Self;
    /// See [`ln`].
    fn logarithm(self) -> Self;
    /// See [`sin`].
    fn sine(self) -> Self;
    /// See [`cos`].
    fn cosine(self) -> Self;
    /// See [`floor`].
    fn rounded_down(self) -> Self;
    /// See [`abs`].
    fn magnitude(self) -> Self;
}

macro_rules! real {
    ($type:ty, $sqrt:ident, $exp:path, $expm1:ident, $erfc:ident, $ln:ident, $sin:path, $cos:path, $floor:ident, $abs:ident) => {
        impl Real for $type {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;

            fn of(value: f32) -> Self {
                Self::from(value)
            }
            fn of_count(count: usize) -> Self {
                count as Self
            }
            fn whole(self) -> i64 {
                self as i64
            }
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            fn square_root(self) -> Self {
                libm::$sqrt(self)
            }
            fn exponential(self) -> Self {
                $exp(self)
            }
            fn exponential_less_one(self) -> Self {
                libm::$expm1(self)
            }
            fn complementary_error(self) -> Self {
                libm::$erfc(self)
            }
            fn logarithm(self) -> Self {
                libm::$ln(self)
            }
            fn sine(self) -> Self {
                $sin(self)
            }
            fn cosine(self) -> Self {
                $cos(self)
            }
            fn rounded_down(self) -> Self {
                libm::$floor(self)
            }
            fn magnitude(self) -> Self {
                libm::$abs(self)
            }
        }
    };
}

real!(
    f32,
    sqrtf,
    cogmint_core::real::exp,
    expm1f,
    erfcf,
    logf,
    cogmint_core::real::sin,
    cogmint_core::real::cos,
    floorf,
    fabsf
);
real!(f64, sqrt, libm::exp, expm1, erfc, log, libm::sin, libm::cos, floor, fabs);

/// Square root.
pub fn sqrt<T: Real>(x: T) -> T {
    x.square_root()
}

/// Natural exponential.
pub fn exp<T: Real>(x: T) -> T {
    x.exponential()
}

/// Natural exponential less 1.
pub fn exp_m1<T: Real>(x: T) -> T {
    x.exponential_less_one()
}

/// Complement of the error function.
pub fn erfc<T: Real>(x: T) -> T {
    x.complementary_error()
}

/// Natural logarithm.
pub fn ln<T: Real>(x: T) -> T {
    x.logarithm()
}

/// ln of a product. Order: a logarithm is taken wherever the product has left 1e-12 to 1e12, and of the rest at last.
pub fn ln_product<T: Real>(factors: impl IntoIterator<Item = T>) -> T {
    let (least, most) = (T::of(1e-12), T::of(1e12));
    let (mut product, mut sum) = (T::ONE, T::ZERO);
    for factor in factors {
        product *= factor;
        let is_inside = product >= least && product <= most;
        if !is_inside {
            sum += ln(product);
            product = T::ONE;
        }
    }
    sum + ln(product)
}

/// Sine of an angle in radians.
pub fn sin<T: Real>(x: T) -> T {
    x.sine()
}

/// Cosine of an angle in radians.
pub fn cos<T: Real>(x: T) -> T {
    x.cosine()
}

/// Largest integer not above `x`.
pub fn floor<T: Real>(x: T) -> T {
    x.rounded_down()
}

/// Absolute value.
pub fn abs<T: Real>(x: T) -> T {
    x.magnitude()
}

/// `a` where it is greater, else `b`.
pub fn larger<T: Real>(a: T, b: T) -> T {
    if a > b { a } else { b }
}

/// `a` where it is less, else `b`.
pub fn smaller<T: Real>(a: T, b: T) -> T {
    if a < b { a } else { b }
}

/// `x` limited to `low..=high`.
pub fn limited<T: Real>(x: T, low: T, high: T) -> T {
    smaller(larger(x, low), high)
}

/// Pi, as the core rounds it.
pub fn pi<T: Real>() -> T {
    T::of(std::f32::consts::PI)
}

/// 2 pi, as the core rounds it.
pub fn tau<T: Real>() -> T {
    T::of(std::f32::consts::TAU)
}

/// Speed of light, metres per second, as the core rounds it.
pub fn speed_of_light<T: Real>() -> T {
    T::of(299_792_458.0)
}

/// The square of `x`.
pub fn square<T: Real>(x: T) -> T {
    x * x
}
