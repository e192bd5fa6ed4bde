# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The memory limit of commands; what hostile files do under it is in tests/recording."""

import os
import resource

import pytest

from mnsf_ros.cli import evaluate, memory
from mnsf_ros.cli.main import EXIT_MEMORY, EXIT_USAGE, run
from mnsf_ros.errors import RecordingError

GB = 10**9


def data_limit():
    return resource.getrlimit(resource.RLIMIT_DATA)[0]


@pytest.fixture
def limits(monkeypatch):
    """The limits under which `mnsf report` has run."""
    seen = []
    monkeypatch.setattr(evaluate, "run_report", lambda _: seen.append(data_limit()))
    return seen


def test_a_command_is_limited_to_half_of_the_memory_while_it_runs(limits):
    before = data_limit()
    assert run(["report", "."]) == 0
    assert 0 < limits[0] <= os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2
    assert data_limit() == before


def test_the_limit_is_an_option(limits):
    run(["report", ".", "--max-memory", "77.5"])
    run(["report", ".", "--max-memory", "inf"])
    assert limits == [int(77.5 * GB), resource.RLIM_INFINITY]


@pytest.mark.parametrize("text", ["0", "-1", "nan", "much", "0.2"])
def test_a_limit_is_what_libraries_take_or_more(text, capsys):
    assert run(["report", ".", "--max-memory", text]) == EXIT_USAGE
    assert f"got '{text}', expected 0.5 GB or more, or inf" in capsys.readouterr().err


def refuse(_):
    try:
        raise MemoryError
    except MemoryError as error:
        raise RecordingError("a.mcap: cannot be read") from error


def exhaust(_):
    raise MemoryError


@pytest.mark.parametrize(
    ("fail", "said"), [(refuse, "a.mcap: cannot be read"), (exhaust, "out of memory")]
)
def test_memory_that_is_missing_is_one_line_with_the_option(monkeypatch, capsys, fail, said):
    monkeypatch.setattr(evaluate, "run_report", fail)
    assert run(["report", ".", "--max-memory", "99"]) == EXIT_MEMORY
    line = f"mnsf: {said}; memory is limited to 99.0 GB (--max-memory)\n"
    assert capsys.readouterr().err == line


def test_memory_that_is_missing_for_the_only_recording_is_told_alike(monkeypatch, capsys, tmp_path):
    (tmp_path / "a.mcap").write_bytes(b"")
    monkeypatch.setattr("mnsf_ros.recording.bag_reader.McapFile", exhaust_at)
    command = ["evaluate", f"{tmp_path}/a.mcap", "--out", f"{tmp_path}/out", "--max-memory=99"]
    assert run(command) == EXIT_MEMORY
    assert "a.mcap: cannot be read: it takes more memory than the limit; memory is limited to" in (
        capsys.readouterr().err
    )


def exhaust_at(_path):
    raise MemoryError


def test_memory_of_the_machine_is_that_of_its_container(monkeypatch, tmp_path):
    limited, unlimited = tmp_path / "limited", tmp_path / "unlimited"
    limited.write_text("3000000\n")
    unlimited.write_text("max\n")
    monkeypatch.setattr(memory, "_GROUP_LIMITS", (unlimited, tmp_path / "none"))
    assert memory.machine_bytes() > 3_000_000
    monkeypatch.setattr(memory, "_GROUP_LIMITS", (unlimited, limited))
    assert memory.machine_bytes() == 3_000_000
