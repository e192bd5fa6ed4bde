#!/usr/bin/env bash
# SUBJECT  small-mcap 0.16.0 (read_message), compared with mcap 1.6.0 (Python)
# GUESS    An indexed file is read in the order of log_time, forward as well as in reverse; messages
#          of equal time keep their order in the file.
# SEEN     Forward, the messages of one topic in one chunk come as they were written: stamps of 0,
#          30, 10, 40, 20 and 50 ms are returned in that order, with reverse=True as 50, 40, ... 0.
#          Two topics are merged as if each were sorted: a second one puts 35 after 30 and before
#          10. Messages of equal time come topic by topic. mcap returns all of them in order.
# WHY IT MATTERS
#          Two publishers of /tf, files that were merged or stamped with header times, and every
#          simulation (equal stamps) have such messages. Buffers of transforms refuse or drop what
#          is older than the newest, filters step back in time, and a run in reverse disagrees.
# SOURCE   Run below; _breakup_chunk_data_with_indexes in small_mcap/reader.py.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 30 MB and 10 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  small-mcap==0.16.0 mcap==1.6.0
"$dir/venv/bin/python" - "$dir/transforms.mcap" <<'EOF'
import sys
from importlib.metadata import version
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from small_mcap import read_message

print(*(f"{name} {version(name)}" for name in ("small-mcap", "mcap")))
path = Path(sys.argv[1])


def write(*messages):
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="", library="")
        channels = {
            topic: writer.register_channel(topic, "json", 0)
            for topic in dict.fromkeys(topic for topic, _ in messages)
        }
        for number, (topic, stamp) in enumerate(messages):
            writer.add_message(channels[topic], stamp, b"{}", stamp, number)
        writer.finish()


def read(reader, reverse):
    with path.open("rb") as file:
        if reader == "mcap":
            messages = make_reader(file).iter_messages(reverse=reverse)
        else:
            messages = read_message(file, reverse=reverse)
        return [(channel.topic, message.log_time) for _, channel, message in messages]


def check(title, messages, expected):
    write(*messages)
    in_order = sorted(messages, key=lambda message: message[1])
    got = read("small-mcap", False)
    print(f"{title}: {got}")
    assert got == expected, "read otherwise now"
    assert read("mcap", False) == in_order != got
    backward = [stamp for _, stamp in read("small-mcap", True)]
    assert backward == sorted((stamp for _, stamp in messages), reverse=True)


steps = [("/tf", stamp) for stamp in (0, 30, 10, 40, 20, 50)]
check("one topic", steps, steps)
later = [("/odom", stamp + 5) for _, stamp in steps]
merged = [0, 5, 30, 10, 35, 15, 40, 20, 45, 25, 50, 55]
check("two topics", steps + later, [("/odom" if at % 10 else "/tf", at) for at in merged])
pairs = [("/tf", 0), ("/scan", 0)] * 2
check("equal times", pairs, [("/tf", 0)] * 2 + [("/scan", 0)] * 2)
print("as stated: forward reading takes each topic as sorted")
EOF
