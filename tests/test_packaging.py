# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Files that repeat each other agree: versions, requirements and pins, settings."""

import importlib
import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
import setuptools  # noqa: F401 - has distutils, which Python has no longer
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from ruamel.yaml import YAML

import mnsf_ros
from mnsf_ros.cli.evaluation import new_folder
from mnsf_ros.cli.parameters import TITLES
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings import Settings
from mnsf_ros.settings_documents import settings_markdown, settings_yaml

ROOT = Path(__file__).parents[1]


def test_package_xml_and_changelog_have_the_version_of_the_package() -> None:
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    assert package.findtext("version") == mnsf_ros.__version__
    text = (ROOT / "CHANGELOG.rst").read_text()
    assert re.search(rf"^{mnsf_ros.__version__} \(\d{{4}}-\d\d-\d\d\)\n-+$", text, re.MULTILINE)


@pytest.fixture(scope="module")
def requirements() -> dict[str, list[Requirement]]:
    """Extra -> what setup.py asks for; "" -> what the package always needs."""
    package = importlib.import_module("distutils.core").run_setup(
        str(ROOT / "setup.py"), stop_after="init"
    )
    lines = {"": package.install_requires, **package.extras_require}
    return {extra: [Requirement(line) for line in own] for extra, own in lines.items()}


def names_of(wanted: list[Requirement]) -> set[str]:
    return {canonicalize_name(requirement.name) for requirement in wanted}


def test_recipe_for_ros_installs_every_requirement(requirements) -> None:
    """By rosdep from package.xml, or by pip; rosbags brings backports.zstd."""
    (line,) = re.findall(r"^pip install 'numpy<2' (.+)$", (ROOT / "README.md").read_text(), re.M)
    keys = re.findall(
        r"<exec_depend>python3-(\w+)</exec_depend>", (ROOT / "package.xml").read_text()
    )
    installed = {canonicalize_name(name) for name in (*line.split(), *keys)}
    assert names_of(requirements[""]) - installed == {"setuptools", "backports-zstd"}


def test_pixi_has_the_packages_of_ros_that_package_xml_names() -> None:
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    keys = [element.text.replace("_", "-") for element in package.iter("exec_depend")]
    wanted = {f"ros-jazzy-{key}" for key in keys if not key.startswith("python3-")}
    names = re.findall(r"^(ros-\S+) = ", (ROOT / "pixi.toml").read_text(), re.MULTILINE)
    assert {*names} == wanted


def test_hard_requirements_exclude_ros_and_pytorch(requirements) -> None:
    """Wheels of ROS would shadow an installed ROS; PyTorch is gigabytes, and `online` has none."""
    assert not [name for name in names_of(requirements[""]) if name.startswith(("ros-", "torch"))]


def test_each_requirement_has_a_pin_that_it_allows(requirements) -> None:
    """`make pins` checks that the pins have wheels."""
    lines = re.findall(r"^[^#\n]+", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
    pins = [Requirement(line) for line in lines]
    # Ray has no wheel for every Python.
    for wanted in (each for extra, own in requirements.items() if extra != "ray" for each in own):
        versions = [
            next(iter(pin.specifier)).version
            for pin in pins
            if canonicalize_name(pin.name) == canonicalize_name(wanted.name)
        ]
        assert versions or wanted.name == "setuptools", wanted
        assert all(wanted.specifier.contains(version) for version in versions), wanted


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="needs a checkout")
def test_git_ignores_results_without_a_name_of_the_user():
    names = [str(new_folder([Path("street"), Path("other")])), "tuned", "study_frames"]
    paths = [f"{name}/rows.jsonl" for name in names]
    command = ["git", "check-ignore", "--no-index", *paths]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == paths


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
