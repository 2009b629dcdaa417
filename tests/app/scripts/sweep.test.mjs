// The sweep of the monitor: every beat of a steady beat is drawn alike.
import assert from "node:assert/strict";
import { test } from "node:test";
import { LEFT, SECONDS, headAt, samples } from "../../../src/eclsim/app/web/lib/sweep.js";

const WAVE = Array.from({ length: 200 }, (_, k) => Math.sin((2 * Math.PI * k) / 200));

test("the head starts behind the axis, reaches the end and starts again", () => {
  assert.equal(headAt(0, 640, 1), LEFT);
  assert.equal(headAt(SECONDS / 2, 640, 1), LEFT + 300);
  assert.equal(headAt(SECONDS, 640, 1), LEFT);
});

test("the head stands on a border of device pixels", () => {
  for (const ratio of [1, 1.5, 2])
    for (const time of [0.1234, 1.7, 5.99]) assert.ok(Number.isInteger(headAt(time, 631, ratio) * ratio));
});

test("samples stand at their own times", () => {
  const width = 640;
  const points = samples(WAVE, 0.5, width, LEFT, width);
  const [x, value] = points[150];
  const time = ((x - LEFT) / (width - LEFT)) * SECONDS;
  assert.ok(Math.abs(Math.sin((2 * Math.PI * time) / 0.5) - value) < 1e-12);
  assert.ok(points[0][0] <= LEFT && points.at(-1)[0] >= width);
});

test("two pieces hold the same samples where they overlap", () => {
  const whole = new Map(samples(WAVE, 0.73, 500, 0, 500));
  for (const [x, value] of samples(WAVE, 0.73, 500, 200, 260)) assert.equal(whole.get(x), value);
});

test("a missing sample leaves a gap", () => {
  const points = samples([1, null, 3, NaN], 1, 640, LEFT, 640);
  assert.deepEqual(new Set(points.map(([, value]) => value)), new Set([1, 3]));
});
