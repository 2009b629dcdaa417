// The panel of knobs: a slider and a typed number each, a list for each choice.
import { bus, latency, words } from "eclsim-page";

const WAIT = 400; // ms after which a turn is sent although the last one is not yet drawn
const POSITIONS = 400;
let seq = 0;

export default {
  template: `
  <div class="ecl-knobs" tabindex="-1" role="group" :aria-label="words.knobs">
    <span id="knobs" tabindex="-1"></span>
    <section v-for="group in groups" :key="group" :class="'group-' + group" :aria-label="words['group_' + group]">
      <header>
        <h2>{{ words['group_' + group] }}</h2>
        <button v-if="group in devices" type="button" class="ecl-switch" role="switch" :disabled="!connected" :aria-checked="devices[group]"
          :aria-label="label(group)" :title="label(group)" @click="tell('connect', { device: group })"><i></i></button>
      </header>
      <template v-for="c in of(group)" :key="c.key">
        <div v-if="c.options" class="ecl-pick" :class="{ bad: errors[c.key] }">
          <label :for="id(c)">{{ c.label }}</label>
          <select :id="id(c)" :value="values[c.key]" :disabled="!connected" @change="pick(c, $event.target.value)">
            <option v-for="[name, text] in c.options" :key="name" :value="name">{{ text }}</option>
          </select>
          <p v-if="errors[c.key]" role="alert">{{ errors[c.key] }}</p>
        </div>
        <div v-else class="ecl-knob" :class="{ bad: errors[c.key] }">
          <label :for="id(c)" :title="c.hint">{{ c.label }}</label>
          <span class="typed">
            <input :id="id(c)" type="text" inputmode="decimal" autocomplete="off" maxlength="40" :value="written(c)"
              :aria-invalid="!!errors[c.key]" :aria-describedby="errors[c.key] ? id(c) + '-error' : null"
              :disabled="!connected" @change="type(c, $event)" @keydown="arrow(c, $event)" @focus="$event.target.select()" />
            <small>{{ c.unit }}</small>
          </span>
          <input type="range" :min="0" :max="positions(c)" step="1" :value="place(c)" :aria-label="c.label"
            :aria-valuetext="written(c) + ' ' + c.unit" :style="{ '--at': 100 * place(c) / positions(c) + '%' }"
            :disabled="!connected" @input="slide(c, $event)" />
          <p v-if="errors[c.key]" :id="id(c) + '-error'" role="alert">{{ errors[c.key] }}</p>
        </div>
      </template>
    </section>
    <section class="group-model" :aria-label="words.group_model">
      <header><h2>{{ words.group_model }}</h2></header>
      <div class="ecl-pick">
        <label for="knob-policy">{{ words.policy }}</label>
        <select id="knob-policy" :value="policy" :disabled="!connected" @change="tell('policy', { policy: $event.target.value })">
          <option value="as_published">{{ words.as_published }}</option>
          <option value="patient_held">{{ words.patient_held }}</option>
        </select>
      </div>
    </section>
  </div>`,
  data: () => ({
    words, panel: [], values: {}, errors: {}, devices: {}, policy: "as_published",
    connected: true, groups: ["heart", "vessels", "ecmo", "crrt", "lvad"],
  }),
  mounted() {
    this.words = words;
    this.stops = [
      bus.on("panel", (panel) => (this.panel = panel)),
      bus.on("state", (state) => {
        const held = this.held && state.seq < this.held.seq && this.held.key in state.values;
        this.values = { ...state.values, ...(held ? { [this.held.key]: this.values[this.held.key] } : {}) };
        this.devices = state.devices;
        this.policy = state.policy;
        this.errors = {};
      }),
      bus.on("error", (error) => this.refuse(error)),
      bus.on("beat", (beat) => this.arrived(beat.seq)),
      bus.on("connected", (on) => this.connect(on)),
      bus.on("failed", () => this.arrived(Infinity)),
    ];
  },
  unmounted() {
    for (const stop of this.stops) stop();
  },
  methods: {
    id: (c) => "knob-" + c.key.replace(/\W/g, "-"),
    of(group) {
      return this.panel.filter((c) => c.group === group);
    },
    label(device) {
      const key = this.devices[device] ? "disconnect" : "connect";
      return words[key].replace("{device}", words["group_" + device]);
    },
    positions: (c) => (c.log ? POSITIONS : Math.max(1, Math.round((c.high - c.low) / c.step))),
    place(c) {
      const value = Math.min(Math.max(this.values[c.key], c.low), c.high);
      const share = c.log ? Math.log(value / c.low) / Math.log(c.high / c.low) : (value - c.low) / (c.high - c.low);
      return Math.round(share * this.positions(c));
    },
    at(c, place) {
      const share = place / this.positions(c);
      const value = c.log ? c.low * (c.high / c.low) ** share : c.low + share * (c.high - c.low);
      return Number((c.log ? value : Math.round(value / c.step) * c.step).toPrecision(c.log ? 3 : 10));
    },
    written(c) {
      const value = this.values[c.key];
      return typeof value === "number" ? String(Number(value.toPrecision(4))) : value;
    },
    slide(c, event) {
      this.move(c, Number(event.target.value));
    },
    type(c, event) {
      this.send(c.key, event.target.value);
    },
    arrow(c, event) {
      const way = { ArrowUp: 1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
      if (!way) return;
      event.preventDefault();
      this.move(c, Math.min(Math.max(this.place(c) + way, 0), this.positions(c)));
    },
    // What is turned here stays as it is until the server has caught up with it.
    move(c, place) {
      this.values[c.key] = this.at(c, place);
      this.send(c.key, this.values[c.key]);
      this.held = { key: c.key, seq };
    },
    pick(c, value) {
      this.send(c.key, value);
    },
    // Only the newest turn waits while one is on its way.
    send(key, value) {
      seq += 1;
      latency.start(seq);
      this.next = { key, value, seq };
      if (!this.away || performance.now() - this.away.since > WAIT) this.flush();
      else this.timer ??= setTimeout(() => this.flush(), WAIT);
    },
    flush() {
      clearTimeout(this.timer);
      this.timer = undefined;
      if (!this.next) return;
      this.away = { seq: this.next.seq, since: performance.now() };
      this.tell("turn", this.next);
      this.next = undefined;
    },
    arrived(drawn) {
      if (this.away && drawn >= this.away.seq) this.away = undefined;
      if (this.held && drawn >= this.held.seq) this.held = undefined;
      if (!this.away) this.flush();
    },
    // Without a connection the knobs stand where the numbers that are shown belong, and cannot be turned.
    connect(on) {
      this.connected = on;
      const now = on ? bus.last("state") : bus.last("beat");
      if (!now) return;
      clearTimeout(this.timer);
      this.timer = this.next = this.away = this.held = undefined;
      this.values = { ...now.values };
      for (const c of this.panel) {
        const field = document.getElementById(this.id(c));
        if (field) field.value = c.options ? this.values[c.key] : this.written(c);
      }
    },
    tell(event, data) {
      bus.publish("turned", { key: data.key ?? event });
      this.$emit(event, data);
    },
    refuse(error) {
      this.errors = { ...this.errors, [error.key]: error.messages.join(" ") };
      this.away = this.held = undefined;
      this.flush();
    },
  },
};
