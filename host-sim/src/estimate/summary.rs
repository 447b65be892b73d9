//! What the estimates of many links are worth together.

use super::link::Link;
use super::spread::{Spread, median};
use serde::Serialize;

/// Figures over links that are alike in how the direct path is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Whether the direct path is free; none where that is not known or changes.
    pub line_of_sight: Option<bool>,
    /// Links.
    pub links: usize,
    /// Frames of these.
    pub frames: usize,
    /// Share of these without any path.
    pub without_path_share: f64,
    /// Share of them with a path within a pulse duration of the first one.
    pub first_path_share: f64,
    /// Paths per frame that are ahead of the first one by more than that.
    pub paths_ahead_per_frame: f64,
    /// Share of the links whose first-path range spreads no more than the radio's own range. Where the true range is
    /// known, the errors of both are compared.
    pub range_spread_no_larger: Option<Share>,
    /// The same for a detector without any error, which only carries the zero that the radio gave each frame.
    pub ideal_range_spread_no_larger: Option<Share>,
    /// Share of the links whose first path spreads no more, against the registered response, than the radio's own
    /// range.
    pub first_path_spread_no_larger_than_range: Option<Share>,
    /// Share of the links whose first path spreads no more, against the registered response, than the radio's own
    /// first-path index.
    pub first_path_spread_no_larger_than_radio: Option<Share>,
    /// Median over the links of the first path's standard deviation against the registered response, metres.
    pub first_path_std_m: Option<f64>,
    /// The same for the radio's own first-path index.
    pub radio_first_path_std_m: Option<f64>,
    /// Mean over the links of the correlation of the radio's own range with the error of its index, and how far that
    /// mean is uncertain: 1 / sqrt(responses).
    pub range_index_correlation: Option<[f64; 2]>,
    /// Median over the links of the median first-path range error, metres, and its spread from link to link.
    pub bias_m: Option<Spread>,
    /// The same for the radio's own range.
    pub radio_bias_m: Option<Spread>,
    /// Median share of a frame's energy that is left without its paths.
    pub residual_share: Option<f64>,
}

/// Share of the links of which a comparison holds, by standard deviation and by robust deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Share {
    /// Links that could be compared.
    pub links: usize,
    /// Share of them by standard deviation.
    pub by_std: f64,
    /// Share of them by 1.4826 times the median absolute deviation.
    pub by_robust_std: f64,
}

impl Share {
    /// Of pairs whose first spread is to be no larger than the second.
    fn of(pairs: impl Iterator<Item = (Spread, Spread)>) -> Option<Self> {
        let pairs: Vec<(Spread, Spread)> = pairs.collect();
        let count = |holds: &dyn Fn(&Spread) -> f64| {
            pairs.iter().filter(|(own, other)| holds(own) <= holds(other)).count() as f64 / pairs.len() as f64
        };
        (!pairs.is_empty()).then(|| Self {
            links: pairs.len(),
            by_std: count(&|spread| spread.std),
            by_robust_std: count(&|spread| spread.robust_std),
        })
    }
}

/// A summary for each kind of direct path that occurs: free, not free, unknown.
pub fn summaries(links: &[&Link]) -> Vec<Summary> {
    [Some(true), Some(false), None]
        .into_iter()
        .filter_map(|kind| {
            let own: Vec<&Link> = links.iter().copied().filter(|link| link.line_of_sight == kind).collect();
            (!own.is_empty()).then(|| summary(kind, &own))
        })
        .collect()
}

fn summary(line_of_sight: Option<bool>, links: &[&Link]) -> Summary {
    let compared = |own: &dyn Fn(&Link) -> Option<Spread>, other: &dyn Fn(&Link) -> Option<Spread>| {
        Share::of(links.iter().filter_map(|link| Some((own(link)?, other(link)?))))
    };
    let first_path = |link: &Link| Some(link.registered?.first_path_m);
    let radio_first_path = |link: &Link| link.registered?.radio_first_path_m;
    let frames: usize = links.iter().map(|link| link.frames).sum();
    // Of all frames, whichever link they are of.
    let mean = |of: &dyn Fn(&Link) -> f64| {
        links.iter().map(|link| of(link) * link.frames as f64).sum::<f64>() / frames as f64
    };
    Summary {
        line_of_sight,
        links: links.len(),
        frames,
        without_path_share: mean(&|link| link.frames_without_path as f64 / link.frames as f64),
        first_path_share: mean(&|link| link.first_path_share),
        paths_ahead_per_frame: mean(&|link| link.paths_ahead_per_frame),
        range_spread_no_larger: compared(
            &|link| link.first_path_error_m.or(link.first_path_range_m),
            &|link| link.radio_error_m.or(link.radio_range_m),
        ),
        ideal_range_spread_no_larger: compared(&|link| Some(link.registered?.ideal_range_m), &|link| {
            link.radio_range_m
        }),
        first_path_spread_no_larger_than_range: compared(&first_path, &|link| link.radio_range_m),
        first_path_spread_no_larger_than_radio: compared(&first_path, &radio_first_path),
        first_path_std_m: median(links.iter().filter_map(|link| Some(first_path(link)?.std))),
        radio_first_path_std_m: median(links.iter().filter_map(|link| Some(radio_first_path(link)?.std))),
        range_index_correlation: range_index_correlation(links),
        bias_m: Spread::of(links.iter().filter_map(|link| Some(link.first_path_error_m?.median))),
        radio_bias_m: Spread::of(links.iter().filter_map(|link| Some(link.radio_error_m?.median))),
        residual_share: median(links.iter().filter_map(|link| link.residual_share)),
    }
}

fn range_index_correlation(links: &[&Link]) -> Option<[f64; 2]> {
    let registered = links.iter().filter_map(|link| link.registered);
    let known: Vec<(f64, usize)> =
        registered.filter_map(|own| Some((own.range_index_correlation?, own.responses))).collect();
    let responses: usize = known.iter().map(|(_, responses)| responses).sum();
    let sum: f64 = known.iter().map(|(correlation, _)| correlation).sum();
    (!known.is_empty()).then(|| [sum / known.len() as f64, 1.0 / (responses as f64).sqrt()])
}
