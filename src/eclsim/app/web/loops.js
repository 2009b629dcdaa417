// Pressure-volume loops of both ventricles.
import { aboutSign, bandsOf, extent, fixed, ink, drawing, isPossible, niceRange } from "eclsim-page";
import { Chart, axis, line } from "eclsim-page/chart.js";

const SIDES = [
  { place: "lv", title: "left_ventricle", ink: "left-heart", axes: { xaxis: "x", yaxis: "y" }, middle: 0.22 },
  {
    place: "rv",
    title: "right_ventricle",
    ink: "right-heart",
    axes: { xaxis: "x2", yaxis: "y2" },
    middle: 0.78,
  },
];
const FIXED = { automargin: false }; // to find margins for labels, Plotly draws twice
const HOVER = "%{x:.0f} mL, %{y:.1f} mmHg<extra></extra>";
const closed = (wave) => [...wave, wave[0]];

export default {
  template: `
  <div class="ecl-loops">
    <p v-if="caution" class="ecl-caution">† {{ caution }}</p>
    <p v-if="pinned && !shadow" class="ecl-caution" role="status">{{ texts.impossible_pinned }}</p>
    <div class="ecl-chart" ref="chart" role="group" :aria-label="label"></div>
  </div>`,
  mixins: [
    drawing(["bands"], {
      beat(beat) {
        this.beat = beat;
        this.show();
      },
    }),
  ],
  data: () => ({ label: "", caution: "", pinned: null, shadow: null }),
  unmounted() {
    this.chart.close();
  },
  methods: {
    setUp() {
      this.ranges = {};
      this.chart = new Chart(this.$refs.chart, "loops");
    },
    show() {
      if (!this.beat) return;
      const bands = bandsOf(this.beat);
      this.shadow = isPossible(this.pinned) ? this.pinned : null;
      const { outputs } = this.beat;
      this.caution = this.beat.cautions.EDVLV ?? "";
      const volumes = ["EDVLV", "ESVLV", "EDVRV", "ESVRV"].map(
        (name) => `${name} ${aboutSign(this.beat, name)}${fixed(outputs[name], 0)} mL`,
      );
      this.label = `${this.texts.loops}: ${volumes.join(", ")}`;
      const traces = SIDES.map((side) => this.members(side, bands?.loops[side.place] ?? []));
      if (this.shadow) traces.push(...SIDES.map((side) => this.loop(side, this.shadow, true)));
      traces.push(...SIDES.map((side) => this.loop(side, this.beat, false)));
      this.chart.draw(
        traces.filter((trace) => trace.x.length),
        this.layout(bands),
      );
    },
    // Loops of the posterior's draws: one trace for all, with gaps.
    members(side, loops) {
      const joined = (k) => loops.flatMap((loop) => [...loop[k], null]);
      return line(joined(0), joined(1), this.texts.bands_column, ink(side.ink), {
        ...side.axes,
        showlegend: false,
        hoverinfo: "skip",
        opacity: 0.3,
        line: { width: 1 },
      });
    },
    loop(side, beat, shadow) {
      const [volume, pressure] = ["V", "P"].map((kind) => closed(beat.waves[kind + side.place]));
      const name = shadow ? this.texts.pinned : this.texts[side.title];
      return line(volume, pressure, name, ink(shadow ? "edge" : side.ink), {
        ...side.axes,
        showlegend: false,
        hovertemplate: HOVER,
        line: { width: shadow ? 1.6 : 2.4 },
      });
    },
    range(kind, place, bands) {
      const drawn = (bands?.loops[place] ?? []).flatMap((loop) => loop["VP".indexOf(kind)]);
      const beats = [this.beat, this.shadow].filter(Boolean).flatMap((beat) => beat.waves[kind + place]);
      const [low, high] = extent([0, ...beats, ...drawn]);
      return (this.ranges[kind + place] = niceRange(low, high, this.ranges[kind + place]));
    },
    layout(bands) {
      const heading = ({ title, middle }) => ({
        text: `<b>${this.texts[title]}</b>`,
        xref: "paper",
        yref: "paper",
        x: middle,
        y: 1.02,
        xanchor: "center",
        yanchor: "bottom",
        showarrow: false,
        font: { size: 13 },
      });
      const [volume, pressure] = [this.texts.volume_axis, this.texts.pressure_axis];
      return {
        showlegend: false,
        annotations: SIDES.map(heading),
        xaxis: axis(volume, { ...FIXED, domain: [0, 0.44], range: this.range("V", "lv", bands) }),
        yaxis: axis(pressure, { ...FIXED, range: this.range("P", "lv", bands) }),
        xaxis2: axis(volume, { ...FIXED, domain: [0.56, 1], range: this.range("V", "rv", bands) }),
        yaxis2: axis(pressure, { ...FIXED, anchor: "x2", range: this.range("P", "rv", bands) }),
      };
    },
  },
};
