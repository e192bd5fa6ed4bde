# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Methods by name: our own, and those of other installed packages.

A name with a preset before it or settings behind it, `paper/mnsf+fusion.kind=mean`, is a variant of
that method.

Another package registers a method with an entry point in the group `mnsf_ros.methods`. Its name
is the name of the method; its object is called with the settings and returns an estimator, see
`SceneFlowEstimator`.

Modules of methods that fit networks are imported when such a method is made: PyTorch takes seconds.
"""

import logging
import sys
from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pkgutil import resolve_name
from typing import Any, Final

from mnsf_ros.core.scene_flow_estimator import MethodTraits, SceneFlowEstimator
from mnsf_ros.errors import (
    LibraryError,
    MethodError,
    MnsfError,
    SettingsError,
    did_you_mean,
    library_missing,
    one_line,
)
from mnsf_ros.methods.external_flow import CommandEstimator, PredictionFiles
from mnsf_ros.methods.references import ReferenceEstimator, ego_flow, estimated_ego_flow, zero_flow
from mnsf_ros.online.object_flow import ObjectFlowEstimator
from mnsf_ros.presets import settings_for, variant_of
from mnsf_ros.settings import Settings

_LOG = logging.getLogger(__name__)

GROUP: Final = "mnsf_ros.methods"
COMMAND_PREFIX: Final = "command:"

MethodMaker = Callable[[Settings], SceneFlowEstimator]


def _network(path: str, options: Mapping[str, Any] | None = None, **traits: Any) -> MethodMaker:  # noqa: ANN401 - see below
    """A method that fits networks: `MODULE:FUNCTION` with its options, and its `NetworkMethod`."""

    def make(settings: Settings) -> SceneFlowEstimator:
        _load_torch()
        networks = import_module("mnsf_ros.methods.network_estimator")
        flow_of = partial(resolve_name(f"mnsf_ros.methods.{path}"), **(options or {}))
        method = networks.NetworkMethod(flow_of, **traits)
        return networks.NetworkEstimator(settings, method)

    return make


def _load_torch() -> None:
    if "torch" not in sys.modules:
        _LOG.info("PyTorch is loaded for the first network, which takes some seconds")
        import_module("torch")


def _live_or_as_published(settings: Settings) -> SceneFlowEstimator:
    if not settings.live.enabled:
        return _mnsf(3)(settings)
    _load_torch()
    live = import_module("mnsf_ros.methods.live_mnsf")
    estimator: SceneFlowEstimator = live.LiveMnsfEstimator(settings)
    return estimator


def _mnsf(num_sweeps: int) -> MethodMaker:
    return _network(
        "mnsf:mnsf",
        {"num_fields": num_sweeps - 1},
        num_sweeps=num_sweeps,
        # The method as published makes do with two sweeps where there is no previous one.
        needs_previous=num_sweeps != 3,
    )


_NETWORKS: Final[dict[str, MethodMaker]] = {
    "nsfp": _network("baselines:nsfp", distance_kind="tree"),
    "nsfp-linear": _network("baselines:nsfp", {"is_linear": True}, distance_kind="tree"),
    "fnsf": _network("baselines:fnsf"),
    "fnsf-linear": _network("baselines:fnsf", {"is_linear": True}),
    "fnsf-joint": _network("baselines:fnsf_joint", num_sweeps=3),
    "fnsf-time": _network("baselines:fnsf_joint", {"has_time": True}, num_sweeps=3),
    "mnsf-cycle": _network("mnsf:mnsf_cycle", num_sweeps=3),
    "mnsf": _live_or_as_published,
    # Ablation (a) of the paper, and its numbers of sweeps.
    "mnsf-no-backward": _mnsf(2),
    "mnsf-frames4": _mnsf(4),
    "mnsf-frames5": _mnsf(5),
}

# A new method is one line here or above; docs/extending.md has the recipe.
_METHODS: Final[dict[str, MethodMaker]] = {
    "online": ObjectFlowEstimator,
    "zero": partial(ReferenceEstimator, zero_flow, MethodTraits()),
    "ego": partial(ReferenceEstimator, ego_flow, MethodTraits(needs_poses=True)),
    "ego-estimated": partial(
        ReferenceEstimator, estimated_ego_flow, MethodTraits(carries_state=True)
    ),
    **_NETWORKS,
    **{
        name: partial(CommandEstimator.from_environment, name)
        for name in ("flot", "3dflow", "gmsf", "scoop")
    },
}

# What follows the prefix names files or a program.
_PREFIXES: Final[dict[str, Callable[[str, Settings], SceneFlowEstimator]]] = {
    COMMAND_PREFIX: CommandEstimator,
    "file:": PredictionFiles,
}


def method_names() -> tuple[str, ...]:
    """The names that `make_method` knows: our methods, then those of other packages."""
    others = {plug_in.name for plug_in in entry_points(group=GROUP)}
    return (*_METHODS, *sorted(others - _METHODS.keys()))


def make_method(name: str, settings: Settings) -> SceneFlowEstimator:
    """Makes a new estimator of a method.

    Args:
        name: One of `method_names`, also as a variant (`paper/mnsf+fusion.kind=mean`), or
            `command:` and a command line.
        settings: Of the estimate. A variant changes its settings on top, and `online` takes its own
            preset instead of `paper` or `authors`, see `settings_for`.

    Raises:
        SettingsError: If there is no such method, or the settings ask for a device that is not
            there.
        LibraryError: If it needs a library that is not installed.
        MethodError: If another package offers it and fails.
    """
    try:
        return _maker(variant_of(name).method)(settings_for(name, settings))
    except ModuleNotFoundError as error:
        raise LibraryError(f"method {name!r}: {library_missing(error)}") from error
    except ImportError as error:
        raise LibraryError(f"method {name!r} cannot be imported: {error}") from error


def _maker(name: str) -> MethodMaker:
    if name in _METHODS:
        return _METHODS[name]
    for prefix, make in _PREFIXES.items():
        if name.startswith(prefix):
            return partial(make, name.removeprefix(prefix))
    # A package seen twice on the path (a checkout and its installation) is still one.
    plug_ins = set(entry_points(group=GROUP, name=name))
    if not plug_ins:
        known = method_names()
        hint = did_you_mean(name, known)
        raise SettingsError(f"unknown method {name!r}{hint}; there are {', '.join(known)}")
    if len(plug_ins) > 1:
        packages = " and ".join(sorted(_package(plug_in) for plug_in in plug_ins))
        raise SettingsError(f"method {name!r} is offered by {packages}; uninstall all but one")
    return partial(_of_package, plug_ins.pop())


def _of_package(plug_in: EntryPoint, settings: Settings) -> SceneFlowEstimator:
    source = f"method {plug_in.name!r} of {_package(plug_in)}"
    try:
        estimator: SceneFlowEstimator = plug_in.load()(settings)
    except MnsfError:
        raise
    except ImportError as error:
        raise LibraryError(f"{source}: cannot load {plug_in.value!r}: {error}") from error
    except (Exception, SystemExit) as error:
        text = f"{source}: {plug_in.value!r} cannot be made: {one_line(error)}"
        raise MethodError(text) from error
    parts = ("estimate", "renewed", "settings", "traits")
    missing = [name for name in parts if not hasattr(estimator, name)]
    if missing or not isinstance(estimator.traits, MethodTraits):
        raise MethodError(
            f"{source}: {type(estimator).__name__} lacks {', '.join(missing or ['MethodTraits'])}, "
            "which every method must have; see docs/extending.md"
        )
    return estimator


def _package(plug_in: EntryPoint) -> str:
    return plug_in.dist.name if plug_in.dist else plug_in.value
