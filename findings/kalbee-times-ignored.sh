#!/usr/bin/env bash
# SUBJECT  kalbee 1.0.0 (Kalman filters and trackers), with numpy 2.4.6 and scipy 1.17.1
# GUESS    KalmanFilter.predict(dt) moves the state by dt, the time since the last update, and
#          AsyncSensorBuffer, for measurements out of order or at a variable rate, weights each by
#          its time.
# SEEN     The linear filter takes its fixed matrices whatever dt is. Through the buffer, an object
#          at 10 m/s has 20 m/s if each second sweep is left out, and 50 m/s with one of five; after
#          a hole of 2 s it is 16 m behind. No warning.
#          With a filter that does use dt, the buffer forgets: beyond 50 measurements the oldest is
#          taken out, but the start is kept. Each result is computed from the first state over one
#          single step to the oldest of the window. An object that has stood for 55 s has 0.33 m/s.
# WHY IT MATTERS
#          Lidars drop sweeps, and detections come late: that is what the buffer is for. The speed
#          of a mover then depends on the rate. Pass F for the step to predict, set
#          transition_covariance before, and give the buffer the capacity of the whole recording.
# SOURCE   Run below; filters/kf_filter.py (predict), fusion/async_buffer.py (_replay).
# DATE     2026-11-28
# Needs Python 3.11 to 3.14. About 145 MB and 20 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
# Without the tests of numpy and scipy, with which it takes 200 MB.
extract='import sys, zipfile; wheel = zipfile.ZipFile(sys.argv[2]); wheel.extractall(
  sys.argv[1], [name for name in wheel.namelist() if "/tests/" not in name])'
for package in scipy==1.17.1 numpy==2.4.6 kalbee==1.0.0; do
  python3 -m pip download --quiet --no-cache-dir --no-deps --dest "$dir/wheel" "$package"
  python3 -c "$extract" "$dir/site" "$dir"/wheel/*.whl
  rm -r "$dir/wheel"
done
PYTHONPATH="$dir/site" python3 -s - <<'EOF'
from importlib.metadata import version

import numpy as np
from kalbee import ExtendedKalmanFilter, KalmanFilter
from kalbee.modules.fusion.async_buffer import AsyncSensorBuffer

print(*(f"{name} {version(name)}" for name in ("kalbee", "numpy", "scipy")))
STEP, SPEED = 0.1, 10.0  # s, m/s
POSITION = np.array([[1.0, 0.0]])


def moved(seconds):
    return np.array([[1.0, seconds], [0.0, 1.0]])


def linear():
    return KalmanFilter(
        np.zeros((2, 1)), np.eye(2) * 100, moved(STEP), np.eye(2) * 1e-4, POSITION, np.eye(1) * 1e-2
    )


print("predict, from 0 m at 10 m/s")
for dt in (0.1, 1.0):
    alone = linear()
    alone.state = np.array([[0.0], [SPEED]])
    place = alone.predict(dt=dt)[0, 0]
    print(f"  dt {dt} s: {place:.1f} m")
    assert place == 1.0, "dt is used now"


def last_state(stamps):
    buffer = AsyncSensorBuffer(linear())
    buffer.initialize(0.0, np.zeros((2, 1)), np.eye(2) * 100)
    for stamp in stamps:
        state, _ = buffer.add_measurement(stamp, np.array([SPEED * stamp]))
    print(f"  at {SPEED * stamps[-1]:.1f} m: {state[0, 0]:.1f} m, {state[1, 0]:.1f} m/s")
    return state.ravel()


sweeps = STEP * np.arange(1, 46)
for every in (1, 2, 5):
    print(f"every {every}. sweep" if every > 1 else "every sweep")
    _, speed = last_state(sweeps[every - 1 :: every])
    assert abs(speed - every * SPEED) < 0.1, "times are used now"
print("a hole of 2 s")
place, _ = last_state([*sweeps[:30], 5.0])
assert place < 35, "a hole is bridged now"


def extended():
    return ExtendedKalmanFilter(
        np.zeros((2, 1)), np.eye(2) * 1e-4, np.diag([1e-5, 1e-4]), np.eye(1) * 1e-2,
        transition_function=lambda state, dt: moved(dt) @ state,
        transition_jacobian=lambda state, dt: moved(dt),
        measurement_function=lambda state: state[:1],
        measurement_jacobian=lambda state: POSITION,
    )


stamps = STEP * np.arange(1, 1201)
speeds = np.interp(stamps, (0, 5, 60, 65), (0, SPEED, SPEED, 0))
places = np.cumsum(speeds) * STEP
buffer, alone = AsyncSensorBuffer(extended()), extended()
buffer.initialize(0.0, np.zeros((2, 1)), np.eye(2) * 1e-4)
for stamp, place in zip(stamps, places):
    state, _ = buffer.add_measurement(stamp, np.array([place]))
    alone.predict(dt=STEP)
    alone.update(np.array([place]))
speed, right = abs(state[1, 0]), abs(alone.state[1, 0])
print(f"stands for 55 s: {speed:.2f} m/s by the buffer, {right:.2f} m/s by the filter alone")
assert right < 0.001 and 0.3 < speed < 0.4, "the start moves with the window now"
print("as stated: the linear filter ignores dt, and the window begins at the first state")
EOF
