#!/usr/bin/env bash
# SUBJECT  Time ranges of MCAP readers: mcap 1.6.0, rosbags 0.11.9, pybag-sdk 0.13.0 (Python) and
#          @mcap/core 2.2.2 (npm)
# GUESS    All readers of a bag exclude the end of a time range, as Python ranges do.
# SEEN     mcap and rosbags exclude it, pybag and @mcap/core include it. For 0.1 s to 0.3 s of a
#          10 Hz topic the first two return sweeps 1 and 2, the others 1, 2 and 3. From 0.2 s to
#          0.2 s: nothing, or sweep 2. In mcap 1.6.0, start_time and end_time raise a
#          DeprecationWarning; ending_before and ending_at replace end_time.
# WHY IT MATTERS
#          Cut a recording into windows back to back, and with two of the readers the sweep at
#          each border is evaluated twice; ask for first stamp to last stamp, and with the other
#          two the last sweep is missing. Stamps on a border are the rule: lidars that are
#          synchronised to the second start their sweeps at multiples of 0.1 s.
# SOURCE   Run below, with iter_messages (mcap), AnyReader.messages (rosbags),
#          McapFileReader.messages (pybag), McapIndexedReader.readMessages (@mcap/core).
# DATE     2026-11-27
# Needs Python 3.11 or newer, Node.js 18 or newer and npm. About 130 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  mcap==1.6.0 rosbags==0.11.9 pybag-sdk==0.13.0 numpy==2.4.6
npm install --loglevel=error --no-audit --no-fund --prefix "$dir" --cache "$dir/cache" @mcap/core@2.2.2

cat > "$dir/read.cjs" <<'EOF'
const { readFileSync } = require("node:fs");
const { McapIndexedReader } = require("@mcap/core");
const [path, ...times] = process.argv.slice(2);
const [startTime, endTime] = times.map(BigInt);
const bytes = readFileSync(path);
const readable = {
  size: async () => BigInt(bytes.length),
  read: async (at, length) => new Uint8Array(bytes.subarray(Number(at), Number(at + length))),
};
McapIndexedReader.Initialize({ readable }).then(async (reader) => {
  const found = [];
  for await (const message of reader.readMessages({ startTime, endTime })) {
    found.push(message.sequence);
  }
  console.log(JSON.stringify(found));
});
EOF
"$dir/venv/bin/python" -W ignore::DeprecationWarning - "$dir" <<'EOF'
import json
import struct
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from pybag.mcap_reader import McapFileReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

folder = Path(sys.argv[1])
path = folder / "sweeps.mcap"
core = json.loads((folder / "node_modules/@mcap/core/package.json").read_text())["version"]
print(*(f"{name} {version(name)}" for name in ("mcap", "rosbags", "pybag-sdk")), "@mcap/core", core)

STEP = 100_000_000  # ns
with path.open("wb") as file:
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start(profile="ros2", library="")
    schema = writer.register_schema("std_msgs/msg/UInt32", "ros2msg", b"uint32 data")
    channel = writer.register_channel("/sweep", "cdr", schema)
    for i in range(6):
        data = b"\0\1\0\0" + struct.pack("<I", i)
        writer.add_message(channel, i * STEP, data, i * STEP, i)
    writer.finish()


def with_mcap(start, end):
    with path.open("rb") as file:
        messages = make_reader(file).iter_messages(start_time=start, end_time=end)
        return [message.sequence for _, _, message in messages]


def with_rosbags(start, end):
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        return [stamp // STEP for _, stamp, _ in reader.messages(start=start, stop=end)]


def with_pybag(start, end):
    with McapFileReader.from_file(path) as reader:
        return [message.data.data for message in reader.messages("/sweep", start, end)]


def with_core(start, end):
    command = ["node", str(folder / "read.cjs"), str(path), str(start), str(end)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


for start, end in ((1, 3), (2, 2)):
    got = {
        read.__name__: read(start * STEP, end * STEP)
        for read in (with_mcap, with_rosbags, with_pybag, with_core)
    }
    print(f"{start / 10} s to {end / 10} s: {got}")
    assert got["with_mcap"] == got["with_rosbags"] == list(range(start, end)), "end included now"
    assert got["with_pybag"] == got["with_core"] == list(range(start, end + 1)), "end excluded now"
print("as stated: two readers exclude the end of a range, two include it")
EOF
