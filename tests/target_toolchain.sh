# What the scripts that run on the target share: its toolchain, and QEMU. To be sourced in the repository's root, after
# `say` is defined.
#
# Takes the rustup target where it is installed; else Debian's toolchain with the sources of `core`; else installs
# the one or the other.

target=thumbv7em-none-eabihf

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

# Records so many cycles of the seminar room in a new folder, told by its walls: the target's tracker has room for eight
# surfaces, not for a private one of every virtual anchor.
record_room() {
  sed 's/^told = "virtual-anchors"/told = "walls"/' host-sim/scenarios/seminar-room.toml >"$2.toml"
  cargo run --quiet --locked --release -- simulate "$2.toml" --seed 1 --cycles "$1" --out "$2" >&2
}

# Records so many cycles of the DW3000 office with so many of its anchors in a new folder, of each response the usual window.
record_office() {
  awk -v most="$1" '/^\[\[anchors\]\]/ { skip = ++anchors > most } /^\[tag\]/ { skip = 0 } !skip
    /^kind = "dw3000"/ { print "samples = 128\nwindow.first_path.sample = 32" }' \
    host-sim/scenarios/dw3000-office.toml >"$3.toml"
  cargo run --quiet --locked --release -- simulate "$3.toml" --seed 1 --cycles "$2" --out "$3" >&2
}

# Runs cargo for the target: its subcommand and arguments. The parts of the standard library that are used come first: `core`, or
# `core,alloc`.
cargo_for_target() {
  local parts=$1 subcommand=$2
  shift 2
  if rustup_target; then
    cargo "$subcommand" --quiet --locked --target "$target" "$@" >&2
  elif debian_toolchain; then
    (
      export PATH=/usr/bin:$PATH RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1
      export CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER=ld.lld
      /usr/bin/cargo "$subcommand" --quiet --locked -Z build-std="$parts" --target "$target" "$@" >&2
    )
  else
    say "no toolchain for $target"
    exit 1
  fi
}

# Builds the programs of a folder that is no member of the workspace. `heap` as second argument: with `alloc`. A third
# one: only this program; a fourth: with this feature.
build_for_target() {
  local only=(${3:+--bin "$3"} ${4:+--features "$4"})
  (cd "$1" && cargo_for_target "core${2:+,alloc}" build --release "${only[@]}")
}

# Runs a program in a folder, from which it reads feed.bin; its output becomes target.txt. One instruction per virtual
# nanosecond: counts repeat exactly.
run() {
  (
    cd "$1"
    timeout 600 qemu-system-arm -cpu cortex-m4 -machine mps2-an386 -nographic -monitor none -serial none \
      -semihosting-config enable=on,target=native -icount shift=0 -kernel "$2" >target.txt 2>&1
  ) || say "QEMU ended with $?"
}
