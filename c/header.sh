#!/usr/bin/env bash
# Makes include/cogmint.h of the sources.
#
#   bash c/header.sh [--check]
#
# With --check it writes nothing, and exit code 0 means that the header is what the sources make.
set -euo pipefail
cd "$(dirname "$0")"

case ${1-} in
  "" | --check) ;;
  *) echo "header.sh: unknown option $1 (known: --check)" >&2; exit 2 ;;
esac

made=$(mktemp)
trap 'rm -f "$made"' EXIT
cargo run --quiet --locked --release --manifest-path header/Cargo.toml -- "$made"
if [ "${1-}" = --check ]; then
  diff -u include/cogmint.h "$made" >&2 || { echo "header.sh: include/cogmint.h is stale: bash c/header.sh" >&2; exit 1; }
else
  mkdir -p include
  cp "$made" include/cogmint.h
  chmod 644 include/cogmint.h
fi
