// Numbers and limits as text.
export const MINUS = "\u2212";
export const MISSING = "–";
// Signs for exceeded limits, the most serious kind first.
export const GRAVEST = ["collapse", "alarm", "warning"];
export const SIGNS = { ok: "", warning: "! ", alarm: "▲ ", collapse: "✕ " };

const isMissing = (value) => value === null || value === undefined || !Number.isFinite(value);

// A number in another unit; a missing one stays missing, where null * 60 would be a flow of 0.
export const scaled = (value, factor) => (isMissing(value) ? NaN : value * factor);

// A number with a given number of decimals, a typographic minus, and no minus before zero.
export function fixed(value, digits) {
  if (isMissing(value)) return MISSING;
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", MINUS);
}

// A number with about three significant digits; values below 1e-5 are residuals of a search and shown as 0.
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

// Text above results that are computed only for the start of a course.
export const laterThanStart = (texts, shown, pinned) =>
  [
    [texts.of_start, shown],
    [texts.pinned_later, pinned],
  ]
    .filter(([, time]) => time)
    .map(([text, time]) => fill(text, { time }));

// Whether the numbers of a beat, or of results computed from it, are possible in a patient.
export const isPossible = (beat) => beat?.possible !== false;

// Sign before a number that depends on where its computation started, since closed valves trap blood.
export const UNDETERMINED = "≈";
export const isUndetermined = (beat, names) => names.some((name) => !!beat?.undetermined?.includes(name));
export const aboutSign = (beat, ...names) => (isUndetermined(beat, names) ? UNDETERMINED : "");

// What is to be known of reading some outputs of a beat, each sentence once; and the sign before their label.
export const CARE = "†";
export const careOf = (beat, names) =>
  [...new Set(names.map((name) => beat?.cautions?.[name]).filter(Boolean))].join("; ");

// A list of names, of which the first are written and the others counted by a text.
export function fewOf(names, most, more) {
  const left = names.length - most;
  return (left > 1 ? [...names.slice(0, most), fill(more, { count: left })] : names).join(", ");
}

// Key of the text on a steady beat that is not the only one at its settings; empty for any other.
export function doubtOf(beat) {
  if (beat?.undetermined?.length) return "undetermined";
  return beat?.second ? "one_of_two" : "";
}

// Numbers of posterior draws that are not in its bands, and the reasons; empty if there are none.
export function leftOut(texts, { lost, impossible }, withGases) {
  const draws = [
    [withGases ? texts.bands_lost_gases : texts.bands_lost, lost],
    [texts.bands_impossible, impossible],
  ]
    .filter(([, count]) => count)
    .map(([text, count]) => fill(text, { count }))
    .join(", ");
  return draws && fill(texts.bands_left_out, { draws });
}

// Selected speeds of an ordered list as text, with ranges for neighbours: "1000, 3000–5000".
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

// A difference with its sign; zero has none.
export function signed(value, digits) {
  const text = fixed(value, digits);
  return Number(text) === 0 || value < 0 || isMissing(value) ? text : `+${text}`;
}

// Exceeded limits and their levels, without their numbers.
export const limitsOf = (notes) =>
  notes.map(([kind, text]) => kind + text.replace(/[\d.\u2212-]+/g, "#")).join();

// Limits of some kinds that a beat exceeds: each with its name and its limit, or in few words.
const listed = (beat, kinds, words) =>
  beat.notes.flatMap(([kind, text], k) => (kinds.includes(kind) ? [words(text, k)] : [])).join("; ");
export const subjects = (beat, kinds) => listed(beat, kinds, (text) => text.split(": ")[0]);
export const briefs = (beat, kinds) => listed(beat, kinds, (_, k) => beat.brief[k]);

// The most serious of the levels of some outputs.
export const gravest = (levels, outputs) =>
  GRAVEST.find((kind) => outputs.some((name) => levels[name] === kind)) ?? "ok";

// A number with all its digits, as for a limit or a setting: 7.65, not 8 or 7.7.
export const exact = (value) => (isMissing(value) ? MISSING : String(value).replaceAll("-", MINUS));

// Values of a setting side by side: four digits, or all digits if four do not distinguish them.
export function settingsText(values) {
  const written = (digits) =>
    values.map((v) => (typeof v === "number" ? exact(Number(v.toPrecision(digits))) : (v ?? MISSING)));
  const count = (some) => new Set(some).size;
  return count(written(4)) === count(values) ? written(4) : written(15);
}

// "! < 65, > 107" and below it "▲ < 55, > 133": values beyond a bound get its sign.
export function limitLines(limits) {
  const bounds = (kind) =>
    limits
      .filter((limit) => limit.kind === kind)
      .map((limit) => `${limit.side === "below" ? "<" : ">"} ${exact(limit.value)}`);
  const kinds = GRAVEST.toReversed().filter((kind) => bounds(kind).length);
  return kinds.map((kind) => SIGNS[kind] + bounds(kind).join(", ")).join("\n");
}

// Fill a sentence with named placeholders: fill("{a} of {b}", { a: 1, b: 2 }).
export const fill = (text, values) =>
  Object.entries(values).reduce((filled, [name, value]) => filled.replace(`{${name}}`, () => value), text);
