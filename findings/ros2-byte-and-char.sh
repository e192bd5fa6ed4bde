#!/usr/bin/env bash
# SUBJECT  byte and char of ROS 2 messages in rosbags 0.11.9, mcap-ros2-support 0.6.0 and
#          mcap-ros2-support-fast 0.8.0 (Python)
# GUESS    Both types are numbers from 0 to 255 in every reader: ROS 2 maps byte to octet and
#          char to uint8.
# SEEN     The value 200, sent as either type:
#            rosbags                 byte -56   char 200
#            mcap-ros2-support       byte 200   char -56
#            mcap-ros2-support-fast  byte 200   char 200
#          Each of the first two is wrong for the type that the other gets right. In arrays it is
#          the same, except that mcap-ros2-support returns bytes for byte[]. Writing 200 as a byte
#          with rosbags raises struct.error. Values below 128 are right everywhere.
# WHY IT MATTERS
#          Packets of sensors are recorded as byte[], and labels or ring numbers as char[]. A
#          decoder that is fed -56 where 0xC8 was sent fails, or masks half of its fields, and two
#          readers that disagree can both be wrong. View such arrays as uint8.
# SOURCE   Run below; MSG_TYPE_TO_IDL in rosidl_adapter of github.com/ros2/rosidl maps byte to
#          octet and char to uint8, and the C++ generator makes both unsigned.
# DATE     2026-11-27
# Needs Python 3.11 or newer. About 130 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  rosbags==0.11.9 mcap==1.6.0 mcap-ros2-support==0.6.0 mcap-ros2-support-fast==0.8.0 numpy==2.4.6
"$dir/venv/bin/python" - "$dir" <<'EOF'
import struct
import sys
from importlib.metadata import version
from pathlib import Path

import mcap_ros2.decoder
import mcap_ros2_support_fast
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

names = ("rosbags", "mcap-ros2-support", "mcap-ros2-support-fast", "mcap")
print(*(f"{name} {version(name)}" for name in names))

TYPE = "packets/msg/Packet"
TEXT = "byte a_byte\nchar a_char\nbyte[] bytes\nchar[] chars\n"
# Little-endian CDR: two octets, padding to 4, then two sequences of one octet.
CDR = b"\0\1\0\0" + bytes([200, 200, 0, 0]) + struct.pack("<IB3xIB", 1, 200, 1, 200)

path = Path(sys.argv[1]) / "packets.mcap"
with path.open("wb") as file:
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start(profile="ros2", library="")
    schema = writer.register_schema(TYPE, "ros2msg", TEXT.encode())
    writer.add_message(writer.register_channel("/packets", "cdr", schema), 0, CDR, 0)
    writer.finish()


def numbers(message):
    """a_byte, a_char, bytes[0], chars[0] as integers, as a reader gives them."""
    arrays = (message.bytes[0], message.chars[0])
    return [int(value) for value in (message.a_byte, message.a_char, *arrays)]


def decoded(factory):
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[factory])
        return next(iter(reader.iter_decoded_messages())).decoded_message


store = get_typestore(Stores.EMPTY)
store.register(get_types_from_msg(TEXT, TYPE))
message = store.deserialize_cdr(CDR, TYPE)
got = {
    "rosbags": numbers(message),
    "mcap-ros2-support": numbers(decoded(mcap_ros2.decoder.DecoderFactory())),
    "mcap-ros2-support-fast": numbers(decoded(mcap_ros2_support_fast.DecoderFactory())),
}
print(f"{'':24}byte  char  byte[]  char[]")
for name, values in got.items():
    print(f"{name:24}" + "{:4}  {:4}  {:6}  {:6}".format(*values))
assert got["rosbags"] == [-56, 200, -56, 200], "rosbags has changed"
assert got["mcap-ros2-support"] == [200, -56, 200, -56], "mcap-ros2-support has changed"
assert got["mcap-ros2-support-fast"] == [200] * 4, "mcap-ros2-support-fast has changed"

message.a_byte = 200
try:
    store.serialize_cdr(message, TYPE)
except struct.error as error:
    print("rosbags writing 200 as byte:", error)
else:
    raise SystemExit("rosbags writes it now")
print("as stated: rosbags has a signed byte, mcap-ros2-support a signed char")
EOF
