// The limits that the beat exceeds, the most serious first, visible in every view; and cautions.
import { SIGNS, fill, limitsOf, listening, sized } from "eclsim-page";

export default {
  template: `
  <section class="ecl-limits" ref="list" :class="{ impossible: !possible }" :aria-label="texts.alarms"
    tabindex="0" @scroll.passive="measure">
    <div class="list">
      <p v-if="!possible" class="verdict"><b>✕ {{ texts.impossible_long }}</b></p>
      <p v-if="judged && !broken.length" class="quiet">✓ {{ texts.no_alarms }}</p>
      <p v-for="[kind, text] in broken" :key="text" :class="kind"><b>{{ signs[kind] }}</b>{{ text }}</p>
    </div>
    <details v-if="cautions.length"><summary>† {{ heading }}</summary>
      <p v-for="text in cautions" :key="text">{{ text }}</p>
    </details>
    <p v-if="hidden" class="further">▼ {{ more }}</p>
  </section>`,
  mixins: [
    sized("list"),
    listening({
      display(display) {
        this.labels = Object.fromEntries(display.figures.map((figure) => [figure.output, figure.label]));
      },
      beat(beat) {
        this.judged = true;
        this.possible = beat.possible;
        this.broken = beat.notes.filter(([kind]) => kind !== "caution");
        this.cautions = beat.notes.filter(([kind]) => kind === "caution").map(([, text]) => text);
        this.concerned = Object.keys(beat.cautions);
        this.$nextTick(() => this.toTop());
      },
    }),
  ],
  data: () => ({
    signs: SIGNS,
    judged: false, // until there is a beat
    possible: true,
    broken: [],
    cautions: [],
    concerned: [],
    labels: {},
    hidden: 0,
  }),
  methods: {
    // If the exceeded limits change, scroll the list back to the most serious ones.
    toTop() {
      const which = limitsOf(this.broken);
      if (which !== this.which) this.$refs.list?.scrollTo({ top: 0 });
      this.which = which;
      this.measure();
    },
    // Number of limits hidden below the edge of the list.
    measure() {
      const { list } = this.$refs;
      if (!list) return;
      const edge = list.getBoundingClientRect().bottom;
      const lines = [...list.querySelectorAll(".list p")];
      this.hidden = lines.filter((line) => line.getBoundingClientRect().bottom > edge + 2).length;
    },
  },
  computed: {
    more() {
      return fill(this.texts.alarms_more, { hidden: this.hidden, all: this.broken.length });
    },
    // Symbols of the paper unchanged; other outputs by the label of their tile, if they have one.
    heading() {
      const short = (name) => (name === name.toUpperCase() ? name : this.labels[name]);
      const names = new Set(this.concerned.map(short).filter(Boolean));
      return fill(this.texts.cautions, { names: [...names].join(", ") });
    },
  },
};
