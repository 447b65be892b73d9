//! Outage: that a scan has nothing to do with the tag, because its anchor is switched off, jammed or behind a door.
//!
//! One hypothesis more, of probability p, in which all measurements are clutter. It costs no misses and moves nothing. With L the
//! sum over all associations, relative to clutter,
//!
//! den = (1 - p) L + p, p <- p / den,
//!
//! and den is the evidence of the scan.

use crate::real::{exp, larger, ln};

/// What is left of the evidence of a scan (nats) where there may be an outage, and the probability of it afterwards.
pub fn weigh(outage: f32, evidence_nat: f32) -> (f32, f32) {
    // Relative to the more probable of both.
    let most = larger(evidence_nat, 0.0);
    let (heard, out) = ((1.0 - outage) * exp(evidence_nat - most), outage * exp(-most));
    let either = larger(heard + out, f32::MIN_POSITIVE);
    (most + ln(either), out / either)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_is_shared_by_bayes_rule_and_always_a_number() {
        for outage in [0.0_f32, 0.05, 0.5, 1.0] {
            for evidence_nat in [-30.0_f32, -3.0, 0.0, 2.5, 40.0] {
                let (p, l) = (f64::from(outage), f64::from(evidence_nat).exp());
                let exact = (1.0 - p) * l + p;
                let (found_nat, found) = weigh(outage, evidence_nat);
                assert!((f64::from(found_nat) - exact.ln()).abs() < 1e-5, "{outage} {evidence_nat}");
                assert!((f64::from(found) - p / exact).abs() < 1e-6, "{outage} {evidence_nat}");
            }
            for evidence_nat in [-1e6, -200.0, 200.0, 1e6] {
                let (nat, after) = weigh(outage, evidence_nat);
                assert!(nat.is_finite() && (0.0..=1.0).contains(&after), "{outage} {evidence_nat}");
            }
        }
    }
}
