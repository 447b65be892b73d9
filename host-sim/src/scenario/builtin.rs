//! The scenarios that the command carries.

/// A scenario that the command carries.
#[derive(Clone, Copy, Debug)]
pub struct BuiltIn {
    /// Its name on the command line.
    pub name: &'static str,
    /// The text of its file.
    pub text: &'static str,
}

/// All of them.
pub const BUILT_IN: [BuiltIn; 0] = [];
