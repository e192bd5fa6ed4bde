"""A parser for which options may stand anywhere, also between the arguments without a name."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any


class IntermixedParser(argparse.ArgumentParser):
    """argparse gives up on `NAME --option X BAG...`, because it takes NAME and no BAG at once."""

    _is_inside = False

    def parse_known_args(  # type: ignore[override]  # argparse has overloads of the same
        self,
        args: Sequence[str] | None = None,
        namespace: Any = None,  # noqa: ANN401 - as argparse
    ) -> tuple[Any, list[str]]:
        """Parses options first, then what is left; that calls this method once more."""
        if self._is_inside:
            return super().parse_known_args(args, namespace)
        self._is_inside = True
        try:
            return self.parse_known_intermixed_args(args, namespace)
        finally:
            self._is_inside = False
