//! What a cycle reports.

use crate::model::surface::Line;
use crate::radio::library::Action;
use nalgebra::Matrix2;

/// What a cycle did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CycleReport {
    /// Number of the cycle, from 0.
    pub cycle: u32,
    /// Estimated position, metres: of the leading place.
    pub position_m: [f32; 2],
    /// Covariance of the position over all places that the tag may be at, square metres.
    pub position_covariance_m2: Matrix2<f32>,
    /// Estimated velocity, m/s: that of the leading component, the same that [`crate::Tracker::filter`] shows. Meaningless while
    /// `searching`.
    pub velocity_m_s: [f32; 2],
    /// Its covariance in the leading component alone, m^2/s^2: unlike that of the position, other places do not count.
    pub velocity_covariance_m2_s2: Matrix2<f32>,
    /// Probability that the tag is at the leading place.
    pub probability: f32,
    /// Entropy of the position before the measurements, nats.
    pub predicted_entropy_nat: f32,
    /// And after.
    pub entropy_nat: f32,
    /// Reward of the action applied, in the unit of the reward configured.
    pub reward: f32,
    /// Anchors heard.
    pub anchors_heard: u32,
    /// Paths or ranges received and kept.
    pub measurements: u32,
    /// Paths or ranges received that were left out because a scan keeps no more than `PATHS`, searching or not.
    pub left_out: u32,
    /// What the cycle has cost, about in instructions of a Cortex-M4F ([`crate::model::work`]).
    pub work: u32,
    /// Frames whose estimate was ended by [`WorkLimits::frame`](crate::config::WorkLimits::frame): weak paths may be missing.
    pub cut_short: u32,
    /// Established components of the belief that counted and found no room: each was joined with the nearest one. There is room for
    /// as many as the belief has, and for as many as [`WorkLimits`](crate::config::WorkLimits) allow.
    pub crowded_out: u32,
    /// Of the measurements, how many more likely than not belong to a known feature.
    pub associated: u32,
    /// Whether it is not known (yet, or any more) where the tag is: no place is more probable than all others together.
    pub searching: bool,
    /// Whether that is so since this cycle.
    pub lost: bool,
    /// Mean normalised innovation squared of the ranges associated: near 1 where the filter knows how wrong it is; 0
    /// where nothing was associated.
    pub nis: f32,
    /// Virtual anchors discovered in this cycle.
    pub discovered: u32,
    /// Virtual anchors forgotten in this cycle, including those that gave way to a discovery.
    pub forgotten: u32,
    /// Images that one surface explained together with others, and that became images in it.
    pub joined: u32,
    /// Discoveries dropped because the map was full.
    pub map_full: u32,
    /// Index of the action this cycle's frames were received with (the first anchor's where they differ; the one
    /// asked for where there was none): the reward is credited to it.
    pub action: usize,
    /// Index of the next action: the first anchor's where each has its own ([`crate::Tracker::controller_of`] has all).
    pub next_action: usize,
    /// Index of the action after that, which the next frame is to announce; `None` where nothing is announced.
    pub announced_action: Option<usize>,
    /// The next action, carrier and pulse.
    pub next: Action,
    /// Parts of the state in which bits have flipped.
    pub integrity: Integrity,
}

/// Parts of the tracker's state that are checked, and reset, each by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Part {
    /// Where the tag is, and the states of the surfaces. Broken components are dropped; with the last one the tag is searched for, and
    /// if no map is left either, the walls are where the plan told.
    Belief,
    /// The channel estimator's tables: made anew, nothing is lost.
    Estimator,
    /// Gain control, and when anchors were heard.
    Receiver,
    /// Which surfaces and sources exist: broken entries are forgotten.
    Environment,
    /// What walls let through.
    Transmission,
    /// Candidates for virtual anchors.
    Discovery,
    /// What belongs to nothing known.
    Clutter,
    /// How late ranges are.
    Lateness,
    /// SINR of sources and actions.
    Channel,
    /// Values of actions and the choice of the next one.
    Controllers,
    /// The number of the cycle, where the tag was last heard, and the lever arm of the antenna in use.
    Cycle,
}

impl Part {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Belief,
        Self::Estimator,
        Self::Receiver,
        Self::Environment,
        Self::Transmission,
        Self::Discovery,
        Self::Clutter,
        Self::Lateness,
        Self::Channel,
        Self::Controllers,
        Self::Cycle,
    ];
}

/// A set of parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Parts(u16);

impl Parts {
    /// None.
    pub const NONE: Self = Self(0);

    /// Whether a part is in it.
    pub fn has(self, part: Part) -> bool {
        self.0 & 1 << part as u16 != 0
    }

    /// Whether none is.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// One bit for each part, in the order of [`Part`].
    pub fn bits(self) -> u16 {
        self.0
    }

    pub(crate) fn add(&mut self, part: Part) {
        self.0 |= 1 << part as u16;
    }

    pub(crate) fn add_all(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

/// What has become of the state because bits have flipped in memory, as far as it was looked at: every part in every cycle, or in one of eight. Of bits that flipped in what the tracker was told says
/// [`crate::Error::ToldChanged`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Integrity {
    /// Parts that were not what they had been at the end of the last cycle. They were used as they are if they are not `reset`: a
    /// snapshot from before is better.
    pub flipped: Parts,
    /// Parts that were reset because numbers were not finite, or not what they may be, or the part was broken otherwise.
    pub reset: Parts,
}

impl Integrity {
    /// Nothing has flipped.
    pub const NONE: Self = Self { flipped: Parts::NONE, reset: Parts::NONE };

    /// Whether nothing has flipped.
    pub fn is_intact(&self) -> bool {
        self.flipped.is_empty() && self.reset.is_empty()
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.flipped.add_all(other.flipped);
        self.reset.add_all(other.reset);
    }
}

/// A wall as it is believed to stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallEstimate {
    /// Its line; of a wall that no plan tells of, the centre is where the first of its images to be joined was seen reflected
    /// at right angles.
    pub line: Line,
    /// Standard deviation of its offset along the normal at the centre, metres.
    pub offset_std_m: f32,
    /// Standard deviation of its rotation about the centre, radians.
    pub rotation_std_rad: f32,
    /// Probability that it exists.
    pub existence: f32,
    /// Whether a plan tells of it.
    pub is_told: bool,
}

/// What has become of the map in a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MapChanges {
    /// Virtual anchors discovered.
    pub discovered: u32,
    /// Virtual anchors forgotten, including those that gave way to a discovery.
    pub forgotten: u32,
    /// Images that one surface explained together with others, and that became images in it.
    pub joined: u32,
    /// Discoveries dropped because the map was full.
    pub map_full: u32,
}

/// Where the tag is, how sure that is, and the next action.
#[cfg(feature = "defmt")]
impl defmt::Format for CycleReport {
    fn format(&self, to: defmt::Formatter<'_>) {
        let ([x, y], [vx, vy]) = (self.position_m, self.velocity_m_s);
        let [variance_x_m2, variance_y_m2] =
            [self.position_covariance_m2.m11, self.position_covariance_m2.m22];
        defmt::write!(
            to,
            "cycle {=u32}: ({=f32}, {=f32}) m with probability {=f32}, variances {=f32}, {=f32} m^2, ({=f32}, {=f32}) m/s; {=u32} of \
             {=u32} measurements of {=u32} anchors associated; searching {=bool}, lost {=bool}; next action {=usize}; \
             flipped {=u16:b}, reset {=u16:b}",
            self.cycle,
            x,
            y,
            self.probability,
            variance_x_m2,
            variance_y_m2,
            vx,
            vy,
            self.associated,
            self.measurements,
            self.anchors_heard,
            self.searching,
            self.lost,
            self.next_action,
            self.integrity.flipped.bits(),
            self.integrity.reset.bits()
        );
    }
}
