#!/usr/bin/env bash
# SUBJECT  laspy 2.7.0 (LAS and LAZ files), with numpy 2.4.6
# GUESS    LAS stores integers, so laspy refuses a coordinate that is NaN just as it refuses one
#          that is infinite or out of range (OverflowError).
# SEEN     Infinite: OverflowError. One NaN set alone: ValueError. An array with a NaN: accepted,
#          with a RuntimeWarning of numpy about a cast at most; the file then holds a finite
#          point. On x86 it is the smallest integer: x = -2147483.648 m with a scale of 1 mm.
#          The range check compares the minimum and maximum of the array; with a NaN in it both
#          are NaN and nothing is out of range, so neighbours in the array are not checked
#          either: 1e7 m, refused otherwise, is stored as another finite number.
# WHY IT MATTERS
#          Organised clouds of ROS drivers mark rays without a return by NaN. Written to LAS they
#          become points thousands of kilometres away that stretch the bounding box, and no
#          reader can tell them from measurements. Remove them first.
# SOURCE   Run below; ScaledArrayView.__setitem__ in this version.
# DATE     2026-11-27
# Needs Python 3.11 or newer. About 110 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  laspy==2.7.0 numpy==2.4.6
"$dir/venv/bin/python" -W ignore::RuntimeWarning - "$dir" <<'EOF'
import sys

import laspy
import numpy as np

print("laspy", laspy.__version__, "numpy", np.__version__)


def cloud():
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales, header.offsets = [0.001] * 3, [0.0] * 3
    las = laspy.LasData(header)
    las.xyz = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]])
    return las


def refused(x, kind):
    try:
        cloud().x = np.array(x)
    except kind as error:
        print(f"x = {x}: {type(error).__name__}")
        return True
    return False


assert refused([1.0, np.inf, 7.0], OverflowError)
assert refused([1.0, 4.0, 1e7], OverflowError)
assert refused([1.0, 4.0, -1e7], OverflowError)

for x in ([1.0, np.nan, 7.0], [1.0, np.nan, 1e7]):
    las = cloud()
    las.x = np.array(x)  # neither refused nor marked
    path = f"{sys.argv[1]}/cloud.las"
    las.write(path)
    back = laspy.read(path)
    print(f"x = {x}: read back as {list(map(float, back.x))}, mins[0] = {back.header.mins[0]}")
    assert len(back) == 3, "rays without a return are dropped now"
    assert np.isfinite(back.xyz).all()
    assert back.x[0] == 1.0
    assert not np.isclose(back.x[2], 1e7), "1e7 m fits now"
print("as stated: NaN is stored as a finite coordinate and disables the range check")
EOF
