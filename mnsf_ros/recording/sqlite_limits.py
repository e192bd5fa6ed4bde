# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""SQLite with limits: a database is a program, and that of a stranger may run for ever.

What computes (views, generated columns, indexes of expressions) is refused. A damaged or crafted
tree of pages may still have more rows than the file has bytes; so each statement has a budget.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import apsw

from mnsf_ros.decompression import MAX_BYTES

# What a statement may do for each byte of the file. Messages of five bytes, the smallest there are,
# take one step of SQLite's virtual machine a byte, and no table returns more bytes than it has.
_MAX_PER_BYTE: Final = 10
_STEPS_BETWEEN_CHECKS: Final = 1000
# rosbag2 writes none of these.
_UNSUPPORTED: Final = """
    SELECT replace(type, 'virtual', 'virtual table'), name
    FROM pragma_table_list WHERE type IN ('view', 'virtual')
    UNION ALL
    SELECT 'generated column', of.name || '.' || one.name
    FROM pragma_table_list AS of, pragma_table_xinfo(of.name) AS one WHERE one.hidden
    UNION ALL
    SELECT 'computed index', one.name
    FROM pragma_table_list AS of, pragma_index_list(of.name) AS one
    WHERE one.partial OR EXISTS (SELECT * FROM pragma_index_xinfo(one.name) WHERE cid = -2)
    LIMIT 1
"""


class DatabaseLimitError(apsw.Error):
    """A database computes its content, or makes a statement do more than its size explains."""


def limit_database(connection: Any) -> None:  # noqa: ANN401
    """Limits what statements of a connection may do; a hook of apsw for new connections.

    Only connections that cannot write are limited: those of recordings.

    Raises:
        apsw.Error: The file is no database, or one that is not supported.
    """
    if not connection.readonly("main"):
        return
    connection.limit(apsw.SQLITE_LIMIT_LENGTH, MAX_BYTES)
    connection.config(apsw.SQLITE_DBCONFIG_ENABLE_VIEW, 0)
    budget = _Budget(_MAX_PER_BYTE * Path(connection.filename).stat().st_size)
    connection.exec_trace = budget.start
    connection.row_trace = budget.count_row
    connection.set_progress_handler(budget.count_steps, _STEPS_BETWEEN_CHECKS)
    # They would be evaluated when the integrity is checked.
    connection.execute("PRAGMA ignore_check_constraints = ON")
    for kind, name in connection.execute(_UNSUPPORTED):
        raise DatabaseLimitError(f"it has the {kind} {name!r}, expected only tables as of rosbag2")


class _Budget:
    """What the statement that was started last may still do."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._num_steps = self._num_bytes = 0

    def start(self, *_: object) -> bool:
        self._num_steps = self._num_bytes = 0
        return True

    def count_steps(self) -> bool:
        self._num_steps += _STEPS_BETWEEN_CHECKS
        self._check(self._num_steps, "takes", "steps")
        return False

    def count_row(self, _: object, row: tuple[object, ...]) -> tuple[object, ...]:
        self._num_bytes += sum(len(value) for value in row if isinstance(value, (str, bytes)))
        self._check(self._num_bytes, "returns", "bytes")
        return row

    def _check(self, number: int, verb: str, unit: str) -> None:
        if number > max(self._limit, _STEPS_BETWEEN_CHECKS):
            raise DatabaseLimitError(
                f"the database is damaged: a query {verb} more than {self._limit} {unit}, "
                f"{_MAX_PER_BYTE} for each byte of the file"
            )
