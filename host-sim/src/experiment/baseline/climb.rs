//! From a point near a maximum to the maximum, by Newton's method.

/// Distance at which derivatives are taken, largest step, and step at which it ends, samples.
const PROBE: f64 = 0.08;
const LONGEST: f64 = 0.4;
const SHORTEST: f64 = 1e-4;

/// The position of the maximum of `power` near `start`, in at most `steps` steps, each of which must go up.
pub(super) fn climb(power: impl Fn(f64) -> f64, start: f64, steps: usize) -> f64 {
    let mut here = start;
    let mut height = power(here);
    for _ in 0..steps {
        let [before, after] = [power(here - PROBE), power(here + PROBE)];
        let slope = (after - before) / (2.0 * PROBE);
        let bend = (after - 2.0 * height + before) / (PROBE * PROBE);
        // Where it does not bend down Newton would go to a minimum.
        let mut step = if bend < 0.0 { -slope / bend } else { LONGEST * slope.signum() };
        step = step.clamp(-LONGEST, LONGEST);
        let mut there = power(here + step);
        for _ in 0..3 {
            if there >= height {
                break;
            }
            step *= 0.5;
            there = power(here + step);
        }
        if !(there >= height) {
            break;
        }
        (here, height) = (here + step, there);
        if step.abs() < SHORTEST {
            break;
        }
    }
    here
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_maximum_of_a_bell_is_found_from_its_flank() {
        for start in [-1.2, -0.3, 0.9, 1.4] {
            let top = climb(|x| (-(x - 0.2_f64).powi(2)).exp(), start, 12);
            assert!((top - 0.2).abs() < 1e-3, "{start}: {top}");
        }
    }
}
