// Explanation and reliability of the bands, in views that have any if there is a posterior.
import { fill, leftOut, listening, timeOf } from "eclsim-page";

const TOPICS = { monitor: "bands", loops: "bands", gases: "bands", outputs: "bands", ramp: "ramp_bands" };
const SMALLEST_SHARE = 0.9; // of the draws: a band of fewer is one of a part of what is possible
const summary = (bands) => {
  if (!bands) return bands;
  const { of, failed, count, lost, impossible, fewest } = bands;
  return { of, failed, count, lost, impossible, fewest, loops: bands.loops?.lv?.length };
};

export default {
  template: `
  <div v-if="posterior && topic" class="ecl-bands" role="group" :aria-label="texts.bands_label">
    <span class="what">{{ what }}<b v-if="without" :class="{ bad: isThin }">{{
      without }}</b></span>
    <span>{{ posterior.method }}</span>
    <span :class="['trust', { bad: !posterior.trusted }]" :title="posterior.doubts.join('; ')">{{
      trust }}</span>
    <button type="button" @click="toggle">{{ on ? texts.bands_hide : texts.bands_show }}</button>
  </div>`,
  mixins: [
    listening({
      posterior(posterior) {
        this.posterior = posterior;
      },
      view(view) {
        this.view = view;
      },
      beat(beat) {
        this.beat = beat.of;
        this.time = timeOf(beat);
        this.gases = !!beat.gas;
      },
      bands(bands) {
        this.bands = summary(bands);
      },
      ramp_bands(bands) {
        this.ramp_bands = summary(bands);
      },
    }),
  ],
  data: () => ({
    posterior: null,
    on: true,
    view: "",
    beat: "",
    time: "",
    gases: false,
    bands: null,
    ramp_bands: null,
  }),
  computed: {
    topic() {
      return TOPICS[this.view];
    },
    trust() {
      const { trusted, checked, doubts } = this.posterior;
      if (!trusted) return `${this.texts.posterior_doubted}: ${doubts.join("; ")}`;
      return checked ? this.texts.posterior_trusted : this.texts.posterior_without;
    },
    what() {
      if (!this.on) return "";
      if (this.time && this.topic === "bands") return fill(this.texts.bands_start, { time: this.time });
      const bands = this[this.topic];
      if (bands?.of !== this.beat) return this.texts.bands_computing;
      if (bands.failed) return this.texts.bands_failed;
      if (!bands.count) return "";
      const { count, loops = 0, fewest } = bands;
      const text = this.view === "loops" ? this.texts.bands_loops : this.texts.bands_what;
      return fill(text, { count: fewest, loops, all: count });
    },
    // Draws not in the band: those without a beat, or with one that is impossible in a patient.
    without() {
      const bands = this[this.topic];
      const shown = this.on && bands?.of === this.beat && !(this.time && this.topic === "bands");
      return shown && bands.count ? leftOut(this.texts, bands, this.gases) : "";
    },
    isThin() {
      const { count, fewest } = this[this.topic];
      return fewest < SMALLEST_SHARE * count;
    },
  },
  methods: {
    toggle() {
      this.on = !this.on;
      this.$emit("show", { on: this.on });
    },
  },
};
