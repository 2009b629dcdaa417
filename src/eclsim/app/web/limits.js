// The limits that the beat breaks, the gravest first, in sight in every view; and how its numbers are to be read.
import { bus, words } from "eclsim-page";

export const SIGNS = { ok: "", warning: "! ", alarm: "▲ ", collapse: "✕ " };

export default {
  template: `
  <section class="ecl-limits" :class="{ impossible: !possible }" :aria-label="words.alarms" tabindex="0">
    <div role="status">
      <p v-if="!possible" class="verdict"><b>✕ {{ words.impossible_long }}</b></p>
      <p v-if="!broken.length" class="quiet">✓ {{ words.no_alarms }}</p>
      <p v-for="[kind, text] in broken" :key="text" :class="kind"><b>{{ signs[kind] }}</b>{{ text }}</p>
    </div>
    <details v-if="cautions.length"><summary>† {{ words.cautions.replace('{names}', named) }}</summary>
      <p v-for="text in cautions" :key="text">{{ text }}</p>
    </details>
  </section>`,
  data: () => ({ words, signs: SIGNS, possible: true, broken: [], cautions: [], named: "" }),
  mounted() {
    this.words = words;
    this.stop = bus.on("beat", (beat) => {
      this.possible = beat.possible;
      this.broken = beat.notes.filter(([kind]) => kind !== "caution");
      this.cautions = beat.notes.filter(([kind]) => kind === "caution").map(([, text]) => text);
      const short = (name) => (name === "ejection_fraction_lv" ? words.key_EF : name === name.toUpperCase() ? name : "");
      this.named = Object.keys(beat.cautions).map(short).filter(Boolean).join(", ");
    });
  },
  unmounted() {
    this.stop();
  },
};
