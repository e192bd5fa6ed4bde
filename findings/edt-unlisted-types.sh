#!/usr/bin/env bash
# SUBJECT  edt 3.1.2 (exact distance transform), with numpy 2.4.6
# GUESS    A grid of a type that edt does not support (float16, or big-endian as it is read from
#          a GeoTIFF or a big-endian PointCloud2) is converted, or raises TypeError.
# SEEN     edt returns zeros for the whole grid, without an error or a warning: every cell says
#          "occupied". The same grid as bool has a largest distance of 4.0 m. int16, float32 and
#          float64 in the byte order of the machine are right.
# WHY IT MATTERS
#          Occupancy from a network is often float16, and a cost that looks up distances (scene
#          flow, ICP on a grid) is then 0 for every motion: it "converges" in the first step.
#          Convert the mask to bool before the call.
# SOURCE   Run below; the docstring of edt.edt lists the types, edtsq has no branch for others.
# DATE     2026-11-27
# Needs Python 3.11 or newer. About 110 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile edt==3.1.2 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import edt
import numpy as np

print("edt", version("edt"), "numpy", np.__version__)

# One occupied cell in the corner of a free grid of 41 x 5 x 3 cells of 0.1 m.
free = np.ones((41, 5, 3), bool)
free[0, 2, 1] = False
size = (0.1, 0.1, 0.1)
index = np.argwhere(np.ones_like(free)).reshape(*free.shape, 3)
exact = 0.1 * np.linalg.norm(index - [0, 2, 1], axis=-1)


def largest(kind):
    distances = edt.edt(free.astype(kind), anisotropy=size)
    print(f"{np.dtype(kind).str:>4} largest distance {distances.max():.3f} m")
    return distances


other_order = ">" if np.little_endian else "<"
for kind in ("?", "i2", "f4", "f8"):
    assert np.allclose(largest(kind), exact, atol=1e-5), kind
for kind in ("f2", other_order + "i2", other_order + "f4"):
    assert not largest(kind).any(), f"{kind}: no longer zeros only"
print("as stated: unlisted types give zeros everywhere")
EOF
