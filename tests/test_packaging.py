# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What colcon, pip and ROS need to find agrees with each other."""

import ast
import email
import importlib
import re
import shlex
import subprocess
import sys
import tarfile
from email.message import Message
from pathlib import Path
from xml.etree import ElementTree

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from ruamel.yaml import YAML

import mnsf_ros
from mnsf_ros.cli.main import run
from mnsf_ros.cli.parameters import TITLES
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings import Settings
from mnsf_ros.settings_documents import settings_markdown, settings_yaml

ROOT = Path(__file__).parents[1]
DOCUMENTS = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
PYTHON_VERSIONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
# What a machine without ROS needs but for PyTorch, which has an index of its own.
LOCKED_EXTRAS = ("", "wheels", "view", "datasets", "tune")
INSTALLED_EXTRAS = ("wheels", "networks", "datasets", "tune", "view", "test", "lint")


def test_package_xml_has_the_version_of_the_package() -> None:
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    assert package.findtext("name") == "mnsf_ros"
    assert package.findtext("version") == mnsf_ros.__version__
    assert package.findtext("license") == "Apache-2.0"


def test_changelog_has_a_dated_section_of_this_version() -> None:
    text = (ROOT / "CHANGELOG.rst").read_text()
    assert re.search(rf"^{mnsf_ros.__version__} \(\d{{4}}-\d\d-\d\d\)\n-+$", text, re.MULTILINE)


def test_executables_go_where_ros2_run_looks() -> None:
    assert "install_scripts=$base/lib/mnsf_ros" in (ROOT / "setup.cfg").read_text()
    assert (ROOT / "resource" / "mnsf_ros").exists()


def test_recipe_for_ros_installs_every_requirement(declared: str) -> None:
    """By rosdep from package.xml, or by pip; rosbags brings backports.zstd."""
    (line,) = re.findall(r"^pip install 'numpy<2' (.+)$", (ROOT / "README.md").read_text(), re.M)
    keys = re.findall(
        r"<exec_depend>python3-(\w+)</exec_depend>", (ROOT / "package.xml").read_text()
    )
    installed = {canonicalize_name(name) for name in (*line.split(), *keys)}
    wanted = {canonicalize_name(wanted.name) for wanted in requirements(declared)}
    assert wanted - installed == {"setuptools", "backports-zstd"}


def test_what_is_no_hard_requirement(declared: str) -> None:
    """Wheels of ROS would shadow an installed ROS; PyTorch is gigabytes, and `online` has none."""
    names = {canonicalize_name(wanted.name) for wanted in requirements(declared)}
    assert {name for name in names if name.startswith(("ros-", "torch"))} == set()


def test_ros_tools_that_the_readme_uses_are_installed_by_rosdep() -> None:
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    keys = {element.text for element in package.findall("exec_depend")}
    assert {"rclpy", "launch_ros", "ros2launch", "rviz2"} <= keys
    assert {element.get("type") for element in package.findall("url")} >= {"website", "repository"}


@pytest.fixture(scope="module")
def source_archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sdist")
    subprocess.run(
        [
            *(sys.executable, "setup.py", "-q"),
            *("egg_info", "--egg-base", folder, "sdist", "--dist-dir", folder),
        ],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    (archive,) = folder.glob("*.tar.gz")
    return archive


def test_source_archive_has_what_the_makefile_and_the_tests_need(source_archive: Path) -> None:
    with tarfile.open(source_archive) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    for name in (
        *("constraints.txt", "Makefile", "pyproject.toml", "package.xml", "resource/mnsf_ros"),
        *("CONTRIBUTING.md", "docs/recipes.md", "tests/conftest.py", ".ci/check_ros_recipe"),
        *("config/online.yaml", "launch/scene_flow.launch.py", "benchmarks/movers.py"),
        *("QUALITY_DECLARATION.md", ".gitignore", "locked.txt"),
    ):
        assert name in names


@pytest.fixture(scope="module")
def metadata(source_archive: Path) -> Message:
    with tarfile.open(source_archive) as archive:
        (name,) = (name for name in archive.getnames() if re.fullmatch(r"[^/]+/PKG-INFO", name))
        return email.message_from_binary_file(archive.extractfile(name))


@pytest.fixture(scope="module")
def declared(source_archive: Path) -> str:
    """What setup.py requires, as every setuptools writes it: sections `[EXTRA:MARKER]`."""
    return (source_archive.parent / "mnsf_ros.egg-info" / "requires.txt").read_text()


def requirements(declared: str, extra: str = "") -> list[Requirement]:
    """What the package always needs, or what one extra adds."""
    sections = re.findall(
        r"^\[(.*?)(?::.*)?\]\n((?:[^[\n].*\n|\n)*)", f"[]\n{declared}", re.MULTILINE
    )
    lines = [line for name, text in sections if name == extra for line in text.splitlines()]
    return [Requirement(line) for line in lines if line]


def test_metadata_says_what_the_package_is(metadata: Message) -> None:
    assert metadata["Name"] == "mnsf_ros"
    assert metadata["Author"]
    assert metadata["Description-Content-Type"] == "text/markdown"
    assert len(metadata.get_all("Project-URL")) >= 3
    assert "networks" in metadata.get_all("Provides-Extra")
    assert "## Install" in str(metadata.get_payload() or metadata["Description"])


def pins(version: str, name: str = "constraints.txt") -> dict[str, list[Requirement]]:
    """The pins that hold for a Python version on x86-64 Linux, by the name of the library."""
    # In locked.txt, lines that begin with a space are hashes of the pin above.
    lines = re.findall(r"^[^#\s][^\\\n]*", (ROOT / name).read_text(), re.MULTILINE)
    all_pins = [Requirement(line) for line in lines]
    found: dict[str, list[Requirement]] = {canonicalize_name(pin.name): [] for pin in all_pins}
    for pin in all_pins:
        python = {"python_version": version, "python_full_version": f"{version}.0"}
        if not pin.marker or pin.marker.evaluate(python):
            found[canonicalize_name(pin.name)].append(pin)
    return found


@pytest.mark.parametrize("version", PYTHON_VERSIONS)
def test_each_library_has_one_pin_for_each_python(version: str) -> None:
    """`make pins` checks that the pins have wheels."""
    assert {name: len(found) for name, found in pins(version).items() if len(found) != 1} == {}


@pytest.mark.parametrize("version", PYTHON_VERSIONS)
def test_pins_are_what_setup_py_asks_for(version: str, declared: str) -> None:
    extras = [wanted for name in INSTALLED_EXTRAS for wanted in requirements(declared, name)]
    found = pins(version)
    assert len(extras) > len(INSTALLED_EXTRAS)
    for wanted in [*requirements(declared), *extras]:
        if wanted.name != "setuptools":
            (pin,) = found[canonicalize_name(wanted.name)]
            (exact,) = pin.specifier
            assert wanted.specifier.contains(exact.version), wanted


@pytest.mark.parametrize("version", PYTHON_VERSIONS)
def test_locked_versions_are_those_of_the_pins(version: str, declared: str) -> None:
    locked, pinned = pins(version, "locked.txt"), pins(version)
    wanted = [each.name for name in LOCKED_EXTRAS for each in requirements(declared, name)]
    assert len(wanted) > len(LOCKED_EXTRAS)
    assert {canonicalize_name(name) for name in wanted} <= set(locked)
    assert all(len(found) <= 1 for found in locked.values())
    both = [(*found, *pinned[name]) for name, found in locked.items() if found and name in pinned]
    assert len(both) > len(LOCKED_EXTRAS)
    assert all(one.specifier == other.specifier for one, other in both)


def test_each_locked_library_has_hashes_of_its_files() -> None:
    """Without them pip would refuse the whole file."""
    text = (ROOT / "locked.txt").read_text()
    entries = re.findall(
        r"^[^#\s].*(?:\n +--hash=sha256:[0-9a-f]{64}(?: \\)?)+$", text, re.MULTILINE
    )
    assert len(entries) == len(re.findall(r"^[^#\s]", text, re.MULTILINE)) > len(LOCKED_EXTRAS)


def test_python_versions_are_those_that_the_package_names(metadata: Message) -> None:
    start = "Programming Language :: Python :: "
    named = [
        line.removeprefix(start)
        for line in metadata.get_all("Classifier")
        if line.startswith(start)
    ]
    assert tuple(named) == PYTHON_VERSIONS
    assert metadata["Requires-Python"] == f">={PYTHON_VERSIONS[0]}"


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_config_files_are_what_the_settings_say(name: str) -> None:
    """`make config` writes them."""
    text = (ROOT / "config" / f"{name}.yaml").read_text()
    assert text == settings_yaml(preset(name), TITLES[name])


def test_parameter_table_is_what_the_settings_say() -> None:
    """`make config` writes it."""
    table = settings_markdown({name: preset(name) for name in PRESET_NAMES})
    assert (ROOT / "docs" / "parameters.md").read_text().endswith(table)


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_config_files_hold_the_preset(name: str) -> None:
    content = YAML(typ="safe").load((ROOT / "config" / f"{name}.yaml").read_text())
    # Only this head holds for every node name and namespace.
    groups = content["/**"]["ros__parameters"]
    values = {
        f"{group}.{key}": value for group, keys in groups.items() for key, value in keys.items()
    }
    assert Settings().changed(values) == preset(name)
    for key, value in preset(name).to_mapping().items():
        assert type(values[key]) is type(value), key


def test_launch_file_starts_the_executable_with_files_that_are_there() -> None:
    text = (ROOT / "launch" / "scene_flow.launch.py").read_text()
    compile(text, "scene_flow.launch.py", "exec")
    setup = (ROOT / "setup.py").read_text()
    for name, function in (
        ("scene_flow_node", "main"),
        ("scene_flow_lifecycle_node", "lifecycle_main"),
    ):
        assert f'"{name}"' in text
        assert f'"{name} = mnsf_ros.node.__main__:{function}"' in setup
    for folder, name in re.findall(r'SHARE, "(\w+)", "([\w.]+)"', text):
        assert (ROOT / folder / name).exists()


def anchors(path: Path) -> set[str]:
    """What a link into a document may name: its headings as GitHub spells them."""
    headings = re.findall(r"^#+ (.+)$", path.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_of_documents_lead_somewhere(path: Path) -> None:
    for link in re.findall(r"\]\((?!https?:)([^)\[]+)\)", path.read_text()):
        file, _, anchor = link.partition("#")
        target = path.parent / file if file else path
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


def test_index_of_documents_has_all_of_them() -> None:
    index = (ROOT / "docs" / "README.md").read_text()
    pages = {path.name for path in (ROOT / "docs").glob("*.md")} - {"README.md"}
    assert {name for name in pages if f"]({name})" not in index} == set()


def test_layers_are_those_of_the_contract() -> None:
    contract = (ROOT / "pyproject.toml").read_text().partition("layers = [")[2].partition("]")[0]
    picture = (ROOT / "CONTRIBUTING.md").read_text()
    lines = [re.split(r"\s{2,}", line)[0] for line in picture.splitlines()]
    layers = re.findall(r'"(.+)"', contract)
    assert [line for line in lines if line in layers] == layers


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_documents_name_only_settings_that_are_there(path: Path) -> None:
    names = set(re.findall(r"(?<![\w.])([a-z_]+\.[a-z_]+)(?=[`:=\s])", path.read_text()))
    declared = set(Settings().to_mapping())
    groups = {name.partition(".")[0] for name in declared}
    modules = {"sweeps", "objects.py"}
    found = {name for name in names if name.split(".")[0] in groups - modules}
    assert {name for name in found - declared if not name.endswith((".py", ".md", "._"))} == set()


def commands(text: str) -> list[list[str]]:
    """The `mnsf` command lines in the code blocks of a document, as words."""
    blocks = re.findall(r"^```(?:bash)?\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    starts = [re.sub(r"^(\w+='.*?' )?", "", line.partition(" #")[0]) for line in lines]
    return [shlex.split(line)[1:] for line in starts if line.startswith("mnsf ")]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_of_documents_have_options_that_are_there(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in commands(path.read_text()):
        with pytest.raises(SystemExit) as ended:
            run([words[0], "--help"])
        assert ended.value.code == 0, words
        known = set(re.findall(r"--?[a-z][a-z-]*", capsys.readouterr().out))
        assert {word for word in words if re.match(r"--?[a-z]", word)} <= known, words


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_python_of_documents_imports_what_is_there(path: Path) -> None:
    for code in re.findall(r"^```python\n(.*?)^```", path.read_text(), re.MULTILINE | re.DOTALL):
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith(("mnsf_", "msg_")):
                module = importlib.import_module(str(node.module))
                assert [name.name for name in node.names if not hasattr(module, name.name)] == []
