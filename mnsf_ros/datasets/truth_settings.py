"""How far the labels of a data set are believed."""

from __future__ import annotations

from dataclasses import dataclass

from mnsf_ros.datasets.errors import DatasetError


@dataclass(frozen=True)
class TruthSettings:
    """What truth is made of.

    Attributes:
        box_margin_m: By how much boxes grow in length, width and height, in total. The default
            is that of the data sets prepared for NSFP, FNSF and MNSF.
        unlabelled_static: Whether points where no labels reach count as standing still instead
            of as unknown.
    """

    box_margin_m: float = 0.6
    unlabelled_static: bool = False

    def __post_init__(self) -> None:
        """Checks the margin."""
        if not 0.0 <= self.box_margin_m <= 10.0:
            raise DatasetError(f"box margin is {self.box_margin_m} m, expected 0 to 10")
