import assert from "node:assert/strict";
import { test } from "node:test";

import {
  alarmsBetween,
  briefly,
  brokenSpans,
  clock,
  curvePath,
  momentAt,
  playedTo,
  timeOf,
  valueIn,
} from "../../../src/eclsim/app/web/lib/course.js";

test("minutes are read as on a clock, with days in front", () => {
  assert.equal(clock(0), "00:00");
  assert.equal(clock(192.9), "03:12");
  assert.equal(clock(59.9999999), "01:00");
  assert.equal(clock(1440 + 61), "1 d 01:01");
  assert.equal(clock(1.75, true), "00:01:45");
  assert.equal(clock(59 / 60, true), "00:00:59");
  assert.equal(clock(2 - 1.2e-5, true), "00:02:00", "never 60 seconds");
});

test("a beat of a later minute has a time", () => {
  assert.equal(timeOf({ minute: 252, transient: false }), "04:12");
  assert.equal(timeOf({ minute: 1.5, transient: true }), "00:01:30");
  assert.deepEqual([{ minute: 0 }, null, undefined].map(timeOf), ["", "", ""]);
});

test("play goes on at its speed and ends at the end", () => {
  assert.equal(playedTo(10, 60_000, 1, 100), 11);
  assert.equal(playedTo(10, 1000, 3600, 100), 70);
  assert.equal(playedTo(99, 1000, 3600, 100), 100);
  assert.equal(playedTo(10, -16, 3600, 100), 10);
});

test("play meets the first alarms on its way, no warning, and none where it stands", () => {
  const times = [0, 10, 20, 25, 30, 60];
  const [early, first, second, third] = [
    { kind: "warning", at_min: 12 },
    { kind: "alarm", at_min: 20 },
    { kind: "collapse", at_min: 26.5 },
    { kind: "alarm", at_min: 28 },
  ];
  const alarms = [third, second, early, first];
  assert.deepEqual(alarmsBetween(alarms, times, 0, 60), { minute: 20, alarms: [first] });
  assert.deepEqual(alarmsBetween(alarms, times, 20, 60), { minute: 30, alarms: [third, second] });
  assert.equal(alarmsBetween(alarms, times, 20, 29), null, "the beats in between need not break the limit");
  assert.equal(alarmsBetween(alarms, times, 0, 15), null);
  assert.equal(alarmsBetween([], times, 0, 60), null);
});

test("an alarm is said in short, without its times and its reason", () => {
  const brief = (sentence) => briefly({ sentence });
  const low = "mean arterial pressure below 55 mmHg";
  assert.equal(brief(`${low} at 01:11, until 01:37 (7.667 mmHg at worst): organs are not perfused`), low);
  assert.equal(brief(`${low} at 1 d 01:11 (7.667 mmHg at worst): organs are not perfused`), low);
  assert.equal(
    brief("at 01:20, until 01:25: volume falls to \u22121.7 mL: it collapses"),
    "volume falls to \u22121.7 mL",
  );
});

test("the last moment at or before a time is found", () => {
  const times = [0, 10, 10.5, 20];
  assert.deepEqual(
    [-1, 0, 9, 10, 10.4, 10.5, 25].map((t) => momentAt(times, t)),
    [-1, 0, 0, 1, 1, 2, 3],
  );
  assert.equal(momentAt([], 3), -1);
});

test("between moments values lie on a line, and nowhere else is a value", () => {
  const [times, values] = [
    [0, 10, 20],
    [80, 60, null],
  ];
  assert.equal(valueIn(times, values, 5), 70);
  assert.equal(valueIn(times, values, 10), 60);
  assert.equal(valueIn(times, values, 21), undefined);
  assert.equal(valueIn(times, values, -1), undefined);
  assert.equal(valueIn([0, 5, 5, 9], [1, 1, 3, 3], 5), 3, "a sudden change shows what follows it");
});

test("a curve breaks where there is no value", () => {
  const path = curvePath([0, 1, 2, 4], [0, 10, null, 5], {
    end: 4,
    width: 100,
    height: 10,
    low: 0,
    high: 10,
  });
  assert.equal(path, "M0.0 10.0L25.0 0.0M100.0 5.0");
});

test("the gravest of the limits that are broken is painted last", () => {
  const alarms = [
    { kind: "alarm", at_min: 20, until_min: 30 },
    { kind: "collapse", at_min: 28, until_min: 29 },
    { kind: "warning", at_min: 10, until_min: null },
    { kind: "alarm", at_min: 36, until_min: null },
    { kind: "caution", at_min: 0, until_min: null },
  ];
  const spans = brokenSpans(alarms, { last: 40, end: 80, width: 800 });
  assert.deepEqual(
    spans.map(({ kind, from, width }) => [kind, from, width]),
    [
      ["warning", 100, 300],
      ["alarm", 200, 100],
      ["alarm", 360, 40],
      ["collapse", 280, 10],
    ],
  );
});
