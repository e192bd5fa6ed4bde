"""Resolves the pins of constraints.txt for every supported Python version, from wheels alone.

    python .ci/check_pins.py [3.10 3.14 ...]

Installs nothing. Exit status 0: every version resolves, or no package index can be reached (one
line says so); 1: a pin has no wheel, or pins contradict each other. torch is left out, because its
wheels take gigabytes; `make setup` installs it by itself.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from distutils.core import run_setup
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
VERSIONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
EXTRAS = ("wheels", "datasets", "test", "lint")
UNREACHABLE = ("Failed to establish a new connection", "Name or service not known", "timed out")


def main() -> int:
    """Checks the versions that are named on the command line, or all of them."""
    package = run_setup(str(ROOT / "setup.py"), stop_after="init")
    wanted = [*package.install_requires]
    for extra in EXTRAS:
        wanted += package.extras_require[extra]
    pins = [
        line.strip()
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if line.strip() and not line.startswith("#")
    ]
    status = 0
    for version in sys.argv[1:] or VERSIONS:
        result = resolve(for_python(wanted, version), for_python(pins, version), version)
        if result.returncode == 0:
            print(f"Python {version}: resolved")
        elif any(text in result.stderr for text in UNREACHABLE):
            print(f"Python {version}: not checked, no package index can be reached")
        else:
            print(f"Python {version}: FAILED\n{result.stderr}")
            status = 1
    return status


def for_python(lines: list[str], version: str) -> list[str]:
    """Returns the requirements that hold for a Python version, without their markers.

    pip evaluates markers for the Python that runs it, whatever `--python-version` says.
    """
    kept = []
    for line in lines:
        requirement = Requirement(line)
        environment = {"python_version": version, "python_full_version": f"{version}.0"}
        if requirement.name != "torch" and (
            requirement.marker is None or requirement.marker.evaluate(environment)
        ):
            requirement.marker = None
            kept.append(str(requirement))
    return kept


def resolve(wanted: list[str], pins: list[str], version: str) -> subprocess.CompletedProcess[str]:
    """Returns pip's answer for one Python version."""
    with tempfile.TemporaryDirectory() as folder:
        constraints = Path(folder, "constraints.txt")
        constraints.write_text("\n".join(pins))
        # The one dependency (of the ROS wheels) that has no wheel; it is pure Python.
        run_pip("wheel", "--quiet", "--no-deps", f"--wheel-dir={folder}", "empy")
        command = [
            *("install", "--dry-run", "--quiet", "--ignore-installed", f"--find-links={folder}"),
            *("--only-binary=:all:", f"--python-version={version}", f"--target={folder}/target"),
            *("--constraint", str(constraints), *wanted),
        ]
        return run_pip(*command)


def run_pip(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Returns what pip says."""
    command = [sys.executable, "-m", "pip", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


if __name__ == "__main__":
    sys.exit(main())
