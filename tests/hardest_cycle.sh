#!/usr/bin/env bash
# Searches the hardest legal cycle: random scans, frames, priors and plans that the firmware's image has room for, by the
# time that the core takes for them on the host; the worst are run again on a Cortex-M4F in QEMU, whose instructions
# decide.
#
#   bash tests/hardest_cycle.sh [--json] [--seconds N] [--seed S]
#
# Searches for 60 seconds from seed 1 where nothing is given; an hour (`--seconds 3600`) finds harder cycles. The seed
# printed re-creates its case: `--seed S --seconds 0` runs that case alone. `--json` prints one line of JSON.
#
# Exit code 0 only when the firmware ran every case to its end with the host's bits.
set -euo pipefail
cd "$(dirname "$0")/.."

seconds=60
seed=1
json=
while [ $# -gt 0 ]; do
  case $1 in
    --json) json=--json ;;
    --seconds | --seed)
      [[ ${2:-} =~ ^[0-9]{1,16}$ ]] || { echo "hardest_cycle.sh: $1 needs a whole number" >&2; exit 2; }
      if [ "$1" = --seconds ]; then seconds=$2; else seed=$2; fi
      shift
      ;;
    *) echo "hardest_cycle.sh: unknown option $1 (known: --json, --seconds N, --seed S)" >&2; exit 2 ;;
  esac
  shift
done

say() { echo "hardest_cycle.sh: $*" >&2; }

source tests/target_toolchain.sh
build_for_target firmware-stub "" cogmint-firmware

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cargo build --quiet --locked --release -p cogmint-tests --example hardest_cycle
hardest_cycle=(cargo run --quiet --locked --release -p cogmint-tests --example hardest_cycle --)
"${hardest_cycle[@]}" search --seconds "$seconds" --seed "$seed" --out "$work"
for folder in "$work"/*/; do
  run "$folder" "$PWD/firmware-stub/target/$target/release/cogmint-firmware"
done
"${hardest_cycle[@]}" report --out "$work" $json
