#!/usr/bin/env bash
# Searches the hardest legal cycle: random scans, frames, priors and plans that the firmware's image has room for, by the
# work that the core counts; the worst are run again on a Cortex-M4F in QEMU, whose instructions decide.
#
#   bash tests/hardest_cycle.sh [--json] [--seconds N] [--cycles N] [--seed S] [--worst N] [--uncapped]
#
# Searches for 60 seconds from seed 1 where nothing is given, or as many cycles as are told, which finds the same again:
# `--cycles 1000000` takes a quarter of an hour. The worst 100 are run on the target, or as many as are told. The seed printed
# re-creates its case: `--seed S --seconds 0` runs that case alone. `--uncapped`: the core does as much in a cycle as there is
# to do. `--json` prints one line of JSON.
#
# Exit code 0 only when the firmware ran every case to its end with the host's bits, and work and instructions agree within 20 %.
set -euo pipefail
cd "$(dirname "$0")/.."

seconds=
cycles=
seed=1
worst=100
json=
uncapped=
while [ $# -gt 0 ]; do
  case $1 in
    --json) json=--json ;;
    --uncapped) uncapped=--uncapped ;;
    --seconds | --cycles | --seed | --worst)
      [[ ${2:-} =~ ^[0-9]{1,16}$ ]] || { echo "hardest_cycle.sh: $1 needs a whole number" >&2; exit 2; }
      printf -v "${1#--}" %s "$2"
      shift
      ;;
    *)
      echo "hardest_cycle.sh: unknown option $1 (known: --json, --seconds N, --cycles N, --seed S, --worst N, --uncapped)" >&2
      exit 2
      ;;
  esac
  shift
done

# Where cycles are told, time is not what ends the search.
: "${seconds:=${cycles:+999999}}" "${seconds:=60}" "${cycles:=999999999}"

say() { echo "hardest_cycle.sh: $*" >&2; }

source tests/target_toolchain.sh
build_for_target firmware-stub "" cogmint-firmware

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cargo build --quiet --locked --release -p cogmint-tests --example hardest_cycle
hardest_cycle=(cargo run --quiet --locked --release -p cogmint-tests --example hardest_cycle --)
"${hardest_cycle[@]}" search --cycles "$cycles" --seconds "$seconds" --worst "$worst" --seed "$seed" $uncapped --out "$work"
for folder in "$work"/*/; do
  run "$folder" "$PWD/firmware-stub/target/$target/release/cogmint-firmware"
done
"${hardest_cycle[@]}" report --out "$work" $json
