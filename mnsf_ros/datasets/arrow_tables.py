"""Feather and Parquet tables as arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.datasets.source_files import reading, require
from mnsf_ros.errors import DatasetError
from mnsf_ros.sweeps_io.arrays import read_feather_columns, read_feather_table


def read_feather(path: Path, columns: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Returns columns of a Feather file as (N,) arrays, texts as arrays of objects.

    Raises:
        DatasetError: If the file is missing or damaged, or lacks a column.
    """
    require("pyarrow.feather")
    with reading(path):
        return read_feather_columns(path, columns)


def feather_columns(path: Path) -> list[str]:
    """Returns the names of the columns of a Feather file.

    Raises:
        DatasetError: If the file is missing or damaged.
    """
    require("pyarrow.feather")
    with reading(path):
        return list(read_feather_table(path).column_names)


def read_parquet(path: Path, columns: Sequence[str]) -> list[dict[str, Any]]:
    """Returns the rows of a small Parquet file, lists in it as Python lists.

    Raises:
        DatasetError: If the file is missing or damaged, or lacks a column.
    """
    parquet = require("pyarrow.parquet")
    with reading(path), parquet.ParquetFile(path) as file:
        _check_columns(path, file.schema_arrow.names, columns)
        rows: list[dict[str, Any]] = file.read(columns=list(columns)).to_pylist()
        return rows


def parquet_groups(
    path: Path, key: str, columns: Sequence[str]
) -> Iterator[tuple[int, list[dict[str, Any]]]]:
    """Yields the rows of a large Parquet file by the integer in one of its columns.

    The file is read a few rows at a time, so it must be in the order of the key.

    Args:
        path: The file.
        key: Column with the integer.
        columns: The other columns to read; lists in them become arrays.

    Yields:
        The integer and all rows that have it.

    Raises:
        DatasetError: If the file is missing or damaged, lacks a column, or is out of order.
    """
    parquet = require("pyarrow.parquet")
    group: list[dict[str, Any]] = []
    current: int | None = None
    with reading(path), parquet.ParquetFile(path) as file:
        _check_columns(path, file.schema_arrow.names, [key, *columns])
        for batch in file.iter_batches(batch_size=1, columns=[key, *columns]):
            row = {name: _value(batch.column(name)[0]) for name in batch.schema.names}
            value = int(row.pop(key))
            if current is not None and value < current:
                raise DatasetError(f"{path}: its rows are not in the order of {key!r}")
            if current is not None and value > current:
                yield current, group
                group = []
            current = value
            group.append(row)
    if current is not None:
        yield current, group


def _value(scalar: Any) -> Any:  # noqa: ANN401
    values = getattr(scalar, "values", None)
    # Null lists have no values; numbers have no such attribute.
    return scalar.as_py() if values is None else np.asarray(values)


def _check_columns(path: Path, found: Sequence[str], wanted: Sequence[str]) -> None:
    missing = [name for name in wanted if name not in found]
    if missing:
        raise DatasetError(f"{path}: has no column {', '.join(missing)}; it has {', '.join(found)}")
