"""The rows of the paper's tables, its ablations, and two honest rows beside them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Final

from mnsf_ros.common_frame import in_common_frame
from mnsf_ros.core.multi_frame import MultiFrameEstimator
from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.estimators import make_estimator
from mnsf_ros.methods.cold_estimator import ColdEstimator, FlowOf
from mnsf_ros.methods.command_estimator import CommandEstimator
from mnsf_ros.methods.fnsf import fnsf, fnsf_joint, fnsf_linear, fnsf_time
from mnsf_ros.methods.mnsf_cycle import mnsf_cycle
from mnsf_ros.methods.nsfp import nsfp, nsfp_linear
from mnsf_ros.methods.without_optimization import (
    EgoMotionEstimator,
    EstimatedEgoMotionEstimator,
    ZeroEstimator,
)
from mnsf_ros.settings import Settings, SettingValue

MethodMaker = Callable[[Settings], SceneFlowEstimator]


def _cold(flow_of: FlowOf, num_before: int = 0, distance_kind: str | None = None) -> MethodMaker:
    make = partial(ColdEstimator, flow_of, num_before=num_before, distance_kind=distance_kind)
    return lambda settings: in_common_frame(make(settings))


def _mnsf(num_sweeps: int = 3, /, **changes: SettingValue) -> MethodMaker:
    """The paper's method with networks, and some settings of its fusion fixed."""
    values: dict[str, SettingValue] = {"field.kind": "network"}
    values |= {f"fusion.{name}": value for name, value in changes.items()}

    def make(settings: Settings) -> SceneFlowEstimator:
        return in_common_frame(MultiFrameEstimator(settings.changed(values), num_sweeps))

    return make


def _mnsf_objects(settings: Settings) -> SceneFlowEstimator:
    return make_estimator(settings.changed({"field.kind": "objects"}))


def _network(name: str) -> MethodMaker:
    return partial(CommandEstimator.from_environment, name)


BUILT_IN: Final[Mapping[str, MethodMaker]] = MappingProxyType(
    {
        "zero": ZeroEstimator,
        "ego": EgoMotionEstimator,
        "ego-estimated": EstimatedEgoMotionEstimator,
        "nsfp": _cold(nsfp, distance_kind="tree"),
        "nsfp-linear": _cold(nsfp_linear, distance_kind="tree"),
        "fnsf": _cold(fnsf),
        "fnsf-linear": _cold(fnsf_linear),
        "fnsf-joint": _cold(fnsf_joint, num_before=1),
        "fnsf-time": _cold(fnsf_time, num_before=1),
        "mnsf-cycle": _cold(mnsf_cycle, num_before=1),
        "mnsf": make_estimator,
        # Either kind of field, whatever the preset says.
        "mnsf-objects": _mnsf_objects,
        "mnsf-network": _mnsf(),
        # Ablations (a) to (c); (d) is the method itself.
        "mnsf-no-backward": _mnsf(2),
        "mnsf-mean": _mnsf(kind="mean"),
        "mnsf-no-inversion": _mnsf(inversion=False),
        # Fusion operations: mean is ablation (b), and the third is the method's own network.
        "mnsf-weighted-sum": _mnsf(kind="weighted_sum"),
        "mnsf-mlp": _mnsf(kind="mlp"),
        **{f"mnsf-depth{depth}": _mnsf(num_hidden_layers=depth) for depth in (2, 3, 5, 7)},
        # With two sweeps there is no backward flow: that is ablation (a).
        **{f"mnsf-frames{number}": _mnsf(number) for number in (2, 3, 4, 5)},
        **{name: _network(name) for name in ("flot", "3dflow", "gmsf", "scoop")},
    }
)
