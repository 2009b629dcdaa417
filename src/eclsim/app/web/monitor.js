// Waveforms as on a bedside monitor: they sweep in real time, and are repainted at once when the beat changes.
import { bandsOf, bus, fixed, latency, niceRange, words } from "eclsim-page";

const LANES = [
  { wave: "Pao", colour: "#FF8A70", digits: 0, kind: "pressure", outputs: ["SP", "DP"] },
  { wave: "Ppas", colour: "#F0E442", digits: 0, kind: "pressure", outputs: ["SPAP", "DPAP"] },
  { wave: "Pra", colour: "#6CC3F5", digits: 0, kind: "mean", outputs: ["right_atrial_pressure"] },
  { wave: "Qecmopump", colour: "#3BD3A5", digits: 2, kind: "flow", outputs: ["PF"] },
  { wave: "Qlvadpump", colour: "#E7A6CC", digits: 2, kind: "flow", outputs: ["lvad_flow"] },
  { wave: "Pcrrttuin", colour: "#FFB733", digits: 0, kind: "mean", outputs: ["crrt_access_pressure"] },
  { wave: "Pcrrttuout", colour: "#E4E7EC", digits: 0, kind: "mean", outputs: ["crrt_return_pressure"] },
];
const SECONDS = 6;
const GAP = 16;
const TO_L_MIN = 0.06;
const LEFT = 40;

export default {
  template: `
  <div class="ecl-monitor">
    <div class="screen" ref="screen">
      <canvas ref="canvas" role="img" :aria-label="words.monitor_label + ': ' + spoken"></canvas>
      <div class="numbers">
        <div v-for="lane in lanes" :key="lane.wave" class="lane" :style="{ color: lane.colour }" :title="words[lane.wave + '_long']">
          <span class="name">{{ words[lane.wave] }} <em>{{ lane.unit }}</em></span>
          <span class="big">{{ lane.big }}</span>
          <span class="small">{{ lane.small }}</span>
          <span v-if="lane.band" class="band" :title="words.bands_column">{{ lane.band }}</span>
          <span v-if="lane.pinned" class="pinned">{{ words.pinned }} {{ lane.pinned }}</span>
        </div>
      </div>
      <button type="button" class="pause" :aria-pressed="paused" @click="paused = !paused">{{ paused ? words.sweep_go : words.sweep_pause }}</button>
    </div>
    <div class="ecl-alarms" role="log" :aria-label="words.alarms">
      <p v-if="!notes.length" class="quiet">✓ {{ words.no_alarms }}</p>
      <p v-for="[kind, text] in notes" :key="text" :class="kind"><b>{{ kind === 'warning' ? '!' : '▲' }}</b> {{ text }}</p>
    </div>
  </div>`,
  data: () => ({ words, lanes: [], notes: [], paused: false, spoken: "" }),
  mounted() {
    this.words = words;
    this.scales = {};
    this.paused = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.since = performance.now();
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(this.$refs.screen);
    this.stops = [
      bus.on("pinned", (beat) => {
        this.pinned = beat;
        if (this.beat) this.show(this.beat);
      }),
      bus.on("bands", () => {
        if (this.beat) this.show(this.beat);
      }),
      bus.on("beat", (beat) => {
        this.show(beat);
        latency.drawn(beat.seq);
      }),
    ];
    const frame = (now) => {
      this.frame = requestAnimationFrame(frame);
      if (this.beat && !this.paused && this.width > 0) this.sweep(now);
    };
    this.frame = requestAnimationFrame(frame);
  },
  unmounted() {
    cancelAnimationFrame(this.frame);
    this.observer.disconnect();
    for (const stop of this.stops) stop();
  },
  methods: {
    show(beat) {
      this.beat = beat;
      this.bands = bandsOf(beat);
      this.notes = beat.notes;
      const seen = LANES.filter((lane) => beat.waves[lane.wave]);
      this.lanes = seen.map((lane) => ({ ...lane, ...this.read(lane, beat), pinned: this.shadow(lane), band: this.interval(lane) }));
      this.spoken = this.lanes.map((l) => `${words[l.wave]} ${l.big} ${l.small}`).join(", ");
      for (const lane of seen) {
        const all = [beat, this.pinned].filter((b) => b?.waves[lane.wave]).flatMap((b) => this.values(lane, b));
        const band = this.bands?.waves[lane.wave]?.flat().map((v) => (lane.kind === "flow" ? v * TO_L_MIN : v)) ?? [];
        const finite = [...all, ...band].filter(Number.isFinite);
        let [low, high] = [Math.min(...finite), Math.max(...finite)];
        const least = lane.kind === "flow" ? 1 : 6;
        if (high - low < least) [low, high] = [0.5 * (low + high - least), 0.5 * (low + high + least)];
        this.scales[lane.wave] = niceRange(low, high, this.scales[lane.wave]);
      }
      this.repaint();
    },
    values: (lane, beat) => beat.waves[lane.wave].map((v) => (lane.kind === "flow" ? v * TO_L_MIN : v)),
    read(lane, beat) {
      const mean = beat.means[lane.wave] * (lane.kind === "flow" ? TO_L_MIN : 1);
      if (lane.kind === "flow") return { big: fixed(mean, 2), small: "", unit: "L/min" };
      if (lane.kind === "mean") return { big: fixed(mean, 0), small: "", unit: "mmHg" };
      const [high, low] = lane.wave === "Pao" ? [beat.outputs.SP, beat.outputs.DP] : [beat.outputs.SPAP, beat.outputs.DPAP];
      return { big: `${fixed(high, 0)}/${fixed(low, 0)}`, small: `(${fixed(mean, 0)})`, unit: "mmHg" };
    },
    shadow(lane) {
      if (!this.pinned?.waves[lane.wave]) return "";
      const { big, small } = this.read(lane, this.pinned);
      return `${big} ${small}`;
    },
    interval(lane) {
      const found = lane.outputs.map((name) => this.bands?.outputs[name]).filter(Boolean);
      return found.map(([low, high]) => `${fixed(low, lane.digits)}–${fixed(high, lane.digits)}`).join(" / ");
    },
    resize() {
      const canvas = this.$refs.canvas;
      const ratio = window.devicePixelRatio || 1;
      this.width = canvas.clientWidth;
      this.height = canvas.clientHeight;
      canvas.width = Math.round(this.width * ratio);
      canvas.height = Math.round(this.height * ratio);
      this.pen = canvas.getContext("2d");
      this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      this.repaint();
    },
    head(now) {
      const speed = (this.width - LEFT) / SECONDS;
      return LEFT + ((((now - this.since) / 1000) % SECONDS) * speed);
    },
    repaint() {
      if (!this.pen || !this.beat || !(this.width > LEFT)) return;
      const now = performance.now();
      this.x = this.head(now);
      this.paint(0, this.width);
      if (!this.paused) this.pen.clearRect(this.x, 0, GAP, this.height);
    },
    sweep(now) {
      const x = this.head(now);
      if (x < this.x) {
        this.paint(this.x - 1, this.width);
        this.x = LEFT;
      }
      if (x - this.x < 1) return;
      this.paint(this.x - 1, x);
      this.pen.clearRect(x, 0, GAP, this.height);
      this.x = x;
    },
    paint(from, to) {
      const pen = this.pen;
      const tall = this.height / this.lanes.length;
      pen.save();
      pen.beginPath();
      pen.rect(from, 0, to - from, this.height);
      pen.clip();
      pen.clearRect(from, 0, to - from, this.height);
      this.lanes.forEach((lane, k) => {
        const [low, high] = this.scales[lane.wave];
        const y = (v) => (k + 1) * tall - 7 - ((v - low) / (high - low)) * (tall - 16);
        if (from < LEFT) this.axis(lane, low, high, y, k, tall);
        pen.strokeStyle = "#2A3644";
        pen.lineWidth = 1;
        for (const v of [low, high]) this.path([[Math.max(from, LEFT), y(v)], [to, y(v)]]);
        if (this.pinned?.waves[lane.wave]) this.trace(lane, this.pinned, y, from, to, "#7C8896", 1.2);
        if (this.bands?.waves[lane.wave]) this.band(lane, this.bands.waves[lane.wave], y, from, to);
        this.trace(lane, this.beat, y, from, to, lane.colour, 1.8);
      });
      pen.restore();
    },
    axis(lane, low, high, y, k, tall) {
      const pen = this.pen;
      pen.fillStyle = "#93A1B0";
      pen.font = "11px system-ui, sans-serif";
      pen.textAlign = "right";
      const digits = high - low < 3 ? 1 : 0;
      pen.fillText(fixed(high, digits), LEFT - 6, y(high) + 8);
      pen.fillText(fixed(low, digits), LEFT - 6, y(low));
      if (k) {
        pen.strokeStyle = "#1B2530";
        this.path([[0, k * tall], [this.width, k * tall]]);
      }
    },
    trace(lane, beat, y, from, to, colour, width) {
      this.pen.strokeStyle = colour;
      this.pen.lineWidth = width;
      this.pen.lineJoin = "round";
      this.path(this.points(lane, beat.waves[lane.wave], beat.period, y, from, to));
    },
    band(lane, [low, high], y, from, to) {
      const [under, over] = [low, high].map((wave) => this.points(lane, wave, this.beat.period, y, from, to));
      this.pen.beginPath();
      [...under, ...over.reverse()].forEach(([x, v], k) => (k ? this.pen.lineTo(x, v) : this.pen.moveTo(x, v)));
      this.pen.fillStyle = lane.colour + "48";
      this.pen.fill();
    },
    points(lane, wave, period, y, from, to) {
      const scale = lane.kind === "flow" ? TO_L_MIN : 1;
      const perPixel = SECONDS / (this.width - LEFT) / period;
      const points = [];
      const n = wave.length;
      for (let x = Math.max(from, LEFT) - 1; x <= to + 1; x += 1) {
        const at = (((x - LEFT) * perPixel) % 1 + 1) % 1 * n;
        const i = Math.floor(at) % n;
        const v = wave[i] + (at - Math.floor(at)) * (wave[(i + 1) % n] - wave[i]);
        if (Number.isFinite(v)) points.push([Math.max(x, LEFT), y(v * scale)]);
      }
      return points;
    },
    path(points) {
      this.pen.beginPath();
      points.forEach(([x, y], k) => (k ? this.pen.lineTo(x, y) : this.pen.moveTo(x, y)));
      this.pen.stroke();
    },
  },
};
