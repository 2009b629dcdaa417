// The form of measurements, the fit's progress and what it found.
import { bus, compact, fixed, tab, words } from "eclsim-page";

const POSITION = (value, [low, high]) => 100 * Math.min(Math.max(Math.log(value / low) / Math.log(high / low), 0), 1);

const MOST_KEPT = 6;
const [DOUBTFUL, POOR] = [2.5, 4]; // standard uncertainties, as in the verdict of a fit

export default {
  template: `
  <div class="ecl-identify">
    <form @submit.prevent="fit" novalidate autocomplete="off">
      <p class="intro"><b>{{ words.fit_form_of.replace('{name}', name) }}.</b> {{ words.identify_intro }}</p>
      <div class="fields">
        <div v-for="f in fields" :key="f.key" :class="{ bad: mistakes[f.key], doubt: warnings[f.key] }">
          <label :for="id(f)"><b v-if="f.short">{{ f.short }}</b> {{ f.label }}</label>
          <span>
            <select v-if="f.kind === 'name'" :id="id(f)" v-model="typed[f.key]" @change="check"><option v-for="n in f.names" :key="n">{{ n }}</option></select>
            <input v-else :id="id(f)" type="text" :inputmode="f.kind === 'number' ? 'decimal' : 'text'" maxlength="80" v-model="typed[f.key]" @input="check"
              :aria-invalid="!!mistakes[f.key]" :aria-describedby="id(f) + '-said'" />
            <small>{{ f.unit }}</small>
          </span>
          <small v-if="now(f)" class="now">{{ now(f) }}</small>
          <p :id="id(f) + '-said'" aria-live="polite">{{ mistakes[f.key] || warnings[f.key] || '' }}</p>
        </div>
      </div>
      <p v-for="(text, key) in others" :key="key" class="other" role="alert">{{ key }}: {{ text }}</p>
      <p class="circuit">{{ words.fit_circuit.replace('{circuit}', circuit) }}</p>
      <div class="actions">
        <button v-if="!running || asked" type="submit" class="primary" :disabled="!ready || running || !connected">{{ words.fit }}</button>
        <button v-else type="button" class="primary" @click="$emit('cancel')">{{ words.cancel }}</button>
        <button type="button" @click="empty">{{ words.fit_clear }}</button>
        <span v-if="running && !asked" class="progress" role="progressbar" :aria-valuenow="Math.round(100 * share)" aria-valuemin="0" aria-valuemax="100" :aria-valuetext="said"><i :style="{ width: 100 * share + '%' }"></i></span>
        <span v-if="!asked" class="said" role="status">{{ said }}</span>
      </div>
    </form>
    <section v-if="found" ref="found" class="found" :aria-label="words.fit_fitted">
      <p v-if="old" class="old" role="status">! {{ words.fit_old.replace('{of}', found.of) }}</p>
      <div v-if="found.verdict" :class="['judgement', found.verdict.level]" role="alert"><b>{{ found.headline }}.</b>
        <ul v-if="found.verdict.reasons.length" :aria-label="words.fit_reasons"><li v-for="r in found.verdict.reasons" :key="r.sentence">{{ r.sentence }}</li></ul></div>
      <p class="verdict"><b>{{ found.of }}</b> · {{ words.fit_ended_with.replace('{message}', found.message) }} · {{ found.seconds }} s · {{ summary }}
        <button v-if="found.usable" type="button" :class="{ primary: level !== 'poor' }" @click="$emit('use', { link: found.link })">{{ level === 'poor' ? words.fit_use_poor : words.fit_use }}</button></p>
      <p v-if="found.usable" class="actions">
        <button v-if="running && asked" type="button" class="primary" @click="$emit('cancel')">{{ words.cancel }}</button>
        <button v-else type="button" :disabled="running" :title="words.posterior_hint" @click="uncertainty">{{ words.posterior_find }}</button>
        <span v-if="running && asked" class="progress" role="progressbar" :aria-label="words.posterior_find" :aria-valuenow="Math.round(100 * share)" aria-valuemin="0" aria-valuemax="100" :aria-valuetext="said"><i :style="{ width: 100 * share + '%' }"></i></span>
        <span v-if="asked && said" class="said" role="status">{{ said }}</span>
        <template v-else-if="posterior"><span :class="['trust', { bad: !posterior.trusted }]">{{ posterior.trusted ? (level === 'good' ? '✓ ' : '') + words.posterior_trusted : words.posterior_doubted + ': ' + posterior.doubts.join('; ') }}</span>
          <span class="said">{{ verdict }}</span></template>
        <span v-else class="said">{{ words.posterior_hint }}</span>
      </p>
      <div class="ecl-table"><table>
        <thead><tr><th scope="col">{{ words.output }}</th><th scope="col" class="n">{{ words.fit_measured }}</th><th scope="col" class="n">{{ words.fit_fitted }}</th><th scope="col" class="n">{{ words.fit_difference }}</th><th v-if="pinned" scope="col" class="n pinned">{{ words.pinned }}</th></tr></thead>
        <tbody><tr v-for="(o, name) in found.outputs" :key="name"><th scope="row"><b>{{ name }}</b></th><td class="n">{{ show(o.measured) }}</td><td class="n"><b>{{ show(o.simulated) }}</b></td><td :class="['n', off(name)]" :title="uncertainties(name)">{{ difference(o) }}</td><td v-if="pinned" class="n pinned">{{ show(pinned.outputs[name]) }}</td></tr></tbody>
      </table></div>
      <div class="ecl-table"><table>
        <thead><tr><th scope="col">{{ words.fit_parameter }}</th><th scope="col" class="n">{{ words.fit_fitted }}</th><th scope="col" class="n">{{ words.fit_interval }}</th><th scope="col" class="range">{{ words.fit_bounds }}</th><th scope="col">{{ words.fit_identifiable }}</th></tr></thead>
        <tbody><tr v-for="(p, name) in found.parameters" :key="name" :class="{ vague: !p.identifiable }">
          <th scope="row" :title="p.words"><b>{{ name }}</b> <small>{{ p.unit }}</small></th><td class="n"><b>{{ show(p.value) }}</b></td><td class="n">{{ show(p.lower) }} – {{ show(p.upper) }}<template v-if="posterior"><br /><small>{{ words.posterior_interval }}</small> {{ show(after(name).lower) }} – {{ show(after(name).upper) }}</template></td>
          <td class="range"><svg v-if="p.bounds" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true"><rect x="0" y="4.4" width="100" height="1.2" fill="#cfd7de" /><rect :x="at(p.lower, p)" y="2.6" :width="Math.max(at(p.upper, p) - at(p.lower, p), 1)" height="4.8" :fill="p.identifiable ? '#0072B2' : '#E69F00'" opacity="0.55" /><rect :x="at(p.value, p) - 0.8" y="0.5" width="1.6" height="9" fill="#17202A" /><rect v-if="posterior && p.bounds" :x="at(after(name).lower, p)" y="8.4" :width="Math.max(at(after(name).upper, p) - at(after(name).lower, p), 1)" height="1.6" fill="#17202A" opacity="0.7" /></svg></td>
          <td>{{ p.identifiable ? (level === 'good' ? '✓ ' : '') + words.fit_yes : '✗ ' + words.fit_no.replace('{reason}', p.reason) }}</td>
        </tr></tbody>
      </table></div>
    </section>
  </div>`,
  props: { fields: Array },
  data: () => ({ words, typed: {}, mistakes: {}, warnings: {}, ready: false, running: false, share: 0, said: "", found: null, sent: null, asked: false, posterior: null, pinned: null, subject: "", name: "", circuit: "", outputs: {}, connected: true }),
  computed: {
    others() {
      const own = new Set(this.fields.map((f) => f.key));
      return Object.fromEntries(Object.entries(this.mistakes).filter(([key]) => !own.has(key)));
    },
    // Whether the form or the devices are no longer those of the fit that is shown.
    old() {
      const changed = (key) => String(this.sent[key] ?? "").trim() !== String(this.typed[key] ?? "").trim();
      return !!this.sent && (this.fields.some((f) => changed(f.key)) || !this.found.of.endsWith(this.circuit));
    },
    level() {
      return this.found?.verdict?.level;
    },
    verdict() {
      const { method, draws, effective, shape, seconds } = this.posterior;
      return `${words.posterior_found.replace("{method}", method).replace("{draws}", draws).replace("{effective}", effective.toFixed(0)).replace("{shape}", fixed(shape, 2))} ${seconds} s. ${words.posterior_use}`;
    },
    summary() {
      const count = Object.values(this.found.parameters).filter((p) => p.identifiable).length;
      return words.fit_summary.replace("{count}", count).replace("{all}", Object.keys(this.found.parameters).length);
    },
  },
  mounted() {
    this.words = words;
    this.stops = [
      bus.on("form", (form) => this.open(form)),
      bus.on("connected", (on) => (this.connected = on)),
      bus.on("state", (state) => (this.circuit = state.whose.circuit)),
      bus.on("beat", (beat) => (this.outputs = beat.converged ? beat.outputs : {})),
      bus.on("pinned", (beat) => (this.pinned = beat)),
      bus.on("form_check", (found) => Object.assign(this, found)),
      bus.on("fit_progress", ({ share, seconds, words: said }) => Object.assign(this, { running: true, share, said: `${said} (${seconds.toFixed(0)} s)` })),
      bus.on("fit_ended", ({ subject, message, fit }) => {
        this.ended(subject, message);
        if (fit) this.results(subject, { found: fit, posterior: null, sent: this.asking });
        if (fit) this.$nextTick(() => this.$refs.found?.scrollIntoView({ block: "start" }));
      }),
      bus.on("posterior_progress", ({ share, seconds, words: said }) => Object.assign(this, { running: true, asked: true, share, said: `${said} (${seconds.toFixed(0)} s)` })),
      bus.on("posterior_ended", ({ subject, message, posterior, judged }) => {
        this.ended(subject, message);
        if (posterior && this.found) this.results(subject, { found: this.judged(judged), posterior, sent: this.sent });
      }),
      bus.on("view", (view) => {
        if (view === "identify" && !this.prepared) {
          this.prepared = true;
          this.$emit("fill");
        }
      }),
    ];
  },
  unmounted() {
    clearTimeout(this.timer);
    for (const stop of this.stops) stop();
  },
  methods: {
    id: (f) => "form-" + f.key.replace(/\W/g, "-"),
    show: compact,
    after(name) {
      return this.posterior.parameters[name] ?? {};
    },
    at: (value, p) => POSITION(value, p.bounds),
    difference(o) {
      if (o.measured === null || o.measured === undefined || o.simulated === null) return "";
      const change = o.simulated - o.measured;
      return (change > 0 ? "+" : "") + fixed(change, 2);
    },
    now(f) {
      const value = f.short && this.outputs[f.short];
      return Number.isFinite(value) ? words.fit_now.replace("{value}", compact(value)) : "";
    },
    // What was typed and found is kept for each patient, in this tab: another patient has another form.
    kept: (what) => tab.read(what) ?? {},
    keep(what, data) {
      const { [this.subject]: _, ...others } = this.kept(what);
      tab.keep(what, Object.fromEntries([...Object.entries(others).slice(1 - MOST_KEPT), [this.subject, data]]));
    },
    open({ subject, name, values, opened }) {
      const again = subject === this.subject && !opened;
      if (again && Object.keys(this.typed).length) return;
      clearTimeout(this.timer);
      this.subject = subject;
      if (opened) for (const what of ["forms", "fits"]) this.keep(what, undefined);
      const typed = this.kept("forms")[subject];
      const result = this.kept("fits")[subject];
      Object.assign(this, { name, typed: typed ?? values, asked: false, said: typed ? words.fit_typed_kept : "" });
      Object.assign(this, { found: result?.found ?? null, posterior: result?.posterior ?? null, sent: result?.sent ?? null, mistakes: {}, warnings: {}, ready: false });
      this.ask();
    },
    // The fit as it is judged now that the posterior's intervals are known.
    judged(found) {
      if (!found) return this.found;
      const parameters = { ...this.found.parameters };
      for (const [name, doubt] of Object.entries(found.parameters)) parameters[name] = { ...parameters[name], ...doubt };
      return { ...this.found, verdict: found.verdict, headline: found.headline, parameters };
    },
    off(name) {
      const away = Math.abs(this.found.verdict?.goodness?.differences[name] ?? 0);
      return away > POOR ? "poor" : away > DOUBTFUL ? "doubtful" : "";
    },
    uncertainties(name) {
      const away = this.found.verdict?.goodness?.differences[name];
      return away === undefined ? "" : words.fit_off.replace("{count}", fixed(away, 1));
    },
    ended(subject, message) {
      if (subject !== this.subject) return;
      this.running = false;
      this.said = message ?? "";
    },
    results(subject, result) {
      if (subject !== this.subject) return;
      Object.assign(this, result);
      this.keep("fits", result);
    },
    ask() {
      this.timer = setTimeout(() => this.$emit("check", { ...this.typed }), 120);
    },
    check() {
      this.keep("forms", { ...this.typed });
      clearTimeout(this.timer);
      this.ask();
    },
    empty() {
      for (const f of this.fields) if (f.short) this.typed[f.key] = "";
      this.check();
    },
    uncertainty() {
      this.said = "";
      this.asked = true;
      const { link, parameters, verdict } = this.found;
      this.$emit("posterior", { link, found: { parameters, verdict } });
    },
    fit() {
      if (this.running) return;
      this.said = "";
      this.asked = false;
      this.asking = { ...this.typed };
      this.$emit("fit", { ...this.typed });
    },
  },
};
