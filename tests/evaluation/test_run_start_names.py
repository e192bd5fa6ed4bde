# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What recordings are called when a run goes on, and which of them are the same."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace

import pytest
import small_evaluations as small

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.recordings import recording_names
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.recording.bag_files import fingerprint, storage_files


@pytest.fixture
def bags(tmp_path):
    """Two recordings of the same last name that differ in nothing but their points."""
    return [
        small.write_recording(tmp_path / folder / "drive", 3, num_points=num_points)
        for folder, num_points in (("a", 60), ("b", 61))
    ]


def known(*bags, names=("drive",)):
    return [small.recording_at(bag, name) for bag, name in zip(bags, names, strict=True)]


def test_recordings_keep_their_names_and_new_ones_get_free_ones(bags):
    first, second = bags
    assert recording_names(bags, known(first)) == ["drive", str(second)]
    assert recording_names(bags[::-1], known(first)) == [str(second), "drive"]
    both = known(first, second, names=(str(first), str(second)))
    assert recording_names([second], both) == [str(second)]


def test_recording_that_has_moved_keeps_its_name(bags, tmp_path):
    records = known(*bags, names=("drive", "other"))
    moved = bags[1].rename(tmp_path / "new")
    assert recording_names([moved, bags[0]], records) == ["other", "drive"]


def test_name_of_another_place_is_not_given_twice(bags, tmp_path, monkeypatch):
    """`b/drive` is the name of a recording that has moved, and the path of another one."""
    monkeypatch.chdir(tmp_path)
    records = known(*bags, names=("drive", "b/drive"))
    moved = bags[1].rename(tmp_path / "moved")
    new = small.write_recording(tmp_path / "b" / "drive", 4)
    names = recording_names([bags[0], moved, new.relative_to(tmp_path)], records)
    assert names == ["drive", "b/drive", str(new)]


def test_copies_keep_their_names(bags, tmp_path):
    copy = shutil.copytree(bags[0], tmp_path / "copy")
    records = known(bags[0], copy, names=("drive", "copy"))
    assert recording_names([copy, bags[0]], records) == ["copy", "drive"]
    assert recording_names([bags[0], copy], records) == ["drive", "copy"]
    assert recording_names([bags[0]], records) == ["drive"]


def test_changed_recording_is_called_as_before_so_that_it_is_refused(bags):
    assert recording_names([bags[1]], known(bags[0])) == ["drive"]


def test_same_recording_in_another_spelling_is_refused(bags, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bag = bags[0]
    link = tmp_path / "link"
    link.symlink_to(bag)
    (file,) = bag.glob("*.mcap")
    for other in (bag.relative_to(tmp_path), tmp_path / "b" / ".." / "a" / "drive", link, file):
        with pytest.raises(EvaluationError, match=r"is the same recording as .*; name it once"):
            recording_names([bag, other])


def test_name_is_text_whatever_the_path_is(tmp_path):
    folder = tmp_path / os.fsdecode(b"bad\xff")
    folder.mkdir()
    assert recording_names([folder]) == [r"bad\xff"]


def test_fingerprint_is_that_of_the_content(bags, tmp_path):
    first, second = bags
    before = fingerprint(first)
    assert before != fingerprint(second)
    moved = first.rename(tmp_path / "moved")
    (moved / "metadata.yaml").write_text("written again")
    (file,) = storage_files(moved)
    assert fingerprint(moved) == fingerprint(file) == before
    file.write_bytes(file.read_bytes()[::-1])
    assert fingerprint(moved)["hash"] != before["hash"]
    assert fingerprint(moved)["num_bytes"] == before["num_bytes"]


@pytest.mark.parametrize("place", [0, 1 << 22, (1 << 23) - 1])
def test_large_files_are_looked_at_from_end_to_end(tmp_path, place):
    file = tmp_path / "large.mcap"
    content = bytearray(1 << 23)
    file.write_bytes(content)
    before = fingerprint(file)
    step = ((1 << 23) - 65_536) / 63
    content[place if place != 1 << 22 else round(32 * step)] = 1
    file.write_bytes(content)
    assert fingerprint(file) != before


def test_recording_that_is_not_there_is_itself(tmp_path):
    assert storage_files(tmp_path / "nowhere") == [tmp_path / "nowhere"]
    with pytest.raises(OSError, match="nowhere"):
        fingerprint(tmp_path / "nowhere")


def resume(out, recording):
    return small.begun(out, [recording], small.methods_of(["ego"]), small.options(), resume=True)


def test_other_odometry_is_another_recording(bags, tmp_path):
    recording = small.recording_at(bags[0])
    resume(tmp_path / "out", recording)
    with pytest.raises(EvaluationError, match="'drive': odometry was /truth/odometry, is None"):
        resume(tmp_path / "out", replace(recording, odometry=None))


@pytest.mark.parametrize(
    ("before", "now"), [(True, True), (True, False), (False, True), (False, False)]
)
def test_recording_has_checksums_if_it_had_them_in_all_sessions(bags, tmp_path, before, now):
    recording = small.recording_at(bags[0])
    for has_checksums in (before, now):
        resume(tmp_path / "out", replace(recording, has_checksums=has_checksums))
    (known,) = RunFolder(tmp_path / "out").read_record().recordings
    assert known.has_checksums == (before and now)
