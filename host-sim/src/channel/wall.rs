//! What a wall does to a wave: reflection and transmission of layered slabs over frequency and angle.
//!
//! A material's relative permittivity is eps(f) = a f^b - j 17.98 c f^d / f with f in GHz (ITU-R P.2040-3). Layers in
//! air are folded from the far side: with the wave's normal component k_i = sqrt(eps_i - sin^2 t), the phase
//! q_i = 2 pi D_i k_i / lambda and the interface reflection r_i between layer i and i + 1,
//!
//! Gamma_i = (r_i + Gamma_(i+1) e^(-j 2 q)) / (1 + r_i Gamma_(i+1) e^(-j 2 q)),
//!
//! which for one layer is the slab formula of ITU-R P.2040-3 (43), (44). Only decaying exponentials occur, so thick
//! metal is no special case.

use crate::scenario::{Construction, Material, Polarisation};
use rustfft::num_complex::Complex64;
use std::sync::OnceLock;

use super::{SPEED_OF_LIGHT_M_S, cis};

/// e0 of S/m over GHz: sigma / (2 pi f eps0) = 17.98 sigma / f_GHz.
const CONDUCTIVITY_SCALE: f64 = 17.975_103_5;

/// A wall's layers with their materials looked up.
#[derive(Clone, Debug, PartialEq)]
pub enum Slab {
    /// Layers from one side to the other: material and thickness in metres.
    Layered(Vec<(Material, f64)>),
    /// Amplitude factors that do not depend on frequency or angle.
    Flat {
        /// Of a reflection.
        reflection: f64,
        /// Of passing through.
        transmission: f64,
    },
}

/// What leaves the wall on either side, relative to the wave that meets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Amplitude reflected, with the phase at the surface.
    pub reflection: Complex64,
    /// Amplitude passed through, relative to the same way through air.
    pub transmission: Complex64,
}

impl Slab {
    /// The slab of a construction; `material` looks a name up. `None` where a name is unknown.
    pub fn new(construction: &Construction, material: impl Fn(&str) -> Option<Material>) -> Option<Self> {
        match construction {
            Construction::Layered { layers } => {
                let layers = layers.iter().map(|layer| Some((material(&layer.material)?, layer.thickness_m)));
                Some(Self::Layered(layers.collect::<Option<_>>()?))
            }
            Construction::Flat { reflection_loss_db, transmission_loss_db } => Some(Self::Flat {
                // A denser medium turns the field round.
                reflection: -amplitude(-reflection_loss_db),
                transmission: amplitude(-transmission_loss_db),
            }),
        }
    }

    /// Response at `frequency_hz` to a wave whose direction makes `cos_incidence` with the wall's normal.
    pub fn response(&self, frequency_hz: f64, cos_incidence: f64, polarisation: Polarisation) -> Response {
        match self {
            Self::Layered(layers) => {
                let layers = layers
                    .iter()
                    .map(|(material, thickness_m)| (permittivity(material, frequency_hz), *thickness_m));
                layered(layers.rev(), frequency_hz, cos_incidence, polarisation)
            }
            Self::Flat { reflection, transmission } => Response {
                reflection: Complex64::new(*reflection, 0.0),
                transmission: Complex64::new(*transmission, 0.0),
            },
        }
    }
}

/// Response of layers in air, from the far side to the near one, each with its permittivity and thickness in metres.
fn layered(
    layers: impl Iterator<Item = (Complex64, f64)>,
    frequency_hz: f64,
    cos_incidence: f64,
    polarisation: Polarisation,
) -> Response {
    // Exactly grazing, every formula is 0 / 0; its limit is total reflection.
    let cosine = cos_incidence.clamp(1e-9, 1.0);
    let sine_squared = 1.0 - cosine * cosine;
    let wave_number = std::f64::consts::TAU * frequency_hz / SPEED_OF_LIGHT_M_S;
    let one = Complex64::new(1.0, 0.0);
    // In air: normal component and admittance.
    let mut behind = Complex64::new(cosine, 0.0);
    let mut reflection = Complex64::new(0.0, 0.0);
    let mut transmission = one;
    let mut thickness_m = 0.0;
    for (epsilon, layer_m) in layers {
        let normal = square_root(epsilon - sine_squared);
        let admittance = match polarisation {
            Polarisation::Vertical => normal,
            Polarisation::Horizontal => normal / epsilon,
        };
        // Interface from this layer to what lies behind it, then the way through this layer.
        (reflection, transmission) = interface(admittance, behind, reflection, transmission);
        let phase = normal * (-wave_number * layer_m);
        let through = cis(phase.re) * libm::exp(-phase.im);
        reflection *= through * through;
        transmission *= through;
        behind = admittance;
        thickness_m += layer_m;
    }
    (reflection, transmission) = interface(Complex64::new(cosine, 0.0), behind, reflection, transmission);
    // The plan's wall has no thickness: the way through it counts as air already.
    transmission *= cis(wave_number * thickness_m * cosine);
    Response { reflection, transmission }
}

/// Reflection and transmission seen from before an interface, from those seen behind it.
fn interface(
    before: Complex64,
    behind: Complex64,
    reflection: Complex64,
    transmission: Complex64,
) -> (Complex64, Complex64) {
    let r = (before - behind) / (before + behind);
    let denominator = (r * reflection + 1.0).inv();
    ((r + reflection) * denominator, transmission * (r + 1.0) * denominator)
}

/// Relative permittivity at a frequency, ITU-R P.2040-3.
fn permittivity(material: &Material, frequency_hz: f64) -> Complex64 {
    let f_ghz = frequency_hz * 1e-9;
    let Material { a, b, c, d } = *material;
    Complex64::new(a * libm::pow(f_ghz, b), -CONDUCTIVITY_SCALE * c * libm::pow(f_ghz, d) / f_ghz)
}

/// The root whose wave decays into the wall: imaginary parts are never positive, that of -1 included.
fn square_root(z: Complex64) -> Complex64 {
    let length = (z.re * z.re + z.im * z.im).sqrt();
    let re = (0.5 * (length + z.re)).max(0.0).sqrt();
    let im = (0.5 * (length - z.re)).max(0.0).sqrt();
    Complex64::new(re, -im)
}

fn amplitude(decibel: f64) -> f64 {
    libm::pow(10.0, decibel / 20.0)
}

/// Angles of a table: cosines from 0 to 1. Between two of them the phase of a wall of half a metre turns by less than
/// a twentieth of a radian at 9 GHz, so that straight lines err by less than 1e-3.
const ANGLES: usize = 1024;

/// Frequencies that are worked out together.
const CHUNK: usize = 64;

/// One wall's response on a lattice of frequencies, filled as angles and frequencies are asked for. What a cell holds
/// does not depend on who asked first.
#[derive(Debug)]
pub struct WallTable {
    slab: Slab,
    polarisation: Polarisation,
    frequencies_hz: Vec<f64>,
    /// Per frequency, from the far layer to the near one.
    permittivities: Vec<Vec<(Complex64, f64)>>,
    /// Per angle, and in it per chunk of frequencies.
    cells: Vec<OnceLock<Vec<Response>>>,
}

impl WallTable {
    /// A table of `slab` at these frequencies.
    pub fn new(slab: Slab, polarisation: Polarisation, frequencies_hz: Vec<f64>) -> Self {
        let layers = |&frequency_hz: &f64| match &slab {
            Slab::Layered(layers) => layers
                .iter()
                .rev()
                .map(|(material, thickness_m)| (permittivity(material, frequency_hz), *thickness_m))
                .collect(),
            Slab::Flat { .. } => Vec::new(),
        };
        let permittivities = frequencies_hz.iter().map(layers).collect();
        let cells = (ANGLES + 1) * frequencies_hz.len().div_ceil(CHUNK);
        let cells = (0..cells).map(|_| OnceLock::new()).collect();
        Self { slab, polarisation, frequencies_hz, permittivities, cells }
    }

    /// Whether the wall leaves the pulse's shape alone.
    pub fn is_flat(&self) -> bool {
        matches!(self.slab, Slab::Flat { .. })
    }

    /// The responses of a chunk of frequencies at an angle.
    fn cell(&self, angle: usize, chunk: usize) -> &[Response] {
        self.cells[angle * self.frequencies_hz.len().div_ceil(CHUNK) + chunk].get_or_init(|| {
            let cosine = angle as f64 / ANGLES as f64;
            let from = chunk * CHUNK;
            let frequencies = self.frequencies_hz.iter().zip(&self.permittivities).skip(from).take(CHUNK);
            frequencies
                .map(|(&frequency_hz, layers)| {
                    layered(layers.iter().copied(), frequency_hz, cosine, self.polarisation)
                })
                .collect()
        })
    }

    /// Multiplies `spectrum` by the response at this angle: the entry n of `spectrum` is at the frequency
    /// `first + n`; what of it to take is `part`'s choice.
    pub fn apply(
        &self,
        spectrum: &mut [Complex64],
        first: usize,
        cos_incidence: f64,
        part: impl Fn(&Response) -> Complex64,
    ) {
        if self.is_flat() {
            let factor = part(&self.slab.response(7e9, 1.0, self.polarisation));
            spectrum.iter_mut().for_each(|value| *value *= factor);
            return;
        }
        let position = cos_incidence.clamp(0.0, 1.0) * ANGLES as f64;
        let low = (position as usize).min(ANGLES - 1);
        let weight = position - low as f64;
        let mut done = 0;
        while done < spectrum.len() {
            let (chunk, within) = ((first + done) / CHUNK, (first + done) % CHUNK);
            let count = (CHUNK - within).min(spectrum.len() - done);
            let (below, above) = (self.cell(low, chunk), self.cell(low + 1, chunk));
            let pairs = below[within..within + count].iter().zip(&above[within..]);
            for (value, (below, above)) in spectrum[done..done + count].iter_mut().zip(pairs) {
                let (below, above) = (part(below), part(above));
                *value *= below + (above - below) * weight;
            }
            done += count;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slab(a: f64, c: f64, d: f64, thickness_m: f64) -> Slab {
        Slab::Layered(vec![(Material { a, b: 0.0, c, d }, thickness_m)])
    }

    /// The table of literature 7.3: reflection at 30 degrees, vertical polarisation, 5 to 9 GHz.
    #[test]
    fn the_published_reflection_table_is_met_within_a_tenth_of_a_decibel() {
        let table: [(Slab, [f64; 9]); 8] = [
            (slab(5.24, 0.0462, 0.7822, 0.2), [-7.1, -7.0, -7.1, -7.1, -7.1, -7.1, -7.1, -7.1, -7.1]),
            (slab(3.91, 0.0238, 0.16, 0.12), [-6.3, -5.8, -8.9, -12.9, -7.2, -5.7, -7.6, -13.1, -8.3]),
            (
                slab(2.73, 0.0085, 0.9395, 0.0125),
                [-6.6, -7.6, -9.2, -11.9, -16.4, -25.1, -19.6, -13.7, -10.6],
            ),
            (slab(2.73, 0.0085, 0.9395, 0.025), [-7.5, -6.4, -6.5, -7.9, -11.6, -19.9, -14.7, -9.5, -7.4]),
            (slab(6.31, 0.0036, 1.3394, 0.006), [-2.2, -2.3, -2.4, -2.6, -3.0, -3.6, -4.5, -5.9, -8.3]),
            (slab(6.31, 0.0036, 1.3394, 0.004), [-2.8, -2.6, -2.4, -2.3, -2.3, -2.3, -2.3, -2.3, -2.4]),
            (
                slab(1.99, 0.0047, 1.0718, 0.04),
                [-12.0, -20.5, -17.1, -11.2, -9.6, -10.4, -14.1, -21.1, -14.7],
            ),
            (slab(1.0, 1e7, 0.0, 0.001), [0.0; 9]),
        ];
        for (slab, row) in table {
            for (n, expected_db) in row.into_iter().enumerate() {
                let frequency_hz = (5.0 + 0.5 * n as f64) * 1e9;
                let cosine = (std::f64::consts::PI / 6.0).cos();
                let response = slab.response(frequency_hz, cosine, Polarisation::Vertical);
                let db = 20.0 * response.reflection.norm().log10();
                assert!((db - expected_db).abs() < 0.1, "{slab:?} at {frequency_hz}: {db}, {expected_db}");
            }
        }
    }

    #[test]
    fn two_layers_of_one_material_are_one_layer_of_both_thicknesses() {
        let material = Material { a: 3.9, b: 0.0, c: 0.02, d: 0.2 };
        for polarisation in [Polarisation::Vertical, Polarisation::Horizontal] {
            for cosine in [0.05, 0.4, 0.99] {
                let one = Slab::Layered(vec![(material, 0.05)]).response(6.3e9, cosine, polarisation);
                let two = Slab::Layered(vec![(material, 0.02), (material, 0.03)]);
                let two = two.response(6.3e9, cosine, polarisation);
                assert!((one.reflection - two.reflection).norm() < 1e-12);
                assert!((one.transmission - two.transmission).norm() < 1e-12);
            }
        }
    }

    #[test]
    fn lossless_walls_keep_all_power_and_air_is_no_wall() {
        let lossless = slab(4.0, 0.0, 0.0, 0.031);
        for polarisation in [Polarisation::Vertical, Polarisation::Horizontal] {
            let response = lossless.response(7.1e9, 0.6, polarisation);
            let power = response.reflection.norm_sqr() + response.transmission.norm_sqr();
            assert!((power - 1.0).abs() < 1e-12, "{power}");
        }
        let air = slab(1.0, 0.0, 0.0, 0.3).response(7e9, 0.3, Polarisation::Vertical);
        assert!(air.reflection.norm() < 1e-12);
        assert!((air.transmission - 1.0).norm() < 1e-9);
    }

    #[test]
    fn a_lossless_wall_that_no_wave_enters_reflects_everything_however_thick() {
        let thin_air = Slab::Layered(vec![(Material { a: 1.0, b: -2.0, c: 0.0, d: 0.0 }, 5.0)]);
        let response = thin_air.response(7e9, 0.3, Polarisation::Vertical);
        assert!((response.reflection.norm() - 1.0).abs() < 1e-12, "{}", response.reflection);
        assert!(response.transmission.norm() < 1e-12);
    }

    /// The slab formula of ITU-R P.2040 written out.
    #[test]
    fn one_layer_is_the_slab_formula() {
        let (frequency_hz, cosine, thickness_m) = (6.2e9, 0.7, 0.012);
        let epsilon = Complex64::new(2.73, -17.975_103_5 * 0.0085 * 6.2_f64.powf(0.9395) / 6.2);
        let root = (epsilon - (1.0 - cosine * cosine)).sqrt();
        let q = root * (std::f64::consts::TAU * thickness_m * frequency_hz / 299_792_458.0);
        let turn = (Complex64::new(0.0, -2.0) * q).exp();
        let cases = [
            ((cosine - root) / (cosine + root), Polarisation::Vertical),
            ((epsilon * cosine - root) / (epsilon * cosine + root), Polarisation::Horizontal),
        ];
        for (r, polarisation) in cases {
            let expected = r * (1.0 - turn) / (1.0 - r * r * turn);
            let response =
                slab(2.73, 0.0085, 0.9395, thickness_m).response(frequency_hz, cosine, polarisation);
            // TM with the admittance k / eps gives the same sign as the formula's (eps cos - root) / (eps cos + root).
            assert!((response.reflection - expected).norm() < 1e-9, "{} {expected}", response.reflection);
        }
    }

    #[test]
    fn the_table_follows_the_formula_between_its_angles() {
        let thick = slab(5.24, 0.001, 0.78, 0.3);
        let frequencies_hz: Vec<f64> = (0..50).map(|n| 6e9 + 50e6 * f64::from(n)).collect();
        let table = WallTable::new(thick.clone(), Polarisation::Vertical, frequencies_hz.clone());
        for cosine in [0.0001, 0.123_45, 0.5, 0.777_7, 1.0] {
            let mut spectrum = vec![Complex64::new(1.0, 0.0); 40];
            table.apply(&mut spectrum, 5, cosine, |response| response.reflection);
            for (value, frequency_hz) in spectrum.iter().zip(&frequencies_hz[5..]) {
                let exact = thick.response(*frequency_hz, cosine, Polarisation::Vertical).reflection;
                assert!((value - exact).norm() < 2e-3, "{cosine} {frequency_hz}: {value} {exact}");
            }
        }
    }
}
