// The numbers that matter most, always in sight.
import { MISSING, SIGNS, fill, fixed, gravest, isPossible, listening, signed } from "eclsim-page";

export default {
  template: `
  <dl class="ecl-keys">
    <div v-for="k in seen" :key="k.key" :class="k.level" :title="k.hint" :data-key="k.key">
      <dt><span v-if="k.caution" role="img" :aria-label="k.hint">† </span>{{ k.label }}</dt>
      <dd><i v-if="k.sign" class="sign">{{ k.sign }}</i><b :class="{ long: k.value.length > 4 }">{{
        k.value }}</b></dd>
      <dd class="more">{{ k.unit }}<em v-for="m in k.more" :key="m">{{ m }}</em></dd>
    </div>
  </dl>`,
  mixins: [
    listening({
      display(display) {
        this.figures = display.figures;
      },
      beat(beat) {
        this.beat = beat;
      },
      state({ provenance }) {
        this.measured = provenance.measured;
      },
      pinned(beat) {
        this.pinned = beat;
      },
    }),
  ],
  data: () => ({ figures: [], beat: null, measured: {}, pinned: null }),
  computed: {
    seen() {
      if (!this.beat) return [];
      const { outputs, cautions } = this.beat;
      const shown = (figure) =>
        outputs[figure.output] !== undefined && (!figure.only_with || figure.only_with in cautions);
      return this.figures.filter(shown).map((figure) => this.tile(figure));
    },
  },
  methods: {
    tile({ key, label, text: words, unit, digits, output, limits, extremes }) {
      const { outputs, levels, cautions, possible } = this.beat;
      const value = outputs[output];
      const level = possible ? gravest(levels, limits) : "collapse";
      const caution = limits.map((name) => cautions[name]).find(Boolean);
      const full = `${words} [${unit}]`;
      const hint = caution ? `${full}, ${fill(this.texts.caution, { why: caution })}` : full;
      const range = extremes && possible ? extremes.map((name) => fixed(outputs[name], 0)).join("/") : "";
      const text = level === "collapse" ? MISSING : fixed(value, digits);
      const measured = this.asMeasured([output], digits) || this.asMeasured(extremes ?? [], 0);
      const more = [this.difference(output, value, digits) || range, measured].filter(Boolean);
      return { key, label, unit, level, caution, hint, sign: SIGNS[level].trim(), value: text, more };
    },
    difference(output, value, digits) {
      const before = this.pinned?.outputs[output];
      if (!isPossible(this.beat)) return "";
      if (this.pinned && !isPossible(this.pinned)) return `Δ ${SIGNS.collapse.trim()}`;
      return Number.isFinite(before) ? `Δ ${signed(value - before, digits)}` : "";
    },
    asMeasured(outputs, digits) {
      const measured = outputs.map((name) => this.measured[name]);
      if (!measured.length || measured.includes(undefined)) return "";
      return `${this.texts.key_measured} ${measured.map((value) => fixed(value, digits)).join("/")}`;
    },
  },
};
