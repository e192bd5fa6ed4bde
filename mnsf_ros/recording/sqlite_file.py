# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Databases of rosbag2 (sqlite3), opened for reading only."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

import apsw

from mnsf_ros.recording.bag_topics import TopicSummary, add_topic, has_latched_profile
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
                if encoding == "cdr":
                    self._numbers.setdefault(name, []).append(number)
                    summary = TopicSummary(msgtype, count, has_latched_profile(profiles))
                    add_topic(self.topics, name, summary)
        if counts:
            text = f"messages that belong to no topic: {sum(counts.values())}"
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
    # Immutable: SQLite makes no file beside it.
    uri = f"file:{quote(str(path.resolve()), errors='surrogateescape')}?immutable=1"
    database = apsw.Connection(uri, flags=apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI)
    try:
        # A view may compute for ever, and rosbag2 has none.
        database.config(apsw.SQLITE_DBCONFIG_ENABLE_VIEW, 0)
        database.set_progress_handler(lambda: False, _STEPS)
        yield database
    except apsw.NoMemError as error:
        raise MemoryError from error
    finally:
        database.close()


def _topics(database: apsw.Connection) -> Iterator[tuple[int, str, str, str, str]]:
    """Number, name, type, serialization and QoS profiles of each topic."""
    columns = {row[1] for row in database.execute("PRAGMA table_info(topics)")}
    # The first versions of rosbag2 stored none.
    profiles = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
    query = f"SELECT id, name, type, serialization_format, {profiles} FROM topics ORDER BY id"
    for number, *texts in database.execute(query):
        name, msgtype, encoding, stored = map(str, texts)
        yield number, name, msgtype, encoding, stored
