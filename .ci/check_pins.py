# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Resolves the pins of constraints.txt for every supported Python version, from wheels alone.

    python .ci/check_pins.py [3.10 3.14 ...]

For x86-64, and for arm64 without the wheels of ROS, which has none there.

Installs nothing. Exit status 0: every version resolves, or no package index can be reached (a line
says so); 1: a pin has no wheel, or pins contradict each other. torch is left out, because its
wheels take gigabytes.
"""

from __future__ import annotations

import importlib
import itertools
import subprocess
import sys
import tempfile
from pathlib import Path

from setuptools import Distribution

ROOT = Path(__file__).resolve().parents[1]
VERSIONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
EXTRAS = ("wheels", "networks", "datasets", "view", "tune", "test", "lint")
UNREACHABLE = ("Failed to establish a new connection", "Name or service not known", "timed out")

MACHINES = ("x86_64", "aarch64")
# Ubuntu 22.04 has glibc 2.35.
PLATFORMS = ["manylinux2014", *(f"manylinux_2_{minor}" for minor in range(17, 36))]

# With --python-version and --platform, pip chooses wheels for those, but still evaluates the
# markers of dependencies for the Python that runs it.
PIP_FOR_PYTHON = """
import sys
from pip._internal.cli.main import main
from pip._vendor.packaging import markers
version, machine, *arguments = sys.argv[1:]
own = markers.default_environment()
other = own | {"python_version": version, "python_full_version": f"{version}.0"}
other["platform_machine"] = machine
markers.default_environment = lambda: other
sys.exit(main(arguments))
"""


def main() -> int:
    """Checks the versions that are named on the command line, or all of them."""
    # setuptools has it, which Python has no longer.
    distutils = importlib.import_module("distutils.core")
    package = distutils.run_setup(str(ROOT / "setup.py"), stop_after="init")
    status = 0
    with tempfile.TemporaryDirectory() as folder:
        # The one dependency (of the ROS wheels) that has no wheel; it is pure Python.
        run_pip(
            *(VERSIONS[0], MACHINES[0], "wheel", "--quiet", "--no-deps"),
            *(f"--wheel-dir={folder}", "empy"),
        )
        for version, machine in itertools.product(sys.argv[1:] or VERSIONS, MACHINES):
            result = resolve(wanted(package, machine), version, machine, folder)
            title = f"Python {version}, {machine}"
            if result.returncode == 0:
                print(f"{title}: resolved")
            elif any(text in result.stderr for text in UNREACHABLE):
                print(f"{title}: not checked, no package index can be reached")
            else:
                print(f"{title}: FAILED\n{result.stderr}")
                status = 1
    return status


def wanted(package: Distribution, machine: str) -> list[str]:
    """Returns what must have wheels on a machine."""
    extras = [name for name in EXTRAS if name != "wheels" or machine == MACHINES[0]]
    lines = [line for name in extras for line in package.extras_require[name]]
    return [line for line in package.install_requires + lines if not line.startswith("torch")]


def resolve(
    wanted: list[str], version: str, machine: str, folder: str
) -> subprocess.CompletedProcess[str]:
    """Returns pip's answer for one Python version on one kind of machine."""
    return run_pip(
        *(version, machine, "install", "--dry-run", "--quiet", "--ignore-installed"),
        *(f"--find-links={folder}", f"--target={folder}/target", "--only-binary=:all:"),
        *(f"--python-version={version}", f"--constraint={ROOT / 'constraints.txt'}"),
        *(f"--platform={platform}_{machine}" for platform in PLATFORMS),
        *wanted,
    )


def run_pip(version: str, machine: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs pip with the markers of a Python version and a kind of machine."""
    command = [sys.executable, "-c", PIP_FOR_PYTHON, version, machine, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


if __name__ == "__main__":
    sys.exit(main())
