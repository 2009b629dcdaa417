// Hands messages of the server to the views, and keys pressed anywhere to the server.
import { bus, setWords } from "eclsim-page";

const SHORTCUTS = [
  ["z", "ctrl", "undo"], ["y", "ctrl", "redo"], ["p", "alt", "pin"], ["s", "alt", "save"], ["r", "alt", "reset"],
];

export default {
  template: `<div class="ecl-status" role="status" aria-live="polite" :class="kind"><span class="dot"></span>{{ shown }}</div>`,
  props: { words: Object, served: String },
  data: () => ({ shown: "", kind: "busy" }),
  created() {
    setWords(this.words);
  },
  mounted() {
    this.shown = this.words.computing;
    this.stops = [
      bus.on("busy", (text) => this.say("busy", text)),
      bus.on("failed", (text) => this.say("bad", text)),
      bus.on("beat", (beat) => {
        if (beat.converged) this.say("good", this.words.ready);
        else this.say("bad", `${this.words.not_converged}: ${beat.message}`);
      }),
    ];
    this.pressed = (event) => this.key(event);
    window.addEventListener("keydown", this.pressed);
    // A tab that is loaded again, or lost its connection for long, goes on where it was.
    const kept = JSON.parse(sessionStorage.getItem("eclsim") ?? "{}");
    this.$emit("hello", { link: location.hash.slice(1, 9000) || (kept.served === this.served ? kept.link : "") });
    this.stops.push(bus.on("state", ({ link }) => sessionStorage.setItem("eclsim", JSON.stringify({ served: this.served, link }))));
    if (location.hash) history.replaceState(null, "", location.pathname + location.search);
  },
  unmounted() {
    for (const stop of this.stops) stop();
    window.removeEventListener("keydown", this.pressed);
  },
  methods: {
    publish(topic, data) {
      bus.publish(topic, data);
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
