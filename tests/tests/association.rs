//! Association on the microcontroller's terms against its twin, over problems no recording poses: empty, crowded,
//! beyond the memory of the exact solution.

use cogmint::reference::association as twin;
use cogmint::reference::lateness;
use cogmint_core::model::lateness::Lateness;
use cogmint_core::model::measurement::{Clutter, Measurement};
use cogmint_core::perceptor::association::background::Background;
use cogmint_core::perceptor::association::{Joint, associate};
use cogmint_core::perceptor::expectation::Expectation;
use heapless::Vec;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

const VAS: usize = 24;
const PATHS: usize = 16;

#[test]
fn core_and_twin_agree_in_every_bit() {
    let mut noise = Xoshiro128PlusPlus::seed_from_u64(1);
    let mut uniform = move || (noise.next_u32() >> 8) as f32 / 16_777_216.0;
    let [mut exact, mut loopy] = [0, 0];
    for problem in 0..3000 {
        // From features that share nothing to features that all want the same measurements.
        let span_m = [30.0, 12.0, 6.0, 2.0][problem % 4];
        let deviation_m = [0.02, 0.1, 0.3][problem % 3];
        let [features, measurements] = [VAS + 1, PATHS + 1].map(|most| (uniform() * most as f32) as usize);
        let mut expectation = |existence| Expectation {
            range_m: 1.0 + span_m * uniform(),
            variance_m2: deviation_m * deviation_m * uniform(),
            existence,
            detection: 0.5 + 0.49 * uniform(),
            lateness: Lateness::NONE,
        };
        let mut direct = expectation(1.0);
        let mut virtual_anchors: Vec<Expectation, VAS> = Vec::new();
        for k in 0..features {
            virtual_anchors.push(expectation(k as f32 / features as f32)).unwrap();
        }
        if problem % 3 == 0 {
            direct.lateness = Lateness { share: uniform(), mean_m: 0.01 + uniform() };
        }
        let mut scan: Vec<Measurement, PATHS> = Vec::new();
        for _ in 0..measurements {
            let variance_m2 = deviation_m * deviation_m * (0.01 + uniform());
            let range_m = 1.0 + span_m * uniform();
            scan.push(Measurement { range_m, variance_m2, sinr: 0.0, energy: 0.0, false_alarm: 1.0 })
                .unwrap();
        }
        let false_alarms_per_m = if problem % 5 == 0 { 0.0 } else { 0.03 };
        let clutter = Clutter { false_alarms_per_m, all_per_m: 0.03 + 0.2 * uniform() };
        // What candidates claim makes a measurement more probable, by anything from nothing to a lot.
        let claims: [f32; PATHS] =
            std::array::from_fn(|_| if uniform() < 0.5 { 1.0 } else { 1.0 / (1e-3 + uniform()) });
        let background = Background::new(&scan, &direct, &clutter, &claims);
        let ours = associate(&direct, &virtual_anchors, &scan, &background);

        let plain = |feature: &Expectation| twin::Expectation {
            range_m: feature.range_m,
            variance_m2: feature.variance_m2,
            existence: feature.existence,
            detection: feature.detection,
            lateness: lateness::Lateness { share: feature.lateness.share, mean_m: feature.lateness.mean_m },
        };
        let features: std::vec::Vec<_> =
            std::iter::once(&direct).chain(&virtual_anchors).map(plain).collect();
        let measurements: std::vec::Vec<_> = scan
            .iter()
            .map(|z| twin::Measurement {
                range_m: z.range_m,
                variance_m2: z.variance_m2,

                sinr: 0.0,
                energy: 0.0,
                false_alarm: z.false_alarm,
            })
            .collect();
        let clutter =
            twin::Clutter { false_alarms_per_m: clutter.false_alarms_per_m, all_per_m: clutter.all_per_m };
        let theirs = twin::associate(&features, &measurements, &claims, &clutter);

        assert_eq!(ours.iterations, theirs.iterations, "problem {problem}");
        assert_eq!(ours.evidence_nat.to_bits(), theirs.evidence_nat.to_bits(), "problem {problem}");
        for (ours, theirs) in ours.features().zip(&theirs.features) {
            assert_eq!(ours.joint, theirs.joint, "problem {problem}");
            *(if ours.joint == Joint::Unknown { &mut loopy } else { &mut exact }) += 1;
            let ours = [ours.missed, ours.existence].into_iter().chain(ours.associated);
            let theirs =
                [theirs.missed, theirs.existence].into_iter().chain(theirs.associated.iter().copied());
            assert!(ours.zip(theirs).all(|(a, b)| a.to_bits() == b.to_bits()), "problem {problem}");
        }
        let free = ours.unassociated.iter().zip(&theirs.unassociated);
        assert!(free.into_iter().all(|(a, b)| a.to_bits() == b.to_bits()), "problem {problem}");
        let (direct, others) = ours.most_probable();
        let chosen: std::vec::Vec<_> = std::iter::once(direct).chain(others).collect();
        assert_eq!(chosen, theirs.most_probable(), "problem {problem}");
    }
    println!("features solved exactly {exact}, by messages {loopy}");
    assert!(exact > 1000 && loopy > 1000, "{exact} {loopy}");
}
