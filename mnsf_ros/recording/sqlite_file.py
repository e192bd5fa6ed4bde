# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Databases of rosbag2 (sqlite3), opened for reading only."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

import apsw

from mnsf_ros.recording.bag_topics import CDR, TopicSummary, add_topic, has_latched_profile
from mnsf_ros.recording.storage_file import Damage, Readable, StorageFile

# Steps of SQLite between two chances for Ctrl-C.
_STEPS = 1_000_000


class SqliteFile(StorageFile):
    """A database of rosbag2."""

    def __init__(self, path: Path) -> None:
        """Reads topics and counts, but no message."""
        super().__init__(path)
        self._numbers: dict[str, list[int]] = {}
        with _opened(path) as database:
            span = "SELECT min(timestamp), max(timestamp) FROM messages"
            ((first_ns, last_ns),) = database.execute(span)
            self.first_ns = self.first_ns if first_ns is None else int(first_ns)
            self.last_ns = int(last_ns or 0)
            query = "SELECT topic_id, count(*) FROM messages GROUP BY topic_id"
            counts = dict(database.execute(query))
            for number, name, msgtype, encoding, profiles in _topics(database):
                count = counts.pop(number, 0)
                if encoding == CDR:
                    self._numbers.setdefault(name, []).append(number)
                is_latched = has_latched_profile(profiles)
                add_topic(self.topics, name, TopicSummary(msgtype, count, is_latched, encoding))
        if counts:
            text = f"messages that belong to no topic: {sum(counts.values())}"
            self.damages.append(Damage(str(path), "", text))
        if _has_content(path, "-journal"):
            text = "holds incomplete changes (-journal); opening it once with sqlite3 undoes them"
            self.damages.append(Damage(str(path), "", text))

    def messages(self, topic: str, start_ns: float) -> Iterator[Readable[bytes]]:
        """Yields receive time and CDR bytes of the messages from a time on."""
        numbers = self._numbers.get(topic, [])
        query = (
            "SELECT timestamp, data FROM messages "
            f"WHERE topic_id IN ({', '.join('?' * len(numbers))}) "
            "AND timestamp >= ? ORDER BY timestamp"
        )
        with _opened(self.path) as database:
            for received_ns, data in database.execute(query, (*numbers, start_ns)):
                yield int(received_ns), data


@contextmanager
def _opened(path: Path) -> Iterator[apsw.Connection]:
    # Both options keep SQLite from making files. With immutable=1 it ignores a write-ahead log,
    # which a recorder that was killed leaves.
    options = "vfs=unix-none" if _has_content(path, "-wal") else "immutable=1"
    uri = f"file:{quote(str(path.resolve()), errors='surrogateescape')}?{options}"
    database = apsw.Connection(uri, flags=apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI)
    try:
        # The index of the log is then in memory, and the log is not written back.
        database.pragma("locking_mode", "exclusive")
        database.config(apsw.SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1)
        # A view may compute for ever, and rosbag2 has none.
        database.config(apsw.SQLITE_DBCONFIG_ENABLE_VIEW, 0)
        database.set_progress_handler(lambda: False, _STEPS)
        yield database
    except apsw.NoMemError as error:
        raise MemoryError from error
    finally:
        database.close()


def _has_content(path: Path, suffix: str) -> bool:
    """Whether a database has a companion file with this suffix that is not empty."""
    path = path.resolve()  # not of a link to it
    companion = path.with_name(path.name + suffix)
    return companion.is_file() and companion.stat().st_size > 0


def _topics(database: apsw.Connection) -> Iterator[tuple[int, str, str, str, str]]:
    """Number, name, type, serialization and QoS profiles of each topic."""
    columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
    # The first versions of rosbag2 stored none.
    profiles = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
    query = f"SELECT id, name, type, serialization_format, {profiles} FROM topics ORDER BY id"
    for number, *texts in database.execute(query):
        name, msgtype, encoding, stored = map(str, texts)
        yield number, name, msgtype, encoding, stored
