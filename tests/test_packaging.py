"""What colcon, pip and ROS need to find agrees with each other."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

import mnsf_ros
from mnsf_ros.cli.parameters import TITLES
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings import Settings
from mnsf_ros.settings_documents import settings_markdown, settings_yaml

ROOT = Path(__file__).parents[1]


def test_package_xml_has_the_version_of_the_package() -> None:
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    assert package.findtext("name") == "mnsf_ros"
    assert package.findtext("version") == mnsf_ros.__version__
    assert package.findtext("license") == "Apache-2.0"


def test_executables_go_where_ros2_run_looks() -> None:
    assert "install_scripts=$base/lib/mnsf_ros" in (ROOT / "setup.cfg").read_text()
    assert (ROOT / "resource" / "mnsf_ros").exists()


def test_ros_wheels_are_no_hard_requirement() -> None:
    """Beside an installed ROS they would shadow it."""
    text = (ROOT / "setup.py").read_text()
    required = text[text.index("install_requires") : text.index("extras_require")]
    assert "ros-" not in required


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
    content = yaml.safe_load((ROOT / "config" / f"{name}.yaml").read_text())
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
    assert 'executable="scene_flow_node"' in text
    assert "scene_flow_node = mnsf_ros.node.main:main" in (ROOT / "setup.py").read_text()
    for folder, name in re.findall(r'SHARE, "(\w+)", "([\w.]+)"', text):
        assert (ROOT / folder / name).exists()


def test_readme_names_only_what_is_there() -> None:
    text = (ROOT / "README.md").read_text()
    links = re.findall(r"\]\((?!https?:)([^)#]+)\)", text)
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
    names = set(re.findall(r"`([a-z_]+\.[a-z_]+)`", text))
    declared = set(Settings().to_mapping())
    groups = {name.partition(".")[0] for name in declared}
    assert [name for name in names if name.split(".")[0] in groups and name not in declared] == []
