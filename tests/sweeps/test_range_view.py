# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Places that a sweep knows nothing of: behind surfaces, and out of its view."""

from __future__ import annotations

import numpy as np
import pytest

from mnsf_ros.geometry.rigid_motion import turned
from mnsf_ros.geometry.transforms import tilt
from mnsf_ros.sweeps.range_view import RangeView

AROUND, FEW = np.arange(0.0, 360.0, 0.4), np.arange(-14.5, 15.0, 2.0)


def rings(elevations_deg, azimuths_deg=AROUND, range_m=10.0):
    """(N, 3) float32, what lasers at some elevations meet."""
    elevations, azimuths = np.deg2rad(np.meshgrid(elevations_deg, azimuths_deg)).reshape(2, -1)
    flat = np.cos(elevations)
    directions = np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), np.sin(elevations)])
    return (range_m * directions.T).astype(np.float32)


def are_between(view, places):
    return view.limits_m(places, view, reach_m=0.5, hidden_m=0.1) == 0


@pytest.mark.parametrize(
    ("beams_deg", "place_deg", "is_between"),
    [
        (FEW, -13.5, True),
        (FEW, -12.5, False),
        (FEW, 16.5, False),
        (np.arange(-14.5, 15.0, 0.4), -13.5, False),
    ],
)
def test_between_few_beams_nothing_is_known(beams_deg, place_deg, is_between):
    view = RangeView(rings(beams_deg))
    assert are_between(view, rings([place_deg])).all() == is_between
    assert are_between(view, rings([place_deg])).any() == is_between


def test_where_few_things_reach_up_the_beams_still_meet_them():
    ground, person = rings(np.arange(-19.5, 0.0)), rings(np.arange(-4.5, 6.0), np.arange(0, 5, 0.4))
    view = RangeView(np.concatenate([ground, person]))
    assert not are_between(view, person).any()


@pytest.mark.parametrize(
    ("azimuth_deg", "is_beside"), [(0.0, False), (39.0, False), (50.0, True), (180.0, True)]
)
def test_beside_its_view_a_sensor_sees_nothing(azimuth_deg, is_beside):
    view = RangeView(rings(np.arange(-12.5, 13.0), np.arange(-40.0, 40.0, 0.4)))
    assert view.are_out(rings([0.0], [azimuth_deg], range_m=5.0), view) == is_beside
    assert view.are_out(rings([5.0], [azimuth_deg], range_m=20.0), view) == is_beside


def test_what_can_be_seen_limits_how_far_off_a_point_may_be():
    view, other = (
        RangeView(rings(np.arange(-12.5, 13.0), np.arange(first, last, 0.4)))
        for first, last in ((-40.0, 40.0), (0.0, 360.0))
    )

    def limits_of(seen_from, *places):
        return view.limits_m(np.concatenate(places), seen_from, 0.5, 0.1).tolist()

    near, behind, aside = (
        rings([0.0], [azimuth_deg], range_m)
        for azimuth_deg, range_m in ((0.0, 10.0), (0.0, 15.0), (180.0, 5.0))
    )
    assert limits_of(view, near, behind, aside) == pytest.approx([0.5, 0.1, 0.1])
    # The other view has returns from there.
    assert limits_of(other, near, behind, aside) == pytest.approx([0.5, 0.1, 0.5])


def test_nothing_returned():
    nothing = RangeView(rings([]))
    assert nothing.limits_m(rings([0.0]), nothing, 0.5, 0.1) == pytest.approx(0.1)


def test_an_azimuth_between_two_columns_is_in_view():
    view = RangeView(rings(np.arange(-12.5, 13.0), np.arange(0.0, 360.0, 2.0)))
    assert not view.are_out(rings([0.0], AROUND), view).any()


@pytest.mark.parametrize("pitch_deg", [0.0, 20.0])
@pytest.mark.parametrize(
    ("elevation_deg", "is_out"), [(-16.5, True), (-11.5, False), (11.5, False), (16.5, True)]
)
def test_above_and_below_the_beams_a_tilted_sensor_sees_nothing(pitch_deg, elevation_deg, is_out):
    beams_from_sensor = tilt(np.deg2rad(pitch_deg), 0.0)[:3, :3]
    beams, places = rings(np.arange(-12.5, 13.0)), rings([elevation_deg], range_m=15.0)
    view = RangeView(turned(beams, beams_from_sensor.T), beams_from_sensor)
    places = turned(places, beams_from_sensor.T)
    assert (view.are_out(places, view) == is_out).all()
    limits = view.limits_m(places, view, reach_m=0.5, hidden_m=0.1)
    # Those in view are behind the returns.
    assert limits == pytest.approx(0.1)
    limits = view.limits_m(places / 2, view, reach_m=0.5, hidden_m=0.1)
    assert limits == pytest.approx(0.1 if is_out else 0.5)
