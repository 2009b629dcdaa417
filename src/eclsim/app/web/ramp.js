// Speed ramp: pressures, flows and pressures in the circuits over the whole range of a pump's speed.
import {
  FONT,
  bandsOf,
  bus,
  extent,
  fill,
  fixed,
  ink,
  placeLabels,
  speedsText,
  stroke,
  studied,
  studyNotes,
  textWidth,
} from "eclsim-page";
import { Chart, axis, line } from "eclsim-page/chart.js";

const AXES = { pressure: "y", flow: "y2", circuit: "y3" };
const ROWS = { 2: [[0.54, 1], [0, 0.46]], 3: [[0.78, 1], [0.52, 0.72], [0, 0.45]] }; // prettier-ignore
const LETTER_HEIGHT = 11; // px
const TITLE = 12; // px of an axis
const NAME_SPACE = 18; // px after the last limit, for its label
const MARGIN = { l: 56, r: 14, t: 24, b: 66 };
const overhead = { yref: "paper", y: 1, yanchor: "bottom", showarrow: false };

export default {
  template: `
  <div class="ecl-fill">
    ${studyNotes("ramp_none")}
    <p v-if="note && !empty" class="ecl-caution bad" role="status">{{ note }}</p>
    <div v-show="!empty" :class="['ecl-chart', { 'ecl-old': isOld }]" ref="chart" role="group"
      :aria-label="texts.ramp"></div>
  </div>`,
  mixins: [studied("ramp", ["ramp_bands"])],
  data: () => ({ note: "" }),
  unmounted() {
    this.chart.close();
  },
  methods: {
    setUp() {
      this.chart = new Chart(this.$refs.chart, "ramp", () => this.show());
    },
    show() {
      if (!this.study) return;
      const limits = this.limits();
      const { speeds, lost, impossible, closed, undetermined } = this.study;
      this.note = [
        ["ramp_lost", lost],
        ["ramp_impossible", impossible],
        ["ramp_closed", closed],
        ["ramp_undetermined", undetermined],
      ]
        .filter(([, some]) => some.length)
        .map(([words, some]) => fill(this.texts[words], { speeds: speedsText(some, speeds) }))
        .join(" ");
      this.chart.draw(this.traces(), this.layout(limits));
    },
    traces() {
      const { study: ramp } = this;
      const bands = bandsOf(ramp, "ramp_bands");
      const kept = bus.last("ramp_pinned");
      const shadow = kept?.outputs && kept.of === this.pinned?.of && kept.key === ramp.key ? kept : undefined;
      return ramp.curves.flatMap(({ name, label, panel, number }) => {
        const { colour, dash } = stroke(number);
        const where = { xaxis: "x", yaxis: AXES[panel], hovertemplate: "%{x:.0f} rpm: %{y:.2f}" };
        const sides = bands?.outputs[name] ? this.band(bands, name, colour, where) : [];
        const old = shadow?.outputs[name] && [
          line(shadow.speeds, shadow.outputs[name], this.texts.pinned, ink("edge"), {
            ...where,
            showlegend: false,
            line: { width: 1.4, dash },
          }),
        ];
        const now = line(ramp.speeds, ramp.outputs[name], label, colour, { ...where, line: { dash } });
        return [...sides, ...(old ?? []), now];
      });
    },
    band(bands, name, colour, where) {
      const quiet = { ...where, hovertemplate: undefined, hoverinfo: "skip", showlegend: false };
      const filled = { fill: "tonexty", fillcolor: `${colour}26` };
      return bands.outputs[name].map((side, k) =>
        line(bands.speeds, side, "", colour, { ...quiet, line: { width: 0 }, ...(k ? filled : {}) }),
      );
    },
    // Limits as labelled lines in the colour of the curve; those far from all curves are omitted.
    limits() {
      const limited = this.study.curves.filter((curve) => curve.panel === "circuit");
      const curves = limited.map((curve) => this.study.outputs[curve.name]);
      const range = extent(curves.flat());
      if (!range) return { shapes: [], labels: [] };
      const [low, high] = range;
      const reach = 0.25 * (high - low) + 20;
      const near = limited.flatMap((curve) =>
        curve.limits
          .filter(({ value }) => value > low - reach && value < high + reach)
          .map((limit) => this.named(curve, limit)),
      );
      const [bottom, top] = extent([low, high, ...near.map(({ value }) => value)]);
      const panel = this.panel();
      const margin = (NAME_SPACE / panel.height) * (top - bottom) + 1;
      const yRange = [bottom - margin, top + margin];
      const places = placeLabels(near, { ...panel, curves, yRange });
      return {
        range: yRange,
        shapes: near.map((limit) => this.limitLine(limit)),
        labels: near.map((limit, k) => this.limitLabel(limit, places[k])),
      };
    },
    // The lowest panel, in which limits are drawn.
    panel() {
      const { speeds: xs, own } = this.study;
      const { width, height } = this.chart.size;
      const [bottom, top] = ROWS[3][2];
      return {
        xs,
        upright: [own],
        xRange: [xs[0], xs.at(-1)],
        width: (width || 500) - MARGIN.l - MARGIN.r,
        height: ((height || 480) - MARGIN.t - MARGIN.b) * (top - bottom),
      };
    },
    named({ short, number }, { kind, value }) {
      const text = `${short} ${this.texts[`kind_${kind}`]} ${fixed(value, 0)}`;
      return {
        value,
        text,
        wide: textWidth(text, `${LETTER_HEIGHT}px ${FONT}`),
        colour: stroke(number).colour,
      };
    },
    limitLine: ({ value, colour }) => ({
      type: "line",
      xref: "paper",
      x0: 0,
      x1: 1,
      yref: "y3",
      y0: value,
      y1: value,
      line: { color: colour, width: 1, dash: "2px,3px" },
    }),
    limitLabel: ({ text, value, colour }, { left, above }) => ({
      text,
      xref: "paper",
      x: left,
      xanchor: "left",
      yref: "y3",
      y: value,
      yanchor: above ? "bottom" : "top",
      showarrow: false,
      font: { size: LETTER_HEIGHT, color: colour },
      borderpad: 0,
    }),
    // A vertical axis; if a low panel has no room for the title, only the unit.
    upright(title, settings) {
      const [bottom, top] = settings.domain;
      const room = (this.chart.size.height - MARGIN.t - MARGIN.b) * (top - bottom);
      const fits = textWidth(title, `${TITLE}px ${FONT}`) < room;
      return axis(fits ? title : title.replace(/^.*\[(.*)\]$/, "$1"), settings);
    },
    layout({ shapes, labels, range }) {
      const { own, speeds, curves, key } = this.study;
      const { device = "" } = (bus.last("panel") ?? []).find((knob) => knob.key === key) ?? {};
      const rows = ROWS[curves.some((curve) => curve.panel === "circuit") ? 3 : 2];
      const now = {
        ...overhead,
        text: `${this.texts.now}: ${Math.round(own)} rpm`,
        x: own,
        xanchor: own > speeds[0] + 0.85 * (speeds.at(-1) - speeds[0]) ? "right" : "center",
        font: { size: 11.5 },
      };
      const ownSpeed = {
        type: "line",
        x0: own,
        x1: own,
        yref: "paper",
        y0: 0,
        y1: 1,
        line: { color: ink("ink"), width: 1.2, dash: "dot" },
      };
      const layout = {
        shapes: [ownSpeed, ...shapes],
        annotations: [now, ...labels],
        hovermode: "x unified",
        legend: { orientation: "h", x: 0, y: -0.1, font: { size: 11 } },
        margin: MARGIN,
        xaxis: axis(fill(this.texts.ramp_speed, { device }), {
          anchor: rows.length === 3 ? "y3" : "y2",
          range: [speeds[0], speeds.at(-1)],
        }),
        yaxis: this.upright(this.texts.ramp_pressure, { domain: rows[0], rangemode: "tozero" }),
        yaxis2: this.upright(this.texts.ramp_flow, { domain: rows[1], rangemode: "tozero" }),
      };
      if (rows.length === 3)
        layout.yaxis3 = this.upright(this.texts.ramp_pressure, { domain: rows[2], range });
      return layout;
    },
  },
};
