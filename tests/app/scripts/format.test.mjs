// Numbers, limits and sentences as the page writes them.
import assert from "node:assert/strict";
import { test } from "node:test";
import {
  MINUS,
  aboutSign,
  careOf,
  change,
  compact,
  doubtOf,
  fewOf,
  fill,
  fixed,
  gravest,
  isPossible,
  laterThanStart,
  leftOut,
  limitLines,
  limitsOf,
  scaled,
  settingsText,
  signed,
  speedsText,
} from "../../../src/eclsim/app/web/lib/format.js";

test("a number has its decimals, a typographic minus, and none before zero", () => {
  assert.equal(fixed(3.96, 1), "4.0");
  assert.equal(fixed(-12.34, 1), `${MINUS}12.3`);
  assert.equal(fixed(-0.04, 1), "0.0");
});

test("what is no number is a dash", () => {
  for (const value of [null, undefined, NaN, Infinity]) {
    assert.equal(fixed(value, 1), "–");
    assert.equal(compact(value), "–");
    assert.equal(fixed(scaled(value, 0.06), 2), "–");
  }
  assert.equal(scaled(100, 0.06), 6);
});

test("compact numbers have about three digits", () => {
  const expected = [
    [0, "0.000"],
    [0.0123, "0.012"],
    [1.234, "1.23"],
    [12.34, "12.3"],
    [123.4, "123"],
    [-123.4, `${MINUS}123`],
    [0.0001234, `1.23e${MINUS}4`],
    [-0.0001234, `${MINUS}1.23e${MINUS}4`],
    [1.87e-7, "0.000"],
    [-6.17e-7, "0.000"],
    [2345678, "2.35e+6"],
  ];
  for (const [value, text] of expected) assert.equal(compact(value), text);
});

test("a change below a thousandth of the value is none", () => {
  assert.equal(change(100.05, 100), "0");
  assert.equal(change(101, 100), "+1.00");
  assert.equal(change(99, 100), `${MINUS}1.00`);
  assert.equal(change(99, null), "");
  assert.equal(change(null, 99), "");
});

test("a difference has its sign", () => {
  assert.equal(signed(0.004, 2), "0.00");
  assert.equal(signed(-0.004, 2), "0.00");
  assert.equal(signed(0.5, 2), "+0.50");
  assert.equal(signed(null, 2), "–");
  assert.equal(signed(-0.64, 2), `${MINUS}0.64`);
});

test("the same limits are broken whatever their numbers are, others where one comes or gets graver", () => {
  const low = (value, kind = "warning") => [kind, `pressure ${value} mmHg is below 65 mmHg: organs`];
  assert.equal(limitsOf([low("56.7")]), limitsOf([low("60")]));
  assert.equal(limitsOf([low("\u22121.2")]), limitsOf([low("3")]));
  assert.notEqual(limitsOf([low("56.7")]), limitsOf([low("56.7", "alarm")]));
  assert.notEqual(limitsOf([low("56.7")]), limitsOf([low("56.7"), ["warning", "aortic valve flow 0.000"]]));
});

test("the gravest level of several outputs counts", () => {
  const levels = { MAP: "warning", PF: "alarm", CO: "ok" };
  assert.equal(gravest(levels, ["MAP", "PF"]), "alarm");
  assert.equal(gravest(levels, ["MAP", "CO"]), "warning");
  assert.equal(gravest(levels, ["CO", "unknown"]), "ok");
});

test("limits are listed by kind with their sign", () => {
  const limits = [
    { kind: "alarm", side: "below", value: 55 },
    { kind: "warning", side: "below", value: 65 },
    { kind: "warning", side: "above", value: 107 },
  ];
  assert.equal(limitLines(limits), "! < 65, > 107\n▲ < 55");
  assert.equal(limitLines([]), "");
});

test("limits have all their digits: a pH of 7.65 is not 8, an extraction of 0.5 not 1", () => {
  const above = (value) => limitLines([{ kind: "alarm", side: "above", value }]);
  assert.deepEqual([7.65, 0.5, 0.25, -300].map(above), [
    "▲ > 7.65",
    "▲ > 0.5",
    "▲ > 0.25",
    `▲ > ${MINUS}300`,
  ]);
});

test("settings that differ are written differently, as beside their knobs where that tells them apart", () => {
  assert.deepEqual(settingsText([0.75989, 1.1, undefined, -5]), ["0.7599", "1.1", "–", `${MINUS}5`]);
  assert.deepEqual(settingsText([3425, 3425.4]), ["3425", "3425.4"]);
  assert.deepEqual(settingsText(["aorta", "aorta"]), ["aorta", "aorta"]);
});

test("gaps of a sentence are filled with what was typed, whatever signs it has", () => {
  assert.equal(fill("{a} of {b}", { a: 1, b: "$&" }), "1 of $&");
});

test("a beat is possible unless it says that it is not", () => {
  assert.deepEqual([{ possible: true }, {}, null, undefined].map(isPossible), [true, true, true, true]);
  assert.equal(isPossible({ possible: false }), false);
});

test("what is computed for the start alone says so while another minute is seen", () => {
  const texts = { of_start: "start, not {time}", pinned_later: "pinned {time}" };
  assert.deepEqual(laterThanStart(texts, "", ""), []);
  assert.deepEqual(laterThanStart(texts, "04:12", "03:00"), ["start, not 04:12", "pinned 03:00"]);
});

test("neighbouring speeds are named by their ends", () => {
  const all = [0, 1000.4, 2000, 3000, 4000, 5000];
  assert.equal(speedsText([4000], all), "4000");
  assert.equal(speedsText([0, 1000.4, 3000, 4000, 5000], all), "0–1000, 3000–5000");
  assert.equal(speedsText([], all), "");
});

test("draws that are not in a band are counted by what they lack, of gases only where there are any", () => {
  const texts = {
    bands_left_out: "left out: {draws}",
    bands_lost: "{count} no beat",
    bands_lost_gases: "{count} no beat or gases",
    bands_impossible: "{count} impossible",
  };
  assert.equal(leftOut(texts, { lost: 0, impossible: 0 }, true), "");
  assert.equal(leftOut(texts, { lost: 3, impossible: 0 }, true), "left out: 3 no beat or gases");
  assert.equal(leftOut(texts, { lost: 3, impossible: 12 }, false), "left out: 3 no beat, 12 impossible");
});

test("a number that is not determined is marked, whichever of several is meant", () => {
  const beat = { undetermined: ["MAP"], second: "" };
  assert.equal(aboutSign(beat, "MAP"), "≈");
  assert.equal(aboutSign(beat, "PF", "MAP"), "≈");
  assert.equal(aboutSign(beat, "PF"), "");
  assert.equal(aboutSign(null, "MAP"), "");
});

test("a beat that is not the only one at its settings has a text of its own", () => {
  assert.equal(doubtOf({ undetermined: ["MAP"], second: "" }), "undetermined");
  assert.equal(doubtOf({ undetermined: [], second: "two" }), "one_of_two");
  assert.equal(doubtOf({ undetermined: [], second: "" }), "");
  assert.equal(doubtOf(undefined), "");
});

test("what is to be known of reading several outputs is said once", () => {
  const open = "SP and DP are not determined";
  const beat = { cautions: { SP: open, DP: open, PCWP: "the volume is assumed" } };
  assert.equal(careOf(beat, ["SP", "DP", "PCWP"]), `${open}; the volume is assumed`);
  assert.equal(careOf(beat, ["MAP"]), "");
  assert.equal(careOf(null, ["SP"]), "");
});

test("of many names the first are written, and never one counted that could be", () => {
  assert.equal(fewOf(["SP", "DP", "PA"], 2, "{count} more"), "SP, DP, PA");
  assert.equal(fewOf(["SP", "DP", "PA", "CO"], 2, "{count} more"), "SP, DP, 2 more");
  assert.equal(fewOf([], 2, "{count} more"), "");
});
