# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Small files that expand to gigabytes or compute for ever, under the memory limit of a command."""

import contextlib
import os
import signal
import subprocess
import sys

import pytest
from hostile_bags import HOSTILE, endless_tree

from mnsf_ros.cli.main import EXIT_MEMORY

pytestmark = pytest.mark.slow

LIMIT_GB = 1.7
LIMITED = ("sqlite, row of 990 MB", "ROS 1, bz2 of 3 GB")
# With what does not count for the limit, such as the code of libraries.
MAX_MB = 2000
# Not ru_maxrss, which a process inherits through fork and exec.
RUN = """
import signal
import sys
from pathlib import Path
from mnsf_ros.cli.main import run
# Whoever starts the tests may ignore it.
signal.signal(signal.SIGINT, signal.default_int_handler)
status = run(["evaluate", *sys.argv[1:], "--methods=zero"])
peak = Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]
print(status, int(peak) // 1000)
"""


def evaluated(path, out, limit_gb):
    command = [sys.executable, "-c", RUN, path, "--out", out, f"--max-memory={limit_gb}"]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_recording_ends_in_lines_and_takes_little_memory(tmp_path, kind):
    path = HOSTILE[kind](tmp_path)
    # Of a row of sqlite3 and of a chunk of ROS 1 nothing but the limit bounds the size.
    ended = evaluated(path, tmp_path / "out", LIMIT_GB if kind in LIMITED else "inf")
    assert "Traceback" not in ended.stderr
    assert str(path.name) in ended.stderr + ended.stdout
    status, peak_mb = ended.stdout.splitlines()[-1].split()
    assert status in {"2", "3", "5"}
    assert int(peak_mb) < MAX_MB


@pytest.mark.parametrize(
    ("name", "options"),
    [("explain {}", "--stamp=5 --at=8,0"), ("export opensceneflow {}", "--out={}.flows")],
)
def test_memory_that_is_missing_is_one_line_with_the_limit(tmp_path, name, options):
    path = HOSTILE["ROS 1, bz2 of 3 GB"](tmp_path)
    arguments = f"{name} {options} --max-memory=2".replace("{}", str(path)).split()
    command = [sys.executable, "-m", "mnsf_ros.cli", *arguments]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == EXIT_MEMORY
    line = ended.stderr.splitlines()[-1]
    assert line.startswith(f"mnsf: {path}: damaged after 0 messages on '/points': ")
    assert line.endswith("; memory is limited to 2.0 GB (--max-memory)")


def test_ctrl_c_ends_a_database_that_is_read_for_ever(tmp_path):
    command = [sys.executable, "-c", RUN, endless_tree(tmp_path / "bag"), "--out", tmp_path / "o"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as running:
        with contextlib.suppress(subprocess.TimeoutExpired):
            running.wait(10)
        os.kill(running.pid, signal.SIGINT)
        assert running.communicate(timeout=60)[1].endswith("mnsf: interrupted\n")
