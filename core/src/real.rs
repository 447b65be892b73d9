//! Every float function the core uses, in one place.
//!
//! The arithmetic contract (same bits on every machine) holds because nothing else in the core calls a
//! transcendental function: these are `libm`'s, compiled from the same source everywhere, and the rest
//! is IEEE `+ - * /` in written order. Square root, exponential, sine and cosine are the core's own: on a Cortex-M4F those of `libm` take
//! twice the instructions, sine and cosine over ten times as many, in double precision, for which that has no hardware. `f32::max` and `f32::min` leave the sign of a zero result to the
//! target, so [`larger`] and [`smaller`] replace them.

/// Mathematics: speed of light in vacuum, metres per second.
pub const SPEED_OF_LIGHT_M_S: f32 = 299_792_458.0;

/// Mathematics: 2 pi.
pub const TAU: f32 = core::f32::consts::TAU;

/// Square root, correctly rounded; NaN for negative arguments.
///
/// Newton's steps for 1 / sqrt(x) and one of Heron's come within a unit in the last place; which neighbour is nearest is told by
/// the remainder x - y^2, exact in integers.
pub fn sqrt(x: f32) -> f32 {
    let bits = x.to_bits();
    if bits.wrapping_sub(LEAST_NORMAL) >= EXPONENT - LEAST_NORMAL {
        // Zero, subnormal, negative, infinite, NaN.
        return libm::sqrtf(x);
    }
    let half = 0.5 * x;
    let mut inverse = f32::from_bits(INVERSE_ROOT.wrapping_sub(bits >> 1));
    inverse *= 1.5 - half * inverse * inverse;
    inverse *= 1.5 - half * inverse * inverse;
    let root = x * inverse;
    let root = (root + 0.5 * inverse * (x - root * root)).to_bits();
    // x = m 2^(e - 150), y = q 2^(f - 150) in integers m and q: the remainder in units of (2^(f - 150))^2.
    let shift = (bits >> 23).wrapping_sub(2 * (root >> 23)).wrapping_add(150);
    let (m, q) = (mantissa(bits), mantissa(root));
    // It is of 25 bits: those above cancel.
    let remainder = m.wrapping_shl(shift).wrapping_sub(q.wrapping_mul(q)).cast_signed();
    // (q + 1/2)^2 - q^2 = q + 1/4, and (q - 1/2)^2 - q^2 = 1/4 - q.
    let above = u32::from(remainder > q.cast_signed());
    let below = u32::from(remainder <= -q.cast_signed());
    f32::from_bits(root.wrapping_add(above).wrapping_sub(below))
}

/// Mathematics: bits of the exponent of an `f32`.
const EXPONENT: u32 = 0x7f80_0000;
/// Mathematics: bits of the least normal number: the lowest bit of the exponent.
const LEAST_NORMAL: u32 = 0x0080_0000;
/// Mathematics: bits of about 2^(3 * 127 / 2), less half the bits of x: within 3.5 % of those of 1 / sqrt(x).
const INVERSE_ROOT: u32 = 0x5f37_5a86;

/// The digits of a normal number, with the leading one.
fn mantissa(bits: u32) -> u32 {
    bits & (LEAST_NORMAL - 1) | LEAST_NORMAL
}

/// Natural exponential, within 2 units in the last place.
pub fn exp(x: f32) -> f32 {
    // Guard: near both ends of the range, and of NaN, it is `libm`'s.
    if !(abs(x) <= 87.0) {
        return libm::expf(x);
    }
    let half = if x < 0.0 { -0.5 } else { 0.5 };
    let power = (x * core::f32::consts::LOG2_E + half) as i32;
    let [a, b] = LN_2;
    let number = power as f32;
    let r = x - number * a - number * b;
    // Least greatest relative error, 3e-9 ahead of rounding.
    let series =
        0.499_999_94 + r * (0.166_665_18 + r * (0.041_668_415 + r * (8.368_985e-3 + r * 1.381_397_6e-3)));
    let exponent = power.wrapping_add(127).cast_unsigned();
    f32::from_bits(exponent.wrapping_shl(23)) * (1.0 + (r + r * r * series))
}

/// Mathematics: ln 2 in two parts. The first has 10 digits: its products with powers are exact.
const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];

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

/// Sine of an angle in radians, within 2 units in the last place of the angle or the result, whichever is the greater.
pub fn sin(x: f32) -> f32 {
    let (quarter, rest) = quarters(x);
    of_quarter(quarter, rest)
}

/// Cosine of an angle in radians, as exact as [`sin`].
pub fn cos(x: f32) -> f32 {
    let (quarter, rest) = quarters(x);
    of_quarter(quarter.wrapping_add(1), rest)
}

/// Mathematics: pi / 2 in three parts. The first two have 11 digits: their products with numbers of quarters below 2^13 are exact.
const QUARTER_RAD: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];

/// An angle as the nearest number of quarters of a turn, of which two bits count, and the rest, radians.
fn quarters(x: f32) -> (i32, f32) {
    // Guard: beyond, the angle itself is given to a thousandth at best; NaN stays so.
    let x = if abs(x) <= 10_000.0 { x } else { of_one_turn(x - TAU * floor(x / TAU)) };
    let half = if x < 0.0 { -0.5 } else { 0.5 };
    let quarter = (x * (4.0 / TAU) + half) as i32;
    let [a, b, c] = QUARTER_RAD;
    let number = quarter as f32;
    (quarter, x - number * a - number * b - number * c)
}

/// What is left of an angle when whole turns were taken off; 0 where it was so large that nothing is, NaN of NaN.
fn of_one_turn(rest: f32) -> f32 {
    if abs(rest) > 7.0 { 0.0 } else { rest }
}

/// sin(`quarter` pi / 2 + `rest`) for |`rest`| <= pi / 4.
fn of_quarter(quarter: i32, rest: f32) -> f32 {
    // Least greatest relative errors of the functions, 4e-9 and 1e-10 ahead of rounding.
    let square = rest * rest;
    let value = if quarter & 1 == 0 {
        let series = -0.166_666_55 + square * (8.332_157e-3 + square * -1.951_464_7e-4);
        rest + rest * square * series
    } else {
        let series = 0.041_666_646 + square * (-1.388_731e-3 + square * 2.443_243_1e-5);
        1.0 - 0.5 * square + square * square * series
    };
    if quarter & 2 == 0 { value } else { -value }
}

/// ln of a product, factor by factor: one logarithm for as many of them as stay within range together. Factors from 1e-25 to 1e25.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LnProduct {
    product: f32,
    /// Of those before.
    sum: f32,
}

impl LnProduct {
    /// Of no factors.
    pub const ONE: Self = Self { product: 1.0, sum: 0.0 };

    /// With a factor more.
    pub fn times(&mut self, factor: f32) {
        self.product *= factor;
        // Guard: far enough from the ends of the range for any factor.
        if !(1e-12..=1e12).contains(&self.product) {
            self.sum += ln(self.product);
            self.product = 1.0;
        }
    }

    /// Its logarithm.
    pub fn ln(&self) -> f32 {
        self.sum + ln(self.product)
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn square_roots_are_those_of_the_machine() {
        // Every mantissa at exponents of both parities, at both ends of the range too, and what is no normal number.
        let binades = [1, 2, 126, 127, 128, 253, 254];
        let normal = binades.into_iter().flat_map(|exponent: u32| exponent << 23..(exponent + 1) << 23);
        let others = [0.0, -0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e-40, f32::from_bits(1)];
        for bits in normal.chain(others.map(f32::to_bits)) {
            let x = f32::from_bits(bits);
            let (own, machine) = (sqrt(x), x.sqrt());
            assert!(own.to_bits() == machine.to_bits() || own.is_nan() && machine.is_nan(), "{x:e}: {own:e}");
        }
    }

    #[test]
    fn exponentials_are_within_two_units_of_those_in_double_precision() {
        let mut worst = 0.0_f64;
        for n in -8_800_000..=8_800_000 {
            let x = n as f32 * 1e-5;
            let exact = f64::from(x).exp();
            let unit = (exact * f64::from(f32::EPSILON)).max(f64::from(f32::from_bits(1)));
            worst = worst.max((f64::from(exp(x)) - exact).abs() / unit);
        }
        std::println!("worst error of the exponential: {worst:.2} units in the last place");
        assert!(worst < 2.0, "{worst}");
        assert!(
            exp(0.0) == 1.0 && exp(-200.0) == 0.0 && exp(200.0) == f32::INFINITY && exp(f32::NAN).is_nan()
        );
        assert!(exp(f32::NEG_INFINITY) == 0.0 && exp(f32::INFINITY) == f32::INFINITY);
    }

    #[test]
    fn a_logarithm_of_a_product_is_the_sum_of_those_of_its_factors() {
        let mut state = 1_u64;
        let mut factor = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            10.0_f64.powf(50.0 * ((state >> 33) as f64 / 2.0_f64.powi(31) - 0.5)) as f32
        };
        for count in 0..200 {
            let (mut own, mut exact) = (LnProduct::ONE, 0.0);
            for _ in 0..count {
                let factor = factor();
                own.times(factor);
                exact += f64::from(factor).ln();
            }
            assert!((f64::from(own.ln()) - exact).abs() < 1e-5 * (10.0 + exact.abs()), "{count}: {exact}");
        }
    }

    #[test]
    fn sine_and_cosine_are_within_two_units_of_those_in_double_precision() {
        let angles = (-20_000_000..20_000_000).step_by(7).map(|n| n as f32 * 3.7e-7);
        let far = (0..200_000_u32).map(|n| (n as f32 - 100_000.0) * 0.1);
        let beyond = (1..1000_u32).map(|n| n as f32 * 1e6);
        let mut worst = 0.0_f64;
        for x in angles.chain(far).chain(beyond).chain([core::f32::consts::PI, 1e-20, 0.0, -0.0]) {
            let exact = f64::from(x);
            for (own, exact) in [(sin(x), exact.sin()), (cos(x), exact.cos())] {
                // A unit of the result; and what a unit of an angle beyond 1 rad makes of it.
                let unit =
                    (exact.abs() * f64::from(f32::EPSILON)).max(f64::from(abs(x) * f32::EPSILON) * 0.5);
                worst = worst.max((f64::from(own) - exact).abs() / unit.max(1e-30));
            }
        }
        std::println!("worst error of sine and cosine: {worst:.2} units in the last place");
        assert!(worst < 2.0, "{worst}");
        for x in [1e15, -1e20, f32::MAX] {
            assert!(abs(sin(x)) <= 1.0 && abs(cos(x)) <= 1.0, "{x}");
        }
        assert!(sin(f32::INFINITY).is_nan() && cos(f32::NAN).is_nan() && sin(-0.0) == 0.0);
    }
}
