"""Name of a study to what it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Final

from mnsf_ros.errors import SettingsError
from mnsf_ros.studies.landscape_study import LandscapeOptions, run_landscape_study
from mnsf_ros.studies.method_study import METHOD_STUDIES, run_method_study
from mnsf_ros.studies.stability_study import (
    StabilityOptions,
    run_stability_study,
    stability_settings,
)
from mnsf_ros.studies.study import StudyOptions, StudyResult, write_study

_METHOD_STUDIES: Final = {study.name: study for study in METHOD_STUDIES}
STUDY_NAMES: Final = (*_METHOD_STUDIES, "landscape", "stability")


def run_study(
    name: str,
    options: StudyOptions,
    how: Mapping[str, Any] | None = None,
) -> tuple[StudyResult, list[Path]]:
    """Does a study and writes what came out.

    Args:
        name: One of `STUDY_NAMES`.
        options: On what, and how.
        how: Attributes of LandscapeOptions and StabilityOptions to values; a study takes those
            that it has.

    Returns:
        The result, and the files.

    Raises:
        MnsfError: There is no such study, or something that was given cannot be used.
        OSError: Writing fails.
    """
    how = how or {}
    if name in _METHOD_STUDIES:
        result = run_method_study(_METHOD_STUDIES[name], options)
    elif name == "landscape":
        result = run_landscape_study(options, LandscapeOptions(**_own(LandscapeOptions, how)))
    elif name == "stability":
        options = replace(options, settings=stability_settings(options.settings))
        result = run_stability_study(options, StabilityOptions(**_own(StabilityOptions, how)))
    else:
        raise SettingsError(f"unknown study {name!r}, expected one of {', '.join(STUDY_NAMES)}")
    return result, write_study(result, options)


def _own(kind: type, how: Mapping[str, Any]) -> dict[str, Any]:
    names = {field.name for field in fields(kind)}
    return {name: value for name, value in how.items() if name in names}
