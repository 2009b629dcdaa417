// Hands messages of the server to the views, and keys pressed anywhere to the server.
import { bus, setWords, tab } from "eclsim-page";

const PATIENCE = 5000; // ms that the server may take to say that it has heard of a turn
const HANDSHAKE = 1000; // ms after a new connection: one that the server refuses loads the page again

const SHORTCUTS = [
  ["z", "ctrl", "undo"], ["y", "ctrl", "redo"], ["p", "alt", "pin"], ["s", "alt", "save"], ["r", "alt", "reset"],
];

export default {
  template: `<div class="ecl-status" role="status" aria-live="polite" :class="cut ? 'bad' : kind"><span class="dot"></span><span class="said" :title="cut || shown">{{ cut || shown }}</span></div>`,
  props: { words: Object },
  data: () => ({ shown: "", kind: "busy", cut: "" }),
  created() {
    setWords(this.words);
  },
  mounted() {
    this.shown = this.words.computing;
    this.stops = [
      bus.on("busy", (text) => this.say("busy", text)),
      bus.on("failed", (text) => this.say("bad", text)),
      bus.on("beat", (beat) => {
        const alarms = beat.notes.filter(([kind]) => kind === "alarm" || kind === "collapse").map(([, text]) => text.split(": ")[0]).join("; ");
        if (!beat.converged) this.say("bad", `${this.words.not_converged}: ${beat.message}`);
        else if (!beat.possible) this.say("bad", `${this.words.impossible}: ${alarms}`);
        else if (alarms) this.say("broken", `${this.words.limit_broken}: ${alarms}`);
        else this.say("good", this.words.ready);
      }),
    ];
    this.pressed = (event) => this.key(event);
    window.addEventListener("keydown", this.pressed);
    this.hello();
    this.stops.push(
      bus.on("state", (state) => {
        this.heard();
        tab.keep("last", { link: state.link, of: state.of });
        this.mark();
      }),
      bus.on("error", () => this.heard()),
      bus.on("beat", () => this.mark()),
      bus.on("keep", (kept) => tab.keep("tab", kept)),
      bus.on("turned", () => {
        this.waiting ??= setTimeout(() => this.lost("silent"), PATIENCE);
      }),
    );
    this.pasted = () => this.$emit("link", { link: this.takeLink() });
    this.hashed = () => location.hash.length > 1 && this.pasted();
    window.addEventListener("hashchange", this.hashed);
    this.listen();
  },
  unmounted() {
    for (const stop of this.stops) stop();
    window.removeEventListener("keydown", this.pressed);
    window.removeEventListener("hashchange", this.hashed);
    for (const timer of [this.waiting, this.listening, this.returning]) clearTimeout(timer);
  },
  methods: {
    publish(topic, data) {
      bus.publish(topic, data);
    },
    // Tells the server what this tab was opened with and what it kept: a page that is loaded again goes on.
    hello() {
      const [kept, last] = [tab.read("tab"), tab.read("last")];
      const again = performance.getEntriesByType("navigation")[0]?.type === "reload";
      const newer = last && last.of !== kept?.of ? last.link : "";
      this.$emit("hello", { link: this.takeLink(), tab: kept?.tab ?? "", last: newer, again });
    },
    // The link in the address, which is taken out of it.
    takeLink() {
      const link = location.hash.slice(1, 9000);
      if (location.hash) history.replaceState(null, "", location.pathname + location.search);
      return link;
    },
    listen() {
      if (!window.socket) {
        this.listening = setTimeout(() => this.listen(), 50);
        return;
      }
      window.socket.on("disconnect", () => this.lost("offline"));
      window.socket.on("connect", () => {
        this.returning = setTimeout(() => this.heard(), HANDSHAKE);
      });
    },
    // Nothing is heard from the server: knobs go back to where the numbers that are shown belong.
    lost(why) {
      clearTimeout(this.returning);
      const beat = bus.last("beat");
      const [key, panel] = [bus.last("turned")?.key, bus.last("panel") ?? []];
      const knob = this.waiting && panel.find((c) => c.key === key && key in (beat?.values ?? {}));
      const what = knob ? `${knob.label} ${beat.values[key]} ${knob.unit ?? ""}`.trim() : bus.last("state")?.name;
      this.cut = this.words[why].replace("{what}", what ?? "–");
      bus.publish("connected", false);
      this.mark();
    },
    heard() {
      clearTimeout(this.waiting);
      this.waiting = undefined;
      if (!this.cut) return;
      this.cut = "";
      bus.publish("connected", true);
      this.mark();
    },
    // Numbers that do not belong to where the knobs stand are pale.
    mark() {
      const old = !!this.cut || bus.last("beat")?.of !== bus.last("state")?.of;
      document.querySelector(".ecl-page")?.classList.toggle("ecl-stale", old);
    },
    say(kind, text) {
      this.kind = kind;
      this.shown = text;
    },
    key(event) {
      const typing = /^(text|search|password|number)$/.test(event.target?.type ?? "") || event.target?.tagName === "TEXTAREA";
      for (const [key, modifier, action] of SHORTCUTS) {
        const held = modifier === "ctrl" ? event.ctrlKey || event.metaKey : event.altKey;
        if (!held || event.key.toLowerCase() !== key || (typing && modifier === "ctrl")) continue;
        event.preventDefault();
        this.$emit("shortcut", { action });
      }
      if (event.altKey && /^[1-7]$/.test(event.key)) {
        event.preventDefault();
        this.$emit("shortcut", { action: "view", number: Number(event.key) });
      }
    },
    async copyLink(link) {
      const url = location.origin + location.pathname + "#" + link;
      try {
        await navigator.clipboard.writeText(url);
        return { copied: true, url };
      } catch {
        return { copied: false, url };
      }
    },
  },
};
