//! The host side of cogmint: recordings, importers, the built-in room, the float reference and the plots.

pub mod bound;
pub mod channel;
pub mod demo;
pub mod floor_plan;
pub mod geometry;
pub mod import;
pub mod input_error;
pub mod plot;
pub mod recording;
pub mod reference;
pub mod replay;
pub mod room;
pub mod scenario;
pub mod score;
pub mod simulator;
mod toml_place;
pub mod trace;
pub mod track;
pub mod verify;
pub mod view;
