#!/usr/bin/env bash
# SUBJECT  mcap-bag-parser 0.3.1 (bags to pandas, with rosx_introspection), with mcap 1.6.0
# GUESS    parse_mcap_file gives every number of a message a column, or says what it leaves out.
# SEEN     Arrays of more than 100 elements are left out whole, without a word: a scan of 100 ranges
#          has 100 columns ranges.0 to ranges.99, one of 101 has none. If the length changes within
#          a topic, the rows of the long messages hold NaN. What follows the array is read right.
# WHY IT MATTERS
#          Every laser scanner measures more than 100 ranges, and most joint trajectories, event
#          packets and polygons cross that length at times: "no value" then means "many values".
#          Count the columns, or read such topics with mcap-ros2-support.
# SOURCE   Run below.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 150 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip pandas==3.1.1 numpy==2.4.6
rm -r "$dir"/venv/lib/python3*/site-packages/pandas/tests  # 30 MB
pip mcap-bag-parser==0.3.1 mcap==1.6.0
"$dir/venv/bin/python" - "$dir/scan.mcap" <<'EOF'
import struct
import sys
from importlib.metadata import version
from pathlib import Path

import mcap_bag
from mcap.writer import Writer

print(*(f"{name} {version(name)}" for name in ("mcap-bag-parser", "mcap", "pandas")))
path = Path(sys.argv[1])
DEFINITION = b"float32[] ranges\nfloat32 range_max\n"


def columns_of(*lengths):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="")
        schema = writer.register_schema("test_msgs/msg/Scan", "ros2msg", DEFINITION)
        channel = writer.register_channel("/scan", "cdr", schema)
        for stamp, length in enumerate(lengths):
            ranges = [float(k) for k in range(length)]
            data = b"\0\1\0\0" + struct.pack(f"<I{length + 1}f", length, *ranges, 30)
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    frame = mcap_bag.parse_mcap_file(str(path))["/scan"]
    assert (frame["range_max"] == 30).all()
    return frame.filter(regex=r"^ranges")


for length, expected in ((99, 99), (100, 100), (101, 0), (720, 0)):
    found = columns_of(length).shape[1]
    print(f"{length} ranges written, {found} columns")
    assert found == expected, "the limit is another one now"
mixed = columns_of(3, 720, 3)
print(mixed.to_string())
assert mixed.shape == (3, 3) and mixed.isna().all(axis=1).tolist() == [False, True, False]
print("as stated: arrays of more than 100 elements are left out")
EOF
