#!/usr/bin/env bash
# SUBJECT  slam-dataset-sdk 0.0.2 (loaders of data sets for lidar odometry), with numpy 2.2.6
# GUESS    gt_poses[i] is the pose of sweep i: for Boreas from lidar_poses.csv, relative to the
#          first; for Oxford RobotCar interpolated at the stamp of the sweep.
# SEEN     Boreas: the y of each position is the heading, as both columns are unpacked into one
#          name. A straight drive of 100 m to the north has no length.
#          Oxford: nothing is interpolated, the share between two poses is a division without a
#          rest, hence 0: each pose is that of the last sample before. And the list of stamps gets
#          the origin at its front, so len() is one more than there are sweeps, the first comes
#          twice, and all after it have the poses of the next sweep.
# WHY IT MATTERS
#          An odometry without error is judged bad by this truth, or a lag of one sweep is found
#          that the lidar does not have: 1 m here. The names and layouts are those of kiss-icp, from
#          which the loaders come; kiss-icp 1.3.0 reads Boreas right.
# SOURCE   Run below; datasets/boreas.py, datasets/oxford.py, tools/oxford_sdk/interpolate_poses.py.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 90 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.2.6 natsort==8.4.0
pip --no-deps slam-dataset-sdk==0.0.2
"$dir/venv/bin/python" -W ignore - "$dir" <<'EOF'
import sys
from contextlib import redirect_stdout
from importlib.metadata import version
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from types import ModuleType

import numpy as np

# The package itself imports its odometry and viewer; images and PLY files are not used here.
package = ModuleType("slam_dataset_sdk.datasets")
package.__path__ = [str(Path(find_spec("slam_dataset_sdk").origin).parent / "datasets")]
sys.modules["slam_dataset_sdk.datasets"] = package
for name in ("cv2", "plyfile"):
    sys.modules[name] = ModuleType(name)
    sys.modules[name].__getattr__ = lambda attribute: None
from slam_dataset_sdk.datasets.boreas import BoreasDataset  # noqa: E402
from slam_dataset_sdk.datasets.oxford import OxfordRobotCarDataset  # noqa: E402

print(*(f"{name} {version(name)}" for name in ("slam-dataset-sdk", "numpy")))
root = Path(sys.argv[1])

boreas = root / "boreas-2021-01-01"
(boreas / "lidar").mkdir(parents=True)
(boreas / "applanix").mkdir()
rows = ["GPSTime,easting,northing,altitude,vel_east,vel_north,vel_up,"
        "roll,pitch,heading,angvel_z,angvel_y,angvel_x"]
for sweep in range(11):
    np.zeros((1, 6), np.float32).tofile(boreas / "lidar" / f"{1600000000 + sweep}000000.bin")
    rows.append(f"{1600000000 + sweep}000000,500,{1000 + 10 * sweep},0,0,10,0,0,0,0.5,0,0,0")
(boreas / "applanix" / "lidar_poses.csv").write_text("\n".join(rows) + "\n")
metres = np.linalg.norm(BoreasDataset(boreas).gt_poses[-1][:3, 3])
print(f"Boreas: 100 m to the north, {metres:.1f} m by gt_poses")
assert metres < 0.01, "the northing is read now"

sweeps = root / "oxford" / "velodyne_left"
(sweeps.parent / "vo").mkdir(parents=True)
(sweeps.parent / "extrinsics").mkdir()
sweeps.mkdir()
(sweeps.parent / "extrinsics" / "velodyne_left.txt").write_text("0 0 0 0 0 0\n")
# Sweeps every 50 ms from 0.11 s, poses every 80 ms, at 20 m/s along x. Stamps in us.
START, SPEED, BETWEEN = 1_400_000_000_000_000, 20.0, 80_000
ahead = f"{SPEED * BETWEEN * 1e-6},0,0,0,0,0"
rows = ["source_timestamp,destination_timestamp,x,y,z,roll,pitch,yaw"]
rows += [f"{START + BETWEEN * k},{START + BETWEEN * (k - 1)},{ahead}" for k in range(1, 20)]
(sweeps.parent / "vo" / "vo.csv").write_text("\n".join(rows) + "\n")
stamps = [START + 110_000 + 50_000 * sweep for sweep in range(10)]
(sweeps.parent / "velodyne_left.timestamps").write_text("".join(f"{s} 1\n" for s in stamps))
for stamp in stamps:
    np.zeros(4, np.float32).tofile(sweeps / f"{stamp}.bin")
with redirect_stdout(StringIO()):
    data = OxfordRobotCarDataset(sweeps)
places = np.array([float(pose[0, 3]) for pose in data.gt_poses])
after = np.array(stamps) - START
right = SPEED * (after - after[0]) * 1e-6
samples = (after // BETWEEN - after[0] // BETWEEN) * SPEED * BETWEEN * 1e-6
print(f"Oxford: {len(stamps)} sweeps, len() {len(data)}, x in m")
print("  gt_poses", places.round(2).tolist())
print("  right   ", right.round(2).tolist())
assert np.allclose(places, samples) and not np.allclose(places, right), "poses are interpolated now"
assert len(data) == len(stamps) + 1, "no sweep comes twice now"
for index in (1, 2, 9):
    _, stamp = data[index]
    print(f"  data[{index}] is sweep {stamps.index(stamp)}, with the pose of sweep {index}")
    assert stamps.index(stamp) == index - 1, "a sweep has its own pose now"
print("as stated: truth of other places and times")
EOF
