//! Puts the board's memory map where the linker finds it: `memory.x` of the repository's root, or the file that
//! `COGMINT_MEMORY` names, for boards with less or more.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    println!("cargo:rerun-if-env-changed=COGMINT_MEMORY");
    let memory = PathBuf::from(env::var_os("COGMINT_MEMORY").unwrap_or("../memory.x".into()));
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    if let Err(error) = fs::copy(&memory, out.join("memory.x")) {
        panic!("{}: {error}", memory.display());
    }
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rustc-link-arg=-Tlink.x");
    println!("cargo:rustc-link-arg=--nmagic");
    println!("cargo:rerun-if-changed={}", memory.display());
}
