// Whose numbers the page shows: patient or preset, changed or not, fitted or not. Always in sight.
import { bus, words } from "eclsim-page";

export default {
  template: `
  <p v-if="whose" class="ecl-whose" :class="whose.level" role="status" :aria-label="words.whose">
    <b class="badge">{{ whose.badge }}</b> <b class="title">{{ whose.title }}</b> <span :title="whose.text">{{ whose.text }}</span>
  </p>`,
  data: () => ({ words, whose: null }),
  mounted() {
    this.words = words;
    this.stop = bus.on("state", (state) => (this.whose = state.whose));
  },
  unmounted() {
    this.stop();
  },
};
