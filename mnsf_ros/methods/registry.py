# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Name of a method to its estimator: our methods, and those of other installed packages.

Another package registers a method with an entry point in the group `mnsf_ros.methods`. Its name
is the name of the method; its object is called with the settings and returns an estimator, see
`SceneFlowEstimator`.

Modules of methods that fit networks are imported when such a method is made: PyTorch takes seconds.
"""

from __future__ import annotations

import difflib
import logging
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pkgutil import resolve_name
from typing import Any, Final

from mnsf_ros.core.scene_flow_estimator import MethodTraits, SceneFlowEstimator
from mnsf_ros.errors import LibraryError, SettingsError, library_missing
from mnsf_ros.methods.prediction_files import FILE_PREFIX, PredictionFiles
from mnsf_ros.methods.without_optimization import (
    EgoMotionEstimator,
    EstimatedEgoMotionEstimator,
    ZeroEstimator,
)
from mnsf_ros.objects.object_flow import ObjectFlowEstimator
from mnsf_ros.presets import settings_for
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings

_LOG = logging.getLogger(__name__)

GROUP: Final = "mnsf_ros.methods"
COMMAND_PREFIX: Final = "command:"

MethodMaker = Callable[[Settings], SceneFlowEstimator]

_TRIPLET: Final = 3

# What torch imports by itself with the first optimizer, for a second and more.
OPTIMIZER_MODULE: Final = "torch._dynamo"
_ARE_NETWORKS_LOADED: Final = threading.Event()


def _later(path: str) -> Callable[..., Any]:
    """Something of this package that is called, and imported when that happens first."""
    return partial(_called, f"mnsf_ros.methods.{path}")


def _called(path: str, *args: object, **options: object) -> Any:  # noqa: ANN401 - what it is
    return resolve_name(path)(*args, **options)


def _linear(path: str) -> Callable[..., Any]:
    return partial(_later(path), is_linear=True)


def _network(*args: Any, **options: Any) -> SceneFlowEstimator:  # noqa: ANN401 - of its class
    """A method that fits networks."""
    _import_torch()
    estimator: SceneFlowEstimator = _called(
        "mnsf_ros.methods.network_estimator:NetworkEstimator", *args, **options
    )
    return estimator


def _import_torch() -> None:
    if "torch" not in sys.modules:
        _LOG.info("PyTorch is loaded for the first network, which takes some seconds")
    import_module("torch")


def _mnsf(num_sweeps: int = 3, /, **changes: SettingValue) -> MethodMaker:
    """The method of the paper, with some settings of its fusion fixed."""
    return partial(
        _network,
        flow_of=partial(_later("mnsf:mnsf"), num_fields=num_sweeps - 1),
        num_sweeps=num_sweeps,
        fixed={f"fusion.{name}": value for name, value in changes.items()},
        starts_warm=True,
        needs_previous=num_sweeps != _TRIPLET,
    )


# A new method is one line here; docs/extending.md has the recipe.
_METHODS: Final[dict[str, MethodMaker]] = {
    "online": ObjectFlowEstimator,
    "mnsf": _mnsf(),
    "zero": ZeroEstimator,
    "ego": EgoMotionEstimator,
    "ego-estimated": EstimatedEgoMotionEstimator,
    "nsfp": partial(_network, flow_of=_later("nsfp:nsfp"), distance_kind="tree"),
    "nsfp-linear": partial(_network, flow_of=_linear("nsfp:nsfp"), distance_kind="tree"),
    "fnsf": partial(_network, flow_of=_later("fnsf:fnsf")),
    "fnsf-linear": partial(_network, flow_of=_linear("fnsf:fnsf")),
    "fnsf-joint": partial(_network, flow_of=_later("fnsf:fnsf_joint"), num_sweeps=3),
    "fnsf-time": partial(
        _network, flow_of=partial(_later("fnsf:fnsf_joint"), has_time=True), num_sweeps=3
    ),
    "mnsf-cycle": partial(_network, flow_of=_later("mnsf:mnsf_cycle"), num_sweeps=3),
    # Ablations (a) to (c) of the paper; (d) is the method itself.
    "mnsf-no-backward": _mnsf(2),
    "mnsf-mean": _mnsf(kind="mean"),
    "mnsf-no-inversion": _mnsf(inversion=False),
    # Fusion operations: mean is ablation (b), and the third is the method's own network.
    "mnsf-weighted-sum": _mnsf(kind="weighted_sum"),
    "mnsf-mlp": _mnsf(kind="mlp"),
    **{f"mnsf-depth{depth}": _mnsf(num_hidden_layers=depth) for depth in (2, 3, 5, 7)},
    # With two sweeps there is no backward flow: that is ablation (a).
    **{f"mnsf-frames{number}": _mnsf(number) for number in (2, 3, 4, 5)},
    **{
        name: partial(_later("command_estimator:CommandEstimator.from_environment"), name)
        for name in ("flot", "3dflow", "gmsf", "scoop")
    },
}

# What follows the prefix says which files or programs they are.
_PREFIXES: Final[dict[str, Callable[[str, Settings], SceneFlowEstimator]]] = {
    COMMAND_PREFIX: _later("command_estimator:CommandEstimator.from_text"),
    FILE_PREFIX: PredictionFiles,
}

_OLD_NAMES: Final = {"mnsf-objects": "online", "mnsf-network": "mnsf"}


def method_names() -> tuple[str, ...]:
    """The names that `make_method` knows: our methods, then those of other packages."""
    return (*_METHODS, *(name for name in sorted(_plug_ins()) if name not in _METHODS))


def check_method(name: str) -> None:
    """Checks that there is a method of that name, without making it.

    Raises:
        SettingsError: If there is none, or several packages offer it.
    """
    _maker(name)


def is_loaded(name: str) -> bool:
    """Whether a method is there at once: `load_method` would take no seconds."""
    return not _has_network(name) or _ARE_NETWORKS_LOADED.is_set()


def load_method(name: str) -> None:
    """Imports what the first estimate of a method would, which takes seconds for a network.

    `make_method` tells if a library is missing or broken.
    """
    if not is_loaded(name):
        with suppress(Exception):
            _import_torch()
            import_module(OPTIMIZER_MODULE)
            _ARE_NETWORKS_LOADED.set()


def _has_network(name: str) -> bool:
    make = _METHODS.get(name)
    return isinstance(make, partial) and make.func is _network


def make_method(name: str, settings: Settings) -> SceneFlowEstimator:
    """Makes the estimator of a method, which has seen nothing yet.

    Args:
        name: One of `method_names`, or `command:` and a command line.
        settings: How to estimate. Each method adds what makes it that method, and `online` takes
            its own preset instead of `paper` or `authors`, see `settings_for`.

    Raises:
        SettingsError: If there is no such method, it cannot be made, or the settings ask for a
            device that is not there.
        LibraryError: If it needs a library that is not installed.
    """
    try:
        return _maker(name)(settings_for(name, settings))
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
    plug_ins = _plug_ins().get(name, [])
    if not plug_ins:
        raise SettingsError(_unknown(name))
    if len(plug_ins) > 1:
        packages = " and ".join(sorted(_package(plug_in) for plug_in in plug_ins))
        raise SettingsError(f"method {name!r} is offered by {packages}; uninstall all but one")
    return partial(_made, plug_ins[0])


def _plug_ins() -> dict[str, list[EntryPoint]]:
    found: dict[str, list[EntryPoint]] = {}
    # A package seen twice on the path (a checkout and its installation) is still one.
    for plug_in in dict.fromkeys(entry_points(group=GROUP)):
        found.setdefault(plug_in.name, []).append(plug_in)
    return found


def _made(plug_in: EntryPoint, settings: Settings) -> SceneFlowEstimator:
    source = f"method {plug_in.name!r} of {_package(plug_in)}"
    try:
        make = plug_in.load()
    except ImportError as error:
        raise LibraryError(f"{source}: cannot load {plug_in.value!r}: {error}") from error
    except AttributeError as error:
        raise SettingsError(f"{source}: cannot load {plug_in.value!r}: {error}") from error
    if not callable(make):
        raise SettingsError(f"{source}: got {make!r}, expected a class or function of settings")
    estimator: SceneFlowEstimator = make(settings)
    missing = _missing(estimator)
    if missing:
        raise SettingsError(
            f"{source}: {type(estimator).__name__} lacks {', '.join(missing)}, which every method "
            "must have; see docs/extending.md"
        )
    return estimator


def _missing(estimator: object) -> list[str]:
    """What an object lacks to be an estimator."""
    methods = ("estimate", "with_settings")
    missing = [f"{name}()" for name in methods if not callable(getattr(estimator, name, None))]
    if not isinstance(getattr(estimator, "settings", None), Settings):
        missing.append("settings (Settings)")
    if not isinstance(getattr(estimator, "traits", None), MethodTraits):
        missing.append("traits (MethodTraits)")
    return missing


def _package(plug_in: EntryPoint) -> str:
    return plug_in.dist.name if plug_in.dist else plug_in.value


def _unknown(name: str) -> str:
    if name in _OLD_NAMES:
        return f"unknown method {name!r}: it is now called {_OLD_NAMES[name]!r}"
    names = method_names()
    near = difflib.get_close_matches(name, names, n=3)
    hint = f"; did you mean {' or '.join(near)}?" if near else ""
    return f"unknown method {name!r}{hint}; there are {', '.join(names)}"
