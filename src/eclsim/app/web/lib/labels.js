// Widths of texts, and placement of the labels of limits in a chart, so that they overlap no curve, line or
// other label.
export const FONT = 'system-ui, "Segoe UI", Roboto, sans-serif';
const LABEL_HEIGHT = 13; // px
const STEPS = 40; // positions along a line that are tried, from the right
const SAMPLES = 12; // points of a curve checked along a label

// Width [px] of a text in a font as CSS has it.
let pen;
export function textWidth(text, font) {
  pen ??= document.createElement("canvas").getContext("2d");
  pen.font = font;
  return pen.measureText(text).width;
}

const meet = (a, b) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;

// Value of a curve at a position, interpolated between its points; NaN in a gap.
function valueAtPlace(xs, ys, x) {
  const right = xs.findIndex((place) => place >= x);
  if (right < 0) return NaN;
  if (right === 0) return x < xs[0] ? NaN : (ys[0] ?? NaN);
  const [a, b] = [ys[right - 1] ?? NaN, ys[right] ?? NaN];
  return a + ((x - xs[right - 1]) / (xs[right] - xs[right - 1])) * (b - a);
}

// Whether a curve runs through a rectangle of the panel.
function crosses(curve, box, { xs, x, y }) {
  const [low, high] = x;
  let before = NaN;
  for (let k = 0; k <= SAMPLES; k += 1) {
    const at = low + (box.left + (k / SAMPLES) * (box.right - box.left)) * (high - low);
    const now = y(valueAtPlace(xs, curve, at));
    const ends = [before, now].filter(Number.isFinite);
    if (ends.length && Math.max(...ends) > box.top && Math.min(...ends) < box.bottom) return true;
    before = now;
  }
  return false;
}

// For each label { value, wide [px] } of a line across the panel: its left end (share of the width), whether
// it stands above its line, and how much it could not avoid.
// panel: xs of the curves, curves, upright lines (places on x), x and y range, width and height [px].
export function placeLabels(labels, { xs, curves, upright, xRange, yRange, width, height }) {
  const [low, high] = yRange;
  const y = (value) => height * (1 - (value - low) / (high - low));
  const placed = [];
  return labels.map(({ value, wide: px }) => {
    const wide = Math.min((px + 4) / width, 1);
    let best;
    for (let k = 0; k <= STEPS; k += 1) {
      const left = (1 - wide) * (1 - k / STEPS);
      for (const above of [true, false]) {
        const line = y(value);
        const [top, bottom] = above
          ? [line - LABEL_HEIGHT - 2, line - 1]
          : [line + 1, line + LABEL_HEIGHT + 2];
        const box = { left, right: left + wide, top, bottom };
        const share = (place) => (place - xRange[0]) / (xRange[1] - xRange[0]);
        const hits = [
          ...curves.map((curve) => crosses(curve, box, { xs, x: xRange, y })),
          ...upright.map((place) => share(place) > box.left && share(place) < box.right),
          ...labels.map((other) => other.value !== value && y(other.value) > top && y(other.value) < bottom),
          ...placed.map((other) => meet(box, other)),
          top < 0 || bottom > height,
        ].filter(Boolean).length;
        if (!best || hits < best.hits) best = { box, left, above, hits };
      }
    }
    placed.push(best.box);
    return { left: best.left, above: best.above, hits: best.hits };
  });
}
