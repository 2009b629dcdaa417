// Scales of axes, traces and sliders.

// Round values between two numbers, about `count` of them.
export function ticks(low, high, count = 4) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].map((factor) => factor * power).find((size) => size >= raw);
  const places = [];
  for (let t = Math.ceil(low / step - 1e-9) * step + 0; t <= high + 1e-9 * step; t += step) places.push(t);
  return places;
}

// A range with round ends around values; the old one while it fits, so that scales do not jump.
export function niceRange(low, high, old) {
  if (!(high > low)) [low, high] = [low - 0.5, high + 0.5];
  if (old && low >= old[0] && high <= old[1] && high - low > 0.35 * (old[1] - old[0])) return old;
  const margin = 0.08 * (high - low);
  const places = ticks(low - margin, high + margin, 4);
  const step = places.length > 1 ? places[1] - places[0] : 1;
  const bottom = low >= 0 && low - margin < 0 ? 0 : Math.floor((low - margin) / step) * step;
  return [bottom, Math.ceil((high + margin) / step) * step];
}

// The scale of a lane with its values, of at least that height; shares in percent end at 100.
export function laneRange(values, unit, least = 0) {
  const [low, high] = niceRange(...(extent(values, least) ?? [0, 1]));
  return unit === "%" && extent(values)?.[1] <= 100 ? [low, Math.min(high, 100)] : [low, high];
}

// The first of some fixed scales that holds all values; the last one doubled until it does.
export function fixedRange(scales, low, high) {
  const holding = scales.find(([bottom, top]) => low >= bottom && high <= top);
  if (holding) return holding;
  let [bottom, top] = scales.at(-1);
  while (low < bottom || high > top) {
    const lower = low < bottom ? Math.min(2 * bottom, -top) : bottom;
    [bottom, top] = [lower, high > top ? 2 * top : top];
  }
  return [bottom, top];
}

// Lowest and highest of the finite values, as far apart as `least` at least.
export function extent(values, least = 0) {
  const finite = values.filter(Number.isFinite);
  if (!finite.length) return undefined;
  const [low, high] = [Math.min(...finite), Math.max(...finite)];
  const missing = 0.5 * Math.max(least - (high - low), 0);
  return [low - missing, high + missing];
}

// Position of a value between two bounds, from 0 to 1: on a logarithmic scale if both are positive.
export const logShare = (value, [low, high]) => {
  const share = low > 0 ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  return Math.min(Math.max(share, 0), 1);
};

const LOG_POSITIONS = 400;

// A slider has whole positions from 0 to `positions`; a knob is { low, high, step, log }.
export const positions = (knob) =>
  knob.log ? LOG_POSITIONS : Math.max(1, Math.round((knob.high - knob.low) / knob.step));

export function positionOf(knob, value) {
  const { low, high, log } = knob;
  const held = Math.min(Math.max(value, low), high);
  const share = log ? Math.log(held / low) / Math.log(high / low) : (held - low) / (high - low);
  return Math.round(share * positions(knob));
}

export function valueAt(knob, position) {
  const { low, high, step, log } = knob;
  const share = position / positions(knob);
  if (log) return Number((low * (high / low) ** share).toPrecision(3));
  return Number((Math.round((low + share * (high - low)) / step) * step).toPrecision(10));
}
