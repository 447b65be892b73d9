"""Delays of lines by HLSVD (Laudadio et al. 2002) as the package hlsvdpropy implements it.

Reads a JSON object per line and answers with a list of delays in seconds; the format is described in
host-sim/src/experiment/baseline/program.rs.
"""

import json
import sys

import numpy as np
from hlsvdpropy.hlsvd import hlsvdpro

# Lines are undamped: a root this far inside or outside the unit circle is noise.
FARTHEST_FROM_CIRCLE = 0.1


def delays_s(question):
    lines = np.array([complex(re, im) for re, im in question["lines"]])
    if not lines.any():
        return []
    # From each line to the next a path turns by -2 pi step_hz tau.
    _, _, turns, dampings, *_ = hlsvdpro(lines, question["paths"])
    turns = turns[np.abs(dampings) < FARTHEST_FROM_CIRCLE]
    return [float(-turn % 1.0 / question["step_hz"]) for turn in turns]


for text in sys.stdin:
    print(json.dumps(delays_s(json.loads(text))), flush=True)
