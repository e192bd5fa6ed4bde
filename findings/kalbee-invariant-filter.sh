#!/usr/bin/env bash
# SUBJECT  kalbee 1.0.0 (InvariantEKF, a filter of poses on SE(3)), with numpy 2.4.6 and scipy
#          1.17.1
# GUESS    Fed with the twist and with fixes of the position it follows them, and finds the heading
#          while it moves: that is what an invariant filter is praised for, convergence from a wrong
#          start.
# SEEN     On a straight road, twist exact, start exact, fixes with 2 cm of noise, it is 10 m off
#          after a second and 800 m after a minute. With exact fixes a heading 2 degrees off becomes
#          13 degrees after three fixes and 97 after six. 1 km from the origin the second fix puts
#          it a kilometre away. It is right only as long as nothing is to be corrected, and at rest.
# WHY IT MATTERS
#          A test with exact data passes, and so does one at rest. Predict and update use two
#          conventions of the error: the covariance is propagated for an error in the body, the
#          correction is applied in the world, where the position depends on the rotation by the
#          lever arm to the origin, which the Jacobian leaves out. Run any such filter once from a
#          wrong heading and once far from the origin.
# SOURCE   Run below; filters/invariant_ekf.py.
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
from kalbee import InvariantEKF

print(*(f"{name} {version(name)}" for name in ("kalbee", "numpy", "scipy")))
STEP, SPEED = 0.1, 10.0  # s, m/s
TWIST = np.array([SPEED, 0, 0, 0, 0, 0])  # velocity first


def drive(fixes, start=0.0, heading_deg=0.0, noise=0.0):
    """Errors of position (m) and heading (degrees) after each fix on a straight road along x."""
    pose = np.eye(4)
    turn = np.deg2rad(heading_deg)
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    pose[0, 3] = start
    estimator = InvariantEKF(
        pose, np.eye(6) * 1e-2, np.eye(6) * 1e-4, np.eye(3) * max(noise, 0.02) ** 2
    )
    draws = np.random.default_rng(0).normal(0, noise, (fixes, 3))
    errors = []
    for fix in range(fixes):
        truth = np.array([start + (fix + 1) * SPEED * STEP, 0, 0])
        estimator.predict(dt=STEP, twist=TWIST)
        estimator.update(truth + draws[fix])
        heading = np.rad2deg(np.arctan2(estimator.pose[1, 0], estimator.pose[0, 0]))
        errors.append((np.linalg.norm(estimator.position.ravel() - truth), heading))
    return np.array(errors)


exact = drive(600)
print(f"exact: {exact[:, 0].max():.6f} m at most")
assert exact.max() < 1e-6

noisy = drive(600, noise=0.02)[:, 0]
print(f"fixes with 2 cm of noise: {noisy[10]:.1f} m off after 1 s, {noisy[-1]:.0f} m after 60 s")
assert noisy[10] > 5 and noisy[-1] > 100, "noisy fixes are followed now"

turned = drive(10, heading_deg=2.0)[:, 1]
print("heading 2 degrees off, after each fix:", turned[:6].round(1).tolist())
assert (np.diff(turned[:6]) > 0).all() and turned[5] > 10, "the heading is found now"

far = drive(5, start=1000.0, heading_deg=2.0)[:, 0]
print("the same, 1 km from the origin:", far.round(1).tolist(), "m off")
assert far.max() > 500, "far from the origin it works now"
print("as stated: it leaves what it should follow")
EOF
