//! The simulator: a scenario becomes frames, one by one for a tracker that chooses its carrier, or a whole recording.

use crate::channel::random::{Purpose, normal, stream, uniform};
use crate::channel::{Channel, Component, FrameScratch, SPEED_OF_LIGHT_M_S};
use crate::floor_plan::{self, FloorPlan};
use crate::input_error::InputError;
use crate::recording::{self, Recording, TruthPath};
use crate::scenario::{Log, Pulse, Scenario, Schedule, Window};
use cogmint_core::radio::pulse::PULSE_SAMPLES;
use rand_core::Rng;
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use std::path::Path;

/// A clock that is further off than this has nothing to do with the frames any more, seconds.
const LARGEST_OFFSET_S: f64 = 1e-5;

/// A scenario on one of its trajectories with one seed.
pub struct Simulator {
    channel: Channel,
    trajectory: usize,
    floor_plan: FloorPlan,
}

impl Simulator {
    /// The simulator of `scenario` along its trajectory `trajectory` (counted from 0), with the scenario's seed unless
    /// `seed` is given; `folder` is where recorded trajectories are looked for.
    ///
    /// # Errors
    /// There is no such trajectory, or its file cannot be used.
    pub fn new(
        scenario: &Scenario,
        folder: Option<&Path>,
        trajectory: usize,
        seed: Option<u64>,
    ) -> Result<Self, InputError> {
        let channel = Channel::new(scenario, folder, trajectory, seed)?;
        let end_s = channel.poses().last().map_or(0.0, |pose| pose.time_s.abs());
        if !(scenario.errors.clock_drift.abs() * end_s <= LARGEST_OFFSET_S) {
            let reason =
                format!("is {}, which in {end_s} s adds up to too much", scenario.errors.clock_drift);
            return Err(InputError::new(&scenario.name, reason)
                .for_item("errors.clock_drift")
                .allowed(format!("at most {LARGEST_OFFSET_S} s in the end")));
        }
        let floor_plan = floor_plan::of(&channel)?;
        Ok(Self { channel, trajectory, floor_plan })
    }

    /// The channel behind it.
    pub fn channel(&self) -> &Channel {
        &self.channel
    }

    /// Index of the trajectory.
    pub fn trajectory(&self) -> usize {
        self.trajectory
    }

    /// The virtual anchor of the recording that an anchor's image source is; none for the anchor itself and for what
    /// neither a position of the way sees nor the plan knows.
    pub fn virtual_anchor(&self, anchor: usize, source: usize) -> Option<usize> {
        self.floor_plan.index_of.get(anchor)?.get(source).copied().flatten()
    }

    /// Reflections of a virtual anchor of the recording; 0 for one that is not there.
    pub fn order(&self, virtual_anchor: usize) -> usize {
        let images = self.floor_plan.index_of.iter().enumerate().find_map(|(anchor, sources)| {
            let source = sources.iter().position(|index| *index == Some(virtual_anchor))?;
            Some(self.channel.images(anchor)[source].order)
        });
        let told = || self.floor_plan.virtual_anchors.get(virtual_anchor).map(|va| va.walls.len());
        images.or_else(told).unwrap_or(0)
    }

    /// Number of cycles.
    pub fn cycles(&self) -> usize {
        self.channel.poses().len()
    }

    /// The action of a recording's cycle.
    pub fn scheduled_action(&self, cycle: usize) -> usize {
        let receiver = self.channel.receiver();
        let count = receiver.actions.len();
        match receiver.schedule {
            Schedule::Fixed => receiver.first_action,
            Schedule::Sweep => (receiver.first_action + cycle) % count,
            Schedule::Random if cycle == 0 => receiver.first_action,
            Schedule::Random => {
                let mut rng = stream(self.channel.seed(), Purpose::Schedule, &[self.trajectory, cycle]);
                rng.next_u32() as usize % count
            }
        }
    }

    /// A place in the disc of `prior.disc_radius_m` about the true first position: what somebody would take for it.
    fn drawn_start_m(&self) -> [f64; 2] {
        let [x, y] = self.channel.poses()[0].position_m;
        let mut rng = stream(self.channel.seed(), Purpose::Start, &[self.trajectory]);
        let (turn, share) = (uniform(&mut rng), uniform(&mut rng));
        let radius_m = self.channel.scenario().prior.disc_radius_m * share.sqrt();
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * turn);
        [x + radius_m * cos, y + radius_m * sin]
    }

    /// Density of the white acceleration that the tracker is told, m^2/s^3.
    fn acceleration_density_m2_s3(&self) -> f64 {
        let prior = &self.channel.scenario().prior;
        prior.acceleration_density_m2_s3.unwrap_or_else(|| {
            let times_s = self.channel.poses().iter().map(|pose| pose.time_s);
            recording::density_m2_s3(prior.acceleration_std_m_s2, recording::usual_period_s(times_s))
        })
    }

    /// The recording without any cycle: what a tracker knows before it starts.
    pub fn before(&self) -> Recording {
        let channel = &self.channel;
        let (scenario, receiver) = (channel.scenario(), channel.receiver());
        let prior = &scenario.prior;
        let duration_s = receiver.actions[receiver.first_action].pulse_duration_s;
        let bandwidth_hz = channel.pulse(receiver.first_action).rms_bandwidth_hz();
        let way = &scenario.trajectories[self.trajectory].name;
        Recording {
            name: format!("{}, trajectory {}", scenario.name, self.trajectory),
            source: format!(
                "simulated by cogmint {}: scenario {}, trajectory {} {way}, seed {}",
                env!("CARGO_PKG_VERSION"),
                scenario.name,
                self.trajectory,
                channel.seed()
            ),
            // A density: that of a cycle alone, and of a part of the way, is that of the whole way.
            motion: recording::Motion {
                acceleration_std_m_s2: None,
                acceleration_density_m2_s3: Some(self.acceleration_density_m2_s3()),
                velocity_decay_s: prior.velocity_decay_s,
            },
            start: recording::Start {
                position_m: prior.position_m.unwrap_or_else(|| self.drawn_start_m()),
                position_std_m: prior.position_std_m,
                velocity_std_m_s: prior.velocity_std_m_s,
                disc_radius_m: Some(prior.disc_radius_m),
                drawn_about_m: prior.position_m.is_none().then(|| channel.poses()[0].position_m),
            },
            association: recording::AssociationModel {
                detection_probability: prior.detection_probability,
                clutter_per_anchor: prior.clutter_per_anchor,
                max_range_m: prior.max_range_m,
            },
            radio: recording::Radio {
                pulse_duration_s: duration_s,
                roll_off: receiver.roll_off(bandwidth_hz, duration_s),
                gain_control: receiver.converter.is_some(),
                begins_with_path: false,
                sampled_pulse: matches!(receiver.pulse, Pulse::Sampled { .. }).then(|| {
                    let step_s = duration_s / 8.0;
                    let pulse = channel.pulse(receiver.first_action);
                    let at = |lag: usize| pulse.autocorrelation(lag as f64 * step_s)[0];
                    recording::SampledPulse { step_s, autocorrelation: (0..PULSE_SAMPLES).map(at).collect() }
                }),
                sample_spacing_s: Some(receiver.sample_spacing_s),
                range_std_m: 0.05,
                range_bias_mean_m: 0.0,
                range_bias_std_m: prior.range_bias_std_m,
                range_late_m: 0.0,
                range_floor_pulses: prior.range_floor_pulses,
            },
            anchors: scenario
                .anchors
                .iter()
                .map(|anchor| recording::Anchor::new(anchor.name.clone(), anchor.position_m, anchor.height_m))
                .collect(),
            virtual_anchors: self.floor_plan.virtual_anchors.clone(),
            antennas: Vec::new(),
            actions: receiver
                .actions
                .iter()
                .map(|action| recording::Action {
                    carrier_hz: action.carrier_hz,
                    pulse_duration_s: action.pulse_duration_s,
                })
                .collect(),
            walls: channel.walls().iter().map(|wall| wall.ends_m).collect(),
            plan: self.floor_plan.plan.clone(),
            cycles: Vec::new(),
        }
    }

    /// What arrives in a cycle when all anchors use `action`: truth and every frame that is not lost.
    pub fn cycle(&self, cycle: usize, action: usize) -> recording::Cycle {
        self.cycle_with(cycle, |_| action)
    }

    /// The same where each anchor has an action of its own.
    pub fn cycle_with(&self, cycle: usize, action_of: impl Fn(usize) -> usize) -> recording::Cycle {
        let anchors = 0..self.channel.scenario().anchors.len();
        let frame = |anchor| self.frame(cycle, anchor, action_of(anchor), &mut FrameScratch::default());
        self.assembled(cycle, anchors.map(frame).collect())
    }

    /// A recording of the first `cycles` cycles (at most all) with the scheduled actions, on all processor cores.
    /// `on_cycle` is called after each cycle, from any thread.
    pub fn record(&self, cycles: usize, on_cycle: impl Fn() + Sync) -> Recording {
        self.record_told(cycles, &on_cycle)
    }

    /// Not generic: compiled here once, not again in every crate that calls it.
    fn record_told(&self, cycles: usize, on_cycle: &(dyn Fn() + Sync)) -> Recording {
        let anchors = self.channel.scenario().anchors.len();
        let cycle = |scratch: &mut FrameScratch, cycle: usize| {
            let action = self.scheduled_action(cycle);
            let frames = (0..anchors).map(|anchor| self.frame(cycle, anchor, action, scratch)).collect();
            let assembled = self.assembled(cycle, frames);
            on_cycle();
            assembled
        };
        let cycles = cycles.min(self.cycles());
        let cycles = (0..cycles).into_par_iter().map_init(FrameScratch::default, cycle).collect();
        Recording { cycles, ..self.before() }
    }

    fn assembled(
        &self,
        cycle: usize,
        frames: Vec<(Option<recording::Frame>, Vec<TruthPath>)>,
    ) -> recording::Cycle {
        let pose = &self.channel.poses()[cycle];
        let (frames, truth_paths): (Vec<_>, Vec<_>) = frames.into_iter().unzip();
        recording::Cycle {
            time_s: pose.time_s,
            truth_position_m: Some(pose.position_m),
            tag_height_m: Some(self.channel.tag_height_m(cycle) + self.told_height_error_m()),
            tag_height_std_m: (self.told_height_std_m() > 0.0).then_some(self.told_height_std_m()),
            antenna: None,
            ranges: Vec::new(),
            frames: frames.into_iter().flatten().collect(),
            truth_paths: truth_paths.into_iter().flatten().collect(),
        }
    }

    /// Standard deviation of the tag's height as it is told, metres.
    fn told_height_std_m(&self) -> f64 {
        self.channel.scenario().tag.height_std_m
    }

    /// By how much the tag's height is told wrong, the same all the way, metres.
    fn told_height_error_m(&self) -> f64 {
        let mut rng = stream(self.channel.seed(), Purpose::TagHeight, &[self.trajectory]);
        self.told_height_std_m() * normal(&mut rng)
    }

    /// One frame, if it arrives, and the true paths.
    fn frame(
        &self,
        cycle: usize,
        anchor: usize,
        action: usize,
        scratch: &mut FrameScratch,
    ) -> (Option<recording::Frame>, Vec<TruthPath>) {
        let channel = &self.channel;
        let (scenario, receiver) = (channel.scenario(), channel.receiver());
        let mut packet = stream(channel.seed(), Purpose::Packet, &[self.trajectory, cycle, anchor]);
        let (grid, phase, stamp) = (uniform(&mut packet), uniform(&mut packet), normal(&mut packet));
        let errors = &scenario.errors;
        // By how much the radio takes every delay for longer than it is.
        let late_s = errors.clock_offset_s
            + errors.clock_drift * channel.poses()[cycle].time_s
            + scenario.anchors[anchor].range_bias_m / SPEED_OF_LIGHT_M_S
            + errors.timestamp_std_s * stamp;
        let (origin_s, reported_s) = match receiver.window {
            Window::Absolute { first_sample_delay_s } => {
                (first_sample_delay_s - late_s, first_sample_delay_s)
            }
            Window::FirstPath { sample } => {
                let first_s = channel.first_path_s(cycle, anchor);
                let origin_s = first_s - (sample as f64 + grid) * receiver.sample_spacing_s;
                (origin_s, origin_s + late_s)
            }
        };
        let mut components = Vec::new();
        let mut samples = channel.samples(cycle, anchor, action, origin_s, scratch, Some(&mut components));
        if receiver.random_phase {
            let turn = crate::channel::cis(std::f64::consts::TAU * phase);
            samples.iter_mut().for_each(|sample| *sample *= turn);
        }
        let gain = receiver.converter.map_or(1.0, |converter| converter.convert(&mut samples));
        let truth = components.iter().map(|component| self.truth_path(anchor, component, gain)).collect();
        let frame = recording::Frame {
            anchor,
            action,
            first_sample_delay_s: reported_s,
            first_path_index: None,
            line_of_sight: None,
            samples: match receiver.log {
                Log::Complex => recording::Samples::Complex(
                    samples.iter().map(|sample| [sample.re as f32, sample.im as f32]).collect(),
                ),
                Log::Magnitude => recording::Samples::Magnitude(samples.iter().map(magnitude).collect()),
            },
        };
        ((!self.is_lost(cycle, anchor)).then_some(frame), truth)
    }

    fn is_lost(&self, cycle: usize, anchor: usize) -> bool {
        let lost = &self.channel.scenario().lost_frames;
        let mut rng = stream(self.channel.seed(), Purpose::Loss, &[self.trajectory, cycle, anchor]);
        lost.gaps.iter().any(|gap| self.channel.cycles_of(*gap).contains(&cycle))
            || uniform(&mut rng) < lost.probability
    }

    fn truth_path(&self, anchor: usize, component: &Component, gain: f64) -> TruthPath {
        TruthPath {
            anchor,
            virtual_anchor: self.floor_plan.index_of[anchor][component.source],
            delay_s: component.delay_s,
            magnitude: component.magnitude() * gain,
            // Beyond this nothing is noise any more.
            sinr: component.sinr.min(1e30),
        }
    }
}

fn magnitude(sample: &Complex64) -> f32 {
    (sample.re * sample.re + sample.im * sample.im).sqrt() as f32
}
