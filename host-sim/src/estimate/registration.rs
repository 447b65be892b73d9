//! Registration of repeated responses: how far each one is shifted against all others.
//!
//! A link at rest gives the same response again and again, up to a phase and a shift: the radio locks onto each frame
//! anew. The shift that makes all of a response agree best with the mean of its repetitions does not depend on where
//! anybody sees a first path. So it shows how far first paths scatter, the radio's as well as ours, to the few
//! millimetres that a whole response is worth.

use rustfft::FftPlanner;
use rustfft::num_complex::Complex64;
use std::f64::consts::TAU;

/// How much of a response is compared: so long before and after the point where it is expected, seconds.
const BEFORE_S: f64 = 40e-9;
const AFTER_S: f64 = 160e-9;
/// Shifts are sought this far to either side in each round, in steps of this, samples.
const REACH: f64 = 1.0;
const STEP: f64 = 0.02;
const ROUNDS: usize = 8;
/// Rounds of the mean's own phases.
const PHASE_ROUNDS: usize = 5;

/// Where a response lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registered {
    /// Position in the frame, samples, of the point that is the same in all responses.
    pub position: f64,
    /// Correlation with the mean of all, 0 to 1.
    pub likeness: f64,
}

/// A response: its samples, and where in it the point that all share is expected, samples.
pub type Response<'a> = (&'a [[f32; 2]], f64);

/// Registers responses with one another; each must have some energy around its expected point.
pub fn register(responses: &[Response<'_>], spacing_s: f64) -> Vec<Registered> {
    let before = (BEFORE_S / spacing_s).round() as i64;
    let length = before + (AFTER_S / spacing_s).round() as i64;
    let fft = FftPlanner::new().plan_fft_forward(length as usize);
    let mut positions: Vec<f64> = responses.iter().map(|(_, expected)| *expected).collect();
    let starts: Vec<i64> = positions.iter().map(|expected| expected.floor() as i64 - before).collect();
    let spectra: Vec<Vec<Complex64>> = responses
        .iter()
        .zip(&starts)
        .map(|((samples, _), start)| {
            let mut spectrum: Vec<Complex64> = (*start..start + length)
                .map(|n| usize::try_from(n).ok().and_then(|n| samples.get(n)).copied().unwrap_or_default())
                .map(|[re, im]| Complex64::new(re.into(), im.into()))
                .collect();
            fft.process(&mut spectrum);
            normalise(&mut spectrum);
            spectrum
        })
        .collect();
    let half = length / 2;
    // Angular frequency per sample of every point.
    let turns: Vec<f64> = (0..length)
        .map(|point| if point <= half { point } else { point - length })
        .map(|point| TAU * point as f64 / length as f64)
        .collect();
    let mut mean = Vec::new();
    let mut likeness = vec![0.0; responses.len()];
    for _ in 0..ROUNDS {
        let shifted: Vec<Vec<Complex64>> = spectra
            .iter()
            .zip(&positions)
            .zip(&starts)
            .map(|((spectrum, position), start)| advanced(spectrum, &turns, position - *start as f64))
            .collect();
        mean = mean_of(&shifted, &mean);
        let mut furthest = 0.0_f64;
        for ((shifted, position), likeness) in shifted.iter().zip(&mut positions).zip(&mut likeness) {
            let (shift, best) = best_shift(shifted, &mean, &turns);
            *position += shift;
            *likeness = best;
            furthest = furthest.max(shift.abs());
        }
        if furthest < 1e-3 {
            break;
        }
    }
    positions
        .into_iter()
        .zip(likeness)
        .map(|(position, likeness)| Registered { position, likeness })
        .collect()
}

/// The spectrum of what comes `samples` later.
fn advanced(spectrum: &[Complex64], turns: &[f64], samples: f64) -> Vec<Complex64> {
    spectrum
        .iter()
        .zip(turns)
        .map(|(value, turn)| value * Complex64::from_polar(1.0, turn * samples))
        .collect()
}

fn normalise(spectrum: &mut [Complex64]) {
    let energy: f64 = spectrum.iter().map(Complex64::norm_sqr).sum();
    if energy > 0.0 {
        spectrum.iter_mut().for_each(|value| *value /= energy.sqrt());
    }
}

fn correlation(a: &[Complex64], b: &[Complex64]) -> Complex64 {
    a.iter().zip(b).map(|(a, b)| a * b.conj()).sum()
}

/// The mean of responses whose phases are unknown, beginning with a guess of it; without one, with the first.
fn mean_of(responses: &[Vec<Complex64>], guess: &[Complex64]) -> Vec<Complex64> {
    let mut mean =
        if guess.is_empty() { responses.first().cloned().unwrap_or_default() } else { guess.to_vec() };
    for _ in 0..PHASE_ROUNDS {
        let mut sum = vec![Complex64::default(); mean.len()];
        for response in responses {
            let agreement = correlation(&mean, response);
            let turn =
                if agreement.norm() > 0.0 { agreement / agreement.norm() } else { Complex64::new(1.0, 0.0) };
            for (sum, value) in sum.iter_mut().zip(response) {
                *sum += turn * value;
            }
        }
        normalise(&mut sum);
        mean = sum;
    }
    mean
}

/// By how many samples later a response agrees best with the mean, and how well.
fn best_shift(response: &[Complex64], mean: &[Complex64], turns: &[f64]) -> (f64, f64) {
    let products: Vec<Complex64> = response.iter().zip(mean).map(|(a, b)| a * b.conj()).collect();
    let steps = (2.0 * REACH / STEP).round() as usize;
    let shift_of = |step: usize| step as f64 * STEP - REACH;
    let agreement: Vec<f64> = (0..=steps)
        .map(|step| {
            let shift = shift_of(step);
            let sum: Complex64 = products
                .iter()
                .zip(turns)
                .map(|(product, turn)| product * Complex64::from_polar(1.0, turn * shift))
                .sum();
            sum.norm()
        })
        .collect();
    let best = (1..steps).max_by(|&a, &b| agreement[a].total_cmp(&agreement[b])).unwrap_or(steps / 2);
    let (left, here, right) = (agreement[best - 1], agreement[best], agreement[best + 1]);
    let curvature = left - 2.0 * here + right;
    let vertex = if curvature < 0.0 { (0.5 * (left - right) / curvature).clamp(-1.0, 1.0) } else { 0.0 };
    (shift_of(best) + vertex * STEP, here)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three pulses, band-limited, at a shift of their own, turned by a phase.
    fn response(shift: f64, phase: f64) -> Vec<[f32; 2]> {
        let pulse = |t: f64| {
            let x = 0.5 * t;
            let sinc = if x.abs() < 1e-9 { 1.0 } else { (0.5 * TAU * x).sin() / (0.5 * TAU * x) };
            sinc * (-(t / 6.0).powi(2)).exp()
        };
        (0..400)
            .map(|n| {
                let t = f64::from(n) - 100.0 - shift;
                let paths = [(0.0, 1.0, 0.0), (5.3, 0.8, 2.0), (17.9, 0.5, 4.0)];
                let sum: Complex64 = paths
                    .iter()
                    .map(|(delay, magnitude, turn)| {
                        Complex64::from_polar(magnitude * pulse(t - delay), *turn)
                    })
                    .sum();
                let turned = sum * Complex64::from_polar(1.0, phase);
                [turned.re as f32, turned.im as f32]
            })
            .collect()
    }

    #[test]
    fn shifts_are_found_whatever_the_phases_and_the_expectation() {
        let shifts = [0.0, 0.31, -0.48, 3.9, 7.25];
        let responses: Vec<_> =
            shifts.iter().enumerate().map(|(n, shift)| response(*shift, 1.7 * n as f64)).collect();
        // Expected somewhere within half a sample of where they are.
        let expected = [99.8, 100.7, 99.4, 104.0, 107.0];
        let input: Vec<Response<'_>> =
            responses.iter().zip(expected).map(|(samples, at)| (samples.as_slice(), at)).collect();
        let registered = register(&input, 1e-9);
        let origin = registered[0].position - shifts[0];
        for (found, shift) in registered.iter().zip(shifts) {
            assert!((found.position - origin - shift).abs() < 2e-3, "{found:?}, {shift}");
            assert!(found.likeness > 0.999);
        }
    }

    #[test]
    fn a_response_that_is_unlike_the_others_says_so() {
        let mut responses: Vec<_> = (0..6).map(|n| response(0.1 * f64::from(n), 0.0)).collect();
        let other: Vec<[f32; 2]> =
            (0..400).map(|n| [((n * n) as f32).sin(), (n as f32 * 1.3).cos()]).collect();
        responses.push(other);
        let input: Vec<Response<'_>> = responses.iter().map(|samples| (samples.as_slice(), 100.0)).collect();
        let registered = register(&input, 1e-9);
        assert!(registered[..6].iter().all(|found| found.likeness > 0.95), "{registered:?}");
        assert!(registered[6].likeness < 0.6, "{registered:?}");
    }
}
