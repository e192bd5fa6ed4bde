# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Nothing that is read may run code: no pickle, no eval, no YAML with objects in it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("mnsf_ros", "msg_utils", "benchmarks", "launch", ".ci")
# Calls that read pickles unless told otherwise, or run what they are given.
NEED_FALSE = {"allow_pickle"}
FORBIDDEN = {
    *("pickle", "cPickle", "dill", "shelve", "marshal", "joblib", "cloudpickle"),
    *("read_pickle", "torch.load", "yaml.load", "yaml.unsafe_load", "os.system", "eval", "exec"),
}


def faults_of(source):
    """Names of unsafe calls, imports and arguments in Python source."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names if name.name in FORBIDDEN)
        elif isinstance(node, ast.ImportFrom) and node.module in FORBIDDEN:
            yield node.module
        elif isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            if name in FORBIDDEN or name.rpartition(".")[2] == "read_pickle":
                yield name
            if name.endswith("YAML") and "typ='safe'" not in ast.unparse(node):
                yield name
            for keyword in node.keywords:
                if keyword.arg in NEED_FALSE and ast.unparse(keyword.value) != "False":
                    yield f"{keyword.arg}={ast.unparse(keyword.value)}"


def test_nothing_unsafe_is_called():
    files = [file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py")]
    assert len(files) > 200
    found = {str(f.relative_to(ROOT)): list(faults_of(f.read_text("utf-8"))) for f in files}
    assert {file: faults for file, faults in found.items() if faults} == {}


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ("import pickle", "pickle"),
        ("from pickle import loads", "pickle"),
        ("np.load(f, allow_pickle=True)", "allow_pickle=True"),
        ("np.load(f, allow_pickle=yes)", "allow_pickle=yes"),
        ("torch.load(f)", "torch.load"),
        ("pandas.read_pickle(f)", "pandas.read_pickle"),
        ("YAML()", "YAML"),
        ("eval(text)", "eval"),
        ("np.load(f, allow_pickle=False)", None),
    ],
)
def test_unsafe_calls_are_found(source, fault):
    assert list(faults_of(source)) == ([] if fault is None else [fault])
