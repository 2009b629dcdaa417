// Live schematic: mean pressures coloured by limits, mean flows, and movable lines of devices.
import {
  CARE,
  FONT,
  SIGNS,
  UNDETERMINED,
  careOf,
  fill,
  fixed,
  handleOf,
  listening,
  nearest,
  placed,
  polyline,
  scaled,
  sized,
  textWidth,
} from "eclsim-page";

const LETTER_HEIGHT = 4.05; // mm, as in the style sheet
const FONTS = {
  name: { size: LETTER_HEIGHT, weight: 400 },
  saturation: { size: LETTER_HEIGHT, weight: 700 },
  pressure: { size: 5.4, weight: 700 },
  readings: { size: 4.3, weight: 600 },
};
const LEAST_LETTER = 11; // px: with smaller letters the circuit does not fit its pane
const WHOLE_LETTER = 8.5; // px: down to this size the whole circuit is shown by default
const EMPTY = { view: [0, 0, 180, 120], frames: [], boxes: [], housed: [], wires: [], lines: [] };
const SYMBOLS = {
  valve: '<path d="M-2.4-2.2 2.4 0-2.4 2.2Z"/><path d="M2.4-2.2V2.2"/>',
  pump: '<circle r="3.4"/><path d="M-1.7-2.9 3.4 0-1.7 2.9Z"/>',
  roller: '<circle r="3.4"/><path d="M0-2V2"/><circle cy="-2" r="1" class="full"/><circle cy="2" r="1"/>',
  exchanger: '<rect x="-3.3" y="-3" width="6.6" height="6"/><path d="M-3.3-3 3.3 3"/>',
  cannula: '<path d="M-2.8-1.6 2.8-.7 2.8.7-2.8 1.6Z"/>',
  resistance: '<rect x="-3.3" y="-1.3" width="6.6" height="2.6"/>',
  tube: '<path d="M-1.6-1.7 1.6 0-1.6 1.7Z"/>',
};
const LEVELS = ["collapse", "alarm", "warning"]; // the gravest first
const STEPS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 };

export default {
  template: `
  <figure :class="['ecl-schematic', { whole: isWhole }]" :aria-label="texts.schematic">
    <div class="sheet" ref="sheet" @scroll.passive="measure"><svg ref="svg" :style="least"
        :viewBox="drawing.view.join(' ')" role="group"
        :aria-label="texts.schematic" @pointermove="drag" @pointerup="drop" @pointercancel="dragged = null">
      <g v-for="f in drawing.frames" :key="f.group" class="frame" :style="ink(f)">
        <rect :x="f.x" :y="f.y" :width="f.w" :height="f.h" rx="3" />
        <text :x="f.title[0]" :y="f.title[1]">{{ f.label
          }}<tspan class="unit" :x="f.title[0]" dy="4.7">{{ f.flows }}</tspan></text>
      </g>
      <g v-for="w in wires" :key="w.name" :style="ink(w)">
        <polyline :points="polyline(w.path)" class="wire" :style="blood(w)" />
        <polyline v-if="w.more" :points="polyline(w.more)" class="wire" :style="blood(w)" />
        <g :transform="placed(w, means['Q' + w.name])" class="symbol" v-html="symbols[w.symbol] ?? ''"></g>
        <text :x="w.label[0]" :y="w.label[1]" :text-anchor="w.label[2]" class="label">{{ w.text }}</text>
        <text :x="w.label[0]" :y="w.label[1] + 4.4" :text-anchor="w.label[2]"
          :class="['flow', flowLevel(w)]">{{ signs[flowLevel(w)] }}{{ flow(w) }}</text>
        <title>{{ w.silent ? w.text : w.text + ": " + flow(w) + " " + w.unit }}</title>
      </g>
      <g v-for="b in drawing.boxes" :key="b.name" class="box" :data-node="b.name" :style="ink(b)"
        :class="[level(b), { target: dragged && b.position, near: dragged?.near === b.name }]">
        <title>{{ aboutBox(b) }}</title>
        <rect :x="b.x" :y="b.y" :width="b.w" :height="b.h" rx="1.6" />
        <text :x="b.x + b.w / 2" :y="b.y + 4.6" class="name"
          v-bind="squeezed(b.short, fonts.name, b.w - 2)">{{ b.short }}</text>
        <text :x="b.x + room(b) / 2" :y="b.y + 10.5" class="pressure"
          v-bind="squeezed(marked(b), fonts.pressure, room(b) - 2)">{{ marked(b) }}</text>
        <g v-if="isFlowing(b)" class="saturation" :style="{ '--blood': gases[b.name].colour }">
          <rect :x="b.x + b.w - 15" :y="b.y + 6.2" width="14" height="5" rx="2" />
          <text :x="b.x + b.w - 8" :y="b.y + 10.2" :style="{ fill: gases[b.name].letters }"
            v-bind="squeezed(saturation(b), fonts.saturation, 13)">{{ saturation(b) }}</text>
        </g>
      </g>
      <g v-for="d in drawing.housed" :key="d.name" class="box housed" :data-device="d.name" :style="ink(d)"
        :class="worst(d.limited)">
        <title>{{ aboutHoused(d) }}</title>
        <polyline :points="polyline(d.path)" class="wire" />
        <rect :x="d.x" :y="d.y" :width="d.w" :height="d.h" rx="1.6" />
        <text :x="d.x + d.w / 2" :y="d.y + 4.6" class="name"
          v-bind="squeezed(d.text, fonts.name, d.w - 2)">{{ d.text }}</text>
        <text :x="d.x + d.w / 2" :y="d.y + 10.4" class="readings"
          v-bind="squeezed(readings(d), fonts.readings, d.w - 2)">{{ readings(d) }}</text>
      </g>
      <g v-for="l in movable" :key="l.moves" class="handle" tabindex="0" role="slider" :data-line="l.moves"
        :style="ink(l)" :aria-label="about(l)" :aria-valuetext="l.site"
        :aria-valuenow="positions.indexOf(l.site)" aria-valuemin="0" :aria-valuemax="positions.length - 1"
        @pointerdown="grab(l, $event)"
        @keydown="step(l, $event)">
        <line v-if="dragged?.line === l" :x1="l.at[0]" :y1="l.at[1]" :x2="dragged.x" :y2="dragged.y"
          class="rubber" />
        <circle :cx="handle(l)[0]" :cy="handle(l)[1]" r="6.5" class="touch" />
        <circle :cx="handle(l)[0]" :cy="handle(l)[1]" r="3" class="knob" />
        <text :x="handle(l)[0]" :y="handle(l)[1] + 1.3" class="letter">{{ l.letter }}</text>
      </g>
    </svg></div>
    <figcaption>
      <button v-if="isSmall" type="button" :aria-pressed="isWhole" @click="chosen = !isWhole">{{
        isWhole ? texts.schematic_larger : texts.schematic_whole }}</button>
      <span v-if="below" class="below" role="status">{{ texts.schematic_below }}</span>
      <span class="key warning">{{ texts.legend_warning }}</span>
      <span class="key alarm">{{ texts.legend_alarm }}</span>
      <span class="key collapse">{{ texts.legend_collapse }}</span>
      <span v-if="Object.keys(gases).length" class="scale">{{ texts.legend_saturation }}
        <i v-for="[percent, colour, letters] in stops" :key="percent"
          :style="{ background: colour, color: letters }">{{ percent }}</i></span>
      <span v-if="movable.length" class="hint" :title="texts.schematic_hint">{{ dragHint }}</span>
    </figcaption>
  </figure>`,
  mixins: [
    sized("sheet"),
    listening({
      drawing(drawing) {
        this.drawing = drawing;
        this.pane = "";
        this.$nextTick(() => this.measure());
      },
      display(display) {
        this.stops = display.saturations;
      },
      beat({ means, outputs, places, levels, gas, undetermined, cautions }) {
        const gases = gas?.places ?? {};
        Object.assign(this, { means, outputs, places, levels, undetermined, cautions, gases });
      },
    }),
  ],
  data: () => ({
    drawing: EMPTY,
    means: {},
    outputs: {},
    places: {},
    levels: {},
    undetermined: [],
    cautions: {},
    gases: {},
    stops: [],
    signs: SIGNS,
    symbols: SYMBOLS,
    fonts: FONTS,
    dragged: null,
    below: false,
    fitted: LEAST_LETTER,
    chosen: undefined,
  }),
  watch: {
    isWhole() {
      this.$nextTick(() => this.measure());
    },
  },
  computed: {
    wires() {
      return [...this.drawing.wires, ...this.drawing.lines];
    },
    movable() {
      return this.drawing.lines.filter((l) => l.moves);
    },
    // Whether letters of the whole circuit would be too small.
    isSmall() {
      return this.fitted < LEAST_LETTER;
    },
    // The whole circuit is shown if it is legible, or as the user chose.
    isWhole() {
      return this.isSmall && (this.chosen ?? this.fitted >= WHOLE_LETTER);
    },
    least() {
      if (this.isWhole) return {};
      const [, , width, height] = this.drawing.view;
      const px = (mm) => `${Math.ceil((LEAST_LETTER / LETTER_HEIGHT) * mm)}px`;
      return { minWidth: px(width), minHeight: px(height) };
    },
    // Boxes to which a line can be moved.
    positions() {
      return this.drawing.boxes.filter((b) => b.position).map((b) => b.name);
    },
    dragHint() {
      return fill(this.texts.schematic_drag, {
        letters: [...new Set(this.movable.map((l) => l.letter))].join(" and "),
      });
    },
  },
  methods: {
    // Size of letters in the whole circuit, and whether part of it is outside its pane.
    measure() {
      const { sheet } = this.$refs;
      if (!sheet) return;
      const [, , width, height] = this.drawing.view;
      const tall = getComputedStyle(this.$el).getPropertyValue("--tall").trim(); // of a page that scrolls
      const room = tall ? parseFloat(tall) || Infinity : sheet.clientHeight;
      const fitted = LETTER_HEIGHT * Math.min(sheet.clientWidth / width, room / height);
      // Text below takes room: use the smaller letter size, otherwise the layout never settles.
      const pane = `${this.$el.clientWidth} ${this.$el.clientHeight}`;
      this.fitted = pane === this.pane ? Math.min(fitted, this.fitted) : fitted;
      this.pane = pane;
      const [down, right] = [sheet.scrollHeight - sheet.clientHeight, sheet.scrollWidth - sheet.clientWidth];
      this.below = down - sheet.scrollTop > 4 || right - sheet.scrollLeft > 4;
    },
    polyline,
    placed,
    ink: (item) => `--ink-of: var(--${item.ink}, var(--soft))`,
    // Condense texts that are too wide in the browser's font.
    squeezed(text, { size, weight }, room) {
      const width = (textWidth(text, `${weight} 100px ${FONT}`) * size) / 100;
      return width > room ? { textLength: room, lengthAdjust: "spacingAndGlyphs" } : {};
    },
    // Stagnant blood has no measurable saturation.
    isFlowing(box) {
      return !!this.gases[box.name] && !this.gases[box.name].standing;
    },
    // Width of a box that the saturation leaves free.
    room(box) {
      return this.isFlowing(box) ? box.w - 14.5 : box.w;
    },
    marked(box) {
      return this.signs[this.level(box)] + this.pressure(box);
    },
    // Flow in a line has the colour of its source; nothing flows into a balloon.
    blood({ name, ends }) {
      if (!ends.every((end) => this.gases[end])) return {};
      const { colour } = this.gases[ends[this.means[`Q${name}`] < 0 ? 1 : 0]] ?? {};
      return colour ? { "--blood": colour } : {};
    },
    saturation(box) {
      const care = careOf(this, box.saturation) ? CARE : "";
      return `${this.signs[this.worst(box.saturation)]}${care}${fixed(this.gases[box.name].values.SO2, 0)} %`;
    },
    aboutBox(box) {
      const { values } = this.gases[box.name] ?? {};
      const gases = this.isFlowing(box)
        ? `, SO2 ${fixed(values.SO2, 1)} %, PO2 ${fixed(values.PO2, 0)} mmHg`
        : "";
      const why = this.isFlowing(box) ? careOf(this, box.saturation) : "";
      const care = why && `, ${fill(this.texts.caution, { why })}`;
      return `${box.text}: ${this.pressure(box)} mmHg${gases}${care}`;
    },
    pressure(box) {
      return (this.undetermined.length ? UNDETERMINED : "") + fixed(this.means[`P${box.name}`], 0);
    },
    // Numbers of a device in the housing of another one's part, with the sign of its gravest limit.
    readings({ readings, limited }) {
      return this.signs[this.worst(limited)] + readings.map((one) => this.reading(one)).join(", ");
    },
    reading({ output, unit }) {
      const about = this.undetermined.includes(output) ? UNDETERMINED : "";
      return `${about}${fixed(this.outputs[output], 0)} ${unit}`;
    },
    aboutHoused(device) {
      const lines = device.readings.map((one) => `${one.text}: ${this.reading(one)}`);
      return [device.text, ...lines].join("\n");
    },
    worst(outputs) {
      return LEVELS.find((level) => outputs.some((name) => this.levels[name] === level)) ?? "ok";
    },
    level(box) {
      return this.places[box.name] ?? "ok";
    },
    // Level of a flow relative to its limits; backward flow is an alarm.
    flowLevel(wire) {
      return this.worst(wire.outputs);
    },
    flow(wire) {
      const mean = this.means[`Q${wire.name}`];
      if (mean === undefined || wire.silent) return "";
      const about = wire.outputs.some((name) => this.undetermined.includes(name)) ? UNDETERMINED : "";
      return about + fixed(scaled(mean, wire.factor), wire.digits);
    },
    about(line) {
      return fill(line.about, {
        site: this.drawing.boxes.find((b) => b.name === line.site)?.text ?? line.site,
      });
    },
    handle(line) {
      return this.dragged?.line === line ? [this.dragged.x, this.dragged.y] : handleOf(line);
    },
    placeOf(event) {
      const screen = this.$refs.svg.getScreenCTM().inverse();
      const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(screen);
      return { x, y };
    },
    grab(line, event) {
      event.preventDefault();
      event.currentTarget.focus?.();
      this.$refs.svg.setPointerCapture(event.pointerId);
      this.dragged = { line, near: line.site, ...this.placeOf(event) };
    },
    drag(event) {
      if (!this.dragged) return;
      const { x, y } = this.placeOf(event);
      const positions = this.drawing.boxes.filter((b) => b.position);
      this.dragged = { ...this.dragged, x, y, near: nearest(positions, x, y) };
    },
    drop() {
      const { dragged } = this;
      this.dragged = null;
      if (dragged?.near && dragged.near !== dragged.line.site) this.move(dragged.line, dragged.near);
    },
    step(line, event) {
      const steps = STEPS[event.key];
      if (!steps) return;
      event.preventDefault();
      const next = this.positions[this.positions.indexOf(line.site) + steps];
      if (next) this.move(line, next);
    },
    move(line, name) {
      this.$emit("move", { key: line.moves, site: this.drawing.boxes.find((b) => b.name === name).position });
    },
  },
};
