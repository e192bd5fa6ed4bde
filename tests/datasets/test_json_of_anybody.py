# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""JSON files of data sets with anything in them: sweeps, or one line that says why not."""

from __future__ import annotations

import copy
import json
import os
from pathlib import Path

import numpy as np
import pytest
import tiny_world
from test_nuscenes_scenes import scene_tables, write_data

from mnsf_ros.datasets import nuscenes
from mnsf_ros.datasets.formats import open_source
from mnsf_ros.datasets.nuscenes import json_rows
from mnsf_ros.datasets.source_files import file_inside, read_content
from mnsf_ros.decompression import MAX_BYTES
from mnsf_ros.errors import DatasetError

hypothesis = pytest.importorskip("hypothesis")
st = hypothesis.strategies

# All of Unicode would take seconds to look up.
TEXTS = st.text(alphabet="./a1\\\0ü\ud800", max_size=9)
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner),
    max_leaves=4,
) | st.sampled_from([10**400, 2**63, "../secret.bin", "/dev/zero", "\0", "s1", "top", [1e300] * 4])
SEARCH = hypothesis.settings(
    max_examples=40,
    derandomize=True,
    deadline=None,
    suppress_health_check=list(hypothesis.HealthCheck),
)
OUTSIDE = [
    "../../secret.bin",
    "sweeps/../../secret.bin",
    "/dev/zero",
    "",
    "sweeps",
    "pipe",
    "zero",
    "a\0b",
    "\ud800",
    "x" * 5000,
]


def sweeps_of(folder):
    return list(open_source("nuscenes", folder, sequence="scene-1").sweeps)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    np.zeros(100, "<f4").tofile(folder / "secret.bin")
    data = write_data(folder / "data")
    os.mkfifo(data / "pipe")
    (data / "zero").symlink_to("/dev/zero")
    return data


def write_table(scene, name, rows):
    (scene / "v1.0-mini" / f"{name}.json").write_text(json.dumps(rows))


@pytest.mark.parametrize("name", [*OUTSIDE, str(Path("/secret.bin")), 5, [], None, {}], ids=ascii)
def test_a_file_name_leads_to_a_file_of_the_data_set(scene, name):
    rows = scene_tables()["sample_data"]
    for row in rows:
        row["filename"] = name
    write_table(scene, "sample_data", rows)
    with pytest.raises(DatasetError):
        sweeps_of(scene)


def test_an_absolute_file_name_of_the_same_folder_is_refused(scene):
    rows = scene_tables()["sample_data"]
    for row in rows:
        row["filename"] = str(scene / row["filename"])
    write_table(scene, "sample_data", rows)
    with pytest.raises(DatasetError, match=r"sample_data\.json: .*leads out of the data set"):
        sweeps_of(scene)


@hypothesis.given(TEXTS)
@SEARCH
def test_no_file_name_leads_out(name):
    folder = Path("/data")
    try:
        found = file_inside(folder, name)
    except ValueError:
        return
    assert Path(os.path.normpath(found)).is_relative_to(folder)


@hypothesis.given(st.data())
@SEARCH
def test_any_value_in_a_table_is_used_or_refused_in_one_line(scene, data):
    tables = copy.deepcopy(scene_tables())
    name = data.draw(st.sampled_from(sorted(name for name, rows in tables.items() if rows)))
    number = data.draw(st.integers(0, len(tables[name]) - 1))
    if data.draw(st.booleans()):
        column = data.draw(st.sampled_from(sorted(tables[name][number])))
        tables[name][number][column] = data.draw(ANYTHING)
    else:
        tables[name][number] = data.draw(ANYTHING)
    for table, rows in tables.items():
        write_table(scene, table, rows)
    try:
        sweeps = sweeps_of(scene)
    except DatasetError as error:
        assert len(str(error)) < 1000  # noqa: PT017 - sweeps are as right
    else:
        real = np.concatenate([tiny_world.sweep(index).xyz for index in range(3)])
        assert all(np.isin(sweep.xyz, real).all() for sweep in sweeps)


@pytest.mark.parametrize(
    ("table", "column", "value", "message"),
    [
        ("scene", "name", ["a"], r"'name' is \['a'\], expected a text"),
        ("sample", "timestamp", "1", "'timestamp' is '1', expected microseconds since 1970"),
        ("sample", "timestamp", float("nan"), "'timestamp' is nan, expected microseconds"),
        ("sample", "timestamp", -1, "'timestamp' is -1, expected microseconds"),
        ("sample", "token", {}, r"'token' is \{\}, expected a text"),
        ("sensor", "token", [], r"'token' is \[\], expected a text"),
        ("ego_pose", "rotation", [True, 0, 0, 0], r"'rotation' is \[True, .*, expected 4 numbers"),
        ("ego_pose", "translation", "123", "'translation' is '123', expected 3 numbers"),
        ("category", "name", None, "'name' is None, expected a text"),
        ("sample_annotation", "size", [1, 2], r"'size' is \[1, 2\], expected 3 numbers"),
        ("sample_data", "filename", 5, "'filename' is 5, expected a text"),
    ],
)
def test_a_value_of_another_type_is_named(scene, table, column, value, message):
    tables = scene_tables()
    tables[table][-1][column] = value
    for name, rows in tables.items():
        write_table(scene, name, rows)
    with pytest.raises(DatasetError, match=rf"{table}\.json: cannot be read: {message}"):
        sweeps_of(scene)


def test_the_end_of_a_damaged_object_is_not_looked_for_in_all_of_a_table(tmp_path, monkeypatch):
    monkeypatch.setattr(nuscenes, "_MAX_OBJECT_CHARACTERS", 1000)
    monkeypatch.setattr(nuscenes, "_CHUNK_CHARACTERS", 100)
    path = tmp_path / "rows.json"
    path.write_text('[{"a": 1}, {"a" 1}, ' + '{"a": 1}, ' * 1000 + '{"a": 1}]')
    with pytest.raises(DatasetError, match="an object is damaged or has over 1000 characters"):
        list(json_rows(path))


@pytest.mark.parametrize("content", [[], 5, None, {"0": 5}, {"0": [5]}, {"x": []}], ids=repr)
def test_boxes_of_another_type_are_refused(tmp_path, content):
    np.savez(tmp_path / "0.npz", xyz=np.zeros((3, 3), "f4"), stamp_ns=0)
    (tmp_path / "boxes.json").write_text(json.dumps(content))
    with pytest.raises(DatasetError, match=r"boxes\.json: cannot be read"):
        open_source("sweeps", tmp_path)


def test_what_has_no_end_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    for name in ("pipe", "zero", "."):
        with pytest.raises(DatasetError, match="is not a regular file"):
            read_content(tmp_path / name)
    with (tmp_path / "sparse").open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(DatasetError, match=f"sparse: cannot be read: .*limit is {MAX_BYTES}"):
        read_content(tmp_path / "sparse")
