#!/usr/bin/env bash
# Runs the core's examples on the host, builds them for the target, and checks the core with every choice of its features on both.
#
#   bash tests/examples.sh
#
# Exit code 0 only when every example holds what it asserts, all of it builds without a warning, and the table of sizes in
# docs/firmware.md is the one that the target's build asserts.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "examples.sh: $*" >&2; }

source tests/target_toolchain.sh

# Features that can be chosen, as the manifest lists them.
mapfile -t features < <(awk '/^\[/ { on = $0 == "[features]" } on && /^[a-z0-9_-]+ *=/ { print $1 }' core/Cargo.toml)
[ ${#features[@]} -gt 0 ] || { say "no features found in core/Cargo.toml"; exit 1; }

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for source in core/examples/*.rs; do
  example=$(basename "$source" .rs)
  printf '%s: ' "$example"
  cargo run --quiet --locked --release -p cogmint-core --example "$example" | tee "$work/$example.txt"
done

# Figures of this machine are not in the guide.
while IFS='|' read -r _ of bytes _; do
  grep -qF "|$of|$bytes|" docs/firmware.md || { say "docs/firmware.md lacks the row |$of|$bytes|"; exit 1; }
done < <(tail -n +3 "$work/sizes.txt")

# The examples have no start on the target: all of their code is kept and linked, from address 0.
say "the examples on $target"
(
  export CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS="-C link-args=--no-gc-sections -C link-args=--entry=0 -D warnings"
  cargo_for_target core build --release -p cogmint-core --examples
)

check() {
  say "the core with ${*:-no features}"
  RUSTFLAGS="-D warnings" cargo check --quiet --locked -p cogmint-core --no-default-features "$@"
  RUSTFLAGS="-D warnings" cargo_for_target core check -p cogmint-core --no-default-features "$@"
}
check
for feature in "${features[@]}"; do check --features "$feature"; done
check --all-features
