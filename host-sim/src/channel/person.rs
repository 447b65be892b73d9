//! People in the way: each an upright screen across the path, with diffraction at both edges (3GPP TR 38.901, 7.6.4.2,
//! blockage model B, with a screen that is infinitely high).
//!
//! An edge leaves the share F = atan(+-(pi / 2) sqrt(pi / lambda (D - r))) / pi of the wave missing, where D is the way
//! round the edge and r the direct one; the sign of the nearer edge is negative where the screen does not reach the
//! path. The amplitude is 1 - (F_1 + F_2).

use super::SPEED_OF_LIGHT_M_S;

/// Nobody is nearer to an antenna than this, metres.
const NEAREST_M: f64 = 0.25;

/// Amplitude factor of a person of `width_m` at `person_m` on a leg from `from_m` to `to_m`. Persons before its start or
/// behind its end do not matter.
pub fn shadow(from_m: [f64; 2], to_m: [f64; 2], person_m: [f64; 2], width_m: f64, frequency_hz: f64) -> f64 {
    let leg = [to_m[0] - from_m[0], to_m[1] - from_m[1]];
    let length = (leg[0] * leg[0] + leg[1] * leg[1]).sqrt();
    if length < 1e-9 {
        return 1.0;
    }
    let [dx, dy] = [person_m[0] - from_m[0], person_m[1] - from_m[1]];
    let before = (dx * leg[0] + dy * leg[1]) / length;
    let aside = (dx * leg[1] - dy * leg[0]) / length;
    let behind = length - before;
    if before <= 0.0 || behind <= 0.0 {
        return 1.0;
    }
    let wavelength_m = SPEED_OF_LIGHT_M_S / frequency_hz;
    let missing = |edge: f64| {
        let round = (before * before + edge * edge).sqrt() + (behind * behind + edge * edge).sqrt();
        let argument = (std::f64::consts::PI / wavelength_m * (round - length).max(0.0)).sqrt();
        libm::atan(std::f64::consts::FRAC_PI_2 * argument) / std::f64::consts::PI
    };
    let (low, high) = (aside - 0.5 * width_m, aside + 0.5 * width_m);
    // An edge on its own side of the path hides something; past the path, it gives that back.
    let missing_low = if low < 0.0 { missing(low) } else { -missing(low) };
    let missing_high = if high > 0.0 { missing(high) } else { -missing(high) };
    // From there on the shadow is full; nearer than anybody is, it fades out.
    let depth = (before.min(behind) / (0.5 * width_m).min(NEAREST_M)).min(1.0);
    1.0 - depth * depth * (3.0 - 2.0 * depth) * (missing_low + missing_high)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(aside_m: f64) -> f64 {
        shadow([0.0, 0.0], [6.0, 0.0], [3.0, aside_m], 0.5, 7e9)
    }

    #[test]
    fn a_person_on_the_path_takes_most_of_it_and_one_far_aside_nothing() {
        let on_path_db = 20.0 * at(0.0).log10();
        assert!((-25.0..-10.0).contains(&on_path_db), "{on_path_db}");
        assert!((at(2.0) - 1.0).abs() < 0.03, "{}", at(2.0));
        assert_eq!(shadow([0.0, 0.0], [6.0, 0.0], [-1.0, 0.0], 0.5, 7e9), 1.0);
        assert_eq!(shadow([0.0, 0.0], [6.0, 0.0], [7.0, 0.0], 0.5, 7e9), 1.0);
    }

    #[test]
    fn half_of_the_amplitude_is_left_where_an_edge_touches_the_path() {
        // A very wide screen: one edge on the path, the other far away.
        let wide = shadow([0.0, 0.0], [6.0, 0.0], [3.0, 50.0], 100.0, 7e9);
        assert!((wide - 0.5).abs() < 0.01, "{wide}");
    }

    #[test]
    fn the_shadow_has_no_jump() {
        for n in 0..4000 {
            let aside_m = -1.0 + 0.0005 * f64::from(n);
            assert!((at(aside_m) - at(aside_m + 0.0005)).abs() < 0.01, "{aside_m}");
        }
        assert!((at(0.3) - at(-0.3)).abs() < 1e-12);
        for n in 0..2000 {
            let along = |x_m: f64| shadow([0.0, 0.0], [6.0, 0.0], [x_m, 0.1], 0.5, 7e9);
            let x_m = -0.5 + 0.0005 * f64::from(n);
            assert!((along(x_m) - along(x_m + 0.0005)).abs() < 0.01, "{x_m}");
        }
    }
}
