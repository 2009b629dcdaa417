// Origin of the numbers: patient or preset, changed or not, fitted or not. Always visible.
import { fill, listening, onPrint } from "eclsim-page";

export default {
  template: `
  <p v-if="provenance" class="ecl-provenance" :class="provenance.level" role="note"
    :aria-label="texts.provenance">
    <b class="badge">{{ provenance.badge }}</b> <b class="title" :title="provenance.title">{{
      provenance.title }}</b> <span
      :title="provenance.text">{{ provenance.text }}</span>
    <span class="ecl-printed"><br />{{ printed }}</span>
  </p>`,
  mixins: [
    listening({
      state(state) {
        this.provenance = state.provenance;
      },
    }),
  ],
  data: () => ({ provenance: null, printed: "" }),
  // A printed page says when and by which program it was printed.
  mounted() {
    const { printed, version } = this.texts;
    const now = () => new Date().toLocaleString("sv-SE", { timeZoneName: "short" });
    this.stop = onPrint((on) => {
      if (on) this.printed = fill(fill(printed, { version }), { time: now() });
    });
  },
  unmounted() {
    this.stop();
  },
};
