//! What a recording leaves unknown: parameters and joint movements of parameters whose deviation it hardly lowers.

use super::Found;
use super::file::Calibration;
use nalgebra::DVector;

/// What keeps more than this share of its deviation is said to be unknown.
pub const LEFT: f64 = 0.7;
/// Two parameters that are correlated more than this are known together alone.
const TIED: f64 = 0.9;

pub(super) fn sentences(found: &Found<'_>, calibration: &Calibration) -> Vec<String> {
    let mut said = Vec::new();
    let prior = found.prior;
    let (size, anchors) = (prior.size(), prior.anchors_m.len());
    let heard: Vec<usize> = (0..anchors).filter(|anchor| found.counts[*anchor] > 0).collect();
    let unknown = |place: usize| found.std(place) > LEFT * prior.std(place);
    let names = |of: Vec<usize>| -> String {
        of.iter().map(|anchor| found.first.anchors[*anchor].name.as_str()).collect::<Vec<_>>().join(", ")
    };
    if !found.estimate.converged {
        said.push("The estimate did not come to rest: take nothing here for more than a guess.".into());
    }
    if heard.len() < anchors {
        let silent = (0..anchors).filter(|anchor| found.counts[*anchor] == 0).collect();
        said.push(format!("Nothing of {}: no range of theirs was heard in these cycles.", names(silent)));
    }
    let biases: Vec<usize> = heard.iter().copied().filter(|anchor| unknown(prior.bias(*anchor))).collect();
    if !biases.is_empty() {
        said.push(format!("The range bias of {}: the deviation told hardly falls.", names(biases)));
    }
    let mut direction = |what: &str, weights: DVector<f64>| {
        let (left_m, told_m) = (found.std_along(&weights), found.told_std_along(&weights));
        if told_m > 0.0 && left_m > LEFT * told_m {
            said.push(format!(
                "{what}: {:.0} % of the deviation told is left ({left_m:.3} of {told_m:.3} m).",
                100.0 * left_m / told_m
            ));
        }
    };
    let share = 1.0 / heard.len().max(1) as f64;
    let mut common = DVector::zeros(size);
    heard.iter().for_each(|anchor| common[prior.bias(*anchor)] = share);
    direction("A bias common to all anchors", common);
    if prior.anchor_std_m > 0.0 {
        for (axis, name) in ["x", "y"].into_iter().enumerate() {
            let mut shift = DVector::zeros(size);
            heard.iter().for_each(|anchor| shift[prior.coordinate(*anchor, axis)] = share);
            direction(&format!("A shift of all anchors along {name}"), shift);
        }
        let middle =
            |axis: usize| heard.iter().map(|anchor| prior.anchors_m[*anchor][axis]).sum::<f64>() * share;
        let middle_m = [middle(0), middle(1)];
        let arms_m: Vec<[f64; 2]> = heard
            .iter()
            .map(|anchor| [0, 1].map(|axis| prior.anchors_m[*anchor][axis] - middle_m[axis]))
            .collect();
        let size_m = arms_m.iter().map(|[x, y]| x * x + y * y).sum::<f64>().sqrt().max(1e-9);
        let mut turn = DVector::zeros(size);
        let mut growth = DVector::zeros(size);
        for (anchor, [x, y]) in heard.iter().zip(&arms_m) {
            turn[prior.coordinate(*anchor, 0)] = -y / size_m;
            turn[prior.coordinate(*anchor, 1)] = x / size_m;
            growth[prior.coordinate(*anchor, 0)] = x / size_m;
            growth[prior.coordinate(*anchor, 1)] = y / size_m;
        }
        direction("A turn of all anchors about their middle", turn);
        direction("A growth of all anchors' distances", growth);
        for anchor in &heard {
            let name = &found.first.anchors[*anchor].name;
            let axes: Vec<&str> = ["x", "y"]
                .into_iter()
                .enumerate()
                .filter(|(axis, _)| unknown(prior.coordinate(*anchor, *axis)))
                .map(|(_, name)| name)
                .collect();
            if !axes.is_empty() {
                let axes = axes.join(" and ");
                said.push(format!("The position of {name} along {axes}: the deviation told hardly falls."));
            }
            for (axis, axis_name) in ["x", "y"].into_iter().enumerate() {
                let (bias, coordinate) = (prior.bias(*anchor), prior.coordinate(*anchor, axis));
                let covariance = found.estimate.covariance[(bias, coordinate)];
                let correlation = covariance / (found.std(bias) * found.std(coordinate)).max(1e-12);
                if correlation.abs() > TIED {
                    said.push(format!(
                        "The bias of {name} apart from its {axis_name}: they are correlated by {correlation:.2}."
                    ));
                }
            }
        }
    } else {
        said.push("The positions of the anchors: they were told to be exact (--anchor-std-m 0).".into());
    }
    said.push("Heights of the anchors: they are taken as told.".into());
    said.push(
        "Which part of a bias is the anchor's delay and which the tag's: ranges have their sum.".into(),
    );
    if found.first.antennas.iter().any(|antenna| antenna.lever_arm_m.is_none()) {
        said.push(
            "Where antennas sit whose lever arm is not told: they are taken to be at the centre.".into(),
        );
    }
    if !calibration.errors.are_first_paths {
        said.push(
            "Excess and false ranges of the radio's own: what was calibrated from are the shortest of several ranges, or first \
             paths of frames."
                .into(),
        );
    }
    match &calibration.pulse {
        None if found.first.radio.sampled_pulse.is_some() => {
            said.push("The pulse: it is told sample by sample, and taken as told.".into());
        }
        None => said.push("The pulse: there are too few frames in which one path stands out.".into()),
        Some(pulse) => {
            if !pulse.is_shape_known() {
                said.push(
                    "The pulse's duration and roll-off well enough: rising edges fit several, and the tracker keeps what it was told."
                        .into(),
                );
            }
            if pulse.peak_offset_m.is_none() {
                said.push("The pulse's peak offset apart from the biases: the radio gives no ranges.".into());
            }
        }
    }
    said
}
