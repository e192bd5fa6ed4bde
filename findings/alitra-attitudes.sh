#!/usr/bin/env bash
# SUBJECT  alitra 1.1.5 (poses of robots between map frames), with scipy 1.17.1 and numpy 2.4.6
# GUESS    transform_pose turns the attitude as it turns the position: the rotation between the
#          frames from the left, R * attitude. Applied to a point of the robot, both ways agree.
# SEEN     The position is right, the attitude is attitude * R. A robot that points along x and
#          leans by 10 degrees to its right, seen from a frame turned by 90 degrees, leans back by
#          10 degrees; a point 2 m above it is 0.49 m off. Level robots and rotations about z agree,
#          and so does the way there and back, since the inverse has the same order.
# WHY IT MATTERS
#          Maps are aligned by a yaw, robots are level in tests, and round trips pass: only a slope
#          shows it. A lidar tilted by 30 degrees on a robot looks to the wrong side in the other
#          map. Take transform.rotation and multiply from the left.
# SOURCE   Run below; transform.py (transform_rotation). 3.0.2, for Python 3.14, has the same lines.
# DATE     2026-11-28
# Needs Python 3.11 to 3.14. About 145 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
# Without the tests of numpy and scipy, with which it takes 200 MB.
extract='import sys, zipfile; wheel = zipfile.ZipFile(sys.argv[2]); wheel.extractall(
  sys.argv[1], [name for name in wheel.namelist() if "/tests/" not in name])'
for package in scipy==1.17.1 numpy==2.4.6 dacite==1.9.2 alitra==1.1.5; do
  python3 -m pip download --quiet --no-cache-dir --no-deps --dest "$dir/wheel" "$package"
  python3 -c "$extract" "$dir/site" "$dir"/wheel/*.whl
  rm -r "$dir/wheel"
done
PYTHONPATH="$dir/site" python3 -s - <<'EOF'
from importlib.metadata import version

import numpy as np
from alitra import Frame, Orientation, Pose, Position, Transform, Translation
from scipy.spatial.transform import Rotation

print(*(f"{name} {version(name)}" for name in ("alitra", "numpy", "scipy")))
ROBOT_MAP, SITE_MAP = Frame("robot_map"), Frame("site_map")
ABOVE = np.array([0, 0, 2.0])  # in the axes of the robot


def seen_from_site(yaw, pitch, roll):
    """Yaw, pitch and roll in the map of the site, and the error of a point above the robot."""
    transform = Transform.from_euler_array(
        translation=Translation(5, 3, from_=ROBOT_MAP, to_=SITE_MAP),
        euler=np.array([np.pi / 2, 0, 0]),
        from_=ROBOT_MAP,
        to_=SITE_MAP,
    )
    attitude = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True)
    place = np.array([1.0, 2.0, 0.0])
    orientation = Orientation(*attitude.as_quat(), frame=ROBOT_MAP)
    pose = Pose(Position.from_array(place, ROBOT_MAP), orientation, ROBOT_MAP)
    moved = transform.transform_pose(pose, from_=ROBOT_MAP, to_=SITE_MAP)
    turned = moved.orientation.to_rotation()
    point = Position.from_array(place + attitude.apply(ABOVE), ROBOT_MAP)
    right = transform.transform_position(point, from_=ROBOT_MAP, to_=SITE_MAP).to_array()
    metres = np.linalg.norm(moved.position.to_array() + turned.apply(ABOVE) - right)
    angles = turned.as_euler("ZYX", degrees=True)
    print(f"  {(yaw, pitch, roll)} becomes {(angles.round(1) + 0).tolist()}, {metres:.2f} m off")

    back = transform.transform_pose(moved, from_=SITE_MAP, to_=ROBOT_MAP)
    assert (back.orientation.to_rotation() * attitude.inv()).magnitude() < 1e-9
    return angles, metres


print("yaw, pitch, roll in a frame turned by 90 degrees")
angles, metres = seen_from_site(30, 0, 0)
assert np.allclose(angles, (120, 0, 0)) and metres < 1e-9
angles, metres = seen_from_site(0, 0, 10)
assert np.allclose(angles, (90, -10, 0)), "the robot leans to its right now"
assert 0.45 < metres < 0.55, "the attitude agrees with the position now"
print("as stated: the rotation between the frames is multiplied from the right")
EOF
