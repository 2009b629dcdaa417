// The numbers that matter most, always in sight.
import { bus, fixed, words } from "eclsim-page";

const KEYS = [
  { key: "MAP", unit: "mmHg", digits: 0, of: (o) => o.MAP, limits: ["MAP", "pulse_pressure"], more: (o) => `${fixed(o.SP, 0)}/${fixed(o.DP, 0)}` },
  { key: "CO", unit: "L/min", digits: 2, of: (o) => o.CO, limits: ["CO"] },
  { key: "LVO", unit: "L/min", digits: 2, of: (o, beat) => (beat.cautions.CO ? o.LVO : undefined), limits: ["LVO"] },
  { key: "PF", unit: "L/min", digits: 2, of: (o) => o.PF, limits: ["PF"] },
  { key: "lvad_flow", unit: "L/min", digits: 2, of: (o) => o.lvad_flow, limits: ["lvad_flow"] },
  { key: "MPAP", unit: "mmHg", digits: 0, of: (o) => o.MPAP, limits: ["MPAP"] },
  { key: "PCWP", unit: "mmHg", digits: 0, of: (o) => o.PCWP, limits: ["PCWP"] },
  { key: "CVP", unit: "mmHg", digits: 0, of: (o) => o.right_atrial_pressure, limits: ["right_atrial_pressure"] },
  { key: "EF", unit: "%", digits: 0, of: (o) => o.ejection_fraction_lv, limits: ["ejection_fraction_lv"] },
];
const SIGNS = { ok: "", warning: "!", alarm: "▲", collapse: "✕" };
const GRAVEST = ["collapse", "alarm", "warning"];

export default {
  template: `
  <dl class="ecl-keys">
    <div v-for="k in seen" :key="k.key" :class="k.level" :title="k.hint" :data-key="k.key">
      <dt><span v-if="k.caution" role="img" :aria-label="k.hint">† </span>{{ words['key_' + k.key] }}</dt>
      <dd><b>{{ k.sign }}{{ k.text }}</b></dd>
      <dd class="more"><em v-if="k.more">{{ k.more }}</em><template v-else>{{ k.unit }}</template></dd>
    </div>
  </dl>`,
  data: () => ({ words, seen: [] }),
  mounted() {
    this.words = words;
    this.stops = [
      bus.on("beat", (beat) => this.show((this.beat = beat))),
      bus.on("state", ({ whose }) => {
        this.measured = whose.measured;
        if (this.beat) this.show(this.beat);
      }),
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
      this.seen = KEYS.filter((k) => k.of(beat.outputs, beat) !== undefined).map((k) => {
        const value = k.of(beat.outputs, beat);
        const level = GRAVEST.find((kind) => k.limits.some((name) => beat.levels[name] === kind)) ?? "ok";
        const caution = k.limits.map((name) => beat.cautions[name]).find(Boolean);
        const hint = caution ? `${k.unit}, ${words.caution.replace("{why}", caution)}` : k.unit;
        const old = this.pinned && k.of(this.pinned.outputs, beat);
        const difference = old === undefined || old === null ? null : value - old;
        const change = difference === null ? "" : `Δ ${difference >= 0 ? "+" : ""}${fixed(difference, k.digits)}`;
        const measured = this.measured?.[k.key] === undefined ? "" : `${words.key_measured} ${fixed(this.measured[k.key], k.digits)}`;
        return { key: k.key, unit: k.unit, caution, hint, text: level === "collapse" ? " –" : fixed(value, k.digits), level, sign: SIGNS[level], more: change || measured || (k.more?.(beat.outputs) ?? "") };
      });
    },
  },
};
