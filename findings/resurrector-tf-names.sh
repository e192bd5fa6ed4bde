#!/usr/bin/env bash
# SUBJECT  rosbag-resurrector 0.8.7 (analysis of ROS 2 bags), transforms of /tf; input by
#          rosbags 0.11.9
# GUESS    parse_tf_message reads every transform of a tf2_msgs/TFMessage.
# SEEN     It reads a transform only if the name of the parent frame has a length of 3, 7, 11, ...:
#          strings of CDR begin at multiples of four bytes, and the parser does not go on to the
#          next multiple after the first name. map -> odom is read; odom -> base_link, and all
#          that follow it in the same message, are left out, without an error or a log. So a
#          tree of map, odom, base_link and velodyne has one edge, and TFTree.chain returns None
#          for velodyne in base_link.
# WHY IT MATTERS
#          The same parser feeds the topic as a table, the list of frames of a contract and the
#          3-D view. A bag with complete transforms looks as if its publishers had been
#          missing. Count the transforms with another reader.
# SOURCE   Run below; _parse_transform_stamped and _read_cdr_string in resurrector/core/scene.py.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 130 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  rosbags==0.11.9 numpy==2.4.6
# The module below needs NumPy alone; the dependencies of the whole package are several 100 MB.
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile --no-deps \
  rosbag-resurrector==0.8.7
"$dir/venv/bin/python" - <<'EOF'
import importlib.util
import sys
from importlib.metadata import distribution, version

from rosbags.typesys import Stores, get_typestore

path = distribution("rosbag-resurrector").locate_file("resurrector/core/scene.py")
spec = importlib.util.spec_from_file_location("scene", path)
scene = sys.modules["scene"] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(scene)
print(*(f"{name} {version(name)}" for name in ("rosbag-resurrector", "rosbags", "numpy")))

store = get_typestore(Stores.ROS2_JAZZY)
kinds = {name.rsplit("/", 1)[1]: kind for name, kind in store.types.items()}
KIND = "tf2_msgs/msg/TFMessage"


def stamped(parent, child):
    return store.types["geometry_msgs/msg/TransformStamped"](
        header=store.types["std_msgs/msg/Header"](kinds["Time"](sec=5, nanosec=0), parent),
        child_frame_id=child,
        transform=kinds["Transform"](
            translation=kinds["Vector3"](x=1.0, y=0.0, z=0.0),
            rotation=kinds["Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        ),
    )


def serialized(*edges):
    message = store.types[KIND](transforms=[stamped(*edge) for edge in edges])
    data = bytes(store.serialize_cdr(message, KIND))
    assert len(store.deserialize_cdr(data, KIND).transforms) == len(edges)
    return data


def read(*edges):
    transforms = scene.parse_tf_message(serialized(*edges))
    return [(found.parent_frame, found.child_frame) for found in transforms]


for parent in ("map", "odom", "world", "base_link", "os_lidar", "vehicle"):
    found = read((parent, "velodyne"))
    print(f"{parent} -> velodyne: {len(found)} of 1 transforms read")
    assert found == ([(parent, "velodyne")] if len(parent) % 4 == 3 else []), found

edges = [("map", "odom"), ("odom", "base_link"), ("base_link", "velodyne")]
found = read(*edges)
print(f"{len(edges)} transforms in one message: {found}")
assert found == edges[:1]

tree = scene.TFTree()
for edge in edges:
    tree.add_many(scene.parse_tf_message(serialized(edge)))
print("frames", sorted(tree.frames()), "velodyne in base_link:",
      tree.chain("base_link", "velodyne", 5_000_000_000))
assert tree.frames() == {"map", "odom"}
assert tree.chain("base_link", "velodyne", 5_000_000_000) is None
print("as stated: transforms are left out by the length of their parent's name")
EOF
