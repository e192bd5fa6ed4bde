#!/usr/bin/env bash
# SUBJECT  copc 0.0.8 (reader of LAS, LAZ and COPC for JavaScript), files of laspy 2.7.0
# GUESS    Extra bytes with a scale and an offset come back as laspy wrote them: it applies both,
#          as for coordinates.
# SEEN     It applies them, but takes the two doubles of their description for big-endian. A
#          reflectance of -19.5 dB, stored as 50 with scale 0.01 and offset -20, is returned as
#          3.8e286; a width of 3.5, stored as 7 with scale 0.5, as 2.0e-318. The rest of a point is
#          right: coordinates, GPS time, extra bytes without a scale.
# WHY IT MATTERS
#          Reflectance, deviation and range of Riegl and others are stored like this, and viewers
#          in the browser that build upon this package colour by them: black or white. Nothing is
#          thrown. Read these bytes with scale and offset yourself, or write them as floats.
# SOURCE   Run below; las/extra-bytes.ts. The specification of LAS: all values are little-endian.
# DATE     2026-11-28
# Needs Python 3.11 or newer, Node.js 18 or newer and npm. About 120 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  laspy==2.7.0 lazrs==0.8.2 numpy==2.4.6
cd "$dir"
printf '{"private": true}' >package.json
npm install --silent --no-audit --no-fund --cache "$dir/npm" copc@0.0.8 laz-perf@0.0.7
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import laspy
import numpy as np

header = laspy.LasHeader(point_format=7, version="1.4")
header.scales, header.offsets = [0.001] * 3, [691000, 5334000, 0]


def field(name, kind, scale=None, offset=None):
    given = {} if scale is None else {"scales": np.array([scale]), "offsets": np.array([offset])}
    header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=kind, **given))


field("reflectance", np.uint16, 0.01, -20.0)
field("width", np.uint16, 0.5, 0.0)
field("count", np.uint16)
las = laspy.LasData(header)
las.x = np.array([691000.125, 691001.25])
las.y = np.array([5334000.25, 5334002.5])
las.z = np.array([512.5, -3.25])
las.gps_time = np.array([1e8 + 0.25, 1e8 + 0.5])
las.reflectance = np.array([-19.5, 10.0])
las.width = np.array([3.5, 100.0])
las.count = np.array([7, 65535])
las.write("cloud.laz")
las = laspy.read("cloud.laz")
rows = [np.ravel(las[name]).tolist() for name in ("reflectance", "width", "count")]
print("laspy", version("laspy"), *rows)
assert np.allclose(rows, [[-19.5, 10.0], [3.5, 100.0], [7, 65535]])
EOF
cat >read.mjs <<'EOF'
import {readFileSync} from 'node:fs';
import assert from 'node:assert/strict';
import {Las} from 'copc';

const file = readFileSync('cloud.laz');
const get = async (begin, end) => file.subarray(begin, end);
const header = Las.Header.parse(file);
const found = Las.Vlr.find(await Las.Vlr.walk(get, header), 'LASF_Spec', 4);
const extra = Las.ExtraBytes.parse(await Las.Vlr.fetch(get, found));
const view = Las.View.create(await Las.PointData.decompressFile(file), header, extra);
const column = (name) => [0, 1].map(view.getter(name));

for (const name of ['X', 'Y', 'Z', 'GpsTime', 'count', 'reflectance', 'width'])
  console.log(name, column(name));
assert.deepEqual(column('X'), [691000.125, 691001.25]);
assert.deepEqual(column('GpsTime'), [1e8 + 0.25, 1e8 + 0.5]);
assert.deepEqual(column('count'), [7, 65535]);

// The doubles of scale and offset, turned around.
const turned = (value) => {
  const bytes = new DataView(new ArrayBuffer(8));
  bytes.setFloat64(0, value, true);
  return bytes.getFloat64(0);
};
const described = Object.fromEntries(extra.map((field) => [field.name, field]));
console.log('scale', described.reflectance.scale, 'offset', described.reflectance.offset);
assert.equal(described.reflectance.scale, turned(0.01), 'the scale is read otherwise now');
assert.equal(described.reflectance.offset, turned(-20));
assert.ok(column('reflectance').every((value) => value > 1e280));
assert.ok(column('width').every((value) => value < 1e-300));
console.log('as stated: scale and offset are read with their bytes turned around');
EOF
node read.mjs
