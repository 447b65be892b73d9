//! What the estimates of one anchor's frames are worth.

use super::registration::{Response, register};
use super::spread::{Spread, median};
use super::truth::Tally;
use super::{EstimatedFrame, SPEED_OF_LIGHT_M_S};
use crate::recording::{Recording, Samples};
use serde::Serialize;

/// A tag that stays within this of one place is at rest, metres.
const REST_M: f64 = 1e-3;
/// A response less like its repetitions than this was not received over the same channel.
const ALIKE: f64 = 0.9;
/// So many responses must be alike.
const FEWEST: usize = 5;

/// Figures of all estimated frames of one anchor of a recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Link {
    /// The recording's name.
    pub recording: String,
    /// Index of the anchor.
    pub anchor: usize,
    /// Its name.
    pub name: String,
    /// Whether the direct path is free in all frames; none where that is not known or changes.
    pub line_of_sight: Option<bool>,
    /// Frames estimated.
    pub frames: usize,
    /// Those without any path.
    pub frames_without_path: usize,
    /// Mean number of paths per frame.
    pub paths_per_frame: f64,
    /// Those of them that are ahead of the first path by more than a pulse duration.
    pub paths_ahead_per_frame: f64,
    /// Share of the frames with a path within a pulse duration of the first one.
    pub first_path_share: f64,
    /// Range of the first path, metres.
    pub first_path_range_m: Option<Spread>,
    /// The radio's own range, metres, over the frames that have one.
    pub radio_range_m: Option<Spread>,
    /// First-path range minus true range, metres.
    pub first_path_error_m: Option<Spread>,
    /// The radio's own range minus true range, metres.
    pub radio_error_m: Option<Spread>,
    /// Median rms level of the white noise, in the unit of the samples.
    pub noise_level: f64,
    /// Median of the strongest path's power over that of the white noise, decibels.
    pub strongest_over_noise_db: Option<f64>,
    /// Median share of a frame's energy that is left without its paths.
    pub residual_share: Option<f64>,
    /// Median share of a frame's energy that is white noise.
    pub noise_share: f64,
    /// Repeated complex responses of a tag at rest, registered with one another.
    pub registered: Option<RegisteredFirstPaths>,
    /// Against the true paths, where the recording holds them.
    pub truth: Option<AgainstTruth>,
}

/// First paths beside the shift of the whole response. In a static link that difference should be constant: its spread
/// is what detecting the first path adds to a range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RegisteredFirstPaths {
    /// Responses that agree with their repetitions.
    pub responses: usize,
    /// Those that do not, and are left out.
    pub unlike: usize,
    /// Position of the estimator's first path, metres from the registered point.
    pub first_path_m: Spread,
    /// The same for the radio's own first-path index.
    pub radio_first_path_m: Option<Spread>,
    /// The registered point on the recording's axis of delay, metres: the range of a detector without any error, with
    /// the zero that the radio's index gave each frame.
    pub ideal_range_m: Spread,
    /// Correlation of the radio's own range with the error of its index, outliers apart: what it would be near -1 or 1
    /// if the range were made of this very response, and zero if it was made of others.
    pub range_index_correlation: Option<f64>,
}

/// Estimated against true paths.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AgainstTruth {
    /// True paths in all frames.
    pub paths: usize,
    /// Share of them found within half a pulse duration.
    pub detected_share: Option<f64>,
    /// Share found of those of 9 dB SINR and more.
    pub detected_share_above_9_db: Option<f64>,
    /// Share found of those of 12 dB SINR and more.
    pub detected_share_above_12_db: Option<f64>,
    /// Estimated paths per frame that are no true one.
    pub false_paths_per_frame: f64,
    /// Those of them that are farther than a pulse duration from every true path above -3 dB: nothing is there.
    pub far_false_paths_per_frame: f64,
    /// Fitted level of noise and dense multipath over the true one, where true paths are: median.
    pub level_ratio_median: Option<f64>,
    /// That which 95 % of them stay below.
    pub level_ratio_95: Option<f64>,
    /// Root mean square delay error of the paths found, seconds.
    pub delay_rmse_s: Option<f64>,
}

/// The figures of every anchor that has frames.
pub fn links(recording: &Recording, frames: &[EstimatedFrame]) -> Vec<Link> {
    let anchors = recording.anchors.iter().enumerate();
    anchors
        .filter_map(|(index, anchor)| {
            let own: Vec<&EstimatedFrame> = frames.iter().filter(|frame| frame.anchor == index).collect();
            (!own.is_empty()).then(|| link(recording, index, &anchor.name, &own))
        })
        .collect()
}

fn link(recording: &Recording, anchor: usize, name: &str, frames: &[&EstimatedFrame]) -> Link {
    let count = frames.len() as f64;
    // Of every path, how much later than the first path it is, in pulse durations.
    let pulse_s = recording.actions.iter().map(|action| action.pulse_duration_s).fold(0.0, f64::max);
    let later = |frame: &EstimatedFrame| -> Vec<f64> {
        let first = frame.first_path.iter().map(|first| first.delay_s);
        first
            .flat_map(|first_s| frame.paths.iter().map(move |path| (path.delay_s - first_s) / pulse_s))
            .collect()
    };
    let ahead = |frame: &&EstimatedFrame| later(frame).iter().filter(|later| **later < -1.0).count();
    let has_first = |frame: &&&EstimatedFrame| later(frame).iter().any(|later| later.abs() <= 1.0);
    let first = |frame: &&EstimatedFrame| frame.first_path.map(|path| path.range_m);
    let free: Option<Vec<bool>> = frames.iter().map(|frame| frame.line_of_sight).collect();
    let strongest_db = frames.iter().filter_map(|frame| {
        let strongest = frame.paths.iter().map(|path| path.power()).fold(0.0, f64::max);
        (strongest > 0.0).then(|| 10.0 * (strongest / frame.white_noise).log10())
    });
    Link {
        recording: recording.name.clone(),
        anchor,
        name: name.to_owned(),
        line_of_sight: free.and_then(|free| free.iter().all(|&other| other == free[0]).then_some(free[0])),
        frames: frames.len(),
        frames_without_path: frames.iter().filter(|frame| frame.paths.is_empty()).count(),
        paths_per_frame: frames.iter().map(|frame| frame.paths.len()).sum::<usize>() as f64 / count,
        paths_ahead_per_frame: frames.iter().map(ahead).sum::<usize>() as f64 / count,
        first_path_share: frames.iter().filter(has_first).count() as f64 / count,
        first_path_range_m: Spread::of(frames.iter().filter_map(first)),
        radio_range_m: Spread::of(frames.iter().filter_map(|frame| frame.radio_range_m)),
        first_path_error_m: Spread::of(
            frames.iter().filter_map(|frame| Some(frame.first_path?.range_m - frame.true_range_m?)),
        ),
        radio_error_m: Spread::of(
            frames.iter().filter_map(|frame| Some(frame.radio_range_m? - frame.true_range_m?)),
        ),
        noise_level: median(frames.iter().map(|frame| frame.white_noise.sqrt())).unwrap_or(0.0),
        strongest_over_noise_db: median(strongest_db),
        residual_share: median(frames.iter().filter_map(|frame| frame.residual_share)),
        noise_share: median(frames.iter().map(|frame| frame.noise_share)).unwrap_or(0.0),
        registered: registered(recording, anchor, frames),
        truth: {
            let mut tally = Tally::default();
            tally.add(recording, frames.iter().copied());
            tally.figures()
        },
    }
}

fn registered(
    recording: &Recording,
    anchor: usize,
    frames: &[&EstimatedFrame],
) -> Option<RegisteredFirstPaths> {
    let spacing_s = recording.radio.sample_spacing_s?;
    if !is_at_rest(recording, frames) {
        return None;
    }
    let mut responses: Vec<Response<'_>> = Vec::new();
    let mut received = Vec::new();
    for frame in frames {
        let raw = recording.cycles[frame.cycle].frames.iter().find(|raw| raw.anchor == anchor)?;
        let Samples::Complex(samples) = &raw.samples else { return None };
        let seen_s = frame.radio_first_path_s.or_else(|| frame.first_path.map(|path| path.delay_s));
        if let Some(seen_s) = seen_s {
            responses.push((samples, (seen_s - raw.first_sample_delay_s) / spacing_s));
            received.push((*frame, raw.first_sample_delay_s));
        }
    }
    let places = register(&responses, spacing_s);
    // (estimated, radio's own, registered) delay of each response that is like the others.
    let alike: Vec<_> = places
        .iter()
        .zip(&received)
        .filter(|(place, _)| place.likeness >= ALIKE)
        .map(|(place, (frame, first_sample_s))| (*frame, first_sample_s + place.position * spacing_s))
        .collect();
    if alike.len() < FEWEST {
        return None;
    }
    let metres = |seconds: f64| seconds * SPEED_OF_LIGHT_M_S;
    let own = alike.iter().filter_map(|(frame, place_s)| Some(metres(frame.first_path?.delay_s - place_s)));
    let radio = alike.iter().filter_map(|(frame, place_s)| Some(metres(frame.radio_first_path_s? - place_s)));
    Some(RegisteredFirstPaths {
        responses: alike.len(),
        unlike: places.len() - alike.len(),
        first_path_m: Spread::of(own)?,
        radio_first_path_m: Spread::of(radio),
        ideal_range_m: Spread::of(alike.iter().map(|(_, place_s)| metres(*place_s)))?,
        range_index_correlation: correlation(alike.iter().filter_map(|(frame, place_s)| {
            Some((frame.radio_range_m?, metres(frame.radio_first_path_s? - place_s)))
        })),
    })
}

/// Correlation coefficient of pairs of which neither is further than three robust deviations from its median.
fn correlation(pairs: impl Iterator<Item = (f64, f64)>) -> Option<f64> {
    let mut pairs: Vec<(f64, f64)> = pairs.collect();
    let first = Spread::of(pairs.iter().map(|pair| pair.0))?;
    let second = Spread::of(pairs.iter().map(|pair| pair.1))?;
    let near = |value: f64, spread: &Spread| (value - spread.median).abs() <= 3.0 * spread.robust_std;
    pairs.retain(|pair| near(pair.0, &first) && near(pair.1, &second));
    let first = Spread::of(pairs.iter().map(|pair| pair.0))?;
    let second = Spread::of(pairs.iter().map(|pair| pair.1))?;
    let products = pairs.iter().map(|pair| (pair.0 - first.mean) * (pair.1 - second.mean));
    let coefficient = products.sum::<f64>() / ((pairs.len() as f64 - 1.0) * first.std * second.std);
    (pairs.len() >= FEWEST && coefficient.is_finite()).then_some(coefficient)
}

/// Whether the tag is known to have stayed at one place.
fn is_at_rest(recording: &Recording, frames: &[&EstimatedFrame]) -> bool {
    let mut places = frames.iter().map(|frame| recording.cycles[frame.cycle].truth_position_m);
    let Some(Some([x, y])) = places.next() else { return false };
    places.all(|place| place.is_some_and(|[other_x, other_y]| (other_x - x).hypot(other_y - y) <= REST_M))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::{Options, estimate};
    use crate::recording::tests::example;
    use crate::recording::{Cycle, Frame, Range};
    use std::path::Path;

    const SPACING_S: f64 = 0.25e-9;
    const TRUE_M: f64 = 2.5;

    /// A tag at rest, one path, twelve frames that begin anywhere; the radio sees the path where it is but for
    /// `jitter` samples, and its range has the share `follows` of that error.
    fn at_rest(follows: f64) -> (Recording, Vec<f64>) {
        let mut recording = example();
        recording.radio.sample_spacing_s = Some(SPACING_S);
        let jitter: Vec<f64> = (0..12).map(|n| f64::from(n * 7 % 12) / 12.0 - 0.45).collect();
        recording.cycles = jitter
            .iter()
            .enumerate()
            .map(|(n, jitter)| {
                let place = 60.0 + 0.083 * n as f64;
                let index = place + jitter;
                let scatter_m = 0.005 * (f64::from((4 * n as u32 + 1) * n as u32 % 11) - 5.0);
                let range_m = TRUE_M + scatter_m + follows * jitter * SPACING_S * SPEED_OF_LIGHT_M_S;
                let pulse = cogmint_core::radio::pulse::Pulse::root_raised_cosine(0.5e-9, 0.6);
                let sample = |n: usize| {
                    let value = 300.0 * pulse.autocorrelation(((n as f64 - place) / 2.0) as f32);
                    // Noise enough for a level.
                    [value + (n as f32 * 1.7).sin(), (n as f32 * n as f32 * 0.13).sin()]
                };
                Cycle {
                    time_s: n as f64,
                    truth_position_m: Some([0.5 + TRUE_M, 7.0]),
                    ranges: vec![Range { anchor: 0, range_m, std_m: None, angles: None }],
                    frames: vec![Frame {
                        anchor: 0,
                        action: 0,
                        first_sample_delay_s: TRUE_M / SPEED_OF_LIGHT_M_S - index * SPACING_S,
                        first_path_index: Some(index),
                        line_of_sight: Some(true),
                        samples: Samples::Complex((0..400).map(sample).collect()),
                    }],
                    ..Cycle::default()
                }
            })
            .collect();
        (recording, jitter)
    }

    fn only_link(recording: &Recording) -> Link {
        let options = Options { false_paths: 0.01, from: 0, cycles: usize::MAX, anchor: None };
        let frames = estimate(recording, Path::new("r"), &options, || {}).expect("is estimated");
        let mut links = links(recording, &frames);
        assert_eq!(links.len(), 1);
        links.remove(0)
    }

    #[test]
    fn registration_tells_the_radios_jitter_from_ours() {
        let (recording, jitter) = at_rest(0.0);
        let link = only_link(&recording);
        assert_eq!((link.line_of_sight, link.frames, link.frames_without_path), (Some(true), 12, 0));
        let registered = link.registered.expect("the tag is at rest");
        assert_eq!((registered.responses, registered.unlike), (12, 0));
        let given_m = Spread::of(jitter.iter().map(|part| part * SPACING_S * SPEED_OF_LIGHT_M_S)).unwrap();
        let seen_m = registered.radio_first_path_m.unwrap();
        assert!((seen_m.std - given_m.std).abs() < 5e-4, "{} {}", seen_m.std, given_m.std);
        assert!(registered.first_path_m.std < 2e-3, "{}", registered.first_path_m.std);
        // What carries the radio's zero scatters with it.
        assert!((registered.ideal_range_m.std - given_m.std).abs() < 5e-4);
        assert!(registered.range_index_correlation.unwrap().abs() < 0.5);
        let (followed, _) = at_rest(1.0);
        let correlation = only_link(&followed).registered.unwrap().range_index_correlation;
        assert!(correlation.unwrap() > 0.7, "{correlation:?}");
    }

    #[test]
    fn a_tag_that_moves_is_not_registered() {
        let (mut recording, _) = at_rest(0.0);
        recording.cycles[7].truth_position_m = Some([3.1, 7.0]);
        let link = only_link(&recording);
        assert_eq!(link.registered, None);
        assert_eq!(link.first_path_error_m.unwrap().count, 12);
    }
}
