"""What was run: settings, seed, versions, machine, commit, recordings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mnsf_ros.evaluation.run_json import plain
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.report.html import Html, element, joined
from mnsf_ros.report.result_table import fact_list, words_table
from mnsf_ros.settings import declared_settings


def run_section(record: RunRecord) -> Html:
    """Returns the record of a run for people, every setting folded away at its end.

    Args:
        record: The record.
    """
    run = plain(record)
    identity = run.get("identity", {})
    sessions = run.get("sessions", [])
    facts = element("div", fact_list(_facts(identity, sessions)), class_="card")
    recordings = [
        (str(recording.get("name", "")), _recording_text(recording))
        for recording in run.get("recordings", [])
    ]
    table = element("div", words_table(recordings, ("recording", "what it is")), class_="card")
    return joined(facts, table, _settings_details(identity))


def _facts(identity: Mapping[str, Any], sessions: list[Mapping[str, Any]]) -> list[tuple[str, str]]:
    last: Mapping[str, Any] = sessions[-1] if sessions else {}
    machine: Mapping[str, Any] = last.get("machine", {})
    versions: Mapping[str, str] = last.get("versions", {})
    cores = f"{machine['cores']} cores" if machine.get("cores") else ""
    parts = (machine.get("name"), machine.get("processor"), cores, machine.get("gpu"))
    return [
        ("started", str(last.get("started", ""))),
        ("command", " ".join(last.get("command", []))),
        ("machine", ", ".join(str(part) for part in parts if part)),
        ("system", str(machine.get("system", ""))),
        ("versions", ", ".join(f"{name} {version}" for name, version in versions.items())),
        ("git commit", str(last.get("git_commit") or "none, not a checkout")),
        ("seed", str(identity.get("seed", ""))),
        ("points of a sweep", str(identity.get("num_points", ""))),
        ("ground by", str(identity.get("ground", ""))),
        ("played at", _rate_text(identity.get("realtime_rate"))),
        ("sessions", str(len(sessions)) if len(sessions) > 1 else ""),
    ]


def _rate_text(rate: float | None) -> str:
    return "" if rate is None else f"{rate:g} times real time, dropping as the live node does"


def _recording_text(recording: Mapping[str, Any]) -> str:
    text = f"{recording.get('num_sweeps', '?')} sweeps on {recording.get('points')}"
    text += f", truth on {recording['truth']}" if recording.get("truth") else ", no truth"
    if recording.get("odometry"):
        text += f", poses on {recording['odometry']}"
    damages = recording.get("damages", [])
    return text + (f"; damaged: {'; '.join(damages)}" if damages else "")


def _settings_details(identity: Mapping[str, Any]) -> Html:
    values = {**identity.get("settings", {}), **identity.get("crop_and_ground", {})}
    if not values:
        return Html()
    units = {setting.name: setting.unit for setting in declared_settings()}
    rows = [(name, f"{value} {units.get(name, '')}".strip()) for name, value in values.items()]
    table = words_table(rows, ("setting", "value"))
    summary = element("summary", f"All {len(rows)} settings")
    return element("details", summary, element("div", table, class_="card long"))
