// Saved states side by side: what differs in the knobs, the main outputs, arterial pressure and loops.
import { bus, compact, ink, stroke, svgDash, words } from "eclsim-page";
import { Chart, axis, line } from "eclsim-page/chart.js";

const OUTPUTS = ["SP", "DP", "MAP", "MPAP", "PCWP", "right_atrial_pressure", "CO", "PF", "lvad_flow", "ejection_fraction_lv", "EDVLV", "stroke_work_lv", "crrt_access_pressure", "crrt_return_pressure", "lowest_drainage_pressure"];
const NAMES = "eclsim-names"; // of the saved states of this tab, by what they were computed from
const shadow = () => ({ colour: ink("edge"), dash: "solid" });

export default {
  template: `
  <div class="ecl-compare">
    <p v-if="!saved.length && !pinned" class="ecl-empty">{{ words.compare_none }}</p>
    <template v-else>
      <div class="ecl-table" tabindex="0" role="region" :aria-label="words.compare_table"><table>
        <thead><tr><th scope="col"><span class="ecl-hidden">{{ words.output }}</span></th><th v-for="(s, k) in columns" :key="k" scope="col" class="n">
          <svg viewBox="0 0 40 6" width="40" height="6" aria-hidden="true"><line x1="0" x2="40" y1="3" y2="3" :stroke="s.stroke.colour" stroke-width="2.4" :stroke-dasharray="s.dash" /></svg>
          <template v-if="s.number"><br /><input type="text" maxlength="40" :value="s.label" :aria-label="words.compare_name.replace('{number}', s.number)" @change="name(s, $event.target.value)" />
            <br /><button type="button" @click="$emit('show', { number: s.number - 1 })" :aria-label="words.compare_show + ' ' + s.number">{{ words.compare_show }}</button><button type="button" @click="$emit('remove', { number: s.number - 1 })" :aria-label="words.compare_remove + ' ' + s.number">✕</button></template>
          <template v-else> {{ s.label }}</template></th></tr></thead>
        <tbody>
          <tr><th scope="row">{{ words.patient }}</th><td v-for="(s, k) in columns" :key="k" class="n name">{{ s.name }}</td></tr>
          <tr v-for="r in rows" :key="r.key" :class="r.kind"><th scope="row" :title="r.hint">{{ r.label }} <small>{{ r.unit }}</small></th><td v-for="(v, k) in r.cells" :key="k" class="n">{{ v }}</td></tr>
        </tbody>
      </table></div>
      <div class="ecl-chart" ref="chart" role="group" :aria-label="words.compare"></div>
    </template>
  </div>`,
  props: { specs: Object },
  data: () => ({ words, saved: [], pinned: null, beat: null, state: null, panel: [], names: {} }),
  computed: {
    columns() {
      const now = { name: this.state?.name, values: this.state?.values ?? {}, beat: this.beat, label: words.compare_now, stroke: stroke(0) };
      const pinned = this.pinned && { ...this.pinned, beat: this.pinned, label: words.pinned, stroke: shadow() };
      const saved = this.saved.map((s, k) => ({ ...s, beat: s, label: this.names[this.slot(k)] || String(k + 1), slot: this.slot(k), number: k + 1, stroke: stroke(k + 1) }));
      return [now, pinned, ...saved].filter((s) => s?.beat).map((s) => ({ ...s, dash: svgDash(s.stroke.dash) }));
    },
    rows() {
      const show = (v) => (typeof v === "number" ? compact(v) : v ?? "–");
      const keys = [...new Set(this.columns.flatMap((s) => Object.keys(s.values)))];
      const knobs = keys.map((key) => ({ key, label: words[key], unit: this.panel.find((c) => c.key === key)?.unit ?? "", cells: this.columns.map((s) => show(s.values[key])), kind: "knob" }));
      const outputs = OUTPUTS.filter((key) => this.columns.some((s) => key in s.beat.outputs)).map((key) => ({ key, label: (key === key.toUpperCase() ? key : this.specs[key].words) + (this.caution(key) ? " †" : ""), hint: this.caution(key), unit: this.specs[key].unit, cells: this.columns.map((s) => show(s.beat.outputs[key])), kind: "output" }));
      return [...knobs.filter((r) => new Set(r.cells).size > 1), ...outputs];
    },
  },
  mounted() {
    this.words = words;
    this.names = JSON.parse(sessionStorage.getItem(NAMES) ?? "{}");
    this.stops = [
      bus.on("saved", (saved) => {
        this.saved = saved;
        this.$nextTick(() => this.show());
      }),
      bus.on("pinned", (beat) => {
        this.pinned = beat;
        this.$nextTick(() => this.show());
      }),
      bus.on("panel", (panel) => (this.panel = panel)),
      bus.on("state", (state) => (this.state = state)),
      bus.on("view", (view) => {
        this.seen = view === "compare";
        this.$nextTick(() => this.show());
      }),
      bus.on("beat", (beat) => {
        this.last = beat;
        this.show();
      }),
    ];
  },
  unmounted() {
    this.chart?.close();
    for (const stop of this.stops) stop();
  },
  methods: {
    caution(key) {
      const why = this.columns.map((s) => s.beat.cautions?.[key]).find(Boolean);
      return why ? words.caution.replace("{why}", why) : "";
    },
    // A state that was saved twice has two names.
    slot(k) {
      const { of } = this.saved[k];
      return `${of}-${this.saved.slice(0, k).filter((s) => s.of === of).length}`;
    },
    name(state, given) {
      this.names = { ...this.names, [state.slot]: given.trim() };
      sessionStorage.setItem(NAMES, JSON.stringify(this.names));
      this.show();
    },
    show() {
      if (!this.seen || !this.last) return;
      this.beat = this.last;
      if (!this.$refs.chart) return;
      if (this.chart?.element !== this.$refs.chart) {
        this.chart?.close();
        this.chart = new Chart(this.$refs.chart, "compare");
      }
      const traces = [...this.columns].reverse().flatMap((s) => {
        const { colour, dash } = s.stroke;
        const drawn = { line: { dash, width: s.number || s.label === words.pinned ? 1.8 : 2.4 }, showlegend: false };
        const name = s.label;
        const wave = s.beat.waves.Pao;
        const loop = (kind) => [...s.beat.waves[kind], s.beat.waves[kind][0]];
        return [
          line(wave.map((_, i) => (i / wave.length) * s.beat.period), wave, name, colour, drawn),
          line(loop("Vlv"), loop("Plv"), name, colour, { ...drawn, xaxis: "x2", yaxis: "y2" }),
        ];
      });
      this.chart.draw(traces, {
        showlegend: false, margin: { l: 50, r: 12, t: 12, b: 42 },
        xaxis: axis(words.time_axis, { domain: [0, 0.45] }), yaxis: axis(`${words.Pao} [mmHg]`),
        xaxis2: axis(`${words.left_ventricle} [mL]`, { domain: [0.57, 1] }), yaxis2: axis(words.pressure_axis, { anchor: "x2" }),
      });
    },
  },
};
