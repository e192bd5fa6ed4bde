#!/usr/bin/env bash
# SUBJECT  @foxglove/rosmsg2-serialization 3.1.0 (ROS 2 messages in JavaScript, npm), with
#          @foxglove/rosmsg 5.0.5; compared with @foxglove/rosmsg-serialization 2.0.4 (ROS 1)
# GUESS    A typed array of another number type (a Float32Array for float64[36]) is converted,
#          as a plain Array is and as the ROS 1 writer does, or the writer throws.
# SEEN     Neither. A fixed-size field is written as zeros: a pose covariance of 0.5 comes back
#          as 0. A sequence is written as its length without its elements: the message is 8 bytes
#          shorter than calculateByteSize says, and the reader of the same package fails on it.
# WHY IT MATTERS
#          Covariances and matrices come from WebGL, WASM or gl-matrix as Float32Array. A pose
#          with zero covariance is a legal message that a filter takes as certain. Convert with
#          Float64Array.from (or Float32Array.from for scan ranges) before writing.
# SOURCE   Run below; float64Array and float32Array in dist/MessageWriter.js of this version.
# DATE     2026-11-27
# Needs Node.js 18 or newer and npm. About 5 MB and 10 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
npm install --loglevel=error --no-audit --no-fund --prefix "$dir" --cache "$dir/cache" \
  @foxglove/rosmsg@5.0.5 @foxglove/rosmsg2-serialization@3.1.0 \
  @foxglove/rosmsg-serialization@2.0.4 tslib@2.9.1
cat > "$dir/run.cjs" <<'EOF'
const assert = require("node:assert");
const { parse } = require("@foxglove/rosmsg");
const ros2 = require("@foxglove/rosmsg2-serialization");
const ros1 = require("@foxglove/rosmsg-serialization");
for (const name of ["rosmsg", "rosmsg2-serialization", "rosmsg-serialization"]) {
  const path = `${__dirname}/node_modules/@foxglove/${name}/package.json`;
  console.log(name, JSON.parse(require("node:fs").readFileSync(path)).version);
}

const text = "float64[36] covariance\nfloat32[] ranges\nuint8 last\n";
const writer = new ros2.MessageWriter(parse(text, { ros2: true }));
const reader = new ros2.MessageReader(parse(text, { ros2: true }));
const writer1 = new ros1.MessageWriter(parse(text));
const reader1 = new ros1.MessageReader(parse(text));

const plain = { covariance: Array(36).fill(0.5), ranges: [1, 2], last: 9 };
const covariance32 = { ...plain, covariance: new Float32Array(36).fill(0.5) };
const ranges64 = { ...plain, ranges: new Float64Array([1, 2]) };

function show(title, message) {
  const { covariance, ranges, last } = message;
  console.log(title, `covariance[0] ${covariance[0]}, ranges [${ranges}], last ${last}`);
  return [covariance[0], Array.from(ranges), last];
}

const right = [0.5, [1, 2], 9];
for (const message of [plain, covariance32, ranges64]) {
  const back = reader1.readMessage(writer1.writeMessage(message));
  assert.deepStrictEqual(show("ROS 1:", back), right);
}
assert.deepStrictEqual(show("ROS 2, Array:", reader.readMessage(writer.writeMessage(plain))), right);

const zero = reader.readMessage(writer.writeMessage(covariance32));
assert.deepStrictEqual(show("ROS 2, Float32Array for float64[36]:", zero), [0, [1, 2], 9]);
assert(zero.covariance.every((value) => value === 0));

const bytes = writer.writeMessage(ranges64);
const missing = writer.calculateByteSize(ranges64) - bytes.byteLength;
console.log(`ROS 2, Float64Array for float32[]: ${missing} bytes fewer than announced`);
assert.strictEqual(missing, 8);
assert.throws(() => reader.readMessage(bytes), (error) => {
  console.log("reading it:", error.message);
  return error instanceof RangeError;
});
console.log("as stated: arrays of another number type are dropped");
EOF
node "$dir/run.cjs"
