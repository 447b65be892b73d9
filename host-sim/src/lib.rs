//! The host side of cogmint: scenarios and the channel simulator, recordings and importers, the float reference, scores
//! and figures.

pub mod bound;
pub mod calibrate;
pub mod channel;
pub mod cycle_choice;
pub mod demo;
pub mod estimate;
pub mod estimate_table;
pub mod experiment;
pub mod floor_plan;
pub mod geometry;
pub mod import;
pub mod input_error;
pub mod plot;
pub mod recording;
pub mod reference;
pub mod replay;
pub mod rooms;
pub mod scenario;
pub mod score;
pub mod simulator;
pub mod thin;
pub mod told_plan;
mod toml_place;
pub mod trace;
pub mod track;
pub mod trackers;
pub mod verify;
pub mod view;
pub mod whole_file;
