// What all views share: messages from the server, number formats, colours, and the measured latency.
const listeners = new Map();
const last = new Map();

export const bus = {
  publish(topic, data) {
    last.set(topic, data);
    for (const f of listeners.get(topic) ?? []) f(data);
  },
  // Calls f with every message of a topic, the last one at once; returns how to stop that.
  on(topic, f) {
    if (!listeners.has(topic)) listeners.set(topic, new Set());
    listeners.get(topic).add(f);
    if (last.has(topic)) f(last.get(topic));
    return () => listeners.get(topic).delete(f);
  },
  last: (topic) => last.get(topic),
};

// The bands of the posterior that belong to a beat or a ramp, if they are there.
export function bandsOf(shown, topic = "bands") {
  const found = last.get(topic);
  return found?.count && shown && found.of === shown.of ? found : undefined;
}

// What this tab keeps in its browser until it is closed; nothing where storage is blocked.
export const tab = {
  read(name) {
    try {
      return JSON.parse(sessionStorage.getItem("eclsim-" + name) ?? "null");
    } catch {
      return null;
    }
  },
  keep(name, data) {
    try {
      sessionStorage.setItem("eclsim-" + name, JSON.stringify(data));
    } catch {
      // a full or blocked storage: the page goes on without
    }
  },
};

export let words = {};
export function setWords(found) {
  words = found;
}

export const MINUS = "\u2212";
export function fixed(value, digits) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const shown = value.toFixed(digits);
  return Number(shown) === 0 ? shown.replace("-", "") : shown.replace("-", MINUS);
}
export function compact(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 0.001 || size >= 1e6)) return value.toExponential(2).replace("-", MINUS);
  return fixed(value, size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3);
}

// A colour of the style sheet, light or dark as the reader prefers.
export const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
export const dark = window.matchMedia("(prefers-color-scheme: dark)");
// Curves on a light and on a dark ground, and dashes: no two alike in either.
const CURVES = [
  ["#17202a", "#e6ebf0", "solid"], ["#c24f00", "#ff9a5c", "dash"], ["#0072b2", "#6cb8ea", "dot"], ["#007a5a", "#3bd3a5", "dashdot"], ["#9a4a80", "#e29cca", "longdash"],
  ["#8a5300", "#f0b040", "longdashdot"], ["#6f4a9b", "#bfa0ee", "12px,3px,2px,3px,2px,3px"], ["#4d6b00", "#b5d334", "16px,3px"], ["#00708a", "#58cfe6", "6px,5px"], ["#b0006a", "#ff7ab8", "2px,6px"],
];
export const stroke = (k) => {
  const [light, pale, dash] = CURVES[k % CURVES.length];
  return { colour: dark.matches ? pale : light, dash };
};
// The dash of an SVG line that looks like that of a chart.
export const svgDash = (dash) => ({ solid: "", dash: "9 9", dot: "3 3", dashdot: "9 3 3 3", longdash: "15 6", longdashdot: "15 4 3 4" })[dash] ?? dash.replaceAll("px", "").replaceAll(",", " ");

// From the turn of a knob to the repainted page.
export const latency = {
  sent: new Map(),
  found: [],
  start(seq) {
    this.sent.set(seq, performance.now());
  },
  drawn(seq) {
    for (const [one, since] of this.sent) {
      if (one > seq) continue;
      if (one === seq) {
        requestAnimationFrame(() => {
          this.found.push(performance.now() - since);
          if (this.found.length > 2000) this.found.splice(0, 1000);
        });
      }
      this.sent.delete(one);
    }
  },
};

export function ticks(low, high, wanted = 4) {
  const raw = (high - low) / wanted;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].map((m) => m * power).find((s) => s >= raw);
  const found = [];
  for (let t = Math.ceil(low / step - 1e-9) * step; t <= high + 1e-9 * step; t += step) found.push(t);
  return found;
}

// A range with round ends around values; keeps the old one while it fits, so that scales do not jump.
export function niceRange(low, high, old) {
  if (!(high > low)) [low, high] = [low - 0.5, high + 0.5];
  if (old && low >= old[0] && high <= old[1] && high - low > 0.35 * (old[1] - old[0])) return old;
  const pad = 0.08 * (high - low);
  const all = ticks(low - pad, high + pad, 4);
  const step = all.length > 1 ? all[1] - all[0] : 1;
  const bottom = low >= 0 && low - pad < 0 ? 0 : Math.floor((low - pad) / step) * step;
  return [bottom, Math.ceil((high + pad) / step) * step];
}

window.eclsim = { bus, latency };
