//! Values that pass from stage to stage: what one stage's state says in the terms of another.

use crate::config::Config;
use crate::controller::planning::{PlanningState, Visible};
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::{Background, Viewpoint};
use crate::memory::environment::{CONFIRMED, EnvironmentMemory};
use crate::model::anchor::Anchor;
use crate::model::availability::{Paths, WallNow, Walls};
use crate::model::channel::{ChannelKnowledge, ChannelPrior};
use crate::model::image::Sequence;
use crate::model::motion::Agent;
use crate::model::observation::TagHeight;
use crate::model::plan::FloorPlan;
use crate::model::range::Regression;
use crate::model::source::{Sight, Source};
use crate::model::work::{BACKGROUND, COMPARISON, LEG, PAIR, SOURCE, Work};
use crate::perceptor::expectation::{Expectations, Prospect, detection};
use crate::perceptor::scan::Scan;
use crate::perceptor::state_filter::StateFilter;
use crate::radio::library::Library;
use crate::real::{larger, sqrt};
use heapless::Vec;
use nalgebra::Matrix2;

/// What is told and does not change.
#[derive(Clone, Copy)]
pub(super) struct Told<'a, const ANCHORS: usize, const ACTIONS: usize> {
    pub(super) config: &'a Config,
    pub(super) anchors: &'a Vec<Anchor, ANCHORS>,
    pub(super) library: &'a Library<ACTIONS>,
    pub(super) tag_height: Option<TagHeight>,
    /// Where the antenna is on the body of the tag, metres.
    pub(super) lever_arm_m: [f32; 2],
}

impl<const ANCHORS: usize, const ACTIONS: usize> Told<'_, ANCHORS, ACTIONS> {
    /// Where an anchor is seen from the tag.
    pub(super) fn sight(&self, anchor: usize) -> Option<Sight> {
        let anchor = self.anchors.get(anchor)?;
        Some(Sight {
            anchor_m: anchor.position_m,
            height_m: self.height_m(anchor),
            height_std_m: self.tag_height.map_or(0.0, |height| height.std_m),
            lever_arm_m: self.lever_arm_m,
        })
    }

    /// Height of an anchor above the tag, metres; 0 where the tag's is not known.
    fn height_m(&self, anchor: &Anchor) -> f32 {
        self.tag_height.map_or(0.0, |height| anchor.height_m - height.mean_m)
    }
}

/// Where the tag may be.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) position_m: [f32; 2],
    /// Standard deviation per axis, metres.
    pub(super) std_m: f32,
}

impl Place {
    /// As an agent is known.
    pub(super) fn of(agent: &Agent) -> Self {
        let c = &agent.covariance;
        Self { position_m: [agent.mean.x, agent.mean.y], std_m: sqrt(larger(0.5 * (c.m11 + c.m22), 0.0)) }
    }
}

/// The plan with its walls as they stand now, as far as they are believed to be there; whether they `hide` paths at all, and the
/// share that a wall lets `through` if it is there.
pub(super) fn walls_now<
    'a,
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
>(
    plan: &'a FloorPlan<SEGMENTS>,
    filter: &StateFilter<ANCHORS, SURFACES>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    hide: bool,
    through: impl Fn(usize) -> f32,
) -> Walls<'a, SEGMENTS> {
    let mut walls = Walls::new(plan, |index, wall| {
        let slot = wall.surface.map(usize::from);
        let (line, std_m) = match slot.and_then(|slot| filter.surface(slot)) {
            Some((_, state, c)) => (wall.line.moved(state.x, state.y), sqrt(larger(c.m11, 0.0))),
            None => (wall.line, wall.told.offset_std_m),
        };
        let existence =
            slot.and_then(|slot| environment.surface(slot)).map_or(1.0, |record| record.existence);
        WallNow { line, std_m, through: 1.0 - existence * (1.0 - through(index)) }
    });
    if !hide {
        walls.open();
    }
    walls
}

/// What is known of tag, map and channels.
#[derive(Clone, Copy)]
pub(super) struct Known<
    'a,
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const ACTIONS: usize,
> {
    pub(super) filter: &'a StateFilter<ANCHORS, SURFACES>,
    pub(super) environment: &'a EnvironmentMemory<SURFACES, SOURCES>,
    pub(super) channel: &'a ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    pub(super) plan: &'a FloorPlan<SEGMENTS>,
    pub(super) walls: &'a Walls<'a, SEGMENTS>,
}

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const ACTIONS: usize,
> Known<'_, ANCHORS, SURFACES, SOURCES, SEGMENTS, ACTIONS>
{
    /// What every source of a scan's anchor is `expected` to show in it; `None` where that is not known.
    #[inline(never)]
    pub(super) fn expect<const PATHS: usize>(
        &self,
        told: &Told<'_, ANCHORS, ACTIONS>,
        scan: &Scan<PATHS>,
        expected: &mut Expectations<SOURCES>,
        work: &mut Work,
    ) -> Option<()> {
        let anchor = scan.anchor;
        let sight = told.sight(anchor)?;
        let place = Place::of(&self.filter.agent());
        let association = &told.config.association;
        let detection = |prospect: &Prospect| prospect.detection(scan, association.detection_probability);
        let source = Source::Direct { anchor };
        let paths = self.walls.paths(sight.anchor_m, place.position_m, place.std_m);
        let availability = paths.direct();
        let direct = self.prospect(scan, self.filter.regress(source, &sight, None)?, availability);
        expected.begin(&direct, &detection(&direct));
        for slot in self.environment.images_of(anchor) {
            let source = Source::Virtual { anchor, slot };
            let record = self.environment.get(slot)?;
            let (availability, sequence) = self.available(&paths, &record.sequence);
            let regression = self.filter.regress(source, &sight, Some(&sequence))?;
            let image = self.prospect(scan, regression, availability);
            expected.add(&image, self.environment.existence(slot), &detection(&image));
        }
        if let Some(action) = told.library.get(scan.action)
            && scan.is_framed()
        {
            expected.disturb(&told.config.radio.pulse(action));
            let sources = 1 + expected.expectations.len();
            work.add(PAIR, sources * sources / 2);
        }
        let measurements = scan.measurements.len();
        work.add_each(SOURCE, 1 + expected.expectations.len(), measurements);
        work.add(BACKGROUND, measurements * measurements);
        work.add(LEG, paths.legs() as usize);
        work.add(COMPARISON, 1);
        Some(())
    }

    /// What is known of a source before a scan.
    #[inline(always)] // built where it is used
    fn prospect<const PATHS: usize>(
        &self,
        scan: &Scan<PATHS>,
        regression: Regression,
        availability: f32,
    ) -> Prospect {
        let Regression { source, range_m, .. } = regression;
        let prior = channel_prior(scan, source, self.channel);
        let level = if prior.seen { scan.level(range_m) } else { None };
        Prospect {
            regression,
            channel: prior,
            sinr_here: level.and_then(|level| self.channel.sinr_over(source, scan.action, range_m, level)),
            is_unseen_image: self.environment.is_unseen(source),
            availability,
        }
    }

    /// Probability that the plan lets the path by way of these surfaces through to where `paths` lead, and in which order it
    /// meets them there. Surfaces of which no plan tells end nowhere.
    pub(super) fn available(&self, paths: &Paths<'_, SEGMENTS>, sequence: &Sequence) -> (f32, Sequence) {
        let wall_of = |surface: u8| self.plan.wall_of(usize::from(surface));
        let Some(first) = wall_of(sequence.first) else { return (1.0, *sequence) };
        let second = match sequence.second {
            None => None,
            Some(second) => match wall_of(second) {
                None => return (1.0, *sequence),
                second => second,
            },
        };
        let (Some(second), true) = (second, sequence.is_either_order) else {
            return (paths.reflected(first, second), *sequence);
        };
        let (availability, is_reversed) = paths.either_order([first, second]);
        (availability, if is_reversed { sequence.reversed() } else { *sequence })
    }

    /// An image as it is seen from a place: that of a source which is confirmed, and whose path the plan may let through.
    pub(super) fn seen_image(
        &self,
        told: &Told<'_, ANCHORS, ACTIONS>,
        slot: usize,
        place: &Place,
    ) -> Option<Visible> {
        let record = self.environment.get(slot)?;
        if self.environment.existence(slot) <= CONFIRMED {
            return None;
        }
        let anchor = told.anchors.get(record.anchor)?;
        let paths = self.walls.paths(anchor.position_m, place.position_m, place.std_m);
        let (availability, sequence) = self.available(&paths, &record.sequence);
        if availability <= 0.0 {
            return None; // It would tell nothing.
        }
        let (position, covariance_m2) = self.filter.placed(anchor.position_m, &sequence)?;
        Some(Visible {
            source: Source::Virtual { anchor: record.anchor, slot },
            position_m: [position.x, position.y],
            height_m: told.height_m(anchor),
            covariance_m2,
            availability,
        })
    }

    /// The sources planning counts on, as they are seen from a place: all direct paths, and the images that are confirmed.
    pub(super) fn visible<'s>(
        &'s self,
        told: &'s Told<'_, ANCHORS, ACTIONS>,
        place: Place,
    ) -> impl Iterator<Item = Visible> + Clone + 's {
        let direct = told.anchors.iter().enumerate().map(move |(index, anchor)| Visible {
            source: Source::Direct { anchor: index },
            position_m: anchor.position_m,
            height_m: told.height_m(anchor),
            covariance_m2: Matrix2::new(0.0, 0.0, 0.0, 0.0),
            availability: self.walls.paths(anchor.position_m, place.position_m, place.std_m).direct(),
        });
        let reflected =
            self.environment.iter().filter_map(move |(slot, _)| self.seen_image(told, slot, &place));
        direct.chain(reflected)
    }
}

/// What is known of the channel of a source in a scan: of ranges, only how probably nothing hides it.
fn channel_prior<const PATHS: usize>(
    scan: &Scan<PATHS>,
    source: Source,
    channel: &impl ChannelKnowledge,
) -> ChannelPrior {
    if scan.is_framed() { channel.prior(source, scan.action) } else { channel.of_ranges(source) }
}

/// Detection probability, wherever the tag is: of the direct path, and of every slot of the map (0 for free ones).
pub(super) fn detections_anywhere<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    told: &Told<'_, ANCHORS, ACTIONS>,
    scan: &Scan<PATHS>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    channel: &ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
) -> (f32, [f32; SOURCES]) {
    let of = |source: Source| {
        let prior = channel_prior(scan, source, channel);
        let told = told.config.association.detection_probability;
        detection(scan, told, &prior, None, environment.is_unseen(source), 1.0).probability
    };
    let mut detections = [0.0; SOURCES];
    for (slot, record) in environment.iter() {
        if let Some(detection) = detections.get_mut(slot) {
            *detection = of(Source::Virtual { anchor: record.anchor, slot });
        }
    }
    (of(Source::Direct { anchor: scan.anchor }), detections)
}

/// From where an anchor's candidates are seen by the leader, and what they compete with.
pub(super) fn leader_view<const ANCHORS: usize, const SURFACES: usize, const ACTIONS: usize>(
    told: &Told<'_, ANCHORS, ACTIONS>,
    leader: &StateFilter<ANCHORS, SURFACES>,
    clutter: &ClutterMemory<ANCHORS>,
    anchor: usize,
) -> Option<(Viewpoint, Background)> {
    let direct = leader.regress(Source::Direct { anchor }, &told.sight(anchor)?, None)?;
    discovery_view(told, leader, clutter, anchor, &direct)
}

/// From where an anchor's candidates are seen, and what they compete with; `direct` is the anchor's direct path as it was
/// expected.
pub(super) fn discovery_view<const ANCHORS: usize, const SURFACES: usize, const ACTIONS: usize>(
    told: &Told<'_, ANCHORS, ACTIONS>,
    filter: &StateFilter<ANCHORS, SURFACES>,
    clutter: &ClutterMemory<ANCHORS>,
    anchor: usize,
    direct: &Regression,
) -> Option<(Viewpoint, Background)> {
    let sight = told.sight(anchor)?;
    let (bias_m, _) = filter.bias_m(anchor)?;
    let viewpoint = Viewpoint {
        agent: filter.agent(),
        height_m: sight.height_m,
        height_std_m: sight.height_std_m,
        bias_m,
        direct_m: direct.range_m,
        direct_variance_m2: direct.variance_m2(),
    };
    let clutter = clutter.clutter(anchor);
    let background = Background {
        all_per_m: clutter.all_per_m,
        false_alarms_per_m: clutter.false_alarms_per_m,
        detection_probability: told.config.association.detection_probability,
    };
    Some((viewpoint, background))
}

/// Sources as they are seen from one place, kept.
pub(super) struct Seen<const ANCHORS: usize, const SOURCES: usize> {
    direct: Vec<Visible, ANCHORS>,
    images: Vec<Visible, SOURCES>,
}

impl<const ANCHORS: usize, const SOURCES: usize> Seen<ANCHORS, SOURCES> {
    /// No sources.
    pub(super) const NONE: Self = Self { direct: Vec::new(), images: Vec::new() };

    /// Keeps them.
    #[inline(always)] // built where it stays
    pub(super) fn new(sources: impl Iterator<Item = Visible>) -> Self {
        let mut seen = Self { direct: Vec::new(), images: Vec::new() };
        for source in sources {
            // One per anchor and one per slot: the pushes succeed.
            let _ = match source.source {
                Source::Direct { .. } => seen.direct.push(source),
                Source::Virtual { .. } => seen.images.push(source),
            };
        }
        seen
    }

    /// All of them.
    pub(super) fn iter(&self) -> impl Iterator<Item = Visible> + Clone + '_ {
        self.direct.iter().chain(&self.images).copied()
    }
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
        range_floor_pulses: config.ranging.floor_pulses,
        radio: config.radio,
        threshold,
    }
}
