//! What the stages of a cycle are told, and what is known of tag, map and channels when a scan comes in.

use super::acquisition::{Acquisition, Landmark, Sweep};
use super::association::{Expectation, detection_probability};
use super::channel_memory::ChannelMemory;
use super::clutter::ClutterMemory;
use super::controller::{Library, Outlook, Visible};
use super::discovery::{Background, Viewpoint};
use super::environment::{CONFIRMED, EnvironmentMemory};
use super::motion::{Agent, MotionStep, PX, PY, VX, VY};
use super::overlap::{Arrival, overlap};
use super::range::{Regression, Sight};
use super::real::{Real, limited, smaller};
use super::receiver::Scan;
use super::state_filter::StateFilter;
use cogmint_core::model::detection::HIDDEN_DETECTION;
use cogmint_core::model::observation::TagHeight;
use cogmint_core::model::source::Source;
use cogmint_core::perceptor::expectation::Sighting;
use cogmint_core::{Anchor, Config};

/// What is told, and does not change in a cycle.
#[derive(Clone, Copy)]
pub struct Told<'a, T> {
    /// The configuration.
    pub config: &'a Config,
    /// The anchors.
    pub anchors: &'a [Anchor],
    /// The actions.
    pub library: &'a Library<T>,
    /// Height of the tag, if it is known.
    pub tag_height: Option<TagHeight>,
}

impl<T: Real> Told<'_, T> {
    /// Where an anchor is seen from; at the height of the tag where that is unknown.
    pub fn sight(&self, anchor: usize) -> Sight<T> {
        let anchor = &self.anchors[anchor];
        let height_m = self
            .tag_height
            .map_or([T::ZERO; 2], |tag| [T::of(anchor.height_m) - T::of(tag.mean_m), T::of(tag.std_m)]);
        Sight { anchor_m: anchor.position_m.map(T::of), height_m }
    }
}

/// What a source is expected to show in a scan.
#[derive(Clone, Copy, Debug)]
pub struct Expected<T> {
    /// The line of its range.
    pub regression: Regression<T>,
    /// What association makes of it.
    pub feature: Expectation<T>,
    /// Probability that it is found if nothing hides it but the noise.
    pub found: T,
    /// Whether it can be seen.
    pub sighting: Sighting,
}

/// How probable it is that the path of an existing source is found.
#[derive(Clone, Copy, Debug)]
pub struct Detection<T> {
    /// The probability.
    pub probability: T,
    /// See [`Expected::found`].
    pub found: T,
    /// See [`Expected::sighting`].
    pub sighting: Sighting,
}

/// What is known of tag, map and channels.
#[derive(Clone, Copy)]
pub struct Known<'a, T> {
    /// Tag and virtual anchors.
    pub filter: &'a StateFilter<T>,
    /// Which virtual anchors exist.
    pub environment: &'a EnvironmentMemory<T>,
    /// How well sources are heard.
    pub channel: &'a ChannelMemory<T>,
    /// What nothing explains.
    pub clutter: &'a ClutterMemory<T>,
}

impl<T: Real> Known<'_, T> {
    /// What the sources of a scan's anchor are expected to show in it: the direct path, then its virtual anchors by slot.
    pub fn expect(&self, told: &Told<'_, T>, scan: &Scan<T>) -> Vec<Expected<T>> {
        let sight = told.sight(scan.anchor);
        let mut expected = Vec::new();
        for source in self.environment.sources_of(scan.anchor) {
            let regression = self.filter.regress(source, &sight);
            let Detection { probability, found, sighting } =
                self.detection(told, scan, source, Some(regression.range_m));
            let feature = Expectation {
                range_m: regression.range_m,
                variance_m2: regression.variance_m2(),
                existence: self.environment.existence(source),
                detection: probability,
            };
            expected.push(Expected { regression, feature, found, sighting });
        }
        if scan.frame.is_some() {
            let pulse = told.library.pulse(scan.action, &told.config.radio);
            let mut arrivals = Vec::new();
            for Expected { regression, feature, .. } in &expected {
                arrivals.push(Arrival {
                    range_m: feature.range_m,
                    presence: feature.existence * feature.detection,
                    sinr: self.channel.sinr(regression.source, scan.action),
                });
            }
            for (k, Expected { regression, feature, .. }) in expected.iter_mut().enumerate() {
                let (variance_m2, detection) = overlap(&pulse, &arrivals, k, feature.detection);
                regression.residual_m2 += variance_m2;
                feature.variance_m2 = regression.variance_m2();
                feature.detection = detection;
            }
        }
        expected
    }

    /// How probable it is that the path of an existing source is found in a scan, at a range or anywhere: in frames a matter of
    /// SINR, as remembered, or over the noise of this frame where that is less.
    pub fn detection(
        &self,
        told: &Told<'_, T>,
        scan: &Scan<T>,
        source: Source,
        range_m: Option<T>,
    ) -> Detection<T> {
        let usual = T::of(told.config.association.detection_probability);
        let Some(frame) = &scan.frame else {
            return Detection { probability: usual, found: usual, sighting: Sighting::Open };
        };
        let mut sinr = self.channel.sinr(source, scan.action);
        if let Some(range_m) = range_m
            && let Some(level) = scan.level(range_m)
            && let Some(now) = self.channel.sinr_over(source, scan.action, range_m, level)
        {
            sinr = smaller(sinr, now);
        }
        let found = detection_probability(sinr, frame.threshold);
        let least = T::of(HIDDEN_DETECTION);
        let (probability, hidden) = if self.channel.has_seen(source) {
            let probability = self.channel.visibility(source) * found;
            (probability, probability <= least)
        } else if self.environment.is_unseen(source) {
            (least, true)
        } else {
            (usual, false)
        };
        let sighting = if hidden { Sighting::Hidden } else { Sighting::Open };
        Detection { probability: limited(probability, least, usual), found, sighting }
    }

    /// A scan with all that its measurements may be, for a tag that may be anywhere.
    pub fn sweep(&self, told: &Told<'_, T>, scan: &Scan<T>, acquisition: &Acquisition<T>) -> Sweep<T> {
        let anchor = scan.anchor;
        let sight = told.sight(anchor);
        let mut landmarks = Vec::new();
        for source in self.environment.sources_of(anchor) {
            let (position_m, covariance_m2) = match source {
                Source::Direct { .. } => (sight.anchor_m, [[T::ZERO; 2]; 2]),
                Source::Virtual { slot, .. } => {
                    (self.filter.virtual_anchor_m(slot), self.filter.virtual_anchor_covariance_m2(slot))
                }
            };
            let detection = self.detection(told, scan, source, None).probability;
            landmarks.push(Landmark {
                position_m,
                covariance_m2,
                height_m: sight.height_m,
                detection: self.environment.existence(source) * detection,
            });
        }
        let clutter = self.clutter.clutter(anchor);
        let all_per_m = clutter.all_per_m;
        let usual = T::of(told.config.association.detection_probability);
        let unmapped = (T::ONE - clutter.false_alarms_per_m / all_per_m) * usual;
        Sweep {
            anchor,
            measurements: scan.measurements.clone(),
            direct: landmarks.remove(0),
            reflections: landmarks,
            bias_m: self.filter.bias_m(anchor),
            bias_variance_m2: self.filter.bias_variance_m2(anchor),
            all_per_m: acquisition.backgrounds(anchor, &scan.measurements, all_per_m, unmapped),
            false_alarms_per_m: clutter.false_alarms_per_m,
            anywhere_per_m: T::ONE / T::of(told.config.ranging.max_range_m),
        }
    }

    /// Where an anchor's candidates are seen from, its direct path being expected so, and what else leftovers may be.
    pub fn discovery_view(
        &self,
        told: &Told<'_, T>,
        anchor: usize,
        direct: &Regression<T>,
    ) -> (Viewpoint<T>, Background<T>) {
        let sight = told.sight(anchor);
        let viewpoint = Viewpoint {
            agent: self.filter.agent(),
            height_m: sight.height_m,
            bias_m: self.filter.bias_m(anchor),
            direct_m: direct.range_m,
            direct_variance_m2: direct.variance_m2(),
        };
        let clutter = self.clutter.clutter(anchor);
        let background = Background {
            all_per_m: clutter.all_per_m,
            false_alarms_per_m: clutter.false_alarms_per_m,
            detection_probability: T::of(told.config.association.detection_probability),
        };
        (viewpoint, background)
    }

    /// The sources planning counts on: all direct paths, and the confirmed virtual anchors by slot.
    pub fn visible(&self, told: &Told<'_, T>) -> Vec<Visible<T>> {
        let mut visible = Vec::new();
        for anchor in 0..told.anchors.len() {
            let sight = told.sight(anchor);
            visible.push(Visible {
                source: Source::Direct { anchor },
                position_m: sight.anchor_m,
                height_m: sight.height_m[0],
                covariance_m2: [[T::ZERO; 2]; 2],
            });
        }
        for (slot, record) in self.environment.in_use() {
            if record.existence > T::of(CONFIRMED) {
                visible.push(Visible {
                    source: Source::Virtual { anchor: record.anchor, slot },
                    position_m: self.filter.virtual_anchor_m(slot),
                    height_m: told.sight(record.anchor).height_m[0],
                    covariance_m2: self.filter.virtual_anchor_covariance_m2(slot),
                });
            }
        }
        visible
    }
}

/// Where planning starts from.
pub fn outlook<T: Real>(config: &Config, agent: &Agent<T>, threshold: T, elapsed_s: T) -> Outlook<T> {
    Outlook {
        position_m: [agent.mean[PX], agent.mean[PY]],
        velocity_m_s: [agent.mean[VX], agent.mean[VY]],
        covariance: agent.covariance.clone(),
        elapsed_s,
        step: MotionStep::new(&config.motion, elapsed_s),
        variance_inflation: T::of(config.ranging.variance_inflation),
        range_floor_m: T::of(config.ranging.floor_m),
        radio: config.radio,
        threshold,
    }
}
