// Names of limits in a chart lie on nothing that is drawn there.
import assert from "node:assert/strict";
import { test } from "node:test";
import { placeLabels } from "../../../src/eclsim/app/web/lib/labels.js";

const xs = [0, 25, 50, 75, 100];
const panel = {
  xs,
  xRange: [0, 100],
  yRange: [-200, 600],
  width: 420,
  height: 160,
  upright: [60],
  curves: [],
};

test("a name stands at the right end above its line where nothing is in the way", () => {
  const [place] = placeLabels([{ value: 100, wide: 60 }], panel);
  assert.equal(place.above, true);
  assert.equal(place.hits, 0);
  assert.ok(place.left > 0.8 && place.left < 1);
});

test("it gives way to a curve, also to one that is steep or has a gap", () => {
  const label = { value: 350, wide: 105 };
  for (const curve of [
    [0, 100, 200, 300, 400],
    [-200, -200, -200, 600, -200],
    [0, null, 200, 360, 380],
  ]) {
    const [place] = placeLabels([label], { ...panel, curves: [curve] });
    assert.equal(place.hits, 0, JSON.stringify(curve));
    const wide = label.wide / panel.width;
    const px = (value) => panel.height * (1 - (value + 200) / 800);
    const [top, bottom] = place.above ? [px(350) - 15, px(350) - 1] : [px(350) + 1, px(350) + 15];
    for (let share = place.left; share <= place.left + wide; share += 0.002) {
      const k = Math.min(Math.floor(share * 4), 3);
      const [a, b] = [curve[k], curve[k + 1]];
      if (a === null || b === null) continue;
      const y = px(a + (share * 4 - k) * (b - a));
      assert.ok(y <= top || y >= bottom, `${share}: ${y} in ${top} to ${bottom}`);
    }
  }
});

test("names of neighbouring limits do not lie on each other or on the speed that is set", () => {
  const labels = [290, 190, 60, -50].map((value) => ({ value, wide: 100 }));
  const places = placeLabels(labels, { ...panel, curves: [[0, 50, 100, 150, 330]] });
  assert.deepEqual(
    places.map(({ hits }) => hits),
    [0, 0, 0, 0],
  );
  for (const { left } of places) assert.ok(left > 0.6 || left + 100 / 420 < 0.6);
});

test("where there is no free place the least bad one is taken", () => {
  const walls = [590, 400, 200, 0, -190].map((value) => xs.map(() => value));
  const crowd = { ...panel, height: 40, curves: walls };
  const [place] = placeLabels([{ value: 200, wide: 60 }], crowd);
  assert.ok(place.hits > 0);
  assert.ok(place.left >= 0 && place.left <= 1);
});
