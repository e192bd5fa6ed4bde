# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The settings that reproduce what the authors' code does and the paper does not say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from moving_sweeps import QUICK, mean_error

from mnsf_ros.core.flow_estimate import Start, StopReason
from mnsf_ros.core.temporal_fusion import fusion_network
from mnsf_ros.core.warm_start import Learners
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings


def test_joint_fields_start_from_the_same_weights():
    settings = QUICK.changed({"optimization.joint": True})
    learners = Learners.fresh(settings, torch.Generator(), torch.device("cpu"), num_fields=3)
    first, *others = (field.network.state_dict() for field in learners.fields)
    for other in others:
        for name, weights in first.items():
            assert torch.equal(weights, other[name])
            assert weights.data_ptr() != other[name].data_ptr()
    assert len({id(field.optimizer) for field in learners.fields}) == 1


def test_joint_fit_has_one_stage_and_stops_as_soon_as_the_forward_loss_does(translated):
    # The current sweep is its own next one: the forward field is there at once.
    patient = {"optimization.joint": True, "early_stopping.patience": 5, "field.zero_start": True}
    settings = QUICK.changed(patient)
    moving = make_method("mnsf", settings).estimate(translated)
    still = make_method("mnsf", settings).estimate(replace(translated, next=translated.current))
    assert list(moving.fits) == ["fields", "fusion"]
    assert list(moving.times_ms) == ["prepare", "fields", "fusion"]
    assert mean_error(moving.flow) < 0.05
    assert still.fits["fields"].stop_reason is StopReason.CONVERGED
    assert still.fits["fields"].iterations < moving.fits["fields"].iterations / 2


def test_joint_fields_go_on_warm_and_alone(translated):
    values = {"optimization.joint": True, "warm_start.enabled": True}
    joint = QUICK.changed({**values, "warm_start.max_loss_ratio": 1000})
    estimator = make_method("mnsf", joint)
    starts = [estimator.estimate(translated).start for _ in range(2)]
    assert starts == [Start.COLD_FIRST, Start.WARM]
    # Fields with an optimizer each are other networks.
    apart = estimator.with_settings(joint.changed({"optimization.joint": False}))
    assert apart.estimate(translated).start is Start.COLD_FIRST


def test_fields_of_the_last_step_are_fused(translated):
    # Steps far too large: the last weights are not the best.
    wild = QUICK.changed(
        {
            "fusion.kind": "mean",
            "optimization.learning_rate": 0.3,
            "optimization.decay": False,
            "optimization.max_iterations": 15,
        }
    )
    best, last = (
        make_method("mnsf", wild.changed({"fusion.fields": each})).estimate(translated)
        for each in ("best", "last")
    )
    assert not np.allclose(best.flow, last.flow)
    for stage in ("forward", "backward"):
        assert best.fits[stage].loss_m <= last.fits[stage].loss_m


def test_fusion_of_the_sum_cannot_tell_the_flows_apart(generator):
    settings = Settings().changed({"fusion.input": "sum"}).fusion
    network = fusion_network(settings, generator, num_flows=3)
    flows = torch.randn(20, 3, 3, generator=generator)
    swapped = flows[:, [2, 0, 1]]
    torch.testing.assert_close(network(flows.flatten(1)), network(swapped.flatten(1)))
    apart = fusion_network(Settings().fusion, generator, num_flows=3)
    assert not torch.allclose(apart(flows.flatten(1)), apart(swapped.flatten(1)))


def test_preset_of_the_authors_differs_from_the_paper_in_what_their_code_does():
    paper, authors = (preset(name).to_mapping() for name in ("paper", "authors"))
    assert {name: authors[name] for name in paper if paper[name] != authors[name]} == {
        "optimization.joint": True,
        "fusion.input": "sum",
        "fusion.fields": "last",
        "fusion.patience": 30,
        "nsfp.weight_decay": 0.0001,
        "nsfp.min_delta_m2": 0.0001,
    }
