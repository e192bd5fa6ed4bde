#!/usr/bin/env bash
# SUBJECT  kiss-icp 1.3.0 (loader of the NCLT data set), with numpy 2.4.6
# GUESS    A return 70 m ahead is at x = 70 m, as one 70 m behind is at x = -70 m.
# SEEN     The files hold unsigned shorts, 5 mm each, from -100 m. They are read as signed ones: a
#          coordinate above 63.83 m comes out 327.68 m too low, so 70 m ahead becomes 257.68 m
#          behind. y, too, before it is mirrored: 70 m to the right becomes 257.68 m to the left.
#          Behind and on the left all is right. The default max_range of 100 m then drops these
#          points, so no map shows them: the sweep ends at 63.8 m ahead and on the right, and at
#          100 m behind and on the left.
# WHY IT MATTERS
#          Far walls hold the heading of an odometry, and they are missing where the robot looks.
#          With a larger max_range they are ghosts on the other side. genz-icp 0.3.2 and
#          slam-dataset-sdk 0.0.2 have the same code. Read the files as '<u2'.
# SOURCE   Run below; NCLTDataset.read_point_cloud. The example that NCLT gives, read_vel_sync.py,
#          takes unsigned shorts.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 100 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6 pydantic-settings==2.15.0 PyYAML==6.0.4
# Without viewers and SciPy, which reading and preprocessing do not import.
pip --no-deps kiss-icp==1.3.0
"$dir/venv/bin/python" - "$dir" <<'EOF'
import sys
from importlib.metadata import version

import numpy as np
from kiss_icp.config import load_config
from kiss_icp.datasets.nclt import NCLTDataset
from kiss_icp.preprocess import get_preprocessor

print(*(f"{name} {version(name)}" for name in ("kiss-icp", "numpy")))
distance = np.arange(1.0, 100.0)
zero = np.zeros_like(distance)
# In NCLT's frame, in which y points right and z down: ahead, behind, right, left.
written = np.concatenate([
    np.column_stack(columns)
    for columns in (
        (distance, zero, zero), (-distance, zero, zero),
        (zero, distance, zero), (zero, -distance, zero),
    )
])
record = np.zeros(len(written), [("xyz", "<u2", 3), ("intensity", "u1"), ("laser", "u1")])
record["xyz"] = np.round((written + 100.0) / 0.005)
path = f"{sys.argv[1]}/1326030975726043.bin"
record.tofile(path)

read = NCLTDataset.read_point_cloud(None, path)
right = written * [1, -1, -1]
off = np.linalg.norm(read - right, axis=1)
wrong = off > 0.01
far = written.max(axis=1) > 63.835
print(f"70 m ahead: {read[69].round(2)}, 70 m behind: {read[99 + 69].round(2)}, "
      f"70 m to the right: {read[2 * 99 + 69].round(2)}")
assert np.array_equal(wrong, far) and far.sum() == 2 * 36, "all coordinates are right now"
assert np.allclose(off[wrong], 327.68, atol=0.01)

config = load_config(None)
used = get_preprocessor(config).preprocess(read, np.array([]), np.eye(4))
print(f"max_range {config.data.max_range:g} m: x from {used[:, 0].min():.0f} to "
      f"{used[:, 0].max():.0f} m, y from {used[:, 1].min():.0f} to {used[:, 1].max():.0f} m")
assert used[:, 0].max() == 63 and used[:, 0].min() == -99
assert used[:, 1].min() == -63 and used[:, 1].max() == 99
print("as stated: coordinates above 63.83 m are read 327.68 m too low")
EOF
