#!/usr/bin/env bash
# SUBJECT  standard-e2e 0.0.3 (data sets for end-to-end driving, Waymo among them), with numpy 2.4.6
# GUESS    Trajectory.resample interpolates headings as angles, and gives no numbers where the
#          trajectory has none.
# SEEN     Headings are interpolated as numbers: between 179 and -179 degrees a vehicle that drives
#          straight on turns to 0 and comes back. Before the first and after the last stamp, and in
#          holes, all values are 0: the place is that of the vehicle itself, with heading 0. Only
#          IS_VALID tells. Stamps are kept as float32: two sweeps at an epoch time of 2026 are one
#          stamp, and an error says that they do not increase.
# WHY IT MATTERS
#          The trajectories are those of the ego vehicle and of the movers relative to it; oncoming
#          traffic has just these headings. A loss on headings learns a turn that nobody drove, and
#          one without IS_VALID learns objects at the own place. Resample sine and cosine.
# SOURCE   Run below; data_structures/trajectory_data.py. 0.0.7, for Python 3.12, is alike.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 85 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6
pip --no-deps standard-e2e==0.0.3
"$dir/venv/bin/python" - <<'EOF'
import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np

# Tensors, images, tables and settings are not used here.
root = Path(find_spec("standard_e2e").origin).parent
for name in ("torch", "yaml", "standard_e2e.utils.image_utils"):
    sys.modules[name] = ModuleType(name)
    sys.modules[name].__getattr__ = lambda attribute: type(attribute, (), {})
for name in ("standard_e2e", "standard_e2e.data_structures"):
    sys.modules[name] = ModuleType(name)
    sys.modules[name].__path__ = [str(root.parent.joinpath(*name.split(".")))]
from standard_e2e.data_structures.trajectory_data import Trajectory  # noqa: E402
from standard_e2e.enums import TrajectoryComponent as Part  # noqa: E402

print(*(f"{name} {version(name)}" for name in ("standard-e2e", "numpy")))


def trajectory(stamps):
    """Straight on against x, as oncoming traffic, 30 m to 10 m ahead."""
    return Trajectory({
        Part.TIMESTAMP: stamps,
        Part.X: [30.0, 20.0, 10.0],
        Part.Y: [3.0, 3.0, 3.0],
        Part.HEADING: np.deg2rad([179.0, -179.0, -179.0]),
    })


wanted = [-0.5, 0.0, 0.25, 0.5, 0.75, 1.0, 2.5]
found = trajectory([0.0, 1.0, 2.0]).resample(wanted)
places, valid = (found.get(part).ravel() for part in (Part.X, Part.IS_VALID))
degrees = np.rad2deg(found.get(Part.HEADING).ravel())
for stamp, place, heading, known in zip(wanted, places, degrees, valid):
    print(f"  {stamp:5.2f} s: x {place:4.1f} m, heading {heading:6.1f} degrees, valid {known:.0f}")
assert np.allclose(degrees[1:6], (179, 89.5, 0, -89.5, -179)), "headings are angles now"
assert places[0] == places[-1] == degrees[-1] == 0, "values outside are no longer 0"
assert valid.tolist() == [0, 1, 1, 1, 1, 1, 0]

try:
    trajectory([1.79e9, 1.79e9 + 0.1, 1.79e9 + 0.2]).resample([1.79e9])
except ValueError as error:
    print("stamps of 2026, 0.1 s apart:", error)
else:
    raise AssertionError("stamps are kept in double precision now")
print("as stated: headings are numbers, and what is unknown is 0")
EOF
