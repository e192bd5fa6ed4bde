#!/usr/bin/env bash
# SUBJECT  pykitti 0.3.1 (KITTI raw data), with numpy 2.4.6
# GUESS    raw(...).get_velo(i) is the sweep that belongs to oxts[i]; frames=[...] chooses sweeps by
#          number, and raises if one does not exist.
# SEEN     Sweeps are counted as files. If the files of sweeps 8 and 9 are missing, as four are in
#          drive 2011_09_26_drive_0009, get_velo(8) is sweep 10 with the pose of sweep 8, and all
#          later ones stay two behind. frames=range(15, 20) gives 5 poses and all 18 sweeps from
#          0, since an index past the end of one sensor's files switches the choice off for that
#          sensor, and an exception is swallowed. No error for either.
# WHY IT MATTERS
#          Maps and labels of the rest of the drive are 0.4 s off, 4 m at 10 m/s: less than a
#          wrong calibration looks like, and no length differs that one compares
#          (len(raw) counts stamps of the IMU). Pair by the number in the file name.
# SOURCE   Run below; raw._get_file_lists, utils.subselect_files. The four files are missing in the
#          data set as it is given out; the line of such a sweep in timestamps.txt is empty.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 100 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6 pillow==13.0.0
pip --no-deps pykitti==0.3.1
"$dir/venv/bin/python" - "$dir" <<'EOF'
import sys
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np

# The package itself imports OpenCV and pandas, for its reader of the tracking data.
package = ModuleType("pykitti")
package.__path__ = find_spec("pykitti").submodule_search_locations
sys.modules["pykitti"] = package
from pykitti.raw import raw  # noqa: E402

print(*(f"{name} {version(name)}" for name in ("pykitti", "numpy")))
DATE, DRIVE, COUNT, MISSING = "2011_09_26", "0009", 20, (8, 9)
root = Path(sys.argv[1])
drive = root / DATE / f"{DATE}_drive_{DRIVE}_sync"
for folder in ("oxts/data", "velodyne_points/data"):
    (drive / folder).mkdir(parents=True)
identity = "R: 1 0 0 0 1 0 0 0 1\nT: 0 0 0\n"
(root / DATE / "calib_imu_to_velo.txt").write_text(identity)
(root / DATE / "calib_velo_to_cam.txt").write_text(identity)
(root / DATE / "calib_cam_to_cam.txt").write_text("".join(
    f"P_rect_0{camera}: 700 0 600 0 0 700 170 0 0 0 1 0\nR_rect_0{camera}: 1 0 0 0 1 0 0 0 1\n"
    for camera in range(4)
))
(drive / "oxts" / "timestamps.txt").write_text("".join(
    f"2011-09-26 13:02:{10 + 0.1 * sweep:012.9f}\n" for sweep in range(COUNT)
))
for sweep in range(COUNT):
    # Altitude and x of the points tell the number of the sweep.
    values = [49.0, 8.4, sweep, *[0] * 20, 0.1, 0.1, 4, 8, 4, 4, 0]
    (drive / "oxts" / "data" / f"{sweep:010d}.txt").write_text(" ".join(map(str, values)))
    if sweep not in MISSING:
        np.full((1, 4), sweep, np.float32).tofile(
            drive / "velodyne_points" / "data" / f"{sweep:010d}.bin"
        )


def pairs(data):
    return [
        (int(pose.packet.alt), int(points[0, 0])) for pose, points in zip(data.oxts, data.velo)
    ]


whole = raw(root, DATE, DRIVE)
print(f"{len(whole)} stamps; (pose, sweep):", pairs(whole)[6:11], "...", pairs(whole)[-1])
assert len(whole) == COUNT and pairs(whole)[7] == (7, 7)
assert pairs(whole)[8] == (8, 10) and pairs(whole)[-1] == (17, 19), "sweeps are paired now"

part = raw(root, DATE, DRIVE, frames=range(15, COUNT))
print("frames 15 to 19:", len(part.oxts), "poses,", len(part.velo_files), "sweeps,", pairs(part))
assert len(part.oxts) == 5 and len(part.velo_files) == COUNT - len(MISSING)
assert pairs(part) == [(15, 0), (16, 1), (17, 2), (18, 3), (19, 4)], "frames are chosen now"
print("as stated: sweeps are counted as files, and paired with poses of other sweeps")
EOF
