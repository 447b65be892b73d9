#!/usr/bin/env bash
# The C interface: is its header what the sources make, do its tests and the examples in C run, and does C compute the bits of the host's
# trace, on the host and on a Cortex-M4F (thumbv7em-none-eabihf) in QEMU?
#
#   bash tests/c_interface.sh [--cycles N]
#
# The trace is that of the seminar room told by its walls; behind it, the map that was learnt goes into a tracker that is started anew. Exit code 0 only when the header is fresh, the examples end well, all hashes are
# equal and no function of the header can panic.
set -euo pipefail
cd "$(dirname "$0")/.."

cycles=20
while [ $# -gt 0 ]; do
  case $1 in
    --cycles)
      [ $# -gt 1 ] || { echo "c_interface.sh: $1 needs a value" >&2; exit 2; }
      cycles=$2
      shift
      ;;
    *) echo "c_interface.sh: unknown option $1 (known: --cycles N)" >&2; exit 2 ;;
  esac
  shift
done

say() { echo "c_interface.sh: $*" >&2; }

source tests/target_toolchain.sh

command -v cc >/dev/null || install_packages gcc libc6-dev
command -v arm-none-eabi-gcc >/dev/null || install_packages gcc-arm-none-eabi libnewlib-arm-none-eabi

# Where cargo puts what is built of the crate.
built=${CARGO_TARGET_DIR:-$PWD/c/target}
strict=(-std=c11 -O2 -Wall -Wextra -Wconversion -Wno-sign-conversion -Werror -I c/include)

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

bash c/header.sh --check
say "the header is fresh"

(cd c && cargo test --quiet --locked >&2)

# Ranges alone, then frames as well; each a library of its own.
for features in ranges,panics-do-not-link panics-do-not-link; do
  (cd c && cargo build --quiet --locked --release --features "$features")
  ranges=()
  [ "$features" = panics-do-not-link ] || ranges=(-DCOGMINT_RANGES)
  cc "${strict[@]}" "${ranges[@]}" c/examples/host.c "$built/release/libcogmint.a" -Wl,--gc-sections -lm -o "$work/host"
  "$work/host" >"$work/circle.txt" || { cat "$work/circle.txt" >&2; say "the example on the host failed"; exit 1; }
  tail -n 1 "$work/circle.txt"
done
cc "${strict[@]}" c/examples/replay.c c/examples/feed_host.c "$built/release/libcogmint.a" -Wl,--gc-sections -o "$work/replay"

record_room "$cycles" "$work/room"
cargo run --quiet --locked --release -- \
  trace --recording "$work/room" --cycles "$cycles" --feed "$work/feed.bin" >"$work/host.txt"

cargo run --quiet --locked --release -p cogmint-tests --example map_carried -- "$work/room" "$cycles" >"$work/carried.txt"
grep '^map ' "$work/carried.txt" >"$work/map.txt"
without=$(grep '^without ' "$work/carried.txt")
[ "${without##* }" != "$(sed 's/.* //' "$work/map.txt")" ] || { say "a map makes no difference"; exit 1; }

# Compares the hashes of a replay with those of the trace.
compare() {
  sed -n 's/^cycle \([0-9]*\) hash \([0-9a-f]*\)$/\1 \2/p' "$1" >"$work/hashes.txt"
  if [ "$(wc -l <"$work/host.txt")" != "$cycles" ] || ! diff "$work/host.txt" "$work/hashes.txt" >&2; then
    grep -h '^error' "$1" >&2 || true
    say "$2: hashes differ from the trace's"
    exit 1
  fi
  # The map alone in a tracker that is started anew, and what a cycle makes of it; without it, that would be something else.
  if ! grep '^map ' "$1" | cmp - "$work/map.txt" >&2 || grep -qF "${without##* }" "$1"; then
    grep -h '^error' "$1" >&2 || true
    say "$2: a map carried over is not what Rust makes of it"
    exit 1
  fi
  echo "$2: $cycles of $cycles hashes equal, and that of a map carried over"
}

(cd "$work" && ./replay) >"$work/replay.txt" || { cat "$work/replay.txt" >&2; say "the replay on the host failed"; exit 1; }
compare "$work/replay.txt" "C on the host"

build_for_target c "" "" panics-do-not-link
# Links the replay for the target: the image, then more for the linker.
link_for_target() {
  arm-none-eabi-gcc "${strict[@]}" -Os -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16 \
    -ffunction-sections -fdata-sections -nostartfiles -T c/examples/target.ld -Wl,--gc-sections,--no-warn-execstack \
    c/examples/replay.c c/examples/feed_target.c "$built/$target/release/libcogmint.a" -o "$@"
}

# With every function of the header in the image, no panic may be in it.
mapfile -t functions < <(sed -n 's/^[a-z].*[ *]\(cogmint_[a-z0-9_]*\)(.*/\1/p' c/include/cogmint.h)
[ ${#functions[@]} -gt 15 ] || { say "no functions in the header"; exit 1; }
link_for_target "$work/whole.elf" "${functions[@]/#/-Wl,-u,}"
! arm-none-eabi-nm "$work/whole.elf" | grep -i panic || { say "a panic is linked"; exit 1; }
echo "${#functions[@]} functions and no panic: flash $(arm-none-eabi-size "$work/whole.elf" | awk 'END { print $1 + $2 }') B with the replay"

link_for_target "$work/replay.elf"
run "$work" "$work/replay.elf"
compare "$work/target.txt" "C on the target"
arm-none-eabi-size "$work/replay.elf" | awk 'END { printf "flash %d B, static variables %d B", $1 + $2, $2 + $3 }'
sed -n 's/^stack \([0-9]*\) tracker \([0-9]*\)$/, of which the tracker \2 B; stack \1 B/p' "$work/target.txt"
