// Hands messages of the server to the views, and keys pressed anywhere to the server.
import { markRaw } from "vue";
import {
  addressOf,
  briefs,
  bus,
  clock,
  doubtOf,
  fill,
  linkIn,
  remember,
  setTexts,
  subjects,
  tab,
} from "eclsim-page";

const ANSWER_TIMEOUT = 5000; // ms within which the server must answer
const ASK_AFTER = 1500; // ms without an answer after which the server is pinged
const PALE_AFTER = 400; // ms after which numbers that do not yet include a change are dimmed
const REPORT_TIMEOUT = 2000; // ms without a progress report after which the server is pinged as well
const ANNOUNCE_AFTER = 1000; // ms without another outcome after which a screen reader announces it
const HANDSHAKE = 1000; // ms after a new connection; if the server refuses it, the page is reloaded
const GRAVE = ["collapse", "alarm"];
const SHORTCUTS = [
  ["z", "ctrl", "undo"],
  ["y", "ctrl", "redo"],
  ["p", "alt", "pin"],
  ["s", "alt", "save"],
  ["r", "alt", "reset"],
];
const TYPED = /^(text|search|password|number)$/;
// A beat is never modified: Vue need not track every number of it.
const shownOnly = (beat) => {
  for (const part of Object.values(beat)) if (part && typeof part === "object") markRaw(part);
  return markRaw(beat);
};

export default {
  template: `
  <div class="ecl-outcome">
    <div class="ecl-status" :class="shownKind">
      <span class="dot"></span><span class="message" :title="whole">{{ shown }}</span>
    </div>
    <span class="ecl-hidden" role="status">{{ announced }}</span>
  </div>`,
  props: { texts: Object },
  data: () => ({ message: "", long: "", kind: "busy", cut: "", late: false, warnings: "", announced: "" }),
  computed: {
    // Announce a delayed beat: its numbers are not there, whatever the last ones were.
    isLate() {
      return this.late && this.kind !== "busy";
    },
    shown() {
      return this.cut || (this.isLate ? this.texts.computing : this.message);
    },
    // With the names and limits of what is exceeded, for which the header has no room.
    whole() {
      return this.shown === this.message ? this.long : this.shown;
    },
    shownKind() {
      return this.cut ? "bad" : this.isLate ? "busy" : this.kind;
    },
    spoken() {
      const known = !this.cut && this.shownKind !== "busy"; // else they are of an earlier beat
      return [this.whole, known ? this.warnings : ""].filter(Boolean).join("; ");
    },
  },
  watch: {
    // A screen reader announces the outcome once, when it is stable, not every beat of a change.
    spoken(words) {
      clearTimeout(this.speaking);
      this.speaking = setTimeout(() => (this.announced = words), this.cut ? 0 : ANNOUNCE_AFTER);
    },
  },
  created() {
    setTexts(this.texts);
  },
  mounted() {
    this.say("busy", this.texts.computing);
    this.onKey = (event) => this.key(event);
    this.onHash = () => location.hash.length > 1 && this.$emit("link", { link: this.takeLink() });
    window.addEventListener("keydown", this.onKey);
    window.addEventListener("hashchange", this.onHash);
    this.hello();
    this.stops = [
      bus.on("busy", (text) => this.say("busy", text)),
      bus.on("failed", (text) => {
        this.failed = bus.last("state")?.of;
        this.say("bad", text);
        this.markStale();
      }),
      bus.on("beat", (beat) => this.judge(beat)),
      bus.on("state", (state) => {
        this.answered();
        tab.keep("last", { link: state.link, of: state.of });
        this.links = remember(this.links ?? {}, state.of, state.link, 2);
        this.behind ??= setTimeout(() => this.markStale(false, 0), PALE_AFTER);
      }),
      bus.on("error", () => {
        this.answered();
        this.markStale();
      }),
      bus.on("keep", (snapshot) => tab.keep("tab", snapshot)),
      bus.on("view", (view) => tab.keep("view", view)),
      bus.on("turned", () => {
        this.expect();
        this.paling ??= setTimeout(() => this.markStale(true), PALE_AFTER);
      }),
      bus.on("alive", () => this.answered()),
      ...["fit", "posterior"].flatMap((job) => [
        bus.on(`${job}_progress`, () => this.hearFrom(REPORT_TIMEOUT)),
        bus.on(`${job}_ended`, () => this.hearFrom(0)),
      ]),
      bus.on("taken_back", () => {
        this.takeBack = undefined;
        this.answered();
      }),
    ];
    this.watchSocket();
  },
  unmounted() {
    for (const stop of this.stops) stop();
    window.removeEventListener("keydown", this.onKey);
    window.removeEventListener("hashchange", this.onHash);
    for (const timer of [
      this.waiting,
      this.asking,
      this.paling,
      this.watching,
      this.returning,
      this.behind,
      this.lagging,
      this.speaking,
      this.silence,
    ])
      clearTimeout(timer);
  },
  methods: {
    publish(topic, data) {
      bus.publish(topic, topic === "beat" ? shownOnly(data) : data);
    },
    // The link and the stored state of this tab, from which a reloaded page continues.
    hello() {
      const [snapshot, last, view] = ["tab", "last", "view"].map((name) => tab.read(name));
      const again = performance.getEntriesByType("navigation")[0]?.type === "reload";
      const newer = last && last.of !== snapshot?.of ? last.link : "";
      this.$emit("hello", { link: this.takeLink(), tab: snapshot?.tab ?? "", last: newer, again, view });
    },
    // The link in the address, which is then removed from it.
    takeLink() {
      const link = linkIn(location.hash);
      if (location.hash) history.replaceState(null, "", location.pathname + location.search);
      return link;
    },
    watchSocket() {
      if (!window.socket) {
        this.watching = setTimeout(() => this.watchSocket(), 50);
        return;
      }
      window.socket.on("disconnect", () => this.lost("offline"));
      window.socket.on("connect", () => {
        this.returning = setTimeout(() => this.returned(), HANDSHAKE);
      });
      window.socket.on("connect_error", () => this.cut && this.askSignIn());
      window.socket.onAnyOutgoing((event) => event === "event" && this.expect());
    },
    // Every message has an answer, if only that the server is alive.
    expect() {
      if (this.cut) return;
      this.waiting ??= setTimeout(() => this.lost("silent"), ANSWER_TIMEOUT);
      this.asking ??= setTimeout(() => this.$emit("ask"), ASK_AFTER);
    },
    // The server does not answer: controls return to the settings of the displayed numbers, and later
    // changes are discarded.
    lost(why) {
      clearTimeout(this.returning);
      const beat = bus.last("beat");
      const key = bus.last("turned")?.key;
      const knob =
        this.paling && (bus.last("panel") ?? []).find((k) => k.key === key && key in (beat?.values ?? {}));
      const what = knob
        ? `${knob.label} ${beat.values[key]} ${knob.unit ?? ""}`.trim()
        : bus.last("state")?.name;
      this.expectNothing();
      if (!this.cut) this.takeBack = beat && { of: beat.of, link: this.links?.[beat.of] ?? "" };
      this.what = what ?? "–";
      this.cut = fill(this.texts[why], { what: this.what });
      this.connect(false);
      if (why === "silent" && this.takeBack) this.$emit("take_back", this.takeBack);
    },
    // A restarted server, or one after 12 hours, asks for the password, which requires a new page.
    async askSignIn() {
      try {
        const answer = await fetch(location.pathname, { redirect: "manual", method: "HEAD" });
        if (answer.type === "opaqueredirect") this.cut = fill(this.texts.signed_out, { what: this.what });
        bus.publish("cut", this.cut);
      } catch {
        // the server is gone: announced already
      }
    },
    // The connection is restored.
    returned() {
      if (this.takeBack) this.$emit("take_back", this.takeBack);
      else this.answered();
    },
    expectNothing() {
      for (const timer of [this.waiting, this.asking, this.paling]) clearTimeout(timer);
      this.waiting = this.asking = this.paling = undefined;
    },
    answered() {
      this.expectNothing();
      if (this.cut && !this.takeBack) {
        this.cut = "";
        this.connect(true);
      }
      if (this.isLate) this.expect();
    },
    // Without a connection, actions are disabled so that none is carried out later.
    connect(on) {
      bus.publish("connected", on);
      bus.publish("cut", this.cut);
      const header = [...document.querySelectorAll(".ecl-header > *")].filter((one) => one !== this.$el);
      for (const one of [...header, ...document.querySelectorAll(".ecl-views button, .ecl-middle svg")])
        one.inert = !on;
      this.markStale();
    },
    // Numbers that do not belong to the present settings are dimmed; impossible ones are struck through.
    markStale(late = false, wait = late ? 0 : PALE_AFTER) {
      const beat = bus.last("beat");
      const { of } = bus.last("state") ?? {};
      const stale = late || beat?.of !== of;
      const page = document.querySelector(".ecl-page")?.classList;
      if (beat?.of === of) this.behind = clearTimeout(this.behind);
      page?.toggle("ecl-stale", stale || !!this.cut);
      page?.toggle("ecl-impossible", beat?.possible === false);
      if (stale && of !== this.failed) this.lagging ??= setTimeout(() => this.lag(), wait);
      else this.isThere();
    },
    // A delayed beat: the server is computing or unreachable.
    lag() {
      this.late = true;
      if (this.isLate) this.expect();
    },
    // Long computations report continually: if they do not, ping the server.
    hearFrom(within) {
      clearTimeout(this.silence);
      if (within) this.silence = setTimeout(() => this.expect(), within);
    },
    isThere() {
      clearTimeout(this.lagging);
      this.lagging = undefined;
      this.late = false;
    },
    judge(beat) {
      this.isThere();
      const warnings = subjects(beat, ["warning"]);
      this.warnings = warnings && beat.converged ? `${this.texts.kind_warning}: ${warnings}` : "";
      const [alarms, brief] = [subjects(beat, GRAVE), briefs(beat, GRAVE)];
      if (!beat.converged) this.say("bad", `${this.texts.not_converged}: ${beat.message}`);
      else if (!beat.possible) this.sayOf("bad", this.texts.impossible, alarms, brief);
      else this.sayOf(alarms || doubtOf(beat) ? "broken" : "good", this.outcome(beat, alarms), alarms, brief);
      this.markStale();
    },
    outcome(beat, alarms) {
      const outcome = doubtOf(beat) || (alarms ? "limit_broken" : "ready");
      const what = beat.transient ? beat.message : this.texts[outcome];
      return beat.minute ? `${what}, ${clock(beat.minute, beat.transient)}` : what;
    },
    sayOf(kind, words, alarms, brief) {
      if (alarms) this.say(kind, `${words}: ${brief}`, `${words}: ${alarms}`);
      else this.say(kind, words);
    },
    say(kind, message, long = message) {
      Object.assign(this, { kind, message, long });
    },
    // Nothing changes behind a dialog, not even by the browser's undo.
    key(event) {
      const isCovered = !!document.querySelector(".q-dialog__inner");
      const field = event.target;
      // In a control's field, the browser's undo applies only to text not yet entered.
      const isEntered = !!field?.matches?.(".ecl-knob input:not([data-typed])");
      const typing = !isEntered && (TYPED.test(field?.type ?? "") || field?.tagName === "TEXTAREA");
      for (const [key, modifier, action] of SHORTCUTS) {
        const held = modifier === "ctrl" ? event.ctrlKey || event.metaKey : event.altKey;
        if (!held || event.key.toLowerCase() !== key || (typing && modifier === "ctrl")) continue;
        event.preventDefault();
        if (!isCovered) this.$emit("shortcut", { action });
      }
      if (event.altKey && /^[1-8]$/.test(event.key)) {
        event.preventDefault();
        if (!isCovered) this.$emit("shortcut", { action: "view", number: Number(event.key) });
      }
    },
    // Ends the session of the browser, and leaves nothing of the patient in this tab.
    signOut(address) {
      tab.forget();
      const form = Object.assign(document.createElement("form"), { method: "post", action: address });
      document.body.append(form);
      form.submit();
    },
    async copyLink(link) {
      const url = addressOf(location, link);
      try {
        await navigator.clipboard.writeText(url);
        return { copied: true, url };
      } catch {
        return { copied: false, url };
      }
    },
  },
};
