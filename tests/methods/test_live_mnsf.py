# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Networks that live from sweep to sweep, on a street of boxes on which a car drives."""

import gc
import weakref
from dataclasses import replace
from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import driving_car
import numpy as np
import pytest
import torch
from box_street import stamp_ns, triplets_of
from driving_car import FAST, is_of_car, of_car, truth

from mnsf_ros.core.reason import Verdict
from mnsf_ros.core.scene_flow_estimator import never
from mnsf_ros.errors import CancelledError, OptimizationError, SweepError
from mnsf_ros.methods import live_fit, live_mnsf, make_method
from mnsf_ros.networks import optimization
from mnsf_ros.networks.target_distance import TargetDistance
from mnsf_ros.presets import preset
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import Start, Sweep, SweepTriplet

# The boxes have fewer points than real objects.
SETTINGS = preset("mnsf").changed({"compute.device": "cpu", "objects.cell_size_m": 0.25})
# Where it is not about the flow.
SHORT = SETTINGS.changed({"live.first_iterations": 10})
# Over the ground, metres per tenth of a second.
SLOW = (0.4, 0.0, 0.0)
STAGES = ["forward", "backward", "fusion"]


sweep = cache(driving_car.sweep)


def triplet(*indices, velocity=FAST, **how):
    return SweepTriplet(*(sweep(index, velocity) for index in indices), **how)


def drive(number, velocity=FAST):
    """So many consecutive triplets."""
    return triplets_of([sweep(index, velocity) for index in range(number + 2)])


def estimator_of(**changes):
    return make_method("mnsf", SETTINGS.changed(changes))


def estimate(triplet, cancelled=never, **changes):
    return estimator_of(**changes).estimate(triplet, cancelled)


def assert_right(result, indices, velocity=FAST, limit_m=0.05):
    """The car moves and all else stands still, up to some centimetres."""
    _, index, next_index = indices
    current = sweep(index, velocity)
    car, rest, known = of_car(current), ~is_of_car(current), result.over_ground
    expected, _ = truth(index, next_index, current, velocity)
    errors_m = np.linalg.norm(result.flow - expected, axis=1)
    assert errors_m[car].max() < limit_m
    assert errors_m[rest].max() < 0.02
    assert known.dynamic[car].all()
    assert not known.dynamic[rest].any()
    assert np.isfinite(result.flow).all()


def steps_of(result):
    return [result.fits[stage].iterations for stage in STAGES if stage in result.fits]


def state_of(networks):
    """Weights by name."""
    return {
        f"{stage} {name}": weights.detach().clone()
        for stage, network in networks.networks.items()
        for name, weights in network.named_parameters()
    }


def assert_same_state(seen, wanted):
    assert seen.keys() == wanted.keys()
    for name, value in wanted.items():
        assert torch.equal(seen[name], value), name


def assert_same_bits(seen, wanted):
    """Two estimates are the same, bit for bit."""
    np.testing.assert_array_equal(seen.flow, wanted.flow)
    for name in ("motion", "dynamic", "confidence", "track_ids"):
        np.testing.assert_array_equal(
            getattr(seen.over_ground, name), getattr(wanted.over_ground, name)
        )
    assert seen.fits == wanted.fits


@pytest.fixture
def states(monkeypatch):
    """What all fits found and left behind, in their order: pairs of states."""
    found = []

    class Recorded(live_fit.LiveFit):
        def run(self, clock):
            before = state_of(self._networks)
            motions = super().run(clock)
            found.append((before, state_of(self._networks)))
            return motions

    monkeypatch.setattr(live_mnsf, "LiveFit", Recorded)
    return found


def is_fresh(state):
    """The fields say that nothing moves."""
    return not any(state[f"{stage} _layers.2.weight"].any() for stage in STAGES[:2])


class TestOnADrive:
    @pytest.fixture(scope="class")
    def results(self):
        estimator = estimator_of()
        return [estimator.estimate(each) for each in drive(6)]

    def test_finds_the_car_and_what_stands_still(self, results):
        assert_right(results[0], (0, 1, 2))
        for index, result in enumerate(results[3:], start=4):
            assert_right(result, (index - 1, index, index + 1))

    def test_tells_of_objects_as_online_does(self, results):
        known, current = results[-1].over_ground, sweep(6)
        (found,) = known.objects
        assert found.age_s == pytest.approx(0.5)
        assert found.track_id == results[0].over_ground.objects[0].track_id
        speed = np.linalg.norm(found.velocity)
        assert speed == pytest.approx(10 * np.linalg.norm(FAST), abs=0.6)
        assert set(known.track_ids[of_car(current)]) == {found.track_id}
        assert ((known.confidence >= 0) & (known.confidence <= 1)).all()
        assert known.confidence[of_car(current)].min() > 0.9
        assert known.source == "registration"
        reason = results[-1].reason_of(np.flatnonzero(of_car(current)))
        assert reason.verdict is Verdict.DYNAMIC

    def test_says_where_it_starts_and_what_it_does(self, results):
        assert [each.start for each in results] == [Start.COLD_FIRST] + 5 * [Start.WARM]
        first, later = SETTINGS.live.first_iterations, SETTINGS.optimization.max_iterations
        assert steps_of(results[0]) == [first, first, first]
        for result in results[1:]:
            assert steps_of(result) == [later, later, SETTINGS.fusion.max_iterations]
            assert set(STAGES) < result.times_ms.keys()
            assert set(result.stop_reasons.values()) == {"iteration_limit"}
            assert (result.device, result.distance_kind) == ("cpu", "cells")


class TestNetworksGoOn:
    def test_with_their_weights_from_triplet_to_triplet(self, states):
        estimator = make_method("mnsf", SHORT)
        for each in drive(3):
            estimator.estimate(each)
        assert is_fresh(states[0][0])
        for (_, after), (before, _) in pairwise(states):
            assert_same_state(before, after)
        # Each fit teaches all three.
        for stage in STAGES:
            names = [name for name in states[1][0] if name.startswith(stage) and "weight" in name]
            assert all(not torch.equal(states[1][0][name], states[1][1][name]) for name in names)

    def test_not_without_warm_start(self, states):
        estimator = make_method("mnsf", SHORT.changed({"warm_start.enabled": False}))
        results = [estimator.estimate(each) for each in drive(3)]
        assert {each.start for each in results} == {Start.COLD_BY_SETTING}
        for result, (before, _) in zip(results, states, strict=True):
            assert steps_of(result) == 3 * [SHORT.live.first_iterations]
            assert_same_state(before, states[0][0])
        assert_same_bits(results[0], make_method("mnsf", SHORT).estimate(drive(1)[0]))


def pushed(stream, *indices):
    """The stream after sweeps."""
    for index in indices:
        stream.push(sweep(index))
    return stream


@pytest.mark.parametrize(
    ("indices", "frame_id", "start"),
    [
        ((30, 31, 32), "lidar", Start.COLD_GAP),
        ((-20, -19, -18), "lidar", Start.COLD_TIME_JUMP),
        ((4, 5, 6), "rear", Start.COLD_FRAME),
        ("reset", "lidar", Start.COLD_FIRST),
    ],
)
def test_another_stretch_starts_from_scratch(states, indices, frame_id, start):
    settings = SHORT.changed({"ego_motion.max_gap_s": 0.5, "buffer.max_interval_s": 0.5})
    stream, new = pushed(Stream(settings), 0, 1, 2, 3), Stream(settings)
    if indices == "reset":
        stream, indices = Stream(settings, after=stream), (4, 5, 6)
    sweeps = [replace(sweep(index), frame_id=frame_id) for index in indices]
    (result, wanted) = ([each.push(one) for one in sweeps][-1] for each in (stream, new))
    assert (result.start, wanted.start) == (start, Start.COLD_FIRST)
    assert len(states) == 4
    assert_same_state(states[2][0], states[3][0])
    assert_same_state(states[2][1], states[3][1])
    np.testing.assert_array_equal(result.flow, wanted.flow)
    assert result.fits == wanted.fits


class TestTorch:
    @pytest.fixture(autouse=True)
    def _as_before(self):
        before = torch.get_num_threads()
        yield
        torch.set_num_threads(before)

    def test_same_bits_with_any_number_of_threads(self):
        results = []
        for num_threads in (1, 2, 4):
            torch.set_num_threads(num_threads)
            estimator = estimator_of(**{"compute.num_threads": num_threads})
            results.append([estimator.estimate(each) for each in drive(3)][-1])
            assert torch.get_num_threads() == num_threads
        for result in results[1:]:
            assert_same_bits(result, results[0])

    def test_threads_are_as_many_as_before_after_an_error_too(self):
        torch.set_num_threads(2)
        with pytest.raises(CancelledError):
            estimator_of().estimate(triplet(0, 1, 2), lambda: True)
        assert torch.get_num_threads() == 2


def test_same_bits_prepared_or_not():
    one, other = estimator_of(), estimator_of()
    for each in drive(2):
        assert_same_bits(one.estimate(each, prepared=one.prepare(each)), other.estimate(each))


@pytest.mark.parametrize("indices", [(0, 1, 3), (0, 2, 3), (0, 1, 1.5)])
@pytest.mark.parametrize("kind", ["mlp", "mean"])
def test_unequal_intervals(indices, kind):
    # The mean shows the inverted backward flow as it is.
    velocity = SLOW if kind == "mean" else FAST
    result = estimate(triplet(*indices, velocity=velocity), **{"fusion.kind": kind})
    assert_right(result, indices, velocity, 0.1)


def test_without_stamps_the_intervals_are_taken_for_equal():
    unstamped = SweepTriplet(*(Sweep(each.xyz) for each in triplet(0, 1, 2).sweeps))
    assert_right(estimate(unstamped), (0, 1, 2))


def test_each_network_takes_its_first_steps_when_it_is_first_fitted():
    estimator = estimator_of(**{"live.first_iterations": 12})
    pair = SweepTriplet(None, *(sweep(index, SLOW) for index in (0, 1)))
    assert steps_of(estimator.estimate(pair)) == [12]
    # The forward field goes on, the other networks are fresh.
    assert steps_of(estimator.estimate(triplet(0, 1, 2, velocity=SLOW))) == [
        SETTINGS.optimization.max_iterations,
        12,
        12,
    ]


def test_two_sweeps_are_enough():
    pair = replace(triplet(0, 1, 2, velocity=SLOW), previous=None)
    result = estimate(pair)
    assert_right(result, (0, 1, 2), SLOW, 0.1)
    assert list(result.fits) == ["forward"]


@pytest.mark.parametrize(
    "changes",
    [
        {"distance.kind": "tree"},
        {"distance.kind": "grid"},
        {"distance.kind": "bricks"},
        {"fusion.kind": "mean"},
        {"fusion.kind": "weighted_sum"},
        {"optimization.max_points": 0},
    ],
    ids=str,
)
def test_other_settings_find_the_car_too(changes, monkeypatch):
    nums, with_gradient = set(), TargetDistance.with_gradient

    def counted(distance, positions):
        nums.add(len(positions))
        return with_gradient(distance, positions)

    monkeypatch.setattr(TargetDistance, "with_gradient", counted)
    # A small grid.
    near = changes | {"crop.max_range_m": 20.0, "distance.cell_size_m": 0.2}
    estimator = estimator_of(**near)
    for each in drive(4, SLOW):
        result = estimator.estimate(each)
    assert_right(result, (3, 4, 5), SLOW)
    assert result.distance_kind == changes.get("distance.kind", "cells")
    assert (result.fits["fusion"].iterations > 0) == (changes.get("fusion.kind") != "mean")
    assert (nums == {256}) == ("optimization.max_points" not in changes)


def test_the_time_budget_ends_each_network_in_time(monkeypatch):
    # Each look at the clock takes a millisecond.
    calls = iter(range(1000))
    monkeypatch.setattr(live_fit, "time", SimpleNamespace(monotonic=lambda: 0.0))
    monkeypatch.setattr(
        optimization, "time", SimpleNamespace(monotonic=lambda: (next(calls) + 0.5) / 1e3)
    )
    result = estimate(triplet(0, 1, 2), **{"optimization.time_budget_ms": 20.0})
    # 8, 16 and 20 ms; nobody looks before the first step of each.
    assert steps_of(result) == [9, 8, 4]
    assert set(result.stop_reasons.values()) == {"time_budget"}
    assert np.isfinite(result.flow).all()


def test_a_loss_that_is_not_finite_is_an_error_that_leaves_nothing_behind(states):
    # Steps of 1.0 blow up so deep a network.
    deep = {"field.num_hidden_layers": 32}
    estimator = estimator_of(**deep, **{"optimization.learning_rate": 1.0})
    first, second = drive(2)
    with pytest.raises(OptimizationError, match=r"not finite|the loss became"):
        estimator.estimate(first)
    assert not states
    result = estimator.renewed(SETTINGS.changed(deep)).estimate(second)
    assert steps_of(result) == 3 * [SETTINGS.live.first_iterations]
    assert np.isfinite(result.flow).all()


def test_an_estimate_can_be_abandoned_before_each_step_and_the_next_one_is_fine():
    each, asked = triplet(0, 1, 2), []
    few = {"live.first_iterations": 2}
    estimate(each, cancelled=lambda: bool(asked.append(None)), **few)
    # Before the steps of all networks, and the other stages.
    assert len(asked) > 3 * 2 + 8
    estimator = estimator_of(**few)
    for allowed in range(len(asked)):
        answers = iter([False] * allowed + [True])
        with pytest.raises(CancelledError):
            estimator.estimate(each, lambda answers=answers: next(answers))
    # Fits that were finished count, and what the networks learned by then does no harm.
    estimator = estimator_of()
    for allowed in (20, 70, 60):
        answers = iter([False] * allowed + [True])
        with pytest.raises(CancelledError):
            estimator.estimate(each, lambda answers=answers: next(answers))
    result = estimator.estimate(each)
    later = SETTINGS.optimization.max_iterations
    assert steps_of(result) == [later, later, SETTINGS.live.first_iterations]
    assert_right(result, (0, 1, 2), limit_m=0.06)


class TestHostileSweeps:
    def test_nothing_that_could_move(self):
        """Ground and a wall too long for an object."""
        ground = np.random.default_rng(0).uniform((-30, -10, -1.8), (30, 10, -1.8), (3000, 3))
        wall = np.stack(np.meshgrid(np.arange(-20, 20, 0.2), 8, np.arange(-1.5, 1, 0.3)), -1)
        xyz = np.vstack([ground, wall.reshape(-1, 3)]).astype(np.float32)
        empty = (Sweep(xyz, stamp_ns(index)) for index in range(3))
        result = estimator_of().estimate(SweepTriplet(*empty))
        assert not result.over_ground.dynamic.any()
        np.testing.assert_allclose(result.flow, 0, atol=0.02)
        assert result.fits == {}

    @pytest.mark.parametrize("far", [1e3, 1e20, 3e38])
    def test_points_far_away(self, far):
        strays = np.array([[far, far, 0], [-far, 0, 1]], np.float32)
        sweeps = [
            replace(each, xyz=np.vstack([strays, each.xyz])) for each in triplet(0, 1, 2).sweeps
        ]
        result = estimate(SweepTriplet(*sweeps))
        assert_right(result.part(np.arange(2, len(result.flow))), (0, 1, 2))
        assert not result.over_ground.dynamic[:2].any()

    @pytest.mark.parametrize("removes_ground", [True, False])
    def test_all_points_in_one_place(self, removes_ground):
        xyz = np.tile(np.float32([[5.0, 1.0, 0.0]]), (500, 1))
        each = SweepTriplet(*(Sweep(xyz, stamp_ns(index)) for index in range(3)))
        try:
            result = estimate(each, **{"ground.remove": removes_ground})
        except SweepError:
            return
        assert np.isfinite(result.flow).all()


@pytest.mark.parametrize("has_stamps", [True, False])
def test_distances_to_sweeps_are_built_once_and_forgotten(monkeypatch, has_stamps):
    alive, build = [], TargetDistance.__init__

    def counted(self, *arguments):
        build(self, *arguments)
        alive.append(weakref.ref(self))

    monkeypatch.setattr(TargetDistance, "__init__", counted)
    estimator = estimator_of(**{"live.first_iterations": 1, "optimization.max_iterations": 1})
    sweeps = [sweep(index) for index in range(22)]
    if not has_stamps:
        sweeps = [Sweep(each.xyz) for each in sweeps]
    for each in triplets_of(sweeps):
        estimator.estimate(each)
    gc.collect()
    assert len(alive) == len(sweeps)
    # As many as the sweeps that are kept to look back at.
    assert sum(each() is not None for each in alive) <= 12
