#!/usr/bin/env bash
# SUBJECT  mgrs 1.6.0 (conversion of MGRS coordinates) beside 1.5.4
# GUESS    MGRSToUTM and toLatLon return the south-west corner of a square, as the standard counts
#          from it and as all versions before did: the square 54SUE begins at (300 km, 3900 km).
# SEEN     1.6.0 returns the centre: (350 km, 3950 km), and its latitude and longitude. With all
#          digits it is half a metre in each direction. 1.5.4 returns the corner. UTMToMGRS and
#          toMGRS truncate in both: to MGRS and back, a point moves by up to 1.4 m south-west in
#          1.5.4, and by up to 0.7 m to any side in 1.6.0.
# WHY IT MATTERS
#          Maps of Autoware are stored in metres from the corner of their square of 100 km, and the
#          name of the square stands beside them. Whoever adds the corner, found with this
#          package, places map and vehicle 50 km east and 50 km north, or half a metre off where
#          full coordinates are decoded. The change stands in the notes of the release;
#          the functions and the form of their results are as before.
# SOURCE   Run below; release notes of mgrs 1.6.0, number 57. NGA's GEOTRANS 3.10, which it wraps.
# DATE     2026-11-28
# Needs Python 3.11 to 3.13. About 30 MB and 15 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
pip() { "$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile "$@"; }
pip --target "$dir/old" mgrs==1.5.4 packaging==25.0
pip --target "$dir/new" mgrs==1.6.0
cat >"$dir/convert.py" <<'EOF'
import json
from importlib.metadata import version

import mgrs

convert = mgrs.MGRS()
east, north = 312345.9, 3967890.9
name = convert.UTMToMGRS(54, "N", east, north)
name = name.decode() if isinstance(name, bytes) else name
print(json.dumps({
    "version": version("mgrs"),
    "square": convert.MGRSToUTM("54SUE")[2:],
    "degrees": convert.toLatLon("54SUE"),
    "name": name,
    "back": convert.MGRSToUTM(name)[2:],
}))
EOF
for version in old new; do
  PYTHONPATH="$dir/$version" "$dir/venv/bin/python" "$dir/convert.py" >"$dir/$version.json"
done
"$dir/venv/bin/python" - "$dir/old.json" "$dir/new.json" <<'EOF'
import json
import sys

old, new = (json.load(open(path)) for path in sys.argv[1:])
for result in (old, new):
    print(f"mgrs {result['version']}: 54SUE is at {result['square']} m, {result['degrees']}")
    print(f"  (312345.9, 3967890.9) is {result['name']}, and that is at {result['back']} m")


def close(left, right):
    return all(abs(one - other) < 1e-3 for one, other in zip(left, right, strict=True))


assert old["name"] == new["name"] == "54SUE1234567890"
assert close(old["square"], (300_000, 3_900_000))
assert close(new["square"], (350_000, 3_950_000)), "the corner is returned again"
assert close(old["back"], (312_345, 3_967_890)) and close(new["back"], (312_345.5, 3_967_890.5))
apart = [after - before for before, after in zip(old["degrees"], new["degrees"], strict=True)]
print("apart by", [round(value, 3) for value in apart], "degrees")
assert all(value > 0.4 for value in apart)
print("as stated: a square is decoded to its centre, 50 km from its corner")
EOF
