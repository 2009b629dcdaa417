// Where the numbers come from: patient or preset, changed or not, fitted or not. Always in sight.
import { listening } from "eclsim-page";

export default {
  template: `
  <p v-if="provenance" class="ecl-provenance" :class="provenance.level" role="note"
    :aria-label="texts.provenance">
    <b class="badge">{{ provenance.badge }}</b> <b class="title">{{ provenance.title }}</b> <span
      :title="provenance.text">{{ provenance.text }}</span>
  </p>`,
  mixins: [
    listening({
      state(state) {
        this.provenance = state.provenance;
      },
    }),
  ],
  data: () => ({ provenance: null }),
};
