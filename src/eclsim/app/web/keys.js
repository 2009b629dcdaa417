// Key figures, always visible: if the page scrolls, in a strip below its header.
import {
  MISSING,
  SIGNS,
  UNDETERMINED,
  aboutSign,
  careOf,
  doubtOf,
  fill,
  fixed,
  gravest,
  isPossible,
  isUndetermined,
  listening,
  signed,
} from "eclsim-page";

const FIGURES_IN_STRIP = 8; // figures of the strip, in addition to those that exceed a limit

export default {
  template: `
  <div>
  <dl class="ecl-keys" ref="tiles">
    <div v-for="k in seen" :key="k.key" :class="k.level" :title="k.hint" :data-key="k.key">
      <dt><span v-if="k.caution" role="img" :aria-label="k.hint">† </span>{{ k.label }}</dt>
      <dd><i v-if="k.sign" class="sign" role="img" :aria-label="texts['kind_' + k.level]">{{
        k.sign }}</i><b :class="{ long: k.value.length > 4, longest: k.value.length > 4 && k.sign }">{{
        k.value }}</b></dd>
      <dd class="more">{{ k.unit }}<em v-for="m in k.more" :key="m">{{ m }}</em></dd>
    </div>
  </dl>
  <div v-if="away" class="ecl-strip" ref="strip" aria-hidden="true">
    <span v-for="k in brief" :key="k.key" :class="k.level" :title="k.hint"><small>{{
      k.caution ? "† " : "" }}{{ k.label }}</small> <b>{{ k.sign }} {{ k.value }}</b> <small>{{
      k.unit }}</small></span>
    <p v-if="cut || broken" :class="cut ? 'alarm cut' : gravest">{{ cut || broken }}</p>
  </div>
  </div>`,
  mixins: [
    listening({
      cut(cut) {
        this.cut = cut;
      },
      display(display) {
        this.figures = display.figures;
      },
      beat(beat) {
        this.beat = beat;
      },
      pinned(beat) {
        this.pinned = beat;
      },
    }),
  ],
  data: () => ({ figures: [], beat: null, pinned: null, away: false, cut: "" }),
  mounted() {
    const header = document.querySelector(".ecl-header");
    const measure = () => {
      const head = getComputedStyle(header).position === "sticky" ? header.offsetHeight : 0;
      document.documentElement.style.setProperty("--head-height", `${head}px`);
      this.seeing?.disconnect();
      const margin = { rootMargin: `-${head}px 0px 0px 0px` };
      const seen = (changes) => (this.away = !changes.at(-1).isIntersecting);
      this.seeing = new IntersectionObserver(seen, margin);
      this.seeing.observe(this.$refs.tiles);
    };
    this.sizing = new ResizeObserver(measure);
    for (const one of [header, document.documentElement]) this.sizing.observe(one);
  },
  updated() {
    const height = this.$refs.strip?.offsetHeight ?? 0; // what stays in sight stands below it
    document.documentElement.style.setProperty("--strip-height", `${height}px`);
  },
  unmounted() {
    for (const one of [this.seeing, this.sizing]) one?.disconnect();
  },
  computed: {
    brief() {
      return this.seen.filter(({ level }, k) => k < FIGURES_IN_STRIP || level !== "ok");
    },
    // Short text of the exceeded limits, the most serious first.
    broken() {
      const words = this.limits.map(([kind, , brief]) => SIGNS[kind] + brief);
      const first = this.texts[isPossible(this.beat) ? doubtOf(this.beat) : "impossible"];
      return [first, ...words].filter(Boolean).join("; ");
    },
    limits() {
      const { notes = [], brief } = this.beat ?? {};
      return notes.map(([kind, text], k) => [kind, text, brief?.[k]]).filter(([kind]) => kind in SIGNS);
    },
    gravest() {
      return this.limits[0]?.[0] ?? "warning";
    },
    seen() {
      if (!this.beat) return [];
      const { outputs, apart } = this.beat;
      const shown = ({ output, unlike }) =>
        outputs[output] !== undefined && (!unlike || apart.includes(output));
      return this.figures.filter(shown).map((figure) => this.tile(figure));
    },
  },
  methods: {
    tile({ key, label, text: words, unit, digits, output, limits, extremes }) {
      const { outputs, levels, possible } = this.beat;
      const value = outputs[output];
      const level = possible ? gravest(levels, limits) : "collapse";
      const caution = careOf(this.beat, [...limits, output, ...(extremes ?? [])]);
      const about = aboutSign(this.beat, output);
      const ends = (extremes ?? []).map((name) => fixed(outputs[name], 0)).join("/");
      const range = ends && possible ? about + ends : "";
      const text = level === "collapse" ? MISSING : about + fixed(value, digits);
      const measured = this.measuredOf([output], digits) || this.measuredOf(extremes ?? [], 0);
      const { key_measured: sign, key_measured_before: before } = this.texts;
      const isOld = measured && this.beat.measured_before; // there only in the tooltip
      const care = caution ? fill(this.texts.caution, { why: caution }) : "";
      const old = isOld ? fill(before, { values: measured }) : "";
      const hint = [`${words} [${unit}]`, care, old].filter(Boolean).join(", ");
      const beside = measured && !isOld ? `${sign} ${measured}` : "";
      const more = [this.difference(output, value, digits) || range, beside].filter(Boolean);
      return { key, label, unit, level, caution, hint, sign: SIGNS[level].trim(), value: text, more };
    },
    difference(output, value, digits) {
      const before = this.pinned?.outputs[output];
      if (!isPossible(this.beat)) return "";
      if (this.pinned && !isPossible(this.pinned)) return `Δ ${SIGNS.collapse.trim()}`;
      const isOpen = [this.beat, this.pinned].some((beat) => isUndetermined(beat, [output]));
      if (this.pinned && isOpen) return `Δ ${UNDETERMINED}`;
      return Number.isFinite(before) && Number.isFinite(value) ? `Δ ${signed(value - before, digits)}` : "";
    },
    measuredOf(outputs, digits) {
      const measured = outputs.map((name) => this.beat.measured[name]);
      if (this.beat.minute) return ""; // they were measured at the start of the course
      if (!measured.length || measured.includes(undefined)) return "";
      return measured.map((value) => fixed(value, digits)).join("/");
    },
  },
};
