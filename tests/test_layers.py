# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Who may import whom, and who may end the process.

The contracts are in pyproject.toml: import-linter's for imports, ruff's (`make lint`) for print,
assert and exit. Both are also tried on made-up offenders, so that they cannot become rules that
never complain.
"""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("msg_utils", "mnsf_ros")
SOURCES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
}
ROS_NAMES = [
    "rclpy",
    "sensor_msgs",
    "std_msgs",
    "nav_msgs",
    "builtin_interfaces",
    "rcl_interfaces",
    "visualization_msgs",
]

# Module to one line in it that breaks a contract.
OFFENDERS = {
    "msg_utils.offender": "import sensor_msgs.msg",
    "msg_utils.offender_upward": "from mnsf_ros.errors import MnsfError",
    "msg_utils.offender_outside": "import rosbags",
    "mnsf_ros.errors.offender": "import numpy",
    "mnsf_ros.sweeps.offender": "def f():\n    import torch",
    "mnsf_ros.sweeps.offender_upward": "from ..core import batches",
    "mnsf_ros.core.offender": "from msg_utils.stamps import decode_stamp",
    "mnsf_ros.core.offender_upward": "import mnsf_ros.online.online_pipeline",
    "mnsf_ros.core.offender_outside": "from rclpy.node import Node",
    "mnsf_ros.methods.offender": "from mnsf_ros.recording import bag_reader",
    "mnsf_ros.recording.offender": "import mnsf_ros.simulation",
    "mnsf_ros.simulation.offender": "from nav_msgs.msg import Odometry",
    "mnsf_ros.evaluation.offender": "from mnsf_ros import node",
    "mnsf_ros.evaluation.offender_upward": "import mnsf_ros.report",
    "mnsf_ros.report.offender": "from mnsf_ros.studies import ablation",
    "mnsf_ros.studies.offender": "import mnsf_ros.demo",
    "mnsf_ros.node.offender": "from mnsf_ros.recording import bag_reader",
    "mnsf_ros.cli.offender": "import rclpy",
    "mnsf_ros.helpers.offender": "",
}


def lint_imports(folder):
    """Exit status and output of import-linter on the packages of a folder."""
    pytest.importorskip("importlinter")
    script = (
        "import sys; from importlinter.cli import lint_imports\n"
        "sys.exit(lint_imports(config_filename='pyproject.toml', no_cache=True))"
    )
    result = subprocess.run(
        [sys.executable, "-c", script],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "300"},
        capture_output=True,
        text=True,
        check=False,
    )
    return result.returncode, result.stdout + result.stderr


def test_imports_keep_the_contracts():
    status, text = lint_imports(ROOT)
    assert status == 0, text


@pytest.fixture(scope="module")
def complaints(tmp_path_factory):
    """What import-linter says of a copy of the project that has all offenders in it."""
    folder = tmp_path_factory.mktemp("offenders")
    shutil.copy(ROOT / "pyproject.toml", folder)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("*.pyc"))
    for module, line in OFFENDERS.items():
        path = (folder / module.replace(".", "/")).with_suffix(".py")
        path.parent.mkdir(exist_ok=True)
        path.parent.joinpath("__init__.py").touch()
        path.write_text(f"{line}\n")
    # A package beside a module of the same name hides it.
    (folder / "mnsf_ros" / "errors" / "__init__.py").write_text(
        (ROOT / "mnsf_ros" / "errors.py").read_text()
    )
    status, text = lint_imports(folder)
    assert status == 1
    return text


@pytest.mark.parametrize("module", OFFENDERS)
def test_offender_is_found(module, complaints):
    assert (module if OFFENDERS[module] else module.rpartition(".")[0]) in complaints


def modules_of(graph, package):
    """The modules of a package of ours; a library counts as one."""
    inside = set() if graph.is_module_squashed(package) else graph.find_descendants(package)
    return {package, *inside}


def test_no_contract_allows_what_nobody_does():
    """Every importer that a contract allows imports what the contract protects."""
    grimp = pytest.importorskip("grimp")
    configuration = pytest.importorskip("importlinter.api").read_configuration
    graph = grimp.build_graph(*PACKAGES, include_external_packages=True, cache_dir=None)
    unused = []
    for contract in configuration(str(ROOT / "pyproject.toml"))["contracts_options"]:
        importers = {
            importer
            for protected in contract.get("protected_modules", ())
            for module in modules_of(graph, protected)
            for importer in graph.find_modules_that_directly_import(module)
        }
        unused += [
            f"{contract['name']}: {allowed}"
            for allowed in contract.get("allowed_importers", ())
            if importers.isdisjoint(modules_of(graph, allowed))
        ]
    assert unused == []


def raises_system_exit(source):
    """Whether a module ends the process in the one way that ruff does not notice."""
    return any(
        isinstance(node, ast.Name) and node.id == "SystemExit"
        for node in ast.walk(ast.parse(source))
    )


def test_only_the_command_line_and_the_node_end_the_process():
    programs = ("mnsf_ros.cli.", "mnsf_ros.node.main")
    found = [name for name, path in SOURCES.items() if raises_system_exit(path.read_text())]
    assert [name for name in found if not name.startswith(programs)] == []
    assert raises_system_exit("def f():\n    raise SystemExit(2)")
    assert not raises_system_exit("raise ValueError('SystemExit')")


@pytest.mark.parametrize(
    ("module", "line", "rule"),
    [
        ("core/x.py", "assert True", "S101"),
        ("cli/x.py", "assert True", "S101"),
        ("core/x.py", "print('hello')", "T201"),
        ("core/x.py", "import sys\n\nsys.exit(1)", "TID251"),
        ("core/x.py", "from sys import exit as end", "TID251"),
        ("core/x.py", "import os\n\nos._exit(0)", "TID251"),
        ("core/x.py", "quit()", "PLR1722"),
        ("cli/x.py", "import sys\n\nsys.exit(1)", ""),
        ("cli/x.py", "print('hello')", ""),
        ("core/x.py", "console.print('x')\nworker.exit()", ""),
    ],
)
def test_ruff_finds_print_assert_and_exit(module, line, rule):
    if not importlib.util.find_spec("ruff"):
        pytest.skip("ruff is not installed")
    command = [sys.executable, "-m", "ruff", "check", "--output-format=json"]
    rules = ["--select=S101,T201,TID251,PLR1722", f"--stdin-filename=mnsf_ros/{module}", "-"]
    result = subprocess.run(
        [*command, *rules], cwd=ROOT, input=line, capture_output=True, text=True, check=False
    )
    assert {problem["code"] for problem in json.loads(result.stdout)} == ({rule} if rule else set())


def import_without(modules, blocked):
    """Imports modules in a fresh interpreter where the blocked ones do not exist."""
    script = (
        "import importlib, sys\n"
        f"for name in {blocked!r}: sys.modules[name] = None\n"
        f"for name in {modules!r}: importlib.import_module(name)\n"
    )
    return subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    ("layers", "blocked"),
    [
        (
            ["mnsf_ros.errors", "mnsf_ros.settings", "mnsf_ros.presets"],
            ["torch", "numpy", "scipy", "rosbags", *ROS_NAMES],
        ),
        (["msg_utils"], ["torch", "scipy", "rosbags", "mnsf_ros", *ROS_NAMES]),
        (["mnsf_ros.sweeps."], ["torch", "rosbags", "msg_utils", *ROS_NAMES]),
        (["mnsf_ros.sweeps_io"], ["torch", "rosbags", *ROS_NAMES]),
        (
            ["mnsf_ros.core", "mnsf_ros.methods", "mnsf_ros.online", "mnsf_ros.scene_flow"],
            ["rosbags", "msg_utils", *ROS_NAMES],
        ),
        (
            ["mnsf_ros.cli", "mnsf_ros.evaluation", "mnsf_ros.report", "mnsf_ros.datasets"],
            ["torch", *ROS_NAMES],
        ),
        (["mnsf_ros.studies"], ROS_NAMES),
    ],
    ids=lambda names: names[0],
)
def test_imports_where_nothing_else_is_installed(layers, blocked):
    modules = [name for name in SOURCES if name.startswith(tuple(layers))]
    assert modules
    result = import_without(modules, blocked)
    assert result.returncode == 0, result.stderr


def test_blocked_module_is_really_missing():
    result = import_without(["mnsf_ros.core.batches"], ["torch"])
    assert result.returncode != 0
    assert "torch" in result.stderr
