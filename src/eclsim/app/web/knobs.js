// Panel of controls: a slider with a number field for each value, a list for each choice.
import { bus, clock, fill, latency, listening, positionOf, positions, valueAt } from "eclsim-page";

const SEND_AFTER = 400; // ms after which a change is sent even if the last one is not yet drawn
let seq = 0;

const written = (value) => (typeof value === "number" ? String(Number(value.toPrecision(4))) : value);

// A single control, redrawn only when it changes: a beat changes few of the dozens.
const Knob = {
  template: `
  <div v-if="knob.options" class="ecl-pick" :class="{ bad: error }">
    <label :for="id">{{ knob.label }}</label>
    <select :id="id" :value="value" :disabled="!connected"
      @change="$emit('send', knob.key, $event.target.value)">
      <option v-for="[name, text] in knob.options" :key="name" :value="name">{{ text }}</option>
    </select>
    <p v-if="error" role="alert">{{ error }}</p>
    <p v-for="[kind, words] in remarks" :key="words" role="note" :class="kind">{{ words }}</p>
  </div>
  <div v-else class="ecl-knob" :class="{ bad: error }">
    <label :for="id" :title="knob.hint">{{ knob.label }}</label>
    <span class="typed">
      <input :id="id" type="text" inputmode="decimal" autocomplete="off" maxlength="40"
        :value="typed ?? text" :aria-invalid="!!error" :data-typed="typed"
        :aria-describedby="id + '-unit' + (error ? ' ' + id + '-error' : '')"
        :disabled="!connected" @input="$emit('type', knob.key, $event.target.value)"
        @change="$emit('enter', knob, $event.target.value)" @keydown="arrow" @keydown.esc="restore"
        @focus="$event.target.select()" @blur="$emit('left')" />
      <small :id="id + '-unit'">{{ knob.unit }}</small>
    </span>
    <input type="range" :min="0" :max="last" step="1" :value="position" :aria-label="knob.label"
      :aria-valuetext="text + ' ' + knob.unit" :style="{ '--at': 100 * position / last + '%' }"
      :disabled="!connected" @input="$emit('move', knob, Number($event.target.value))" />
    <p v-if="error" :id="id + '-error'" role="alert">{{ error }}</p>
    <p v-for="[kind, words] in remarks" :key="words" role="note" :class="kind">{{ words }}</p>
  </div>`,
  // `refusals` counts refusals: a further one resets the field even if the reason is the same.
  props: ["knob", "id", "value", "error", "remarks", "refusals", "connected", "typed"],
  emits: ["send", "enter", "move", "type", "left"],
  computed: {
    text() {
      return written(this.value);
    },
    last() {
      return positions(this.knob);
    },
    position() {
      return positionOf(this.knob, this.value);
    },
  },
  methods: {
    // Otherwise what is typed would be sent on leaving the field.
    restore(event) {
      this.$emit("left");
      this.$nextTick(() => event.target.select());
    },
    arrow(event) {
      const steps = { ArrowUp: 1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
      if (!steps) return;
      event.preventDefault();
      this.$emit("move", this.knob, Math.min(Math.max(this.position + steps, 0), this.last));
    },
  },
};

export default {
  components: { Knob },
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
      <p v-for="[kind, words] in remarks[group.key]" :key="words" role="note" :class="kind">{{ words }}</p>
      <Knob v-for="k in panel.filter((k) => k.group === group.key)" :key="k.key" :knob="k" :id="id(k)"
        :value="values[k.key]" :error="errors[k.key]" :refusals="errors[k.key] && refusals"
        :remarks="remarks[k.key]" :connected="connected"
        :typed="typed?.key === k.key ? typed.text : undefined"
        @send="send" @enter="enter" @move="move" @type="(key, text) => (typed = { key, text })"
        @left="typed = typed?.entered ? typed : undefined" />
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
        this.remarks = state.remarks;
      },
      error(error) {
        this.refuse(error);
      },
      beat(beat) {
        this.minute = beat.minute;
        this.transient = beat.transient;
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
    remarks: {},
    refusals: 0,
    devices: {},
    policy: "as_published",
    connected: true,
    typed: undefined,
    minute: 0,
    transient: false,
    recording: false,
  }),
  computed: {
    // Note that a later minute is shown, in which settings may differ from the controls.
    later() {
      if (!this.minute || this.recording) return "";
      return fill(this.texts.knobs_of_start, { time: clock(this.minute, this.transient) });
    },
  },
  methods: {
    id: (knob) => `knob-${knob.key.replace(/\W/g, "-")}`,
    switchLabel(group) {
      const [on, off] = group.section ? ["switch_on", "switch_off"] : ["connect", "disconnect"];
      return fill(this.texts[this.devices[group.key] ? off : on], { device: group.label });
    },
    enter(knob, text) {
      this.typed = { key: knob.key, text, entered: true };
      this.send(knob.key, text);
    },
    // A changed control keeps its value until the server has processed it.
    move(knob, position) {
      if (this.typed?.key === knob.key) this.typed = undefined;
      this.values[knob.key] = valueAt(knob, position);
      this.send(knob.key, this.values[knob.key]);
      this.held = { key: knob.key, seq };
    },
    // While a change is being processed, only the newest one waits.
    send(key, value) {
      seq += 1;
      latency.start(seq);
      this.next = { key, value, seq };
      if (!this.away || performance.now() - this.away.since > SEND_AFTER) this.flush();
      else this.timer ??= setTimeout(() => this.flush(), SEND_AFTER);
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
    // Without a connection, controls show the settings of the displayed numbers and are disabled.
    connect(on) {
      this.connected = on;
      const shown = on ? bus.last("state") : bus.last("beat");
      if (!shown) return;
      clearTimeout(this.timer);
      this.timer = this.next = this.away = this.held = this.typed = undefined;
      this.values = { ...shown.values };
      for (const knob of this.panel) {
        const field = document.getElementById(this.id(knob));
        if (field) field.value = knob.options ? this.values[knob.key] : written(this.values[knob.key]);
      }
    },
    tell(event, data) {
      bus.publish("turned", { key: data.key ?? event });
      this.$emit(event, data);
    },
    refuse(error) {
      this.typed = undefined;
      this.refusals += 1;
      this.errors = { ...this.errors, [error.key]: error.messages.join(" ") };
      this.away = this.held = undefined;
      this.flush();
    },
  },
};
