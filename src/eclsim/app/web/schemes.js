// The nine schemes of the paper as small multiples; one press connects the CRRT that way.
import { bus, fixed, niceRange, ticks, words } from "eclsim-page";

const W = 164, H = 112, L = 40, R = 4, T = 9, B = 7;
const SIGNS = { ok: "", warning: "! ", alarm: "▲ ", collapse: "✕ " };

export default {
  template: `
  <div class="ecl-schemes">
    <p v-if="empty" class="ecl-empty">{{ words.schemes_none }}</p>
    <template v-else>
      <p class="head">{{ head }}<br /><span class="access">━ {{ words.scheme_access }}</span> <span class="return">╌ {{ words.scheme_return }}</span> <span class="limit">┄ {{ words.scheme_limits }}</span> · {{ words.scheme_h }}</p>
      <div class="grid">
        <button v-for="c in cells" :key="c.letter" type="button" :class="{ own: c.own }" :aria-pressed="c.own" :title="say(c)" @click="$emit('use', { access: c.access_site, giving: c.return_site })">
          <span class="title"><b>{{ c.letter }}</b> {{ c.name }}<span class="unit">mmHg</span></span>
          <svg viewBox="0 0 ${W} ${H}" aria-hidden="true">
            <g v-for="t in c.ticks" :key="t.v"><line x1="${L}" x2="${W - R}" :y1="t.y" :y2="t.y" class="tick" /><text x="${L - 3}" :y="t.y + 4">{{ t.text }}</text></g>
            <line v-for="y in c.limits" :key="y" x1="${L}" x2="${W - R}" :y1="y" :y2="y" class="limit" />
            <path v-for="p in c.paths" :key="p.name" :d="p.d" :class="p.name" />
          </svg>
          <span v-if="c.converged" class="values">
            <span v-for="line in ['access', 'return']" :key="line" :class="[line, c[line].level]">{{ words['scheme_' + line] }} <b>{{ value(c[line]) }}</b> mmHg</span>
            <span>MAP <b>{{ number(c.MAP, 0) }}</b> mmHg</span>
          </span>
          <span v-else class="values"><span class="alarm">{{ words.not_converged }}</span></span>
        </button>
      </div>
    </template>
  </div>`,
  data: () => ({ words, cells: [], empty: false, head: "" }),
  mounted() {
    this.words = words;
    this.stops = [
      bus.on("pinned", (beat) => {
        this.pinned = beat;
        if (this.found) this.show(this.found);
      }),
      bus.on("schemes_pinned", () => {
        if (this.found) this.show(this.found);
      }),
      bus.on("schemes", (found) => this.show(found)),
      bus.on("state", (state) => {
        this.own = [state.values["crrt.access_site"], state.values["crrt.return_site"]].join();
        this.mark();
      }),
    ];
  },
  unmounted() {
    for (const stop of this.stops) stop();
  },
  methods: {
    number: fixed,
    value: (line) => `${SIGNS[line.level]}${fixed(line.mean, 0)}`,
    say(c) {
      const text = words.scheme_use.replace("{letter}", c.letter).replace("{name}", c.name);
      return text;
    },
    mark() {
      for (const c of this.cells) c.own = [c.access_site, c.return_site].join() === this.own;
    },
    show(found) {
      this.found = found;
      this.empty = !found;
      if (!found) return;
      const kept = bus.last("schemes_pinned");
      const old = kept && kept.of === this.pinned?.of ? kept : undefined;
      this.head = words.schemes_flow.replace("{flow}", fixed(found.flow, 0));
      const all = found.cells.flatMap((c) => [...c.access.wave, ...c.return.wave]).filter(Number.isFinite);
      this.range = niceRange(Math.min(...all), Math.max(...all), this.range);
      const [low, high] = this.range;
      const y = (v) => T + (1 - (v - low) / (high - low)) * (H - T - B);
      const path = (wave) => wave.map((v, k) => `${k ? "L" : "M"}${(L + (k / (wave.length - 1)) * (W - L - R)).toFixed(1)} ${y(v ?? low).toFixed(1)}`).join("");
      const marks = ticks(low, high, 3).map((v) => ({ v, y: y(v), text: fixed(v, 0) }));
      const limits = [...found.limits.access, ...found.limits.return].filter((v) => v > low && v < high).map(y);
      this.cells = found.cells.map((c, k) => ({
        ...c, own: false, ticks: marks, limits,
        paths: [
          ...(old ? [{ name: "shadow", d: path(old.cells[k].access.wave) }, { name: "shadow2", d: path(old.cells[k].return.wave) }] : []),
          { name: "access", d: path(c.access.wave) }, { name: "return", d: path(c.return.wave) },
        ],
      }));
      this.mark();
    },
  },
};
