// Numbers and limits as text.
export const MINUS = "\u2212";
export const MISSING = "–";
// Signs of how a number stands to its limits, the gravest kind first.
export const GRAVEST = ["collapse", "alarm", "warning"];
export const SIGNS = { ok: "", warning: "! ", alarm: "▲ ", collapse: "✕ " };

const isMissing = (value) => value === null || value === undefined || !Number.isFinite(value);

// A number with so many decimals; a typographic minus, and none before zero.
export function fixed(value, digits) {
  if (isMissing(value)) return MISSING;
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", MINUS);
}

// A number with about three significant digits. Below one in 100 000 there is nothing but what a search left.
export function compact(value) {
  if (isMissing(value)) return MISSING;
  const size = Math.abs(value);
  if (size >= 1e6 || (size < 0.001 && size >= 1e-5)) return value.toExponential(2).replaceAll("-", MINUS);
  return fixed(value, size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3);
}

// A change with its sign; "0" where it is less than a thousandth of the value.
export function change(value, before) {
  if (isMissing(value) || isMissing(before)) return "";
  const difference = value - before;
  if (Math.abs(difference) < 1e-3 * Math.max(Math.abs(value), 0.01)) return "0";
  return (difference > 0 ? "+" : "") + compact(difference);
}

// What is said above something that is computed for the start of a course alone.
export const laterThanStart = (texts, shown, pinned) =>
  [
    [texts.of_start, shown],
    [texts.pinned_later, pinned],
  ]
    .filter(([, time]) => time)
    .map(([text, time]) => fill(text, { time }));

// Whether the numbers of a beat, or of something computed from one, mean anything in a patient.
export const isPossible = (beat) => beat?.possible !== false;

// The draws of a posterior that are not in its bands, and why.
export const leftOut = (texts, { lost, impossible }) =>
  [
    [texts.bands_lost, lost],
    [texts.bands_impossible, impossible],
  ]
    .filter(([, count]) => count)
    .map(([text, count]) => fill(text, { count }))
    .join(", ");

// Some of an ordered list of speeds as text: "1000, 3000–5000" where neighbours are among them.
export function speedsText(some, all) {
  const runs = [];
  for (const speed of some) {
    const run = runs.at(-1);
    if (run && all.indexOf(run.at(-1)) + 1 === all.indexOf(speed)) run.push(speed);
    else runs.push([speed]);
  }
  const ends = (run) => (run.length > 1 ? [run[0], run.at(-1)] : run).map((speed) => fixed(speed, 0));
  return runs.map((run) => ends(run).join("–")).join(", ");
}

// A difference with its sign, and none before zero.
export function signed(value, digits) {
  const text = fixed(value, digits);
  return Number(text) === 0 || value < 0 || isMissing(value) ? text : `+${text}`;
}

// Which limits are broken, and how gravely, whatever the numbers are.
export const limitsOf = (notes) =>
  notes.map(([kind, text]) => kind + text.replace(/[\d.\u2212-]+/g, "#")).join();

// The gravest of the levels of some outputs.
export const gravest = (levels, outputs) =>
  GRAVEST.find((kind) => outputs.some((name) => levels[name] === kind)) ?? "ok";

// A number with all its digits, as a limit or a setting is given: 7.65 is neither 8 nor 7.7.
export const exact = (value) => (isMissing(value) ? MISSING : String(value).replaceAll("-", MINUS));

// Settings of a knob side by side: four digits as beside it, all where these do not tell them apart.
export function settingsText(values) {
  const written = (digits) =>
    values.map((v) => (typeof v === "number" ? exact(Number(v.toPrecision(digits))) : (v ?? MISSING)));
  const count = (some) => new Set(some).size;
  return count(written(4)) === count(values) ? written(4) : written(15);
}

// "! < 65, > 107" and below it "▲ < 55, > 133": what lies beyond a bound has the sign.
export function limitLines(limits) {
  const bounds = (kind) =>
    limits
      .filter((limit) => limit.kind === kind)
      .map((limit) => `${limit.side === "below" ? "<" : ">"} ${exact(limit.value)}`);
  const kinds = GRAVEST.toReversed().filter((kind) => bounds(kind).length);
  return kinds.map((kind) => SIGNS[kind] + bounds(kind).join(", ")).join("\n");
}

// A sentence with named gaps: fill("{a} of {b}", { a: 1, b: 2 }).
export const fill = (text, values) =>
  Object.entries(values).reduce((filled, [name, value]) => filled.replace(`{${name}}`, () => value), text);
