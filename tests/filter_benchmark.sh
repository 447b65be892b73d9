#!/usr/bin/env bash
# The state filter at full size (52 states, 26 ranges per step) beside the filters of other crates: time on the host,
# instructions and memory on a Cortex-M4F in QEMU. Prints a Markdown table.
#
#   bash tests/filter_benchmark.sh
#
# Exit code 0 only when all filters agree with the textbook's to a millimetre.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "filter_benchmark.sh: $*" >&2; }

source tests/target_toolchain.sh
build_for_target firmware-stub
build_for_target tests/peer/filters-on-target heap

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/core" "$work/peers"
cargo run --quiet --locked --release -p cogmint-tests --example full_filter -- published 60 "$work/core/feed.bin" >/dev/null
cp "$work/core/feed.bin" "$work/peers"
run "$work/core" "$PWD/firmware-stub/target/$target/release/filter"
run "$work/peers" "$PWD/tests/peer/filters-on-target/target/$target/release/cogmint-peer-filters-on-target"

columns=()
column() { columns+=("--$1" "$2=$3"); }
column instructions cogmint \
  "$(awk '$1 == "step" { sum += $5 + $6 + $7; steps++ } END { printf "%.0f", sum / steps }' "$work/core/target.txt")"
column memory cogmint "$(awk '$1 == "filter" { print $2 + $4 }' "$work/core/target.txt")"
while read -r _ name instructions bytes; do
  column instructions "$name" "$instructions"
  column memory "$name" "$bytes"
done < <(grep '^peer ' "$work/peers/target.txt")

# An option and its value for each of two figures of five filters.
if [ "${#columns[@]}" -ne 20 ]; then
  say "the target measured $((${#columns[@]} / 2)) of 10 figures"
  exit 1
fi
cargo bench --quiet --locked -p cogmint-tests --bench state_filter -- "${columns[@]}"
