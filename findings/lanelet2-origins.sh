#!/usr/bin/env bash
# SUBJECT  lanelet2 1.2.3 (maps for automated driving)
# GUESS    UtmProjector, LocalCartesianProjector and MercatorProjector are constructed alike, with
#          an origin of latitude, longitude and altitude: its point becomes (0, 0, 0), and nearby
#          the three differ by their distortion only.
# SEEN     The point of the origin becomes (0, 0, 115) with UTM, which keeps the altitude, (0, 0, 0)
#          with local coordinates, and (613470, 4116679, 115) with Mercator: there the origin gives
#          only the scale. 1.3 km away UTM lies 10 m beside the local coordinates, whose x points
#          east: its grid is turned by 0.45 degrees at 8.4 degrees east. 1.2 degrees of longitude
#          beyond the zone no error is raised.
# WHY IT MATTERS
#          A lidar map in local coordinates lies 115 m below a lanelet map by UTM, so points and
#          lanes never meet in three dimensions; and a yaw of one frame is wrong in the other by
#          half a degree: 0.9 m at 100 m. With Mercator, coordinates of millions of metres are
#          rounded to 0.25 m in the floats of clouds and markers. Project a second point of the map
#          with both before trusting one.
# SOURCE   Run below.
# DATE     2026-11-28
# Needs Python 3.11 to 3.14 on Linux. About 45 MB and 10 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile lanelet2==1.2.3
"$dir/venv/bin/python" - <<'EOF'
import math
from importlib.metadata import version

from lanelet2 import projection
from lanelet2.core import GPSPoint
from lanelet2.io import Origin

print("lanelet2", version("lanelet2"))
LATITUDE, LONGITUDE, ALTITUDE = 49.0, 8.4, 115.0
NAMES = ("UtmProjector", "LocalCartesianProjector", "MercatorProjector")
projectors = {
    name: getattr(projection, name)(Origin(LATITUDE, LONGITUDE, ALTITUDE)) for name in NAMES
}


def projected(latitude, longitude):
    found = {}
    print(f"latitude {latitude}, longitude {longitude}, altitude {ALTITUDE}")
    for name, projector in projectors.items():
        point = projector.forward(GPSPoint(latitude, longitude, ALTITUDE))
        found[name] = (point.x, point.y, point.z)
        print(f"  {name:24} ({point.x:.2f}, {point.y:.2f}, {point.z:.2f})")
        back = projector.reverse(point)
        assert math.isclose(back.lat, latitude) and math.isclose(back.lon, longitude)
    return [found[name] for name in NAMES]


def near(point, expected, metres=0.01):
    return math.dist(point, expected) < metres


utm, local, mercator = projected(LATITUDE, LONGITUDE)
assert near(utm, (0, 0, ALTITUDE)), "UTM takes the altitude of the origin off now"
assert near(local, (0, 0, 0)), "local coordinates keep the altitude now"
assert near(mercator, (613470.12, 4116679.47, ALTITUDE)), "Mercator is moved to the origin now"

_, local, _ = projected(LATITUDE, 8.41)
assert near(local[:2], (731.73, 0.05), 0.02), "x of the local coordinates is not east now"
utm, local, _ = projected(49.01, 8.41)
beside = math.dist(utm[:2], local[:2])
turned = math.degrees(math.atan2(utm[1], utm[0]) - math.atan2(local[1], local[0]))
print(f"  UTM: {beside:.1f} m beside the local coordinates, turned by {turned:.2f} degrees")
assert 10 < beside < 11 and -0.46 < turned < -0.44

(x, _, _), *_ = projected(49.1, 13.2)
assert x > 3e5, "a point beyond the zone raises now"
print("as stated: three projectors, three meanings of an origin")
EOF
