// What the bands of the views are, and whether they are to be trusted; seen only where there is a posterior.
import { bus, words } from "eclsim-page";

const TOPICS = { monitor: "bands", loops: "bands", outputs: "bands", ramp: "ramp_bands" };

export default {
  template: `
  <div v-if="posterior" class="ecl-bands" role="group" :aria-label="words.bands_label">
    <span v-if="topic" class="what" role="status">{{ what }}</span>
    <span>{{ posterior.method }}</span>
    <span :class="['trust', { bad: !posterior.trusted }]" :title="posterior.doubts.join('; ')">{{ trust }}</span>
    <button type="button" @click="toggle">{{ on ? words.bands_hide : words.bands_show }}</button>
  </div>`,
  data: () => ({ words, posterior: null, on: true, view: "", beat: "", found: {} }),
  computed: {
    topic() {
      return TOPICS[this.view];
    },
    trust() {
      if (!this.posterior.trusted) return `${words.posterior_doubted}: ${this.posterior.doubts.join("; ")}`;
      return this.posterior.checked ? words.posterior_trusted : words.posterior_without;
    },
    what() {
      if (!this.on) return "";
      const found = this.found[this.topic];
      if (found?.of !== this.beat) return words.bands_computing;
      if (!found.count) return "";
      const text = this.view === "loops" ? words.bands_loops : words.bands_what;
      const lost = found.lost ? ", " + words.bands_lost.replace("{lost}", found.lost) : "";
      return text.replace("{count}", found.count).replace("{loops}", found.drawn) + lost;
    },
  },
  mounted() {
    this.words = words;
    const keep = ({ of, count, lost, loops }) => ({ of, count, lost, drawn: loops?.lv?.length });
    this.stops = [
      bus.on("posterior", (posterior) => (this.posterior = posterior)),
      bus.on("view", (view) => (this.view = view)),
      bus.on("beat", (beat) => (this.beat = beat.of)),
      ...["bands", "ramp_bands"].map((topic) => bus.on(topic, (found) => (this.found = { ...this.found, [topic]: found && keep(found) }))),
    ];
  },
  unmounted() {
    for (const stop of this.stops) stop();
  },
  methods: {
    toggle() {
      this.on = !this.on;
      this.$emit("show", { on: this.on });
    },
  },
};
