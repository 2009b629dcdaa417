// What the pump's speed does: pressures, flows, CRRT lines and drainage over the whole range.
import { bandsOf, bus, fixed, ink, stroke, words } from "eclsim-page";
import { Chart, axis, line } from "eclsim-page/chart.js";

// Output, words, panel; the place in the list is the curve's colour and dash.
const CURVES = [
  ["MAP", "key_MAP", 1], ["MPAP", "key_MPAP", 1], ["PCWP", "key_PCWP", 1], ["right_atrial_pressure", "key_CVP", 1],
  ["PF", "ramp_PF", 2], ["lvad_flow", "ramp_lvad", 2], ["CO", "key_CO", 2],
  ["crrt_access_pressure", "ramp_access", 3], ["crrt_return_pressure", "ramp_return", 3], ["drainage_pressure", "ramp_drain", 3],
];
// Where the limits of a curve are labelled: [curve, output with the limits, place along the axis].
const LIMITS = [["crrt_access_pressure", "crrt_access_pressure", "left"], ["crrt_return_pressure", "crrt_return_pressure", "center"], ["drainage_pressure", "lowest_drainage_pressure", "right"]];

export default {
  template: `<div class="ecl-fill"><p v-if="empty" class="ecl-empty">{{ words.ramp_none }}</p><div v-show="!empty" class="ecl-chart" ref="chart" role="group" :aria-label="words.ramp"></div></div>`,
  data: () => ({ words, empty: false }),
  mounted() {
    this.words = words;
    this.chart = new Chart(this.$refs.chart, "ramp");
    this.stops = [
      bus.on("pinned", (beat) => {
        this.pinned = beat;
        if (this.found) this.show(this.found);
      }),
      bus.on("ramp_pinned", () => {
        if (this.found) this.show(this.found);
      }),
      bus.on("ramp_bands", () => {
        if (this.found) this.show(this.found);
      }),
      bus.on("ramp", (found) => this.show(found)),
    ];
  },
  unmounted() {
    this.chart.close();
    for (const stop of this.stops) stop();
  },
  methods: {
    show(found) {
      this.found = found;
      this.empty = !found;
      if (!found) return;
      const kept = bus.last("ramp_pinned");
      const old = kept && kept.of === this.pinned?.of && kept.key === found.key ? kept : undefined;
      const last = found.outputs.crrt_access_pressure || found.outputs.drainage_pressure ? 3 : 2;
      const traces = [];
      const bands = bandsOf(found, "ramp_bands");
      for (const [k, [name, label, panel]] of CURVES.entries()) {
        const { colour, dash } = stroke(k);
        const where = { xaxis: "x", yaxis: panel === 1 ? "y" : "y" + panel, hovertemplate: "%{x:.0f} rpm: %{y:.2f}" };
        const band = bands?.outputs[name];
        if (band) band.forEach((side, k) => traces.push(line(bands.speeds, side, "", colour, { ...where, hovertemplate: undefined, hoverinfo: "skip", showlegend: false, line: { width: 0 }, ...(k ? { fill: "tonexty", fillcolor: colour + "26" } : {}) })));
        if (old?.outputs[name]) traces.push(line(old.speeds, old.outputs[name], words.pinned, ink("edge"), { ...where, showlegend: false, line: { width: 1.4, dash } }));
        if (found.outputs[name]) traces.push(line(found.speeds, found.outputs[name], words[label], colour, { ...where, line: { dash } }));
      }
      const rows = last === 3 ? [[0.78, 1], [0.52, 0.72], [0, 0.45]] : [[0.54, 1], [0, 0.46]];
      const shapes = [{ type: "line", x0: found.own, x1: found.own, yref: "paper", y0: 0, y1: 1, line: { color: ink("ink"), width: 1.2, dash: "dot" } }];
      const lines = last === 3 ? this.limits(found, shapes) : [];
      const own = { text: `${words.now}: ${Math.round(found.own)} rpm`, x: found.own, yref: "paper", y: 1, yanchor: "bottom", showarrow: false, font: { size: 11.5 } };
      const layout = {
        shapes, annotations: [own, ...lines, ...this.lost(found)], hovermode: "x unified", legend: { orientation: "h", x: 0, y: -0.1, font: { size: 11 } }, margin: { l: 56, r: 14, t: 24, b: 66 },
        xaxis: axis(words.ramp_speed, { anchor: last === 3 ? "y3" : "y2", range: [found.speeds[0], found.speeds.at(-1)] }),
        yaxis: axis(words.ramp_pressure, { domain: rows[0], rangemode: "tozero" }), yaxis2: axis(words.ramp_flow, { domain: rows[1], rangemode: "tozero" }),
      };
      if (last === 3) layout.yaxis3 = axis(words.ramp_pressure, { domain: rows[2] });
      this.chart.draw(traces, layout);
    },
    // Limits as lines of the curve's colour, each with its name; those far from all curves are left out.
    limits(found, shapes) {
      const all = LIMITS.flatMap(([name]) => found.outputs[name] ?? []).filter(Number.isFinite);
      const [low, high] = [Math.min(...all), Math.max(...all)];
      const reach = 0.25 * (high - low) + 20;
      const labels = [];
      for (const [name, limited, side] of LIMITS) {
        if (!found.outputs[name]) continue;
        const k = CURVES.findIndex(([output]) => output === name);
        const { colour } = stroke(k);
        for (const { kind, value } of found.limits[limited] ?? []) {
          if (value < low - reach || value > high + reach) continue;
          shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, yref: "y3", y0: value, y1: value, line: { color: colour, width: 1, dash: "2px,3px" } });
          labels.push({ text: `${words["limit_" + name]} ${words["kind_" + kind]} ${fixed(value, 0)}`, xref: "paper", x: { left: 0.01, center: 0.5, right: 0.99 }[side], xanchor: side, yref: "y3", y: value, yanchor: kind === "warning" && value > 0 ? "top" : "bottom", showarrow: false, font: { size: 11, color: colour }, borderpad: 0 });
        }
      }
      return labels;
    },
    lost(found) {
      if (!found.lost.length) return [];
      const text = words.ramp_lost.replace("{speeds}", found.lost.map((v) => fixed(v, 0)).join(", "));
      return [{ text, xref: "paper", x: 0, yref: "paper", y: 1, xanchor: "left", yanchor: "bottom", showarrow: false, font: { size: 11.5, color: ink("alarm") } }];
    },
  },
};
