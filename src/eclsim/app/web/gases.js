// Blood gases by site, transfer of each exchanger, oxygen supply and demand, upper and lower body.
import { CARE, SIGNS, bandsOf, careOf, fill, fixed, gravest, seenIn } from "eclsim-page";

const COLUMNS = [
  ["SO2", 1],
  ["PO2", 0],
  ["PCO2", 1],
  ["pH", 2],
  ["O2", 1],
  ["CO2", 1],
];
const SUPPLY = ["DO2", "VO2", "O2ER", "recirculation_fraction"];
const DUAL = [
  ["gases_SO2", "SaO2", "SaO2_lower", 1],
  ["gases_PO2", "PaO2", "PaO2_lower", 0],
  ["gases_PCO2", "PaCO2", "PaCO2_lower", 1],
  ["gases_native", "native_share_upper", "native_share_lower", 0],
  ["gases_flow", "upper_body_flow", "lower_body_flow", 2],
];

export default {
  template: `
  <div class="ecl-gases">
    <div v-if="beat && !beat.gas" class="none" role="status">
      <p>{{ texts.gases_off }}</p>
      <button type="button" @click="$emit('connect')">{{ texts.gases_on }}</button>
    </div>
    <p v-else-if="beat && !known" class="none bad" role="status">{{ why }}</p>
    <template v-else-if="beat">
      <div class="scroll" tabindex="0" role="region" :aria-label="texts.gases_samples"><table>
        <caption>{{ texts.gases_samples }}</caption>
        <thead><tr>
          <th scope="col">{{ texts.gases_site }}</th>
          <th v-for="[name] in columns" :key="name" scope="col" class="n">{{ texts["gases_" + name] }}</th>
        </tr></thead>
        <tbody><tr v-for="s in sites" :key="s.place" :data-place="s.place">
          <th scope="row"><i class="blood" :style="{ background: s.colour }"></i>{{ s.label }}</th>
          <td v-for="c in s.cells" :key="c.name" :class="['n', c.level]"
            ><span v-if="c.care" role="img" :aria-label="c.care" :title="c.care">{{ care }}</span
            >{{ c.text }}<small v-if="c.band"
            >{{ c.band }}</small></td>
        </tr></tbody>
      </table></div>
      <div class="pair">
        <table>
          <caption>{{ texts.gases_exchange }}</caption>
          <thead><tr><th scope="col">{{ texts.gases_where }}</th>
            <th scope="col" class="n">{{ texts.gases_uptake }}</th>
            <th scope="col" class="n">{{ texts.gases_removal }}</th></tr></thead>
          <tbody><tr v-for="e in exchanged" :key="e.label" :class="{ sum: e.sum }">
            <th scope="row">{{ e.label }}</th><td class="n">{{ e.uptake }}</td>
            <td class="n">{{ e.removal }}</td>
          </tr></tbody>
        </table>
        <table>
          <caption>{{ texts.gases_supply }}</caption>
          <tbody><tr v-for="r in supply" :key="r.name">
            <th scope="row" :title="r.definition">{{ r.label }}</th>
            <td :class="['n', r.level]"
              ><span v-if="r.care" role="img" :aria-label="r.care" :title="r.care">{{ care }}</span
              >{{ r.text }}<small v-if="r.band">{{ r.band }}</small></td>
            <td>{{ r.unit }}</td>
          </tr></tbody>
        </table>
        <table v-if="dual.length" class="dual">
          <caption>{{ texts.gases_dual }}</caption>
          <thead><tr><th></th><th scope="col" class="n">{{ texts.gases_upper }}</th>
            <th scope="col" class="n">{{ texts.gases_lower }}</th></tr></thead>
          <tbody><tr v-for="r in dual" :key="r.label"><th scope="row">{{ r.label }}</th>
            <td v-for="c in r.cells" :key="c.name" :class="['n', c.level]"
            ><span v-if="c.care" role="img" :aria-label="c.care" :title="c.care">{{ care }}</span
            >{{ c.text }}<small v-if="c.band"
              >{{ c.band }}</small></td>
          </tr></tbody>
        </table>
      </div>
    </template>
  </div>`,
  props: { specs: Object },
  mixins: [
    seenIn("gases", {
      display({ samples, exchangers }) {
        Object.assign(this, { samples, exchangers });
      },
      bands(bands) {
        this.bands = bands;
      },
    }),
  ],
  data: () => ({ beat: null, bands: null, samples: [], exchangers: {}, columns: COLUMNS, care: `${CARE} ` }),
  computed: {
    known() {
      return Object.keys(this.beat.gas.places).length > 0;
    },
    why() {
      return fill(this.texts.gases_none, { why: this.beat.gas.message });
    },
    sites() {
      const { means, gas } = this.beat;
      const { places } = gas;
      const against = (place) => {
        if (places[place].standing) return ` (${this.texts.gases_standing})`;
        return means[`Q${place}`] < 0 ? ` (${this.texts.gases_backwards})` : "";
      };
      return this.samples
        .filter(({ place }) => places[place])
        .map(({ place, label, outputs }) => {
          const { values, colour } = places[place];
          const cells = COLUMNS.map(([name, digits]) => this.cell(name, values[name], digits, outputs[name]));
          return { place, label: label + against(place), colour, cells };
        });
    },
    exchanged() {
      const rows = Object.entries(this.beat.gas.exchanged);
      const row = (label, uptake, gained, sum) => ({
        label,
        sum,
        uptake: fixed(uptake, 0),
        removal: fixed(-gained, 0),
      });
      const total = [0, 1].map((k) => rows.reduce((all, [, both]) => all + both[k], 0));
      return [
        ...rows.map(([at, [uptake, gained]]) => row(this.exchangers[at] ?? at, uptake, gained, false)),
        row(this.texts.gases_sum, ...total, true),
      ];
    },
    supply() {
      const { outputs } = this.beat;
      return SUPPLY.filter((name) => outputs[name] !== undefined).map((name) => {
        const { label, unit, definition } = this.specs[name];
        const cell = this.cell(name, outputs[name], unit === "1" ? 3 : 0, name);
        return { ...cell, label, unit: unit === "1" ? "" : unit, definition };
      });
    },
    dual() {
      const { outputs } = this.beat;
      if (outputs.SaO2_lower === undefined) return [];
      return DUAL.filter(([, upper]) => outputs[upper] !== undefined).map(
        ([label, upper, lower, digits]) => ({
          label: this.texts[label],
          cells: [upper, lower].map((name) => this.cell(name, outputs[name], digits, name)),
        }),
      );
    },
  },
  methods: {
    // A number with a sign for the limit that it exceeds, what to know of reading it, and its 90 % band.
    cell(name, value, digits, output) {
      const level = output ? gravest(this.beat.levels, [output]) : "ok";
      const sides = (output && this.bands && bandsOf(this.beat)?.outputs[output]) || [];
      const band = sides.map((side) => fixed(side, digits)).join("–");
      const why = output && value !== null ? careOf(this.beat, [output]) : "";
      const care = why && fill(this.texts.caution, { why });
      return { name, level, care, text: SIGNS[level] + fixed(value, digits), band };
    },
  },
};
