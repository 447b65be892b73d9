//! Draws docs/architecture.svg from the core's modules.

use cogmint_tests::architecture::{draw, sources};
use std::path::Path;

fn main() -> std::io::Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    std::fs::write(root.join("docs/architecture.svg"), draw(&sources(&root.join("core/src"))?))
}
