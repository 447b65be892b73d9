//! The unit of a frame's power where the receiver scales every frame as it likes (automatic gain control).
//!
//! The receiver's own noise is the same in every frame, so the white noise of a frame is the unit, unless an interferer
//! raised it: then all that stands out of it (samples 9 dB above) does so less far than in the frames before. Two hypotheses
//! compete: what stands out varies as it always does, or the noise rose, by anything up to 10 nats. Some of what stands out
//! is then the interferer's, so that the noise rose by more than what is missing: by twice that, it is taken. The unit leaves
//! the rise out, times its probability.
//!
//! What stood out until the tag was lost may have been an interferer's, or may have stood out of noise that had one in it,
//! since nobody knows when. So frames in which it is sought with another action are compared with nothing. Once it is found
//! in one, the level of what stands out begins anew there; where that is far higher than before, it is told by how much the
//! unit was too large. Of other changes of action nothing such is concluded: what more stands out may be an interferer there.

use crate::model::clock::gain;
use crate::model::observation::Samples;
use crate::real::{exp, larger, limited, ln};
use crate::snapshot::stored;

/// Mathematics: what stands out: this many times the white noise, which 3 in 10 000 samples of noise alone exceed.
pub const STANDS_OUT: f32 = 8.0;
/// Tuned: standard deviation of ln of its sum about the mean, fitted where pulses of 2 ns overlap; less elsewhere.
pub const DEVIATION_LN: f32 = 0.4;
/// Mathematics: end of the even distribution of a rise, nats; no unit changes by more.
pub const MOST_LN: f32 = 10.0;
/// Tuned: odds of no rise at no deviation: prior 49 to 1, and the density of the normal distribution over that of the even one.
pub const ODDS: f32 = 49.0 * MOST_LN / (2.5066 * DEVIATION_LN);
/// Tuned: against following a rise before it is told from one of the noise: how fast the mean changes, as the variance of its walk per second over that of one frame; it follows within 1 nat, and by this share of that where the noise has changed for certain, or an
/// interferer stands out.
pub const WALK_PER_S: f32 = 0.11;
/// Tuned: that share.
pub const CHANGED_SHARE: f32 = 0.1;

/// What is known of the frames of one anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GainControl {
    /// Mean of ln of what stands out over the white noise, at the reference carrier; `None` before the first frame.
    standing_ln: Option<f32>,
    /// Action of the last frame, and ln of what stood out in it, if a lost tag was sought with it.
    sought: Option<(usize, f32)>,
}

impl GainControl {
    /// Before the first frame.
    pub(crate) const NONE: Self = Self { standing_ln: None, sought: None };

    /// The power, in squared units of the samples, to be taken as 1 in a frame received with `action`, with this level of
    /// white noise, `elapsed_s` seconds after the last; `loss_ln` is ln of the power lost to the reference carrier, `is_sought` says that a lost tag is sought with
    /// an action that is not the one held. Finite and positive.
    pub fn unit(
        &mut self,
        samples: Samples<'_>,
        white: f32,
        elapsed_s: f32,
        action: usize,
        loss_ln: f32,
        is_sought: bool,
    ) -> f32 {
        let white = limited(white, 1e-30, 1e30);
        let standing_ln = ln(standing_out(samples, STANDS_OUT * white)) - ln(white) + loss_ln;
        self.sought = is_sought.then_some((action, standing_ln));
        if is_sought {
            return white;
        }
        let mean_ln = self.standing_ln.unwrap_or(standing_ln);
        let missing_ln = limited(mean_ln - standing_ln, -50.0, 50.0);
        let (fallen, risen) = (changed(-missing_ln), changed(missing_ln));
        let rate = gain(WALK_PER_S, elapsed_s) * (1.0 - (1.0 - CHANGED_SHARE) * larger(fallen, risen));
        self.standing_ln = Some(mean_ln - rate * limited(missing_ln, -1.0, 1.0));
        white * exp(-risen * limited(2.0 * missing_ln, 0.0, MOST_LN))
    }

    /// The action of the last frame where a lost tag was sought with it, until it is found.
    pub fn sought_with(&self) -> Option<usize> {
        self.sought.map(|(action, _)| action)
    }

    /// The tag was found in a frame in which it was sought. By how much units were too large with the action held before, as ln:
    /// positive, `None` where not much more stands out.
    pub fn found(&mut self) -> Option<f32> {
        let (_, standing_ln) = self.sought.take()?;
        let excess_ln = limited(standing_ln - self.standing_ln.unwrap_or(standing_ln), -50.0, 50.0);
        let masked = changed(excess_ln) > 0.5;
        if masked || changed(-excess_ln) > 0.5 {
            self.standing_ln = Some(standing_ln);
        }
        masked.then_some(excess_ln)
    }

    /// The state, for traces: the mean, 0 before the first frame, and the action sought with, counted from 1 and 0 for none,
    /// and the level there.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        let (sought, level_ln) = self.sought.map_or((0, 0.0), |(action, level_ln)| (action + 1, level_ln));
        f(self.standing_ln.unwrap_or(0.0));
        f(sought as f32);
        f(level_ln);
    }
}

/// Probability that the noise has changed where this is missing of what stands out, as ln.
fn changed(missing_ln: f32) -> f32 {
    let scaled = larger(missing_ln, 0.0) * (1.0 / DEVIATION_LN);
    1.0 / (1.0 + ODDS * exp(-0.5 * (scaled * scaled)))
}

/// Sum of the powers above `least`; at least that.
fn standing_out(samples: Samples<'_>, least: f32) -> f32 {
    let mut sum = 0.0;
    let mut enter = |power: f32| {
        if power > least {
            sum += power;
        }
    };
    match samples {
        Samples::Complex(samples) => samples.iter().for_each(|[re, im]| enter(re * re + im * im)),
        Samples::Magnitude(samples) => samples.iter().for_each(|magnitude| enter(magnitude * magnitude)),
    }
    limited(sum, least, 1e36)
}

stored!(GainControl { standing_ln, sought } told {});

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame of noise 1 with paths of 100, 400 and 900 times that, all times `gain`; the noise once more times `rise`.
    fn unit(control: &mut GainControl, gain: f32, rise: f32) -> f32 {
        let mut powers = [rise * gain; 200];
        for (n, path) in [(20, 900.0), (40, 400.0), (70, 100.0)] {
            powers[n] = (rise + path) * gain;
        }
        let magnitudes = powers.map(f32::sqrt);
        let complex = powers.map(|power| [0.0, power.sqrt()]);
        let mut copy = *control;
        let of_complex = copy.unit(Samples::Complex(&complex), rise * gain, 0.1, 0, 0.0, false);
        let unit = control.unit(Samples::Magnitude(&magnitudes), rise * gain, 0.1, 0, 0.0, false);
        assert!((of_complex / unit - 1.0).abs() < 1e-4);
        unit
    }

    #[test]
    fn the_gain_is_found_whatever_it_is() {
        let mut control = GainControl::NONE;
        for gain in [1.0, 30.0, 1e-4, 1e6, 0.5] {
            assert!((unit(&mut control, gain, 1.0) / gain - 1.0).abs() < 0.02, "{gain}");
        }
    }

    /// An interferer of 13 dB stays: all of it is noise.
    #[test]
    fn noise_that_rises_is_no_gain() {
        let mut control = GainControl::NONE;
        (0..20).for_each(|_| assert!((unit(&mut control, 2.0, 1.0) / 2.0 - 1.0).abs() < 0.02));
        for frame in 0..10 {
            let found = unit(&mut control, 3.0, 20.0) / 3.0;
            assert!(found > 1e-3 && found < 1.0, "{frame}: {found}");
        }
        // And when the interferer is gone, that is seen at once.
        assert!((unit(&mut control, 1.0, 1.0) - 1.0).abs() < 0.02);
    }

    /// Paths that weaken slowly, by 20 dB in 100 frames, are no noise.
    #[test]
    fn paths_may_weaken() {
        let mut control = GainControl::NONE;
        for frame in 0..100 {
            let strength = 10_f32.powf(-0.02 * frame as f32);
            let mut samples = [1.0; 200];
            samples[20] = (1.0 + 1e4 * strength).sqrt();
            let unit = control.unit(Samples::Magnitude(&samples), 1.0, 0.1, 0, 0.0, false);
            assert!((unit - 1.0).abs() < 0.05, "{frame}: {unit}");
        }
    }

    /// A frame of one path, in this noise.
    fn path_in(control: &mut GainControl, action: usize, noise: f32, is_sought: bool) -> f32 {
        let mut samples = [noise.sqrt(); 200];
        samples[20] = (noise + 1e4).sqrt();
        control.unit(Samples::Magnitude(&samples), noise, 0.1, action, 0.0, is_sought)
    }

    /// Noise of 13 dB above the receiver's own from the first frame on, until a lost tag is found with another action: that
    /// one is quiet, and by how much the first is not is known.
    #[test]
    fn an_interferer_that_was_always_there_is_unmasked_where_the_tag_is_found() {
        let mut control = GainControl::NONE;
        (0..20).for_each(|_| assert_eq!(path_in(&mut control, 2, 20.0, false), 20.0));
        assert!(control.found().is_none() && control.sought_with().is_none());
        let before = control;
        assert_eq!(path_in(&mut control, 3, 1.0, true), 1.0);
        assert_eq!(control.sought_with(), Some(3));
        let excess_ln = control.found();
        assert!(excess_ln.is_some_and(|excess_ln| (excess_ln - 20_f32.ln()).abs() < 0.01), "{excess_ln:?}");
        assert!((path_in(&mut control, 3, 1.0, false) - 1.0).abs() < 1e-6);
        // Back at the first, the noise is known.
        assert!(path_in(&mut control, 2, 20.0, false) < 0.2 * 20.0);
        // Where the tag is not found, all is as it was.
        control = before;
        path_in(&mut control, 3, 1.0, true);
        assert_eq!(path_in(&mut control, 2, 20.0, false), 20.0);
        assert_eq!(control, before);
    }

    /// Less stands out where the tag is found than where it was lost: that was an interferer, and is no measure.
    #[test]
    fn what_stood_out_where_the_tag_was_lost_is_no_measure() {
        for (is_sought, unit) in [(false, 1e-4..0.1), (true, 0.99..1.01)] {
            let mut control = GainControl::NONE;
            (0..5).for_each(|_| {
                path_in(&mut control, 0, 1.0, false);
            });
            path_in(&mut control, 1, 40.0, is_sought);
            assert!(control.found().is_none());
            let found = path_in(&mut control, 1, 40.0, false) / 40.0;
            assert!(unit.contains(&found), "{is_sought}: {found}");
        }
    }

    #[test]
    fn any_samples_give_a_unit() {
        let mut control = GainControl::NONE;
        for magnitude in [0.0, 1e-20, 1.0, 1e18, f32::MAX] {
            for white in [0.0, 1e-38, 1.0, f32::MAX] {
                for samples in [&[magnitude; 40][..], &[]] {
                    for is_sought in [false, true] {
                        let unit = control.unit(Samples::Magnitude(samples), white, 0.1, 0, 3.0, is_sought);
                        assert!(unit > 0.0 && unit.is_finite(), "{magnitude} {white}: {unit}");
                    }
                    assert!(control.found().is_none_or(|excess_ln| excess_ln > 0.0 && excess_ln <= 50.0));
                }
            }
        }
    }
}
