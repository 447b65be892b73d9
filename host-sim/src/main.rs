//! The `cogmint` command.
fn main() {}
