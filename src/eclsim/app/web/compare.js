// Saved states side by side: differences in settings, main outputs, arterial pressure and loops.
import {
  aboutSign,
  clock,
  compact,
  fill,
  ink,
  isPossible,
  listening,
  settingsText,
  stroke,
  svgDash,
  tab,
  timeOf,
} from "eclsim-page";
import { Chart, axis, line } from "eclsim-page/chart.js";

const STORAGE_KEY = "names"; // names of the saved states of this tab, by their inputs
const SYMBOL = /^[^_.]*[A-Z][^_.]*$/; // MAP, SaO2: known to clinicians; other names are those of code
const format = (value) => (typeof value === "number" ? compact(value) : (value ?? "–"));

export default {
  template: `
  <div class="ecl-compare">
    <p v-if="!saved.length && !pinned" class="ecl-empty">{{ texts.compare_none }}</p>
    <template v-else>
      <div class="ecl-table" tabindex="0" role="region" :aria-label="texts.compare_table"><table
        :style="{ '--columns': columns.length }">
        <thead><tr>
          <th scope="col"><span class="ecl-hidden">{{ texts.output }}</span></th>
          <th v-for="(s, k) in columns" :key="k" scope="col" class="n">
            <svg viewBox="0 0 40 6" width="40" height="6" aria-hidden="true"><line x1="0" x2="40"
              y1="3" y2="3" :stroke="s.stroke.colour" stroke-width="2.4" :stroke-dasharray="s.dash" /></svg>
            <template v-if="s.number"><br />
              <input type="text" maxlength="40" :value="s.label" :aria-label="nameLabel(s)"
                @change="name(s, $event.target.value)" /><br />
              <button type="button" :aria-label="texts.compare_show + ' ' + s.number"
                @click="$emit('show', { number: s.number - 1 })">{{ texts.compare_show }}</button>
              <button type="button" :aria-label="texts.compare_remove + ' ' + s.number"
                @click="$event.detail < 2 && $emit('remove', { number: s.number - 1 })">✕</button>
            </template>
            <template v-else> {{ s.label }}</template>
            <b v-if="!s.possible" class="impossible"><br />{{ texts.impossible_column }}</b>
          </th>
        </tr></thead>
        <tbody>
          <tr><th scope="row">{{ texts.patient }}</th>
            <td v-for="(s, k) in columns" :key="k" class="n name">{{ s.name }} <b
              :class="['badge', s.level]">{{ s.badge }}</b></td></tr>
          <tr v-for="r in rows" :key="r.key" :class="r.kind">
            <th scope="row" :title="r.hint">{{ r.label }} <small>{{ r.unit }}</small></th>
            <td v-for="(v, k) in r.cells" :key="k" class="n" :data-whose="columns[k].label"><s
              v-if="r.kind === 'output' && !columns[k].possible">{{ v }}</s><template v-else>{{ v
            }}</template></td></tr>
        </tbody>
      </table></div>
      <div class="ecl-chart" ref="chart" role="group" :aria-label="texts.compare"></div>
    </template>
  </div>`,
  props: { specs: Object },
  mixins: [
    listening({
      display(display) {
        this.outputs = display.compared;
        this.named = display.specs;
      },
      saved(saved) {
        this.saved = saved;
        this.$nextTick(() => this.show());
      },
      pinned(beat) {
        this.pinned = beat;
        this.$nextTick(() => this.show());
      },
      panel(panel) {
        this.panel = panel;
      },
      state(state) {
        this.state = state;
      },
      view(view) {
        this.seen = view === "compare";
        this.$nextTick(() => this.show());
      },
      beat(beat) {
        this.latest = beat;
        this.show();
      },
    }),
  ],
  data: () => ({
    saved: [],
    pinned: null,
    beat: null,
    state: null,
    panel: [],
    outputs: [],
    named: {},
    names: {},
  }),
  computed: {
    columns() {
      const { name, values: knobs = {} } = this.state ?? {};
      const values = this.beat?.values_then ?? knobs;
      const { policy, events, provenance } = this.state ?? {};
      const { badge, level } = provenance ?? {};
      const about = { name, badge, level, values, policy, events, panel: this.panel };
      const now = { ...about, beat: this.beat, label: this.texts.compare_now, stroke: stroke(0) };
      const shadow = { colour: ink("edge"), dash: "solid" };
      const pinned = this.pinned && {
        ...this.pinned,
        beat: this.pinned,
        label: this.texts.pinned,
        stroke: shadow,
      };
      const shown = [now, pinned, ...this.saved.map((state, k) => this.column(state, k))];
      return shown.filter((s) => s?.beat).map((s) => this.judged(s));
    },
    rows() {
      const keys = [...new Set(this.columns.flatMap((s) => Object.keys(s.values)))];
      const set = [...keys.map((key) => this.knobRow(key)), this.policyRow(), this.eventsRow()];
      const names = new Set([...this.outputs, ...this.columns.flatMap((s) => s.compared ?? [])]);
      const known = [...names].filter((name) => this.columns.some((s) => name in s.beat.outputs));
      const differing = set.filter((r) => new Set(r.cells).size > 1);
      return [...differing, ...known.map((name) => this.outputRow(name))];
    },
  },
  unmounted() {
    this.chart?.close();
  },
  methods: {
    setUp() {
      this.names = tab.read(STORAGE_KEY) ?? {};
    },
    column(state, k) {
      const slot = this.slot(k);
      const label = this.names[slot] || String(k + 1);
      return { ...state, beat: state, slot, label, number: k + 1, stroke: stroke(k + 1) };
    },
    judged(column) {
      const time = timeOf(column.beat);
      const name = time ? fill(this.texts.at_minute, { name: column.name, time }) : column.name;
      return { ...column, name, dash: svgDash(column.stroke.dash), possible: isPossible(column.beat) };
    },
    knobRow(key) {
      const panels = this.columns.flatMap((s) => s.panel ?? []);
      const { device = "", label = key, unit, options } = panels.find((k) => k.key === key) ?? {};
      const words = Object.fromEntries(options ?? []);
      const cells = settingsText(this.columns.map((s) => words[s.values[key]] ?? s.values[key]));
      return { key, label: `${device} ${label}`.trim(), unit: unit ?? "", cells, kind: "knob" };
    },
    policyRow() {
      const cells = this.columns.map((s) => this.texts[s.policy]);
      return { key: "policy", label: this.texts.policy, unit: "", cells, kind: "knob" };
    },
    eventsRow() {
      const [over, min] = [this.texts.timeline_over, this.texts.timeline_minutes];
      const eventText = ({ at, words, lasts }) =>
        `${clock(at, at % 1 > 0)} ${words}${lasts ? ` ${over} ${lasts} ${min}` : ""}`;
      const cells = this.columns.map((s) => (s.events ?? []).map(eventText).join(", ") || "–");
      return { key: "events", label: this.texts.timeline_events, unit: "", cells, kind: "knob" };
    },
    outputRow(name) {
      const { label, unit } = this.specs[name] ?? this.named[name] ?? this.kept(name);
      const why = this.columns.map((s) => s.beat.cautions?.[name]).find(Boolean);
      return {
        key: name,
        label: (SYMBOL.test(name) ? name : label) + (why ? " †" : ""),
        hint: why ? fill(this.texts.caution, { why }) : label,
        unit,
        cells: this.columns.map((s) => aboutSign(s.beat, name) + format(s.beat.outputs[name])),
        kind: "output",
      };
    },
    kept(name) {
      return this.columns.map((s) => s.specs?.[name]).find(Boolean);
    },
    nameLabel(state) {
      return fill(this.texts.compare_name, { number: state.number });
    },
    // A state saved twice has two names.
    slot(k) {
      const { of } = this.saved[k];
      return `${of}-${this.saved.slice(0, k).filter((s) => s.of === of).length}`;
    },
    name(state, name) {
      this.names = { ...this.names, [state.slot]: name.trim() };
      tab.keep(STORAGE_KEY, this.names);
      this.show();
    },
    show() {
      if (!this.seen || !this.latest) return;
      this.beat = this.latest;
      if (!this.$refs.chart) return;
      if (this.chart?.element !== this.$refs.chart) {
        this.chart?.close();
        this.chart = new Chart(this.$refs.chart, "compare");
      }
      const drawn = this.columns.filter((s) => s.possible).toReversed();
      this.chart.draw(drawn.flatMap(this.traces), {
        showlegend: false,
        margin: { l: 50, r: 12, t: 12, b: 42 },
        xaxis: axis(this.texts.time_axis, { domain: [0, 0.45] }),
        yaxis: axis(this.texts.arterial_axis),
        xaxis2: axis(this.texts.left_volume_axis, { domain: [0.57, 1] }),
        yaxis2: axis(this.texts.pressure_axis, { anchor: "x2" }),
      });
    },
    traces({ beat, label, number, stroke: { colour, dash } }) {
      const width = number || label === this.texts.pinned ? 1.8 : 2.4;
      const drawn = { line: { dash, width }, showlegend: false };
      const { Pao, Vlv, Plv } = beat.waves;
      const times = Pao.map((_, k) => (k / Pao.length) * beat.period);
      const closed = (wave) => [...wave, wave[0]];
      return [
        line(times, Pao, label, colour, drawn),
        line(closed(Vlv), closed(Plv), label, colour, { ...drawn, xaxis: "x2", yaxis: "y2" }),
      ];
    },
  },
};
