// Time in a course: clock texts, position of a time, and interpolation between moments.
import { GRAVEST } from "./format.js";

// Hours and minutes, such as 03:12, or 00:03:12 with seconds; preceded by days if any.
export function clock(minute, seconds = false) {
  const all = Math.floor(60 * minute + 1e-3);
  const whole = Math.floor(all / 60);
  const [day, hour, rest] = [Math.floor(whole / 1440), Math.floor(whole / 60) % 24, whole % 60];
  const pad = (number) => String(number).padStart(2, "0");
  const end = seconds ? `:${pad(all % 60)}` : "";
  return `${day ? `${day} d ` : ""}${pad(hour)}:${pad(rest)}${end}`;
}

// Clock time of a beat; empty for the start.
export const timeOf = (beat) => (beat?.minute ? clock(beat.minute, beat.transient) : "");

// Minute after some milliseconds of play, never beyond the end and never back: the time of a frame may be
// before the press of Play, and an alarm that Play stopped at would be met again.
export const playedTo = (minute, ms, speed, end) =>
  Math.min(minute + (Math.max(ms, 0) / 60_000) * speed, end);

// The first moment of a course at which an alarm is seen: between two moments its beginning is an estimate.
export const seenAt = ({ at_min: at }, times) => times.find((time) => time >= at - 1e-9) ?? times.at(-1);

// The first alarms after one minute and not later than another, and when; warnings do not count.
export function alarmsBetween(alarms, times, from, to) {
  const grave = alarms.filter(({ kind }) => kind === "alarm" || kind === "collapse");
  const minute = Math.min(...grave.map((one) => seenAt(one, times)).filter((at) => at > from + 1e-6));
  return minute <= to ? { minute, alarms: grave.filter((one) => seenAt(one, times) === minute) } : null;
}

// Subject of an alarm of a course, without its times and its reason.
const TIMES = /(^| )at (\d+ d )?[\d:]+\d(, until (\d+ d )?[\d:]+\d)?( \([^)]*\))?/;
export const briefly = ({ sentence }) => sentence.replace(TIMES, "").replace(/^: /, "").split(": ")[0];

// Position of the last moment at or before a time; -1 before the first.
export function momentAt(times, minute) {
  let [low, high] = [-1, times.length - 1];
  while (low < high) {
    const middle = Math.floor((low + high + 1) / 2);
    if (times[middle] <= minute + 1e-9) low = middle;
    else high = middle - 1;
  }
  return low;
}

// Value at a time by linear interpolation between moments; undefined beyond the ends.
export function valueIn(times, values, minute) {
  const left = momentAt(times, minute);
  if (left < 0 || minute > times.at(-1) + 1e-9) return undefined;
  const right = Math.min(left + 1, times.length - 1);
  const width = times[right] - times[left];
  const [a, b] = [values[left], values[right]];
  if (a === null || b === null) return a ?? undefined;
  return width > 0 ? a + ((minute - times[left]) / width) * (b - a) : a;
}

// Points of a curve in a lane: minutes to 0..width, values to height..0; gaps where there is no value.
export function curvePath(times, values, { end, width, height, low, high }) {
  let pen = "M";
  const parts = [];
  times.forEach((time, k) => {
    if (values[k] === null) {
      pen = "M";
      return;
    }
    const x = (time / end) * width;
    const y = height - ((values[k] - low) / (high - low)) * height;
    parts.push(`${pen}${x.toFixed(1)} ${y.toFixed(1)}`);
    pen = "L";
  });
  return parts.join("");
}

// Intervals in which limits of a lane are exceeded, on 0..width; the most serious last, to be drawn on top.
export function brokenSpans(alarms, { last, end, width }) {
  const x = (minute) => (minute / end) * width;
  return alarms
    .filter(({ kind }) => GRAVEST.includes(kind))
    .toSorted((a, b) => GRAVEST.indexOf(b.kind) - GRAVEST.indexOf(a.kind))
    .map(({ at_min: from, until_min: until, kind }) => ({
      kind,
      from: x(from),
      width: Math.max(x(until ?? last) - x(from), 2),
    }));
}
