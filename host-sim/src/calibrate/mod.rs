//! Calibration of a radio and its anchors from recordings: range biases (antenna delays), anchors' positions within what is told
//! of them, what errors of ranges look like, and the pulse.
//!
//! With a truth the way is known; without, it is estimated along with the calibration ([`batch`]). Everything comes with the
//! deviation that the recording leaves, and what it leaves unknown is said. What a tracker is told of it is [`mod@file`]'s matter.

pub mod batch;
pub mod file;
pub mod pulse;
pub mod range_error;
mod unknown;

use crate::cycle_choice::CycleChoice;
use crate::estimate;
use crate::input_error::InputError;
use crate::recording::{ARRAYS_FILE, Anchor, META_FILE, Recording};
use batch::{Estimate, Movement, Node, Observed, Prior, Run};
use file::{AnchorCalibration, AntennaCalibration, Calibration, Errors};
use nalgebra::DVector;
use pulse::{PulseEstimate, Shown};
use range_error::RangeError;
use std::path::Path;

/// Deviation of a bias where a recording tells none, metres: an antenna delay that nobody set.
const USUAL_BIAS_STD_M: f64 = 0.3;
/// What errors are taken to look like before anything was seen: share with an excess, its mean in metres, share of false ranges.
const USUAL_EXCESS: (f64, f64, f64) = (0.1, 0.3, 0.01);
/// Ranges that are needed at least, per anchor heard.
const LEAST_RANGES: usize = 5;
/// The tracker's own decay of velocities, seconds, where a recording tells none.
const USUAL_DECAY_S: f64 = 10.0;

/// What is asked of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The cycles that it may look at.
    pub cycles: CycleChoice,
    /// Whether it uses the truth of recordings that have one.
    pub uses_truth: bool,
    /// Standard deviation per axis of the anchors' positions as told, metres; 0: they are exact.
    pub anchor_std_m: f64,
    /// Standard deviation of biases beforehand, metres, of every anchor; without, what the first recording tells of each.
    pub bias_std_m: Option<f64>,
}

/// A recording with the folder that it is from.
pub type Source = (Recording, std::path::PathBuf);

/// A first guess of where the tag was in every cycle of a recording in a folder, metres.
pub type Way<'a> = dyn Fn(&Recording, &Path) -> Result<Vec<[f64; 2]>, InputError> + 'a;

/// Calibrates. `way` is asked for a first guess of where the tag was in every cycle of a recording that has no truth.
///
/// # Errors
/// The recordings have different anchors or antennas, too little was measured, or `way` fails.
pub fn calibrate(sources: &[Source], options: &Options, way: &Way<'_>) -> Result<Calibration, InputError> {
    let Some((first, folder)) = sources.first() else {
        return Err(InputError::new(".", "is no recording"));
    };
    for (recording, other) in sources {
        options.cycles.check(recording, other)?;
        check_alike(first, folder, recording, other)?;
    }
    let prior = prior(first, options);
    let mut runs = Vec::with_capacity(sources.len());
    let mut measured = Vec::with_capacity(sources.len());
    for (recording, folder) in sources {
        let heard = Heard::of(recording, folder, options.cycles)?;
        runs.push(run(recording, folder, options, &heard, way)?);
        measured.push(heard);
    }
    let heard = |anchor: usize| runs.iter().flat_map(|run| &run.observed).filter(move |o| o.anchor == anchor);
    let counts: Vec<usize> = (0..first.anchors.len()).map(|anchor| heard(anchor).count()).collect();
    let anchors_heard = counts.iter().filter(|count| **count > 0).count();
    let total: usize = counts.iter().sum();
    if total < LEAST_RANGES * anchors_heard.max(1) {
        let reason =
            format!("has {total} ranges in the cycles chosen, which is too little to calibrate from");
        let least = format!("{LEAST_RANGES} per anchor at least");
        return Err(InputError::new(folder.join(ARRAYS_FILE), reason).allowed(least));
    }
    let Some(estimate) = batch::estimate(&prior, &mut runs) else {
        return Err(InputError::new(folder, "cannot be calibrated: the equations have no solution"));
    };
    let pulse = pulse(sources, options.cycles);
    let one_range = measured.iter().all(|heard| heard.one_range);
    let of = Found { first, prior: &prior, estimate: &estimate, runs: &runs, counts: &counts, one_range };
    Ok(of.calibration(sources, options, pulse))
}

/// Refuses recordings that do not share anchors and antennas.
fn check_alike(first: &Recording, folder: &Path, other: &Recording, at: &Path) -> Result<(), InputError> {
    let refuse = |item: &str| {
        let reason = format!("are not those of {}: they are calibrated together", folder.display());
        Err(InputError::new(at.join(META_FILE), reason).for_item(item))
    };
    if first.anchors != other.anchors {
        return refuse("anchors");
    }
    if first.antennas != other.antennas {
        return refuse("antennas");
    }
    Ok(())
}

fn prior(first: &Recording, options: &Options) -> Prior {
    let radio = &first.radio;
    let std_m =
        |told_m: f64| options.bias_std_m.unwrap_or(if told_m > 0.0 { told_m } else { USUAL_BIAS_STD_M });
    let bias_m = |anchor: &Anchor| {
        let mean_m = anchor.range_bias_mean_m.unwrap_or(radio.range_bias_mean_m);
        [mean_m, std_m(anchor.range_bias_std_m.unwrap_or(radio.range_bias_std_m))]
    };
    let arms = first.antennas.iter().map(|antenna| antenna.lever_arm_m.unwrap_or([0.0; 2]));
    let (excess_share, excess_m, false_share) = USUAL_EXCESS;
    Prior {
        anchors_m: first.anchors.iter().map(|anchor| anchor.position_m).collect(),
        anchor_std_m: options.anchor_std_m,
        biases_m: first.anchors.iter().map(bias_m).collect(),
        difference_std_m: std_m(radio.range_bias_std_m),
        arms_m: if first.antennas.is_empty() { vec![[0.0; 2]] } else { arms.collect() },
        error: RangeError {
            noise_std_m: first.radio.range_std_m,
            excess_share,
            excess_m,
            false_share,
            longest_m: first.association.max_range_m,
        },
    }
}

/// The direct paths' ranges of a recording: cycle, anchor, metres.
struct Heard {
    ranges: Vec<(usize, usize, f64)>,
    /// Whether no anchor has more than one range in a cycle, and all are ranges: then they are the radio's own first paths.
    one_range: bool,
}

impl Heard {
    /// Of several ranges of an anchor and cycle the shortest; where there is none, the first path of its frame.
    fn of(recording: &Recording, folder: &Path, cycles: CycleChoice) -> Result<Self, InputError> {
        let mut ranges = Vec::new();
        let mut one_range = true;
        let longest_m = recording.association.max_range_m;
        let chosen = || recording.cycles.iter().enumerate().filter(|(index, _)| cycles.has(*index));
        for (index, cycle) in chosen() {
            for anchor in 0..recording.anchors.len() {
                let of_anchor = cycle.ranges.iter().filter(|range| range.anchor == anchor);
                one_range &= of_anchor.clone().count() <= 1;
                let sound = of_anchor.map(|range| range.range_m).filter(|&m| m > 0.0 && m <= longest_m);
                if let Some(range_m) = sound.min_by(f64::total_cmp) {
                    ranges.push((index, anchor, range_m));
                }
            }
        }
        let is_framed = chosen().any(|(_, cycle)| !cycle.frames.is_empty());
        // Where the radio ranges itself, its frames add nothing: they are on the axis of its ranges.
        if is_framed && ranges.is_empty() {
            one_range = false;
            let all = estimate::Options { false_paths: 0.1, from: 0, cycles: usize::MAX, anchor: None };
            let frames = estimate::estimate(recording, folder, &all, || {})?;
            for frame in frames.iter().filter(|frame| cycles.has(frame.cycle)) {
                if let Some(path) = frame.first_path.filter(|path| path.range_m > 0.0) {
                    ranges.push((frame.cycle, frame.anchor, path.range_m));
                }
            }
        }
        ranges.sort_by_key(|&(index, anchor, _)| (index, anchor));
        Ok(Self { ranges, one_range })
    }
}

/// A recording as the batch takes it.
fn run(
    recording: &Recording,
    folder: &Path,
    options: &Options,
    heard: &Heard,
    way: &Way<'_>,
) -> Result<Run, InputError> {
    let is_true = has_truth(recording, options);
    let guessed = if is_true { Vec::new() } else { way(&chosen_alone(recording, options.cycles), folder)? };
    let mut nodes: Vec<Node> = Vec::new();
    let mut node_of = vec![None; recording.cycles.len()];
    for (index, cycle) in recording.cycles.iter().enumerate().filter(|(index, _)| options.cycles.has(*index))
    {
        let place = if is_true { cycle.truth_position_m } else { guessed.get(index).copied() };
        let Some(position_m) = place else { continue };
        node_of[index] = Some(nodes.len());
        nodes.push(Node { time_s: cycle.time_s, position_m, ..Node::default() });
    }
    if !is_true {
        guess_velocities(&mut nodes);
    }
    let observed = heard.ranges.iter().filter_map(|&(index, anchor, range_m)| {
        let cycle = &recording.cycles[index];
        let up_m = cycle.tag_height_m.map_or(0.0, |height_m| height_m - recording.anchors[anchor].height_m);
        let antenna = cycle.antenna.unwrap_or(0);
        Some(Observed { node: node_of[index]?, anchor, antenna, range_m, up_m })
    });
    let movement = Movement {
        density_m2_s3: recording.acceleration_density_m2_s3().max(1e-12),
        decay_s: recording.motion.velocity_decay_s.unwrap_or(USUAL_DECAY_S),
    };
    Ok(Run { observed: observed.collect(), nodes, movement: (!is_true).then_some(movement) })
}

/// A recording in which nothing was heard in any other cycle.
fn chosen_alone(recording: &Recording, cycles: CycleChoice) -> Recording {
    let mut alone = recording.clone();
    for (_, cycle) in alone.cycles.iter_mut().enumerate().filter(|(index, _)| !cycles.has(*index)) {
        cycle.ranges.clear();
        cycle.frames.clear();
    }
    alone
}

/// Whether the truth of a recording is used.
fn has_truth(recording: &Recording, options: &Options) -> bool {
    let mut chosen = recording.cycles.iter().enumerate().filter(|(index, _)| options.cycles.has(*index));
    options.uses_truth && chosen.any(|(_, cycle)| cycle.truth_position_m.is_some())
}

/// Velocities from the positions before and after.
fn guess_velocities(nodes: &mut [Node]) {
    for index in 0..nodes.len() {
        let before = nodes[index.saturating_sub(1)];
        let after = nodes[(index + 1).min(nodes.len() - 1)];
        let elapsed_s = after.time_s - before.time_s;
        if elapsed_s > 0.0 {
            nodes[index].velocity_m_s =
                [0, 1].map(|axis| (after.position_m[axis] - before.position_m[axis]) / elapsed_s);
        }
    }
}

/// What the frames of the chosen cycles show of the pulse; nothing where it is told sample by sample.
fn pulse(sources: &[Source], cycles: CycleChoice) -> Option<PulseEstimate> {
    let (first, _) = sources.first()?;
    let spacing_s = first.radio.sample_spacing_s?;
    if first.radio.sampled_pulse.is_some() {
        return None;
    }
    let mut shown = Vec::new();
    for (recording, _) in sources.iter().filter(|(recording, _)| recording.radio == first.radio) {
        for (_, cycle) in recording.cycles.iter().enumerate().filter(|(index, _)| cycles.has(*index)) {
            for frame in &cycle.frames {
                let mut ranges = cycle.ranges.iter().filter(|range| range.anchor == frame.anchor);
                shown.push(Shown {
                    frame,
                    told_duration_s: recording.actions[frame.action].pulse_duration_s,
                    range_m: ranges.next().filter(|_| ranges.next().is_none()).map(|range| range.range_m),
                });
            }
        }
    }
    pulse::estimate(&shown, spacing_s)
}

/// What the batch found, and of what.
struct Found<'a> {
    first: &'a Recording,
    prior: &'a Prior,
    estimate: &'a Estimate,
    runs: &'a [Run],
    /// Ranges of each anchor.
    counts: &'a [usize],
    /// Whether the ranges are the radio's own first paths.
    one_range: bool,
}

impl Found<'_> {
    fn calibration(
        &self,
        sources: &[Source],
        options: &Options,
        pulse: Option<PulseEstimate>,
    ) -> Calibration {
        let Self { first, prior, estimate, .. } = self;
        let parameters = &estimate.parameters;
        let anchors = first.anchors.iter().enumerate().map(|(index, anchor)| {
            let error = prior.error(parameters, index);
            let (excess_m, std_m) = error.moments_m();
            AnchorCalibration {
                name: anchor.name.clone(),
                told_position_m: anchor.position_m,
                position_m: prior.anchor_m(parameters, index),
                position_std_m: [0, 1].map(|axis| match options.anchor_std_m {
                    0.0 => 0.0,
                    _ => self.std(prior.coordinate(index, axis)),
                }),
                ranges: self.counts[index],
                range_bias_m: prior.bias_m(parameters, index),
                range_bias_std_m: self.std(prior.bias(index)),
                noise_std_m: error.noise_std_m,
                excess_share: error.excess_share,
                mean_error_m: prior.bias_m(parameters, index) + excess_m,
                mean_error_std_m: self.mean_error_std_m(index),
                error_std_m: std_m,
            }
        });
        let antennas = first.antennas.iter().enumerate().map(|(index, antenna)| AntennaCalibration {
            name: antenna.name.clone(),
            difference_m: prior.difference_m(parameters, index),
            difference_std_m: self.difference_std_m(index),
        });
        let shape = prior.error(parameters, 0);
        let with_truth = sources.iter().all(|(recording, _)| has_truth(recording, options));
        let mut calibration = Calibration {
            format: file::FORMAT,
            recordings: sources.iter().map(|(recording, _)| recording.name.clone()).collect(),
            cycles: options.cycles,
            with_truth,
            errors: Errors {
                ranges: self.counts.iter().sum(),
                excess_m: shape.excess_m,
                false_share: shape.false_share,
                are_first_paths: self.one_range,
                suspicious_share: self.suspicious_share(),
            },
            anchors: anchors.collect(),
            antennas: antennas.collect(),
            pulse,
            unknown: Vec::new(),
        };
        calibration.unknown = unknown::sentences(self, &calibration);
        calibration
    }

    fn std(&self, place: usize) -> f64 {
        self.estimate.covariance[(place, place)].max(0.0).sqrt()
    }

    /// Standard deviation of a sum of parameters with weights.
    fn std_along(&self, weights: &DVector<f64>) -> f64 {
        weights.dot(&(&self.estimate.covariance * weights)).max(0.0).sqrt()
    }

    /// The same beforehand.
    fn told_std_along(&self, weights: &DVector<f64>) -> f64 {
        let squares = weights.iter().enumerate().map(|(place, w)| (w * self.prior.std(place)).powi(2));
        squares.sum::<f64>().sqrt()
    }

    fn difference_std_m(&self, antenna: usize) -> f64 {
        let mut weights = DVector::zeros(self.prior.size());
        let free = self.first.antennas.len() - 1;
        for place in 0..free {
            weights[self.prior.contrast(place)] = match antenna < free {
                true => f64::from(u8::from(place == antenna)),
                false => -1.0,
            };
        }
        self.std_along(&weights)
    }

    /// Standard deviation of bias and mean excess together, which are known better than either: by numeric slopes.
    fn mean_error_std_m(&self, anchor: usize) -> f64 {
        let parameters = &self.estimate.parameters;
        let at = |parameters: &DVector<f64>| {
            self.prior.bias_m(parameters, anchor) + self.prior.error(parameters, anchor).moments_m().0
        };
        let slopes = (0..self.prior.size()).map(|place| {
            let step = 1e-4 * self.prior.std(place);
            let moved = |by: f64| {
                let mut moved = parameters.clone();
                moved[place] += by;
                at(&moved)
            };
            (moved(step) - moved(-step)) / (2.0 * step)
        });
        self.std_along(&DVector::from_iterator(self.prior.size(), slopes))
    }

    /// Mean probability of the ranges that they are too long or false.
    fn suspicious_share(&self) -> f64 {
        let parameters = &self.estimate.parameters;
        let shares = self.runs.iter().flat_map(|run| {
            run.observed.iter().map(|observed| {
                let error_m = batch::error_m(self.prior, parameters, &run.nodes[observed.node], observed);
                self.prior.error(parameters, observed.anchor).suspicion(error_m)
            })
        });
        let (sum, count) = shares.fold((0.0, 0), |(sum, count), share| (sum + share, count + 1));
        sum / f64::from(count.max(1))
    }
}
