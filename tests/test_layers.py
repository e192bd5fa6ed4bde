"""Who may import whom, and who may print, exit or assert.

The rules are checked on the source, and the most important ones by importing, too. Each rule is
also tried on a made-up offender, so that it cannot become one that never complains.
"""

from __future__ import annotations

import ast
import fnmatch
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

_BASE = ["errors", "settings", "presets"]
_METHOD = [*_BASE, "geometry", "sweeps", "core"]

# Layer to the layers that it may import, from the bottom to the top: only what stands above it.
LAYERS = {
    "msg_utils": [],
    "mnsf_ros": [],  # the package itself: its version
    "errors": [],
    "settings": ["errors"],
    "presets": ["errors", "settings"],
    "settings_documents": _BASE,
    "geometry": ["errors", "settings", "msg_utils"],
    "sweeps": ["errors", "settings", "geometry"],
    "core": ["errors", "settings", "geometry", "sweeps"],
    "ego_motion": ["errors", "settings", "geometry", "sweeps"],
    "objects": ["errors", "settings", "geometry", "sweeps", "core", "ego_motion"],
    "common_frame": ["errors", "settings", "geometry", "sweeps", "core", "ego_motion"],
    "estimators": ["errors", "settings", "core", "common_frame", "objects"],
    "scene_flow": [*_METHOD, "estimators"],
    "methods": [*_METHOD, "ego_motion", "common_frame", "estimators"],
    "online": [*_METHOD, "estimators"],
    "sweeps_io": ["errors", "settings", "sweeps"],
    "recording": [*_BASE, "geometry", "sweeps", "msg_utils"],
    "simulation": [*_BASE, "geometry", "sweeps", "msg_utils", "recording"],
    "datasets": [
        *(*_BASE, "geometry", "sweeps", "sweeps_io", "msg_utils", "recording", "simulation"),
    ],
    "evaluation": [
        *("mnsf_ros", *_METHOD, "msg_utils", "settings_documents", "scene_flow", "methods"),
        *("recording", "simulation", "datasets", "ego_motion"),
    ],
    "node": [*_METHOD, "msg_utils", "settings_documents", "ego_motion", "online"],
    "drawing": ["errors", "geometry"],
    "report": [
        *("mnsf_ros", "errors", "settings", "geometry", "sweeps", "msg_utils", "recording"),
        *("evaluation", "drawing"),
    ],
    "studies": [*_METHOD, "methods", "recording", "simulation", "evaluation"],
    "demo": ["*"],
    "cli": ["*"],
}

ROS = (
    *("rclpy", "rcl_interfaces", "rclcpp", "ament_*", "builtin_interfaces", "launch", "launch_*"),
    *("*_msgs", "*_msgs_py", "tf2*", "rosidl_*", "ros2*", "rpyutils", "unique_identifier_msgs"),
)

# Packages from outside that a layer may import; a layer that is not here may import any but ROS.
OUTSIDE = {
    "msg_utils": ["numpy"],
    "mnsf_ros": [],
    "errors": [],
    "settings": [],
    "presets": [],
    "settings_documents": [],
    "geometry": ["numpy", "scipy"],
    "sweeps": ["numpy", "scipy"],
    "core": ["numpy", "scipy", "torch", "edt"],
    "ego_motion": ["numpy", "scipy", "small_gicp"],
    "objects": ["numpy", "scipy", "torch", "small_gicp"],
    "common_frame": ["numpy", "torch"],
    "estimators": [],
    "scene_flow": ["numpy"],
    "methods": ["numpy", "scipy", "torch"],
    "online": ["numpy", "torch"],
    "sweeps_io": ["numpy", "pyarrow"],
}

MAY_IMPORT_ROS = ["node"]
MAY_PRINT_AND_EXIT = ["mnsf_ros.cli", "mnsf_ros.cli.*", "mnsf_ros.node.main"]


def read_sources():
    """Dotted name of each module of the project to its source."""
    sources = {}
    for package in ("msg_utils", "mnsf_ros"):
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            sources[name] = path.read_text()
    return sources


def layer_of(module):
    """`core` for `mnsf_ros.core.batches`, `msg_utils` for all of that package."""
    parts = module.split(".")
    return parts[1] if parts[0] == "mnsf_ros" and len(parts) > 1 else parts[0]


SOURCES = read_sources()
STUBS = dict.fromkeys([module for module in SOURCES if layer_of(module) in LAYERS], "")


def imports_of(module, sources):
    """Dotted names that the module imports, wherever in it, each with its line."""
    for node in ast.walk(ast.parse(sources[module])):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom):
            yield from _imports_from(node, module, sources)


def _imports_from(node, module, sources):
    start = node.module or ""
    if node.level:
        package = module.split(".")[: -node.level]
        start = ".".join([*package, start] if start else package)
    for alias in node.names:
        full = f"{start}.{alias.name}"
        is_module = full in sources or any(name.startswith(f"{full}.") for name in sources)
        yield (full if is_module else start), node.lineno


def import_problems(sources):
    """One line for each import that breaks a rule."""
    problems = []
    for module in sources:
        layer = layer_of(module)
        if layer not in LAYERS:
            problems.append(f"{module}: its layer {layer!r} is not in the table of this test")
            continue
        for name, line in imports_of(module, sources):
            problem = _import_problem(layer, name)
            if problem:
                problems.append(f"{module}, line {line}: {problem}")
    return problems


def _import_problem(layer, name):
    top = name.split(".")[0]
    if top in ("msg_utils", "mnsf_ros"):
        other = layer_of(name)
        allowed = LAYERS[layer]
        is_allowed = other in (layer, *allowed) or "*" in allowed
        return "" if is_allowed else f"{layer} must not import {other} ({name})"
    if top in sys.stdlib_module_names:
        return ""
    if any(fnmatch.fnmatch(top, pattern) for pattern in ROS) and layer not in MAY_IMPORT_ROS:
        return f"{layer} must not import ROS ({name})"
    if top not in OUTSIDE.get(layer, [top]):
        return f"{layer} must not import {top}"
    return ""


def import_cycle(sources):
    """The modules of an import cycle, in order; empty if there is none."""
    edges = {
        module: sorted({name for name, _ in imports_of(module, sources) if name in sources})
        for module in sources
    }
    done, path = set(), []

    def visit(module):
        if module in path:
            return [*path[path.index(module) :], module]
        if module in done:
            return []
        path.append(module)
        cycles = (visit(other) for other in edges[module])
        cycle = next((cycle for cycle in cycles if cycle), [])
        path.pop()
        done.add(module)
        return cycle

    return next((cycle for cycle in map(visit, edges) if cycle), [])


def manners_problems(sources):
    """One line for each assert, and for each print or exit outside the command line."""
    problems = []
    for module, source in sources.items():
        is_free = any(fnmatch.fnmatch(module, pattern) for pattern in MAY_PRINT_AND_EXIT)
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Assert):
                problems.append(f"{module}, line {node.lineno}: assert")
            elif not is_free and _says_or_ends(node):
                problems.append(f"{module}, line {node.lineno}: {ast.unparse(node)}")
    return problems


def _says_or_ends(node):
    if isinstance(node, ast.Call):
        called = ast.unparse(node.func)
        return called in {"print", "exit", "quit", "sys.exit", "os._exit", "os.abort", "SystemExit"}
    if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Name):
        return node.exc.id == "SystemExit"
    # `from sys import exit` would hide its calls.
    return (
        isinstance(node, ast.ImportFrom)
        and node.module == "sys"
        and (any(alias.name == "exit" for alias in node.names))
    )


def test_imports_go_downward():
    assert import_problems(SOURCES) == []


def test_no_import_cycle():
    assert import_cycle(SOURCES) == []


def test_nobody_asserts_and_only_the_command_line_prints_or_exits():
    assert manners_problems(SOURCES) == []


def test_table_itself_goes_downward():
    order = list(LAYERS)
    for layer, allowed in LAYERS.items():
        assert set(allowed) - {"*"} <= set(order[: order.index(layer)])


def test_every_layer_of_the_table_exists():
    existing = {layer_of(module) for module in SOURCES}
    assert {"msg_utils", "mnsf_ros", *_METHOD, "scene_flow", "online", "node"} <= existing


@pytest.mark.parametrize(
    ("module", "line", "problem"),
    [
        ("msg_utils.x", "import sensor_msgs.msg", "must not import ROS (sensor_msgs.msg)"),
        ("msg_utils.x", "import rosbags", "msg_utils must not import rosbags"),
        ("msg_utils.x", "from mnsf_ros.errors import MnsfError", "must not import errors"),
        ("mnsf_ros.errors", "import numpy", "errors must not import numpy"),
        ("mnsf_ros.settings", "import torch", "settings must not import torch"),
        ("mnsf_ros.settings", "from mnsf_ros import presets", "settings must not import presets"),
        ("mnsf_ros.presets", "from mnsf_ros.core import batches", "must not import core"),
        ("mnsf_ros.sweeps.x", "def f():\n    import torch", "line 2: sweeps must not import torch"),
        ("mnsf_ros.sweeps.x", "from ..core import batches", "sweeps must not import core"),
        ("mnsf_ros.sweeps.x", "from rosbags.highlevel import AnyReader", "import rosbags"),
        ("mnsf_ros.core.x", "from msg_utils.stamps import decode_stamp", "import msg_utils"),
        ("mnsf_ros.core.x", "import mnsf_ros.online.online_pipeline", "must not import online"),
        ("mnsf_ros.core.x", "from rclpy.node import Node", "core must not import ROS"),
        ("mnsf_ros.core.x", "from mnsf_ros.presets import preset", "must not import presets"),
        ("mnsf_ros.online.x", "import rosbags", "online must not import rosbags"),
        ("mnsf_ros.online.x", "from msg_utils import stamps", "online must not import msg_utils"),
        ("mnsf_ros.online.x", "import mnsf_ros.node.main", "online must not import node"),
        ("mnsf_ros.recording.x", "import rclpy", "recording must not import ROS (rclpy)"),
        ("mnsf_ros.recording.x", "import mnsf_ros.simulation", "must not import simulation"),
        ("mnsf_ros.simulation.x", "from nav_msgs.msg import Odometry", "must not import ROS"),
        ("mnsf_ros.evaluation.x", "import builtin_interfaces.msg", "must not import ROS"),
        ("mnsf_ros.evaluation.x", "from mnsf_ros import node", "must not import node"),
        ("mnsf_ros.evaluation.x", "from mnsf_ros.report import html", "must not import report"),
        ("mnsf_ros.report.x", "from mnsf_ros.methods import make_method", "not import methods"),
        ("mnsf_ros.report.x", "from mnsf_ros.studies import run_study", "must not import studies"),
        ("mnsf_ros.studies.x", "from mnsf_ros.report import html", "must not import report"),
        ("mnsf_ros.studies.x", "from mnsf_ros import node", "studies must not import node"),
        ("mnsf_ros.node.x", "from mnsf_ros.recording import truth", "must not import recording"),
        ("mnsf_ros.cli.x", "import rclpy", "cli must not import ROS (rclpy)"),
        ("mnsf_ros.helpers.x", "", "its layer 'helpers' is not in the table"),
    ],
)
def test_forbidden_import_is_found(module, line, problem):
    problems = import_problems({**STUBS, module: line})
    assert len(problems) == 1
    assert problem in problems[0]
    assert problems[0].startswith(module)


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("msg_utils.x", "import array, numpy as np"),
        ("mnsf_ros.core.x", "import torch\nfrom mnsf_ros.sweeps.sweep import Sweep"),
        ("mnsf_ros.core.x", "from . import batches\nfrom .batches import evaluate"),
        ("mnsf_ros.node.x", "import rclpy\nfrom sensor_msgs.msg import PointCloud2"),
        ("mnsf_ros.recording.x", "import rosbags\nfrom msg_utils import stamps"),
        ("mnsf_ros.cli.x", "from mnsf_ros import __version__\nfrom mnsf_ros.node import main"),
    ],
)
def test_allowed_import_is_left_alone(module, line):
    assert import_problems({**STUBS, module: line}) == []


@pytest.mark.parametrize(
    ("files", "cycle"),
    [
        ({"a": "import b", "b": "import c", "c": "import b"}, ["b", "c", "b"]),
        ({"a": "def f():\n    from a import g"}, ["a", "a"]),
        ({"p": "", "p.a": "from p import b", "p.b": "from . import a"}, ["p.a", "p.b", "p.a"]),
        ({"p": "from p.a import f", "p.a": "import p"}, ["p", "p.a", "p"]),
        ({"a": "import b, c", "b": "import c", "c": ""}, []),
    ],
)
def test_cycle_is_found(files, cycle):
    assert import_cycle(files) == cycle


@pytest.mark.parametrize(
    "line",
    [
        "assert True",
        "print('hello')",
        "import sys\nsys.exit(1)",
        "from sys import exit",
        "raise SystemExit",
        "raise SystemExit(2)",
        "def f():\n    quit()",
        "import os\nos._exit(0)",
    ],
)
def test_bad_manners_are_found(line):
    assert len(manners_problems({"mnsf_ros.core.x": line})) == 1
    is_assert = line.startswith("assert")
    assert len(manners_problems({"mnsf_ros.cli.x": line})) == is_assert


def test_good_manners_are_left_alone():
    source = "console.print('x')\nraise ValueError('exit')\nworker.exit()\nimport sys"
    assert manners_problems({"mnsf_ros.core.x": source}) == []


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


ROS_NAMES = ["rclpy", "sensor_msgs", "std_msgs", "nav_msgs", "builtin_interfaces", "rcl_interfaces"]


@pytest.mark.parametrize(
    ("layers", "blocked"),
    [
        (["errors", "settings", "presets"], ["torch", "numpy", "scipy", "rosbags", *ROS_NAMES]),
        (["msg_utils"], ["torch", "scipy", "rosbags", "mnsf_ros", *ROS_NAMES]),
        (["sweeps"], ["torch", "rosbags", "msg_utils", *ROS_NAMES]),
        (["core", "methods", "online", "scene_flow"], ["rosbags", "msg_utils", *ROS_NAMES]),
        (["evaluation", "report", "studies", "datasets", "sweeps_io"], ROS_NAMES),
    ],
    ids=lambda names: names[0],
)
def test_imports_where_nothing_else_is_installed(layers, blocked):
    modules = [module for module in SOURCES if layer_of(module) in layers]
    assert modules
    result = import_without(modules, blocked)
    assert result.returncode == 0, result.stderr


def test_blocked_module_is_really_missing():
    result = import_without(["mnsf_ros.core.batches"], ["torch"])
    assert result.returncode != 0
    assert "torch" in result.stderr
