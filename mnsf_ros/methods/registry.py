"""Name of a method to its estimator: ours, and those of other installed packages.

Another package registers a method with an entry point in the group `mnsf_ros.methods`: its name
is the name of the method, its object is called with the settings and returns an estimator.
"""

from __future__ import annotations

import difflib
from importlib.metadata import EntryPoint, entry_points

from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.errors import SettingsError
from mnsf_ros.methods.built_in import BUILT_IN
from mnsf_ros.methods.command_estimator import COMMAND_PREFIX, CommandEstimator
from mnsf_ros.settings import Settings

GROUP = "mnsf_ros.methods"


def method_names() -> tuple[str, ...]:
    """The names that `make_method` knows: ours in the order of the paper's table, then others."""
    return (*BUILT_IN, *(name for name in sorted(_plug_ins()) if name not in BUILT_IN))


def make_method(name: str, settings: Settings) -> SceneFlowEstimator:
    """Makes the estimator of a method.

    Args:
        name: One of `method_names`, or `command:` and a command line.
        settings: How to estimate. What makes the method comes on top of them.

    Raises:
        SettingsError: If there is no such method, it cannot be made, or the settings ask for a
            device that is not there.
    """
    if name in BUILT_IN:
        return BUILT_IN[name](settings)
    if name.startswith(COMMAND_PREFIX):
        return CommandEstimator.from_text(name.removeprefix(COMMAND_PREFIX), settings)
    plug_ins = _plug_ins().get(name, [])
    if not plug_ins:
        raise SettingsError(_unknown(name))
    if len(plug_ins) > 1:
        packages = " and ".join(sorted(_package(plug_in) for plug_in in plug_ins))
        raise SettingsError(f"method {name!r} is offered by {packages}; uninstall all but one")
    return _made(plug_ins[0], settings)


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
    except (ImportError, AttributeError) as error:
        raise SettingsError(f"{source}: cannot load {plug_in.value!r}: {error}") from error
    if not callable(make):
        raise SettingsError(f"{source}: got {make!r}, expected something to call with settings")
    estimator = make(settings)
    if not callable(getattr(estimator, "estimate", None)):
        raise SettingsError(f"{source}: got {estimator!r}, expected an object with estimate()")
    made: SceneFlowEstimator = estimator
    return made


def _package(plug_in: EntryPoint) -> str:
    return plug_in.dist.name if plug_in.dist else plug_in.value


def _unknown(name: str) -> str:
    names = method_names()
    near = difflib.get_close_matches(name, names, n=3)
    hint = f"; did you mean {' or '.join(near)}?" if near else ""
    return f"unknown method {name!r}{hint}; there are {', '.join(names)}"
