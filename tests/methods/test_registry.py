# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Methods by name: ours, and those of packages that are really installed."""

import sys

import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import MnsfError, SettingsError
from mnsf_ros.methods import make_method, method_names
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

PAPER = preset("paper").changed({"compute.device": "cpu"})

CODE = """
import numpy as np
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never

class Constant:
    traits = MethodTraits()

    def __init__(self, settings):
        self.settings = settings

    def renewed(self, settings):
        return Constant(settings)

    def estimate(self, triplet, cancelled=never):
        flow = np.full_like(triplet.current.xyz, self.settings.compute.seed)
        return FlowEstimate(flow, np.ones(len(flow), bool))

class NoEstimator:
    def __init__(self, settings):
        self.traits = 3

class Old:
    def __init__(self, settings):
        self.settings = settings

    def estimate(self, triplet):
        pass

not_callable = 3
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Installs a distribution as pip would: its module and its metadata on the path."""

    def install_it(package, methods, folder="site"):
        site = tmp_path / folder
        metadata = site / f"{package}-1.0.dist-info"
        metadata.mkdir(parents=True)
        (site / f"{package}_module.py").write_text(CODE)
        (metadata / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n"
        )
        lines = [f"{name} = {target}" for name, target in methods.items()]
        text = "\n".join(["[mnsf_ros.methods]", *lines, ""])
        (metadata / "entry_points.txt").write_text(text)
        monkeypatch.syspath_prepend(site)
        monkeypatch.delitem(sys.modules, f"{package}_module", raising=False)

    return install_it


def triplet():
    sweep = Sweep.from_array(np.eye(3))
    return SweepTriplet(sweep, sweep, sweep)


def test_names_are_those_of_the_paper_and_unique():
    names = method_names()
    assert len(set(names)) == len(names)
    assert set(names) >= {
        *("online", "zero", "ego", "ego-estimated", "nsfp", "nsfp-linear", "fnsf", "fnsf-linear"),
        *("fnsf-joint", "fnsf-time", "mnsf-cycle", "mnsf", "mnsf-no-backward"),
        *("mnsf-frames4", "mnsf-frames5", "flot", "3dflow", "gmsf", "scoop"),
    }


@pytest.mark.parametrize("name", [*method_names(), "command:true"])
def test_every_method_describes_itself(name, monkeypatch):
    for network in ("FLOT", "3DFLOW", "GMSF", "SCOOP"):
        monkeypatch.setenv(f"MNSF_{network}", "true")
    settings = PAPER.changed({"warm_start.enabled": True})
    estimator = make_method(name, settings)
    traits = estimator.traits
    assert traits.is_reference == (name in ("zero", "ego", "ego-estimated"))
    assert traits.needs_poses == (name == "ego")
    assert traits.is_external == (name in ("flot", "3dflow", "gmsf", "scoop", "command:true"))
    assert traits.carries_state == (name in ("online", "ego-estimated"))
    assert traits.is_timed
    changed = settings.changed({"compute.seed": 3, "fusion.kind": "weighted_sum"})
    again = estimator.renewed(changed)
    if name != "online":
        assert again.settings == make_method(name, changed).settings
    assert again.traits == traits


@pytest.mark.parametrize("preset_name", ["online", "mnsf", "paper", "authors"])
def test_online_is_what_the_robot_runs_under_any_preset(preset_name):
    settings = make_method("online", preset(preset_name)).settings
    assert settings == preset("online")
    # What was set by hand still holds, also to the value that the preset has.
    values = {"objects.cell_size_m": 0.3, "crop.min_range_m": 0.0, "warm_start.enabled": False}
    changed = preset(preset_name).changed({**values, "method.name": "online"})
    assert make_method("online", changed).settings == preset("online").changed(values)
    variant = make_method("online+objects.min_points=9", preset(preset_name)).settings
    assert variant == preset("online").changed({"objects.min_points": 9})


@pytest.mark.parametrize("name", ["", "MNSF", "mnsf-frames3", "fnfs", "files:x"])
def test_unknown_name(name):
    with pytest.raises(
        SettingsError,
        match=rf"{name!r}.*; there are online, zero, ego, ego-estimated, nsfp",
    ):
        make_method(name, PAPER)
    with pytest.raises(SettingsError, match="did you mean mnsf-frames"):
        make_method("mnsf-frames3", PAPER)


@pytest.mark.parametrize("start", ["online", "mnsf", "paper"])
def test_a_preset_before_the_name_replaces_the_one_that_is_chosen(start):
    by_hand = {"crop.max_range_m": 30.0, "optimization.max_iterations": 7}
    settings = preset(start).changed(by_hand)
    for name in ("mnsf", "paper", "authors"):
        made = make_method(f"{name}/mnsf", settings).settings
        assert made == preset(name).changed(by_hand)
        variant = make_method(f"{name}/mnsf+optimization.max_iterations=9", settings).settings
        assert variant == made.changed({"optimization.max_iterations": 9})
    # Also in place of a method's own.
    assert make_method("paper/online", settings).settings == preset("paper").changed(by_hand)


def test_published_and_live_form_of_a_method_side_by_side():
    both = [make_method(f"{name}/mnsf", PAPER) for name in ("paper", "mnsf")]
    assert [one.traits.carries_state for one in both] == [False, True]
    assert make_method("mnsf", PAPER).settings == both[0].settings


def test_naming_mnsf_on_top_of_paper_leaves_it_as_published():
    named = preset("paper").changed({"method.name": "mnsf", "compute.device": "cpu"})
    assert make_method("mnsf", named).settings == named
    assert not named.live.enabled


@pytest.mark.parametrize(
    ("name", "preset_name"),
    [("papr/mnsf", "papr"), ("/mnsf", ""), ("paper/mnsf/mnsf", "paper/mnsf")],
)
def test_unknown_preset_before_the_name(name, preset_name):
    text = f"^method {name!r}: unknown preset {preset_name!r}, expected one of online, mnsf, paper"
    with pytest.raises(SettingsError, match=text):
        make_method(name, PAPER)


def test_a_slash_in_a_folder_or_command_is_no_preset(tmp_path):
    assert make_method(f"file:{tmp_path}", PAPER).settings == PAPER
    assert make_method("command:paper/mnsf", PAPER).settings == PAPER


@pytest.mark.parametrize("name", ["mnsf+fusion.kind", "mnsf+fusion.kind=sum", "mnsf+kind=mean"])
def test_variant_with_a_wrong_setting(name):
    with pytest.raises(SettingsError, match="kind"):
        make_method(name, PAPER)


def test_method_of_another_package(install):
    install("theirs", {"constant": "theirs_module:Constant", "aaa": "theirs_module:Constant"})
    assert method_names()[-2:] == ("aaa", "constant")
    estimate = make_method("constant", PAPER.changed({"compute.seed": 7})).estimate(triplet())
    assert isinstance(estimate, FlowEstimate)
    assert (estimate.flow == 7).all()


def test_same_name_in_two_packages(install):
    install("theirs", {"constant": "theirs_module:Constant"}, folder="a")
    install("others", {"constant": "others_module:Constant"}, folder="b")
    assert method_names().count("constant") == 1
    text = "^method 'constant' is offered by others and theirs; uninstall all but one$"
    with pytest.raises(SettingsError, match=text):
        make_method("constant", PAPER)


def test_our_names_stay_ours(install):
    names = method_names()
    install("theirs", {"mnsf": "theirs_module:Constant"})
    assert method_names() == names
    assert make_method("mnsf", PAPER).traits.num_sweeps == 3


@pytest.mark.parametrize(
    ("target", "text"),
    [
        ("no_such_module:Constant", "cannot load 'no_such_module:Constant': No module named"),
        ("theirs_module:Missing", "'theirs_module:Missing' cannot be made: AttributeError: "),
        ("theirs_module:not_callable", "'theirs_module:not_callable' cannot be made: TypeError: "),
        (
            "theirs_module:NoEstimator",
            r"NoEstimator lacks estimate, renewed, settings, which every method must have",
        ),
        ("theirs_module:Old", r"Old lacks renewed, traits"),
    ],
)
def test_broken_package(install, target, text):
    install("theirs", {"broken": target})
    assert "broken" in method_names()
    with pytest.raises(MnsfError, match=f"^method 'broken' of theirs: {text}"):
        make_method("broken", PAPER)
