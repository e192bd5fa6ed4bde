# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The table of licences in docs/security.md is that of the libraries that are installed."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LINE = re.compile(r"^\| ([A-Z]\S*[^|]*) \| ([a-z][^|`]*) \|$", re.MULTILINE)


@pytest.fixture(scope="module")
def licenses():
    spec = importlib.util.spec_from_file_location("licenses", ROOT / ".ci" / "licenses.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_table_is_that_of_the_installed_libraries(licenses):
    text = (ROOT / "docs" / "security.md").read_text()
    table = {name: kind for kind, names in LINE.findall(text) for name in names.split(", ")}
    installed = licenses.rows()
    assert {"numpy", "rosbags"} <= set(installed)
    assert {name: table.get(name) for name in installed} == installed


def test_no_library_is_stricter_than_apache_allows(licenses):
    assert licenses.strict_ones(licenses.rows()) == []
    assert licenses.strict_ones({"a": "GPL", "b": "unknown", "c": "MIT"}) == ["a", "b"]


@pytest.mark.parametrize(
    ("metadata", "found"),
    [
        ({"License-Expression": "LGPL-3.0-or-later"}, "LGPL"),
        ({"Classifier": "License :: OSI Approved :: MIT License"}, "MIT"),
        ({"License": "GPLv3"}, "GPL"),
        ({"License": "BSD 3-Clause\nCopyright ... Apache"}, "BSD"),
        ({}, "unknown"),
        ({"License": "nobody knows"}, "unknown"),
    ],
)
def test_licences_are_read_from_metadata(licenses, metadata, found):
    from email.message import Message
    from types import SimpleNamespace

    message = Message()
    for key, value in metadata.items():
        message.add_header(key, value)
    assert licenses.license_of("some", SimpleNamespace(metadata=message)) == found
