#!/usr/bin/env bash
# SUBJECT  @foxglove/rostime 1.1.3 and its fork @lichtblick/rostime 1.0.0 (times and durations of
#          ROS in JavaScript, npm), with @foxglove/rosmsg 5.0.5, @foxglove/rosmsg2-serialization
#          3.1.0
# GUESS    Negative times have one form, that of ROS: sec rounded down, nsec from 0 to 999999999.
#          toString writes -0.5 s as -0.500000000.
# SEEN     subtract and interpolate return that form. fromSec, fromMillis, fromMicros and
#          fromNanoSec do not: -0.25 s has nsec -250000000. As uint32 of a ROS 2 Duration that is
#          4044967296: the reader of the same package returns 4.04 s. toString puts a sign
#          before the two numbers: -0.5 s, { sec: -1, nsec: 500000000 }, is "-1.500000000".
#          fromDate takes the millisecond off twice: 1 ms before 1970 is -1.001 s.
# WHY IT MATTERS
#          Differences of stamps are negative half of the time: sweep minus pose, camera minus
#          lidar, return minus end of sweep. Shown or sent, an offset of -0.5 s is 1 s wrong, one
#          of -0.25 s has the other sign. Keep offsets as numbers or bigint; normalise with
#          subtract(time, { sec: 0, nsec: 0 }).
# SOURCE   Run below; fromSec, toString and fromDate of these versions;
#          builtin_interfaces/msg/Duration of ROS 2.
# DATE     2026-11-28
# Needs Node.js 18 or newer and npm. About 5 MB and 10 s.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
npm install --loglevel=error --no-audit --no-fund --prefix "$dir" --cache "$dir/cache" \
  @foxglove/rostime@1.1.3 @lichtblick/rostime@1.0.0 @foxglove/rosmsg@5.0.5 \
  @foxglove/rosmsg2-serialization@3.1.0 tslib@2.9.1
cat > "$dir/run.cjs" <<'EOF'
const assert = require("node:assert");
const { readFileSync } = require("node:fs");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader, MessageWriter } = require("@foxglove/rosmsg2-serialization");

const definition = parse("duration offset", { ros2: true });
const sent = (offset) => {
  const bytes = new MessageWriter(definition).writeMessage({ offset });
  return new MessageReader(definition).readMessage(bytes).offset;
};
const seconds = ({ sec, nsec, nanosec }) => sec + (nsec ?? nanosec) / 1e9;

for (const name of ["@foxglove/rostime", "@lichtblick/rostime"]) {
  const path = `${__dirname}/node_modules/${name}/package.json`;
  console.log(name, JSON.parse(readFileSync(path)).version);
  const time = require(name);

  const half = time.subtract({ sec: 1, nsec: 0 }, { sec: 1, nsec: 500000000 });
  assert.deepStrictEqual(half, { sec: -1, nsec: 500000000 });
  assert.strictEqual(seconds(sent(half)), -0.5);
  const text = time.toString(half, true);
  console.log("  -0.5 s by subtract:", half, "toString:", text);
  assert.strictEqual(text, "-1.500000000");

  const forms = {
    fromSec: time.fromSec(-0.25),
    fromMillis: time.fromMillis(-250),
    fromMicros: time.fromMicros(-250000),
    fromNanoSec: time.fromNanoSec(-250000000n),
  };
  for (const [from, offset] of Object.entries(forms)) {
    const received = seconds(sent(offset));
    console.log(`  -0.25 s by ${from}:`, offset, `sent as a message: ${received} s`);
    assert.ok(offset.sec === 0 && offset.nsec === -250000000, "normalised now");
    assert.strictEqual(received, 4.044967296);
  }
  const normal = time.subtract(forms.fromSec, { sec: 0, nsec: 0 });
  assert.strictEqual(seconds(sent(normal)), -0.25);

  const date = time.fromDate(new Date(-1));
  console.log("  1 ms before 1970 by fromDate:", date, `= ${seconds(date)} s`);
  assert.strictEqual(seconds(date), -1.001);
}
console.log("as stated: negative times have two forms, and their text is wrong");
EOF
node "$dir/run.cjs"
