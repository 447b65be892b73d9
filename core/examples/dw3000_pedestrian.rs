//! A tag with a DW3000 that somebody carries, in a room whose plan is known: from time stamps and accumulators to a position, to the next
//! channel, and through a power cut.
//!
//!     cargo run -p cogmint-core --example dw3000_pedestrian
//!
//! `hear` and `cycle` are what firmware has. `Radio` stands for the radio's driver: here it simulates.

#![cfg_attr(target_os = "none", no_std, no_main)]

mod simulated;

use cogmint_core::model::observation::{Observation, Range, RangeScan, TagHeight};
use cogmint_core::radio::accumulator::{
    AccumulatorFormat, Cir, CirError, SAMPLE_SPACING_S, Window, first_path_index,
};
use cogmint_core::radio::library::Action;
use cogmint_core::radio::presets::RadioPreset;
use cogmint_core::radio::two_way::{AntennaDelays, DoubleSided, TICK_M, Timestamp, TwoWayError};
use cogmint_core::real::{SPEED_OF_LIGHT_M_S, TAU, cos, sin, sqrt};
use cogmint_core::{
    Anchor, Config, CycleReport, Error, Map, Plan, PlanSegment, PlanWall, SnapshotError, Tracker,
};
use simulated::Noise;

// What `cogmint plan FILE --format rust` writes: the anchors, and the walls with how far they may be from where they are drawn.
const ANCHORS: [Anchor; 4] = [
    Anchor { position_m: [0.3, 0.3], height_m: 2.5 },
    Anchor { position_m: [7.7, 0.3], height_m: 2.5 },
    Anchor { position_m: [7.7, 5.7], height_m: 2.5 },
    Anchor { position_m: [0.3, 5.7], height_m: 2.5 },
];
const OUTLINE_M: [[f32; 2]; 4] = [[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]];
const WALLS: [PlanWall; 4] = [PlanWall { offset_std_m: 0.05, rotation_std_rad: 0.005 }; 4];
const SEGMENTS: [PlanSegment; 4] = [
    PlanSegment { wall: 0, ends_m: [[0.0, 0.0], [8.0, 0.0]] },
    PlanSegment { wall: 1, ends_m: [[8.0, 0.0], [8.0, 6.0]] },
    PlanSegment { wall: 2, ends_m: [[8.0, 6.0], [0.0, 6.0]] },
    PlanSegment { wall: 3, ends_m: [[0.0, 6.0], [0.0, 0.0]] },
];
const PLAN: Plan<'static> = Plan {
    outline_m: &OUTLINE_M,
    walls: &WALLS,
    segments: &SEGMENTS,
    turn_std_rad: 0.0,
    reflections: 1,
    most_sources: 16,
};
const MAP: Map<'static> = Map { virtual_anchors: &[], plan: Some(PLAN) };

const RADIO: RadioPreset = RadioPreset::Dw3000;
const TAG_HEIGHT: TagHeight = TagHeight { mean_m: 1.2, std_m: 0.1 };
const CYCLE_S: f32 = 0.1;
/// Samples that are read around the first path, and their bytes.
const SAMPLES: usize = Window::USUAL.len();
const BYTES: usize = SAMPLES * AccumulatorFormat::Bits24.bytes_per_sample();

/// 4 anchors, 6 surfaces (the walls, and two that may be found), 20 sources, 4 segments, 8 paths per frame, 2 channels, 4 components of the
/// belief, 2 points for each of the 128 samples, 6 candidates for walls that may be found.
type TagTracker = Tracker<4, 6, 20, 4, 8, 2, 4, 256, 6>;

/// What can go wrong.
#[derive(Debug)]
#[expect(dead_code, reason = "only printed")]
enum Fault {
    Tracker(Error),
    Stamps(TwoWayError),
    Response(CirError),
    Snapshot(SnapshotError),
    /// A tracker went on from a snapshot with other bits.
    OtherBits,
}

/// The tracker as it is switched on. Firmware has it in a static, and starts it there: docs/firmware.md.
fn switched_on() -> Result<TagTracker, Error> {
    let mut config = Config::pedestrian(RADIO);
    config.start.position_m = [4.0, 3.0];
    let mut tracker = TagTracker::new();
    tracker.start(&config, &ANCHORS, &MAP, RADIO.library(), 1)?;
    Ok(tracker)
}

/// What an exchange with one anchor makes of the tracker. A frame that is refused has changed nothing: the range counts all the same.
fn hear(tracker: &mut TagTracker, anchor: usize, action: usize, exchange: &Exchange) -> Result<(), Fault> {
    // Radios that are programmed with their antenna delays have corrected the stamps.
    let range_m = exchange.stamps.range_m(AntennaDelays::default()).map_err(Fault::Stamps)?;
    let std_m = RADIO.range_std_m().unwrap_or(0.1);
    let ranges = [Range { range_m, variance_m2: std_m * std_m }];
    tracker.receive(&Observation::Ranges(RangeScan { anchor, ranges: &ranges })).map_err(Fault::Tracker)?;

    // The window alone was read over SPI, from this sample on.
    let index = first_path_index(exchange.first_path_register);
    let first_sample = Window::USUAL.first_sample(index).map_err(Fault::Response)?;
    let format = AccumulatorFormat::Bits24;
    let cir =
        Cir::<SAMPLES>::from_accumulator(&exchange.accumulator, first_sample, format, index, Window::USUAL)
            .map_err(Fault::Response)?;
    let peak_after = RADIO.peak_after_first_path_samples().unwrap_or(0.0);
    let frame = cir.frame(anchor, action, range_m, peak_after);
    tracker.receive(&Observation::Frame(frame)).map_err(Fault::Tracker)
}

/// One cycle: every anchor is asked, one after the other, into one buffer; then the radio is told its next channel.
fn cycle(tracker: &mut TagTracker, radio: &mut Radio) -> Result<CycleReport, Fault> {
    tracker.begin(CYCLE_S, Some(TAG_HEIGHT)).map_err(Fault::Tracker)?;
    for anchor in 0..ANCHORS.len() {
        // An anchor that does not answer is left out.
        let Some(exchange) = radio.exchange(anchor) else { continue };
        hear(tracker, anchor, radio.channel, &exchange)?;
    }
    let report = tracker.finish().map_err(Fault::Tracker)?;
    // The anchors simulated change to it at once. Over the air: `cogmint_core::radio::link`.
    radio.channel = report.next_action;
    Ok(report)
}

/// Six seconds of a walk, with a power cut after three. `storage`: what survives it. The root of the mean squared error over the second
/// half, metres, and the bytes of the snapshot.
fn run(storage: &mut [u8]) -> Result<(f32, usize), Fault> {
    let mut radio = Radio { channel: 0, tag_m: [2.0, 2.0], noise: Noise(1) };
    let mut tracker = switched_on().map_err(Fault::Tracker)?;
    for _ in 0..30 {
        radio.walk();
        cycle(&mut tracker, &mut radio)?;
    }
    let snapshot_bytes = tracker.snapshot(storage).map_err(Fault::Snapshot)?;
    let hash = tracker.hash();

    // Told the same again, then as it was.
    let mut tracker = switched_on().map_err(Fault::Tracker)?;
    tracker.restore(storage).map_err(Fault::Snapshot)?;
    if tracker.hash() != hash {
        return Err(Fault::OtherBits);
    }
    let mut sum_m2 = 0.0;
    for _ in 0..30 {
        radio.walk();
        let [x, y] = cycle(&mut tracker, &mut radio)?.position_m;
        let [true_x, true_y] = radio.tag_m;
        sum_m2 += (x - true_x) * (x - true_x) + (y - true_y) * (y - true_y);
    }
    Ok((sqrt(sum_m2 / 30.0), snapshot_bytes))
}

/// What the radio has after a double-sided exchange.
struct Exchange {
    stamps: DoubleSided,
    first_path_register: u16,
    accumulator: [u8; BYTES],
}

/// In the driver's place: a room whose walls reflect half of an amplitude.
struct Radio {
    channel: usize,
    tag_m: [f32; 2],
    noise: Noise,
}

impl Radio {
    /// 0.85 m/s.
    fn walk(&mut self) {
        let [x, y] = self.tag_m;
        self.tag_m = [x + 0.8 * CYCLE_S, y + 0.3 * CYCLE_S];
    }

    fn length_m(&self, [x, y]: [f32; 2], height_m: f32) -> f32 {
        let [tag_x, tag_y] = self.tag_m;
        let up_m = height_m - TAG_HEIGHT.mean_m;
        sqrt((x - tag_x) * (x - tag_x) + (y - tag_y) * (y - tag_y) + up_m * up_m)
    }

    fn exchange(&mut self, anchor: usize) -> Option<Exchange> {
        let Anchor { position_m: [x, y], height_m } = *ANCHORS.get(anchor)?;
        let action = *RADIO.library().get(self.channel)?;
        let places = [[x, y], [-x, y], [16.0 - x, y], [x, -y], [x, 12.0 - y]];
        let lengths_m = places.map(|place_m| self.length_m(place_m, height_m));
        let [direct_m, ..] = lengths_m;
        // Time of flight as the first path was found, ticks. The anchor's clock began elsewhere; 1 ms is 63,897,600 ticks.
        let flight = ((direct_m + 0.05 * self.noise.normal()) / TICK_M) as u64;
        let (own, theirs, reply) = (1 << 39, 12_345, 63_897_600);
        let stamps = DoubleSided {
            poll_sent: Timestamp::new(own),
            poll_received: Timestamp::new(theirs + flight),
            response_sent: Timestamp::new(theirs + flight + reply),
            response_received: Timestamp::new(own + 2 * flight + reply),
            final_sent: Timestamp::new(own + 2 * flight + 2 * reply),
            final_received: Timestamp::new(theirs + 3 * flight + 2 * reply),
        };
        // The maximum of the direct path's pulse is at sample 740.4, two samples behind where the radio finds its beginning.
        let (peak, first_path_register) = (740.4, (738.4 * 64.0) as u16);
        let mut accumulator = [0; BYTES];
        let first_sample = 738 - Window::USUAL.before;
        for (n, bytes) in accumulator.chunks_exact_mut(6).enumerate() {
            let [mut i, mut q] = [40.0 * self.noise.normal(), 40.0 * self.noise.normal()];
            for (path, length_m) in lengths_m.iter().enumerate() {
                let reflected = if path == 0 { 1.0 } else { 0.5 };
                let excess_s = (length_m - direct_m) / SPEED_OF_LIGHT_M_S;
                let off_s = ((first_sample + n) as f32 - peak) * SAMPLE_SPACING_S - excess_s;
                let level = 2e4 / length_m * reflected * pulse(&action, off_s);
                let phase = TAU * action.carrier_hz * (length_m / SPEED_OF_LIGHT_M_S);
                i += level * cos(phase);
                q -= level * sin(phase);
            }
            let parts = [i, q].map(|part| (part as i32).to_le_bytes());
            for (to, from) in bytes.chunks_exact_mut(3).zip(&parts) {
                to.iter_mut().zip(from).for_each(|(to, from)| *to = *from);
            }
        }
        Some(Exchange { stamps, first_path_register, accumulator })
    }
}

/// The pulse behind the matched filter, this long beside its maximum.
fn pulse(action: &Action, off_s: f32) -> f32 {
    RADIO.radio().pulse(action).autocorrelation(off_s / action.pulse_duration_s)
}

#[cfg(not(target_os = "none"))]
fn main() -> Result<(), Fault> {
    let mut storage = vec![0; 1 << 16];
    let (rmse_m, snapshot_bytes) = run(&mut storage)?;
    println!("RMSE {rmse_m:.3} m after a power cut, snapshot {snapshot_bytes} bytes");
    assert!(rmse_m < 0.1, "{rmse_m} m");
    Ok(())
}

/// Keeps the code in a program that has no start of its own.
#[cfg(target_os = "none")]
#[used]
static RUN: fn(&mut [u8]) -> Result<(f32, usize), Fault> = run;
