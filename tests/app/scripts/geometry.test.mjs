// Geometry of the schematic.
import assert from "node:assert/strict";
import { test } from "node:test";
import { handleOf, nearest, pieceAt, placed, polyline } from "../../../src/eclsim/app/web/lib/geometry.js";

const PATH = [
  [10, 0],
  [10, 20],
  [40, 20],
];

test("a path is written for SVG", () => {
  assert.equal(polyline(PATH), "10,0 10,20 40,20");
});

test("the piece that a symbol stands on is found", () => {
  assert.deepEqual(pieceAt(PATH, [25, 20]), [PATH[1], PATH[2]]);
  assert.deepEqual(pieceAt(PATH, [10, 5]), [PATH[0], PATH[1]]);
});

test("a symbol points along the flow, a cannula to the patient", () => {
  const wire = { path: PATH, at: [25, 20], symbol: "tube" };
  assert.equal(placed(wire), "translate(25 20) rotate(0)");
  assert.equal(placed({ ...wire, at: [10, 5] }), "translate(10 5) rotate(90)");
  assert.equal(placed({ ...wire, symbol: "cannula" }), "translate(25 20) rotate(90)");
  assert.equal(placed(wire, -0.5), "translate(25 20) rotate(180)");
  assert.equal(
    placed({ ...wire, symbol: "pump" }, -0.5),
    "translate(25 20) rotate(0)",
    "a pump stays as it is built",
  );
});

test("the handle stands beside the site, whichever way the line flows", () => {
  const expected = [10, 2.6];
  assert.deepEqual(handleOf({ path: PATH, end: [10, 0] }), expected);
  assert.deepEqual(handleOf({ path: PATH.toReversed(), end: [10, 0] }), expected);
});

test("a line is dropped on the nearest position within reach, or on none", () => {
  const boxes = [
    { name: "left", x: 0, y: 0, w: 20, h: 10 },
    { name: "right", x: 40, y: 0, w: 20, h: 10 },
  ];
  assert.equal(nearest(boxes, 10, 5), "left");
  assert.equal(nearest(boxes, 35, 15), "right");
  assert.equal(nearest(boxes, 30, 60), null);
});
