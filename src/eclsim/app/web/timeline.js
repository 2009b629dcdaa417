// Timeline of the course below the monitor: play, jump, events; the page shows the cursor's minute.
import {
  GRAVEST,
  MISSING,
  SIGNS,
  aboutSign,
  alarmsBetween,
  briefly,
  brokenSpans,
  clock,
  curvePath,
  fill,
  fixed,
  isPossible,
  laneRange,
  listening,
  playedTo,
  seenAt,
  tab,
  valueIn,
} from "eclsim-page";

const SPEEDS = [1, 10, 60, 600, 3600];
const [WIDTH, LANE] = [1000, 40];
const SHORTEST_INTERVAL = 250; // ms between two requests for a minute
const STORAGE_KEY = "timeline"; // stored in this tab: length of the course, and minute of the cursor
const STEPS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 };

export default {
  template: `
  <section class="ecl-timeline" :aria-label="texts.timeline">
    <div class="bar">
      <button type="button" class="toggle" ref="toggle" :aria-expanded="isOpen" @click="toggle">{{
        isOpen ? texts.timeline_close : openLabel }}</button>
      <template v-if="isOpen">
        <button type="button" class="play" :disabled="!course || !connected"
          @click="playing ? stop() : play()">{{
          playing ? texts.timeline_pause : texts.timeline_play }}</button>
        <button type="button" :disabled="!minute" :title="texts.timeline_start"
          :aria-label="texts.timeline_start" @click="jump(0)">|◀</button>
        <label>{{ texts.timeline_speed }} <select v-model.number="speed">
          <option v-for="s in speeds" :key="s" :value="s">{{ s }}×</option></select></label>
        <label>{{ texts.timeline_length }} <select :value="length"
          @change="resize(Number($event.target.value))">
          <option v-for="m in lengths" :key="m" :value="m">{{ hours(m) }}</option></select></label>
        <label :title="texts.timeline_record_hint"><input type="checkbox" v-model="recording"
          @change="record" /> {{ texts.timeline_record }}</label>
        <details v-if="course" class="lanes"><summary>{{ texts.timeline_lanes }} ▾</summary>
          <div><label v-for="r in course.rows" :key="r.name"><input type="checkbox" :checked="isSeen(r)"
            @change="seen = { ...seen, [r.name]: $event.target.checked }" /> {{ r.label }}</label></div>
        </details>
        <span class="shown" role="status" :aria-live="playing ? 'off' : 'polite'">{{
          busy ? texts.timeline_computing : isOld ? texts.study_old : shown }}</span>
      </template>
    </div>
    <template v-if="isOpen">
      <p v-if="again" class="ahead" role="status">{{ beat ? again : ahead }}</p>
      <p v-if="paused" class="refused" role="alert">{{ paused }}</p>
      <p v-if="impossible" class="refused" role="alert">{{ impossible }}</p>
      <p v-if="course?.message" class="refused" role="alert">{{ course.message }}</p>
      <p v-if="counts.length" class="counts">{{ texts.timeline_alarms }}: <button v-for="c in counts"
        :key="c.kind" type="button" class="link" :class="c.kind" @click="jump(c.minute)">{{
        c.text }}</button></p>
      <details v-if="course?.approximations.length" class="remarks"><summary>† {{ remarks }}</summary>
        <p v-for="a in course.approximations" :key="a" role="note">{{ a }}</p></details>
      <div v-if="course" class="chart" :class="{ old: isOld }" ref="chart" tabindex="0" role="slider"
        :aria-label="texts.timeline_cursor" aria-valuemin="0" :aria-valuemax="end" :aria-valuenow="minute"
        :aria-valuetext="time(minute)" @pointerdown="grab" @pointermove="drag" @pointerup="held = false"
        @pointercancel="held = false" @keydown="step">
        <div v-for="r in rows" :key="r.name" class="lane">
          <span class="name" :title="r.care"><template v-if="r.care">† </template>{{ r.label }} <em>{{
            r.unit }}</em></span>
          <svg :viewBox="'0 0 1000 40'" preserveAspectRatio="none" aria-hidden="true">
            <rect v-for="a in r.alarms" :key="a.from + a.kind" :x="a.from" y="0" :width="a.width" height="40"
              :class="a.kind" />
            <line v-for="(e, k) in marks" :key="k" :x1="e.x" :x2="e.x" y1="0" y2="40" class="event" />
            <path :d="r.path" />
            <line :x1="at(minute)" :x2="at(minute)" y1="0" y2="40" class="cursor" />
          </svg>
          <span class="range"><i>{{ r.high }}</i><i>{{ r.low }}</i></span>
          <b>{{ r.now }}</b>
        </div>
        <div class="axis"><span v-for="t in ticks" :key="t" :style="{ left: 100 * t / length + '%' }">{{
          time(t) }}</span></div>
      </div>
      <p v-if="refused" class="refused" role="alert">{{ refused }}</p>
      <form class="new" @submit.prevent="add">
        <label>{{ texts.timeline_what }} <select v-model="what">
          <optgroup v-for="g in groups" :key="g.label" :label="g.label">
            <option v-for="p in g.items" :key="p.key" :value="p.key">{{ p.label }}</option>
          </optgroup></select></label>
        <label>{{ texts.timeline_amount }} <input v-model="amount" inputmode="decimal" size="6"
          maxlength="30" /> {{ chosen?.unit }}</label>
        <label>{{ texts.timeline_over }} <input v-model="over" inputmode="decimal" size="4"
          maxlength="30" /> {{ texts.timeline_minutes }}</label>
        <button type="submit" :disabled="!connected" @click="onlyOnce">{{ addLabel }}</button>
      </form>
      <div class="lists">
        <ol v-if="events.length" :aria-label="texts.timeline_events"><li v-for="(e, k) in events" :key="k">
          <button type="button" class="link" @click="jump(e.at)">{{ time(e.at) }}</button> {{ e.words
          }}<template v-if="e.lasts">, {{ texts.timeline_over }} {{ e.lasts }} {{
            texts.timeline_minutes }}</template>
          <button type="button" class="remove" @click="$event.detail < 2 && $emit('remove', { number: k })"
            :aria-label="texts.timeline_remove" :title="texts.timeline_remove">×</button></li></ol>
        <ul v-if="course" :aria-label="texts.timeline_alarms">
          <li v-if="!course.alarms.length">{{ texts.timeline_no_alarms }}</li>
          <li v-for="a in course.alarms" :key="a.sentence" :class="a.kind">
            <button type="button" class="link" @click="jump(seenAt(a, course.time))">{{
              time(a.at_min) }}</button>
            {{ signs[a.kind] }}{{ a.sentence }}</li>
        </ul>
        <p v-if="course" class="balance">{{ balance }}</p>
      </div>
    </template>
  </section>`,
  props: { lengths: Array },
  mixins: [
    listening({
      beat(beat) {
        this.cautions = beat.cautions;
        this.shownBeat = beat;
      },
      state({ events, of, start }) {
        // Another patient begins at its own start, and not in the middle of the course that was played.
        if (this.playing && this.start !== start) {
          this.stop();
          this.jump(0);
        }
        this.start = start;
        this.events = events;
        if (this.of !== of) this.refused = "";
        this.of = of;
        if (!this.begun) this.goOn();
        this.keepPlace();
      },
      possible_events(possible) {
        this.possible = possible;
        if (!this.chosen) this.what = possible[0]?.key;
      },
      turned({ key }) {
        if (this.recording && this.playing && key !== "events") this.stop();
      },
      go_to({ minute, length }) {
        if (minute) this.follow(minute, length);
        else if (this.isOpen) this.jump(0);
      },
      course_busy() {
        this.busy = true;
      },
      course(course) {
        this.busy = false;
        if (this.course?.of !== course.of) this.paused = ""; // the same course again has the same alarms
        this.impossible = course.refused ?? "";
        this.course = course.refused ? null : course;
        if (!this.course) this.stop();
        this.asked = undefined;
        this.minute = this.course ? Math.min(this.minute, this.end) : 0;
        if (this.isOpen) this.ask();
      },
      error({ key, messages }) {
        if (key === "events") this.refused = messages.join(" ");
      },
      connected(on) {
        this.connected = on;
        if (!on) this.stop();
      },
    }),
  ],
  data: () => ({
    signs: SIGNS,
    isOpen: false,
    course: null,
    busy: false,
    refused: "",
    again: "",
    paused: "",
    impossible: "",
    connected: true,
    events: [],
    possible: [],
    what: "",
    amount: "300",
    over: "15",
    minute: 0,
    of: "",
    speed: 600,
    speeds: SPEEDS,
    length: 360,
    playing: false,
    held: false,
    recording: false,
    seen: {},
    cautions: {},
    shownBeat: null,
  }),
  unmounted() {
    this.stop();
  },
  watch: {
    what() {
      const value = this.chosen?.value ?? 0;
      this.amount = String(Number(Number(value).toPrecision(4)));
      this.over = this.chosen?.give ? "15" : "0";
    },
  },
  computed: {
    chosen() {
      return this.possible.find((p) => p.key === this.what);
    },
    groups() {
      const of = (give) => this.possible.filter((p) => p.give === give);
      return [
        { label: this.texts.timeline_give, items: of(true) },
        { label: this.texts.timeline_set, items: of(false) },
      ];
    },
    // The beat of the cursor if the page shows it, else null.
    beat() {
      return this.shownBeat?.minute === this.minute && this.shownBeat.of === this.of ? this.shownBeat : null;
    },
    // Whether the course belongs to an earlier state, or may do so (while busy or without a connection).
    isOld() {
      return this.busy || !this.connected || (!!this.course && this.course.of !== this.of);
    },
    // End of the known part if the course stopped early.
    end() {
      return Math.min(this.course ? (this.course.time.at(-1) ?? 0) : this.length, this.length);
    },
    beatByBeat() {
      return this.length < 60;
    },
    // Minute of the numbers on the page, which follow the cursor with a delay.
    shown() {
      const { minute = 0 } = this.shownBeat ?? {};
      const words = this.recording && minute ? "timeline_at_recorded" : "timeline_at";
      const at = fill(this.texts[words], { time: this.time(minute) });
      return this.course?.message && minute >= this.end ? `${at} ${this.texts.timeline_ended}` : at;
    },
    // Until the reopened course is computed, the page shows another minute than the cursor.
    ahead() {
      const { minute = 0 } = this.shownBeat ?? {};
      return fill(fill(this.texts.timeline_ahead, { shown: this.time(minute) }), {
        time: this.time(this.minute),
      });
    },
    // A patient from a link or file may have events: the closed timeline indicates them.
    openLabel() {
      const { length: count } = this.events;
      const words = count ? (count > 1 ? "timeline_open_events" : "timeline_open_event") : "timeline_open";
      return fill(this.texts[words], { count });
    },
    addLabel() {
      return fill(this.texts.timeline_add, { time: this.time(this.minute) });
    },
    rows() {
      const { time, rows, alarms } = this.course;
      return rows.filter(this.isSeen).map(({ name, label, unit, digits, values, usual }) => {
        const [low, high] = laneRange(values, unit, 4 * 10 ** -digits);
        const path = curvePath(time, values, { end: this.length, width: WIDTH, height: LANE, low, high });
        const met = alarms.filter((a) => a.quantity === name || a.kind === "collapse");
        const broken = brokenSpans(met, { last: time.at(-1), end: this.length, width: WIDTH });
        const own = usual ? this.beat?.outputs[name] : undefined;
        const now = isPossible(this.beat)
          ? aboutSign(this.beat, name) + fixed(own ?? valueIn(time, values, this.minute), digits)
          : SIGNS.collapse + MISSING;
        const care = this.cautions[name] ?? "";
        const written = [low, high].map((v) => fixed(v, high - low < 0.3 ? 2 : high - low < 3 ? 1 : 0));
        return { name, label, unit, path, alarms: broken, now, care, low: written[0], high: written[1] };
      });
    },
    // How many limits of each kind the course breaks, and the first moment.
    counts() {
      const { alarms = [], time } = this.course ?? {};
      const of = GRAVEST.map((kind) => alarms.filter((alarm) => alarm.kind === kind)).filter((a) => a.length);
      return of.map((same) => {
        const [{ kind }] = same;
        const first = same.toSorted((a, b) => a.at_min - b.at_min)[0];
        const words = { kind: SIGNS[kind] + this.texts[`kind_${kind}`], count: same.length };
        const text = fill(this.texts.timeline_count, { ...words, time: this.time(first.at_min) });
        return { kind, minute: seenAt(first, time), text };
      });
    },
    remarks() {
      return fill(this.texts.timeline_remarks, { count: this.course.approximations.length });
    },
    marks() {
      return this.events.map(({ at }) => ({ x: this.at(at) }));
    },
    ticks() {
      return [0, 1, 2, 3, 4, 5].map((k) => (k * this.length) / 6);
    },
    balance() {
      const b = this.course.balance;
      const blood = fill(
        fill(this.texts.timeline_balance, {
          start: fixed(b.blood_volume_start_ml, 0),
          end: fixed(b.blood_volume_end_ml, 0),
          given: fixed(b.given_ml, 0),
          removed: fixed(b.removed_ml, 0),
        }),
        { refilled: fixed(b.refilled_ml, 0), error: fixed(b.error_ml, 3), seconds: this.course.seconds },
      );
      return this.course.drug ? `${blood} ${this.course.drug}.` : blood;
    },
  },
  methods: {
    time(minute) {
      return clock(minute, this.beatByBeat);
    },
    seenAt,
    isSeen({ name, usual }) {
      return this.seen[name] ?? usual;
    },
    at(minute) {
      return (minute / this.length) * WIDTH;
    },
    hours(minutes) {
      const words = minutes < 60 ? "timeline_beats" : "timeline_hours";
      return fill(this.texts[words], { minutes, hours: minutes / 60 });
    },
    // Position of this tab, restored when the page is reloaded or the server restarted.
    keepPlace() {
      const { of, length, minute, recording } = this;
      tab.keep(STORAGE_KEY, this.isOpen ? { of, length, minute, recording } : null);
    },
    goOn() {
      this.begun = true;
      const { of, length, minute, recording } = tab.read(STORAGE_KEY) ?? {};
      if (of !== this.of || !this.lengths.includes(length) || !(minute >= 0)) return;
      this.follow(minute, length);
      this.again = fill(this.texts.timeline_again, { time: this.time(minute) });
      this.recording = recording === true;
      if (this.recording) this.record();
    },
    record() {
      this.$emit("record", { on: this.recording });
      this.keepPlace();
    },
    toggle() {
      this.isOpen = !this.isOpen;
      this.again = this.paused = "";
      this.stop();
      this.recording = false;
      const last = this.events.at(-1)?.at ?? 0;
      this.length = this.lengths.find((m) => m >= this.length && m > last) ?? this.lengths.at(-1);
      this.minute = 0;
      this.course = null;
      this.busy = this.isOpen;
      this.$emit("open", { number: this.isOpen ? this.length : 0 });
      this.keepPlace();
      // The monitor above is now lower: on a phone the button would be out of sight.
      this.$nextTick(() => this.$refs.toggle.scrollIntoView({ block: "nearest" }));
    },
    // A saved minute of a course of that length.
    follow(minute, length) {
      this.stop();
      if (!this.isOpen || this.length !== length) {
        Object.assign(this, { isOpen: true, length, course: null, busy: true });
        this.$emit("open", { number: length });
      }
      this.minute = minute;
      if (this.course) this.ask();
    },
    resize(length) {
      if (length === this.length) return; // no other course would end the waiting
      this.stop();
      this.length = length;
      this.busy = true;
      this.jump(Math.min(this.minute, length));
      this.$emit("open", { number: length });
    },
    // Play stops where an alarm first appears, and continues when pressed again.
    pauseAt({ minute, alarms }) {
      this.stop();
      const words = { time: this.time(minute), alarms: alarms.map(briefly).join("; ") };
      this.paused = fill(this.texts.timeline_paused, words);
    },
    play() {
      this.paused = "";
      if (this.minute >= this.end - 1e-6) this.minute = 0;
      this.playing = true;
      const own = (this.run = Symbol("play")); // pausing and playing within one frame starts a second run
      let before = performance.now();
      const frame = (now) => {
        if (!this.playing || this.run !== own) return;
        // The course of an earlier state is not played: its alarms are not those of the next one.
        const ms = this.isOld ? 0 : now - before;
        const minute = playedTo(this.minute, ms, this.speed, this.end);
        const met = alarmsBetween(this.course.alarms, this.course.time, this.minute, minute);
        this.minute = met?.minute ?? minute;
        before = now;
        this.ask();
        if (met) this.pauseAt(met);
        else if (this.minute >= this.end) this.stop();
        else requestAnimationFrame(frame);
      };
      requestAnimationFrame(frame);
    },
    stop() {
      this.playing = false;
      clearTimeout(this.later);
      this.later = undefined;
      if (this.minute && this.course) this.$emit("show", { minute: this.minute });
    },
    jump(minute) {
      this.again = this.paused = this.refused = "";
      this.minute = Math.min(Math.max(minute, 0), this.end);
      this.ask();
    },
    // The page follows the cursor, a few minutes a second.
    ask() {
      if (this.later) return;
      const send = () => {
        this.later = undefined;
        if (this.isOpen && this.asked !== this.minute) this.$emit("show", { minute: this.minute });
        this.asked = this.minute;
        this.keepPlace();
      };
      this.later = setTimeout(send, Math.max(SHORTEST_INTERVAL - (performance.now() - (this.sent ?? 0)), 0));
      this.sent = performance.now();
    },
    grab(event) {
      this.held = true;
      event.currentTarget.setPointerCapture(event.pointerId);
      this.drag(event);
    },
    drag(event) {
      if (!this.held) return;
      const { left, width } = this.$refs.chart.querySelector("svg").getBoundingClientRect();
      const finest = this.beatByBeat ? 60 : 1;
      this.jump(Math.round(((event.clientX - left) / width) * this.length * finest) / finest);
    },
    step(event) {
      const steps = STEPS[event.key] ?? { Home: -Infinity, End: Infinity }[event.key];
      if (steps === undefined) return;
      event.preventDefault();
      this.jump(this.minute + (steps * this.length) / 360);
    },
    // Ignore the second click of a double click.
    onlyOnce(click) {
      if (click.detail > 1) click.preventDefault();
    },
    // Send the typed text unchanged: the server parses it, and asks if it is ambiguous.
    add() {
      const at = { at_min: Math.floor(1000 * this.minute) / 1000 };
      const [kind, minutes] = this.chosen.give ? ["give", "over_min"] : ["set", "ramp_min"];
      this.$emit("add", { ...at, [kind]: { [this.what]: this.amount }, [minutes]: this.over });
    },
  },
};
