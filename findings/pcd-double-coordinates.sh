#!/usr/bin/env bash
# SUBJECT  @loaders.gl/pcd 4.4.2 and pypointcloud 0.1.0 (readers of PCD), beside three 0.187.0
# GUESS    SIZE 8, TYPE F is a double; a reader that gives float32 positions rounds it, or says
#          that it reads only SIZE 4.
# SEEN     Both read floats. @loaders.gl/pcd takes the right offset and the lower half of the double:
#          x = 691000.125 is returned as 2, y = 5334000.25 as 2.5e-29. pypointcloud takes the first
#          twelve bytes of a point for three floats, so y is the upper half of x; in ASCII files
#          too. The loader of three converts the same bytes correctly.
# WHY IT MATTERS
#          Clouds in map coordinates need doubles, and are what one opens in a browser. Halves
#          of doubles are tiny or huge: an empty picture, or a box of 1e38 m, and no message.
# SOURCE   Run below; parse-pcd of @loaders.gl/pcd, load_pcd of pypointcloud, PCDLoader of three.
# DATE     2026-11-28
# Needs Python 3.11 or newer, Node.js 20 and npm. About 120 MB and 30 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
export PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
python3 -m venv "$dir/venv"
"$dir/venv/bin/python" -m pip install --quiet --no-cache-dir --no-compile \
  pypointcloud==0.1.0 numpy==2.4.6
cd "$dir"
printf '{"private": true}' >package.json
npm install --silent --no-audit --no-fund --cache "$dir/npm" \
  @loaders.gl/pcd@4.4.2 @loaders.gl/core@4.4.2 @math.gl/types@4.1.0 three@0.187.0
"$dir/venv/bin/python" - <<'EOF'
from importlib.metadata import version

import numpy as np
import pypointcloud

print("pypointcloud", version("pypointcloud"))
points = np.array([[691000.125, 5334000.25, 512.5], [691001.125, 5334002.25, 513.5]])
header = (
    "VERSION 0.7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
    "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA "
)
with open("binary.pcd", "wb") as file:
    file.write(header.encode() + b"binary\n" + points.astype("<f8").tobytes())
with open("ascii.pcd", "w") as file:
    file.write(header + "ascii\n" + "\n".join(" ".join(map(str, row)) for row in points) + "\n")
floats = points.astype("<f8").view("<f4")
for kind in ("binary", "ascii"):
    read, _ = pypointcloud.load_pcd(f"{kind}.pcd")
    print(f"pypointcloud, {kind}: {read.tolist()}")
    assert np.array_equal(read, floats[:, :3]), "doubles are read otherwise now"
floats[:, ::2].tofile("lower_halves.bin")
EOF
cat >read.mjs <<'EOF'
import {readFileSync} from 'node:fs';
import assert from 'node:assert/strict';
import {parseSync} from '@loaders.gl/core';
import {PCDLoader} from '@loaders.gl/pcd';
import {PCDLoader as ThreeLoader} from 'three/examples/jsm/loaders/PCDLoader.js';

const bytesOf = (path) => new Uint8Array(readFileSync(path)).buffer;
const numbers = (array) => Array.from(array);
const file = bytesOf('binary.pcd');
const loaders = numbers(parseSync(file, PCDLoader).attributes.POSITION.value);
const three = numbers(new ThreeLoader().parse(file).geometry.attributes.position.array);
console.log('@loaders.gl/pcd', PCDLoader.version, loaders);
console.log('three', three);
assert.deepEqual(loaders, numbers(new Float32Array(bytesOf('lower_halves.bin'))));
assert.deepEqual(three, [691000.125, 5334000, 512.5, 691001.125, 5334002, 513.5]);
console.log('as stated: both read parts of doubles as floats');
EOF
node read.mjs
