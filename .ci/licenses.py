# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Prints the licences of all libraries that the project needs, directly or not, as a table.

    python .ci/licenses.py

They are those of what is installed. Exit status 1: one is not known, or stricter than Apache-2.0
allows. `tests/test_licenses.py` compares the table in docs/security.md with it.
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

import setuptools  # noqa: F401 - has distutils, which Python has no longer
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
# Of ROS and of what works on the project itself nothing is told here.
EXTRAS = ("networks", "datasets", "view", "tune")
# Part of a licence's name -> what it is called here. The first that fits is taken.
KNOWN = {
    "mpl": "MPL-2.0",
    "mozilla public": "MPL-2.0",
    "lgpl": "LGPL",
    "gpl": "GPL",
    "apache": "Apache-2.0",
    "bsd": "BSD",
    "mit": "MIT",
    "python software foundation": "PSF-2.0",
    "psf": "PSF-2.0",
    "isc": "ISC",
    "hpnd": "HPND",
    "zlib": "Zlib",
}
FREE = ("Apache-2.0", "BSD", "MIT", "PSF-2.0", "ISC", "HPND", "Zlib")
# Its metadata does not say, or not all; checked by hand in its source.
BY_HAND = {
    "edt": "LGPL",
    "mcap": "MIT",
    "rosbags": "Apache-2.0",
    "apsw": "Zlib",  # any of the licences that the OSI has approved
    "triton": "MIT",
}
# Stricter: docs/security.md says why it may be used all the same.
EXCEPTIONS = ("edt", "tqdm")


def wanted() -> Iterator[Requirement]:
    """Yields what setup.py asks for."""
    distutils = importlib.import_module("distutils.core")
    package = distutils.run_setup(str(ROOT / "setup.py"), stop_after="init")
    lines = [
        *package.install_requires,
        *(x for name in EXTRAS for x in package.extras_require[name]),
    ]
    yield from map(Requirement, lines)


def needed() -> dict[str, Distribution]:
    """Returns all libraries that are installed of those that are asked for, and what they need."""
    waiting, found = list(wanted()), {}
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        # NVIDIA's come with PyTorch for CUDA only, under terms of their own.
        if name in found or name.startswith("nvidia-") or not _holds(requirement):
            continue
        try:
            found[name] = distribution(requirement.name)
        except PackageNotFoundError:
            continue
        waiting += map(Requirement, found[name].requires or ())
    return dict(sorted(found.items()))


def _holds(requirement: Requirement) -> bool:
    return requirement.marker is None or requirement.marker.evaluate({"extra": ""})


def license_of(name: str, library: Distribution) -> str:
    """Returns the licence of a library, `unknown` if its metadata does not say."""
    if name in BY_HAND:
        return BY_HAND[name]
    told = library.metadata
    classifiers = [c for c in told.get_all("Classifier", []) if c.startswith("License ::")]
    for text in (told.get("License-Expression"), *classifiers, told.get("License")):
        short = (text or "").splitlines()[:1]
        for part, known in KNOWN.items():
            if short and re.search(rf"(?i)(?<![a-z]){part}", short[0]):
                return known
    return "unknown"


def rows() -> dict[str, str]:
    """Returns library -> licence."""
    return {name: license_of(name, library) for name, library in needed().items()}


def main() -> int:
    """Prints the table."""
    found = rows()
    for text in sorted(set(found.values())):
        print(f"| {text} | {', '.join(name for name in found if found[name] == text)} |")
    strict = strict_ones(found)
    for name in strict:
        print(f"{name}: {found[name]}: not allowed by default", file=sys.stderr)
    return 1 if strict else 0


def strict_ones(found: dict[str, str]) -> list[str]:
    """Returns the libraries of unknown licence, or of one stricter than Apache-2.0 allows."""
    return [name for name, text in found.items() if text not in FREE and name not in EXCEPTIONS]


if __name__ == "__main__":
    sys.exit(main())
