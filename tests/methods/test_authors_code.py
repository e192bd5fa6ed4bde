# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The settings that reproduce what the authors' code does and the paper does not say."""

import numpy as np
import torch
from moving_sweeps import QUICK, mean_error

from mnsf_ros.core.flow_estimate import StopReason
from mnsf_ros.methods import make_method
from mnsf_ros.methods.mnsf import Networks
from mnsf_ros.networks.networks import fusion_network
from mnsf_ros.networks.workbench import Workbench
from mnsf_ros.settings import Settings


def test_joint_fields_start_from_the_same_weights(translated):
    settings = QUICK.changed({"optimization.joint": True, "optimization.max_iterations": 1})
    for is_joint in (True, False):
        bench = Workbench(
            translated,
            settings.changed({"optimization.joint": is_joint}),
            {},
            num_before=2,
        )
        first, *others = (field.state_dict() for field in Networks.fresh(bench, 3).fields)
        for other in others:
            weights = "_layers.0.weight"
            assert torch.equal(first[weights], other[weights]) == is_joint
            assert first[weights].data_ptr() != other[weights].data_ptr()


def test_joint_fit_has_one_stage(translated):
    settings = QUICK.changed({"optimization.joint": True, "early_stopping.patience": 5})
    estimate = make_method("mnsf", settings).estimate(translated)
    assert list(estimate.fits) == ["fields", "fusion"]
    assert list(estimate.times_ms) == ["prepare", "fields", "fusion"]
    assert mean_error(estimate.flow) < 0.05
    assert estimate.fits["fields"].stop_reason is StopReason.CONVERGED


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
