#!/usr/bin/env bash
# SUBJECT  frame-transforms 0.3.1 (a tree of frames without ROS), with numpy 2.4.6 and scipy 1.17.1
# GUESS    What its readme asks, where an object seen by a sensor is in the world, is answered by
#          one of two conventions: the transform added from world to base is the pose of the base in
#          the world, or takes coordinates of the world to the base.
# SEEN     By neither. Of an object 1 m ahead of a base at (10, 0) that points along y, get_position
#          gives (1, 10). The pose is (10, 1) by the first convention, (0, 9) by the second: the
#          transform is multiplied on the wrong side of the pose. Without rotations it is that of
#          the second. Points go through get_transform, by which both conventions can be had.
#          Pose.apply_transform moves along the axes of the map and turns about those of the body: a
#          step of 1 m from the base goes to (11, 0).
# WHY IT MATTERS
#          With frames that differ by a shift, as in a first test, all is right. A lidar or a base
#          that is turned puts detections metres away, and back again is right, since the inverse
#          has the same order. Take registry.get_transform(...) @ pose.transform.
# SOURCE   Run below; transforms.py (Pose.in_frame, Pose.apply_transform).
# DATE     2026-11-28
# Needs Python 3.11 to 3.14. About 145 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
# Without the tests of numpy and scipy, with which it takes 200 MB.
extract='import sys, zipfile; wheel = zipfile.ZipFile(sys.argv[2]); wheel.extractall(
  sys.argv[1], [name for name in wheel.namelist() if "/tests/" not in name])'
for package in scipy==1.17.1 numpy==2.4.6 frame-transforms==0.3.1; do
  python3 -m pip download --quiet --no-cache-dir --no-deps --dest "$dir/wheel" "$package"
  python3 -c "$extract" "$dir/site" "$dir"/wheel/*.whl
  rm -r "$dir/wheel"
done
PYTHONPATH="$dir/site" python3 -s - <<'EOF'
from importlib.metadata import version

import numpy as np
from frame_transforms import Pose, Registry, Transform
from scipy.spatial.transform import Rotation

print(*(f"{name} {version(name)}" for name in ("frame-transforms", "numpy", "scipy")))
AHEAD = np.array([1.0, 0, 0])


def transform(x, yaw):
    return Transform(np.array([x, 0.0, 0.0]), Rotation.from_euler("z", yaw, degrees=True))


def positions(x, yaw):
    """Of an object 1 m ahead of the base: as the package says, and by both conventions."""
    registry = Registry("world")
    added = transform(x, yaw)
    registry.add_transform("world", "base", added)
    seen = Pose(Transform(AHEAD, Rotation.identity()), "base", registry)
    world_from_base = added.as_matrix()
    ahead = np.append(AHEAD, 1)
    found = seen.get_position("world")
    by_pose = (world_from_base @ ahead)[:3]
    by_coordinates = (np.linalg.inv(world_from_base) @ ahead)[:3]
    print(f"base at x = {x}, yaw {yaw}: {found.round(2).tolist()}, by the pose"
          f" {by_pose.round(2).tolist()}, by coordinates {by_coordinates.round(2).tolist()}")

    back = seen.in_frame("world").in_frame("base").transform.translation
    assert np.allclose(back, AHEAD)
    right = registry.get_transform("world", "base") @ seen.transform
    assert np.allclose(right.translation, by_pose)
    return found, by_pose, by_coordinates


found, _, by_coordinates = positions(10.0, 0.0)
assert np.allclose(found, by_coordinates)
found, by_pose, by_coordinates = positions(10.0, 90.0)
assert np.allclose(found, (1, 10, 0)), "the position is another now"
assert not np.allclose(found, by_pose) and not np.allclose(found, by_coordinates)

base = Pose(transform(10.0, 90.0), "world", Registry("world"))
moved = base.apply_transform(transform(1.0, 0.0), None).transform.translation
print("a step of 1 m ahead from there:", moved.tolist())
assert np.allclose(moved, (11, 0, 0)), "the step is taken in the body now"
print("as stated: right for shifts, wrong for turned frames")
EOF
