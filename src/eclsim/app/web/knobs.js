// The panel of knobs: a slider and a typed number each, a list for each choice.
import { bus, clock, fill, latency, listening, positionOf, positions, valueAt } from "eclsim-page";

const WAIT = 400; // ms after which a turn is sent although the last one is not yet drawn
let seq = 0;

export default {
  template: `
  <div class="ecl-knobs" tabindex="-1" role="group" :aria-label="texts.knobs">
    <span id="knobs" tabindex="-1"></span>
    <p v-if="later" class="later" role="note">{{ later }}</p>
    <section v-for="group in groups" :key="group.key" :class="'group-' + group.key" :aria-label="group.label">
      <header>
        <h2>{{ group.label }}</h2>
        <button v-if="group.key in devices" type="button" class="ecl-switch" role="switch"
          :disabled="!connected" :aria-checked="devices[group.key]"
          :aria-label="switchLabel(group)" :title="switchLabel(group)"
          @click="tell('connect', { device: group.key })"><i></i></button>
      </header>
      <p v-if="errors[group.key]" class="refused" role="alert">{{ errors[group.key] }}</p>
      <template v-for="k in panel.filter((k) => k.group === group.key)" :key="k.key">
        <div v-if="k.options" class="ecl-pick" :class="{ bad: errors[k.key] }">
          <label :for="id(k)">{{ k.label }}</label>
          <select :id="id(k)" :value="values[k.key]" :disabled="!connected"
            @change="send(k.key, $event.target.value)">
            <option v-for="[name, text] in k.options" :key="name" :value="name">{{ text }}</option>
          </select>
          <p v-if="errors[k.key]" role="alert">{{ errors[k.key] }}</p>
        </div>
        <div v-else class="ecl-knob" :class="{ bad: errors[k.key] }">
          <label :for="id(k)" :title="k.hint">{{ k.label }}</label>
          <span class="typed">
            <input :id="id(k)" type="text" inputmode="decimal" autocomplete="off" maxlength="40"
              :value="shown(k)" :aria-invalid="!!errors[k.key]"
              :aria-describedby="id(k) + '-unit' + (errors[k.key] ? ' ' + id(k) + '-error' : '')"
              :disabled="!connected" @input="typed = { key: k.key, text: $event.target.value }"
              @change="enter(k, $event.target.value)" @keydown="arrow(k, $event)"
              @focus="$event.target.select()" @blur="typed = typed?.entered ? typed : undefined" />
            <small :id="id(k) + '-unit'">{{ k.unit }}</small>
          </span>
          <input type="range" :min="0" :max="positions(k)" step="1" :value="position(k)" :aria-label="k.label"
            :aria-valuetext="written(k) + ' ' + k.unit"
            :style="{ '--at': 100 * position(k) / positions(k) + '%' }" :disabled="!connected"
            @input="move(k, Number($event.target.value))" />
          <p v-if="errors[k.key]" :id="id(k) + '-error'" role="alert">{{ errors[k.key] }}</p>
        </div>
      </template>
    </section>
    <section class="group-model" :aria-label="texts.group_model">
      <header><h2>{{ texts.group_model }}</h2></header>
      <div class="ecl-pick">
        <label for="knob-policy">{{ texts.policy }}</label>
        <select id="knob-policy" :value="policy" :disabled="!connected"
          @change="tell('policy', { policy: $event.target.value })">
          <option value="as_published">{{ texts.as_published }}</option>
          <option value="patient_held">{{ texts.patient_held }}</option>
        </select>
        <p v-if="errors.policy" role="alert">{{ errors.policy }}</p>
      </div>
    </section>
  </div>`,
  mixins: [
    listening({
      display(display) {
        this.groups = display.groups;
      },
      panel(panel) {
        this.panel = panel;
      },
      state(state) {
        const { held } = this;
        if (this.typed?.entered) this.typed = undefined;
        const ahead = held && state.seq < held.seq && held.key in state.values;
        this.values = { ...state.values, ...(ahead ? { [held.key]: this.values[held.key] } : {}) };
        this.devices = state.devices;
        this.policy = state.policy;
        this.recording = state.recording;
        this.errors = {};
      },
      error(error) {
        this.refuse(error);
      },
      beat(beat) {
        this.minute = beat.minute;
        this.passing = beat.passing;
        this.arrived(beat.seq);
      },
      failed() {
        this.arrived(Infinity);
      },
      connected(on) {
        this.connect(on);
      },
    }),
  ],
  data: () => ({
    groups: [],
    panel: [],
    values: {},
    errors: {},
    devices: {},
    policy: "as_published",
    connected: true,
    typed: undefined,
    minute: 0,
    passing: false,
    recording: false,
  }),
  computed: {
    // A later minute is shown, and the knobs do not stand as they do then.
    later() {
      if (!this.minute || this.recording) return "";
      return fill(this.texts.knobs_of_start, { time: clock(this.minute, this.passing) });
    },
  },
  methods: {
    positions,
    id: (knob) => `knob-${knob.key.replace(/\W/g, "-")}`,
    switchLabel(group) {
      return fill(this.texts[this.devices[group.key] ? "disconnect" : "connect"], { device: group.label });
    },
    position(knob) {
      return positionOf(knob, this.values[knob.key]);
    },
    written(knob) {
      const value = this.values[knob.key];
      return typeof value === "number" ? String(Number(value.toPrecision(4))) : value;
    },
    // What is being typed stays, whatever arrives meanwhile.
    shown(knob) {
      return this.typed?.key === knob.key ? this.typed.text : this.written(knob);
    },
    enter(knob, text) {
      this.typed = { key: knob.key, text, entered: true };
      this.send(knob.key, text);
    },
    arrow(knob, event) {
      const steps = { ArrowUp: 1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
      if (!steps) return;
      event.preventDefault();
      this.typed = undefined;
      this.move(knob, Math.min(Math.max(this.position(knob) + steps, 0), positions(knob)));
    },
    // What is turned here stays as it is until the server has caught up with it.
    move(knob, position) {
      this.values[knob.key] = valueAt(knob, position);
      this.send(knob.key, this.values[knob.key]);
      this.held = { key: knob.key, seq };
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
      const shown = on ? bus.last("state") : bus.last("beat");
      if (!shown) return;
      clearTimeout(this.timer);
      this.timer = this.next = this.away = this.held = this.typed = undefined;
      this.values = { ...shown.values };
      for (const knob of this.panel) {
        const field = document.getElementById(this.id(knob));
        if (field) field.value = knob.options ? this.values[knob.key] : this.written(knob);
      }
    },
    tell(event, data) {
      bus.publish("turned", { key: data.key ?? event });
      this.$emit(event, data);
    },
    refuse(error) {
      this.typed = undefined;
      this.errors = { ...this.errors, [error.key]: error.messages.join(" ") };
      this.away = this.held = undefined;
      this.flush();
    },
  },
};
