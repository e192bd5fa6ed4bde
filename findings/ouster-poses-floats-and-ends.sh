#!/usr/bin/env bash
# SUBJECT  ouster-sdk 1.0.1 (poses of points), with numpy 2.4.6
# GUESS    dewarp(points, poses) and transform compute in the wider type of the two, as NumPy does,
#          so poses in doubles place points in a map. interp_pose stops at the ends, or raises.
# SEEN     The type of the points decides. With float32 points, those of XYZLutFloat, it is
#          computed in floats: at a UTM northing of 5,412,345.678 m all points are 0.18 m
#          off, up to 0.25 m elsewhere. With float64 points there is no error. interp_pose goes on
#          beyond the last pose without a limit: 30 s after the end of a drive at 10 m/s that turns
#          6 degrees a second it is 191 m away. pose_at_timestamp and TrajectoryEvaluator of the
#          same package raise ValueError there.
# WHY IT MATTERS
#          The float table is the one for real time, and GNSS poses come in map coordinates: each
#          sweep moves by another 0.1 m, as walls of a bad registration do. And if the pose file
#          ends before the recording, the rest is placed on an invented way. Subtract an origin
#          before, and compare stamps with the ends.
# SOURCE   Run below; the docstrings say nothing of either.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 150 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6 rosbags==0.9.23 packaging==26.0 more-itertools==10.8.0
pip --no-deps ouster-sdk==1.0.1
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import numpy as np
from ouster.sdk import core

print(*(f"{name} {version(name)}" for name in ("ouster-sdk", "numpy")))
pose = np.eye(4)
pose[:3, 3] = 512_345.678, 5_412_345.678, 100.0
poses = np.repeat(pose[None], 4, axis=0)
for kind in (np.float64, np.float32):
    points = np.ones((2, 4, 3), kind)
    placed = core.dewarp(points, poses)
    moved = core.transform(points[0], pose)
    off = np.abs(placed - pose[:3, 3] - 1.0).max(axis=(0, 1))
    print(f"dewarp of {kind.__name__} points: {placed.dtype}, {off.round(4)} m off")
    assert placed.dtype == moved.dtype == kind, "the wider type is used now"
    assert np.array_equal(placed[0], moved)
    assert 0.1 < off[1] < 0.25 if kind is np.float32 else off.max() < 1e-6

SPEED, TURN = 10.0, np.deg2rad(6.0)  # m/s, rad/s


def driven(seconds):
    pose = np.eye(4)
    cos, sin = np.cos(TURN * seconds), np.sin(TURN * seconds)
    pose[:2, :2] = [[cos, -sin], [sin, cos]]
    pose[:2, 3] = SPEED / TURN * np.array([sin, 1 - cos])
    return pose


stamps = np.arange(0.0, 10.5, 0.5)
known = np.array([driven(stamp) for stamp in stamps])
for after in (0.0, 1.0, 10.0, 30.0):
    found = core.interp_pose(np.array([stamps[-1] + after]), stamps, known)[0]
    from_end = np.linalg.norm(found[:2, 3] - known[-1, :2, 3])
    print(f"interp_pose {after:4.0f} s after the last pose: {from_end:6.1f} m from it")
    assert np.allclose(found, driven(stamps[-1] + after), atol=1e-6), "it stops at the end now"
print("as stated: the type of the points decides, and poses go on beyond the last one")
EOF
