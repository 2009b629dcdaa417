// Shared by all views in the browser: the bus, texts, colours of the style sheet, and measured latency.
import { bandsFor, makeBus, makeLatency } from "./bus.js";
import { timeOf } from "./course.js";
import { laterThanStart } from "./format.js";
import { makeTabStorage } from "./links.js";
import { strokeOf } from "./strokes.js";

export * from "./course.js";
export * from "./format.js";
export * from "./geometry.js";
export * from "./labels.js";
export * from "./links.js";
export * from "./scales.js";
export { svgDash } from "./strokes.js";
export * from "./sweep.js";

export const bus = makeBus();
export const latency = makeLatency(
  () => performance.now(),
  (draw) => requestAnimationFrame(draw),
);
export const tab = makeTabStorage(() => sessionStorage);
export const bandsOf = (shown, topic = "bands") => bandsFor(bus.last(topic), shown);

// Every text of the page by its key, from the server.
export let texts = {};
export function setTexts(all) {
  texts = all;
}

// A colour of the style sheet, light or dark as the reader prefers.
export const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
export const dark = window.matchMedia("(prefers-color-scheme: dark)");
// Calls `listener` with true before printing and false after it; returns a function to stop.
export function onPrint(listener) {
  const print = window.matchMedia("print");
  const change = () => listener(print.matches);
  const [before, after] = [() => listener(true), () => listener(false)];
  print.addEventListener("change", change);
  window.addEventListener("beforeprint", before);
  window.addEventListener("afterprint", after);
  return () => {
    print.removeEventListener("change", change);
    window.removeEventListener("beforeprint", before);
    window.removeEventListener("afterprint", after);
  };
}
export const stroke = (number) => strokeOf(number, dark.matches);

// Common part of all components: texts, and subscriptions to topics of the bus while mounted.
// A component's own `setUp` is called before the first message.
export const listening = (topics) => ({
  data: () => ({ texts }),
  mounted() {
    this.setUp?.();
    const listen = ([topic, listener]) => bus.on(topic, listener.bind(this));
    this.stops = Object.entries(topics).map(listen);
  },
  unmounted() {
    for (const stop of this.stops) stop();
  },
});

// The same for a view whose `beat` is set only while it is visible, as drawing takes long.
export const seenIn = (name, topics) =>
  listening({
    beat(beat) {
      this.latest = beat;
      if (this.seen) this.beat = beat;
    },
    view(view) {
      this.seen = view === name;
      if (this.seen && this.latest) this.beat = this.latest;
    },
    ...topics,
  });

// For a view with `measure`: called again whenever the element with that `ref` changes its size.
export const sized = (name) => ({
  mounted() {
    this.observer = new ResizeObserver(() => this.measure());
    this.observer.observe(this.$refs[name]);
  },
  unmounted() {
    this.observer.disconnect();
  },
});

function redraw() {
  this.show();
}
function keepPinned(beat) {
  this.pinned = beat;
  this.show();
}

// The same for a view drawn by `show`: drawn again when a beat is pinned, and at these topics.
export const drawing = (again, topics) =>
  listening({ pinned: keepPinned, ...Object.fromEntries(again.map((topic) => [topic, redraw])), ...topics });

// The same for a view of a study that the server computes after the beat, `this.study`. It may have failed
// (`failed`), there may be none in this circuit (`empty`), and it may be of a state before (`isOld`).
export const studied = (topic, again, topics = {}) => ({
  mixins: [
    drawing([`${topic}_pinned`, ...again], {
      [topic](study) {
        this.failed = study?.failed ?? "";
        this.study = this.failed ? null : study;
        this.empty = !this.study;
        this.drawn = study?.of;
        this.show();
      },
      beat(beat) {
        this.time = timeOf(beat);
      },
      state({ of }) {
        this.of = of;
      },
      ...topics,
    }),
  ],
  data: () => ({ study: null, empty: false, failed: "", time: "", pinned: null, of: "", drawn: "" }),
  computed: {
    isOld() {
      return this.of !== this.drawn;
    },
    later() {
      return laterThanStart(this.texts, this.time, timeOf(this.pinned));
    },
  },
});
// Text that such a view shows above its numbers.
export const studyNotes = (none) => `
  <p v-if="failed" class="ecl-caution bad" role="alert">{{ failed }}</p>
  <p v-else-if="empty" class="ecl-empty">{{ texts.${none} }}</p>
  <template v-else>
    <p v-for="line in later" :key="line" class="ecl-caution">{{ line }}</p>
    <p v-if="isOld" class="ecl-renewed">{{ drawn ? texts.study_old : texts.computing }}</p>
  </template>`;

window.eclsim = { bus, latency };
