// The nine schemes of the paper as small multiples; a click connects the lines in that way.
import { SIGNS, bus, extent, fill, fixed, niceRange, studied, studyNotes, ticks } from "eclsim-page";

const [WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM] = [164, 112, 40, 4, 9, 7];
const LINES = ["access", "return"];

export default {
  template: `
  <div class="ecl-schemes">
    ${studyNotes("schemes_none")}
    <template v-if="study">
      <p class="head">{{ heading }}<br />
        <span v-for="line in ['access', 'return', 'limits']" :key="line" :class="line">{{
          { access: '━', return: '╌', limits: '┄' }[line] }} {{ texts['scheme_' + line] }}</span>
        · {{ texts.scheme_h }}</p>
      <div :class="['grid', { 'ecl-old': isOld }]">
        <button v-for="c in cells" :key="c.letter" type="button" :class="{ own: isOwn(c) }"
          :aria-pressed="isOwn(c)" :title="about(c)"
          @click="$emit('use', { device, settings: c.settings })">
          <span class="title"><b>{{ c.letter }}</b> {{ c.name }}<span class="unit">mmHg</span></span>
          <svg viewBox="0 0 ${WIDTH} ${HEIGHT}" aria-hidden="true">
            <g v-for="t in c.ticks" :key="t.value">
              <line x1="${LEFT}" x2="${WIDTH - RIGHT}" :y1="t.y" :y2="t.y" class="tick" />
              <text x="${LEFT - 3}" :y="t.y + 4">{{ t.text }}</text>
            </g>
            <line v-for="y in c.limits" :key="y" x1="${LEFT}" x2="${WIDTH - RIGHT}" :y1="y" :y2="y"
              class="limit" />
            <path v-for="p in c.paths" :key="p.name" :d="p.d" :class="p.name" />
          </svg>
          <span v-if="c.converged && c.possible" class="values">
            <span v-for="line in ['access', 'return']" :key="line" :class="[line, c[line].level]">{{
              texts['scheme_' + line] }} <b>{{ value(c[line]) }}</b> mmHg</span>
            <span :class="c.MAP.level">MAP <b>{{ value(c.MAP) }}</b> mmHg</span>
          </span>
          <span v-else class="values"><span class="alarm">{{
            texts[whyNot(c)] }}</span></span>
        </button>
      </div>
    </template>
  </div>`,
  mixins: [
    studied("schemes", [], {
      state({ of, values }) {
        Object.assign(this, { of, values });
      },
    }),
  ],
  data: () => ({ cells: [], heading: "", device: "", values: {} }),
  methods: {
    value: (line) => `${SIGNS[line.level]}${fixed(line.mean, 0)}`,
    // Reason why a scheme has no numbers.
    whyNot({ converged, steady }) {
      if (converged) return "impossible_column";
      return steady ? "scheme_undetermined" : "not_converged";
    },
    about(cell) {
      return fill(this.texts.scheme_use, { letter: cell.letter, name: cell.name });
    },
    isOwn(cell) {
      return Object.entries(cell.settings).every(([key, site]) => this.values[key] === site);
    },
    show() {
      const { study: schemes } = this;
      if (!schemes) return;
      const kept = bus.last("schemes_pinned");
      const shadow = kept?.cells && kept.of === this.pinned?.of ? kept : undefined;
      this.device = schemes.device;
      this.heading = fill(this.texts.schemes_flow, { flow: fixed(schemes.flow, 0) });
      const waves = schemes.cells.flatMap((cell) => LINES.flatMap((line) => cell[line].wave));
      const [lowest, highest] = extent(waves) ?? [0, 1];
      this.range = niceRange(lowest, highest, this.range);
      const [low, high] = this.range;
      const y = (v) => TOP + (1 - (v - low) / (high - low)) * (HEIGHT - TOP - BOTTOM);
      const marks = ticks(low, high, 3).map((v) => ({ value: v, y: y(v), text: fixed(v, 0) }));
      const limits = LINES.flatMap((line) => schemes.limits[line]).filter((v) => v > low && v < high);
      this.cells = schemes.cells.map((cell, k) => ({
        ...cell,
        ticks: marks,
        limits: limits.map(y),
        paths: [...this.paths(shadow?.cells[k], "shadow-", y, low), ...this.paths(cell, "", y, low)],
      }));
    },
    paths(cell, prefix, y, low) {
      if (!cell) return [];
      const x = (k, count) => LEFT + (k / (count - 1)) * (WIDTH - LEFT - RIGHT);
      const point = (v, k, wave) => `${x(k, wave.length).toFixed(1)} ${y(v ?? low).toFixed(1)}`;
      return LINES.map((line) => {
        const points = cell[line].wave.map(point);
        return { name: prefix + line, d: points.length ? `M${points.join("L")}` : "" };
      });
    },
  },
};
