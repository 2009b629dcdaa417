// Charts by Plotly, which is part of the page; drawn only while their view is visible.
import { FONT, bus, dark, ink, onPrint } from "eclsim-page";

const PAPER = { width: 680, height: 460 }; // px, as in the style sheet for paper
const LOAD_AFTER = 2500; // ms after the first beat
const CONFIG = {
  displaylogo: false,
  toImageButtonOptions: { format: "svg", filename: "eclsim" },
  responsive: false,
  modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"],
  scrollZoom: false,
  displayModeBar: window.matchMedia("(hover: none)").matches ? false : "hover", // else it lies over titles
};

let loading;
async function load() {
  try {
    return (await import("nicegui-plotly")).Plotly;
  } catch {
    loading = undefined; // without a connection: the next chart tries again
  }
}
const plotly = () => (loading ??= load());
bus.on("beat", () => {
  if (!loading && !navigator.connection?.saveData) setTimeout(plotly, LOAD_AFTER);
});
// Redraw the charts when the colour preference changes.
dark.addEventListener("change", () => {
  for (const topic of ["beat", "ramp"])
    if (bus.last(topic) !== undefined) bus.publish(topic, bus.last(topic));
});

export const axis = (title, more = {}) => ({
  title: { text: title, standoff: 6, font: { size: 12 } },
  zeroline: false,
  gridcolor: ink("line"),
  linecolor: ink("edge"),
  showline: true,
  ticks: "outside",
  ticklen: 3,
  tickcolor: ink("edge"),
  tickfont: { size: 11 },
  automargin: true,
  ...more,
});

// A curve; `more` may hold further settings of the trace and of its line.
export const line = (x, y, name, colour, { line: stroke = {}, ...more } = {}) => ({
  type: "scatter",
  mode: "lines",
  x,
  y,
  name,
  line: { color: colour, width: 2.2, ...stroke },
  ...more,
});

const common = () => ({
  font: { family: FONT, color: ink("ink") },
  paper_bgcolor: ink("card"),
  plot_bgcolor: ink("card"),
  hoverlabel: { bgcolor: ink("card"), font: { color: ink("ink") } },
  margin: { l: 52, r: 14, t: 28, b: 42 },
  showlegend: true,
  hovermode: "closest",
  legend: { orientation: "h", x: 0, y: -0.16, font: { size: 11.5 } },
});

// If a beat only moves points, axes are not redrawn: that takes half of Plotly's time.
const AT_ONCE = { mode: "immediate", transition: { duration: 0 }, frame: { duration: 0, redraw: false } };
const pointsOf = (traces) => ({
  data: traces.map((trace) => ({ x: trace.x, y: trace.y })),
  traces: traces.map((_, k) => k),
});
const looksOf = (traces, layout) =>
  JSON.stringify([layout, traces.map((trace) => ({ ...trace, x: 0, y: 0 }))]);

export class Chart {
  // `again` recomputes what depends on the size; without it the same curves are drawn in a new size.
  constructor(element, view, again) {
    this.element = element;
    this.again = again ?? (() => this.draw(...this.drawn));
    this.seen = bus.last("view") === view;
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(element);
    this.stopPrint = onPrint((on) => {
      this.paper = on && PAPER;
      if (this.seen && this.drawn) this.again();
    });
    this.stop = bus.on("view", (now) => {
      this.seen = now === view;
      if (this.seen && this.waiting) this.paint();
    });
  }
  draw(traces, layout) {
    this.waiting = [traces, layout];
    if (this.seen) this.paint();
  }
  get size() {
    const { clientWidth: width, clientHeight: height } = this.element;
    return this.paper || { width, height };
  }
  async paint() {
    const Plotly = await plotly();
    if (!Plotly || !this.waiting || !this.element.clientWidth) return;
    const [traces, layout] = this.waiting;
    this.waiting = undefined;
    const whole = { ...common(), ...layout, ...this.size, uirevision: "same" };
    const looks = looksOf(traces, whole);
    const moved = looks === this.looks;
    this.looks = looks;
    // A drawing superseded by the next one is rejected.
    if (moved) await Plotly.animate(this.element, pointsOf(traces), AT_ONCE).catch(() => undefined);
    else await Plotly.react(this.element, traces, whole, CONFIG);
    this.drawn = [traces, layout];
  }
  resize() {
    if (this.drawn && !this.waiting) this.again();
    else if (this.seen) this.paint();
  }
  close() {
    this.observer.disconnect();
    this.stopPrint();
    this.stop();
  }
}
