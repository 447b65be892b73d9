//! What the stages of a cycle are told, and what is known of tag, map and channels when a scan comes in.

use super::association::{Expectation, detection_probability};
use super::availability::{WallNow, availability, either_order};
use super::channel_memory::ChannelMemory;
use super::clutter::ClutterMemory;
use super::controller::{Library, Outlook, Visible};
use super::discovery::{Background, Viewpoint};
use super::environment::{CONFIRMED, EnvironmentMemory};
use super::lateness::Lateness;
use super::motion::{Agent, MotionStep, PX, PY, VX, VY};
use super::overlap::{Arrival, overlap};
use super::plan::FloorPlan;
use super::proposal::{Landmark, Sweep};
use super::range::{Regression, Sight};
use super::real::{Real, larger, limited, ln, smaller, sqrt};
use super::receiver::Scan;
use super::state_filter::StateFilter;
use cogmint_core::model::detection::{HIDDEN_DETECTION, UNAVAILABLE_DETECTION};
use cogmint_core::model::image::Sequence;
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
    /// Where the antenna is on the tag's body, metres.
    pub lever_arm_m: [f32; 2],
}

impl<T: Real> Told<'_, T> {
    /// Where an anchor is seen from; at the height of the tag where that is unknown.
    pub fn sight(&self, anchor: usize) -> Sight<T> {
        let anchor = &self.anchors[anchor];
        let height_m = self
            .tag_height
            .map_or([T::ZERO; 2], |tag| [T::of(anchor.height_m) - T::of(tag.mean_m), T::of(tag.std_m)]);
        Sight { anchor_m: anchor.position_m.map(T::of), height_m, lever_arm_m: self.lever_arm_m.map(T::of) }
    }
}

/// What a source is expected to show in a scan.
#[derive(Clone, Copy, Debug)]
pub struct Expected<T> {
    /// The line of its range.
    pub regression: Regression<T>,
    /// What association makes of it.
    pub feature: Expectation<T>,
    /// Probability that it is found if nothing hides it but the plan and the noise.
    pub found: T,
    /// Whether it can be seen.
    pub sighting: Sighting,
    /// Share of its detection probability that does not rest on its coming out again.
    pub lasting: T,
    /// Probability that its path is there, found or not.
    pub present: T,
    /// ln SINR that it has then.
    pub sinr_ln: T,
    /// Whether a frame has shown it.
    pub is_seen: bool,
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
    /// See [`Expected::lasting`].
    pub lasting: T,
    /// SINR of its path where nothing hides it.
    pub sinr: T,
}

/// A source whose path may be found.
#[derive(Clone, Copy, Debug)]
pub struct Prospect<T> {
    /// Which one.
    pub source: Source,
    /// Where in the scan; none if that is not known.
    pub range_m: Option<T>,
    /// Probability that the plan lets its path through.
    pub availability: T,
}

impl<T: Real> Prospect<T> {
    /// Seen from anywhere, as if there were no walls.
    pub fn anywhere(source: Source) -> Self {
        Self { source, range_m: None, availability: T::ONE }
    }
}

/// Where the tag may be.
#[derive(Clone, Copy, Debug)]
pub struct Place<T> {
    /// Mean, metres.
    pub position_m: [T; 2],
    /// Standard deviation per axis, metres.
    pub std_m: T,
}

impl<T: Real> Place<T> {
    /// As an agent is known: of its axes the mean variance.
    pub fn of(agent: &Agent<T>) -> Self {
        let c = &agent.covariance;
        let variance = T::of(0.5) * (c[PX][PX] + c[PY][PY]);
        Self { position_m: [agent.mean[PX], agent.mean[PY]], std_m: sqrt(larger(variance, T::ZERO)) }
    }
}

/// The walls of the plan as they are believed to stand now. One that does not exist lets everything through, one that does this
/// share.
pub fn walls_now<T: Real>(
    plan: &FloorPlan<T>,
    filter: &StateFilter<T>,
    environment: &EnvironmentMemory<T>,
    through: impl Fn(usize) -> T,
) -> Vec<WallNow<T>> {
    let mut walls = Vec::new();
    for (index, wall) in plan.walls.iter().enumerate() {
        let mut now = wall.clone();
        let mut std_m = T::of(wall.told.offset_std_m);
        let mut existence = T::ONE;
        if let Some(slot) = wall.surface {
            if let Some((_, [offset_m, rotation], c)) = filter.surface(slot) {
                now.line = wall.line.moved(offset_m, rotation);
                std_m = sqrt(larger(c[0][0], T::ZERO));
            }
            if let Some(record) = environment.surfaces[slot] {
                existence = record.existence;
            }
        }
        let through = T::ONE - existence * (T::ONE - through(index));
        walls.push(WallNow::new(now, std_m, through));
    }
    walls
}

/// What is known of tag, map and channels.
#[derive(Clone, Copy)]
pub struct Known<'a, T> {
    /// Tag and surfaces.
    pub filter: &'a StateFilter<T>,
    /// Which surfaces exist, and what is seen in them.
    pub environment: &'a EnvironmentMemory<T>,
    /// How well sources are heard.
    pub channel: &'a ChannelMemory<T>,
    /// The plan.
    pub plan: &'a FloorPlan<T>,
    /// Its walls as they stood when the cycle began.
    pub walls: &'a [WallNow<T>],
}

impl<T: Real> Known<'_, T> {
    /// What the sources of a scan's anchor are expected to show in it: the direct path, then its images by slot.
    pub fn expect(&self, told: &Told<'_, T>, scan: &Scan<T>) -> Vec<Expected<T>> {
        let sight = told.sight(scan.anchor);
        let place = Place::of(&self.filter.agent());
        let mut expected = Vec::new();
        for source in self.environment.sources_of(scan.anchor) {
            let (availability, sequence) = self.available(told, source, &place);
            let regression = self.filter.regress(source, &sight, sequence.as_ref());
            let prospect = Prospect { source, range_m: Some(regression.range_m), availability };
            let Detection { probability, found, sighting, lasting, sinr } =
                detection(told, scan, self.environment, self.channel, &prospect);
            let feature = Expectation {
                range_m: regression.range_m,
                variance_m2: regression.variance_m2(),
                existence: self.environment.existence(source),
                detection: probability,
                lateness: Lateness::none(),
            };
            let least = T::of(UNAVAILABLE_DETECTION);
            expected.push(Expected {
                regression,
                feature,
                found,
                sighting,
                lasting,
                present: self.channel.present(source) * (least + (T::ONE - least) * availability),
                sinr_ln: ln(larger(sinr, T::of(f32::MIN_POSITIVE))),
                is_seen: self.channel.has_seen(source),
            });
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

    /// Probability that the plan lets the path of a source through to a place, and the order in which it meets its surfaces
    /// there. A surface that is no wall of the plan ends nowhere, and nothing is in front of it.
    pub fn available(&self, told: &Told<'_, T>, source: Source, place: &Place<T>) -> (T, Option<Sequence>) {
        let (availability, sequence) = self.hidden(told.sight(source.anchor()).anchor_m, source, place);
        (if told.config.belief.walls_hide_paths { availability } else { T::ONE }, sequence)
    }

    /// The same where the walls hide paths.
    fn hidden(&self, anchor_m: [T; 2], source: Source, place: &Place<T>) -> (T, Option<Sequence>) {
        let Place { position_m, std_m } = *place;
        let available = |walls: &[usize]| availability(self.walls, anchor_m, walls, position_m, std_m);
        let Some(sequence) = self.environment.sequence(source) else { return (available(&[]), None) };
        let walls: Option<Vec<usize>> = sequence.surfaces().map(|slot| self.plan.wall_of(slot)).collect();
        match walls.as_deref() {
            Some(&[first, second]) if sequence.is_either_order => {
                let (availability, is_reversed) =
                    either_order(self.walls, anchor_m, [first, second], position_m, std_m);
                (availability, Some(if is_reversed { sequence.reversed() } else { sequence }))
            }
            Some(walls) => (available(walls), Some(sequence)),
            None => (T::ONE, Some(sequence)),
        }
    }

    /// The sources planning counts on, as they are seen from a place: all direct paths, and the confirmed images by slot.
    pub fn visible(&self, told: &Told<'_, T>, place: &Place<T>) -> Vec<Visible<T>> {
        let direct = (0..told.anchors.len()).map(|anchor| Source::Direct { anchor });
        let images = self.environment.in_use().into_iter();
        let images = images.map(|(slot, record)| Source::Virtual { anchor: record.anchor, slot });
        let mut visible = Vec::new();
        for source in
            direct.chain(images.filter(|image| self.environment.existence(*image) > T::of(CONFIRMED)))
        {
            let sight = told.sight(source.anchor());
            let (availability, sequence) = self.available(told, source, place);
            let (position_m, covariance_m2) = match sequence {
                None => (sight.anchor_m, [[T::ZERO; 2]; 2]),
                Some(sequence) => self.filter.placed(sight.anchor_m, &sequence),
            };
            let height_m = sight.height_m[0];
            visible.push(Visible { source, position_m, height_m, covariance_m2, availability });
        }
        visible
    }
}

/// How probable it is that the path of an existing source is found in a scan: in frames a matter of SINR, as remembered, or over
/// the noise of this frame where that is less; all of it where the plan lets the path through, hardly any where it does not.
pub fn detection<T: Real>(
    told: &Told<'_, T>,
    scan: &Scan<T>,
    environment: &EnvironmentMemory<T>,
    channel: &ChannelMemory<T>,
    prospect: &Prospect<T>,
) -> Detection<T> {
    let Prospect { source, range_m, availability } = *prospect;
    let usual = T::of(told.config.association.detection_probability);
    let least = T::of(HIDDEN_DETECTION);
    let (mut found, mut clear) = (usual, usual);
    let lasting;
    let mut unknown = false;
    let mut sinr = T::ZERO;
    if let Some(frame) = &scan.frame {
        sinr = channel.sinr(source, scan.action);
        if let Some(range_m) = range_m
            && let Some(level) = scan.level(range_m)
            && let Some(now) = channel.sinr_over(source, scan.action, range_m, level)
        {
            sinr = smaller(sinr, now);
        }
        found = detection_probability(sinr, frame.threshold);
        lasting = channel.lasting(source)[0];
        if channel.has_seen(source) {
            clear = channel.visibility(source)[0] * found;
        } else if environment.is_unseen(source) {
            (clear, unknown) = (least, true);
        }
    } else {
        clear = channel.visibility(source)[1] * usual;
        lasting = channel.lasting(source)[1];
    }
    let hidden = unknown || clear * availability <= least;
    let open = limited(clear, least, usual);
    // Order: what the walls take away from it.
    let probability = open - (open - T::of(UNAVAILABLE_DETECTION)) * (T::ONE - availability);
    let found = found * availability;
    Detection {
        probability,
        found,
        lasting: smaller(lasting * found / probability, T::ONE),
        sighting: if hidden { Sighting::Hidden } else { Sighting::Open },
        sinr,
    }
}

/// Where an anchor's candidates are seen from, its direct path being expected so, and what else leftovers may be.
pub fn discovery_view<T: Real>(
    told: &Told<'_, T>,
    filter: &StateFilter<T>,
    clutter: &ClutterMemory<T>,
    anchor: usize,
    direct: &Regression<T>,
) -> (Viewpoint<T>, Background<T>) {
    let viewpoint = Viewpoint {
        agent: filter.agent(),
        height_m: told.sight(anchor).height_m,
        bias_m: filter.bias_m(anchor),
        direct_m: direct.range_m,
        direct_variance_m2: direct.variance_m2(),
    };
    let clutter = clutter.clutter(anchor);
    let background = Background {
        all_per_m: clutter.all_per_m,
        false_alarms_per_m: clutter.false_alarms_per_m,
        detection_probability: T::of(told.config.association.detection_probability),
    };
    (viewpoint, background)
}

/// The same from the leader's state.
pub fn leader_view<T: Real>(
    told: &Told<'_, T>,
    leader: &StateFilter<T>,
    clutter: &ClutterMemory<T>,
    anchor: usize,
) -> (Viewpoint<T>, Background<T>) {
    let direct = leader.regress(Source::Direct { anchor }, &told.sight(anchor), None);
    discovery_view(told, leader, clutter, anchor, &direct)
}

/// A scan with what places expect of it, by the trusted state.
pub fn sweep<T: Real>(
    told: &Told<'_, T>,
    trusted: &StateFilter<T>,
    environment: &EnvironmentMemory<T>,
    channel: &ChannelMemory<T>,
    clutter: &ClutterMemory<T>,
    scan: &Scan<T>,
) -> Sweep<T> {
    let anchor = scan.anchor;
    let sight = told.sight(anchor);
    let mut landmarks = Vec::new();
    for source in environment.sources_of(anchor) {
        let (position_m, c) = match environment.sequence(source) {
            None => (sight.anchor_m, [[T::ZERO; 2]; 2]),
            Some(sequence) => trusted.placed(sight.anchor_m, &sequence),
        };
        let found = detection(told, scan, environment, channel, &Prospect::anywhere(source)).probability;
        let detection = environment.existence(source) * found;
        landmarks.push(Landmark { position_m, covariance_m2: [c[0][0], c[1][0], c[1][1]], detection });
    }
    Sweep {
        measurements: scan.measurements.clone(),
        height_m: sight.height_m[0],
        bias_m: trusted.bias_m(anchor),
        bias_m2: trusted.bias_variance_m2(anchor),
        clutter: clutter.clutter(anchor),
        landmarks,
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
        range_floor_pulses: T::of(config.ranging.floor_pulses),
        radio: config.radio,
        threshold,
    }
}
