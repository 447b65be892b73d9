#!/usr/bin/env bash
# Installs what the tests need and runs all of them: formatting, lints, documentation, host tests in release and debug,
# cross-build and target.
set -euo pipefail
cd "$(dirname "$0")/.."

step() { printf '\n== %s\n' "$*"; }

command -v cargo >/dev/null || { echo "all.sh: needs Rust: see https://rustup.rs" >&2; exit 1; }

step "formatting"
cargo fmt --all --check
(cd firmware-stub && cargo fmt --check)
(cd tests/peer/filters-on-target && cargo fmt --check)

step "lints"
cargo clippy --locked --workspace --all-targets --release -- -D warnings

step "documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps --quiet

step "host tests"
# The command is built first: tests that run it must not wait for each other's builds.
cargo build --locked --release -p cogmint
cargo test --locked --workspace --release

step "the same bits without optimisation"
cargo test --locked -p cogmint-core
cargo test --locked -p cogmint-tests --test golden

step "target, and every budget"
bash tests/budgets.sh
