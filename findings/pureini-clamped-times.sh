#!/usr/bin/env bash
# SUBJECT  pureini 0.10.0 (compression of Cloudini), with numpy 2.4.6
# GUESS    A resolution of 0.001 rounds FLOAT32 fields to a thousandth, however large the values
#          are: differences are stored as integers of any length.
# SEEN     Values are clamped without an error to 2**31 resolutions, here to 2,147,483.75, if the
#          field lies right behind x, y, z. With another field between them it depends on the
#          version that is written: 3 and 4 keep them (to 8), 5 clamps. Times of 0 to 1e8 ns end at
#          2.1 ms.
#          Infinities become NaN, -0.0 becomes 0.0.
# WHY IT MATTERS
#          The transport plugin gives all FLOAT32 fields the resolution of x, y and z. Of times in
#          nanoseconds 98 % are then one value, which a deskewing program takes for the time of one
#          moment; and the difference of "no return" (+inf) and "not measured" (NaN) is lost.
# SOURCE   Run below; cloudini_ros/src/conversion_utils.cpp of Cloudini d202e52 for the resolution.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 80 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  pureini==0.10.0 numpy==2.4.6
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import numpy as np
import pureini

print("pureini", version("pureini"), "numpy", np.__version__)
KINDS = {"f": pureini.FieldType.FLOAT32, "u": pureini.FieldType.UINT16}
TIMES_NS = np.linspace(0, 1e8, 6, dtype=np.float32)
LIMIT = np.float32(2**31 * 0.001)


def times_back(between, values, format_version):
    fields = [*((axis, "<f4") for axis in "xyz"), *between, ("time", "<f4")]
    points = np.zeros(len(values), fields)
    points["time"] = values
    info = pureini.EncodingInfo(
        [
            pureini.PointField(
                name, offset, KINDS[scalar.kind], 0.001 if scalar.kind == "f" else None
            )
            for name, (scalar, offset) in points.dtype.fields.items()
        ],
        len(points),
        1,
        points.itemsize,
        pureini.EncodingOptions.LOSSY,
        pureini.CompressionOption.ZSTD,
        format_version,
    )
    encoded = pureini.PointcloudEncoder(info).encode(points.tobytes())
    decoded, _ = pureini.PointcloudDecoder().decode(encoded)
    return np.frombuffer(decoded, points.dtype)["time"]


for format_version in (3, 4, 5):
    behind = times_back([], TIMES_NS, format_version)
    apart = times_back([("ring", "<u2")], TIMES_NS, format_version)
    print(f"version {format_version}: {behind.tolist()} behind z, {apart.tolist()} behind ring")
    assert np.all(behind[1:] == LIMIT), "times behind z are not clamped now"
    is_clamped = bool(np.all(apart[1:] == LIMIT))
    assert is_clamped == (format_version == 5), "times behind ring are treated otherwise now"
    assert is_clamped or np.allclose(apart, TIMES_NS, atol=8), "and are not kept"

odd = times_back([], [np.inf, -np.inf, np.nan, -0.0], 5)
print("inf, -inf, nan, -0.0:", odd.tolist())
assert np.isnan(odd[:3]).all() and not np.signbit(odd[3]), "special values are kept now"
print("as stated: large values are clamped, infinities are lost")
EOF
