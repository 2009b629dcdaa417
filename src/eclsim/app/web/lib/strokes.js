// Colours and dashes of curves on light and dark backgrounds; curves of the same colour differ in their dash.
// The flows of a ramp (numbers 4, 5, 9, of second devices 10 and 14) look unlike, also to the colour-blind.
const CURVES = [
  ["#17202a", "#e6ebf0", "solid"],
  ["#c24f00", "#ff9a5c", "dash"],
  ["#0072b2", "#6cb8ea", "dot"],
  ["#007a5a", "#3bd3a5", "dashdot"],
  ["#b0006a", "#ff7ab8", "longdash"],
  ["#6f4a9b", "#bfa0ee", "longdashdot"],
  ["#00708a", "#58cfe6", "12px,3px,2px,3px,2px,3px"],
  ["#4d6b00", "#b5d334", "16px,3px"],
  ["#9a4a80", "#e29cca", "6px,5px"],
  ["#8a5300", "#f0b040", "2px,6px"],
];

export function strokeOf(number, dark) {
  const round = Math.floor(number / CURVES.length);
  const [onLight, onDark] = CURVES[(number + 6 * round) % CURVES.length];
  const [, , dash] = CURVES[(number + 3 * round) % CURVES.length];
  return { colour: dark ? onDark : onLight, dash };
}

const SVG_DASHES = {
  solid: "",
  dash: "9 9",
  dot: "3 3",
  dashdot: "9 3 3 3",
  longdash: "15 6",
  longdashdot: "15 4 3 4",
};

// The dash of an SVG line that looks like that of a chart.
export const svgDash = (dash) => SVG_DASHES[dash] ?? dash.replaceAll("px", "").replaceAll(",", " ");
