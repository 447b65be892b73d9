//! Randomness: one stream per purpose and frame, so that no frame depends on which were made before it.

use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;
use rustfft::num_complex::Complex64;

/// What a stream is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Scatterers of the room, of an interferer.
    Scatterers,
    /// White noise.
    Noise,
    /// Lost frames.
    Loss,
    /// Sampling grid, time stamp and phase of a packet.
    Packet,
    /// Schedule of a recording.
    Schedule,
    /// Errors of the floor plan.
    FloorPlan,
    /// Trials of an experiment.
    Experiment,
    /// Aspects of a random room.
    Room,
    /// Errors of a floor plan's walls.
    Walls,
    /// Mean of the first position.
    Start,
    /// Error of the tag's height as it is told.
    TagHeight,
}

/// The generator of a purpose and its indexes.
pub fn stream(seed: u64, purpose: Purpose, indexes: &[usize]) -> Xoshiro128PlusPlus {
    let mixed = indexes.iter().fold(mix(seed ^ mix(purpose as u64 + 1)), |mixed, &index| {
        mix(mixed ^ (index as u64).wrapping_add(0x9e37_79b9_7f4a_7c15))
    });
    Xoshiro128PlusPlus::seed_from_u64(mixed)
}

/// Finaliser of SplitMix64 (Steele, Lea, Flood 2014): every bit of the input moves every bit of the output.
fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Uniform between 0 and 1, both excluded.
pub fn uniform(rng: &mut impl Rng) -> f64 {
    (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0
}

/// Normal of unit variance.
pub fn normal(rng: &mut impl Rng) -> f64 {
    complex_normal(rng).re * std::f64::consts::SQRT_2
}

/// Circular complex normal of unit variance, by the polar method (Marsaglia and Bray 1964): its only transcendental is
/// libm's logarithm, so that the bits are the same everywhere.
pub fn complex_normal(rng: &mut impl Rng) -> Complex64 {
    loop {
        let (x, y) = (2.0 * uniform(rng) - 1.0, 2.0 * uniform(rng) - 1.0);
        let square = x * x + y * y;
        if square < 1.0 {
            let scale = (-libm::log(square) / square).sqrt();
            return Complex64::new(x * scale, y * scale);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_by_seed_purpose_and_every_index() {
        let first = |seed, purpose, indexes: &[usize]| stream(seed, purpose, indexes).next_u64();
        let all = [
            first(1, Purpose::Noise, &[3, 0]),
            first(2, Purpose::Noise, &[3, 0]),
            first(1, Purpose::Packet, &[3, 0]),
            first(1, Purpose::Noise, &[0, 3]),
            first(1, Purpose::Noise, &[3, 1]),
            first(1, Purpose::Noise, &[3]),
        ];
        for (n, value) in all.iter().enumerate() {
            assert!(!all[..n].contains(value));
        }
        assert_eq!(all[0], first(1, Purpose::Noise, &[3, 0]));
    }

    #[test]
    fn complex_normals_have_unit_power() {
        let mut rng = stream(5, Purpose::Noise, &[]);
        let power = (0..100_000).map(|_| complex_normal(&mut rng).norm_sqr()).sum::<f64>() / 1e5;
        assert!((power - 1.0).abs() < 0.015, "{power}");
    }
}
