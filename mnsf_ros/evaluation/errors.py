"""The error of this package: data that cannot be compared, tabulated or drawn."""

from __future__ import annotations

from mnsf_ros.errors import MnsfError


class EvaluationError(MnsfError, ValueError):
    """Flows, masks or table rows do not fit together, or hold what cannot be scored."""
