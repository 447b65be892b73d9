#!/usr/bin/env bash
# Installs what the tests need and runs all of them: formatting, lints, documentation, host tests in release and debug,
# cross-build and target. Says at the end how long each step took.
#
# The steps share what they compile: everything but the step without optimisation is in release, and no step selects
# packages whose dependencies have other features than in the workspace's tests (`cargo build -p cogmint` would).
set -euo pipefail
export LC_ALL=C
cd "$(dirname "$0")/.."

name= rows=() begin_s=0 begin_cpu_s=0 cpu_s=0

# User and system time of all that this shell has waited for. Not in a subshell, whose count begins anew.
count_cpu() {
  times >"$clock"
  cpu_s=$(awk 'NR == 2 { split($1 "s" $2, t, /[ms]+/); print 60 * (t[1] + t[3]) + t[2] + t[4] }' "$clock")
}

row() { printf '%-36s %8d %8.1f' "$1" "$2" "$(awk "BEGIN { print $3 }")"; }

end_step() {
  [ -n "$name" ] || return 0
  count_cpu
  rows+=("$(row "$name" $((SECONDS - begin_s)) "$cpu_s - $begin_cpu_s")")
  name=
}

step() {
  end_step
  printf '\n== %s\n' "$*"
  name=$* begin_s=$SECONDS begin_cpu_s=$cpu_s
}

report() {
  [ "$1" = 0 ] || name="$name (failed)"
  end_step
  printf '\n%-36s %8s %8s\n' step 'wall s' 'CPU s'
  printf '%s\n' "${rows[@]}"
  row 'all' "$SECONDS" "$cpu_s"
  echo
  rm -f "$clock"
}

command -v cargo >/dev/null || { echo "all.sh: needs Rust: see https://rustup.rs" >&2; exit 1; }
clock=$(mktemp)
trap 'report $?' EXIT

step "formatting"
cargo fmt --all --check
(cd firmware-stub && cargo fmt --check)
(cd c && cargo fmt --check)
(cd c/header && cargo fmt --check)
(cd tests/peer/filters-on-target && cargo fmt --check)

step "lints"
cargo clippy --locked --workspace --all-targets --release -- -D warnings
(cd c && cargo clippy --locked --all-targets -- -D warnings)

step "documentation"
RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps --quiet --release

step "compilation of the host tests"
# The command is built first: tests that run it must not wait for each other's builds.
cargo build --locked --release --bin cogmint
cargo test --locked --workspace --release --no-run

step "host tests"
cargo test --locked --workspace --release

step "the same bits without optimisation"
cargo test --locked -p cogmint-core -p cogmint-tests --lib --test golden
cargo test --locked -p cogmint-core -p cogmint-tests --doc

step "examples, and every choice of features"
bash tests/examples.sh

step "target, and every budget"
bash tests/budgets.sh

step "the C interface"
bash tests/c_interface.sh

step "the state filter beside others"
bash tests/filter_benchmark.sh
