"""The estimator that the settings ask for."""

from __future__ import annotations

from mnsf_ros.common_frame import CommonFrameEstimator, in_common_frame
from mnsf_ros.core.compute_device import compute_device
from mnsf_ros.core.multi_frame import MultiFrameEstimator
from mnsf_ros.objects.object_flow import ObjectFlowEstimator
from mnsf_ros.settings import Settings

Estimator = ObjectFlowEstimator | MultiFrameEstimator | CommonFrameEstimator[MultiFrameEstimator]


def make_estimator(settings: Settings) -> Estimator:
    """Makes an estimator that has seen nothing yet.

    Raises:
        SettingsError: If the settings ask for a device that is not there.
    """
    if settings.field.kind == "objects":
        # It needs none; but what no network could have is refused all the same.
        compute_device(settings.compute)
        return ObjectFlowEstimator(settings)
    return in_common_frame(MultiFrameEstimator(settings))


def changed_estimator(estimator: Estimator, settings: Settings) -> Estimator:
    """An estimator with other settings that takes over what still holds.

    Raises:
        SettingsError: If the settings ask for a device that is not there.
    """
    if _kind(settings) != _kind(estimator.settings):
        return make_estimator(settings)
    if isinstance(estimator, CommonFrameEstimator):
        return estimator.with_inner(estimator.inner.with_settings(settings))
    return estimator.with_settings(settings)


def _kind(settings: Settings) -> tuple[str, bool]:
    kind = settings.field.kind
    return kind, kind == "network" and settings.ego_motion.removed
