#!/usr/bin/env bash
# SUBJECT  trajectopy 5.1.2 (evaluation of trajectories), with numpy 2.4.6 and scipy 1.17.1
# GUESS    A perfect estimate has no error once the offset that it has was estimated: a shift of
#          time with time_shift, the rotation of the sensor on the vehicle with sensor_rotation; or
#          in another frame, after adopt_first_pose.
# SEEN     Time shift: an estimate stamped 0.3 s late gets a shift of 0.2999 s, and its error stays
#          as it was, 2.5 m at most. ate() pairs the poses first, then moves the stamps, and
#          compares the old pairs.
#          Sensor rotation: the mean of reference times inverse of estimate is taken and applied
#          on the left, in the world; a mounting acts on the right. The axes of a camera leave
#          107 degrees of 120, and a roll of 10 degrees becomes 10.7.
#          adopt_first_pose: positions are shifted, not turned, and differences of Euler angles are
#          added. An estimate in a frame turned by 90 degrees is 72 m off, first pose equal.
# WHY IT MATTERS
#          The spatio-temporal alignment is what one takes the package for, and the parameters that
#          the shift that it reports is right; the error beside it is the one without. Stamps at the
#          end of sweeps instead of their start, or the frame of a camera, look like a bad odometry.
#          For the shift, call apply_alignment first and then ate() with align=False; for the other
#          two, turn the poses yourself.
# SOURCE   Run below; processing/evaluation.py, processing/alignment.py, lib/alignment/direct.py.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 150 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
# Without tests, and without the readers and writers of files: with them it takes 350 MB.
extract='import sys, zipfile; wheel = zipfile.ZipFile(sys.argv[2]); wheel.extractall(
  sys.argv[1], [name for name in wheel.namelist() if "/tests/" not in name])'
for package in trajectopy==5.1.2 autograd==1.9.0 numpy==2.4.6 scipy==1.17.1; do
  python3 -m pip download --quiet --no-cache-dir --no-deps --dest "$dir/wheel" "$package"
  python3 -c "$extract" "$dir/site" "$dir"/wheel/*.whl
  rm -r "$dir/wheel"
done
PYTHONPATH="$dir/site" python3 -s - <<'EOF'
import logging
import sys
from importlib.metadata import version
from types import ModuleType

# Files, tables and map projections are not used here.
for name in ("pandas", "pyproj", "pyproj.enums", "pyproj.transformer", "rosbags",
             "rosbags.highlevel", "rosbags.typesys"):
    sys.modules[name] = ModuleType(name)
    sys.modules[name].__getattr__ = lambda attribute: type(attribute, (), {})

import numpy as np  # noqa: E402
import trajectopy as tp  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402
from trajectopy.processing.alignment import adopt_first_pose  # noqa: E402

print(*(f"{name} {version(name)}" for name in ("trajectopy", "numpy", "scipy")))
logging.disable(logging.CRITICAL)
stamps = 1.7e9 + np.arange(600) / 10
angle = np.linspace(0, 2 * np.pi, len(stamps))
positions = np.c_[50 * np.sin(angle), 30 * np.sin(2 * angle), 2 * np.sin(angle)]
ahead = np.gradient(positions, axis=0)
rotations = Rotation.from_euler("zy", np.c_[
    np.arctan2(ahead[:, 1], ahead[:, 0]),
    -np.arctan2(ahead[:, 2], np.hypot(ahead[:, 0], ahead[:, 1])),
])


def drive(frame=Rotation.identity(), mounting=Rotation.identity(), late=0.0):
    """Moves the same drive into another frame, sensor and clock."""
    return tp.Trajectory(
        positions=tp.Positions(frame.apply(positions)),
        rotations=tp.Rotations.from_quat((frame * rotations * mounting).as_quat()),
        timestamps=stamps + late,
    )


def largest(result):
    metres = np.linalg.norm(result.abs_dev.pos_dev, axis=1).max()
    return metres, np.rad2deg(result.abs_dev.rot_dev.magnitude().max())


def estimating(**what):
    settings = tp.ProcessingSettings()
    for name, value in what.items():
        setattr(settings.alignment.estimation_settings, name, value)
    return settings


turned = Rotation.from_euler("z", 90, degrees=True)
metres, degrees = largest(tp.ate(drive(turned), drive()))
print(f"other frame, aligned: {metres:.3f} m, {degrees:.3f} degrees")
assert metres < 1e-6 and degrees < 1e-6

plain, _ = largest(tp.ate(drive(late=0.3), drive()))
result, alignment = tp.ate(drive(late=0.3), drive(), estimating(time_shift=True), True)
shift = alignment.position_parameters.time_shift.value
metres, _ = largest(result)
print(f"0.3 s late: {plain:.3f} m; shift of {shift:.4f} s estimated: {metres:.3f} m")
assert abs(shift - 0.3) < 0.001 and metres > 0.9 * plain > 2, "the shift is applied now"
shifted = tp.apply_alignment(drive(late=0.3), alignment, inplace=False)
metres, _ = largest(tp.ate(shifted, drive(), align=False))
print(f"applied before: {metres:.3f} m")
assert metres < 0.05

for name, mounting, left in (
    ("roll of 10 degrees", Rotation.from_euler("x", 10, degrees=True), 10),
    ("axes of a camera", Rotation.from_euler("xyz", [-90, 0, -90], degrees=True), 100),
):
    own = np.rad2deg(mounting.magnitude())
    settings = estimating(sensor_rotation=True)
    _, degrees = largest(tp.ate(drive(mounting=mounting), drive(), settings))
    print(f"{name} ({own:.1f} degrees), sensor rotation estimated: {degrees:.1f} degrees are left")
    assert degrees > left, "the rotation of the sensor is found now"

adopted = adopt_first_pose(drive(turned), drive(), inplace=False)
first = np.linalg.norm(adopted.positions.xyz[0] - positions[0])
metres, _ = largest(tp.ate(adopted, drive(), align=False))
print(f"frame turned by 90 degrees, first pose adopted ({first:.3f} m): {metres:.1f} m at most")
assert first < 1e-6 and metres > 70, "the positions are turned now"
print("as stated: estimated offsets are not in the errors")
EOF
