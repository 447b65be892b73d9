//! The perceptor: from raw samples to the joint state of tag and virtual anchors.
//!
//! Data passes through the stages in this order, and each can be used alone:
//! [`channel_estimator`] finds the specular paths in a frame, [`gain_control`] what its powers are measured in,
//! [`acquisition`] finds out where the tag is while that is not known, [`overlap`] says how far paths disturb each other, [`association`] decides which path belongs to which virtual
//! anchor, [`manoeuvre`] notices when the tag turns, [`state_filter`] moves the estimate, [`loss`] notices when the tag is
//! elsewhere, and [`discovery`] looks for virtual anchors among the paths that were left over.

pub mod acquisition;
pub mod association;
pub mod channel_estimator;
pub mod discovery;
pub mod gain_control;
pub mod loss;
pub mod manoeuvre;
pub mod overlap;
pub mod state_filter;
