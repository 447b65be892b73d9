#!/bin/sh
# Runs hlsvd.py with its packages in a throw-away environment. For `cogmint experiment estimator --against-program`;
# no test needs it.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
python3 -m venv "$place" >&2
"$place/bin/pip" install --quiet --disable-pip-version-check \
    "hlsvdpropy==2.0.2" "numpy>=2,<3" "scipy>=1.14,<2" "setuptools<81" >&2
# One response at a time: threads inside the linear algebra only get in each other's way.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
"$place/bin/python" "$here/hlsvd.py"
