#!/usr/bin/env bash
# SUBJECT  Parameter files of ROS 2 written with PyYAML 6.0.3 and read by rcl_yaml_param_parser
#          9.2.8 of ROS 2 Jazzy, the parser of rclcpp and rclpy
# GUESS    What yaml.safe_dump writes is read as the same value of the same type: the writer quotes
#          strings that would be taken for something else.
# SEEN     It quotes by the rules of YAML 1.1; the parser of ROS has its own. These strings change:
#          "y" and "n" become booleans, "1e5" becomes 100000.0, "0089" becomes 89.0, "0x1p3" becomes
#          8.0, "inf" and "nan" become floats. The list ["x", "y", "z"] is refused for its mixed
#          types. "0012", "on" and "2026-11-28" are quoted and survive, as do floats and integers.
#          A node of rclpy 7.1.6 started with --params-file got the same values.
# WHY IT MATTERS
#          Launch files and calibration tools write such files. An axis "y", a serial number "0089"
#          or a revision "1e5" arrives as another type: it stops a node that declares a string, is
#          silently wrong in one that does not, and both only on some robots. Make PyYAML quote
#          every string: by a representer, or by default_style='"' if all values are strings.
# SOURCE   Run below. The parser takes what strtol and strtod take, and y and n as booleans.
# DATE     2026-11-28
# Needs Python 3.11 to 3.14. About 60 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  ros-rcl-yaml-param-parser==9.2.8 ros-rcutils==6.7.4 PyYAML==6.0.3
libraries=$(echo "$dir"/venv/lib/python3*/site-packages/ros_rcl_yaml_param_parser.libs)
LD_LIBRARY_PATH="$dir/venv/lib:$libraries" "$dir/venv/bin/python" - "$dir" 2>"$dir/log" <<'EOF' || { cat "$dir/log"; exit 1; }
import ctypes
import math
import sys
from importlib.metadata import version
from pathlib import Path

import yaml

folder = Path(sys.argv[1])
print(*(f"{name} {version(name)}" for name in ("ros-rcl-yaml-param-parser", "PyYAML")))


class Allocator(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in ("new", "free", "renew", "zeros", "state")]


class Strings(ctypes.Structure):
    _fields_ = [("size", ctypes.c_size_t), ("data", ctypes.POINTER(ctypes.c_char_p))]


class Value(ctypes.Structure):
    """Of the nine members of rcl_variant_t, the one that is not null holds the value."""

    _fields_ = [
        ("boolean", ctypes.POINTER(ctypes.c_bool)),
        ("integer", ctypes.POINTER(ctypes.c_int64)),
        ("double", ctypes.POINTER(ctypes.c_double)),
        ("string", ctypes.c_char_p),
        *((name, ctypes.c_void_p) for name in ("bytes", "booleans", "integers", "doubles")),
        ("strings", ctypes.POINTER(Strings)),
    ]


rcutils = ctypes.CDLL("librcutils.so", ctypes.RTLD_GLOBAL)
rcutils.rcutils_get_default_allocator.restype = Allocator
parser = ctypes.CDLL("librcl_yaml_param_parser.so")
parser.rcl_yaml_node_struct_init.restype = ctypes.c_void_p
parser.rcl_yaml_node_struct_init.argtypes = [Allocator]
parser.rcl_parse_yaml_file.restype = ctypes.c_bool
parser.rcl_parse_yaml_file.argtypes = [ctypes.c_char_p, ctypes.c_void_p]
parser.rcl_yaml_node_struct_get.restype = ctypes.POINTER(Value)
parser.rcl_yaml_node_struct_get.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_void_p]


def written_and_read(value, **style):
    path = folder / "parameters.yaml"
    path.write_text(yaml.safe_dump({"node": {"ros__parameters": {"value": value}}}, **style))
    parameters = parser.rcl_yaml_node_struct_init(rcutils.rcutils_get_default_allocator())
    if not parser.rcl_parse_yaml_file(str(path).encode(), parameters):
        raise ValueError("refused")
    read = parser.rcl_yaml_node_struct_get(b"node", b"value", parameters).contents
    if read.strings:
        strings = read.strings.contents
        return [strings.data[i].decode() for i in range(strings.size)]
    if read.string is not None:
        return read.string.decode()
    return next(p[0] for p in (read.boolean, read.integer, read.double) if p)


CHANGED = {"y": True, "n": False, "1e5": 1e5, "0089": 89.0, "0x1p3": 8.0, "inf": math.inf}
for string, expected in CHANGED.items():
    read = written_and_read(string)
    print(f"{string!r} written, {read!r} read")
    assert (type(read), read) == (type(expected), expected), "read otherwise now"
assert math.isnan(written_and_read("nan"))
for value in ("x", "0012", "on", "2026-11-28", "1_000", 1e-5, 1e16, 2**40, ["x", "z"]):
    assert written_and_read(value) == value, f"{value!r} changes now"
axes = ["x", "y", "z"]
try:
    written_and_read(axes)
except ValueError as error:
    print(axes, "written,", error)
else:
    raise AssertionError("a list of axes is read now")
for value in (*CHANGED, axes):
    assert written_and_read(value, default_style='"') == value, "quoting all does not help now"
print("as stated: strings that PyYAML leaves bare change their type")
EOF
