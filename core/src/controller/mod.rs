//! The controller: which carrier to listen to next.
//!
//! A single-state value function J over the action library. [`reward`] turns entropies into a reward,
//! [`value`] learns from the action applied and from planned ones, [`planning`] predicts rewards with the
//! filter's own model and the channel memory, [`policy`] turns values into a choice.

pub mod library;
pub mod planning;
pub mod policy;
pub mod reward;
pub mod value;
