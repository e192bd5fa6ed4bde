"""With which settings the rows of each method were computed: others belong into another table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from paper_plan import preset_of

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.run_record import SessionRecord
from mnsf_ros.presets import preset
from mnsf_ros.setting import SettingValue

Values = dict[str, SettingValue]

_OBJECTS = ("online", "online/online")
_GROUPS_OF_OBJECTS = ("crop", "ground", "field", "ego_motion", "objects", "compute")
# Groups of settings that nobody else looks at.
_ONLY_FOR = {
    "ego_motion": (*_OBJECTS, "ego-estimated"),
    "objects": _OBJECTS,
    "nsfp": ("nsfp", "nsfp-linear"),
    "linear": ("nsfp-linear", "fnsf-linear"),
    "mnsf_cycle": ("mnsf-cycle",),
    "node": (),
}


@dataclass(frozen=True)
class PaperRecord:
    """What the rows in a folder were computed with.

    Attributes:
        sessions: When and where.
        settings: Method, or in the first records preset, to its settings.
    """

    sessions: list[SessionRecord]
    settings: dict[str, Values]


def settings_of(method: str) -> Values:
    """The settings that a method has now; those that it does not look at are left out."""
    return _its_own(method, preset(preset_of(method)).to_mapping())


def recorded_settings(recorded: Mapping[str, Values], methods: Iterable[str]) -> dict[str, Values]:
    """Method to the settings that its rows were computed with."""
    # The first records had them for each preset.
    return {
        method: _its_own(method, recorded.get(method) or recorded.get(preset_of(method), {}))
        for method in methods
    }


def changed(method: str, recorded: Values) -> list[str]:
    """Names of the settings that are others now. What was no setting then had no other value."""
    now = settings_of(method)
    return [name for name, value in recorded.items() if now.get(name) != value]


def outdated(recorded: Mapping[str, Values], methods: Iterable[str]) -> list[str]:
    """One line for each method whose rows were computed with other settings than it has now."""
    own = recorded_settings(recorded, methods)
    names = {method: changed(method, values) for method, values in own.items()}
    return [f"{method}: {', '.join(found)}" for method, found in names.items() if found]


def merged_settings(
    recorded: Mapping[str, Values], done: Iterable[str], todo: Iterable[str]
) -> dict[str, Values]:
    """Method to settings, of rows that are there and of rows to come.

    Raises:
        EvaluationError: A method has rows that were computed with other settings.
    """
    merged = recorded_settings(recorded, done)
    for method in todo:
        names = changed(method, merged.get(method, {}))
        if names:
            raise EvaluationError(
                f"the rows of {method} were computed with another {names[0]}; "
                f"`--again {method}` computes them again"
            )
        merged[method] = settings_of(method)
    return merged


def _its_own(method: str, settings: Mapping[str, SettingValue]) -> Values:
    is_removed = settings.get("ego_motion.removed", False)

    def matters(name: str) -> bool:
        group = name.partition(".")[0]
        if name == "ego_motion.removed" or (group == "ego_motion" and is_removed):
            return True
        if method in _OBJECTS:
            return group in _GROUPS_OF_OBJECTS
        return method in _ONLY_FOR.get(group, (method,))

    return {name: value for name, value in settings.items() if matters(name)}
