#!/usr/bin/env bash
# The tracker in a closed loop on a Cortex-M4F (thumbv7em-none-eabihf) in QEMU: over a simulated radio that reacts to the channel that the
# tracker chooses, beside the same radio on the host.
#
#   bash tests/radio_on_target.sh
#
# Exit code 0 only when every cycle has the same hash and the same actions on both; when a radio that ignores its tuning gives others from
# the cycle on in which the tracker leaves the jammed channel, on both alike; and when one whose bus fails in a cycle is reported and
# costs nothing else.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "radio_on_target.sh: $*" >&2; }
fail() { say "$*"; exit 1; }

source tests/target_toolchain.sh
build_for_target firmware-stub "" simulated_radio
image=$PWD/firmware-stub/target/$target/release/simulated_radio

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Both, of a defect: its kind and its cycle, below 256. The files host-KIND.txt and target-KIND.txt.
both() {
  printf 'COGX\x'"$(printf %02x "$1")"'\0\0\0\x'"$(printf %02x "$2")"'\0\0\0' >"$work/feed.bin"
  run "$work" "$image"
  mv "$work/target.txt" "$work/target-$1.txt"
  cargo run --quiet --locked --release -p cogmint-tests --example simulated_radio -- "$1" "$2" \
    >"$work/host-$1.txt"
  cmp "$work/host-$1.txt" "$work/target-$1.txt" || fail "defect $1: host and target differ"
}

both 0 0
cycles=$(grep -c '^cycle ' "$work/target-0.txt")
[ "$cycles" = 90 ] && [ "$(wc -l <"$work/target-0.txt")" = 90 ] || fail "$cycles cycles instead of 90"
grep -q 'action 0' "$work/target-0.txt" && grep -q 'action 1' "$work/target-0.txt" || fail "the channel was never changed"

both 1 0
first=$(cmp "$work/host-0.txt" "$work/target-1.txt" | sed 's/.*line //') || true
left=$(grep -n -m1 'action 1' "$work/host-0.txt" | cut -d: -f1)
[ -n "$first" ] && [ "$first" = "$left" ] || fail "a radio that ignores its tuning is first seen in line ${first:-none}, not $left"

both 2 37
grep -qx 'the radio failed in cycle 37' "$work/target-2.txt" || fail "a bus that fails is not reported"
grep '^cycle ' "$work/target-2.txt" | cmp - "$work/target-0.txt" || fail "a bus that failed once changed more than its call"

# From the first jammed cycle on.
rmse_mm() { awk '/^cycle/ && $2 >= 30 { sum += $(NF - 1) ^ 2; count++ } END { printf "%d", sqrt(sum / count) }' "$1"; }
say "$(rmse_mm "$work/target-0.txt") mm off under interference (RMSE), $(rmse_mm "$work/target-1.txt") mm where the radio ignores its tuning"
say "$cycles of $cycles cycles over a simulated radio have the host's hashes; what is wrong with it shows"
