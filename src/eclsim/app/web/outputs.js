// All outputs with unit, adult reference range and change.
import {
  SIGNS,
  UNDETERMINED,
  aboutSign,
  bandsOf,
  change,
  compact,
  fill,
  isPossible,
  isUndetermined,
  limitLines,
  seenIn,
  timeOf,
} from "eclsim-page";

export default {
  template: `
  <div class="ecl-outputs">
    <p v-if="!isPossible(pinned)" class="ecl-caution" role="status">{{ texts.impossible_pinned }}</p>
    <label class="filter">{{ texts.filter
      }} <input type="search" v-model="filter" autocomplete="off" /></label>
    <div class="scroll" tabindex="0" role="region" :aria-label="texts.outputs"><table>
      <caption class="ecl-hidden">{{ texts.outputs }}</caption>
      <thead><tr>
        <th scope="col">{{ texts.output }}</th>
        <th scope="col" class="n">{{ bands ? texts.bands_value : texts.value }}</th>
        <th v-if="isMeasured" scope="col" class="n">{{ measuredHead }}</th>
        <th scope="col" class="unit">{{ texts.unit }}</th>
        <th scope="col" class="n">{{ changedFrom }}</th>
        <th scope="col">{{ texts.reference }}<small>{{ texts.limits }}</small></th>
      </tr></thead>
      <tbody>
        <tr v-for="r in rows" :key="r.name" :class="r.level">
          <th scope="row" :title="r.definition">
            <b v-if="r.isSymbol">{{ r.name }}</b> {{ r.label
            }}<small v-if="r.caution" class="caution" :title="r.caution"> † {{
              texts.caution_above }}</small>
          </th>
          <td class="n"><span class="value">{{ r.value }}</span
            ><template v-if="r.band"><br /><small class="band">{{ r.band }}</small></template
            ><small class="under">{{ r.unit }}</small></td>
          <td v-if="isMeasured" class="n">{{ r.measured }}</td>
          <td class="unit">{{ r.unit }}</td>
          <td class="n">{{ r.change }}</td>
          <td :title="r.source"><template v-if="r.range">{{ r.range }} <em v-if="r.side">{{
            r.side }}</em></template><small v-if="r.limits" class="limits">{{ r.limits }}</small></td>
        </tr>
      </tbody>
    </table></div>
  </div>`,
  props: { specs: Object },
  mixins: [
    seenIn("outputs", {
      display(display) {
        this.named = display.specs;
      },
      pinned(beat) {
        this.pinned = beat;
      },
      bands(bands) {
        this.latestBands = bands;
      },
      base(beat) {
        this.base = beat;
      },
    }),
  ],
  data: () => ({
    named: {},
    filter: "",
    beat: null,
    pinned: null,
    base: null,
    latestBands: null,
  }),
  computed: {
    isMeasured() {
      return this.beat && !this.beat.minute && Object.keys(this.beat.measured).length > 0; // at the start
    },
    measuredHead() {
      return this.texts[this.beat.measured_before ? "output_measured_before" : "output_measured"];
    },
    bands() {
      return this.latestBands && bandsOf(this.beat);
    },
    changedFrom() {
      if (!this.pinned) return this.texts.change_start;
      const time = timeOf(this.pinned);
      return time ? fill(this.texts.at_minute, { name: this.texts.change, time }) : this.texts.change;
    },
    rows() {
      if (!this.beat) return [];
      const sought = this.filter.trim().toLowerCase();
      const specs = { ...this.specs, ...this.named };
      const known = Object.entries(this.beat.outputs).filter(([name]) => specs[name]);
      const rows = known.map(([name, value]) => this.row(name, value, specs[name]));
      return rows.filter((r) => !sought || `${r.name} ${r.label}`.toLowerCase().includes(sought));
    },
  },
  methods: {
    isPossible,
    row(name, value, { label, unit, definition, range, limits }) {
      const level = this.beat.levels[name] ?? "ok";
      const [low, high, source] = range ?? [];
      return {
        name,
        label,
        unit,
        definition,
        level,
        source,
        isSymbol: name === name.toUpperCase(),
        value: SIGNS[level] + aboutSign(this.beat, name) + compact(value),
        measured: name in this.beat.measured ? compact(this.beat.measured[name]) : "",
        band: (this.bands?.outputs[name] ?? []).map(compact).join(" – "),
        change: this.changeOf(name, value),
        range: range ? `${low} – ${high}`.replaceAll("-", "−") : "",
        side: range && value !== null ? this.side(value, low, high) : "",
        limits: limitLines(limits ?? []),
        caution: this.beat.cautions[name] ?? "",
      };
    },
    // An impossible beat is compared with nothing, and a change of what is not determined has no value.
    changeOf(name, value) {
      const before = this.pinned ?? this.base;
      if (before && [this.beat, before].some((beat) => isUndetermined(beat, [name]))) return UNDETERMINED;
      return isPossible(this.beat) && isPossible(before) ? change(value, before?.outputs[name]) : "";
    },
    side(value, low, high) {
      if (value < low) return this.texts.below_range;
      return value > high ? this.texts.above_range : "";
    },
  },
};
