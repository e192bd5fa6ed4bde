#!/usr/bin/env bash
# SUBJECT  pypointcloud 0.1.0 (PCD files to NumPy), beside pcd-py 0.2.0 and pypcd4 1.5.1
# GUESS    A reader that names binary_compressed among its formats gives the points that were
#          written, as two other readers do, or raises.
# SEEN     The compressed block of PCD holds one field after the other (all x, all y, ...). This
#          reader decompresses it and takes it for rows: with four float fields, its first point
#          is (x0, x1, x2), its second (x4, x5, x6), and its last ones come from the last field.
#          No error, no warning; the number of points is right.
# WHY IT MATTERS
#          Lidar tools write this format by default to save space. A cloud of a street becomes
#          diagonal stripes of plausible size: nothing downstream says why no plane is found.
# SOURCE   Run below; PCL's description of the format says columns; pypointcloud.load_pcd.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 130 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  pypointcloud==0.1.0 pcd-py==0.2.0 pypcd4==1.5.1 numpy==2.4.6
cd "$dir"
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import numpy as np
import pcd_py
import pypcd4
import pypointcloud

for name in ("pypointcloud", "pcd-py", "pypcd4", "numpy"):
    print(name, version(name))

count = 40
fields = {
    "x": np.arange(count, dtype=np.float32),
    "y": 100 + np.arange(count, dtype=np.float32),
    "z": np.full(count, 5, np.float32),
    "intensity": np.full(count, 9, np.float32),
}
written = np.column_stack([fields[name] for name in "xyz"])
in_rows = np.concatenate(list(fields.values())).reshape(count, 4)

for kind in ("binary", "binary_compressed"):
    path = f"{kind}.pcd"
    pcd_py.write_pcd(path, fields, kind)
    other = pypcd4.PointCloud.from_path(path).numpy(("x", "y", "z"))
    points, rest = pypointcloud.load_pcd(path)
    print(f"{kind}: pypcd4 {other[:2].tolist()}, pypointcloud {points[:2].tolist()}")
    assert np.array_equal(other, written), "the file is not what this script means to write"
    assert points.shape == written.shape
    if kind == "binary":
        assert np.array_equal(points, written)
    else:
        assert np.array_equal(points, in_rows[:, :3]), "columns are no longer read as rows"
        assert np.array_equal(rest["intensity"], in_rows[:, 3])
print("as stated: the compressed columns are read as rows, without an error")
EOF
