#!/usr/bin/env bash
# SUBJECT  evalio 0.6.1 (evaluation of lidar-inertial odometry), with numpy 2.4.6
# GUESS    stats.ate compares poses of equal stamps, so a perfect trajectory that lacks one sweep
#          has an error of 0, and moving the whole trajectory by 1 cm changes nothing for the
#          better.
# SEEN     If both trajectories have the same number of poses and the same first pose, stamps are
#          not looked at: poses are compared by their index. A perfect estimate at 10 m/s and
#          10 Hz that dropped one sweep, and ends one sweep later, has an ATE of 0.87 m. The same
#          estimate moved by 1 cm has an ATE of 0, since only then stamps are matched and the
#          first poses aligned. The relative error (rte) does the same: 0.56 m and 0.
# WHY IT MATTERS
#          Real-time runs drop sweeps, and both trajectories often start at the identity. The
#          figure then depends on whether the counts happen to agree. Call stats.align_stamps
#          before, or check that stamps are equal.
# SOURCE   Run below; stats.ate, stats.rte and stats._check_aligned in this version.
# DATE     2026-11-27
# Needs Python 3.11 or newer. About 120 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
# Only what evalio.stats imports: everything that evalio lists takes 500 MB.
python3 -m pip install --quiet --no-cache-dir --no-compile --no-deps --target "$dir/site" \
  evalio==0.6.1 numpy==2.4.6 asteval==1.0.10 rosbags==0.11.9 lz4==4.4.5 ruamel.yaml==0.19.1 \
  backports.zstd==1.8.0 apsw==3.54.1.0 rich==15.0.0 tqdm==4.70.1 PyYAML==6.0.4 \
  typing_extensions==4.16.0
PYTHONPATH="$dir/site" python3 -s - <<'EOF'
from importlib.metadata import version

import numpy as np
from evalio import stats
from evalio import types as ty

print("evalio", version("evalio"), "numpy", np.__version__)


def trajectory(sweeps, shift=0.0):
    """Straight ahead at 1 m per sweep, one sweep every 0.1 s."""
    return ty.Trajectory(
        stamps=[ty.Stamp.from_sec(100.0 + 0.1 * sweep) for sweep in sweeps],
        poses=[
            ty.SE3(ty.SO3.identity(), np.array([sweep + shift, 0.0, 0.0])) for sweep in sweeps
        ],
    )


truth = trajectory(range(21))
dropped = [sweep for sweep in range(22) if sweep != 5]
cases = {
    "one sweep dropped, 21 poses": trajectory(dropped),
    "the same moved by 1 cm": trajectory(dropped, 0.01),
    "one sweep dropped, 20 poses": trajectory(dropped[:-1]),
}
errors = {}
for name, estimate in cases.items():
    ate = stats.ate(estimate, truth).sse().trans
    rte = stats.rte(estimate, truth, stats.WindowMeters(5)).sse().trans
    errors[name] = ate, rte
    print(f"{name:28} ATE {ate:.3f} m, relative error over 5 m {rte:.3f} m")

by_index = [int(a != b) for a, b in zip(dropped, range(21), strict=True)]
expected = float(np.sqrt(np.mean(np.square(by_index))))
ate, rte = errors["one sweep dropped, 21 poses"]
assert np.isclose(ate, expected) and ate > 0.8, "stamps are looked at now"
assert rte > 0.5, "stamps are looked at now"
for name in list(cases)[1:]:
    assert max(errors[name]) < 1e-9, name
print("as stated: equal counts and first poses switch off the matching of stamps")
EOF
