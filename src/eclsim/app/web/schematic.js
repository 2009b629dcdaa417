// The circuit, live: mean pressures coloured by limits, mean flows, CRRT lines that can be moved.
import { bus, fixed, words } from "eclsim-page";

const TO = { crrt: [60, 0, "mL/min"], ecmo: [0.06, 2, "L/min"], patient: [0.06, 2, "L/min"], lvad: [0.06, 2, "L/min"] };
const LETTERING = 'system-ui, "Segoe UI", Roboto, sans-serif';
const LETTERS = 4.05; // mm, as in the style sheet
const LEAST_SCALE = 11 / LETTERS; // px a mm: no letter is smaller than 11 px
const PUMPS = { ecmopump: "PF", lvadpump: "lvad_flow" };
const SIGNS = { ok: "", warning: "! ", alarm: "▲ ", collapse: "✕ " };
const REACH = 14; // mm around a position in which a line is dropped on it

export default {
  template: `
  <figure class="ecl-schematic" :aria-label="words.schematic">
    <div class="sheet"><svg ref="svg" :style="least" :viewBox="drawing.view.join(' ')" role="group" :aria-label="words.schematic" @pointermove="move" @pointerup="drop" @pointercancel="drag = null">
      <g v-for="f in drawing.frames" :key="f.group" class="frame">
        <rect :x="f.x" :y="f.y" :width="f.w" :height="f.h" rx="3" :style="ink(f.group)" />
        <text :x="f.title[0]" :y="f.title[1]" :style="ink(f.group)">{{ words['frame_' + f.group] ?? f.group }}<tspan class="unit" :x="f.title[0]" dy="4.7">{{ flows(f) }}</tspan></text>
      </g>
      <g v-for="w in wires" :key="w.name">
        <polyline :points="points(w.path)" :style="ink(w.group)" class="wire" />
        <polyline v-if="w.more" :points="points(w.more)" :style="ink(w.group)" class="wire" />
        <g :transform="turned(w)" :style="ink(w.group)" class="symbol" v-html="symbol(w.symbol)"></g>
        <text :x="w.label[0]" :y="w.label[1]" :text-anchor="w.label[2]" class="words">{{ w.words }}</text>
        <text :x="w.label[0]" :y="w.label[1] + 4.4" :text-anchor="w.label[2]" class="flow" :class="pumped(w)">{{ signs[pumped(w)] }}{{ flow(w) }}</text>
        <title>{{ w.words }}: {{ flow(w) }} {{ unit(w.group) }}</title>
      </g>
      <g v-for="b in drawing.boxes" :key="b.name" class="box" :class="[level(b), { target: drag && b.position, near: drag?.near === b.name }]" :data-node="b.name">
        <title>{{ b.words }}: {{ pressure(b) }} mmHg</title>
        <rect :x="b.x" :y="b.y" :width="b.w" :height="b.h" rx="1.6" :style="ink(b.group)" />
        <text :x="b.x + b.w / 2" :y="b.y + 4.6" class="name" :textLength="squeezed(b)" lengthAdjust="spacingAndGlyphs">{{ b.short }}</text>
        <text :x="b.x + b.w / 2" :y="b.y + 10.5" class="pressure">{{ sign(b) }}{{ pressure(b) }}</text>
      </g>
      <g v-for="l in movable" :key="l.moves" class="handle" tabindex="0" role="slider" :data-line="l.moves" :aria-label="say(l)"
         :aria-valuetext="l.site" :aria-valuenow="order.indexOf(l.site)" aria-valuemin="0" :aria-valuemax="order.length - 1"
         @pointerdown="grab(l, $event)" @keydown="step(l, $event)">
        <line v-if="drag?.line === l.moves" :x1="l.at[0]" :y1="l.at[1]" :x2="drag.x" :y2="drag.y" class="rubber" />
        <circle :cx="spot(l)[0]" :cy="spot(l)[1]" r="6.5" class="touch" />
        <circle :cx="spot(l)[0]" :cy="spot(l)[1]" r="3" class="knob" />
        <text :x="spot(l)[0]" :y="spot(l)[1] + 1.3" class="letter">{{ l.moves === 'access' ? 'A' : 'R' }}</text>
      </g>
    </svg></div>
    <figcaption><span class="key warning">{{ words.legend_warning }}</span><span class="key alarm">{{ words.legend_alarm }}</span><span class="key collapse">{{ words.legend_collapse }}</span><span v-if="movable.length" class="hint" :title="words.schematic_hint">{{ words.schematic_drag }}</span></figcaption>
  </figure>`,
  data: () => ({ words, drawing: { view: [0, 0, 180, 120], frames: [], boxes: [], wires: [], lines: [] }, means: {}, levels: {}, outputLevels: {}, signs: SIGNS, drag: null }),
  computed: {
    wires() {
      return [...this.drawing.wires, ...this.drawing.lines];
    },
    movable() {
      return this.drawing.lines.filter((l) => l.moves);
    },
    least() {
      const [, , width, height] = this.drawing.view;
      return { minWidth: `${Math.ceil(LEAST_SCALE * width)}px`, minHeight: `${Math.ceil(LEAST_SCALE * height)}px` };
    },
    order() {
      return this.drawing.boxes.filter((b) => b.position).map((b) => b.name);
    },
  },
  mounted() {
    this.words = words;
    this.stops = [
      bus.on("drawing", (drawing) => (this.drawing = drawing)),
      bus.on("beat", (beat) => {
        this.means = beat.means;
        this.levels = beat.places;
        this.outputLevels = beat.levels;
      }),
    ];
  },
  unmounted() {
    for (const stop of this.stops) stop();
  },
  methods: {
    points: (path) => path.map((p) => p.join(",")).join(" "),
    ink: (group) => `--ink-of: var(--${group}, var(--soft))`,
    unit: (group) => (TO[group] ?? TO.patient)[2],
    flows(f) {
      return f.group === "spare" ? "" : words.frame_flows.replace("{unit}", this.unit(f.group));
    },
    // Where the letters of this browser are wide, a name is drawn narrower: it stays in its box.
    squeezed(b) {
      this.pen ??= document.createElement("canvas").getContext("2d");
      this.pen.font = `100px ${LETTERING}`;
      const wide = (this.pen.measureText(b.short).width * LETTERS) / 100;
      return wide > b.w - 2 ? b.w - 2 : null;
    },
    pressure(b) {
      return fixed(this.means["P" + b.name], 0);
    },
    level(b) {
      return this.levels[b.name] ?? "ok";
    },
    sign(b) {
      return SIGNS[this.level(b)];
    },
    // How the flow of a pump stands to its limits: backwards is an alarm.
    pumped(w) {
      return this.outputLevels[PUMPS[w.name]] ?? "ok";
    },
    flow(w) {
      const [factor, digits] = TO[w.group] ?? TO.patient;
      const mean = this.means["Q" + w.name];
      return mean === undefined ? "" : fixed(mean * factor, digits);
    },
    turned(w) {
      const path = w.more ?? w.path;
      const [a, b] = w.more ? path.slice(0, 2) : this.piece(w);
      const angle = (Math.atan2(b[1] - a[1], b[0] - a[0]) * 180) / Math.PI;
      const shown = w.symbol === "cannula" ? 90 : angle; // tips of cannulae point to the patient
      return `translate(${w.at[0]} ${w.at[1]}) rotate(${shown})`;
    },
    // The piece of a line that its symbol stands on.
    piece(w) {
      for (let k = 1; k < w.path.length; k++) {
        const [a, b] = [w.path[k - 1], w.path[k]];
        const on = (i) => w.at[i] >= Math.min(a[i], b[i]) - 0.1 && w.at[i] <= Math.max(a[i], b[i]) + 0.1;
        if (on(0) && on(1)) return [a, b];
      }
      return w.path.slice(0, 2);
    },
    symbol(kind) {
      return {
        valve: '<path d="M-2.4-2.2 2.4 0-2.4 2.2Z"/><path d="M2.4-2.2V2.2"/>',
        pump: '<circle r="3.4"/><path d="M-1.7-2.9 3.4 0-1.7 2.9Z"/>',
        roller: '<circle r="3.4"/><path d="M0-2V2"/><circle cy="-2" r="1" class="full"/><circle cy="2" r="1"/>',
        exchanger: '<rect x="-3.3" y="-3" width="6.6" height="6"/><path d="M-3.3-3 3.3 3"/>',
        cannula: '<path d="M-2.8-1.6 2.8-.7 2.8.7-2.8 1.6Z"/>',
        resistance: '<rect x="-3.3" y="-1.3" width="6.6" height="2.6"/>',
        tube: '<path d="M-1.6-1.7 1.6 0-1.6 1.7Z"/>',
      }[kind] ?? "";
    },
    say(l) {
      return words["line_" + l.moves].replace("{site}", this.drawing.boxes.find((b) => b.name === l.site)?.words ?? l.site);
    },
    spot(l) {
      if (this.drag?.line === l.moves) return [this.drag.x, this.drag.y];
      const path = l.moves === "return" ? [...l.path].reverse() : l.path; // from the site
      const [dx, dy] = [Math.sign(path[1][0] - path[0][0]), Math.sign(path[1][1] - path[0][1])];
      return [l.end[0] + 2.6 * dx, l.end[1] + 2.6 * dy];
    },
    place(event) {
      const p = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.$refs.svg.getScreenCTM().inverse());
      return [p.x, p.y];
    },
    grab(l, event) {
      event.preventDefault();
      event.currentTarget.focus?.();
      this.$refs.svg.setPointerCapture(event.pointerId);
      const [x, y] = this.place(event);
      this.drag = { line: l.moves, from: l.site, x, y, near: l.site };
    },
    move(event) {
      if (!this.drag) return;
      const [x, y] = this.place(event);
      const near = this.drawing.boxes
        .filter((b) => b.position)
        .map((b) => [Math.hypot(Math.max(Math.abs(x - b.x - b.w / 2) - b.w / 2, 0), Math.max(Math.abs(y - b.y - b.h / 2) - b.h / 2, 0)), b.name])
        .sort((p, q) => p[0] - q[0])[0];
      this.drag = { ...this.drag, x, y, near: near && near[0] < REACH ? near[1] : null };
    },
    drop() {
      const drag = this.drag;
      this.drag = null;
      if (drag?.near && drag.near !== drag.from) this.tell(drag.line, drag.near);
    },
    step(l, event) {
      const way = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
      if (!way) return;
      event.preventDefault();
      const next = this.order[this.order.indexOf(l.site) + way];
      if (next) this.tell(l.moves, next);
    },
    tell(line, node) {
      this.$emit("move", { line, site: this.drawing.boxes.find((b) => b.name === node).position });
    },
  },
};
