#!/usr/bin/env bash
# Prints every budget of budgets.toml beside what its meter says now; the ratchet that budgets.toml describes.
#
#   bash tests/budgets.sh [--all] [--json] [--ledger FILE]
#
# `--all` also runs the meters that take long: the main job and the test command from a clean clone.
#
# Exit code 0 only when every meter ran and no row is at fault; 2 where the ledger is malformed.
set -euo pipefail
cd "$(dirname "$0")/.."
exec cargo run --quiet --locked --release -p cogmint-tests --example budgets -- "$@"
