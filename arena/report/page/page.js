// Page of a report: draws the figures, links their time axes, and shows the moment of a number that was clicked.
//
// Elements with data-figure contain a figure. data-time marks figures over time; data-scope is "overview" (all vehicles, those
// that are not selected are faint) or "detail" (selected vehicles only). Elements with data-t jump to that time [s].
// options: time [first, last] [s], vehicles [{name, colour}], preferred (vehicle shown first), marks [{t, colour}],
// detailAll (number of vehicles up to which the detailed figures show all of them at first).
"use strict";

const bytesOf = (id) => Uint8Array.from(atob(document.getElementById(id).textContent.trim()), (c) => c.charCodeAt(0));

async function unpack(id) {
  const stream = new Blob([bytesOf(id)]).stream().pipeThrough(new DecompressionStream("gzip"));
  return await new Response(stream).arrayBuffer();
}

const CONFIG = {
  displaylogo: false,
  responsive: true,
  modeBarButtonsToRemove: [
    "select2d", "lasso2d", "autoScale2d", "zoomIn2d", "zoomOut2d", "hoverClosestCartesian", "hoverCompareCartesian", "sendChartToCloud",
    "sendDataToCloud", "resetCameraLastSave3d", "hoverClosest3d", "tableRotation",
  ],
};
const DETAIL_ALL = 4; // up to so many vehicles, the detailed figures show all of them at first
const FAINT = 0.1;
const CURSOR = "#111827";

class Page {
  constructor(payload, arrays) {
    this.options = payload.options;
    this.figures = payload.figures;
    this.arrays = arrays;
    this.range = [...this.options.time];
    this.moment = null;
    this.selected = new Set();
    this.linking = false;
    this.drawn = new Map();
  }

  // -- drawing ----------------------------------------------------------------------------------------------------------

  resolve(node) {
    if (Array.isArray(node)) return node.map((n) => this.resolve(n));
    if (node && typeof node === "object") {
      if ("$" in node) return this.arrays[node.$];
      return Object.fromEntries(Object.entries(node).map(([k, v]) => [k, this.resolve(v)]));
    }
    return node;
  }

  elements() {
    return [...document.querySelectorAll("[data-figure]")];
  }

  async draw(element) {
    const id = element.dataset.figure;
    if (this.drawn.has(id)) return this.drawn.get(id);
    const promise = this.drawNow(element, id);
    this.drawn.set(id, promise);
    return promise;
  }

  async drawNow(element, id) {
    const figure = this.resolve(this.figures[id]);
    if (id === "map") figure.data.push(this.momentTrace());
    const time = "time" in element.dataset;
    if (time) {
      figure.layout.xaxis.range = [...this.range];
      figure.layout.shapes = this.shapes();
    }
    this.show(element, figure.data);
    await Plotly.newPlot(element, figure.data, figure.layout, CONFIG);
    element.classList.add("drawn");
    if (!time) return element;
    element.on("plotly_relayout", (change) => this.onRelayout(element, change));
    element.on("plotly_click", (event) => {
      const t = event.points[0].x;
      if (typeof t === "number") this.setMoment(t);
    });
    return element;
  }

  async drawAll() {
    for (const element of this.elements()) await this.draw(element);
  }

  drawWhenVisible() {
    const seen = (entries) => entries.forEach((e) => e.isIntersecting && this.draw(e.target));
    const observer = new IntersectionObserver(seen, { rootMargin: "500px" });
    this.elements().forEach((element) => observer.observe(element));
  }

  // -- the common time axis ---------------------------------------------------------------------------------------------

  shapes() {
    const line = (t, colour, dash, width, opacity) => ({
      type: "line", xref: "x", yref: "paper", x0: t, x1: t, y0: 0, y1: 1, layer: "below", opacity,
      line: { color: colour, dash, width },
    });
    const marks = (this.options.marks || []).map((m) => line(m.t, m.colour, "dot", 1.2, 0.75));
    return this.moment === null ? marks : [...marks, { ...line(this.moment, CURSOR, "solid", 1.4, 1), layer: "above" }];
  }

  async updateTime() {
    this.linking = true;
    const changes = { "xaxis.range": [...this.range], shapes: this.shapes() };
    const times = this.elements().filter((e) => "time" in e.dataset && e.classList.contains("drawn"));
    await Promise.all(times.map((element) => Plotly.relayout(element, { ...changes })));
    this.linking = false;
    const [first, last] = this.options.time;
    document.getElementById("whole").disabled =
      this.moment === null && this.range[0] <= first && this.range[1] >= last;
  }

  onRelayout(element, change) {
    if (this.linking) return;
    if (change["xaxis.autorange"]) this.range = [...this.options.time];
    else if ("xaxis.range[0]" in change) this.range = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    else if (change["xaxis.range"]) this.range = [...change["xaxis.range"]];
    else return;
    this.updateTime();
  }

  // Show a moment [s] in all figures: cursor line, positions in the map, and a time range around it.
  jump(t, chart) {
    const [first, last] = this.options.time;
    const half = Math.max(2.5, Math.min(6, (last - first) / 6));
    this.range = [Math.max(first, t - half), Math.min(last, t + half)];
    this.setMoment(t);
    const element = chart && document.querySelector(`[data-figure="${CSS.escape(chart)}"]`);
    if (element) {
      const box = element.getBoundingClientRect();
      if (box.top < 60 || box.bottom > window.innerHeight) element.closest("section, .card").scrollIntoView({ behavior: "smooth", block: "start" });
      element.classList.remove("flash");
      void element.offsetWidth; // restarts the animation
      element.classList.add("flash");
    }
  }

  setMoment(t) {
    this.moment = t;
    document.getElementById("moment").textContent = `${t.toFixed(2)} s`;
    document.getElementById("moment-box").hidden = false;
    this.updateTime();
    this.moveMoment();
  }

  clear() {
    this.moment = null;
    this.range = [...this.options.time];
    document.getElementById("moment-box").hidden = true;
    this.updateTime();
    this.moveMoment();
  }

  // -- the map ----------------------------------------------------------------------------------------------------------

  // Return [name, colour, x, y, z] of each vehicle at the moment; the nearest drawn row counts.
  places() {
    if (this.moment === null) return [];
    const paths = (this.figures.map ? this.figures.map.data : []).filter((trace) => trace.meta && trace.meta.curve === "path");
    return paths.flatMap((raw) => {
      const [t, x, y, z] = [raw.customdata, raw.x, raw.y, raw.z].map((n) => this.resolve(n));
      let [low, high] = [0, t.length - 1];
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (t[middle] <= this.moment) low = middle;
        else high = middle;
      }
      const k = Math.abs(t[high] - this.moment) < Math.abs(t[low] - this.moment) ? high : low;
      const close = Math.abs(t[k] - this.moment) < 1 && Number.isFinite(x[k]);
      return close && this.isShown(raw.meta.vehicle) ? [[raw.meta.vehicle, raw.line.color, x[k], y[k], z[k]]] : [];
    });
  }

  momentTrace() {
    const places = this.places();
    return {
      type: "scatter3d", mode: places.length > 12 ? "markers" : "markers+text", name: "moment", hoverinfo: "text",
      x: places.map((p) => p[2]), y: places.map((p) => p[3]), z: places.map((p) => p[4]),
      text: places.map((p) => escapeText(p[0])), textposition: "top center",
      marker: { size: 7, color: places.map((p) => p[1]), line: { color: CURSOR, width: 2 } },
    };
  }

  moveMoment() {
    const element = document.querySelector('[data-figure="map"]');
    if (!element || !element.classList.contains("drawn")) return;
    const { x, y, z, text, marker, mode } = this.momentTrace();
    Plotly.restyle(element, { x: [x], y: [y], z: [z], text: [text], mode, "marker.color": [marker.color] }, [element.data.length - 1]);
  }

  // -- selected vehicles ------------------------------------------------------------------------------------------------

  isShown(vehicle) {
    return this.selected.size === 0 || this.selected.has(vehicle);
  }

  detailed() {
    if (this.selected.size) return this.selected;
    const names = this.options.vehicles.map((v) => v.name);
    return new Set(names.length <= (this.options.detailAll || DETAIL_ALL) ? names : [this.options.preferred || names[0]]);
  }

  // Set visibility and opacity of the traces of one figure, before it is drawn.
  show(element, traces) {
    const detailed = this.detailed();
    for (const trace of traces) {
      const vehicle = trace.meta && trace.meta.vehicle;
      if (!vehicle) continue;
      if (element.dataset.scope === "detail") trace.visible = detailed.has(vehicle);
      else {
        trace.usual = trace.usual === undefined ? (trace.opacity === undefined ? 1 : trace.opacity) : trace.usual;
        trace.opacity = this.isShown(vehicle) ? trace.usual : FAINT * trace.usual;
      }
    }
  }

  select(vehicle, add) {
    if (vehicle === null) this.selected.clear();
    else if (add) this.selected.has(vehicle) ? this.selected.delete(vehicle) : this.selected.add(vehicle);
    else if (this.selected.size === 1 && this.selected.has(vehicle)) this.selected.clear();
    else this.selected = new Set([vehicle]);
    this.showSelected();
  }

  showSelected() {
    this.showSelection();
    for (const element of this.elements()) {
      if (!element.dataset.scope || !element.classList.contains("drawn")) continue;
      this.show(element, element.data);
      Plotly.redraw(element);
    }
    this.moveMoment();
  }

  showSelection() {
    const detailed = [...this.detailed()];
    document.querySelectorAll("[data-vehicle-chip]").forEach((chip) => {
      const own = chip.dataset.vehicleChip;
      chip.classList.toggle("shown", own !== "" && detailed.includes(own));
      chip.setAttribute("aria-pressed", own === "" ? this.selected.size === 0 : this.selected.has(own));
    });
    const text = detailed.length > 6 ? `${detailed.length} vehicles` : detailed.join(", ");
    document.querySelectorAll(".showing").forEach((e) => (e.textContent = text));
    document.querySelectorAll("[data-row-vehicle]").forEach((row) => {
      row.classList.toggle("faint", !this.isShown(row.dataset.rowVehicle));
    });
  }

  // -- events of the page -----------------------------------------------------------------------------------------------

  listen() {
    document.addEventListener("click", (event) => {
      const jump = event.target.closest("[data-t]");
      const chip = event.target.closest("[data-vehicle-chip]");
      if (jump) {
        event.preventDefault();
        const names = (jump.dataset.vehicle || "").split(",").filter(Boolean);
        const ofRule = names.length && jump.closest("#scenario"); // the value of a rule belongs to these vehicles only
        if (ofRule || names.some((name) => !this.detailed().has(name))) {
          this.selected = new Set(names);
          this.showSelected();
        }
        this.jump(Number(jump.dataset.t), jump.dataset.chart);
      } else if (chip) {
        this.select(chip.dataset.vehicleChip || null, event.shiftKey || event.ctrlKey || event.metaKey);
      }
    });
    document.getElementById("whole").addEventListener("click", () => this.clear());
    document.querySelectorAll("[data-show-all]").forEach((button) => button.addEventListener("click", () => showAll(button)));
    document.querySelectorAll("[data-filter]").forEach((box) => box.addEventListener("change", () => filterRows(box)));
    document.querySelectorAll("[data-filter]").forEach(filterRows);
    window.addEventListener("keydown", (event) => event.key === "Escape" && this.clear());
    window.addEventListener("beforeprint", () => this.drawAll());
  }
}

// Hide the rows of a table whose level is below that of the select box.
function filterRows(box) {
  const ranks = { note: 0, good: 1, warn: 2, bad: 3 };
  document.querySelectorAll(`#${box.dataset.filter} tr[data-level]`).forEach((row) => {
    row.hidden = ranks[row.dataset.level] < Number(box.value);
  });
}

// Show the rows of a long table that are hidden at first.
function showAll(button) {
  document.querySelectorAll(`#${button.dataset.showAll} tr.more`).forEach((row) => (row.hidden = false));
  button.remove();
}

const escapeText = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

async function main() {
  const status = document.getElementById("status");
  try {
    const [library, payload, data] = await Promise.all(["plotly-js", "payload", "arrays"].map(unpack));
    const script = document.createElement("script");
    script.textContent = new TextDecoder().decode(library);
    document.head.append(script);
    const parsed = JSON.parse(new TextDecoder().decode(payload));
    let at = 0;
    const arrays = parsed.lengths.map((length) => {
      const array = new Float32Array(data, at, length);
      at += 4 * length;
      return array;
    });
    const page = new Page(parsed, arrays);
    window.report = page;
    page.showSelection();
    page.listen();
    page.drawWhenVisible();
    status.remove();
    document.body.classList.add("ready");
  } catch (error) {
    status.textContent = `The figures cannot be shown: ${error}. The tables are complete. A browser from 2023 or later is needed.`;
    throw error;
  }
}

main();
