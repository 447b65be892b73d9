//! Choosers on the tracker's own memories: what each action should tell of the position in the next cycle, with the SINR
//! as it is remembered (greedy), as it may be at best (UCB), or drawn from what is known of it (Thompson sampling).
//!
//! Written apart from the core's planning, in f64: an independent account of the same prediction.

use super::choice::{Choose, Seen, best};
use super::truth::Actions;
use crate::bound::posterior::Posterior;
use crate::channel::SPEED_OF_LIGHT_M_S;
use crate::channel::random::normal;
use cogmint_core::memory::environment::CONFIRMED;
use cogmint_core::model::channel::ChannelKnowledge as _;
use cogmint_core::model::detection::detection_probability;
use cogmint_core::model::source::Source;
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;

/// How the remembered SINR is read.
#[derive(Clone, Debug)]
pub enum Reading {
    /// As the best guess.
    Guess,
    /// One deviation better.
    Optimist,
    /// Drawn anew in every cycle.
    Sample(Xoshiro128PlusPlus),
}

impl Reading {
    /// Thompson sampling with the numbers of a seed.
    pub fn sample(seed: u64) -> Self {
        Self::Sample(Xoshiro128PlusPlus::seed_from_u64(seed))
    }
}

/// Takes the action that should tell most.
#[derive(Clone)]
pub struct OnMemory {
    reading: Reading,
}

/// Deviation of ln SINR where its anchor was never heard with the action.
const SPREAD_NAT: f64 = 1.0;

impl OnMemory {
    /// With this reading of the memory.
    pub fn new(reading: Reading) -> Self {
        Self { reading }
    }

    /// Factor on a SINR of an action with which its anchor was heard in this many frames.
    fn factor(&mut self, frames: f64) -> f64 {
        let deviations = match &mut self.reading {
            Reading::Guess => 0.0,
            Reading::Optimist => 1.0,
            Reading::Sample(rng) => normal(rng),
        };
        (deviations * SPREAD_NAT / (1.0 + frames).sqrt()).exp()
    }
}

impl<const A: usize> Choose<A> for OnMemory {
    fn next(&mut self, seen: &Seen<'_, A>) -> Actions {
        let tracker = seen.tracker;
        let config = tracker.config();
        let filter = tracker.filter();
        let [x, y] = filter.position_m().map(f64::from);
        let [u, v] = filter.velocity_m_s().map(f64::from);
        let at = [x + seen.elapsed_s * u, y + seen.elapsed_s * v];
        let mut predicted = Posterior::of(filter.agent_covariance().cast());
        predicted.predict(seen.elapsed_s, f64::from(config.motion.acceleration_density_m2_s3));

        // Sources, with the slope of their range and the variance that the map adds.
        let anchors = tracker.anchors();
        let direct = anchors.iter().enumerate().map(|(anchor, place)| {
            (Source::Direct { anchor }, place.position_m.map(f64::from), [0.0; 3], anchor)
        });
        let reflected = tracker.environment().iter().filter_map(|(slot, record)| {
            let (place, c) = tracker.image(slot)?;
            let source = Source::Virtual { anchor: record.anchor, slot };
            let covariance = [c.m11, c.m21, c.m22].map(f64::from);
            (tracker.environment().existence(slot) > CONFIRMED).then_some((
                source,
                [f64::from(place.x), f64::from(place.y)],
                covariance,
                record.anchor,
            ))
        });
        let mut informations = vec![[0.0; 3]; seen.actions];
        for (source, place, [xx, yx, yy], anchor) in direct.chain(reflected) {
            let rise = f64::from(anchors[anchor].height_m) - seen.tag_height_m;
            let (dx, dy) = (at[0] - place[0], at[1] - place[1]);
            let length = (dx * dx + dy * dy + rise * rise).sqrt().max(1e-6);
            let (gx, gy) = (dx / length, dy / length);
            let available = tracker.availability(source, at.map(|x| x as f32));
            let map_m2 = gx * gx * xx + 2.0 * gx * gy * yx + gy * gy * yy;
            for (action, sum) in informations.iter_mut().enumerate() {
                let memory = tracker.channel();
                let factor = self.factor(f64::from(memory.frames(anchor, action)));
                let sinr = factor * f64::from(memory.sinr(source, action));
                let Some(entry) = tracker.library().get(action) else { continue };
                let pulse = config.radio.pulse(entry);
                let range_m2 = f64::from(config.ranging.variance_inflation)
                    * f64::from(pulse.range_variance_m2(sinr as f32))
                    + f64::from(config.ranging.floor_m).powi(2)
                    + (f64::from(config.ranging.floor_pulses)
                        * f64::from(pulse.duration_s)
                        * SPEED_OF_LIGHT_M_S)
                        .powi(2);
                let found = f64::from(
                    memory.visibility(source)
                        * available
                        * detection_probability(sinr as f32, tracker.threshold()),
                );
                let weight = found / (range_m2 + map_m2);
                sum[0] += weight * gx * gx;
                sum[1] += weight * gx * gy;
                sum[2] += weight * gy * gy;
            }
        }
        vec![best(informations.iter().map(|information| {
            let mut after = predicted;
            after.update(*information);
            -after.position_entropy_nat()
        }))]
    }

    fn again(&self) -> Box<dyn Choose<A>> {
        Box::new(self.clone())
    }
}
