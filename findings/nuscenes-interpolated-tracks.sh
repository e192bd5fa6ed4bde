#!/usr/bin/env bash
# SUBJECT  nuscenes-devkit 1.2.0 (official tracking evaluation), with numpy 1.26.4
# GUESS    Holes of a track, in ground truth and results, are filled by boxes along its way in
#          order of time, as the docstring of interpolate_tracks says.
# SEEN     The weights of the two ends are exchanged: a box that is missing just after the left end
#          is put just before the right one. A car that drives away at 10 m/s and is missing for
#          two key frames is at 0, 10, 5, 15 m; missing for five, at 0, 25, 20, 15, 10, 5, 30 m:
#          it jumps ahead and drives backwards. A single missing key frame is right, as both
#          weights are equal.
# WHY IT MATTERS
#          Ground truth has holes wherever an object has no lidar point, as those boxes are removed
#          before. A tracker that bridges such a hole rightly is 5 to 20 m off, beyond the limit
#          of 2 m, and gets misses and false alarms; one that leaves the same hole is given the
#          same wrong boxes, and hits. Fill holes of the results before evaluating, and distrust
#          small differences.
# SOURCE   Run below; nuscenes/eval/tracking/loaders.py. Reported as issue 1141 of
#          nutonomy/nuscenes-devkit in 2025, and in this release all the same.
# DATE     2026-11-28
# Needs Python 3.11 to 3.12. About 90 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==1.26.4 pyquaternion==0.9.9
pip --no-deps nuscenes-devkit==1.2.0
"$dir/venv/bin/python" - <<'EOF'
import json
import sys
from collections import defaultdict
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

# The package itself imports OpenCV, scikit-learn and more, for its database and pictures.
package = ModuleType("nuscenes")
package.__path__ = find_spec("nuscenes").submodule_search_locations
package.NuScenes = None
sys.modules["nuscenes"] = package
for name, member in (("nuscenes.nuscenes", "NuScenes"), ("nuscenes.utils.data_classes", "Box")):
    sys.modules[name] = ModuleType(name)
    setattr(sys.modules[name], member, None)
from nuscenes.eval.tracking.data_classes import TrackingBox, TrackingConfig  # noqa: E402
from nuscenes.eval.tracking.loaders import interpolate_tracks  # noqa: E402

print(*(f"{name} {version(name)}" for name in ("nuscenes-devkit", "numpy")))
configs = Path(next(iter(package.__path__))) / "eval" / "tracking" / "configs"
TrackingConfig.deserialize(json.loads((configs / "tracking_nips_2019.json").read_text()))
SPEED, PERIOD = 10.0, 0.5  # m/s, s between key frames


def driven(missing):
    """x of the car in each key frame after interpolation, with that many missing."""
    tracks = defaultdict(list)
    for frame in range(missing + 2):
        tracks[round(1e6 * PERIOD * frame)] = [] if 0 < frame <= missing else [
            TrackingBox(
                sample_token=str(frame), translation=(SPEED * PERIOD * frame, 0, 0),
                size=(1.9, 4.6, 1.7), rotation=(1, 0, 0, 0), velocity=(SPEED, 0),
                tracking_id="car", tracking_name="car", tracking_score=-1.0,
            )
        ]
    return [float(boxes[0].translation[0]) for boxes in interpolate_tracks(tracks).values()]


for missing in (1, 2, 5):
    right = [SPEED * PERIOD * frame for frame in range(missing + 2)]
    filled = driven(missing)
    off = max(abs(x - y) for x, y in zip(filled, right))
    print(f"{missing} missing: x {[round(x, 3) for x in filled]}, right {right}, {off:.1f} m off")
    reversed_hole = [right[0], *reversed(right[1:-1]), right[-1]]
    assert all(abs(x - y) < 1e-6 for x, y in zip(filled, reversed_hole)), "order is right now"
    assert off > 2 or missing == 1
print("as stated: holes are filled in reverse order")
EOF
