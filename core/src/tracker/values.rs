//! Values that pass from stage to stage: what one stage's state says in the terms of another.

use super::stages::Expected;
use crate::config::Config;
use crate::controller::planning::{PlanningState, Visible};
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::{Background, Viewpoint};
use crate::memory::environment::{CONFIRMED, EnvironmentMemory};
use crate::model::anchor::Anchor;
use crate::model::channel::{ChannelKnowledge, ChannelPrior};
use crate::model::motion::Agent;
use crate::model::observation::TagHeight;
use crate::model::range::Regression;
use crate::model::source::{Sight, Source};
use crate::perceptor::expectation::{Expectations, Prospect, detection};
use crate::perceptor::receiver::Scans;
use crate::perceptor::scan::Scan;
use crate::perceptor::state_filter::StateFilter;
use crate::radio::library::Library;
use heapless::Vec;
use nalgebra::Matrix2;

/// What is told and does not change.
#[derive(Clone, Copy)]
pub(super) struct Told<'a, const ANCHORS: usize, const ACTIONS: usize> {
    pub(super) config: &'a Config,
    pub(super) anchors: &'a Vec<Anchor, ANCHORS>,
    pub(super) library: &'a Library<ACTIONS>,
    pub(super) tag_height: Option<TagHeight>,
}

impl<const ANCHORS: usize, const ACTIONS: usize> Told<'_, ANCHORS, ACTIONS> {
    /// Where an anchor is seen from the tag.
    pub(super) fn sight(&self, anchor: usize) -> Option<Sight> {
        let anchor = self.anchors.get(anchor)?;
        Some(Sight {
            anchor_m: anchor.position_m,
            height_m: self.height_m(anchor),
            height_std_m: self.tag_height.map_or(0.0, |height| height.std_m),
        })
    }

    /// Height of an anchor above the tag, metres; 0 where the tag's is not known.
    fn height_m(&self, anchor: &Anchor) -> f32 {
        self.tag_height.map_or(0.0, |height| anchor.height_m - height.mean_m)
    }
}

/// What is known of tag, map and channels.
#[derive(Clone, Copy)]
pub(super) struct Known<'a, const ANCHORS: usize, const VAS: usize, const ACTIONS: usize> {
    pub(super) filter: &'a StateFilter<ANCHORS, VAS>,
    pub(super) environment: &'a EnvironmentMemory<VAS>,
    pub(super) channel: &'a ChannelMemory<ANCHORS, VAS, ACTIONS>,
    pub(super) clutter: &'a ClutterMemory<ANCHORS>,
}

impl<const ANCHORS: usize, const VAS: usize, const ACTIONS: usize> Known<'_, ANCHORS, VAS, ACTIONS> {
    /// What every scan is expected to show.
    #[inline(never)]
    pub(super) fn expect_all<'a, const PATHS: usize>(
        &self,
        told: &Told<'_, ANCHORS, ACTIONS>,
        scans: &'a Scans<ANCHORS, PATHS>,
    ) -> Expected<'a, ANCHORS, VAS, PATHS> {
        let mut all = Vec::new();
        for scan in scans {
            if let Some(expected) = self.expect(told, scan) {
                // As many as scans: the push succeeds.
                let _ = all.push((scan, expected));
            }
        }
        all
    }

    /// What every source of a scan's anchor is expected to show in it.
    #[inline(never)]
    fn expect<const PATHS: usize>(
        &self,
        told: &Told<'_, ANCHORS, ACTIONS>,
        scan: &Scan<PATHS>,
    ) -> Option<Expectations<VAS>> {
        let anchor = scan.anchor;
        let sight = told.sight(anchor)?;
        let association = &told.config.association;
        let prospect = |source: Source| {
            Some(prospect(scan, self.filter.regress(source, &sight)?, self.environment, self.channel))
        };
        let direct = prospect(Source::Direct { anchor })?;
        let detection = |prospect: &Prospect| prospect.detection(scan, association.detection_probability);
        let mut expected = Expectations::new(&direct, &detection(&direct));
        for slot in self.environment.images_of(anchor) {
            let image = prospect(Source::Virtual { anchor, slot })?;
            let existence = self.environment.get(slot)?.existence;
            expected.add(&image, existence, &detection(&image));
        }
        if let Some(action) = told.library.get(scan.action)
            && scan.is_framed()
        {
            expected.disturb(&told.config.radio.pulse(action));
        }
        Some(expected)
    }

    /// Detection probability, wherever the tag is: of the direct path, and of every slot of the map (0 for free ones).
    pub(super) fn detections_anywhere<const PATHS: usize>(
        &self,
        told: &Told<'_, ANCHORS, ACTIONS>,
        scan: &Scan<PATHS>,
    ) -> (f32, [f32; VAS]) {
        let of = |source: Source| detection_anywhere(told, scan, source, self.environment, self.channel);
        let mut detections = [0.0; VAS];
        for (slot, record) in self.environment.iter() {
            if let Some(detection) = detections.get_mut(slot) {
                *detection = of(Source::Virtual { anchor: record.anchor, slot });
            }
        }
        (of(Source::Direct { anchor: scan.anchor }), detections)
    }

    /// From where an anchor's candidates are seen, and what they compete with; `direct` is the anchor's direct path as it was
    /// expected.
    pub(super) fn discovery_view(
        &self,
        told: &Told<'_, ANCHORS, ACTIONS>,
        anchor: usize,
        direct: &Regression,
    ) -> Option<(Viewpoint, Background)> {
        let sight = told.sight(anchor)?;
        let (bias_m, _) = self.filter.bias_m(anchor)?;
        let viewpoint = Viewpoint {
            agent: self.filter.agent(),
            height_m: sight.height_m,
            height_std_m: sight.height_std_m,
            bias_m,
            direct_m: direct.range_m,
            direct_variance_m2: direct.variance_m2(),
        };
        let clutter = self.clutter.clutter(anchor);
        let background = Background {
            all_per_m: clutter.all_per_m,
            false_alarms_per_m: clutter.false_alarms_per_m,
            detection_probability: told.config.association.detection_probability,
        };
        Some((viewpoint, background))
    }
}

/// What is known of a source before a scan.
fn prospect<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>(
    scan: &Scan<PATHS>,
    regression: Regression,
    environment: &EnvironmentMemory<VAS>,
    channel: &ChannelMemory<ANCHORS, VAS, ACTIONS>,
) -> Prospect {
    let Regression { source, range_m, .. } = regression;
    let prior = channel_prior(scan, source, channel);
    let level = if prior.seen { scan.level(range_m) } else { None };
    Prospect {
        regression,
        channel: prior,
        sinr_here: level.and_then(|level| channel.sinr_over(source, scan.action, range_m, level)),
        is_unseen_image: environment.is_unseen(source),
    }
}

/// What is known of the channel of a source in a scan; nothing without a frame.
fn channel_prior<const PATHS: usize>(
    scan: &Scan<PATHS>,
    source: Source,
    channel: &impl ChannelKnowledge,
) -> ChannelPrior {
    if scan.is_framed() { channel.prior(source, scan.action) } else { ChannelPrior::UNKNOWN }
}

fn detection_anywhere<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>(
    told: &Told<'_, ANCHORS, ACTIONS>,
    scan: &Scan<PATHS>,
    source: Source,
    environment: &EnvironmentMemory<VAS>,
    channel: &ChannelMemory<ANCHORS, VAS, ACTIONS>,
) -> f32 {
    let prior = channel_prior(scan, source, channel);
    let told = told.config.association.detection_probability;
    detection(scan, told, &prior, None, environment.is_unseen(source)).probability
}

/// The sources planning counts on: all direct paths, and the virtual anchors that are confirmed.
pub(super) fn visible<'a, const ANCHORS: usize, const VAS: usize, const ACTIONS: usize>(
    told: Told<'a, ANCHORS, ACTIONS>,
    environment: &'a EnvironmentMemory<VAS>,
    filter: &'a StateFilter<ANCHORS, VAS>,
) -> impl Iterator<Item = Visible> + Clone + 'a {
    let direct = told.anchors.iter().enumerate().map(move |(index, anchor)| Visible {
        source: Source::Direct { anchor: index },
        position_m: anchor.position_m,
        height_m: told.height_m(anchor),
        covariance_m2: Matrix2::new(0.0, 0.0, 0.0, 0.0),
    });
    let reflected = environment.iter().filter_map(move |(slot, record)| {
        if record.existence <= CONFIRMED {
            return None;
        }
        let (position, covariance_m2) = filter.virtual_anchor(slot)?;
        Some(Visible {
            source: Source::Virtual { anchor: record.anchor, slot },
            position_m: [position.x, position.y],
            height_m: told.height_m(told.anchors.get(record.anchor)?),
            covariance_m2,
        })
    });
    direct.chain(reflected)
}

/// Where planning starts from.
pub(super) fn planning_state(
    config: &Config,
    agent: &Agent,
    threshold: f32,
    elapsed_s: f32,
) -> PlanningState {
    PlanningState {
        position_m: [agent.mean.x, agent.mean.y],
        velocity_m_s: [agent.mean.z, agent.mean.w],
        covariance: agent.covariance,
        elapsed_s,
        motion: config.motion,
        variance_inflation: config.ranging.variance_inflation,
        range_floor_m: config.ranging.floor_m,
        radio: config.radio,
        threshold,
    }
}
