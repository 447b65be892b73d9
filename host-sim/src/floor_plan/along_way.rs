//! The virtual anchors of the published experiments: those that the true way sees best, each with an error of its own.
//!
//! Every image that some position of the trajectory sees is a virtual anchor of the recording. The tracker is told of
//! the strongest: their mean SINR over the whole way counts, zero where they are not seen. With a plan that differs
//! from the room, it is told of the plan's images instead, which are matched to the room's where they are close; those
//! below -30 dB in the mean are left out, so that a wall which swallows all is one that the plan lacks.
//!
//! Nobody has that list outside a simulation; and a real plan is wrong by wall, so that images err together.

use crate::channel::Channel;
use crate::channel::random::{Purpose, normal, stream};
use crate::geometry::distance_m;
use crate::geometry::image_source::ImageSource;
use crate::input_error::InputError;
use crate::recording::VirtualAnchor;
use crate::scenario::Scenario;
use rayon::prelude::*;
use std::collections::BTreeSet;

use super::{FloorPlan, MATCH_M};

/// Positions at which strength is looked at, at most.
const LOOKS: usize = 250;
/// An image of a wrong plan that is fainter in the mean is none: so a plan can lack a wall, by one that swallows all.
const FAINTEST_SINR: f64 = 1e-3;

/// An image with its mean SINR over the way.
struct Strength {
    anchor: usize,
    image: usize,
    mean_sinr: f64,
}

/// The virtual anchors of a channel's recordings.
///
/// # Errors
/// The floor plan's room names something unknown.
pub fn of(channel: &Channel) -> Result<FloorPlan, InputError> {
    let scenario = channel.scenario();
    let visible = strengths(channel);
    let mut listed = Vec::new();
    let mut index_of: Vec<Vec<Option<usize>>> =
        (0..scenario.anchors.len()).map(|anchor| vec![None; channel.images(anchor).len()]).collect();
    for strength in &visible {
        index_of[strength.anchor][strength.image] = Some(listed.len());
        let image = &channel.images(strength.anchor)[strength.image];
        listed.push(VirtualAnchor::new(strength.anchor, image.position_m, 0.0, false));
    }
    let plan = &scenario.prior.floor_plan;
    if !plan.known {
        return Ok(FloorPlan { virtual_anchors: listed, index_of, plan: None });
    }
    match &plan.room {
        None => {
            let mut order: Vec<usize> = (0..visible.len()).collect();
            order.sort_by(|&a, &b| visible[b].mean_sinr.total_cmp(&visible[a].mean_sinr));
            for &index in order.iter().take(plan.max_virtual_anchors) {
                let Strength { anchor, image, .. } = visible[index];
                tell(channel, &mut listed[index], &channel.images(anchor)[image], image);
            }
        }
        Some(room) => {
            let believed = Scenario { room: room.clone(), interference: Vec::new(), ..scenario.clone() };
            let believed = Channel::along(&believed, channel.poses().to_vec(), channel.seed())?;
            let mut strong = strengths(&believed);
            strong.retain(|strength| strength.mean_sinr > FAINTEST_SINR);
            strong.sort_by(|a, b| b.mean_sinr.total_cmp(&a.mean_sinr));
            for Strength { anchor, image, .. } in strong.into_iter().take(plan.max_virtual_anchors) {
                let told = &believed.images(anchor)[image];
                let close = |(index, of): &(usize, &Strength)| {
                    let real = &channel.images(of.anchor)[of.image];
                    of.anchor == anchor
                        && real.order == told.order
                        && !listed[*index].known
                        && distance_m(real.position_m, told.position_m) < MATCH_M
                };
                let distance = |of: &Strength| {
                    distance_m(channel.images(of.anchor)[of.image].position_m, told.position_m)
                };
                let nearest = visible
                    .iter()
                    .enumerate()
                    .filter(close)
                    .min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)))
                    .map(|(index, _)| index);
                let index = nearest.unwrap_or_else(|| {
                    let phantom = VirtualAnchor::new(anchor, told.position_m, 0.0, false);
                    listed.push(VirtualAnchor { exists: false, ..phantom });
                    listed.len() - 1
                });
                tell(channel, &mut listed[index], told, image);
            }
        }
    }
    Ok(FloorPlan { virtual_anchors: listed, index_of, plan: None })
}

/// Makes a virtual anchor known, with the plan's error, if it has one, on top of where the plan has it.
fn tell(channel: &Channel, virtual_anchor: &mut VirtualAnchor, image: &ImageSource, index: usize) {
    let plan = &channel.scenario().prior.floor_plan;
    let std_m = if image.order <= 1 { plan.first_order_std_m } else { plan.higher_order_std_m };
    let error_m = if plan.exact { 0.0 } else { std_m };
    let mut rng = stream(channel.seed(), Purpose::FloorPlan, &[virtual_anchor.anchor, index]);
    virtual_anchor.known = true;
    virtual_anchor.std_m = std_m;
    virtual_anchor.told_position_m = Some(image.position_m.map(|x| x + error_m * normal(&mut rng)));
}

/// All images that some position of the way sees, with their mean SINR at the first action.
fn strengths(channel: &Channel) -> Vec<Strength> {
    let action = channel.receiver().first_action;
    let cycles = channel.poses().len();
    let step = cycles.div_ceil(LOOKS).max(1);
    let looks: Vec<usize> = (0..cycles).step_by(step).collect();
    let mut strengths = Vec::new();
    for anchor in 0..channel.scenario().anchors.len() {
        let seen: Vec<_> = looks.par_iter().map(|&cycle| channel.components(cycle, anchor, action)).collect();
        let mut sums = vec![0.0; channel.images(anchor).len()];
        for component in seen.iter().flatten() {
            sums[component.source] += component.sinr;
        }
        // A short glimpse between two looks makes an image visible as well.
        let visible = self::seen(channel, anchor);
        let looks = looks.len() as f64;
        strengths.extend(visible.into_iter().map(|image| Strength {
            anchor,
            image,
            mean_sinr: sums[image] / looks,
        }));
    }
    strengths
}

/// The images of an anchor that some position of the way sees, by index; the anchor itself is none.
pub(super) fn seen(channel: &Channel, anchor: usize) -> BTreeSet<usize> {
    (0..channel.poses().len())
        .into_par_iter()
        .flat_map_iter(|cycle| channel.paths(cycle, anchor).into_iter().map(|path| path.source()))
        .filter(|&source| source > 0)
        .collect()
}
