// Waveforms as on a bedside monitor: they sweep in real time; a new beat is painted at once.
import {
  CARE,
  LEFT,
  MISSING,
  SIGNS,
  aboutSign,
  bandsOf,
  careOf,
  extent,
  fill,
  fixed,
  fixedRange,
  headAt,
  isPossible,
  latency,
  drawing,
  niceRange,
  samples,
  scaled,
} from "eclsim-page";

const GAP = 16; // px without a trace before the head
const L_MIN = 0.06; // of 1 mL/s
const [GRID, EDGE, TICKS, SHADOW] = ["#2A3644", "#1B2530", "#93A1B0", "#7C8896"];
const SMALLEST_RANGE = { flow: 1, pressure: 6, mean: 6 }; // of a stretched scale

export default {
  template: `
  <div class="ecl-monitor">
    <div class="screen" ref="screen"
      :style="{ minHeight: 'max(220px, calc(30px + ' + traces.length + ' * var(--row, 3em)))' }">
      <canvas ref="canvas" role="img" :aria-label="texts.monitor_label + ': ' + spoken"></canvas>
      <div class="numbers">
        <div v-for="t in traces" :key="t.signal" class="trace" :style="{ color: t.colour }" :title="t.hint"
          :data-wave="t.signal" :data-scale="t.scale.join()">
          <span class="name">{{ t.care }} {{ t.label }} <em>{{ t.unit }}</em></span>
          <span class="big" :style="{ '--long': t.big.length }">{{ t.big }}</span>
          <span class="small">{{ t.small }}</span>
          <span v-if="t.band" class="band" :title="texts.bands_column">{{ t.band }}</span>
          <span v-if="t.pinned" class="pinned">{{ texts.pinned }} {{ t.pinned }}</span>
        </div>
      </div>
      <div class="sweeping">
        <button type="button" :aria-pressed="paused" @click="paused = !paused">{{
          texts.sweep_pause }}</button>
        <button type="button" :aria-pressed="auto" :title="texts.autoscale_hint" @click="rescale">{{
          texts.autoscale }}</button>
        <span v-if="auto">{{ texts.autoscale_on }}</span>
        <span v-if="kept" class="kept">{{ kept }}</span>
      </div>
    </div>
  </div>`,
  mixins: [
    drawing(["bands"], {
      display(display) {
        this.known = display.traces;
        this.show();
      },
      beat(beat) {
        const isFirst = !this.beat;
        this.beat = beat;
        this.show();
        if (isFirst) this.run();
        latency.drawn(beat.seq);
      },
    }),
  ],
  data: () => ({ traces: [], paused: false, auto: false, spoken: "", kept: "" }),
  watch: {
    paused() {
      this.run();
    },
  },
  unmounted() {
    cancelAnimationFrame(this.frame);
    this.observer.disconnect();
  },
  methods: {
    setUp() {
      this.scales = {};
      this.known = [];
      this.paused = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
      this.since = performance.now();
      this.observer = new ResizeObserver(([entry]) => this.resize(entry));
      try {
        this.observer.observe(this.$refs.canvas, { box: "device-pixel-content-box" });
      } catch {
        this.observer.observe(this.$refs.canvas);
      }
    },
    // Request frames only while something moves: each costs the browser several ms, visible or not.
    run() {
      cancelAnimationFrame(this.frame);
      const frame = (now) => {
        if (!this.beat || this.paused || !(this.width > 0)) return;
        this.frame = requestAnimationFrame(frame);
        this.sweep(now);
      };
      this.frame = requestAnimationFrame(frame);
    },
    show() {
      if (!this.beat) return;
      this.bands = bandsOf(this.beat);
      this.shadow = isPossible(this.pinned) ? this.pinned : null;
      const seen = this.known.filter((trace) => this.beat.waves[trace.signal]);
      for (const trace of seen) this.scales[trace.signal] = this.scaleOf(trace);
      this.drawn = seen.map((trace) => this.described(trace));
      this.traces = this.drawn;
      this.kept = this.pinned ? this.nameOf(this.pinned) : "";
      this.spoken = this.traces.map((t) => `${t.label} ${t.big} ${t.small}`).join(", ");
      this.repaint();
    },
    // Label of the shadow trace; it says if the fit is not reliable.
    nameOf({ name, badge, level }) {
      const doubt = level === "ok" || badge === this.texts.badge_changed ? "" : ` (${badge})`;
      return fill(this.texts.pinned_of, { name: name + doubt });
    },
    described(trace) {
      const { big, small, unit } = this.read(trace, this.beat);
      const scale = this.scales[trace.signal];
      const bounds = scale.map((v) => fixed(v, 1)).join(" – ");
      const kept = this.shadow?.waves[trace.signal] && this.read(trace, this.shadow);
      const none = isPossible(this.pinned) ? "" : SIGNS.collapse + MISSING;
      const pinned = kept ? `${kept.big} ${kept.small}` : none;
      const why = careOf(this.beat, trace.outputs);
      const care = why ? CARE : "";
      const hint = `${trace.text}, ${bounds} ${unit}${why ? `, ${fill(this.texts.caution, { why })}` : ""}`;
      return { ...trace, big, small, unit, scale, hint, care, pinned, band: this.interval(trace) };
    },
    rescale() {
      this.auto = !this.auto;
      this.scales = {};
      this.show();
    },
    scaleOf(trace) {
      const factor = trace.form === "flow" ? L_MIN : 1;
      const beats = [this.beat, this.shadow].flatMap((beat) => beat?.waves[trace.signal] ?? []);
      const values = [...beats, ...(this.bands?.waves[trace.signal]?.flat() ?? [])].map((v) =>
        scaled(v, factor),
      );
      if (this.auto) {
        const [low, high] = extent(values, SMALLEST_RANGE[trace.form]) ?? trace.scales[0];
        return niceRange(low, high, this.scales[trace.signal]);
      }
      const [low, high] = extent(values) ?? trace.scales[0];
      return fixedRange(trace.scales, low, high);
    },
    read({ form, signal, outputs }, beat) {
      const mean = beat.means[signal];
      const about = aboutSign(beat, ...outputs);
      if (form === "flow") return { big: about + fixed(scaled(mean, L_MIN), 2), small: "", unit: "L/min" };
      if (form === "mean") return { big: about + fixed(mean, 0), small: "", unit: "mmHg" };
      const extremes = outputs.map((name) => fixed(beat.outputs[name], 0)).join("/");
      return { big: about + extremes, small: `(${about}${fixed(mean, 0)})`, unit: "mmHg" };
    },
    interval({ form, outputs }) {
      const digits = form === "flow" ? 2 : 0;
      const bands = outputs.map((name) => this.bands?.outputs[name]).filter(Boolean);
      return bands.map((band) => band.map((v) => fixed(v, digits)).join("–")).join(" / ");
    },
    resize(entry) {
      const { canvas } = this.$refs;
      document.documentElement.style.setProperty("--monitor-height", `${this.$el.offsetHeight}px`);
      const box = canvas.getBoundingClientRect();
      const exact = entry?.devicePixelContentBoxSize?.[0];
      const density = window.devicePixelRatio || 1;
      canvas.width = exact?.inlineSize ?? Math.round(box.width * density);
      canvas.height = exact?.blockSize ?? Math.round(box.height * density);
      this.ratio = box.width ? canvas.width / box.width : 1;
      this.width = canvas.width / this.ratio;
      this.height = canvas.height / this.ratio;
      this.pen = canvas.getContext("2d");
      this.pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      this.repaint();
      this.run();
    },
    head(now) {
      return headAt((now - this.since) / 1000, this.width, this.ratio);
    },
    repaint() {
      if (!this.pen || !this.beat || !(this.width > LEFT)) return;
      this.x = this.head(performance.now());
      this.paint(0, this.width);
      if (!this.paused) this.pen.clearRect(this.x, 0, GAP, this.height);
    },
    sweep(now) {
      const x = this.head(now);
      if (x < this.x) {
        this.paint(this.x, this.width);
        this.x = headAt(0, this.width, this.ratio);
      }
      if (x === this.x) return;
      this.paint(this.x, x);
      this.pen.clearRect(x, 0, Math.floor(GAP * this.ratio) / this.ratio, this.height);
      this.x = x;
    },
    clip(x, y, width, height) {
      this.pen.beginPath();
      this.pen.rect(x, y, width, height);
      this.pen.clip();
    },
    paint(from, to) {
      this.pen.save();
      this.clip(from, 0, to - from, this.height);
      this.pen.clearRect(from, 0, to - from, this.height);
      this.drawn.forEach((trace, row) => this.paintTrace(trace, row, from, to));
      this.pen.restore();
    },
    paintTrace(trace, row, from, to) {
      const { pen } = this;
      const tall = this.height / this.drawn.length;
      const [low, high] = trace.scale;
      const y = (v) => (row + 1) * tall - 7 - ((v - low) / (high - low)) * (tall - 16);
      pen.save();
      this.clip(0, row * tall, this.width, tall);
      if (from < LEFT) this.paintAxis(low, high, y, row * tall);
      pen.strokeStyle = GRID;
      pen.lineWidth = 1;
      for (const v of [low, high]) this.path([Math.max(from, LEFT), to].map((x) => [x, y(v)]));
      this.clip(LEFT, row * tall, this.width - LEFT, tall);
      if (this.shadow?.waves[trace.signal]) this.curve(trace, this.shadow, y, from, to, SHADOW, 1.2);
      if (this.bands?.waves[trace.signal]) this.band(trace, this.bands.waves[trace.signal], y, from, to);
      this.curve(trace, this.beat, y, from, to, trace.colour, 1.8);
      pen.restore();
    },
    paintAxis(low, high, y, top) {
      const { pen } = this;
      const digits = high - low < 3 ? 1 : 0;
      pen.fillStyle = TICKS;
      pen.font = "11px system-ui, sans-serif";
      pen.textAlign = "right";
      pen.fillText(fixed(high, digits), LEFT - 6, y(high) + 8);
      pen.fillText(fixed(low, digits), LEFT - 6, y(low));
      if (!top) return;
      pen.strokeStyle = EDGE;
      this.path([
        [0, top],
        [this.width, top],
      ]);
    },
    points(trace, wave, period, y, from, to) {
      const factor = trace.form === "flow" ? L_MIN : 1;
      return samples(wave, period, this.width, from, to).map(([x, v]) => [x, y(scaled(v, factor))]);
    },
    curve(trace, beat, y, from, to, colour, width) {
      this.pen.strokeStyle = colour;
      this.pen.lineWidth = width;
      this.pen.lineJoin = "round";
      this.path(this.points(trace, beat.waves[trace.signal], beat.period, y, from, to));
    },
    band(trace, sides, y, from, to) {
      const [under, over] = sides.map((wave) => this.points(trace, wave, this.beat.period, y, from, to));
      this.trail([...under, ...over.toReversed()]);
      this.pen.fillStyle = `${trace.colour}48`;
      this.pen.fill();
    },
    path(points) {
      this.trail(points);
      this.pen.stroke();
    },
    trail(points) {
      this.pen.beginPath();
      points.forEach(([x, y], k) => (k ? this.pen.lineTo(x, y) : this.pen.moveTo(x, y)));
    },
  },
};
