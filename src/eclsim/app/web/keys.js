// The numbers that matter most, always in sight.
import { bus, fixed, words } from "eclsim-page";

const KEYS = [
  { key: "MAP", unit: "mmHg", digits: 0, of: (o) => o.MAP, node: "ao", more: (o) => `${fixed(o.SP, 0)}/${fixed(o.DP, 0)}` },
  { key: "CO", unit: "L/min", digits: 2, of: (o) => o.CO },
  { key: "PF", unit: "L/min", digits: 2, of: (o) => o.PF },
  { key: "lvad_flow", unit: "L/min", digits: 2, of: (o) => o.lvad_flow },
  { key: "MPAP", unit: "mmHg", digits: 0, of: (o) => o.MPAP, node: "pas" },
  { key: "PCWP", unit: "mmHg", digits: 0, of: (o) => o.PCWP, node: "pvn" },
  { key: "CVP", unit: "mmHg", digits: 0, of: (o) => o.right_atrial_pressure, node: "ra" },
  { key: "EF", unit: "%", digits: 0, of: (o) => o.ejection_fraction_lv },
];
const SIGNS = { ok: "", warning: "!", alarm: "▲" };

export default {
  template: `
  <dl class="ecl-keys">
    <div v-for="k in seen" :key="k.key" :class="k.level" :title="k.unit">
      <dt>{{ words['key_' + k.key] }}</dt>
      <dd><b>{{ k.sign }}{{ k.text }}</b></dd>
      <dd class="more"><em v-if="k.change || k.more">{{ k.change ? 'Δ ' + k.change : k.more }}</em><template v-else>{{ k.unit }}</template></dd>
    </div>
  </dl>`,
  data: () => ({ words, seen: [] }),
  mounted() {
    this.words = words;
    this.stops = [
      bus.on("beat", (beat) => this.show((this.beat = beat))),
      bus.on("pinned", (beat) => {
        this.pinned = beat;
        if (this.beat) this.show(this.beat);
      }),
    ];
  },
  unmounted() {
    for (const stop of this.stops) stop();
  },
  methods: {
    show(beat) {
      this.seen = KEYS.filter((k) => k.of(beat.outputs) !== undefined).map((k) => {
        const value = k.of(beat.outputs);
        const level = (k.node && beat.levels[k.node]) || "ok";
        const old = this.pinned && k.of(this.pinned.outputs);
        const difference = old === undefined || old === null ? null : value - old;
        const change = difference === null ? "" : `${difference >= 0 ? "+" : ""}${fixed(difference, k.digits)}`;
        return { key: k.key, unit: k.unit, text: fixed(value, k.digits), level, sign: SIGNS[level], change, more: k.more?.(beat.outputs) ?? "" };
      });
    },
  },
};
