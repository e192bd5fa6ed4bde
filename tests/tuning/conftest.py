"""A street of two seconds, simulated once."""

import pytest

from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings


@pytest.fixture(scope="session")
def street(tmp_path_factory):
    path = tmp_path_factory.mktemp("recordings") / "street"
    settings = SimulationSettings(seed=3, duration_s=1.8, num_beams=16, num_columns=512)
    write_recording(settings, path)
    return path
