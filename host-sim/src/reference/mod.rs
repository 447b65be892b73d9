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
//! | [`belief`], `proposal` | where the tag may be, in components |
//! | [`plan`], [`surface`], [`image`], [`listing`], [`start`] | what is told before the start |
//! | [`known`], [`availability`], [`overlap`] | what a scan is expected to show |
//! | [`association`] | paths to features |
//! | [`state_filter`] | tag and surfaces |
//! | [`remember`], [`environment`], [`transmission`], [`channel_memory`], [`clutter`] | what is remembered |
//! | [`map`], [`discovery`], [`joining`] | virtual anchors no plan told of, those that are none, and the walls they are seen in |
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

pub mod association;
pub mod availability;
pub mod belief;
pub mod below_threshold;
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
pub mod joining;
pub mod known;
pub mod lateness;
pub mod listing;
pub mod map;
pub mod motion;
mod outage;
pub mod overlap;
pub mod plan;
mod proposal;
pub mod pulse;
pub mod range;
pub mod real;
pub mod receiver;
pub mod region;
pub mod remember;
pub mod soft_update;
pub mod start;
pub mod state_filter;
pub mod surface;
pub mod transmission;
mod work;

pub use cycle::{Capacity, Reference};
pub use real::Real;

/// A symmetric matrix of any size, or any other: rows of entries.
pub type Matrix<T> = Vec<Vec<T>>;

/// A 2 by 2 matrix: rows of entries.
pub type Square<T> = [[T; 2]; 2];

/// A matrix of zeros.
pub fn zeros<T: Real>(rows: usize, columns: usize) -> Matrix<T> {
    vec![vec![T::ZERO; columns]; rows]
}

/// A B.
pub fn product<T: Real>(a: &Square<T>, b: &Square<T>) -> Square<T> {
    let mut c = [[T::ZERO; 2]; 2];
    for row in 0..2 {
        for column in 0..2 {
            c[row][column] = a[row][0] * b[0][column] + a[row][1] * b[1][column];
        }
    }
    c
}

/// M'.
pub fn transposed<T: Real>(m: &Square<T>) -> Square<T> {
    [[m[0][0], m[1][0]], [m[0][1], m[1][1]]]
}
