"""What goes wrong with the files of a data set."""

from __future__ import annotations

from mnsf_ros.errors import MnsfError


class DatasetError(MnsfError):
    """Files of a data set are missing, damaged, or laid out in another way."""
