//! The float reference: the whole cycle once more, written for reading.
//!
//! The core is written for a microcontroller: fixed memory, no panic, blocks of matrices, iterators. This twin does
//! the same with vectors on the heap, plain loops and textbook matrices. A newcomer reads it first, one file per
//! stage, in the order of a cycle:
//!
//! | file | stage |
//! | --- | --- |
//! | [`real`] | the number type: `f32` or `f64` |
//! | [`range`], [`motion`], [`clock`], [`soft_update`] | what every estimate of the tag, and every memory, uses |
//! | [`pulse`], [`channel_estimator`], [`gain_control`], [`receiver`] | frames to paths, paths to scans |
//! | [`plan`], [`image`], [`availability`], [`listing`] | walls, images in them, what can be seen from where |
//! | [`belief`], [`acquisition`], [`loss`], [`manoeuvre`] | whether it is known where the tag is, and where it may be |
//! | [`known`], [`overlap`] | what a scan is expected to show |
//! | [`association`] | paths to features |
//! | [`state_filter`] | tag and virtual anchors |
//! | [`remember`], [`environment`], [`channel_memory`], [`clutter`] | what is remembered |
//! | [`map`], [`discovery`] | virtual anchors no plan told of, and those that are none |
//! | [`information`], [`controller`], [`controllers`] | what a measurement tells, and what to do next |
//! | [`cycle`] | all of it, in order |
//!
//! It shares data types with the core (configuration, observations, actions), but none of its algorithms. Run in
//! `f32` it gives the core's bits, because every number is formed by the same operations in the same order: where an
//! order is a choice, a comment that starts with "Order:" says so. Run in `f64` on the same constants (those the core
//! writes as `f32` stay what `f32` makes of them) it tells how rounding errors grow. [`crate::verify`] does both.
//!
//! Input is taken as the core accepts it; what the core refuses must not be given to the reference.

// The point of this module is to read like the equations: sums over indices.
#![allow(clippy::needless_range_loop)]

pub mod acquisition;
pub mod association;
pub mod availability;
pub mod belief;
pub mod channel_estimator;
pub mod channel_memory;
pub mod clock;
pub mod clutter;
pub mod controller;
pub mod controllers;
pub mod cycle;
pub mod discovery;
pub mod environment;
pub mod gain_control;
pub mod image;
pub mod information;
pub mod known;
pub mod listing;
pub mod loss;
pub mod manoeuvre;
pub mod map;
pub mod motion;
pub mod overlap;
pub mod plan;
pub mod pulse;
pub mod range;
pub mod real;
pub mod receiver;
pub mod remember;
pub mod soft_update;
pub mod state_filter;

pub use cycle::{Capacity, Reference};
pub use real::Real;

/// A symmetric matrix of any size, or any other: rows of entries.
pub type Matrix<T> = Vec<Vec<T>>;

/// A matrix of zeros.
pub fn zeros<T: Real>(rows: usize, columns: usize) -> Matrix<T> {
    vec![vec![T::ZERO; columns]; rows]
}
