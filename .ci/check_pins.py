"""Resolves the pins of constraints.txt for every supported Python version, from wheels alone.

    python .ci/check_pins.py [3.10 3.14 ...]

Installs nothing. Exit status 0: every version resolves, or no package index can be reached (a line
says so); 1: a pin has no wheel, or pins contradict each other. torch is left out, because its
wheels take gigabytes.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from distutils.core import run_setup
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSIONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
EXTRAS = ("wheels", "datasets", "test", "lint")
UNREACHABLE = ("Failed to establish a new connection", "Name or service not known", "timed out")

# With --python-version, pip chooses wheels for that version, but still evaluates the markers of
# dependencies for the Python that runs it.
PIP_FOR_PYTHON = """
import sys
from pip._internal.cli.main import main
from pip._vendor.packaging import markers
version, *arguments = sys.argv[1:]
own = markers.default_environment()
other = own | {"python_version": version, "python_full_version": f"{version}.0"}
markers.default_environment = lambda: other
sys.exit(main(arguments))
"""


def main() -> int:
    """Checks the versions that are named on the command line, or all of them."""
    package = run_setup(str(ROOT / "setup.py"), stop_after="init")
    extras = [line for extra in EXTRAS for line in package.extras_require[extra]]
    wanted = [line for line in package.install_requires + extras if not line.startswith("torch")]
    status = 0
    with tempfile.TemporaryDirectory() as folder:
        # The one dependency (of the ROS wheels) that has no wheel; it is pure Python.
        run_pip(VERSIONS[0], "wheel", "--quiet", "--no-deps", f"--wheel-dir={folder}", "empy")
        for version in sys.argv[1:] or VERSIONS:
            result = resolve(wanted, version, folder)
            if result.returncode == 0:
                print(f"Python {version}: resolved")
            elif any(text in result.stderr for text in UNREACHABLE):
                print(f"Python {version}: not checked, no package index can be reached")
            else:
                print(f"Python {version}: FAILED\n{result.stderr}")
                status = 1
    return status


def resolve(wanted: list[str], version: str, folder: str) -> subprocess.CompletedProcess[str]:
    """Returns pip's answer for one Python version."""
    return run_pip(
        *(version, "install", "--dry-run", "--quiet", "--ignore-installed"),
        *(f"--find-links={folder}", f"--target={folder}/target", "--only-binary=:all:"),
        *(f"--python-version={version}", f"--constraint={ROOT / 'constraints.txt'}", *wanted),
    )


def run_pip(version: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs pip with the markers of a Python version."""
    command = [sys.executable, "-c", PIP_FOR_PYTHON, version, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


if __name__ == "__main__":
    sys.exit(main())
