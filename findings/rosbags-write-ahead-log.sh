#!/usr/bin/env bash
# SUBJECT  rosbags 0.11.9 (ROS bags in Python), with the sqlite3 of Python
# GUESS    A .db3 whose recorder was killed is read by SQLite, so messages in the write-ahead log
#          beside it (FILE.db3-wal) are read like all others: SQLite does so for every program.
# SEEN     The log is ignored without a word. Of ten messages rosbags returns the five in the
#          .db3; SQLite itself finds ten. The count of rosbags is that of metadata.yaml, ten.
# WHY IT MATTERS
#          A recorder with journal_mode=WAL (rosbag2 of Foxy) that is killed leaves the last
#          seconds, often those of the crash, in the log. A tool that rewrites such a bag drops
#          them for good, and the count looks right.
# SOURCE   Run below; it opens the database with immutable=1, for which SQLite documents that
#          changes beside the file are not looked at.
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 80 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  rosbags==0.11.9 numpy==2.4.6
"$dir/venv/bin/python" - "$dir" <<'EOF'
import shutil
import sqlite3
import sys
from importlib.metadata import version
from pathlib import Path

from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

print(f"rosbags {version('rosbags')}, SQLite {sqlite3.sqlite_version}")
root = Path(sys.argv[1])
store = get_typestore(Stores.ROS2_JAZZY)
kind = "std_msgs/msg/String"


def encoded(number):
    """A std_msgs/String as CDR."""
    return store.serialize_cdr(store.types[kind](data=str(number)), kind)


def killed(name, in_file):
    """A bag of ten messages as its recorder leaves it: so many in the .db3, all others in the log."""
    bag = root / f"{name}_live"
    with Writer(bag, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/status", kind, typestore=store)
        for number in range(10):
            writer.write(connection, number + 1, encoded(number))
    (file,) = bag.glob("*.db3")
    database = sqlite3.connect(file, isolation_level=None)
    rows = database.execute("SELECT * FROM messages ORDER BY id").fetchall()
    database.execute("DELETE FROM messages")
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("PRAGMA wal_autocheckpoint=0")
    for number, row in enumerate(rows):
        if number == in_file:
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        database.execute(f"INSERT INTO messages VALUES ({', '.join('?' * len(row))})", row)
    left = root / name
    shutil.copytree(bag, left)
    database.close()
    return left


bag = killed("killed", 5)
print("files  ", sorted(file.name for file in bag.iterdir()))

with Reader(bag) as reader:
    told = reader.message_count
    by_rosbags = [store.deserialize_cdr(raw, kind).data for _, _, raw in reader.messages()]
print("rosbags", by_rosbags, "of", told)

(file,) = bag.glob("*.db3")
by_sqlite = sqlite3.connect(file).execute("SELECT count(*) FROM messages").fetchone()[0]
print("SQLite ", by_sqlite)

assert by_sqlite == 10
assert told == 10, told
assert by_rosbags == [str(number) for number in range(5)], "rosbags reads the log now"
print("as stated: the write-ahead log is ignored, the count is that of metadata.yaml")
EOF
