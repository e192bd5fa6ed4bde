#!/usr/bin/env bash
# SUBJECT  filterpy 2.0.0: CubatureKalmanFilter and FixedLagSmoother, compared with its KalmanFilter
# GUESS    On a linear model a cubature filter is the Kalman filter, and a fixed-lag smoother whose
#          lag is 0 or the whole series is the filter or the RTS smoother, to rounding.
# SEEN     Neither. The covariance of CubatureKalmanFilter after an update is too large by Q: for a
#          random walk with Q = 100 and R = 1 it is 100.99 instead of 0.99, and with two states the
#          estimates differ too. FixedLagSmoother answers one pulse of 1 by a curve that jumps one
#          step after the pulse, where RTS is symmetric about it; with a lag of 0 it returns 0
#          where the filter returns 0.45. The extended, unscented, information and square-root
#          filters agree to 1e-13.
# WHY IT MATTERS
#          Gates and consistency checks of a tracker use that covariance: ten sigmas pass as one.
#          Smoothed tracks lag behind their measurements and look plausible. kalbee 1.0.0 has the
#          same excess in its SigmaPointUKF. Use UnscentedKalmanFilter and rts_smoother.
# SOURCE   Run below. Both reuse what was computed before Q was added (cubature points), or after
#          the update instead of before it (covariance of the smoother).
# DATE     2026-11-28
# Needs Python 3.11 or newer. About 80 MB and 20 s. Of scipy (140 MB) the classes take inv and
# cholesky: NumPy's stand in for them.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip numpy==2.4.6
pip --no-deps filterpy==2.0.0
"$dir/venv/bin/python" - <<'EOF'
import sys
from importlib.metadata import version
from unittest.mock import MagicMock

import numpy as np

for name in ("", ".linalg", ".ndimage", ".sparse", ".sparse.linalg", ".stats"):
    sys.modules[f"scipy{name}"] = MagicMock()
linalg = sys.modules["scipy.linalg"]
linalg.inv = np.linalg.inv
linalg.cholesky = lambda matrix, **_: np.linalg.cholesky(matrix).T
from filterpy.kalman import CubatureKalmanFilter, FixedLagSmoother, KalmanFilter  # noqa: E402

print("filterpy", version("filterpy"), "numpy", np.__version__)


def prepared(filter_, transition, process_noise):
    size = len(transition)
    filter_.x, filter_.P = np.zeros((size, 1)), np.eye(size)
    filter_.F, filter_.H = transition, np.eye(1, size)
    filter_.Q, filter_.R = process_noise, np.eye(1)
    return filter_


def kalman(transition, process_noise):
    return prepared(KalmanFilter(len(transition), 1), transition, process_noise)


def cubature(transition, process_noise):
    filter_ = CubatureKalmanFilter(
        len(transition), 1, 1.0, hx=lambda x: x[:1], fx=lambda x, dt: transition @ x
    )
    return prepared(filter_, transition, process_noise)


def filtered(filter_, measurements):
    states, covariances = [], []
    for measurement in measurements:
        filter_.predict()
        filter_.update(np.array([[measurement]]))
        states.append(filter_.x.copy())
        covariances.append(filter_.P.copy())
    return np.array(states), np.array(covariances)


STILL = np.eye(1)
MOVING = np.array([[1.0, 1.0], [0.0, 1.0]])
MOVING_NOISE = 0.03 * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
PULSE_AT = 20
pulse = np.zeros(41)
pulse[PULSE_AT] = 1

for noise in (0.01, 1.0, 100.0):
    (*_, last), (*_, cubature_last) = (
        filtered(make(STILL, noise * STILL), np.ones(30))[1] for make in (kalman, cubature)
    )
    print(f"Q {noise}: covariance {last.item():.2f}, by cubature {cubature_last.item():.2f}")
    assert np.isclose(cubature_last - last, noise, rtol=0.01), "the excess is not Q now"

states, covariances = filtered(kalman(MOVING, MOVING_NOISE), pulse)
by_cubature, _ = filtered(cubature(MOVING, MOVING_NOISE), pulse)
apart = np.abs(by_cubature - states).max()
print(f"two states: estimates of a pulse of 1 up to {apart:.3f} apart")
assert apart > 0.01


def by_lag(lag):
    smoother = prepared(FixedLagSmoother(2, 1, N=lag), MOVING, MOVING_NOISE)
    for measurement in pulse:
        smoother.smooth(measurement)
    return np.array([state[0, 0] for state in smoother.xSmooth])


def show(title, values):
    print(f"{title:18}", *(f"{value:6.3f}" for value in values[PULSE_AT - 4 : PULSE_AT + 5]))


by_filter = states[:, 0, 0]
by_rts = kalman(MOVING, MOVING_NOISE).rts_smoother(states, covariances)[0][:, 0, 0]
by_lags = {lag: by_lag(lag) for lag in (0, 8)}
show("filter", by_filter)
show("lag 0", by_lags[0])
show("RTS", by_rts)
show("lag 8", by_lags[8])
assert by_rts.argmax() == PULSE_AT and np.allclose(by_rts, by_rts[::-1], atol=0.01)
assert by_lags[8].argmax() == PULSE_AT + 1
assert by_lags[0][PULSE_AT] == 0 and by_filter[PULSE_AT] > 0.3
print("as stated: both differ from the Kalman filter on a linear model")
EOF
