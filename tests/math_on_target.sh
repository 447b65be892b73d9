#!/usr/bin/env bash
# The functions of core/src/real.rs beside the approximations of the crate micromath, on a Cortex-M4F in QEMU: instructions per call, and the
# worst error over a range of arguments, against libm in double precision.
#
#   bash tests/math_on_target.sh
#
# Exit code 0 only when every function was measured.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "math_on_target.sh: $*" >&2; }

source tests/target_toolchain.sh
build_for_target firmware-stub "" math

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
run "$work" "$PWD/firmware-stub/target/$target/release/math"

# sqrt calls 4000 loop 44000 real 352000 59 micromath 80000 60659097
awk '
  function per_call(count) { return (count - $5) / $3 }
  BEGIN { print "| function | instructions: core, micromath | worst error: core, micromath |"; print "| --- | --- | --- |" }
  $2 == "calls" && $6 == "real" && $9 == "micromath" && NF == 11 {
    printf "| `%s` | %.0f, %.0f | %.0e, %.0e |\n", $1, per_call($7), per_call($10), $8 / 1e9, $11 / 1e9
    rows++
    next
  }
  { print "math_on_target.sh: the firmware said: " $0 > "/dev/stderr" }
  END { exit rows != 7 }
' "$work/target.txt"
