#!/usr/bin/env bash
# What the main job or the test command takes from a clean clone of the last commit, build included.
#
#   bash tests/clean_clone.sh [--json] main|tests
#
# Prints seconds by the clock (with how many processors) and seconds of processor time.
set -euo pipefail
cd "$(dirname "$0")/.."

json=
[ "${1:-}" = --json ] && { json=yes; shift; }
case ${1:-} in
  main) job=(cargo run --locked --release) ;;
  tests) job=(bash tests/all.sh) ;;
  *) echo "clean_clone.sh: usage: [--json] main|tests" >&2; exit 2 ;;
esac

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
git clone --quiet . "$work/clone"
cd "$work/clone"
unset CARGO_TARGET_DIR
TIMEFORMAT='%R %U %S'
{ time "${job[@]}" >"$work/output" 2>&1; } 2>"$work/time" || { cat "$work/output" >&2; exit 1; }
read -r wall user system <"$work/time"
awk -v wall="$wall" -v user="$user" -v system_s="$system" -v processors="$(nproc)" -v json="$json" 'BEGIN {
  text = json ? "{\"wall_s\": %.1f, \"processor_s\": %.1f, \"processors\": %d}\n" \
    : "%.1f s by the clock, %.1f s of processor time, %d processors\n"
  printf text, wall, user + system_s, processors
}'
