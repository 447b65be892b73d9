#!/usr/bin/env bash
# Runs the core on a Cortex-M4F (thumbv7em-none-eabihf) in QEMU over recorded frames and compares every cycle's hash
# with the host's.
#
#   bash tests/on_target.sh [--json] [--cycles N] [--recording DIR]
#
# Beside that, the channel estimator alone over frames of eight paths: instructions, state and scratch.
#
# Takes the rustup target where it is installed; else Debian's toolchain with the sources of `core`; else installs
# the one or the other. Exit code 0 only when all hashes are equal and no panic symbol is linked.
set -euo pipefail
here=$PWD
cd "$(dirname "$0")/.."

target=thumbv7em-none-eabihf
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

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }

install_packages() {
  command -v apt-get >/dev/null || { say "needs $*: install them by hand"; exit 1; }
  say "installing $*"
  as_root apt-get update -qq >&2
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "$@" >&2
}

rustup_target() {
  command -v rustup >/dev/null && rustup target list --installed 2>/dev/null | grep -qx "$target"
}

debian_toolchain() {
  [ -x /usr/bin/cargo ] && [ -x /usr/bin/rustc ] && command -v ld.lld >/dev/null \
    && [ -f "$(/usr/bin/rustc --print sysroot)/lib/rustlib/src/rust/library/core/Cargo.toml" ]
}

if ! rustup_target && ! debian_toolchain; then
  if command -v rustup >/dev/null && timeout 60 rustup target add "$target" >/dev/null 2>&1; then
    say "added the rustup target $target"
  else
    install_packages rustc-web cargo-web rust-web-src lld
  fi
fi
command -v qemu-system-arm >/dev/null || install_packages qemu-system-arm

# The firmware is built in its own folder: it is no member of the workspace.
if rustup_target; then
  (cd firmware-stub && cargo build --quiet --locked --release --target "$target" >&2)
elif debian_toolchain; then
  (
    cd firmware-stub
    export PATH=/usr/bin:$PATH RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1
    export CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER=ld.lld
    /usr/bin/cargo build --quiet --locked -Z build-std=core --release --target "$target" >&2
  )
else
  say "no toolchain for $target"
  exit 1
fi
images=$PWD/firmware-stub/target/$target/release
image=$images/cogmint-firmware

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cargo run --quiet --locked --release -p cogmint -- \
  trace "${recording[@]}" --cycles "$cycles" --feed "$work/feed.bin" >"$work/host.txt"

mkdir "$work/eight"
cogmint=(cargo run --quiet --locked --release -p cogmint --)
"${cogmint[@]}" experiment eight-paths --frames 200 --out "$work/eight/frames"
"${cogmint[@]}" trace --recording "$work/eight/frames" --cycles 200 --feed "$work/eight/feed.bin" >/dev/null

# One instruction per virtual nanosecond: counts repeat exactly. The firmware reads feed.bin from its folder.
run() {
  (
    cd "$1"
    timeout 600 qemu-system-arm -cpu cortex-m4 -machine mps2-an386 -nographic -monitor none -serial none \
      -semihosting-config enable=on,target=native -icount shift=0 -kernel "$2" >target.txt 2>&1
  ) || say "QEMU ended with $?"
}
run "$work" "$image"
run "$work/eight" "$images/estimator"

cargo run --quiet --locked --release -p cogmint-tests --example target_report -- \
  --target "$target" --image "$image" --host "$work/host.txt" --log "$work/target.txt" \
  --estimator-log "$work/eight/target.txt" $json
