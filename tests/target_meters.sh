#!/usr/bin/env bash
# Whether the firmware's meters fail where they must: on loops and stacks of known size, on a counter that wraps, on the
# tracker's image linked for a board with too little RAM, and on a program with a reachable panic.
#
#   bash tests/target_meters.sh
#
# Exit code 0 only when every figure is right and every planted failure is reported.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "target_meters.sh: $*" >&2; }
fail() { say "$*"; exit 1; }

source tests/target_toolchain.sh
build_for_target firmware-stub
images=$PWD/firmware-stub/target/$target/release

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# A 32-bit little-endian word.
word() { for shift in 0 8 16 24; do printf "\\x$(printf %02x $(($1 >> shift & 255)))"; done; }

# What the meters' own image says to: what to do, how much of it.
meters() {
  { printf COGX; word "$1"; word "$2"; } >"$work/feed.bin"
  run "$work" "$images/meters" 2>/dev/null
}

expect_error() { grep -q "^error $1" "$work/target.txt" || fail "$2: $(cat "$work/target.txt")"; }

# Between two values, inclusive.
expect_between() { [ "$1" -ge "$2" ] && [ "$1" -le "$3" ] || fail "$4: $1 is not within $2 to $3"; }

# 800 million instructions: more than a counter of 24 bits at 40 instructions per tick holds.
turns=400000000
meters 0 $turns
expect_between "$(awk '$1 == "counted" { print $2 }' "$work/target.txt")" $((2 * turns - 200)) $((2 * turns + 200)) \
  "a long loop is counted wrongly"
# A counter of a million ticks, 40 million instructions.
meters 1 19000000
expect_between "$(awk '$1 == "ticks" { print $2 }' "$work/target.txt")" 949990 950010 "ticks are counted wrongly"
meters 1 21000000
expect_error "the instruction counter wrapped" "a wrapped counter is not reported"

# How deep the stack goes, by the stack pointer in the deepest frame and by the paint.
dig() {
  meters 2 "$1"
  read -r pointer deepest < <(awk '{ print $2 }' "$work/target.txt" | xargs)
  expect_between "$deepest" "$pointer" $((pointer + 64)) "the stack's depth is wrong"
}
dig 25600
hundred=$pointer
dig 51200
frame=$(((pointer - hundred) / 100))
# Into the guard, by half of it; then out of the memory.
ram=$((128 * 1024))
meters 2 $((51200 + (ram - 512 - pointer) / frame * 256))
expect_error "the stack is used up" "a stack that reaches the static variables is not reported"
meters 2 $((2 * ram))
expect_error "hard fault" "a stack that leaves the memory is not reported"

# The static tracker is all zeros: it takes no flash.
readelf --sections --wide "$images/cogmint-firmware" >"$work/sections"
awk '$2 == ".data" || $3 == ".data" { for (n = 1; n < NF; n++) if ($n == "PROGBITS") exit $(n + 3) != "000000" }' \
  "$work/sections" || fail "static variables have values in flash: $(cat "$work/sections")"

# The tracker's image on boards with more RAM than the figure, by 1 KiB, which the guard takes; and with less: by one step of the
# guard below that, by 1 KiB below the figure, and by a sixth.
record_room 3 "$work/room"
cargo run --quiet --locked --release -- trace --recording "$work/room" --feed "$work/feed.bin" >/dev/null
run "$work" "$images/cogmint-firmware"
stack=$(awk '$1 == "stack" { print $2 }' "$work/target.txt")
[ -n "$stack" ] || fail "the tracker did not come to its end: $(cat "$work/target.txt")"
ends=$(readelf --symbols --wide "$images/cogmint-firmware" | awk '$8 == "_stack_end" { print $2 }')
guard=1024
needed=$(((0x$ends - 0x20000000 + stack + guard + 7) / 8 * 8))
# As much as is needed is enough.
for change in 0 -8 -2048 -16384; do
  sed "s/\(RAM.*LENGTH = \).*/\1$((needed + change))/" memory.x >"$work/memory.x"
  COGMINT_MEMORY=$work/memory.x build_for_target firmware-stub "" cogmint-firmware
  run "$work" "$images/cogmint-firmware" 2>/dev/null
  if [ "$change" = 0 ]; then
    [ "$(awk '$1 == "stack" { print $2 }' "$work/target.txt")" = "$stack" ] \
      || fail "in $needed bytes of RAM the image does not run: $(cat "$work/target.txt")"
  else
    expect_error "the stack is used up" "with $((-change)) bytes of RAM too little the image says nothing"
  fi
done

if (build_for_target firmware-stub "" panics planted-panic) 2>"$work/link"; then
  fail "a program with a reachable panic was linked"
fi
grep -q cogmint_has_a_reachable_panic "$work/link" || fail "the planted panic failed otherwise: $(cat "$work/link")"

build_for_target firmware-stub
say "every planted failure was reported; the image needs $needed bytes of RAM"
