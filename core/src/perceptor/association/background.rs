//! Background: what belongs to no known feature, at each measurement of a scan.
//!
//! False alarms of the measurement's strength come at any range; paths that are not in the map only after the direct path. So
//! with lambda the usual density of both and lambda_fa that of false alarms, where the direct path is expected at d,
//!
//! lambda_m = lambda_fa f_m + (lambda - lambda_fa) p(z_m > d) + lambda (c_m - 1),
//!
//! f_m being the density of false alarms so strong over that of all, and c_m what candidates for virtual anchors claim.

use crate::model::detection::LOGISTIC;
use crate::model::measurement::{Clutter, Measurement};
use crate::perceptor::expectation::Expectation;
use crate::real::{LnProduct, exp, limited, sqrt};
use heapless::Vec;

/// Guard: against overflow: exponents go no further.
pub const LARGEST_EXPONENT: f32 = 40.0;

/// What belongs to no known feature.
#[derive(Clone, Debug)]
pub struct Background<const PATHS: usize> {
    /// lambda: per metre.
    usual_per_m: f32,
    /// lambda_m: per metre, by measurement.
    per_m: [f32; PATHS],
    /// Share of that which false alarms are, by measurement.
    false_alarms: [f32; PATHS],
}

impl<const PATHS: usize> Background<PATHS> {
    /// Of these measurements, where the direct path is expected so; `claims` says, per measurement, how much more probable
    /// something that is not in the map makes it than clutter would (1: nothing).
    pub fn new(
        measurements: &Vec<Measurement, PATHS>,
        direct: &Expectation,
        clutter: &Clutter,
        claims: &[f32; PATHS],
    ) -> Self {
        let Clutter { all_per_m, false_alarms_per_m } = *clutter;
        let (mut per_m, mut false_alarms) = ([all_per_m; PATHS], [1.0; PATHS]);
        let densities = per_m.iter_mut().zip(&mut false_alarms);
        for (((density, share), measurement), claim) in densities.zip(measurements).zip(claims) {
            let deviation = sqrt(direct.variance_m2 + measurement.variance_m2);
            let earlier = LOGISTIC * ((direct.range_m - measurement.range_m) / deviation);
            let later = 1.0 / (1.0 + exp(limited(earlier, -LARGEST_EXPONENT, LARGEST_EXPONENT)));
            let false_per_m = false_alarms_per_m * measurement.false_alarm;
            *density = false_per_m + (all_per_m - false_alarms_per_m) * later + all_per_m * (claim - 1.0);
            *share = false_per_m / *density;
        }
        Self { usual_per_m: all_per_m, per_m, false_alarms }
    }

    /// The density at each measurement, per metre.
    pub fn per_m(&self) -> &[f32; PATHS] {
        &self.per_m
    }

    /// Probability that each measurement is a false alarm, where it belongs to no known feature.
    pub fn false_alarms(&self) -> &[f32; PATHS] {
        &self.false_alarms
    }

    /// Evidence of so many measurements, nats, were none of a known feature: over that of the usual density.
    pub fn evidence_nat(&self, measurements: usize) -> f32 {
        let mut evidence = LnProduct::ONE;
        for per_m in self.per_m.iter().take(measurements) {
            evidence.times(per_m / self.usual_per_m);
        }
        evidence.ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::lateness::Lateness;

    const CLUTTER: Clutter = Clutter { all_per_m: 0.2, false_alarms_per_m: 0.03 };

    fn direct(range_m: f32, variance_m2: f32) -> Expectation {
        Expectation { range_m, variance_m2, existence: 1.0, detection: 0.9, lateness: Lateness::NONE }
    }

    fn measurement(range_m: f32, variance_m2: f32, false_alarm: f32) -> Measurement {
        Measurement { range_m, variance_m2, sinr: 0.0, energy: 0.0, false_alarm }
    }

    /// The density of one measurement, by what candidates claim of it.
    fn density(measurement: Measurement, direct: &Expectation, clutter: &Clutter, claim: f32) -> f32 {
        let mut one: Vec<Measurement, 1> = Vec::new();
        one.push(measurement).unwrap();
        Background::new(&one, direct, clutter, &[claim]).per_m()[0]
    }

    #[test]
    fn before_the_direct_path_there_are_false_alarms_alone_and_behind_it_everything() {
        for false_alarm in [1e-4_f32, 0.1, 1.0] {
            for claim in [1.0_f32, 1.5, 20.0] {
                let at = |range_m: f32| {
                    density(measurement(range_m, 0.01, false_alarm), &direct(10.0, 0.03), &CLUTTER, claim)
                };
                let claimed = 0.2 * (claim - 1.0);
                for (range_m, later) in [(0.0, 0.0), (8.0, 0.0), (10.0, 0.5), (12.0, 1.0), (1000.0, 1.0)] {
                    let exact = 0.03 * false_alarm + 0.17 * later + claimed;
                    assert!(
                        (at(range_m) - exact).abs() < 2e-6 * exact.max(0.2),
                        "{range_m}: {} {exact}",
                        at(range_m)
                    );
                }
                // 0.2 m are the deviation of the difference: the normal distribution, within a hundredth.
                for (range_m, normal) in
                    [(9.6, 0.022_750), (9.8, 0.158_655), (10.1, 0.691_462), (10.3, 0.933_193)]
                {
                    let exact = 0.03 * false_alarm + 0.17 * normal + claimed;
                    assert!((at(range_m) - exact).abs() < 0.01 * 0.17, "{range_m}: {} {exact}", at(range_m));
                }
            }
        }
    }

    #[test]
    fn evidence_of_clutter_alone_is_the_product_of_its_densities_over_the_usual_one() {
        let mut measurements: Vec<Measurement, 4> = Vec::new();
        for (range_m, false_alarm) in [(2.0, 1.0), (10.0, 0.2), (30.0, 1e-4)] {
            measurements.push(measurement(range_m, 0.01, false_alarm)).unwrap();
        }
        let background = Background::new(&measurements, &direct(10.0, 0.03), &CLUTTER, &[1.0, 1.0, 3.0, 1.0]);
        // 0.03 / 0.2, (0.006 + 0.085) / 0.2 and (0.000003 + 0.17 + 0.4) / 0.2.
        let exact = (0.15_f64 * 0.455 * 2.850_015).ln();
        assert!((f64::from(background.evidence_nat(3)) - exact).abs() < 1e-5);
        assert_eq!(background.evidence_nat(0), 0.0);
        // Where false alarms are all there is and none is stronger than usual, there is nothing to tell.
        let usual = Clutter { all_per_m: 0.03, false_alarms_per_m: 0.03 };
        let first: Vec<Measurement, 4> = measurements.iter().take(1).copied().collect();
        assert_eq!(Background::new(&first, &direct(10.0, 0.03), &usual, &[1.0; 4]).evidence_nat(1), 0.0);
    }

    #[test]
    fn whatever_the_scan_densities_are_finite_and_above_zero() {
        let mut worst = 0.0_f32;
        for range_m in [1e-3, 1.0, 9.999_999, 10.0, 1e4] {
            for variance_m2 in [1e-6, 1.0, 1e8] {
                for own_m2 in [0.0, 1e-12, 1.0, 1e8] {
                    for (all_per_m, false_alarms_per_m) in
                        [(1e-7, 1e-7), (0.2, 1e-7), (200.0, 100.0), (100.0, 100.0)]
                    {
                        for false_alarm in [1e-4, 1.0] {
                            let clutter = Clutter { all_per_m, false_alarms_per_m };
                            let mut one: Vec<Measurement, 1> = Vec::new();
                            one.push(measurement(range_m, variance_m2, false_alarm)).unwrap();
                            let found = Background::new(&one, &direct(10.0, own_m2), &clutter, &[1.0]);
                            let [per_m] = *found.per_m();
                            assert!(
                                per_m > 0.0 && per_m <= 2.0 * all_per_m,
                                "{range_m} {variance_m2}: {per_m}"
                            );
                            let evidence_nat = found.evidence_nat(1);
                            assert!(evidence_nat.is_finite());
                            worst = worst.min(evidence_nat);
                        }
                    }
                }
            }
        }
        // ln (1e-7 x 1e-4 / 0.2): a strong path long before the direct one.
        assert!((worst + 23.719).abs() < 1e-2, "{worst}");
    }
}
