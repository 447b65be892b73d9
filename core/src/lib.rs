//! Cognitive, multipath-assisted UWB tracking in fixed memory.
//!
//! Indoors, a UWB pulse reaches a tag over the direct path and over wall reflections, each of which seems to come
//! from a *virtual anchor*: the anchor's mirror image in the wall. This crate turns reflections into extra anchors
//! and chooses the carrier of the next measurement so that it tells most about the position.
//!
//! # Layers
//!
//! - [`tracker::Tracker`]: the whole perception-action cycle in one call. For firmware that wants a position.
//! - [`perceptor`]: channel estimator, association, state filter, discovery. Each can be used alone.
//! - [`memory`], [`information`], [`controller`]: what is remembered, what a measurement tells, what to do next.
//! - [`application`], optional: where to go next.
//!
//! Every layer is public and documented. Input comes as [`model::observation`]s; [`config::Config`] is plain data. The
//! tracker checks everything it is given: bad input is an [`Error`] and changes nothing. The stages below it never
//! panic, but work on what they get: finite numbers within the ranges that [`config::Config`] documents.
//!
//! # Guarantees
//!
//! `no_std`, no heap, no `unsafe`, no panic. The same input gives the same bits on every machine: see [`real`] for
//! the arithmetic contract and [`trace`] for how it is checked.
//!
//! ```
//! use cogmint_core::radio::library::LIBRARY_PUBLISHED;
//! use cogmint_core::model::observation::{Observation, Range, RangeScan};
//! use cogmint_core::{Anchor, Config, Map, Tracker};
//!
//! let anchors = [
//!     Anchor { position_m: [0.5, 7.0], height_m: 0.0 },
//!     Anchor { position_m: [5.2, 3.2], height_m: 0.0 },
//! ];
//! let mut config = Config::default();
//! config.start.position_m = [3.0, 7.5];
//! // Room for 2 anchors, 24 surfaces, 24 sources, 32 segments of walls, 16 paths, 40 actions and 8 components of the
//! // belief; no points of residuals, as there are ranges alone; 6 candidates for virtual anchors; no plan is told.
//! let map = Map::default();
//! let mut tracker = Tracker::<2, 24, 24, 32, 16, 40, 8, 0, 6>::new();
//! tracker.start(&config, &anchors, &map, &LIBRARY_PUBLISHED, 1)?;
//! let ranges = [Range { range_m: 2.65, variance_m2: 1e-4 }];
//! let report = tracker.cycle(&[Observation::Ranges(RangeScan { anchor: 0, ranges: &ranges })], 0.1, None)?;
//! assert!(report.entropy_nat < report.predicted_entropy_nat);
//! # Ok::<(), cogmint_core::Error>(())
//! ```

#![no_std]
// Tests run on a host, where a panic is how a test fails.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing))]

#[cfg(test)]
extern crate std;

pub mod application;
pub mod config;
pub mod controller;
mod error;
pub mod information;
pub mod memory;
pub mod model;
pub mod observer;
pub mod perceptor;
pub mod radio;
pub mod real;
pub mod report;
pub mod snapshot;
pub mod trace;
pub mod tracker;

// Its example is compiled with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

/// The vectors and matrices of public fields and functions: the report's covariances, the state of filter and belief, images, information,
/// planning. Take them from here: they are then the ones that this crate was built with. nalgebra 0.35, without `std`; another minor version of
/// it is another minor version of this crate (a major one from 1.0 on).
pub use nalgebra;

pub use config::{Config, Variant};
pub use error::{Error, Setting};
pub use model::anchor::{Anchor, MappedVirtualAnchor};
pub use model::plan::{Map, Plan, PlanSegment, PlanWall};
pub use model::transceiver::Transceiver;
pub use report::{CycleReport, Integrity, Part, Parts, WallEstimate};
pub use snapshot::SnapshotError;
pub use tracker::map::MapRestored;
pub use tracker::over_radio::CycleError;
pub use tracker::{RangeTracker, Tracker};
