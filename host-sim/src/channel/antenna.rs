//! Antenna gain over direction and frequency.

use crate::scenario::{Antenna, Pattern};

impl Antenna {
    /// Amplitude gain towards a horizontal direction (components of a unit vector), at `sin_elevation` above the
    /// horizon. The ripple turns with the frequency, as that of real broadband antennas does.
    pub fn gain(&self, direction: [f64; 2], sin_elevation: f64, frequency_hz: f64) -> f64 {
        let peak = libm::pow(10.0, self.gain_dbi / 20.0);
        let shape = match self.pattern {
            Pattern::Isotropic => 1.0,
            Pattern::Dipole => half_wave_dipole(sin_elevation),
            Pattern::Patch => {
                let ahead = along(direction, self.boresight_deg) * cosine_of(sin_elevation);
                // Cosine-squared power ahead over a floor 20 dB down.
                0.1 + 0.9 * (0.5 + 0.5 * ahead) * (0.5 + 0.5 * ahead)
            }
        };
        if self.ripple == 0.0 {
            return peak * shape;
        }
        let turned_deg = self.boresight_deg + self.ripple_turn_deg_per_ghz * (frequency_hz * 1e-9 - 7.0);
        peak * shape * (1.0 + self.ripple * along(direction, turned_deg))
    }

    /// Whether the gain depends on the frequency.
    pub fn is_flat(&self) -> bool {
        self.ripple == 0.0 || self.ripple_turn_deg_per_ghz == 0.0
    }
}

/// Cosine of the angle between a horizontal direction and an azimuth.
fn along([x, y]: [f64; 2], azimuth_deg: f64) -> f64 {
    let (sin, cos) = libm::sincos(azimuth_deg.to_radians());
    x * cos + y * sin
}

fn cosine_of(sine: f64) -> f64 {
    (1.0 - sine * sine).max(0.0).sqrt()
}

/// cos(pi/2 sin e) / cos e, which is 1 at the horizon and 0 along the axis.
fn half_wave_dipole(sin_elevation: f64) -> f64 {
    let cosine = cosine_of(sin_elevation);
    if cosine < 1e-6 {
        return 0.0;
    }
    libm::cos(std::f64::consts::FRAC_PI_2 * sin_elevation) / cosine
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_isotropic_antenna_has_its_gain_everywhere() {
        let antenna = Antenna { gain_dbi: 6.0, ..Antenna::default() };
        let direction = [0.6, -0.8];
        assert!((20.0 * antenna.gain(direction, 0.3, 5e9).log10() - 6.0).abs() < 1e-12);
    }

    #[test]
    fn a_dipole_is_uniform_over_azimuth_and_blind_along_its_axis() {
        let antenna = Antenna { pattern: Pattern::Dipole, ..Antenna::default() };
        assert_eq!(antenna.gain([1.0, 0.0], 0.0, 7e9), 1.0);
        assert_eq!(antenna.gain([0.0, 1.0], 0.4, 7e9), antenna.gain([1.0, 0.0], -0.4, 7e9));
        assert!(antenna.gain([1.0, 0.0], 1.0, 7e9) < 1e-6);
    }

    #[test]
    fn a_patch_is_twenty_decibels_weaker_behind() {
        let antenna = Antenna { pattern: Pattern::Patch, boresight_deg: 90.0, ..Antenna::default() };
        let (ahead, behind) = (antenna.gain([0.0, 1.0], 0.0, 7e9), antenna.gain([0.0, -1.0], 0.0, 7e9));
        assert!((ahead - 1.0).abs() < 1e-12);
        assert!((20.0 * (ahead / behind).log10() - 20.0).abs() < 1e-9);
    }

    #[test]
    fn the_ripple_turns_with_the_frequency() {
        let antenna = Antenna { ripple: 0.2, ripple_turn_deg_per_ghz: 90.0, ..Antenna::default() };
        assert!((antenna.gain([1.0, 0.0], 0.0, 7e9) - 1.2).abs() < 1e-12);
        assert!((antenna.gain([1.0, 0.0], 0.0, 9e9) - 0.8).abs() < 1e-12);
        assert!(!antenna.is_flat());
    }
}
