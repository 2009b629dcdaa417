// The form of measurements, the progress of the fit, and its result.
import { compact, fill, fixed, listening, logShare, remember, signed, tab } from "eclsim-page";

const MOST_KEPT = 6;
const [DOUBTFUL, POOR] = [2.5, 4]; // residuals in standard uncertainties, as in the verdict of a fit
const PROGRESS = `
  <span class="progress" role="progressbar" :aria-label="label" :aria-valuenow="Math.round(100 * share)"
    aria-valuemin="0" aria-valuemax="100" :aria-valuetext="message">
    <i :style="{ width: 100 * share + '%' }"></i></span>`;

export default {
  components: { ProgressBar: { template: PROGRESS, props: ["label", "share", "message"] } },
  template: `
  <div class="ecl-identify">
    <form @submit.prevent="fit" novalidate autocomplete="off">
      <p class="intro"><b>{{ fill(texts.fit_form_of, { name }) }}.</b> {{ texts.identify_intro }}</p>
      <div class="fields">
        <div v-for="f in asked" :key="f.key" :class="{ bad: mistakes[f.key], doubt: warnings[f.key] }">
          <label :for="id(f)"><b v-if="f.symbol && !f.symbol.includes('_')">{{ f.symbol }}</b> {{
            f.label }}</label>
          <span>
            <select v-if="f.kind === 'name'" :id="id(f)" v-model="typed[f.key]" @change="check">
              <option v-for="n in f.names" :key="n">{{ n }}</option>
            </select>
            <input v-else :id="id(f)" type="text" maxlength="80"
              :inputmode="f.kind === 'number' ? 'decimal' : 'text'" v-model="typed[f.key]"
              @input="check" :aria-invalid="!!mistakes[f.key]"
              :aria-describedby="id(f) + '-message'" />
            <small>{{ f.unit }}</small>
          </span>
          <small v-if="beside(f)" class="now">{{ beside(f) }}</small>
          <p :id="id(f) + '-message'" aria-live="polite">{{ mistakes[f.key] || warnings[f.key] || '' }}</p>
        </div>
      </div>
      <p v-for="(text, key) in otherMistakes" :key="key" class="other" role="alert">{{ key }}: {{ text }}</p>
      <p class="circuit">{{ fill(texts.fit_circuit, { circuit }) }}</p>
      <div class="actions">
        <button v-if="job !== 'fit'" type="submit" class="primary"
          :disabled="!ready || !!job || !connected">{{ texts.fit }}</button>
        <button v-else type="button" class="primary" @click="$emit('cancel')">{{ texts.cancel }}</button>
        <button type="button" @click="empty">{{ texts.fit_clear }}</button>
        <ProgressBar v-if="job === 'fit'" :label="texts.fit" :share="share" :message="message" />
        <span v-if="!isPosterior" class="message" role="status">{{ message }}</span>
      </div>
    </form>
    <section v-if="result" ref="result" class="result" :aria-label="texts.fit_fitted">
      <p v-if="isOutdated" class="outdated" role="status">! {{ fill(texts.fit_old, { of: result.of }) }}</p>
      <div v-if="result.verdict" :class="['judgement', level]" role="alert"><b>{{ result.headline }}.</b>
        <ul v-if="result.verdict.reasons.length" :aria-label="texts.fit_reasons">
          <li v-for="r in result.verdict.reasons" :key="r.sentence">{{ r.sentence }}</li>
        </ul>
      </div>
      <p class="verdict"><b>{{ result.of }}</b> · {{ ending }} · {{ result.seconds }} s · {{ identifiable }}
        <button v-if="result.usable" type="button" :class="{ primary: level !== 'poor' }"
          @click="$emit('use', { link: result.link })">{{
          level === 'poor' ? texts.fit_use_poor : texts.fit_use }}</button>
      </p>
      <p v-if="result.usable" class="actions">
        <button v-if="job === 'posterior'" type="button" class="primary" @click="$emit('cancel')">{{
          texts.cancel }}</button>
        <button v-else type="button" :disabled="!!job" :title="texts.posterior_hint" @click="findPosterior">{{
          texts.posterior_find }}</button>
        <ProgressBar v-if="job === 'posterior'" :label="texts.posterior_find" :share="share"
          :message="message" />
        <span v-if="isPosterior && message" class="message" role="status">{{ message }}</span>
        <template v-else-if="posterior">
          <span :class="['trust', { bad: !posterior.trusted }]">{{ trust }}</span>
          <span class="message">{{ diagnostics }}</span>
        </template>
        <span v-else class="message">{{ texts.posterior_hint }}</span>
      </p>
      <p v-for="note in posterior?.notes" :key="note" class="verdict" role="status">! {{ note }}</p>
      <div class="ecl-table"><table>
        <thead><tr>
          <th scope="col">{{ texts.output }}</th>
          <th scope="col" class="n">{{ texts.fit_measured }}</th>
          <th scope="col" class="n">{{ texts.fit_fitted }}</th>
          <th scope="col" class="n">{{ texts.fit_interval }}</th>
          <th scope="col" class="n">{{ texts.fit_difference }}</th>
          <th v-if="pinned" scope="col" class="n pinned">{{ texts.pinned }}</th>
        </tr></thead>
        <tbody><tr v-for="(o, name) in result.outputs" :key="name"
          :class="{ vague: o.determined === false }">
          <th scope="row"><b>{{ name }}</b> <small>{{ unitOf(name) }}</small></th>
          <td class="n">{{ compact(o.measured) }}</td>
          <td class="n"><b>{{ compact(o.simulated) }}</b></td>
          <td class="n">{{ Number.isFinite(o.lower) ? interval(o) : "" }}</td>
          <td :class="['n', offLevel(name)]" :title="off(name)">{{ difference(o) }}</td>
          <td v-if="pinned" class="n pinned">{{ compact(pinned.outputs[name]) }}</td>
        </tr></tbody>
      </table></div>
      <p v-if="undetermined" class="message">{{ fill(texts.fit_undetermined, { names: undetermined }) }}</p>
      <div class="ecl-table parameters"><table>
        <thead><tr>
          <th scope="col">{{ texts.fit_parameter }}</th>
          <th scope="col" class="n">{{ texts.fit_fitted }}</th>
          <th scope="col" class="n">{{ texts.fit_interval }}</th>
          <th scope="col" class="range">{{ texts.fit_bounds }}</th>
          <th scope="col">{{ texts.fit_identifiable }}</th>
        </tr></thead>
        <tbody><tr v-for="(p, name) in result.parameters" :key="name" :class="{ vague: !p.identifiable }">
          <th scope="row"><b>{{ name }}</b> <small>{{ p.unit }}<br />{{ p.text }}</small></th>
          <td class="n"><b>{{ compact(p.value) }}</b></td>
          <td class="n">{{ interval(p) }}<template v-if="posterior"><br />
            <small>{{ texts.posterior_interval }}</small><br />{{ interval(after(name)) }}</template></td>
          <td class="range"><svg v-if="p.bounds" viewBox="0 0 100 10" preserveAspectRatio="none"
            aria-hidden="true"><rect v-for="(bar, k) in bars(p, after(name))" :key="k" v-bind="bar" />
          </svg></td>
          <td>{{ judgement(p) }}</td>
        </tr></tbody>
      </table></div>
    </section>
  </div>`,
  props: { fields: Array },
  mixins: [
    listening({
      form(form) {
        this.open(form);
      },
      form_check(checked) {
        Object.assign(this, checked);
      },
      connected(on) {
        this.connected = on;
      },
      state({ provenance }) {
        this.circuit = provenance.circuit;
      },
      beat(beat) {
        this.outputs = beat.converged && beat.possible ? beat.outputs : {};
        if (beat.converged) this.measurable = Object.keys(beat.outputs);
      },
      pinned(beat) {
        this.pinned = beat;
      },
      fit_progress(progress) {
        this.progress("fit", progress);
      },
      fit_ended({ subject, message, fit }) {
        this.ended(subject, message);
        if (!fit) return;
        this.keepResult(subject, { result: fit, posterior: null, sent: this.asking });
        this.$nextTick(() => this.$refs.result?.scrollIntoView({ block: "start" }));
      },
      posterior_progress(progress) {
        this.progress("posterior", progress);
      },
      posterior_ended({ subject, message, posterior, judged }) {
        this.ended(subject, message);
        if (!posterior || !this.result) return;
        this.keepResult(subject, { result: this.judgedAgain(judged), posterior, sent: this.sent });
      },
      view(view) {
        if (view !== "identify" || this.prepared) return;
        this.prepared = true;
        this.$emit("fill");
      },
    }),
  ],
  data: () => ({
    typed: {},
    given: {},
    ofPreset: false,
    mistakes: {},
    warnings: {},
    ready: false,
    job: "",
    isPosterior: false,
    share: 0,
    message: "",
    result: null,
    sent: null,
    posterior: null,
    pinned: null,
    subject: "",
    name: "",
    circuit: "",
    outputs: {},
    measurable: [],
    connected: true,
  }),
  computed: {
    // Quantities of the devices and gases that are enabled, and all entered values.
    asked() {
      const { measurable, typed, mistakes } = this;
      const isThere = ({ symbol }) => !symbol || !measurable.length || measurable.includes(symbol);
      return this.fields.filter((f) => isThere(f) || mistakes[f.key] || String(typed[f.key] ?? "").trim());
    },
    otherMistakes() {
      const own = new Set(this.fields.map((f) => f.key));
      return Object.fromEntries(Object.entries(this.mistakes).filter(([key]) => !own.has(key)));
    },
    // Whether the form or the settings differ from those of the fit, before and after its patient is used.
    isOutdated() {
      if (!this.sent) return false;
      const text = (values, key) => String(values[key] ?? "").trim();
      const changed = ({ key }) => text(this.sent, key) !== text(this.typed, key);
      return this.fields.some(changed) || !this.result.settings?.includes(this.circuit);
    },
    level() {
      return this.result?.verdict?.level;
    },
    tick() {
      return this.level === "good" ? "✓ " : "";
    },
    ending() {
      const { message, starts_agreeing: agreeing, starts_refined: refined, explored } = this.result;
      return fill(this.texts.fit_ended_with, { message, agreeing, refined, explored });
    },
    identifiable() {
      const all = Object.values(this.result.parameters);
      return fill(this.texts.fit_summary, {
        count: all.filter((p) => p.identifiable).length,
        all: all.length,
      });
    },
    undetermined() {
      const open = Object.entries(this.result.outputs).filter(([, o]) => o.determined === false);
      return open.map(([name]) => name).join(", ");
    },
    trust() {
      const { trusted, doubts } = this.posterior;
      if (trusted) return this.tick + this.texts.posterior_trusted;
      return `${this.texts.posterior_doubted}: ${doubts.join("; ")}`;
    },
    diagnostics() {
      const { method, draws, effective, shape, seconds } = this.posterior;
      const numbers = { method, draws, effective: effective.toFixed(0), shape: fixed(shape, 2) };
      return `${fill(this.texts.posterior_found, numbers)} ${seconds} s. ${this.texts.posterior_use}`;
    },
  },
  unmounted() {
    clearTimeout(this.timer);
  },
  methods: {
    compact,
    fill,
    id: (f) => `form-${f.key.replace(/\W/g, "-")}`,
    interval: ({ lower, upper }) => `${compact(lower)} – ${compact(upper)}`,
    after(name) {
      return this.posterior?.parameters[name] ?? {};
    },
    unitOf(name) {
      return this.fields.find(({ symbol }) => symbol === name)?.unit;
    },
    difference({ measured, simulated }) {
      return Number.isFinite(measured) && Number.isFinite(simulated) ? signed(simulated - measured, 2) : "";
    },
    simulated({ symbol }) {
      const value = symbol && this.outputs[symbol];
      return Number.isFinite(value) ? fill(this.texts.fit_now, { value: compact(value) }) : "";
    },
    // Values of a preset are no patient's: the page says so until another value is entered.
    beside(field) {
      const { key } = field;
      const left =
        this.ofPreset && this.given[key] !== "" && String(this.typed[key]) === String(this.given[key]);
      return left ? this.texts.fit_of_preset : this.simulated(field);
    },
    judgement(p) {
      if (p.identifiable) return this.tick + this.texts.fit_yes;
      return `✗ ${fill(this.texts.fit_no, { reason: p.reason })}`;
    },
    // Intervals and value of a parameter between its bounds, on a logarithmic scale from 0 to 100.
    bars({ bounds, lower, upper, value, identifiable }, after) {
      const at = (v) => 100 * logShare(v, bounds);
      const span = (low, high) => ({ x: at(low), width: Math.max(at(high) - at(low), 1) });
      const fitted = identifiable ? "#0072B2" : "#E69F00";
      const bars = [
        { x: 0, width: 100, y: 4.4, height: 1.2, fill: "#cfd7de" },
        { ...span(lower, upper), y: 2.6, height: 4.8, fill: fitted, opacity: 0.55 },
        { x: at(value) - 0.8, width: 1.6, y: 0.5, height: 9, fill: "#17202A" },
      ];
      if (!("lower" in after)) return bars;
      return [
        ...bars,
        { ...span(after.lower, after.upper), y: 8.4, height: 1.6, fill: "#17202A", opacity: 0.7 },
      ];
    },
    away(name) {
      return this.result.verdict?.goodness?.differences[name];
    },
    offLevel(name) {
      const away = Math.abs(this.away(name) ?? 0);
      return away > POOR ? "poor" : away > DOUBTFUL ? "doubtful" : "";
    },
    off(name) {
      const away = this.away(name);
      return away === undefined ? "" : fill(this.texts.fit_off, { count: fixed(away, 1) });
    },
    // Entries and fits are stored per patient in this tab; another patient has another form.
    kept(what) {
      return tab.read(what) ?? {};
    },
    keep(what, data) {
      tab.keep(what, remember(this.kept(what), this.subject, data, MOST_KEPT));
    },
    open({ subject, name, values, opened, preset }) {
      Object.assign(this, { given: values, ofPreset: preset });
      if (subject === this.subject && !opened && Object.keys(this.typed).length) return;
      clearTimeout(this.timer);
      if (this.job) this.keep("running", undefined);
      this.subject = subject;
      if (opened) for (const what of ["forms", "fits"]) this.keep(what, undefined);
      const typed = this.kept("forms")[subject];
      const { result = null, posterior = null, sent = null } = this.kept("fits")[subject] ?? {};
      Object.assign(this, { name, result, posterior, sent, mistakes: {}, warnings: {}, ready: false });
      Object.assign(this, { typed: typed ?? values, job: "", isPosterior: false });
      this.message = typed ? this.texts.fit_typed_kept : "";
      if (this.kept("running")[subject]) this.message = this.texts.fit_lost;
      this.keep("running", undefined);
      this.ask();
    },
    // The fit, judged again with the intervals of the posterior.
    judgedAgain(judged) {
      if (!judged) return this.result;
      const parameters = { ...this.result.parameters };
      for (const [name, doubt] of Object.entries(judged.parameters))
        parameters[name] = { ...parameters[name], ...doubt };
      return { ...this.result, verdict: judged.verdict, headline: judged.headline, parameters };
    },
    progress(job, { share, seconds, text }) {
      const message = `${text} (${seconds.toFixed(0)} s)`;
      if (!this.job) this.keep("running", true);
      Object.assign(this, { job, share, message, isPosterior: job === "posterior" });
    },
    ended(subject, message) {
      if (subject !== this.subject) return;
      this.job = "";
      this.keep("running", undefined);
      this.message = message ?? "";
    },
    keepResult(subject, result) {
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
      for (const f of this.fields) if (f.symbol) this.typed[f.key] = "";
      this.check();
    },
    findPosterior() {
      const { link, parameters, verdict } = this.result;
      Object.assign(this, { message: "", isPosterior: true });
      this.$emit("posterior", { link, fit: { parameters, verdict } });
    },
    fit() {
      if (this.job) return;
      Object.assign(this, { message: "", isPosterior: false, asking: { ...this.typed } });
      this.$emit("fit", { ...this.typed });
    },
  },
};
