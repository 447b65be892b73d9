//! The scenarios that the command carries.

/// A scenario that the command carries.
#[derive(Clone, Copy, Debug)]
pub struct BuiltIn {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it is, in a line.
    pub summary: &'static str,
    /// The text of its file.
    pub text: &'static str,
}

/// All of them.
pub const BUILT_IN: [BuiltIn; 6] = [
    BuiltIn {
        name: "seminar-room",
        summary: "the published room: two anchors, a sounder, five ways of 1000 positions",
        text: include_str!("../../scenarios/seminar-room.toml"),
    },
    BuiltIn {
        name: "seminar-room-data",
        summary: "the same room as in the authors' data: second anchor elsewhere, 1001 positions",
        text: include_str!("../../scenarios/seminar-room-data.toml"),
    },
    BuiltIn {
        name: "single-anchor",
        summary: "one anchor in a room with an alcove, its floor plan known",
        text: include_str!("../../scenarios/single-anchor.toml"),
    },
    BuiltIn {
        name: "corridor",
        summary: "2 m by 25 m with recessed doors, two anchors, someone walking",
        text: include_str!("../../scenarios/corridor.toml"),
    },
    BuiltIn {
        name: "l-shaped-office",
        summary: "around a corner: partitions, a glass front, a second person",
        text: include_str!("../../scenarios/l-shaped-office.toml"),
    },
    BuiltIn {
        name: "dw3000-office",
        summary: "four DW3000 anchors under the ceiling, channels 5 and 9, a walk at 10 Hz",
        text: include_str!("../../scenarios/dw3000-office.toml"),
    },
];
