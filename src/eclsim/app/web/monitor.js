// Waveforms as on a bedside monitor: they sweep in real time, and are repainted at once when the beat changes.
// Every sample is drawn at its own time, between pixels too, so that all beats of a steady beat look alike.
import { bandsOf, bus, fixed, latency, niceRange, words } from "eclsim-page";

// `scales`: fixed scales [mmHg or L/min]; the first that holds the whole trace is taken, whatever its amplitude.
const LANES = [
  { wave: "Pao", colour: "#FF8A70", digits: 0, kind: "pressure", outputs: ["SP", "DP"], scales: [[0, 150], [0, 200], [0, 300]] },
  { wave: "Ppas", colour: "#F0E442", digits: 0, kind: "pressure", outputs: ["SPAP", "DPAP"], scales: [[0, 40], [0, 80], [0, 160]] },
  { wave: "Pra", colour: "#6CC3F5", digits: 0, kind: "mean", outputs: ["right_atrial_pressure"], scales: [[0, 20], [-10, 30], [-20, 60]] },
  { wave: "Qecmopump", colour: "#3BD3A5", digits: 2, kind: "flow", outputs: ["PF"], scales: [[0, 6], [0, 10], [-2, 6], [-5, 10]] },
  { wave: "Qlvadpump", colour: "#E7A6CC", digits: 2, kind: "flow", outputs: ["lvad_flow"], scales: [[0, 8], [-4, 12], [-10, 20]] },
  { wave: "Pcrrttuin", colour: "#FFB733", digits: 0, kind: "mean", outputs: ["crrt_access_pressure"], scales: [[-300, 300], [-600, 600]] },
  { wave: "Pcrrttuout", colour: "#E4E7EC", digits: 0, kind: "mean", outputs: ["crrt_return_pressure"], scales: [[0, 400], [-200, 800]] },
];
const SECONDS = 6;
const GAP = 16;
const TO_L_MIN = 0.06;
const LEFT = 40;

export default {
  template: `
  <div class="ecl-monitor">
    <div class="screen" ref="screen" :style="{ minHeight: Math.max(220, 30 + 42 * lanes.length) + 'px' }">
      <canvas ref="canvas" role="img" :aria-label="words.monitor_label + ': ' + spoken"></canvas>
      <div class="numbers">
        <div v-for="lane in lanes" :key="lane.wave" class="lane" :style="{ color: lane.colour }" :title="words[lane.wave + '_long'] + ', ' + lane.scale.map((v) => number(v, 1)).join(' – ') + ' ' + lane.unit" :data-wave="lane.wave" :data-scale="lane.scale.join()">
          <span class="name">{{ words[lane.wave] }} <em>{{ lane.unit }}</em></span>
          <span class="big">{{ lane.big }}</span>
          <span class="small">{{ lane.small }}</span>
          <span v-if="lane.band" class="band" :title="words.bands_column">{{ lane.band }}</span>
          <span v-if="lane.pinned" class="pinned">{{ words.pinned }} {{ lane.pinned }}</span>
        </div>
      </div>
      <div class="sweeping">
        <button type="button" :aria-pressed="paused" @click="paused = !paused">{{ words.sweep_pause }}</button>
        <button type="button" :aria-pressed="auto" :title="words.autoscale_hint" @click="rescale">{{ words.autoscale }}</button>
        <span v-if="auto">{{ words.autoscale_on }}</span>
      </div>
    </div>
  </div>`,
  data: () => ({ words, lanes: [], paused: false, auto: false, spoken: "" }),
  mounted() {
    this.words = words;
    this.scales = {};
    this.paused = window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.since = performance.now();
    this.observer = new ResizeObserver(([entry]) => this.resize(entry));
    try {
      this.observer.observe(this.$refs.canvas, { box: "device-pixel-content-box" });
    } catch {
      this.observer.observe(this.$refs.canvas);
    }
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
      const seen = LANES.filter((lane) => beat.waves[lane.wave]);
      for (const lane of seen) this.scales[lane.wave] = this.scale(lane, beat);
      this.lanes = seen.map((lane) => ({ ...lane, ...this.read(lane, beat), pinned: this.shadow(lane), band: this.interval(lane), scale: this.scales[lane.wave] }));
      this.spoken = this.lanes.map((l) => `${words[l.wave]} ${l.big} ${l.small}`).join(", ");
      this.repaint();
    },
    number: fixed,
    rescale() {
      this.auto = !this.auto;
      this.scales = {};
      this.show(this.beat);
    },
    scale(lane, beat) {
      const all = [beat, this.pinned].filter((b) => b?.waves[lane.wave]).flatMap((b) => this.values(lane, b));
      const band = this.bands?.waves[lane.wave]?.flat().map((v) => (lane.kind === "flow" ? v * TO_L_MIN : v)) ?? [];
      const finite = [...all, ...band].filter(Number.isFinite);
      let [low, high] = finite.length ? [Math.min(...finite), Math.max(...finite)] : lane.scales[0];
      if (!this.auto) {
        let found = lane.scales.find(([bottom, top]) => low >= bottom && high <= top) ?? lane.scales.at(-1);
        while (low < found[0] || high > found[1]) found = [low < found[0] ? Math.min(2 * found[0], -found[1]) : found[0], high > found[1] ? 2 * found[1] : found[1]];
        return found;
      }
      const least = lane.kind === "flow" ? 1 : 6;
      if (high - low < least) [low, high] = [0.5 * (low + high - least), 0.5 * (low + high + least)];
      return niceRange(low, high, this.scales[lane.wave]);
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
    resize(entry) {
      const canvas = this.$refs.canvas;
      const box = canvas.getBoundingClientRect();
      const exact = entry?.devicePixelContentBoxSize?.[0];
      canvas.width = exact?.inlineSize ?? Math.round(box.width * (window.devicePixelRatio || 1));
      canvas.height = exact?.blockSize ?? Math.round(box.height * (window.devicePixelRatio || 1));
      this.ratio = box.width ? canvas.width / box.width : 1;
      this.width = canvas.width / this.ratio;
      this.height = canvas.height / this.ratio;
      this.pen = canvas.getContext("2d");
      this.pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      this.repaint();
    },
    whole(x) {
      return Math.floor(x * this.ratio) / this.ratio; // a border of device pixels: pieces meet without a seam
    },
    head(now) {
      const speed = (this.width - LEFT) / SECONDS;
      return this.whole(LEFT + ((((now - this.since) / 1000) % SECONDS) * speed));
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
        this.paint(this.x, this.width);
        this.x = this.whole(LEFT);
      }
      if (x === this.x) return;
      this.paint(this.x, x);
      this.pen.clearRect(x, 0, this.whole(GAP), this.height);
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
        pen.save();
        pen.beginPath();
        pen.rect(0, k * tall, this.width, tall);
        pen.clip();
        if (from < LEFT) this.axis(lane, low, high, y, k, tall);
        pen.strokeStyle = "#2A3644";
        pen.lineWidth = 1;
        for (const v of [low, high]) this.path([[Math.max(from, LEFT), y(v)], [to, y(v)]]);
        pen.beginPath();
        pen.rect(LEFT, k * tall, this.width - LEFT, tall);
        pen.clip();
        if (this.pinned?.waves[lane.wave]) this.trace(lane, this.pinned, y, from, to, "#7C8896", 1.2);
        if (this.bands?.waves[lane.wave]) this.band(lane, this.bands.waves[lane.wave], y, from, to);
        this.trace(lane, this.beat, y, from, to, lane.colour, 1.8);
        pen.restore();
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
    // The samples between two places, at their times.
    points(lane, wave, period, y, from, to) {
      const scale = lane.kind === "flow" ? TO_L_MIN : 1;
      const n = wave.length;
      const step = (((this.width - LEFT) / SECONDS) * period) / n;
      const points = [];
      for (let i = Math.max(0, Math.floor((from - LEFT) / step) - 2); i <= Math.ceil((to - LEFT) / step) + 2; i += 1) {
        const v = wave[i % n];
        if (Number.isFinite(v)) points.push([LEFT + i * step, y(v * scale)]);
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
