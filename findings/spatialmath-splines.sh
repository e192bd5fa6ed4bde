#!/usr/bin/env bash
# SUBJECT  spatialmath-python 1.1.18 (its splines on SE(3)), with numpy 2.4.6 and scipy 1.17.1
# GUESS    BSplineSE3 is a smooth curve near its control poses, wherever the map has its origin.
#          InterpSplineSE3.derivative is a twist in one frame. SplineFit leaves out poses that the
#          others give to a millimetre.
# SEEN     BSplineSE3 blends the logarithms of the poses in the map. Where the heading passes 180
#          degrees, in the middle of a bend of 20 m, it turns back through 0 and comes within 2 m of
#          the centre; 1 km from the origin it leaves the bend by 900 m. Without that passage it is
#          2 cm off at the origin, and 5 km in UTM coordinates.
#          derivative gives the velocity in the map and the rates in the body: rolled by 90 degrees,
#          a yaw about the own z is (0, 0, 0.5), not (0, -0.5, 0).
#          stochastic_downsample_interpolation maps the times to 0 to 1 by default and then looks up
#          errors at the times in seconds: of 51 poses of a circle it keeps 51, and reports errors
#          of kilometres. With normalize_time=False it keeps 13.
# WHY IT MATTERS
#          A trajectory smoothed this way is right for an arm on a table and for the first bend of a
#          drive. Fit InterpSplineSE3 to poses relative to the first, or compose relative
#          logarithms.
# SOURCE   Run below; spline.py.
# DATE     2026-11-28
# Needs Python 3.11 to 3.14. About 150 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
# Without the tests of numpy and scipy, with which it takes 200 MB.
extract='import sys, zipfile; wheel = zipfile.ZipFile(sys.argv[2]); wheel.extractall(
  sys.argv[1], [name for name in wheel.namelist() if "/tests/" not in name])'
for package in scipy==1.17.1 numpy==2.4.6 typing_extensions==4.15.0 \
  spatialmath-python==1.1.18; do
  python3 -m pip download --quiet --no-cache-dir --no-deps --dest "$dir/wheel" "$package"
  python3 -c "$extract" "$dir/site" "$dir"/wheel/*.whl
  rm -r "$dir/wheel"
done
# Nothing is drawn here: matplotlib, which takes 40 MB, only has to be there.
mkdir "$dir/site/matplotlib"
for module in __init__ axes patches path pyplot transforms; do
  echo "def __getattr__(name): return type(name, (), {})" > "$dir/site/matplotlib/$module.py"
done
PYTHONPATH="$dir/site" python3 -s - <<'EOF'
from importlib.metadata import version

import numpy as np
from spatialmath import SE3
from spatialmath.spline import BSplineSE3, InterpSplineSE3, SplineFit

print(*(f"{name} {version(name)}" for name in ("spatialmath-python", "numpy", "scipy")))
RADIUS, RATE = 20.0, 0.5  # m, rad/s


def on_bend(seconds, heading=0.0, centre=(0.0, 0.0)):
    heading = heading + RATE * seconds
    x, y = centre + RADIUS * np.array([np.sin(heading), -np.cos(heading)])
    return SE3.Trans(x, y, 0) * SE3.Rz(heading)


def farthest_from_bend(name, heading, centre):
    curve = BSplineSE3([on_bend(time, heading, centre) for time in np.arange(0, 3, 0.3)])
    places = np.array([curve(share).t[:2] for share in np.linspace(0, 1, 51)]) - centre
    metres = np.abs(np.linalg.norm(places, axis=1) - RADIUS).max()
    print(f"BSplineSE3, {name}: up to {metres:.2f} m off the bend")
    return metres


UTM = (458_000.0, 5_429_000.0)
assert farthest_from_bend("at the origin", 0, (0, 0)) < 0.05
assert farthest_from_bend("in UTM coordinates", 0, UTM) > 1000, "the origin is of no matter now"
through = np.pi - 0.6
assert farthest_from_bend("heading through 180 degrees", through, (0, 0)) > 15, "180 is passed now"
assert farthest_from_bend("the same, 1 km away", through, (1000, 0)) > 500

times = np.arange(0, 5.01, 0.1)
bend = InterpSplineSE3(list(times), [on_bend(time) for time in times])
twist = bend.derivative(2.0).S
print("derivative on the bend, heading 1 rad:", twist.round(3).tolist())
assert np.allclose(twist[:3], RADIUS * RATE * np.array([np.cos(1), np.sin(1), 0]), atol=0.01)
rolled = InterpSplineSE3(list(times), [SE3.Rx(np.pi / 2) * SE3.Rz(RATE * time) for time in times])
twist = rolled.derivative(2.0).S
print("derivative, rolled by 90 degrees:     ", (twist.round(3) + 0).tolist())
assert np.allclose(twist[3:], (0, 0, RATE), atol=0.01), "rates are in the map now"

for normalize in (True, False):
    np.random.seed(0)
    fit = SplineFit(list(times), [on_bend(time) for time in times])
    _, kept = fit.stochastic_downsample_interpolation(normalize_time=normalize)
    metres = fit.max_euclidean_error()
    print(f"SplineFit, normalize_time={normalize}: keeps {len(kept)} poses, {metres:.3f} m off")
    if normalize:
        assert len(kept) == len(times) and metres > 1000, "poses are left out now"
    else:
        assert len(kept) < 20 and metres < 0.01
print("as stated: curves depend on the origin, twists on two frames")
EOF
