#!/usr/bin/env bash
# Runs the core on a Cortex-M4F (thumbv7em-none-eabihf) in QEMU over recorded frames and compares every cycle's hash
# with the host's: of the seminar room told by its walls, where no recording is given.
#
#   bash tests/on_target.sh [--json] [--cycles N] [--recording DIR]
#
# Beside that, the channel estimator alone over frames of eight paths: instructions, state and scratch; and the state
# filter alone with 26 ranges per step, of 24 virtual anchors as published and of 24 images in 8 walls; images and availability
# alone, 24 sources over 8 walls; planning alone, 20 actions over one and five cycles; and three smaller trackers, of four DW3000 anchors,
# of one, and of the ranges of three alone: what they take of RAM and of flash.
# Then tests/radio_on_target.sh, the tracker over a radio that does what it is told, and tests/target_meters.sh: the firmware's meters must
# fail where they cannot measure.
#
# Exit code 0 only when all hashes are equal, no panic symbol is linked, the state filter and planning are within their
# budgets, no stack is used up and every planted failure of the meters is reported.
set -euo pipefail
here=$PWD
cd "$(dirname "$0")/.."

cycles=60
json=
recording=()
while [ $# -gt 0 ]; do
  case $1 in
    --json) json=--json ;;
    --cycles | --recording)
      [ $# -gt 1 ] || { echo "on_target.sh: $1 needs a value" >&2; exit 2; }
      if [ "$1" = --cycles ]; then
        cycles=$2
      else
        # Relative to the caller's folder.
        recording=(--recording "$(cd "$here" && realpath -m -- "$2")")
      fi
      shift
      ;;
    *) echo "on_target.sh: unknown option $1 (known: --json, --cycles N, --recording DIR)" >&2; exit 2 ;;
  esac
  shift
done

say() { echo "on_target.sh: $*" >&2; }

source tests/target_toolchain.sh

build_for_target firmware-stub
images=$PWD/firmware-stub/target/$target/release
image=$images/cogmint-firmware

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
if [ ${#recording[@]} = 0 ]; then
  record_room "$cycles" "$work/room"
  recording=(--recording "$work/room")
fi
cargo run --quiet --locked --release -- \
  trace "${recording[@]}" --cycles "$cycles" --feed "$work/feed.bin" >"$work/host.txt"

mkdir "$work/eight"
cogmint=(cargo run --quiet --locked --release --)
"${cogmint[@]}" experiment eight-paths --frames 200 --out "$work/eight/frames"
"${cogmint[@]}" trace --recording "$work/eight/frames" --cycles 200 --feed "$work/eight/feed.bin" >/dev/null

# The state filter at full size, 26 ranges per step: 52 states as published, 20 with walls.
for form in published walls; do
  mkdir "$work/$form"
  cargo run --quiet --locked --release -p cogmint-tests --example full_filter -- $form 60 "$work/$form/feed.bin" \
    >"$work/$form/host.txt"
done
mkdir "$work/availability"

# Planning at full size: 20 actions, 26 sources.
mkdir "$work/plan"
cargo run --quiet --locked --release -p cogmint-tests --example full_plan -- "$work/plan/feed.bin" >"$work/plan/host.txt"

# The office as it is, with one of its anchors, and with the distances of three in place of frames.
mkdir "$work/four" "$work/one" "$work/ranges"
record_office 4 100 "$work/four/room"
record_office 1 100 "$work/one/room"
record_office 3 100 "$work/ranges/room"
sized() {
  cargo run --quiet --locked --release -p cogmint-tests --example sized_trace -- \
    "$1" "$work/$2/room" "$work/$2/feed.bin" >"$work/$2/host.txt"
  run "$work/$2" "$images/$1"
}
sized four_anchors four
sized one_anchor one
sized ranges_only ranges
# Snapshots: one of the host's goes on here, and one of the target's on the host. With room for the bytes beside the tracker.
mkdir "$work/snapshots"
ln -s "$work/feed.bin" "$work/snapshots/feed.bin"
sed 's/\(RAM.*LENGTH = \).*/\1256K/' memory.x >"$work/memory.x"
snapshots=(cargo run --quiet --locked --release -p cogmint-tests --example snapshots --
  "${recording[1]}" "$cycles" "$work/snapshots/host.bin" "$work/snapshots/snapshot.bin")
tail -n +$((cycles / 2 + 1)) "$work/host.txt" >"$work/snapshots/expected.txt"
COGMINT_MEMORY=$work/memory.x build_for_target firmware-stub "" snapshots
run "$work/snapshots" "$images/snapshots"
grep -v '^snapshot ' "$work/snapshots/target.txt" | cmp - "$work/snapshots/expected.txt"
"${snapshots[@]}" | cmp - "$work/snapshots/expected.txt"
cp "$work/snapshots/host.bin" "$work/snapshots/restore.bin"
run "$work/snapshots" "$images/snapshots"
cmp "$work/snapshots/target.txt" "$work/snapshots/expected.txt"
say "a snapshot of the target's goes on on the host, and one of the host's on the target, to the same hash"
build_for_target firmware-stub

run "$work" "$image"
run "$work/eight" "$images/estimator"
run "$work/published" "$images/filter"
run "$work/walls" "$images/filter"
run "$work/availability" "$images/availability"
run "$work/plan" "$images/planning"

cargo run --quiet --locked --release -p cogmint-tests --example target_report -- \
  --target "$target" --image "$image" --host "$work/host.txt" --log "$work/target.txt" \
  --estimator-log "$work/eight/target.txt" \
  --filter-host "$work/published/host.txt" --filter-log "$work/published/target.txt" \
  --walls-host "$work/walls/host.txt" --walls-log "$work/walls/target.txt" \
  --availability-log "$work/availability/target.txt" \
  --plan-host "$work/plan/host.txt" --plan-log "$work/plan/target.txt" \
  --four-image "$images/four_anchors" --four-host "$work/four/host.txt" --four-log "$work/four/target.txt" \
  --one-image "$images/one_anchor" --one-host "$work/one/host.txt" --one-log "$work/one/target.txt" \
  --ranges-image "$images/ranges_only" --ranges-host "$work/ranges/host.txt" --ranges-log "$work/ranges/target.txt" $json

bash tests/radio_on_target.sh
bash tests/target_meters.sh
