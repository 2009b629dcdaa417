// Messages between server and views, the measured latency, links, and what a tab keeps.
import assert from "node:assert/strict";
import { test } from "node:test";
import { bandsFor, makeBus, makeLatency } from "../../../src/eclsim/app/web/lib/bus.js";
import { addressOf, linkIn, makeTabStorage, remember } from "../../../src/eclsim/app/web/lib/links.js";
import { strokeOf, svgDash } from "../../../src/eclsim/app/web/lib/strokes.js";

test("whoever listens late hears the last message, and none after stopping", () => {
  const bus = makeBus();
  const heard = [];
  bus.publish("beat", 1);
  bus.publish("beat", 2);
  const stop = bus.on("beat", (data) => heard.push(data));
  bus.publish("beat", 3);
  stop();
  bus.publish("beat", 4);
  assert.deepEqual(heard, [2, 3]);
  assert.equal(bus.last("beat"), 4);
  assert.equal(bus.last("unknown"), undefined);
});

test("bands of another beat are not shown", () => {
  const bands = { count: 48, of: "a" };
  assert.equal(bandsFor(bands, { of: "a" }), bands);
  assert.equal(bandsFor(bands, { of: "b" }), undefined);
  assert.equal(bandsFor({ of: "a" }, { of: "a" }), undefined);
  assert.equal(bandsFor(bands, { of: "a", minute: 30 }), undefined, "they are of the start of a course");
  assert.equal(bandsFor(undefined, { of: "a" }), undefined);
});

test("latency runs from the turn to the frame after its beat; overtaken turns have none", () => {
  let now = 0;
  const frames = [];
  const latency = makeLatency(
    () => now,
    (draw) => frames.push(draw),
  );
  latency.start(1);
  now = 10;
  latency.start(2);
  now = 30;
  latency.drawn(2);
  now = 46;
  for (const draw of frames) draw();
  latency.drawn(2);
  assert.deepEqual(latency.times, [36]);
});

test("a link is what stands behind #, cut where it is too long", () => {
  assert.equal(linkIn("#abc"), "abc");
  assert.equal(linkIn(""), "");
  assert.equal(linkIn(`#${"a".repeat(20_000)}`).length, 8999);
  assert.equal(addressOf({ origin: "http://a", pathname: "/bed/" }, "x"), "http://a/bed/#x");
});

test("a tab keeps the newest entries", () => {
  const entries = { a: 1, b: 2, c: 3 };
  assert.deepEqual(remember(entries, "d", 4, 3), { b: 2, c: 3, d: 4 });
  assert.deepEqual(remember(entries, "a", 9, 3), { b: 2, c: 3, a: 9 });
  assert.deepEqual(remember(entries, "b", undefined, 3), { a: 1, c: 3 });
});

test("blocked or damaged storage keeps nothing and breaks nothing", () => {
  const blocked = makeTabStorage(() => {
    throw new Error("blocked");
  });
  blocked.keep("x", 1);
  assert.equal(blocked.read("x"), null);
  const data = new Map([["eclsim-x", "{"]]);
  const storage = makeTabStorage(() => ({
    getItem: (k) => data.get(k) ?? null,
    setItem: (k, v) => data.set(k, v),
  }));
  assert.equal(storage.read("x"), null);
  storage.keep("y", [1]);
  assert.deepEqual(storage.read("y"), [1]);
});

test("a tab that is signed out forgets its patient and stores nothing more", () => {
  const data = new Map([
    ["eclsim-tab", "1"],
    ["other", "2"],
    ["eclsim-last", "3"],
  ]);
  const storage = makeTabStorage(() => ({
    getItem: (k) => data.get(k) ?? null,
    setItem: (k, v) => data.set(k, v),
    removeItem: (k) => data.delete(k),
    key: (k) => [...data.keys()][k],
    get length() {
      return data.size;
    },
  }));
  storage.forget();
  storage.keep("tab", [1]);
  assert.deepEqual([...data.keys()], ["other"]);
  makeTabStorage(() => {
    throw new Error("blocked");
  }).forget();
});

test("no two curves have the same colour or dash", () => {
  const all = Array.from({ length: 10 }, (_, k) => [strokeOf(k, false), strokeOf(k, true)]);
  assert.equal(new Set(all.map(([light]) => light.colour)).size, 10);
  assert.equal(new Set(all.map(([, dark]) => dark.colour)).size, 10);
  assert.equal(new Set(all.map(([light]) => light.dash)).size, 10);
  assert.equal(svgDash("12px,3px"), "12 3");
  const more = Array.from({ length: 40 }, (_, k) => Object.values(strokeOf(k, false)).join());
  assert.equal(new Set(more).size, 40); // RVAD flow was drawn as arterial pressure, a second ECMO's flow as PA
});

// Vision in linear RGB: normal, without red cones, without green ones (Machado et al. 2009).
const VISIONS = [
  [1, 0, 0, 0, 1, 0, 0, 0, 1],
  [0.152, 1.053, -0.205, 0.115, 0.786, 0.099, -0.004, -0.048, 1.052],
  [0.367, 0.861, -0.228, 0.28, 0.673, 0.047, -0.012, 0.043, 0.969],
];
const SRGB_TO_XYZ = [0.4339, 0.376, 0.19, 0.213, 0.715, 0.072, 0.018, 0.109, 0.873]; // white is 1, 1, 1
const times = (matrix, v) => [0, 3, 6].map((r) => v.reduce((sum, x, k) => sum + matrix[r + k] * x, 0));
const lab = (colour, vision) => {
  const bytes = [1, 3, 5].map((k) => Number.parseInt(colour.slice(k, k + 2), 16) / 255);
  const light = times(
    vision,
    bytes.map((b) => ((b + 0.055) / 1.055) ** 2.4),
  );
  const xyz = times(
    SRGB_TO_XYZ,
    light.map((c) => Math.max(c, 0)),
  );
  const [x, y, z] = xyz.map(Math.cbrt);
  return [116 * y, 500 * (x - y), 200 * (y - z)];
};
const difference = (one, other, vision) =>
  Math.hypot(...lab(one, vision).map((v, k) => v - lab(other, vision)[k]));

test("flows of a ramp look unlike, also to the colour-blind, with two devices of a kind", () => {
  const flows = [4, 5, 9, 14]; // output of the heart, of two devices, and of a second one of the last
  for (const dark of [false, true]) {
    const drawn = flows.map((number) => strokeOf(number, dark));
    assert.equal(new Set(drawn.map(({ dash }) => dash)).size, flows.length);
    for (const [k, { colour }] of drawn.entries())
      for (const other of drawn.slice(k + 1)) {
        const apart = VISIONS.map((vision) => difference(colour, other.colour, vision));
        assert.ok(Math.min(...apart) > 15 && apart[0] > 30, `${colour} and ${other.colour}: ${apart}`);
      }
  }
});
