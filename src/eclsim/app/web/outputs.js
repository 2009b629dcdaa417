// All outputs with unit, adult reference range and change.
import { bandsOf, bus, compact, fixed, words } from "eclsim-page";

const SIGNS = { ok: "", warning: "! ", alarm: "▲ ", collapse: "✕ " };

export default {
  template: `
  <div class="ecl-outputs">
    <label class="filter">{{ words.filter }} <input type="search" v-model="filter" autocomplete="off" /></label>
    <div class="scroll" tabindex="0" role="region" :aria-label="words.outputs"><table>
      <caption class="ecl-hidden">{{ words.outputs }}</caption>
      <thead><tr><th scope="col">{{ words.output }}</th><th scope="col" class="n">{{ bands ? words.bands_value : words.value }}</th><th v-if="measures" scope="col" class="n">{{ words.output_measured }}</th><th scope="col">{{ words.unit }}</th><th scope="col" class="n">{{ pinned ? words.change : words.change_start }}</th><th scope="col">{{ words.reference }}<small>{{ words.limits }}</small></th></tr></thead>
      <tbody>
        <tr v-for="r in rows" :key="r.name" :class="r.level">
          <th scope="row" :title="r.definition"><b v-if="r.short">{{ r.name }}</b> {{ r.words }}<small v-if="r.caution" class="caution" :title="r.caution"> † {{ words.caution_above }}</small></th>
          <td class="n"><span class="value">{{ r.sign }}{{ r.value }}</span><template v-if="r.band"><br /><small class="band">{{ r.band }}</small></template></td><td v-if="measures" class="n">{{ r.measured }}</td><td>{{ r.unit }}</td><td class="n">{{ r.change }}</td>
          <td :title="r.source"><template v-if="r.range">{{ r.range }} <em v-if="r.side">{{ r.side }}</em></template><small v-if="r.limits" class="limits">{{ r.limits }}</small></td>
        </tr>
      </tbody>
    </table></div>
  </div>`,
  props: { specs: Object },
  data: () => ({ words, filter: "", beat: null, pinned: null, base: null, found: null, measured: {} }),
  computed: {
    measures() {
      return Object.keys(this.measured).length > 0;
    },
    bands() {
      return this.found && bandsOf(this.beat);
    },
    rows() {
      if (!this.beat) return [];
      const wanted = this.filter.trim().toLowerCase();
      return Object.entries(this.beat.outputs).filter(([name]) => this.specs[name]).map(([name, value]) => {
        const spec = this.specs[name];
        const old = (this.pinned ?? this.base)?.outputs[name];
        const [low, high, source] = spec.range ?? [];
        const level = this.beat.levels[name] ?? "ok";
        const caution = this.beat.cautions[name] ?? "";
        const limits = this.limits(spec.limits ?? []);
        const side = value === null || !spec.range ? "" : value < low ? "▼ " + words.below : value > high ? "▲ " + words.above : "";
        const change = old === null || old === undefined || value === null ? "" : this.signed(value - old, value);
        return { name, short: name === name.toUpperCase(), words: spec.words, unit: spec.unit, definition: spec.definition, value: compact(value), measured: name in this.measured ? compact(this.measured[name]) : "", band: (this.bands?.outputs[name] ?? []).map(compact).join(" – "), change, range: spec.range ? `${low} – ${high}`.replaceAll("-", "−") : "", source, side, level, sign: SIGNS[level], caution, limits };
      }).filter((r) => !wanted || `${r.name} ${r.words}`.toLowerCase().includes(wanted));
    },
  },
  mounted() {
    this.words = words;
    this.stops = [
      bus.on("pinned", (beat) => (this.pinned = beat)),
      bus.on("state", ({ whose }) => (this.measured = whose.measured)),
      bus.on("bands", (found) => (this.found = found)),
      bus.on("base", (beat) => (this.base = beat)),
      bus.on("beat", (beat) => (this.seen ? (this.beat = beat) : (this.waiting = beat))),
      bus.on("view", (view) => {
        this.seen = view === "outputs";
        if (this.seen && this.waiting) [this.beat, this.waiting] = [this.waiting, null];
      }),
    ];
  },
  unmounted() {
    for (const stop of this.stops) stop();
  },
  methods: {
    // "! < 65 > 107, ▲ < 55 > 133": what is below or above has the sign.
    limits(all) {
      const of = (kind) => all.filter((l) => l.kind === kind).map((l) => `${l.side === "below" ? "<" : ">"} ${fixed(l.value, 0)}`);
      return ["warning", "alarm", "collapse"].filter((kind) => of(kind).length).map((kind) => SIGNS[kind] + of(kind).join(", ")).join("\n");
    },
    signed(change, value) {
      if (Math.abs(change) < 1e-3 * Math.max(Math.abs(value), 0.01)) return "0";
      return (change > 0 ? "+" : "") + compact(change);
    },
  },
};
