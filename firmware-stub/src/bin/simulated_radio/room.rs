//! A DW3000 in a room that is made up, behind the core's trait: what it delivers depends on the channel that it is tuned to.
//!
//! Two anchors, the four walls of a room, a tag that walks. Responses are synthesized where they are received, of the direct path and one
//! reflection per wall, with the pulse and the carrier of the action, in noise of a generator of its own; an interferer takes one
//! channel, then the other. On a jammed channel no range comes, and the response is in 30 dB more noise. Built for the target
//! (`main.rs`) and for the host (`tests/examples/simulated_radio.rs`), whose bits must be equal.

use cogmint_core::model::observation::{Frame, Observation, Range, RangeScan, Samples, TagHeight};
use cogmint_core::model::transceiver::{Moment, Transceiver, Tuning};
use cogmint_core::radio::library::Action;
use cogmint_core::radio::presets::RadioPreset;
use cogmint_core::real::{SPEED_OF_LIGHT_M_S, TAU, cos, sin, sqrt};
use cogmint_core::{
    Anchor, Config, CycleError, CycleReport, Error, Map, Plan, PlanSegment, PlanWall, Tracker,
};
use core::task::Poll;

/// The anchors.
pub const ANCHORS: [Anchor; 2] =
    [Anchor { position_m: [0.4, 0.3], height_m: 2.5 }, Anchor { position_m: [7.6, 5.2], height_m: 2.5 }];
const OUTLINE_M: [[f32; 2]; 4] = [[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]];
const WALLS: [PlanWall; 4] = [PlanWall { offset_std_m: 0.05, rotation_std_rad: 0.005 }; 4];
const SEGMENTS: [PlanSegment; 4] = [
    PlanSegment { wall: 0, ends_m: [[0.0, 0.0], [8.0, 0.0]] },
    PlanSegment { wall: 1, ends_m: [[8.0, 0.0], [8.0, 6.0]] },
    PlanSegment { wall: 2, ends_m: [[8.0, 6.0], [0.0, 6.0]] },
    PlanSegment { wall: 3, ends_m: [[0.0, 6.0], [0.0, 0.0]] },
];
const MAP: Map<'static> = Map {
    virtual_anchors: &[],
    plan: Some(Plan {
        outline_m: &OUTLINE_M,
        walls: &WALLS,
        segments: &SEGMENTS,
        turn_std_rad: 0.0,
        reflections: 1,
        most_sources: 16,
    }),
};

const RADIO: RadioPreset = RadioPreset::Dw3000;
const CYCLE_S: f32 = 0.1;
const TAG_HEIGHT: TagHeight = TagHeight { mean_m: 1.2, std_m: 0.1 };
const SAMPLES: usize = 128;
/// Samples ahead of the direct path.
const AHEAD: f32 = 32.0;
const RANGE_STD_M: f32 = 0.07;
/// Amplitude of a path of 1 m, and the deviation of either part of the noise.
const LEVEL: f32 = 1000.0;
const NOISE: f32 = 2.0;
const JAMMED: f32 = 32.0;
/// By channel, the cycles in which it is jammed.
const JAM: [core::ops::Range<u32>; 2] = [30..60, 60..90];

/// Cycles in which all of it is seen.
pub const CYCLES: u32 = 90;

/// Its tracker: 2 anchors, 6 surfaces, 16 sources, 4 segments, 8 paths, 2 channels, 4 components, 256 points, 2 candidates.
pub type RoomTracker = Tracker<2, 6, 16, 4, 8, 2, 4, 256, 2>;

/// Starts a tracker of this room, where it stays.
///
/// # Errors
/// The core's.
#[inline(never)] // its stack is not that of the cycles
pub fn start(tracker: &mut RoomTracker) -> Result<(), Error> {
    let mut config = Config::pedestrian(RADIO);
    config.start.position_m = [4.0, 3.0];
    tracker.start(&config, &ANCHORS, &MAP, RADIO.library(), 1)
}

/// What is wrong with a radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Defect {
    /// Nothing.
    None,
    /// It stays on its first channel, whatever it is tuned to.
    Stays,
    /// Its bus fails once, in the middle of this cycle.
    FailsIn(u32),
}

/// The bus to the radio failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusFault;

/// The radio, and all that is simulated.
pub struct SimulatedRadio {
    defect: Defect,
    random: u32,
    tag_m: [f32; 2],
    /// The cycle that begins next.
    cycle: u32,
    tuning: Tuning,
    /// What comes next: of each anchor a range, the wait for its response, the response.
    step: usize,
    ranges: [Range; 1],
    samples: [[f32; 2]; SAMPLES],
}

impl SimulatedRadio {
    /// One that is switched on.
    pub const fn new(defect: Defect) -> Self {
        Self {
            defect,
            random: 1,
            tag_m: [1.5, 1.5],
            cycle: 0,
            tuning: Tuning {
                index: 0,
                action: Action { carrier_hz: 0.0, pulse_duration_s: 0.0 },
                announced: None,
            },
            step: 0,
            ranges: [Range { range_m: 0.0, variance_m2: RANGE_STD_M * RANGE_STD_M }],
            samples: [[0.0; 2]; SAMPLES],
        }
    }

    /// How far the report is from where the tag is, metres.
    pub fn off_m(&self, report: &CycleReport) -> f32 {
        let ([x, y], [true_x, true_y]) = (report.position_m, self.tag_m);
        sqrt((x - true_x) * (x - true_x) + (y - true_y) * (y - true_y))
    }

    /// The channel that it receives on: an index of the library.
    fn channel(&self) -> usize {
        if self.defect == Defect::Stays { 0 } else { self.tuning.index }
    }

    fn is_jammed(&self) -> bool {
        JAM.get(self.channel()).is_some_and(|cycles| cycles.contains(&self.cycle.wrapping_sub(1)))
    }

    /// About normal, of deviation 1: twelve uniform numbers less their mean.
    fn normal(&mut self) -> f32 {
        let mut sum = -6.0;
        for _ in 0..12 {
            self.random = self.random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            sum += (self.random >> 8) as f32 / (1 << 24) as f32;
        }
        sum
    }

    fn length_m(&self, [x, y]: [f32; 2], height_m: f32) -> f32 {
        let [tag_x, tag_y] = self.tag_m;
        let up_m = height_m - TAG_HEIGHT.mean_m;
        sqrt((x - tag_x) * (x - tag_x) + (y - tag_y) * (y - tag_y) + up_m * up_m)
    }

    /// The direct path to an anchor and one reflection per wall, metres.
    fn lengths_m(&self, anchor: &Anchor) -> [f32; 5] {
        let Anchor { position_m: [x, y], height_m } = *anchor;
        let images_m = [[x, y], [-x, y], [16.0 - x, y], [x, -y], [x, 12.0 - y]];
        images_m.map(|image_m| self.length_m(image_m, height_m))
    }

    /// Receives a response; the delay of its first sample, seconds.
    fn respond(&mut self, lengths_m: &[f32; 5]) -> f32 {
        let radio = RADIO.radio();
        let action = RADIO.library().get(self.channel()).copied().unwrap_or(self.tuning.action);
        let pulse = radio.pulse(&action);
        let [direct_m, ..] = *lengths_m;
        let first_s = direct_m / SPEED_OF_LIGHT_M_S - AHEAD * radio.sample_spacing_s;
        let noise = NOISE * if self.is_jammed() { JAMMED } else { 1.0 };
        let paths = lengths_m.map(|length_m| {
            let reflected = if length_m > direct_m { 0.5 } else { 1.0 };
            let phase = TAU * action.carrier_hz * (length_m / SPEED_OF_LIGHT_M_S);
            let level = LEVEL / length_m * reflected;
            (length_m / SPEED_OF_LIGHT_M_S, level * cos(phase), -level * sin(phase))
        });
        for n in 0..SAMPLES {
            let at_s = first_s + n as f32 * radio.sample_spacing_s;
            let mut sample = [noise * self.normal(), noise * self.normal()];
            for (delay_s, i, q) in paths {
                let shape = pulse.autocorrelation((at_s - delay_s) / action.pulse_duration_s);
                sample = [sample[0] + i * shape, sample[1] + q * shape];
            }
            if let Some(place) = self.samples.get_mut(n) {
                *place = sample;
            }
        }
        first_s
    }
}

impl Transceiver for SimulatedRadio {
    type Error = BusFault;

    fn tune(&mut self, _: usize, tuning: &Tuning) -> Result<(), BusFault> {
        // One receiver, and one choice for all anchors.
        self.tuning = *tuning;
        Ok(())
    }

    fn begin(&mut self) -> Poll<Result<Moment, BusFault>> {
        self.cycle = self.cycle.wrapping_add(1);
        self.step = 0;
        let [x, y] = self.tag_m;
        self.tag_m = [x + 0.5 * CYCLE_S, y + 0.2 * CYCLE_S];
        Poll::Ready(Ok(Moment { elapsed_s: CYCLE_S, tag_height: Some(TAG_HEIGHT) }))
    }

    fn receive(&mut self) -> Poll<Result<Option<Observation<'_>>, BusFault>> {
        if self.step == 4 && self.defect == Defect::FailsIn(self.cycle.wrapping_sub(1)) {
            self.defect = Defect::None;
            return Poll::Ready(Err(BusFault));
        }
        let (mut anchor, mut part) = (self.step / 3, self.step % 3);
        if part == 0 && self.is_jammed() {
            // The time stamps of a jammed exchange do not come through.
            self.step += 1;
            (anchor, part) = (self.step / 3, self.step % 3);
        }
        let Some(place) = ANCHORS.get(anchor) else { return Poll::Ready(Ok(None)) };
        self.step += 1;
        let lengths_m = self.lengths_m(place);
        let [direct_m, ..] = lengths_m;
        match part {
            0 => {
                let range_m = direct_m + RANGE_STD_M * self.normal();
                self.ranges = [Range { range_m, variance_m2: RANGE_STD_M * RANGE_STD_M }];
                let ranges = &self.ranges;
                Poll::Ready(Ok(Some(Observation::Ranges(RangeScan { anchor, ranges }))))
            }
            1 => Poll::Pending,
            _ => {
                let first_sample_delay_s = self.respond(&lengths_m);
                let samples = Samples::Complex(&self.samples);
                let action = self.tuning.index;
                let frame = Frame { anchor, action, sequence: None, first_sample_delay_s, samples };
                Poll::Ready(Ok(Some(Observation::Frame(frame))))
            }
        }
    }
}

/// What happens in a run.
pub enum Event {
    /// A cycle is over: what was made of it, and the hash over all state.
    Cycle(CycleReport, u64),
    /// It stopped in this cycle, and goes on.
    Stop(u32, CycleError<BusFault>),
}

/// Runs so many cycles, as firmware would in its idle loop.
pub fn run(
    tracker: &mut RoomTracker,
    radio: &mut SimulatedRadio,
    mut each: impl FnMut(&SimulatedRadio, Event),
) {
    let mut cycle = 0;
    // A tracker that refuses every call would never end.
    let mut stops = 0;
    while cycle < CYCLES && stops < CYCLES {
        match tracker.poll_cycle(radio) {
            Poll::Ready(Ok(report)) => {
                cycle += 1;
                let hash = tracker.hash();
                each(radio, Event::Cycle(report, hash));
            }
            Poll::Ready(Err(error)) => {
                stops += 1;
                each(radio, Event::Stop(cycle, error));
            }
            // Here firmware sleeps until the radio's interrupt.
            Poll::Pending => {}
        }
    }
}
