#!/usr/bin/env bash
# SUBJECT  alitra 1.1.5, frame-transforms 0.3.1, pose3d 2.1.0, transform-tree 0.0.9 (trees of frames
#          without ROS), with numpy 2.4.6 and scipy 1.17.1
# GUESS    Each answers what its readme asks, where something seen from one frame is in another: the
#          pose of the frame times the pose that was seen, or its inverse by another convention.
# SEEN     A robot at (10, 0) in the map points along y, and sees 1 m ahead something that leans by
#          10 degrees to its right. Right is (10, 1) with yaw 90 and roll 10: transform-tree. alitra
#          has the place, but multiplies the attitudes the other way around: leaning back.
#          frame-transforms does so with places, too: (1, 9.8, 1.7); the inverse has (0, 9, 0).
#          pose3d does not turn the offset and has its sign wrong: (-10, 1), and (-9, 0) without any
#          rotation. There and back is the pose again for the first two, (11, 10) for pose3d.
# WHY IT MATTERS
#          Level robots, rotations about z, shifts alone and round trips hide one or the other, and
#          tests are made of those. A tilted lidar, or a base that is turned, puts detections metres
#          away. Ask for a pose with roll, seen from a frame with yaw and offset, before taking one.
# SOURCE   Run below; alitra/transform.py (transform_rotation; 3.0.2, for Python 3.14, is alike),
#          frame_transforms/transforms.py (in_frame), pose3d/transform.py (between_poses).
# DATE     2026-11-28
# Needs Python 3.11 to 3.14 on Linux. About 150 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
# Without the tests of numpy and scipy, with which it takes 200 MB.
extract='import sys, zipfile; wheel = zipfile.ZipFile(sys.argv[2]); wheel.extractall(
  sys.argv[1], [name for name in wheel.namelist() if "/tests/" not in name])'
for package in scipy==1.17.1 numpy==2.4.6 alitra==1.1.5 dacite==1.9.2 frame-transforms==0.3.1 \
  pose3d==2.1.0 toml==0.10.2 transform-tree==0.0.9; do
  python3 -m pip download --quiet --no-cache-dir --no-deps --dest "$dir/wheel" "$package"
  python3 -c "$extract" "$dir/site" "$dir"/wheel/*.whl
  rm -r "$dir/wheel"
done
PYTHONPATH="$dir/site" python3 -s - <<'EOF'
from importlib.metadata import version

import alitra
import frame_transforms
import numpy as np
import pose3d
import tf_tree
from scipy.spatial.transform import Rotation

PACKAGES = ("alitra", "frame-transforms", "pose3d", "transform-tree", "numpy", "scipy")
print(*(f"{name} {version(name)}" for name in PACKAGES))
AHEAD, LEANING = np.array([1.0, 0, 0]), Rotation.from_euler("x", 10, degrees=True)
PLACE = np.array([10.0, 0, 0])


def by_alitra(turn):
    robot, world = alitra.Frame("robot"), alitra.Frame("map")
    offset = alitra.Translation.from_array(PLACE, from_=robot, to_=world)
    tree = alitra.Transform(translation=offset, from_=robot, to_=world, rotation=turn)
    orientation = alitra.Orientation(*LEANING.as_quat(), frame=robot)
    seen = alitra.Pose(alitra.Position.from_array(AHEAD, robot), orientation, robot)
    found = tree.transform_pose(seen, from_=robot, to_=world)
    back = tree.transform_pose(found, from_=world, to_=robot)
    place, again = (pose.position.to_array() for pose in (found, back))
    return place, found.orientation.to_rotation(), again


def by_frame_transforms(turn):
    tree = frame_transforms.Registry("map")
    tree.add_transform("map", "robot", frame_transforms.Transform(PLACE, turn))
    seen = frame_transforms.Pose(frame_transforms.Transform(AHEAD, LEANING), "robot", tree)
    found = seen.in_frame("map")
    again = found.in_frame("robot").transform.translation
    return found.transform.translation, found.transform.rotation, again


def by_pose3d(turn):
    def pose(position, rotation):
        result = pose3d.Pose()
        result.position.vector = position
        result.orientation.from_quat(rotation.as_quat())
        return result

    tree = pose3d.TransformSet({})  # with a frame "base" at the origin
    tree.add_frame("robot", pose(PLACE, turn))
    found = tree.change_frame(pose(AHEAD, LEANING), from_frame="robot", to_frame="base")
    back = tree.change_frame(found, from_frame="base", to_frame="robot")
    rotation = Rotation.from_quat(found.orientation.as_quat())
    return found.position.vector, rotation, back.position.vector


def by_transform_tree(turn):
    tree = tf_tree.build([("map", "robot")])
    x, y, z, w = turn.as_quat()
    tf_tree.push(tree, "robot", "map", 1, [w, x, y, z, *PLACE])
    there, back = tree.plan("map", "robot").at(1), tree.plan("robot", "map").at(1)
    place = there[:3, :3] @ AHEAD + there[:3, 3]
    return place, Rotation.from_matrix(there[:3, :3]) * LEANING, back[:3, :3] @ place + back[:3, 3]


def check(answer, yaw, expected, angles, again):
    place, rotation, back = answer(Rotation.from_euler("z", yaw, degrees=True))
    found = rotation.as_euler("ZYX", degrees=True)
    print(f"  {answer.__name__:20} {(place.round(2) + 0).tolist()}, yaw, pitch, roll"
          f" {(found.round(1) + 0).tolist()}, and back {(back.round(2) + 0).tolist()}")
    assert np.allclose(place, expected, atol=1e-6), "the place is another now"
    assert np.allclose(found, angles, atol=1e-6), "the attitude is another now"
    assert np.allclose(back, again, atol=1e-6), "the way back is another now"


print("robot turned by 90 degrees")
check(by_transform_tree, 90, (10, 1, 0), (90, 0, 10), AHEAD)
check(by_alitra, 90, (10, 1, 0), (90, -10, 0), AHEAD)
check(by_frame_transforms, 90, (1, 9.848078, 1.736482), (-90, 10, 0), AHEAD)
check(by_pose3d, 90, (-10, 1, 0), (90, 0, 10), (11, 10, 0))
print("robot not turned")
check(by_transform_tree, 0, (11, 0, 0), (0, 0, 10), AHEAD)
check(by_alitra, 0, (11, 0, 0), (0, 0, 10), AHEAD)
check(by_pose3d, 0, (-9, 0, 0), (0, 0, 10), AHEAD)
print("as stated: one question, four answers")
EOF
