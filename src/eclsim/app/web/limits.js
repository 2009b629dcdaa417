// The limits that the beat exceeds, the most serious first, visible in every view; and cautions.
import { SIGNS, fewOf, fill, limitsOf, listening, sized } from "eclsim-page";

const MOST_NAMED = 6; // outputs in the heading of the cautions

export default {
  template: `
  <section class="ecl-limits" ref="list" :class="{ impossible: !possible }" :aria-label="texts.alarms"
    tabindex="0" @scroll.passive="measure">
    <div class="list">
      <p v-if="!possible" class="verdict"><b>✕ {{ texts.impossible_long }}</b></p>
      <p v-else-if="isOpen" class="verdict open"><b>{{ texts.undetermined_long }}</b></p>
      <p v-if="second" class="verdict open"><b>{{ other }}</b></p>
      <p v-if="judged && !broken.length && !isOpen && !second" class="quiet">✓ {{ texts.no_alarms }}</p>
      <p v-for="[kind, text] in broken" :key="text" :class="kind"><b>{{ signs[kind] }}</b>{{ text }}</p>
    </div>
    <details v-if="cautions.length"><summary ref="remarks">† {{ heading }}</summary>
      <p v-for="text in cautions" :key="text">{{ text }}</p>
    </details>
    <p v-if="more" class="further">▼ {{ more }}</p>
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
        this.isOpen = beat.undetermined.length > 0;
        this.second = beat.second;
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
    second: "", // flows of another steady beat at the same settings
    isOpen: false, // some numbers are not determined
    broken: [],
    cautions: [],
    concerned: [],
    labels: {},
    hidden: 0,
    areRemarksHidden: false,
  }),
  methods: {
    // If the exceeded limits change, scroll the list back to the most serious ones.
    toTop() {
      const which = limitsOf(this.broken);
      if (which !== this.which) this.$refs.list?.scrollTo({ top: 0 });
      this.which = which;
      this.measure();
    },
    // Number of lines hidden below the edge of the list, and whether the cautions are.
    measure() {
      const { list, remarks } = this.$refs;
      if (!list) return;
      const edge = list.getBoundingClientRect().bottom;
      const isBelow = (line) => line.getBoundingClientRect().bottom > edge + 2;
      this.hidden = [...list.querySelectorAll(".list p")].filter(isBelow).length;
      this.areRemarksHidden = !!remarks && isBelow(remarks);
    },
  },
  computed: {
    more() {
      if (!this.hidden) return this.areRemarksHidden ? `† ${this.heading}` : "";
      const lines = fill(this.texts.alarms_more, { hidden: this.hidden, all: this.broken.length });
      return this.areRemarksHidden ? `${lines} †` : lines;
    },
    other() {
      return fill(this.texts.one_of_two_long, { other: this.second });
    },
    // Outputs by the label of their tile, their short name, or their symbol in the paper, if they have one.
    heading() {
      const symbol = (name) => (name === name.toUpperCase() ? name : "");
      const short = (name) => this.labels[name] ?? this.texts[`short_${name}`] ?? symbol(name);
      const [tiles, others] = [true, false].map((has) =>
        this.concerned.filter((n) => n in this.labels === has),
      );
      const names = new Set([...tiles, ...others].map(short).filter(Boolean));
      const few = fewOf([...names], MOST_NAMED, this.texts.provenance_more);
      return fill(this.texts.cautions, { names: few || this.texts.cautions_further });
    },
  },
};
