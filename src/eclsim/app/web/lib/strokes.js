// Colours and dashes of curves on light and dark backgrounds; curves of the same colour differ in their dash.
const CURVES = [
  ["#17202a", "#e6ebf0", "solid"],
  ["#c24f00", "#ff9a5c", "dash"],
  ["#0072b2", "#6cb8ea", "dot"],
  ["#007a5a", "#3bd3a5", "dashdot"],
  ["#9a4a80", "#e29cca", "longdash"],
  ["#8a5300", "#f0b040", "longdashdot"],
  ["#6f4a9b", "#bfa0ee", "12px,3px,2px,3px,2px,3px"],
  ["#4d6b00", "#b5d334", "16px,3px"],
  ["#00708a", "#58cfe6", "6px,5px"],
  ["#b0006a", "#ff7ab8", "2px,6px"],
];

export function strokeOf(number, dark) {
  const [onLight, onDark] = CURVES[number % CURVES.length];
  const [, , dash] = CURVES[(number + 3 * Math.floor(number / CURVES.length)) % CURVES.length];
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
