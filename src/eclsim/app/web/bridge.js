// Hands messages of the server to the views, and keys pressed anywhere to the server.
import { addressOf, bus, clock, fill, linkIn, setTexts, tab } from "eclsim-page";

const PATIENCE = 5000; // ms that the server may take to answer a turn
const PALE = 400; // ms after which numbers that do not know of a turn are pale
const HANDSHAKE = 1000; // ms after a new connection: one that the server refuses loads the page again
const SHORTCUTS = [
  ["z", "ctrl", "undo"],
  ["y", "ctrl", "redo"],
  ["p", "alt", "pin"],
  ["s", "alt", "save"],
  ["r", "alt", "reset"],
];
const TYPED = /^(text|search|password|number)$/;

export default {
  template: `
  <div class="ecl-status" role="status" aria-live="polite" :class="cut ? 'bad' : kind">
    <span class="dot"></span><span class="message" :title="cut || message">{{ cut || message }}</span>
  </div>`,
  props: { texts: Object },
  data: () => ({ message: "", kind: "busy", cut: "" }),
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
      bus.on("failed", (text) => this.say("bad", text)),
      bus.on("beat", (beat) => this.judge(beat)),
      bus.on("state", (state) => {
        this.answered();
        tab.keep("last", { link: state.link, of: state.of });
        this.markStale();
      }),
      bus.on("error", () => {
        this.answered();
        this.markStale();
      }),
      bus.on("keep", (snapshot) => tab.keep("tab", snapshot)),
      bus.on("turned", () => {
        this.waiting ??= setTimeout(() => this.lost("silent"), PATIENCE);
        this.paling ??= setTimeout(() => this.markStale(true), PALE);
      }),
    ];
    this.watchSocket();
  },
  unmounted() {
    for (const stop of this.stops) stop();
    window.removeEventListener("keydown", this.onKey);
    window.removeEventListener("hashchange", this.onHash);
    for (const timer of [this.waiting, this.paling, this.watching, this.returning]) clearTimeout(timer);
  },
  methods: {
    publish(topic, data) {
      bus.publish(topic, data);
    },
    // What this tab was opened with and what it kept: a page that is loaded again goes on.
    hello() {
      const [snapshot, last] = [tab.read("tab"), tab.read("last")];
      const again = performance.getEntriesByType("navigation")[0]?.type === "reload";
      const newer = last && last.of !== snapshot?.of ? last.link : "";
      this.$emit("hello", { link: this.takeLink(), tab: snapshot?.tab ?? "", last: newer, again });
    },
    // The link in the address, which is taken out of it.
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
        this.returning = setTimeout(() => this.answered(), HANDSHAKE);
      });
    },
    // The server does not answer: knobs go back to where the numbers that are shown belong.
    lost(why) {
      clearTimeout(this.returning);
      const beat = bus.last("beat");
      const key = bus.last("turned")?.key;
      const knob =
        this.waiting && (bus.last("panel") ?? []).find((k) => k.key === key && key in (beat?.values ?? {}));
      const what = knob
        ? `${knob.label} ${beat.values[key]} ${knob.unit ?? ""}`.trim()
        : bus.last("state")?.name;
      this.cut = fill(this.texts[why], { what: what ?? "–" });
      bus.publish("connected", false);
      this.markStale();
    },
    answered() {
      clearTimeout(this.waiting);
      clearTimeout(this.paling);
      this.waiting = this.paling = undefined;
      if (!this.cut) return;
      this.cut = "";
      bus.publish("connected", true);
      this.markStale();
    },
    // Numbers that do not belong to where the knobs stand are pale, those of no patient are struck through.
    markStale(late = false) {
      const beat = bus.last("beat");
      const page = document.querySelector(".ecl-page")?.classList;
      page?.toggle("ecl-stale", late || !!this.cut || beat?.of !== bus.last("state")?.of);
      page?.toggle("ecl-impossible", beat?.possible === false);
    },
    judge(beat) {
      const grave = beat.notes.filter(([kind]) => kind === "alarm" || kind === "collapse");
      const alarms = grave.map(([, text]) => text.split(": ")[0]).join("; ");
      if (!beat.converged) this.say("bad", `${this.texts.not_converged}: ${beat.message}`);
      else if (!beat.possible) this.say("bad", `${this.texts.impossible}: ${alarms}`);
      else {
        const what = beat.passing ? beat.message : this.texts[alarms ? "limit_broken" : "ready"];
        const words = beat.minute ? `${what}, ${clock(beat.minute, beat.passing)}` : what;
        this.say(alarms ? "broken" : "good", alarms ? `${words}: ${alarms}` : words);
      }
      this.markStale();
    },
    say(kind, message) {
      this.kind = kind;
      this.message = message;
    },
    key(event) {
      const typing = TYPED.test(event.target?.type ?? "") || event.target?.tagName === "TEXTAREA";
      for (const [key, modifier, action] of SHORTCUTS) {
        const held = modifier === "ctrl" ? event.ctrlKey || event.metaKey : event.altKey;
        if (!held || event.key.toLowerCase() !== key || (typing && modifier === "ctrl")) continue;
        event.preventDefault();
        this.$emit("shortcut", { action });
      }
      if (event.altKey && /^[1-8]$/.test(event.key)) {
        event.preventDefault();
        this.$emit("shortcut", { action: "view", number: Number(event.key) });
      }
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
