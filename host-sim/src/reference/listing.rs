//! The sources that a plan shows, the most useful first.
//!
//! Worth of an image: share of the places in the outline that see it (availability above 0.3, not too far), each
//! by the probability that it is resolved from the direct path, half of that over
//! two reflections. Of too many walls those are used whose single reflections are worth most to all anchors together.

use super::availability::{WallNow, availability, either_order};
use super::plan::{FloorPlan, Wall};
use super::real::{Real, abs, exp, limited, sin, smaller, sqrt, square, tau};
use super::surface::less;
use cogmint_core::Anchor;
use cogmint_core::model::availability::USUAL_THROUGH;
use cogmint_core::model::listing::PLACE_STD_M;
use cogmint_core::radio::pulse::MERGED;

/// A source worth keeping.
#[derive(Clone, Debug, PartialEq)]
pub struct Listed<T> {
    /// Index of its anchor.
    pub anchor: usize,
    /// Its walls, from the anchor.
    pub walls: Vec<usize>,
    /// Whether they may come in either order.
    pub is_either_order: bool,
    /// Share of the places that see it, by the probability that it is resolved.
    pub seen_share: T,
}

/// The best `most` sources over at most `most_walls` walls.
pub fn list<T: Real>(
    plan: &FloorPlan<T>,
    anchors: &[Anchor],
    reflections: usize,
    max_range_m: f32,
    pulse_m: f32,
    most_walls: usize,
    most: usize,
) -> Vec<Listed<T>> {
    if reflections == 0 {
        return Vec::new();
    }
    let told = &plan.walls;
    let now: Vec<WallNow<T>> = told
        .iter()
        .map(|wall| WallNow::new(wall.clone(), T::of(wall.told.offset_std_m), T::of(USUAL_THROUGH)))
        .collect();
    let places = places(plan);
    let share = |anchor: &Anchor, sequence: &[usize], is_either: bool| {
        let anchor_m = anchor.position_m.map(T::of);
        let image = sequence.iter().fold(anchor_m, |image, &wall| told[wall].line.mirrored_m(image));
        let apart = |a: [T; 2], b: [T; 2]| {
            let way = less(a, b);
            sqrt(square(way[0]) + square(way[1]))
        };
        let mut seen = T::ZERO;
        for &place in &places {
            let std = T::of(PLACE_STD_M);
            let available = if is_either {
                either_order(&now, anchor_m, [sequence[0], sequence[1]], place, std).0
            } else {
                availability(&now, anchor_m, sequence, place, std)
            };
            let length = apart(image, place);
            if length <= T::of(max_range_m) && available > T::of(0.3) {
                let excess = length - apart(anchor_m, place);
                seen += T::ONE - exp(-square(excess / T::of(pulse_m) / T::of(MERGED)));
            }
        }
        if seen > T::ZERO { seen / T::of_count(places.len()) } else { T::ZERO }
    };
    let mut used: Vec<usize> = (0..told.len()).collect();
    if used.len() > most_walls {
        let mut worth = vec![T::ZERO; told.len()];
        for wall in 0..told.len() {
            for anchor in anchors {
                worth[wall] += share(anchor, &[wall], false);
            }
        }
        used.sort_by(|&a, &b| worth[b].partial_cmp(&worth[a]).expect("are no NaN"));
        used.truncate(most_walls);
        used.sort_unstable();
    }
    let mut list = Vec::new();
    for (anchor, of) in anchors.iter().enumerate() {
        for &first in &used {
            let mut sequences = vec![(vec![first], false)];
            for &second in used.iter().filter(|&&second| second != first && reflections == 2) {
                let is_either_order = are_at_right_angles(&told[first], &told[second]);
                if !is_either_order || first < second {
                    sequences.push((vec![first, second], is_either_order));
                }
            }
            for (walls, is_either_order) in sequences {
                let seen_share = share(of, &walls, is_either_order);
                if seen_share > T::of(0.02) {
                    list.push(Listed { anchor, walls, is_either_order, seen_share });
                }
            }
        }
    }
    let worth =
        |source: &Listed<T>| source.seen_share * T::of(if source.walls.len() == 2 { 0.5 } else { 1.0 });
    // Stable: equal ones stay in order.
    list.sort_by(|a, b| worth(b).partial_cmp(&worth(a)).expect("are no NaN"));
    list.truncate(most);
    list
}

/// Whether four deviations of their rotations explain what is missing to a right angle.
fn are_at_right_angles<T: Real>(a: &Wall<T>, b: &Wall<T>) -> bool {
    let [a_std, b_std] = [a, b].map(|wall| T::of(wall.told.rotation_std_rad));
    let explained = T::of(1e-3) + T::of(4.0) * sqrt(square(a_std) + square(b_std));
    let cosine = a.line.normal[0] * b.line.normal[0] + a.line.normal[1] * b.line.normal[1];
    abs(cosine) <= sin(smaller(explained, T::of(0.25) * tau()))
}

/// No more than 100 places, in rows and columns over the box of the outline, or of the walls.
fn places<T: Real>(plan: &FloorPlan<T>) -> Vec<[T; 2]> {
    let num = T::of;
    let Some([low, high]) = plan.box_m() else { return Vec::new() };
    let size = less(high, low);
    let columns =
        limited(sqrt(num(100.0) * (size[0] / size[1])) + num(0.5), T::ONE, num(100.0)).whole() as usize;
    let rows = 100 / columns;
    let mut places = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let share = |index, count| (T::of_count(index) + num(0.5)) / T::of_count(count);
            let place = [low[0] + size[0] * share(column, columns), low[1] + size[1] * share(row, rows)];
            if plan.is_inside(place) {
                places.push(place);
            }
        }
    }
    places
}
