//! The path estimates of a recording: what the core's association gets to see, for all trackers alike.
//!
//! The frames go through the core's channel estimator with the set-up's configuration, on all processor cores. Paths
//! beyond the longest range and paths within a pulse of a radio's range are left out, as in the core, and so is every
//! cycle that the core would refuse.
//!
//! **Labels.** Which true path an estimated one is, is decided per frame by the assignment of least total cost, where
//! a pair costs (delta / w)^2 / 2 + ln^2(SINR ratio) / (2 x 1.5^2) with delta the difference of the lengths and w = 0.15 c Tp
//! or twice the stated deviation, whichever is larger, is possible only within c Tp, and an estimated path without
//! partner costs what a pair does whose length is off by half a pulse and whose SINR is right. Frames of an anchor may be late as a whole (biases, clocks): the shift, at
//! most 1 m, at which most true paths meet an estimated one is taken off first.

use super::{CycleScans, Scan, ScanPath, Source};
use crate::recording::{Recording, TruthPath};
use crate::replay::{CycleInput, PATHS, Setup, inputs};
use crate::score::assignment::cheapest;
use cogmint_core::model::observation::{Frame, LONGEST_SCAN, Observation, Range};
use cogmint_core::perceptor::channel_estimator::ChannelEstimator;
use cogmint_core::radio::pulse::Pulse;
use cogmint_core::real::SPEED_OF_LIGHT_M_S;
use rayon::prelude::*;

/// The core refuses frames that begin earlier than this before the transmission, seconds.
const LONGEST_LEAD_S: f32 = 1e-5;
/// Deviation of an estimated path's length from the true one in a label's cost, pulse lengths.
const LABEL_STD: f64 = 0.15;
/// Deviation of an estimated SINR's logarithm from the true one in a label's cost.
const LABEL_SINR_STD: f64 = 1.5;
/// Cost of an estimated path without a partner.
const UNPAIRED: f64 = 0.5 * (0.5 / LABEL_STD) * (0.5 / LABEL_STD);
/// A path of this share of another one's power shifts it where they overlap.
const OVERLAP_RATIO: f64 = 0.1;
/// Largest shift of an anchor's frames that is looked for, metres, and the steps.
const LARGEST_SHIFT_M: f64 = 1.0;
const SHIFT_STEPS: i32 = 100;

/// The path estimates of every cycle of a recording, as a tracker with this set-up gets them.
pub fn scans(recording: &Recording, setup: &Setup) -> Vec<CycleScans> {
    let radio = &setup.config.radio;
    let estimators: Vec<(Pulse, ChannelEstimator<PATHS>)> = setup
        .actions
        .iter()
        .map(|action| {
            let pulse = radio.pulse(action);
            let (spacing_s, samples) = (radio.sample_spacing_s, radio.samples_per_frame);
            (
                pulse,
                ChannelEstimator::new(
                    pulse,
                    spacing_s,
                    samples,
                    radio.false_paths_per_frame,
                    setup.config.estimator,
                ),
            )
        })
        .collect();
    let inputs: Vec<CycleInput<'_>> = inputs(recording).collect();
    let mut cycles: Vec<CycleScans> = recording
        .cycles
        .par_iter()
        .zip(&inputs)
        .map(|(cycle, input)| CycleScans {
            time_s: cycle.time_s,
            elapsed_s: f64::from(input.elapsed_s),
            tag_height_m: input.tag_height.map(|height| f64::from(height.mean_m)),
            scans: cycle_scans(setup, &estimators, &input.observations()),
        })
        .collect();
    label(recording, &mut cycles);
    cycles
}

/// What the core makes of a cycle's observations: one scan per anchor heard, nothing where it refuses one of them.
fn cycle_scans(
    setup: &Setup,
    estimators: &[(Pulse, ChannelEstimator<PATHS>)],
    observations: &[Observation<'_>],
) -> Vec<Scan> {
    let longest_delay_s = setup.config.ranging.max_range_m / SPEED_OF_LIGHT_M_S;
    let refused = observations.iter().any(|observation| match observation {
        Observation::Frame(frame) => {
            frame.action >= estimators.len()
                || frame.samples.len() != setup.config.radio.samples_per_frame
                || frame.samples.check().is_err()
                || !(frame.first_sample_delay_s > -LONGEST_LEAD_S
                    && frame.first_sample_delay_s < longest_delay_s)
        }
        Observation::Ranges(scan) => scan.ranges.len() > LONGEST_SCAN,
    });
    if refused {
        return Vec::new();
    }
    let of_anchor = |anchor: usize| {
        let mut scan = Scan { anchor, action: 0, pulse_m: 0.0, paths: Vec::new() };
        let mut heard = false;
        for observation in observations {
            if let Observation::Ranges(ranges) = observation
                && ranges.anchor == anchor
            {
                take_ranges(ranges.ranges, &mut scan);
                heard = true;
            }
        }
        for observation in observations {
            if let Observation::Frame(frame) = observation
                && frame.anchor == anchor
            {
                take_frame(setup, &estimators[frame.action], frame, &mut scan);
                heard = true;
            }
        }
        scan.paths.sort_by(|a, b| a.range_m.total_cmp(&b.range_m));
        heard.then_some(scan)
    };
    (0..setup.anchors.len()).filter_map(of_anchor).collect()
}

/// Keeps the ranges of the smallest variance, among equals the shortest.
fn take_ranges(ranges: &[Range], scan: &mut Scan) {
    let mut ranges = ranges.to_vec();
    let key = |range: &Range| (range.variance_m2, range.range_m);
    ranges.sort_by(|a, b| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal));
    scan.paths.extend(ranges.iter().take(PATHS).map(|range| ScanPath {
        range_m: f64::from(range.range_m),
        std_m: f64::from(range.variance_m2).sqrt(),
        sinr: 0.0,
        source: None,
        overlapped: false,
    }));
}

fn take_frame(
    setup: &Setup,
    (pulse, estimator): &(Pulse, ChannelEstimator<PATHS>),
    frame: &Frame<'_>,
    scan: &mut Scan,
) {
    scan.action = frame.action;
    let resolution_m = pulse.duration_s * SPEED_OF_LIGHT_M_S;
    scan.pulse_m = f64::from(resolution_m);
    let Ok(estimate) = estimator.estimate(frame.samples, frame.first_sample_delay_s) else { return };
    let ranges: Vec<f64> = scan.paths.iter().map(|path| path.range_m).collect();
    for path in &estimate.paths {
        let range_m = path.range_m();
        let near = ranges.iter().any(|range| (range - f64::from(range_m)).abs() < scan.pulse_m);
        let beyond = range_m <= 0.0 || range_m > setup.config.ranging.max_range_m;
        if near || beyond || scan.paths.len() >= PATHS {
            continue;
        }
        scan.paths.push(ScanPath {
            range_m: f64::from(range_m),
            std_m: f64::from(pulse.range_variance_m2(path.sinr)).sqrt(),
            sinr: f64::from(path.sinr),
            source: None,
            overlapped: false,
        });
    }
}

/// Gives every estimated path the source of the true path that it is.
fn label(recording: &Recording, cycles: &mut [CycleScans]) {
    let speed_m_s = f64::from(SPEED_OF_LIGHT_M_S);
    let truth: Vec<Vec<TruePath>> = recording
        .cycles
        .iter()
        .map(|cycle| {
            let of = |path: &TruthPath| TruePath {
                anchor: path.anchor,
                source: path.virtual_anchor.map_or(Source::Direct, Source::Virtual),
                range_m: path.delay_s * speed_m_s,
                sinr: path.sinr,
            };
            cycle.truth_paths.iter().map(of).collect()
        })
        .collect();
    let shifts: Vec<f64> =
        (0..recording.anchors.len()).into_par_iter().map(|anchor| shift_m(anchor, cycles, &truth)).collect();
    cycles.par_iter_mut().zip(&truth).for_each(|(cycle, truth)| {
        for scan in &mut cycle.scans {
            let own: Vec<&TruePath> = truth.iter().filter(|path| path.anchor == scan.anchor).collect();
            let partners = partners(scan, &own, shifts[scan.anchor]);
            for (path, partner) in scan.paths.iter_mut().zip(partners) {
                let Some(partner) = partner.map(|index| own[index]) else { continue };
                path.source = Some(partner.source);
                path.overlapped = own.iter().any(|other| {
                    other.source != partner.source
                        && (other.range_m - partner.range_m).abs() < scan.pulse_m
                        && other.sinr > OVERLAP_RATIO * partner.sinr
                });
            }
        }
    });
}

/// A true path.
struct TruePath {
    anchor: usize,
    source: Source,
    range_m: f64,
    sinr: f64,
}

/// By how much an anchor's frames are late as a whole: where the sum over its estimated paths of exp(-delta^2 / 2 w^2) to the
/// nearest strong true path is largest; 0 among equals.
fn shift_m(anchor: usize, cycles: &[CycleScans], truth: &[Vec<TruePath>]) -> f64 {
    let mut sums = vec![0.0; 2 * SHIFT_STEPS as usize + 1];
    for (cycle, truth) in cycles.iter().zip(truth) {
        let Some(scan) = cycle.scans.iter().find(|scan| scan.anchor == anchor) else { continue };
        for path in &scan.paths {
            let width_m = pair_std_m(scan, path);
            for of in truth.iter().filter(|of| of.anchor == anchor) {
                let delta_m = path.range_m - of.range_m;
                if delta_m.abs() > LARGEST_SHIFT_M + 3.0 * width_m {
                    continue;
                }
                // Weak true paths are many, and rarely what was found.
                let weight = of.sinr / (of.sinr + 10.0);
                for (sum, step) in sums.iter_mut().zip(-SHIFT_STEPS..) {
                    let shift_m = f64::from(step) * (LARGEST_SHIFT_M / f64::from(SHIFT_STEPS));
                    let scaled = (delta_m - shift_m) / width_m;
                    *sum += weight * (-0.5 * scaled * scaled).exp();
                }
            }
        }
    }
    let best = (-SHIFT_STEPS..=SHIFT_STEPS)
        .zip(&sums)
        .max_by(|(m, a), (n, b)| a.total_cmp(b).then(n.abs().cmp(&m.abs())));
    best.map_or(0.0, |(step, _)| f64::from(step) * (LARGEST_SHIFT_M / f64::from(SHIFT_STEPS)))
}

/// By how much a path's length is off the true one in a label's cost, metres.
fn pair_std_m(scan: &Scan, path: &ScanPath) -> f64 {
    (LABEL_STD * scan.pulse_m).max(2.0 * path.std_m).max(1e-3)
}

/// Per path of a scan the index of its true path.
fn partners(scan: &Scan, truth: &[&TruePath], shift_m: f64) -> Vec<Option<usize>> {
    // What cannot be is dearer than any assignment that can.
    let impossible = UNPAIRED * (scan.paths.len() + 1) as f64;
    let cost = |path: usize, of: usize| {
        let Some(of) = truth.get(of) else { return UNPAIRED };
        let path = &scan.paths[path];
        let delta_m = path.range_m - shift_m - of.range_m;
        // A radio's range has no pulse here: six deviations.
        let gate_m = if scan.pulse_m > 0.0 { scan.pulse_m } else { 6.0 * path.std_m };
        if delta_m.abs() > gate_m {
            return impossible;
        }
        let scaled = delta_m / pair_std_m(scan, path);
        let ratio = if path.sinr > 0.0 { (path.sinr / of.sinr.max(1e-6)).ln() / LABEL_SINR_STD } else { 0.0 };
        0.5 * (scaled * scaled + ratio * ratio)
    };
    // One column per true path, and one per path that stays without.
    let columns = truth.len() + scan.paths.len();
    let partners = cheapest(scan.paths.len(), columns, cost);
    partners.into_iter().map(|partner| partner.filter(|&index| index < truth.len())).collect()
}
