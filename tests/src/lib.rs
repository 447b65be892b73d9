//! What crosses crates: bit-exactness, golden traces, published claims, the command line, the target.
//!
//! The tests are in `tests/tests/`; here is what they share.

pub mod architecture;
pub mod estimator_fuzz;
pub mod full_filter;
pub mod full_plan;
pub mod mutation;
pub mod outcome;
#[path = "../../firmware-stub/src/bin/simulated_radio/room.rs"]
pub mod simulated_radio;

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

/// The workspace's root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// A folder of the recordings that nobody here made, which lie beside a checkout and not in it; says so and gives
/// `None` where they are not there.
pub fn shared_data(name: &str) -> Option<PathBuf> {
    let folder = root().join("../shared/data").join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: there is no {}", folder.display());
    None
}

/// Runs the `cogmint` command in a folder and waits for it.
pub fn cogmint(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().expect("starts")
}

/// The `cogmint` command in a folder.
pub fn command(folder: &Path, arguments: &[&str]) -> Command {
    static EXECUTABLE: OnceLock<PathBuf> = OnceLock::new();
    let mut command = Command::new(EXECUTABLE.get_or_init(built));
    command.args(arguments).current_dir(folder);
    command
}

/// Builds the `cogmint` command and says where it is.
///
/// Without `-p cogmint`, so that its dependencies have the features that they have in the tests, and are not compiled
/// for it once more.
fn built() -> PathBuf {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args([
        "build",
        "--quiet",
        "--release",
        "--bin",
        "cogmint",
        "--message-format=json-render-diagnostics",
    ]);
    let built = cargo.current_dir(root()).stderr(Stdio::inherit()).output().expect("cargo runs");
    assert!(built.status.success(), "cogmint is not built");
    let messages = serde_json::Deserializer::from_slice(&built.stdout).into_iter::<serde_json::Value>();
    let executable = messages.filter_map(|message| Some(message.ok()?["executable"].as_str()?.into())).last();
    executable.expect("cargo names the executable")
}

/// A folder of a test's own, removed in the end.
pub struct Folder(PathBuf);

impl Folder {
    /// Makes the folder; `name` must differ between tests.
    pub fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("cogmint-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).expect("a temporary folder");
        Self(path)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The guide to firmware, whose Rust is compiled with the documentation's tests.
#[cfg(doctest)]
#[doc = include_str!("../../docs/firmware.md")]
struct FirmwareGuide;
