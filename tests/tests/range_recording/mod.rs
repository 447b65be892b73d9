//! Recordings of ranges alone that tests make themselves.

use cogmint::recording::{Action, Anchor, AssociationModel, Cycle, Motion, Radio, Recording, Start};

/// A recording of a tag that starts about the origin, seen from these anchors (position and height, metres); the rest is for the test
/// to say.
pub fn recording_of_ranges(
    name: String,
    anchors: impl IntoIterator<Item = ([f64; 2], f64)>,
    motion: Motion,
    cycles: Vec<Cycle>,
) -> Recording {
    let anchor = |(n, (position_m, height_m))| Anchor::new(format!("anchor {n}"), position_m, height_m);
    Recording {
        name,
        source: String::new(),
        motion,
        start: Start {
            position_m: [0.0, 0.0],
            position_std_m: 1.0,
            velocity_std_m_s: 0.3,
            disc_radius_m: None,
            drawn_about_m: None,
        },
        association: AssociationModel {
            detection_probability: 0.95,
            clutter_per_anchor: 0.05,
            max_range_m: 30.0,
        },
        radio: Radio {
            pulse_duration_s: 2e-9,
            roll_off: 0.5,
            sampled_pulse: None,
            sample_spacing_s: None,
            gain_control: false,
            begins_with_path: false,
            range_std_m: 0.3,
            range_bias_mean_m: 0.0,
            range_bias_std_m: 0.0,
            range_late_m: 0.0,
            range_floor_pulses: None,
        },
        anchors: anchors.into_iter().enumerate().map(anchor).collect(),
        virtual_anchors: Vec::new(),
        walls: Vec::new(),
        plan: None,
        antennas: Vec::new(),
        actions: vec![Action { carrier_hz: 4e9, pulse_duration_s: 2e-9 }],
        cycles,
    }
}
