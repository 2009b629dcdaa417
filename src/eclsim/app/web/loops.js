// Pressure-volume loops of both ventricles.
import { bandsOf, bus, ink, niceRange, words } from "eclsim-page";
import { Chart, axis, line } from "eclsim-page/chart.js";

const SIDES = [
  { place: "lv", title: "left_ventricle", ink: "ecmo", axes: ["x", "y"] },
  { place: "rv", title: "right_ventricle", ink: "patient", axes: ["x2", "y2"] },
];

export default {
  template: `<div class="ecl-looped"><p v-if="caution" class="ecl-caution">† {{ caution }}</p><div class="ecl-chart" ref="chart" role="group" :aria-label="label"></div></div>`,
  data: () => ({ label: "", caution: "" }),
  mounted() {
    this.chart = new Chart(this.$refs.chart, "loops");
    this.stops = [
      bus.on("pinned", (beat) => {
        this.pinned = beat;
        if (this.beat) this.show();
      }),
      bus.on("bands", () => {
        if (this.beat) this.show();
      }),
      bus.on("beat", (beat) => {
        this.beat = beat;
        this.show();
      }),
    ];
  },
  unmounted() {
    this.chart.close();
    for (const stop of this.stops) stop();
  },
  methods: {
    show() {
      const bands = bandsOf(this.beat);
      const pale = (side) => bands?.loops[side.place] ?? [];
      // One trace for all, with gaps: the curves of the members of the posterior.
      const traces = SIDES.map((side) => line(pale(side).flatMap(([v]) => [...v, null]), pale(side).flatMap(([, p]) => [...p, null]), words.bands_column, ink(side.ink), {
        xaxis: side.axes[0], yaxis: side.axes[1], showlegend: false, hoverinfo: "skip", opacity: 0.3, line: { width: 1 },
      })).filter((t) => t.x.length);
      for (const [beat, shadow] of [[this.pinned, true], [this.beat, false]]) {
        if (!beat) continue;
        for (const side of SIDES) {
          const close = (wave) => [...wave, wave[0]];
          traces.push(line(close(beat.waves["V" + side.place]), close(beat.waves["P" + side.place]), shadow ? words.pinned : words[side.title], shadow ? ink("edge") : ink(side.ink), {
            xaxis: side.axes[0], yaxis: side.axes[1], showlegend: false, hovertemplate: "%{x:.0f} mL, %{y:.1f} mmHg<extra></extra>",
            line: { width: shadow ? 1.6 : 2.4 },
          }));
        }
      }
      this.caution = this.beat.cautions.EDVLV ?? "";
      const o = this.beat.outputs;
      this.label = `${words.loops}: EDV LV ${o.EDVLV?.toFixed(0)} mL, ESV LV ${o.ESVLV?.toFixed(0)} mL, EDV RV ${o.EDVRV?.toFixed(0)} mL, ESV RV ${o.ESVRV?.toFixed(0)} mL`;
      const top = (kind, place) => {
        const members = (bands?.loops[place] ?? []).flatMap((loop) => loop["VP".indexOf(kind)]);
        const all = [this.beat, this.pinned].filter(Boolean).flatMap((b) => b.waves[kind + place]).concat(members).filter(Number.isFinite);
        return ((this.tops ??= {})[kind + place] = niceRange(Math.min(0, ...all), Math.max(...all), this.tops?.[kind + place]));
      };
      const head = (text, x) => ({ text: `<b>${text}</b>`, xref: "paper", yref: "paper", x, y: 1.02, xanchor: "center", yanchor: "bottom", showarrow: false, font: { size: 13 } });
      this.chart.draw(traces, {
        showlegend: false, annotations: [head(words.left_ventricle, 0.22), head(words.right_ventricle, 0.78)],
        xaxis: axis(words.volume_axis, { domain: [0, 0.44], range: top("V", "lv") }), yaxis: axis(words.pressure_axis, { range: top("P", "lv") }),
        xaxis2: axis(words.volume_axis, { domain: [0.56, 1], range: top("V", "rv") }), yaxis2: axis(words.pressure_axis, { anchor: "x2", range: top("P", "rv") }),
      });
    },
  },
};
