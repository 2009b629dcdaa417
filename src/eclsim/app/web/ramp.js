// What the pump's speed does: pressures, flows, CRRT lines and drainage over the whole range.
import { bandsOf, bus, words } from "eclsim-page";
import { Chart, axis, line } from "eclsim-page/chart.js";

const CURVES = [
  ["MAP", "key_MAP", "#D55E00", "solid", 1], ["MPAP", "key_MPAP", "#0072B2", "dash", 1], ["PCWP", "key_PCWP", "#009E73", "dot", 1],
  ["right_atrial_pressure", "key_CVP", "#56B4E9", "dashdot", 1],
  ["PF", "key_PF", "#D55E00", "solid", 2], ["lvad_flow", "key_lvad_flow", "#A3528A", "solid", 2], ["CO", "key_CO", "#0072B2", "dash", 2],
  ["crrt_access_pressure", "ramp_access", "#E69F00", "solid", 3], ["crrt_return_pressure", "ramp_return", "#009E73", "dash", 3],
  ["drainage_pressure", "ramp_drain", "#17202A", "dot", 3],
];

export default {
  template: `<div class="ecl-fill"><p v-if="empty" class="ecl-empty">{{ words.ramp_none }}</p><div v-show="!empty" class="ecl-chart" ref="chart" role="img" :aria-label="words.ramp"></div></div>`,
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
      for (const [name, label, colour, dash, panel] of CURVES) {
        const where = { xaxis: "x", yaxis: panel === 1 ? "y" : "y" + panel, hovertemplate: "%{x:.0f} rpm: %{y:.2f}" };
        const band = bands?.outputs[name];
        if (band) band.forEach((side, k) => traces.push(line(bands.speeds, side, "", colour, { ...where, hovertemplate: undefined, hoverinfo: "skip", showlegend: false, line: { width: 0 }, ...(k ? { fill: "tonexty", fillcolor: colour + "26" } : {}) })));
        if (old?.outputs[name]) traces.push(line(old.speeds, old.outputs[name], words.pinned, "#B4BBC3", { ...where, showlegend: false, line: { width: 1.4, dash } }));
        if (found.outputs[name]) traces.push(line(found.speeds, found.outputs[name], words[label], colour, { ...where, line: { dash } }));
      }
      const rows = last === 3 ? [[0.72, 1], [0.4, 0.66], [0, 0.34]] : [[0.54, 1], [0, 0.46]];
      const shapes = [{ type: "line", x0: found.own, x1: found.own, yref: "paper", y0: 0, y1: 1, line: { color: "#17202A", width: 1.2, dash: "dot" } }];
      if (found.outputs.crrt_access_pressure) {
        for (const y of [...found.limits.access, found.limits.return[1]]) shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, yref: "y3", y0: y, y1: y, line: { color: "#A63C00", width: 0.8, dash: "dash" } });
      }
      const own = { text: `${words.now}: ${Math.round(found.own)} rpm`, x: found.own, yref: "paper", y: 1, yanchor: "bottom", showarrow: false, font: { size: 11.5 } };
      const layout = {
        shapes, annotations: [own], hovermode: "x unified", legend: { orientation: "h", x: 0, y: -0.1, font: { size: 11 } }, margin: { l: 56, r: 14, t: 24, b: 70 },
        xaxis: axis(words.ramp_speed, { anchor: last === 3 ? "y3" : "y2", range: [found.speeds[0], found.speeds.at(-1)] }),
        yaxis: axis(words.ramp_pressure, { domain: rows[0], rangemode: "tozero" }), yaxis2: axis(words.ramp_flow, { domain: rows[1], rangemode: "tozero" }),
      };
      if (last === 3) layout.yaxis3 = axis(words.ramp_pressure, { domain: rows[2] });
      this.chart.draw(traces, layout);
    },
  },
};
