"""Where a recording without checksums does not fit itself: counts, and the tables of a database."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

import apsw

from mnsf_ros.recording.damage import Damage, reason

if TYPE_CHECKING:
    from pathlib import Path

# What is found by it, and what is said then. The first reads the whole file.
_CHECKS: Final = {
    "SELECT integrity_check FROM pragma_integrity_check WHERE integrity_check != 'ok' LIMIT 1": (
        "the database is damaged: {}"
    ),
    "SELECT count(*) AS number FROM messages "
    "WHERE topic_id NOT IN (SELECT id FROM topics) HAVING number > 0": (
        "messages that belong to no topic: {}"
    ),
}


def unfit_counts(
    where: Path, promised: Mapping[str, int], found: Mapping[str, int]
) -> Iterator[Damage]:
    """Yields a Damage for each topic of which a file promises another number than there is."""
    for topic in sorted({*promised, *found}):
        numbers = promised.get(topic, 0), found.get(topic, 0)
        if numbers[0] != numbers[1]:
            text = f"promises {numbers[0]} messages on {topic!r}, {numbers[1]} are stored"
            yield Damage(str(where), "", text)


def unfit_database(file: str, database: apsw.Connection) -> Iterator[Damage]:
    """Yields a Damage for what does not fit together in an open database of rosbag2."""
    for query, text in _CHECKS.items():
        try:
            found = [text.format(" ".join(str(row[0]).split())) for row in database.execute(query)]
        except apsw.Error as error:
            found = [f"the database cannot be checked: {reason(error)}"]
        for one in found:
            yield Damage(file, "", one)
