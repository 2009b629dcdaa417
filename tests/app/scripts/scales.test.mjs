// Scales of axes, of the monitor's traces, and of sliders.
import assert from "node:assert/strict";
import { test } from "node:test";
import {
  extent,
  fixedRange,
  logShare,
  laneRange,
  niceRange,
  positionOf,
  positions,
  ticks,
  valueAt,
} from "../../../src/eclsim/app/web/lib/scales.js";

const PRESSURE = [
  [0, 150],
  [0, 200],
  [0, 300],
];

test("ticks are round and lie within the range", () => {
  assert.deepEqual(ticks(0, 100), [0, 25, 50, 75, 100]);
  assert.deepEqual(ticks(-7, 13, 4), [-5, 0, 5, 10]);
});

test("a range with round ends holds its values", () => {
  for (const [low, high] of [
    [64, 68],
    [-29, 190],
    [0.3, 0.4],
    [5, 5],
  ]) {
    const [bottom, top] = niceRange(low, high);
    assert.ok(bottom <= low && top >= high && top > bottom, `${low} ${high}: ${bottom} ${top}`);
  }
});

test("a range stays while the values fit and fill a third of it", () => {
  assert.deepEqual(niceRange(10, 90, [0, 100]), [0, 100]);
  assert.notDeepEqual(niceRange(40, 50, [0, 100]), [0, 100]);
  assert.notDeepEqual(niceRange(10, 110, [0, 100]), [0, 100]);
});

test("the first fixed scale that holds a trace is taken, whatever its amplitude", () => {
  assert.deepEqual(fixedRange(PRESSURE, 60, 64), [0, 150]);
  assert.deepEqual(fixedRange(PRESSURE, 60, 151), [0, 200]);
});

test("the last fixed scale is doubled until it holds the trace", () => {
  assert.deepEqual(fixedRange(PRESSURE, 0, 700), [0, 1200]);
  const [low, high] = fixedRange(PRESSURE, -20, 100);
  assert.ok(low <= -20 && high >= 100);
});

test("an extent leaves out what is no number and is as wide as asked", () => {
  assert.deepEqual(extent([NaN, 3, null, 5]), [3, 5]);
  assert.deepEqual(extent([4, 4], 6), [1, 7]);
  assert.equal(extent([NaN, null]), undefined);
});

test("a share on a logarithmic scale stays between 0 and 1", () => {
  assert.equal(logShare(1, [0.1, 10]), 0.5);
  assert.equal(logShare(0.01, [0.1, 10]), 0);
  assert.equal(logShare(99, [0.1, 10]), 1);
  assert.equal(logShare(1000, [-3000, 5000]), 0.5);
});

test("a slider of even steps gives back the value that it was set to", () => {
  const speed = { low: 1000, high: 5000, step: 25, log: false };
  assert.equal(positions(speed), 160);
  for (const value of [1000, 3425, 5000]) assert.equal(valueAt(speed, positionOf(speed, value)), value);
  assert.equal(positionOf(speed, 9999), positions(speed));
});

test("a logarithmic slider is within a step of the value, and exact at its ends", () => {
  const resistance = { low: 0.1, high: 4, step: 0.01, log: true };
  assert.equal(valueAt(resistance, 0), 0.1);
  assert.equal(valueAt(resistance, positions(resistance)), 4);
  const step = (4 / 0.1) ** (1 / positions(resistance));
  const value = valueAt(resistance, positionOf(resistance, 0.76));
  assert.ok(Math.abs(Math.log(value / 0.76)) < Math.log(step));
});

test("a share in percent has no scale beyond 100", () => {
  assert.equal(laneRange([97, 99.8], "%")[1], 100);
  assert.equal(
    laneRange([99, 99, null], "%", 4)[1],
    100,
    "also where the lane is made higher than its values",
  );
  assert.deepEqual(laneRange([null], "mmHg"), niceRange(0, 1));
  assert.ok(laneRange([97, 104], "%")[1] >= 104, "what is above is still drawn");
  assert.ok(laneRange([97, 99.8], "mmHg")[1] > 100);
});
