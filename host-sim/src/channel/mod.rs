//! From paths to samples.
