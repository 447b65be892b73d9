//! The unit of a frame's power where the receiver scales every frame as it likes.
//!
//! Its white noise; or, where an interferer raised that, what it would be without. S, the sum of all powers above 8 times the
//! white noise, over that noise, is compared with the mean m of ln S: x = m - ln S. A rise has prior odds of 1 to 49, and
//! x then an even density of 1/10; without one x is normal with a deviation of 0.4. Twice x, at most 10, times the
//! probability of a rise, is left out of the unit. m follows ln S by the gain of a random walk ([`super::clock`]), within
//! a nat, and by 0.1 of that where x or -x makes a change likely.
//!
//! Where a lost tag is sought with another action than the one held, ln S waits. Once it is found so, x is taken of the last
//! such frame: where x or -x makes a change likelier than not, m becomes that ln S, and where -x does, the units before were
//! too large by -x.

use super::clock::gain;
use super::real::{Real, exp, larger, limited, ln, square};
use cogmint_core::model::observation::Samples;
use cogmint_core::perceptor::gain_control::{
    CHANGED_SHARE, DEVIATION_LN, MOST_LN, ODDS, STANDS_OUT, WALK_PER_S,
};
use std::fmt;

/// One anchor's frames.
#[derive(Clone, Copy, Debug)]
pub struct GainControl<T> {
    /// m; none before the first frame.
    mean_ln: Option<T>,
    /// Action and ln S of the last frame, if a lost tag was sought with it.
    waiting: Option<(usize, T)>,
}

impl<T> Default for GainControl<T> {
    fn default() -> Self {
        Self { mean_ln: None, waiting: None }
    }
}

impl<T: Real> GainControl<T> {
    /// The unit of a frame with this level of white noise, received with an action that loses `loss_ln` more than the first;
    /// `dt` seconds after the last; `sought`: a lost tag is sought with it.
    pub fn unit(
        &mut self,
        samples: Samples<'_>,
        white: T,
        dt: T,
        action: usize,
        loss_ln: T,
        sought: bool,
    ) -> T {
        let num = T::of;
        let white = limited(white, num(1e-30), num(1e30));
        let least = num(STANDS_OUT) * white;
        let powers: Vec<T> = match samples {
            Samples::Complex(samples) => {
                samples.iter().map(|[re, im]| square(num(*re)) + square(num(*im))).collect()
            }
            Samples::Magnitude(samples) => samples.iter().map(|magnitude| square(num(*magnitude))).collect(),
        };
        let mut sum = T::ZERO;
        for power in powers {
            if power > least {
                sum += power;
            }
        }
        let now_ln = ln(limited(sum, least, num(1e36))) - ln(white) + loss_ln;
        if sought {
            self.waiting = Some((action, now_ln));
            return white;
        }
        self.waiting = None;
        let mean_ln = self.mean_ln.unwrap_or(now_ln);
        let x = limited(mean_ln - now_ln, num(-50.0), num(50.0));
        let risen = likely(x);
        // Order: the rate times 1 - 0.9 p.
        let rate = gain(WALK_PER_S, dt) * (T::ONE - num(1.0 - CHANGED_SHARE) * larger(likely(-x), risen));
        self.mean_ln = Some(mean_ln - rate * limited(x, num(-1.0), num(1.0)));
        white * exp(-risen * limited(num(2.0) * x, T::ZERO, num(MOST_LN)))
    }

    /// The action of the last frame, if it waits.
    pub fn waiting_with(&self) -> Option<usize> {
        self.waiting.map(|(action, _)| action)
    }

    /// The tag was found, in a frame that waits: ln of by how much units were too large with the action held.
    pub fn found(&mut self) -> Option<T> {
        let (_, now_ln) = self.waiting.take()?;
        let by = limited(now_ln - self.mean_ln.unwrap_or(now_ln), T::of(-50.0), T::of(50.0));
        let half = T::of(0.5);
        if likely(by) > half || likely(-by) > half {
            self.mean_ln = Some(now_ln);
        }
        if likely(by) > half { Some(by) } else { None }
    }

    /// Its state, named.
    pub fn visit(&self, anchor: usize, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        f(format_args!("mean of what stands out of anchor {anchor}"), self.mean_ln.unwrap_or(T::ZERO));
        let (waiting, ln_s) = match self.waiting {
            Some((action, ln_s)) => (action + 1, ln_s),
            None => (0, T::ZERO),
        };
        f(format_args!("action anchor {anchor} is sought with"), T::of_count(waiting));
        f(format_args!("what stands out there of anchor {anchor}"), ln_s);
    }
}

/// How likely a change of the noise is that leaves x missing.
fn likely<T: Real>(x: T) -> T {
    // Order: x times the inverse of the deviation.
    let deviations = larger(x, T::ZERO) * T::of(1.0 / DEVIATION_LN);
    T::ONE / (T::ONE + T::of(ODDS) * exp(T::of(-0.5) * square(deviations)))
}
