"""What the node says of its settings at the start."""

from __future__ import annotations

from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings import Settings

_MOST_NAMES = 6


def greeting(settings: Settings) -> str:
    """Returns one line: the nearest preset and what differs, device, threads, ego motion."""
    changed, name = min(
        ((_changed(settings, preset(name)), name) for name in PRESET_NAMES),
        key=lambda found: len(found[0]),
    )
    threads = settings.compute.num_threads
    return (
        f"preset {name}{_but(changed)}, method {settings.method.name}, "
        f"device {settings.compute.device}, {threads} thread{'s'[: threads != 1]}, "
        f"ego motion from {settings.ego_motion.source}"
    )


def _changed(settings: Settings, base: Settings) -> list[str]:
    values = base.to_mapping()
    return [
        name
        for name, value in settings.to_mapping().items()
        if value != values[name] and name != "compute.num_threads"
    ]


def _but(changed: list[str]) -> str:
    if not changed:
        return ""
    if len(changed) > _MOST_NAMES:
        return f" with {len(changed)} changes"
    return f" but for {', '.join(changed)}"
