// Geometry of the schematic [mm, y downwards].
const DROP_DISTANCE = 14; // distance from a position within which a dropped line is attached to it
const HANDLE_DISTANCE = 2.6; // from the end of a line to its round handle

export const polyline = (path) => path.map((point) => point.join(",")).join(" ");

// Segment of a path on which a symbol is placed.
export function pieceAt(path, at) {
  for (let k = 1; k < path.length; k += 1) {
    const [a, b] = [path[k - 1], path[k]];
    const within = (i) => at[i] >= Math.min(a[i], b[i]) - 0.1 && at[i] <= Math.max(a[i], b[i]) + 0.1;
    if (within(0) && within(1)) return [a, b];
  }
  return path.slice(0, 2);
}

// Position and rotation of a line's symbol: arrows of tubes along the flow; tips of cannulae towards
// the patient.
export function placed({ path, more, at, symbol }, flow = 0) {
  const [a, b] = more ? more.slice(0, 2) : pieceAt(path, at);
  const angle = (Math.atan2(b[1] - a[1], b[0] - a[0]) * 180) / Math.PI;
  const turned = symbol === "tube" && flow < 0 ? angle + 180 : angle;
  return `translate(${at[0]} ${at[1]}) rotate(${symbol === "cannula" ? 90 : turned})`;
}

// Position of a line's handle: at a short distance from the site at its end.
export function handleOf({ path, end }) {
  const fromSite = path[0][0] === end[0] && path[0][1] === end[1] ? path : path.toReversed();
  const [[x0, y0], [x1, y1]] = fromSite;
  return [end[0] + HANDLE_DISTANCE * Math.sign(x1 - x0), end[1] + HANDLE_DISTANCE * Math.sign(y1 - y0)];
}

const outside = (at, middle, size) => Math.max(Math.abs(at - middle) - size / 2, 0);

// The box nearest to a point, if it is close enough.
export function nearest(boxes, x, y) {
  let best = { name: null, distance: DROP_DISTANCE };
  for (const { name, ...box } of boxes) {
    const distance = Math.hypot(outside(x, box.x + box.w / 2, box.w), outside(y, box.y + box.h / 2, box.h));
    if (distance < best.distance) best = { name, distance };
  }
  return best.name;
}
