//! The functions of `cogmint_core::real` beside the approximations of `micromath`: instructions per call, and the worst error against
//! `libm` in double precision. `tests/math_on_target.sh` runs it and prints the table.

#![no_std]
#![no_main]

use cogmint_board::host::{self, Fault, Line};
use cogmint_board::meter::instructions;
use cogmint_core::real;
use core::hint::black_box;
use cortex_m_rt::entry;
use micromath::F32Ext;

/// Arguments of each function, evenly spaced over its range.
const ARGUMENTS: u16 = 4000;

/// What an error is a share of.
#[derive(Clone, Copy)]
enum Error {
    /// Of 1.
    Absolute,
    /// Of the value.
    Relative,
}

#[entry]
fn main() -> ! {
    host::end(run())
}

fn run() -> Result<(), Fault> {
    let whole_turns = [-7.0, 7.0];
    row(b"sqrt", [1e-6, 1e4], Error::Relative, real::sqrt, F32Ext::sqrt, libm::sqrt)?;
    row(b"exp", [-30.0, 0.0], Error::Relative, real::exp, F32Ext::exp, libm::exp)?;
    row(b"expm1", [-2.0, 0.0], Error::Relative, real::expm1, |x| F32Ext::exp(x) - 1.0, libm::expm1)?;
    row(b"ln", [1e-3, 1e3], Error::Absolute, real::ln, F32Ext::ln, libm::log)?;
    row(b"sin", whole_turns, Error::Absolute, real::sin, F32Ext::sin, libm::sin)?;
    row(b"cos", whole_turns, Error::Absolute, real::cos, F32Ext::cos, libm::cos)?;
    row(b"floor", [-1e3, 1e3], Error::Absolute, real::floor, F32Ext::floor, libm::floor)
}

/// Measures both, and prints a line: of each the instructions of all calls, and the worst error in parts of a billion.
#[inline(always)] // so that the functions are those, and no pointers
fn row(
    name: &[u8],
    range: [f32; 2],
    of: Error,
    own: impl Fn(f32) -> f32,
    fast: impl Fn(f32) -> f32,
    exact: impl Fn(f64) -> f64,
) -> Result<(), Fault> {
    let (nothing, _) = instructions(|| all(range, |x| x))?;
    let (own_count, _) = instructions(|| all(range, &own))?;
    let (fast_count, _) = instructions(|| all(range, &fast))?;
    Line::new()
        .text(name)
        .text(b" calls ")
        .decimal(u32::from(ARGUMENTS))
        .text(b" loop ")
        .instructions(nothing)
        .text(b" real ")
        .instructions(own_count)
        .text(b" ")
        .decimal(worst(range, of, &own, &exact))
        .text(b" micromath ")
        .instructions(fast_count)
        .text(b" ")
        .decimal(worst(range, of, &fast, &exact))
        .end();
    Ok(())
}

fn arguments([from, to]: [f32; 2]) -> impl Iterator<Item = f32> {
    let step = (to - from) / f32::from(ARGUMENTS - 1);
    (0..ARGUMENTS).map(move |n| from + step * f32::from(n))
}

/// Calls a function with all arguments, for its time.
#[inline(always)]
fn all(range: [f32; 2], function: impl Fn(f32) -> f32) {
    for x in arguments(range) {
        black_box(function(black_box(x)));
    }
}

/// The worst error, parts of a billion.
#[inline(never)]
fn worst(range: [f32; 2], of: Error, function: impl Fn(f32) -> f32, exact: impl Fn(f64) -> f64) -> u32 {
    let mut worst = 0.0_f64;
    for x in arguments(range) {
        let exact = exact(f64::from(x));
        let error = f64::from(function(x)) - exact;
        let share = match of {
            Error::Absolute => error,
            Error::Relative => error / exact,
        };
        let share = if share < 0.0 { -share } else { share };
        // Where the value is 0, so is the error.
        worst = if share > worst { share } else { worst };
    }
    (1e9 * worst) as u32
}
