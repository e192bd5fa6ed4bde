#!/usr/bin/env bash
# SUBJECT  rosbags-image 0.10.4 (sensor_msgs/Image to OpenCV), with rosbags 0.11.9
# GUESS    message_to_cvimage honours step, the length of a row in bytes, as cv_bridge does.
# SEEN     It takes the first height * width pixels of the data: padding at the end of each row is
#          shown as pixels, each row starts further left than the one before, and the last rows are
#          cut. An image of 6 x 4 pixels with rows of 8 bytes comes back sheared, without an error.
# WHY IT MATTERS
#          Camera pipelines align rows to 16, 32 or 64 bytes, crops keep the step of their parent,
#          and depth and range images are measured in, not looked at. A width that is a multiple of
#          the alignment hides it. Reshape data to (height, step) and cut the rows to width first.
# SOURCE   Run below; image_to_cvimage in rosbags/image/image.py.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 85 MB and 20 s. OpenCV (160 MB) only changes colours, which is
# not asked for here: an empty module stands in for it.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  rosbags-image==0.10.4 rosbags==0.11.9 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
import sys
from importlib.metadata import version
from types import ModuleType

import numpy as np
from rosbags.typesys import Stores, get_typestore

cv2 = sys.modules["cv2"] = ModuleType("cv2")
cv2.__getattr__ = lambda name: 0 if name.startswith("COLOR_") else None
from rosbags.image import message_to_cvimage  # noqa: E402

print(*(f"{name} {version(name)}" for name in ("rosbags-image", "rosbags", "numpy")))
types = get_typestore(Stores.ROS2_JAZZY).types
HEIGHT, WIDTH = 4, 6


def seen(encoding, pixels, step):
    rows = pixels.view(np.uint8).reshape(HEIGHT, -1)
    padded = np.zeros((HEIGHT, step), np.uint8)
    padded[:, : rows.shape[1]] = rows
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "camera")
    image_type = types["sensor_msgs/msg/Image"]
    return message_to_cvimage(image_type(header, HEIGHT, WIDTH, encoding, 0, step, padded.ravel()))


for encoding, dtype in (("mono8", np.uint8), ("16UC1", np.uint16)):
    pixels = np.tile(np.arange(1, WIDTH + 1, dtype=dtype), (HEIGHT, 1))  # equal rows
    size = pixels.itemsize
    assert np.array_equal(seen(encoding, pixels, WIDTH * size), pixels)
    sheared = seen(encoding, pixels, 8 * size)
    print(f"{encoding}, rows of {8 * size} bytes for {WIDTH} pixels:", *sheared.tolist(), sep="\n  ")
    expected = np.tile([*range(1, WIDTH + 1), 0, 0], HEIGHT)[: HEIGHT * WIDTH]
    assert np.array_equal(sheared.ravel(), expected), "step is honoured now"
print("as stated: step is ignored")
EOF
