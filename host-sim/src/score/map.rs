//! How good the map is: the virtual anchors found against those that are there.
//!
//! **OSPA** (Schuhmacher, Vo, Vo 2008), cut-off c = 1 m, order 1: pair true and found ones so that the sum of
//! min(distance, c) is least, add c for each one without a partner, and divide by the larger of both numbers. Here
//! virtual anchors of different physical anchors never pair: the sums and the larger numbers are taken per physical
//! anchor and added up before the division. 0 is a perfect map; 1 m is one in which nothing fits.

use super::assignment::cheapest;
use crate::recording::Recording;
use serde::Serialize;

/// A found one further than this, metres, from a true one has nothing to do with it.
const CUT_OFF_M: f64 = 1.0;
/// A path below this SINR (power ratio) shows nothing of its virtual anchor.
pub(super) const SEEN_SINR: f64 = 3.0;
/// A virtual anchor is fair to ask for when its path was that strong in so many cycles: ranges alone do not locate it
/// sooner.
pub(super) const SEEN_CYCLES: usize = 20;

/// The map against the truth. Without a true map only `found` is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MapScore {
    /// Virtual anchors that are there and could have been seen.
    #[serde(rename = "true")]
    pub truth: Option<usize>,
    /// Virtual anchors in the map, right or wrong: existence above one half at the end.
    pub found: usize,
    /// OSPA distance of both, metres.
    pub ospa_m: Option<f64>,
    /// Of those found, how many have no true one of their own within 1 m.
    pub spurious: Option<usize>,
}

/// A true virtual anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueVirtualAnchor {
    /// Index of its physical anchor.
    pub anchor: usize,
    /// Its position, metres.
    pub position_m: [f64; 2],
    /// Whether it could have been seen. A map need not hold the others, and may.
    pub seen: bool,
}

/// The true map of a recording; none where nobody knows it.
pub fn truth(recording: &Recording) -> Option<Vec<TrueVirtualAnchor>> {
    let mut strong = vec![0; recording.virtual_anchors.len()];
    let mut paths_known = false;
    for path in recording.cycles.iter().flat_map(|cycle| &cycle.truth_paths) {
        paths_known = true;
        if let Some(count) = path.virtual_anchor.and_then(|index| strong.get_mut(index)) {
            *count += usize::from(path.sinr > SEEN_SINR);
        }
    }
    if recording.virtual_anchors.is_empty() && !paths_known {
        return None;
    }
    let there = recording.virtual_anchors.iter().zip(strong).filter(|(va, _)| va.exists);
    let truth = there.map(|(va, strong)| TrueVirtualAnchor {
        anchor: va.anchor,
        position_m: va.position_m,
        seen: !paths_known || strong >= SEEN_CYCLES,
    });
    Some(truth.collect())
}

impl MapScore {
    /// Scores the virtual anchors found (index of the physical anchor, position in metres) against the true map.
    ///
    /// A found one that fits a true one which could not have been seen (a floor plan knew of it) neither counts for
    /// nor against the map.
    pub fn new(truth: Option<&[TrueVirtualAnchor]>, found: &[(usize, [f64; 2])]) -> Self {
        let Some(truth) = truth else { return Self { found: found.len(), ..Self::default() } };
        let mut anchors: Vec<usize> = truth.iter().map(|va| va.anchor).collect();
        anchors.extend(found.iter().map(|(anchor, _)| anchor));
        anchors.sort_unstable();
        anchors.dedup();
        let (mut spurious, mut cost_m, mut count) = (0, 0.0, 0);
        for anchor in anchors {
            let places = |seen: bool| -> Vec<[f64; 2]> {
                let here = truth.iter().filter(|va| va.anchor == anchor && va.seen == seen);
                here.map(|va| va.position_m).collect()
            };
            let here = found.iter().filter(|(of, _)| *of == anchor);
            let here: Vec<[f64; 2]> = here.map(|(_, position_m)| *position_m).collect();
            let seen = places(true);
            let (near_m, rest) = pair(&seen, &here);
            let (excused, astray) = pair(&places(false), &rest);
            spurious += astray.len();
            let larger = seen.len().max(here.len() - excused.len());
            cost_m += near_m.iter().sum::<f64>() + CUT_OFF_M * (larger - near_m.len()) as f64;
            count += larger;
        }
        Self {
            truth: Some(truth.iter().filter(|va| va.seen).count()),
            found: found.len(),
            ospa_m: Some(if count > 0 { cost_m / count as f64 } else { 0.0 }),
            spurious: Some(spurious),
        }
    }
}

/// Pairs found ones with true ones at the least sum of cut distances: the distances of the pairs within the cut-off,
/// metres, and the found ones in no such pair.
fn pair(truth: &[[f64; 2]], found: &[[f64; 2]]) -> (Vec<f64>, Vec<[f64; 2]>) {
    let distance = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    // A position that is not finite is far from everything.
    let cut = |m: f64| if m < CUT_OFF_M { m } else { CUT_OFF_M };
    let partners = cheapest(found.len(), truth.len(), |f, t| cut(distance(&found[f], &truth[t])));
    let (mut near_m, mut rest) = (Vec::new(), Vec::new());
    for (place, partner) in found.iter().zip(partners) {
        match partner.map(|t| distance(place, &truth[t])) {
            Some(m) if m < CUT_OFF_M => near_m.push(m),
            _ => rest.push(*place),
        }
    }
    (near_m, rest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::random::{Purpose, stream, uniform};
    use crate::recording::tests::example;
    use crate::recording::{TruthPath, VirtualAnchor};

    fn there(anchor: usize, position_m: [f64; 2]) -> TrueVirtualAnchor {
        TrueVirtualAnchor { anchor, position_m, seen: true }
    }

    fn score(truth: &[TrueVirtualAnchor], found: &[(usize, [f64; 2])]) -> (f64, usize) {
        let score = MapScore::new(Some(truth), found);
        (score.ospa_m.expect("the map is known"), score.spurious.expect("the map is known"))
    }

    #[test]
    fn a_perfect_map_is_at_zero_and_each_mistake_costs_its_share_of_a_metre() {
        let truth = [there(0, [0.0, 0.0]), there(0, [5.0, 0.0]), there(1, [0.0, 5.0]), there(1, [9.0, 9.0])];
        let right: Vec<_> = truth.iter().map(|va| (va.anchor, va.position_m)).collect();
        assert_eq!(score(&truth, &right), (0.0, 0));
        assert_eq!(score(&truth, &right[..3]), (0.25, 0), "one is missing");
        assert_eq!(score(&truth, &[&right[..], &[(1, [20.0, 0.0])]].concat()), (0.2, 1), "one too many");
        assert_eq!(score(&truth, &[&right[..], &[(1, [9.1, 9.0])]].concat()), (0.2, 1), "one twice");
        let mut astray = right.clone();
        astray[0].1 = [0.3, 0.4];
        assert_eq!(score(&truth, &astray), (0.125, 0), "half a metre off");
        astray[0].1 = [3.0, 4.0];
        assert_eq!(score(&truth, &astray), (0.25, 1), "far off");
        astray[0] = (1, [0.0, 0.0]);
        // Too many at one anchor, too few at the other: two mistakes among five.
        assert_eq!(score(&truth, &astray), (0.4, 1), "at the other anchor");
        assert_eq!(score(&truth, &[]), (1.0, 0));
        assert_eq!(score(&[], &right), (1.0, 4));
        assert_eq!(score(&[], &[]), (0.0, 0));
        assert_eq!(score(&truth, &[(0, [f64::NAN, 0.0])]), (1.0, 1));
    }

    #[test]
    fn the_nearest_is_given_up_where_that_serves_the_whole() {
        // Both found ones are nearest to the first true one.
        let truth = [there(0, [0.0, 0.0]), there(0, [-0.9, 0.0])];
        let (ospa_m, spurious) = score(&truth, &[(0, [0.1, 0.0]), (0, [-0.2, 0.0])]);
        assert!((ospa_m - 0.4).abs() < 1e-12 && spurious == 0, "{ospa_m}");
    }

    #[test]
    fn what_could_not_be_seen_is_neither_asked_for_nor_held_against_the_map() {
        let hidden = TrueVirtualAnchor { seen: false, ..there(0, [5.0, 0.0]) };
        let truth = [there(0, [0.0, 0.0]), hidden];
        assert_eq!(score(&truth, &[(0, [0.0, 0.0])]), (0.0, 0));
        assert_eq!(score(&truth, &[(0, [0.0, 0.0]), (0, [5.2, 0.0])]), (0.0, 0));
        assert_eq!(score(&truth, &[(0, [5.2, 0.0])]), (1.0, 0));
        assert_eq!(score(&truth, &[(0, [0.0, 0.0]), (0, [5.2, 0.0]), (0, [5.0, 0.1])]), (0.5, 1));
        assert_eq!(MapScore::new(Some(&truth), &[]).truth, Some(1));
    }

    /// OSPA of one anchor by its definition: the least over all ways to pair, order 1.
    fn by_enumeration(few: &[[f64; 2]], many: &mut Vec<[f64; 2]>) -> f64 {
        let Some((first, rest)) = few.split_first() else { return many.len() as f64 };
        let mut least = f64::INFINITY;
        for n in 0..many.len() {
            let partner = many.remove(n);
            let m = (first[0] - partner[0]).hypot(first[1] - partner[1]).min(1.0);
            least = least.min(m + by_enumeration(rest, many));
            many.insert(n, partner);
        }
        least
    }

    #[test]
    fn it_is_the_least_over_all_pairings() {
        let mut rng = stream(6, Purpose::Experiment, &[]);
        for trial in 0..500 {
            let mut places = |count: usize| -> Vec<[f64; 2]> {
                (0..count).map(|_| [2.0 * uniform(&mut rng), 2.0 * uniform(&mut rng)]).collect()
            };
            let (truth, found) = (places(1 + trial % 6), places(trial / 6 % 6));
            let (few, mut many) = if truth.len() < found.len() {
                (truth.clone(), found.clone())
            } else {
                (found.clone(), truth.clone())
            };
            let number = many.len() as f64;
            let expected = by_enumeration(&few, &mut many) / number;
            let truth: Vec<_> = truth.into_iter().map(|place| there(0, place)).collect();
            let found: Vec<_> = found.into_iter().map(|place| (0, place)).collect();
            let (ospa_m, _) = score(&truth, &found);
            assert!((ospa_m - expected).abs() < 1e-12, "trial {trial}: {ospa_m}, not {expected}");
        }
    }

    #[test]
    fn the_true_map_has_what_exists_and_knows_what_was_strong_for_long() {
        let mut recording = example();
        recording.virtual_anchors =
            (0..3).map(|n| VirtualAnchor::new(0, [f64::from(n), -7.0], 0.0, false)).collect();
        recording.virtual_anchors[2].exists = false;
        let seen = |recording: &Recording| -> Option<Vec<bool>> {
            Some(truth(recording)?.iter().map(|va| va.seen).collect())
        };
        let path = |virtual_anchor, sinr| TruthPath {
            anchor: 0,
            virtual_anchor: Some(virtual_anchor),
            delay_s: 1e-8,
            magnitude: 1.0,
            sinr,
        };
        recording.cycles.iter_mut().for_each(|cycle| cycle.truth_paths.clear());
        assert_eq!(seen(&recording), Some(vec![true, true]), "no path is known: all count");
        recording.cycles[0].truth_paths = vec![path(0, 2.9), path(1, 3.1)];
        assert_eq!(seen(&recording), Some(vec![false, false]));
        let strong = recording.cycles[0].clone();
        recording.cycles.resize(SEEN_CYCLES, strong);
        recording.cycles.iter_mut().for_each(|cycle| cycle.truth_paths = vec![path(0, 2.9), path(1, 3.1)]);
        assert_eq!(seen(&recording), Some(vec![false, true]));
        recording.virtual_anchors.clear();
        recording.cycles.iter_mut().for_each(|cycle| cycle.truth_paths.clear());
        assert_eq!(seen(&recording), None);
    }
}
