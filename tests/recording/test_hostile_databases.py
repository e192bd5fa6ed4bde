# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Small databases that make SQLite compute for ever, or more than they hold."""

from __future__ import annotations

import contextlib
import struct
import subprocess
import sys
from itertools import pairwise

import apsw
import pytest
import tiny_bags

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.recording.sqlite_limits import limit_database

ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c)"
INTERIOR_PAGE = 5
READ = """import sys
from mnsf_ros.recording.inspection import inspect_recording
inspect_recording(sys.argv[1])"""


def changed(path, script, **options):
    file = tiny_bags.write_sqlite(path, **options) / "bag.db3"
    with contextlib.closing(apsw.Connection(str(file))) as database:
        # Statements after one that returns rows are run when its rows are read.
        list(database.execute(script))
    return file


def with_endless_schema(path):
    view = f"CREATE VIEW schema AS {ENDLESS} SELECT count(*) AS schema_version FROM c"
    return changed(path, f"DROP TABLE schema; {view}")


def with_endless_tree(path):
    """A page of the table leads to the next one many times, that one to the next, and so on."""
    size = 512
    script = f"""PRAGMA page_size = {size}; VACUUM;
        WITH c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c LIMIT 800)
        INSERT INTO messages(topic_id, timestamp, data) SELECT 1, x, 'abcdefgh' FROM c"""
    file = changed(path, script, indices=range(1))
    with contextlib.closing(apsw.Connection(str(file))) as database:
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        ((root,),) = database.execute(query)
    data = bytearray(file.read_bytes())
    inner = data[size * (root - 1) : size * root]
    kind, num_cells = struct.unpack_from(">BxxH", inner)
    assert kind == INTERIOR_PAGE
    last_child, *cells = 8, *struct.unpack_from(f">{num_cells}H", inner, 12)
    chain = [root, *(struct.unpack_from(">I", inner, cell)[0] for cell in cells[:15])]
    for page, following in pairwise(chain):
        for place in (last_child, *cells):
            struct.pack_into(">I", inner, place, following)
        data[size * (page - 1) : size * page] = inner
    file.write_bytes(data)
    return file


@pytest.mark.parametrize(
    ("write", "text"),
    [
        (with_endless_schema, "it has the view 'schema', expected only tables as of rosbag2"),
        (with_endless_tree, "a query takes more than [0-9]+ steps, 10 for each byte of the file"),
    ],
)
def test_what_would_be_read_for_ever_is_refused(tmp_path, write, text):
    """In a process that can be killed: without limits it never ends."""
    command = [sys.executable, "-c", READ, write(tmp_path / "bag")]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert ended.returncode == 1
    line = ended.stderr.splitlines()[-1]
    assert line.startswith("mnsf_ros.errors.RecordingError: ")
    with pytest.raises(RecordingError, match=text):
        inspect_recording(command[-1])


@pytest.mark.parametrize(
    ("script", "text"),
    [
        ("CREATE VIEW extra AS SELECT 1", "view 'extra'"),
        ("CREATE VIRTUAL TABLE extra USING fts5(text)", "virtual table 'extra'"),
        (
            "ALTER TABLE messages ADD COLUMN more BLOB AS (zeroblob(1000000000))",
            "generated column 'messages.more'",
        ),
        ("CREATE INDEX extra ON messages (data LIKE '%a%b%c')", "computed index 'extra'"),
        ("CREATE INDEX extra ON messages (id) WHERE data LIKE '%a%'", "computed index 'extra'"),
    ],
)
def test_what_computes_is_refused(tmp_path, script, text):
    file = changed(tmp_path / "bag", script)
    with pytest.raises(RecordingError, match=f"cannot be read: .*{text}") as caught:
        inspect_recording(file)
    assert "\n" not in str(caught.value)


def test_what_only_orders_is_read(tmp_path):
    """Users add indexes, and SQLite statistics of them. Conditions are not evaluated."""
    script = """CREATE INDEX by_topic ON messages (topic_id, timestamp); ANALYZE;
        CREATE TABLE notes(text TEXT UNIQUE CHECK (text LIKE '%a%b%c'));
        PRAGMA ignore_check_constraints = ON; INSERT INTO notes VALUES ('x')"""
    inspection = inspect_recording(changed(tmp_path / "bag", script))
    assert not inspection.damages
    with inspection.open() as reader:
        found = list(reader.readable_messages(tiny_bags.TOPIC))
    assert len(found) == tiny_bags.NUM_CLOUDS
    assert not any(isinstance(item, Damage) for item in found)


def test_more_bytes_than_the_file_has_are_refused(tmp_path):
    file = tiny_bags.write_sqlite(tmp_path / "bag") / "bag.db3"
    num_bytes = file.stat().st_size
    with contextlib.closing(
        apsw.Connection(str(file), flags=apsw.SQLITE_OPEN_READONLY)
    ) as database:
        limit_database(database)
        assert len(list(database.execute("SELECT zeroblob(?)", (num_bytes,)))) == 1
        many = "SELECT zeroblob(?) FROM messages AS a, messages AS b"
        with pytest.raises(apsw.Error, match="returns more than"):
            list(database.execute(many, (num_bytes,)))
        # Each statement has its own budget.
        assert len(list(database.execute("SELECT data FROM messages"))) == tiny_bags.NUM_CLOUDS
