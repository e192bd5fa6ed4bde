#!/usr/bin/env bash
# SUBJECT  pybag-sdk 0.13.0 (ROS bags in Python), with mcap 1.6.0 and rosbags 0.11.9
# GUESS    Reading a topic of an MCAP file returns all of its messages, from however many
#          channels: a channel per publisher is usual, and merging two files makes them too.
# SEEN     Only one channel of the topic is read. Of ten messages on /tf by two publishers, pybag
#          returns the five of the first; its message count is 5 as well, and its list of topics
#          names /tf twice. A pattern such as "/*" changes nothing. The readers of mcap and of
#          rosbags return all ten.
# WHY IT MATTERS
#          /tf and /diagnostics have many publishers. Half of the transforms missing looks like a
#          slow localisation, not like a reader that leaves data out, since the count agrees.
# SOURCE   Run below; McapFileReader.messages and get_message_count; the MCAP specification
#          allows several channels of one topic.
# DATE     2026-11-27
# Needs Python 3.11 or newer. About 130 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  pybag-sdk==0.13.0 mcap==1.6.0 rosbags==0.11.9 numpy==2.4.6
"$dir/venv/bin/python" - "$dir" <<'EOF'
import struct
import sys
from importlib.metadata import version
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from pybag.mcap_reader import McapFileReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

print(*(f"{name} {version(name)}" for name in ("pybag-sdk", "mcap", "rosbags")))
path = Path(sys.argv[1]) / "two_publishers.mcap"
sent = [f"{'ab'[i % 2]}{i}" for i in range(10)]


def encoded(text):
    """A std_msgs/String as CDR."""
    data = text.encode() + b"\0"
    return b"\0\1\0\0" + struct.pack("<I", len(data)) + data


with path.open("wb") as file:
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start(profile="ros2", library="")
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    channels = [writer.register_channel("/tf", "cdr", schema, {"node": node}) for node in "ab"]
    for i, text in enumerate(sent):
        stamp = i * 100_000_000
        writer.add_message(channels[i % 2], stamp, encoded(text), stamp, i)
    writer.finish()

with path.open("rb") as file:
    by_mcap = [message.data[8:-1].decode() for _, _, message in make_reader(file).iter_messages()]
print("mcap   ", by_mcap)

with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
    by_rosbags = [
        reader.deserialize(data, connection.msgtype).data
        for connection, _, data in reader.messages()
    ]
print("rosbags", by_rosbags)

with McapFileReader.from_file(path) as reader:
    topics, count = list(reader.get_topics()), reader.get_message_count("/tf")
    by_pybag = [message.data.data for message in reader.messages("/tf")]
    by_pattern = [message.data.data for message in reader.messages("/*")]
print("pybag  ", by_pybag, "count", count, "topics", topics)

assert by_mcap == by_rosbags == sent
assert topics == ["/tf", "/tf"], topics
assert by_pybag == by_pattern == sent[::2], "pybag reads the second channel now"
assert count == len(by_pybag)
print("as stated: one channel of a topic is read")
EOF
