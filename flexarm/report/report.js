"use strict";
// Plots of a report: every figure draws one chart of the data block as SVG, over a common x axis that can be zoomed with
// the mouse, the buttons or the keys. Nothing is fetched, and no text of the data is read as HTML.
(function () {
  const NS = "http://www.w3.org/2000/svg";
  const TOP = 22, BOTTOM = 6, AXIS = 40, PANEL = 190, LEFT = 64, RIGHT = 12;

  function make(tag, attributes, ...children) {
    const svg = ["svg", "g", "path", "line", "rect", "text", "title"].includes(tag);
    const node = svg ? document.createElementNS(NS, tag) : document.createElement(tag);
    for (const [key, value] of Object.entries(attributes || {})) node.setAttribute(key, value);
    for (const child of children) node.append(child);
    return node;
  }

  function xOf(trace, i) { return trace.x ? trace.x[i] : trace.t0 + i * trace.dt; }

  // First index whose x is not below a value.
  function from(trace, value) {
    if (!trace.x) return Math.min(Math.max(Math.ceil((value - trace.t0) / trace.dt), 0), trace.y.length);
    let low = 0, high = trace.y.length;
    while (low < high) { const mid = (low + high) >> 1; if (trace.x[mid] < value) low = mid + 1; else high = mid; }
    return low;
  }

  // Ticks of a logarithmic axis over exponents: tens, and 2 and 5 between them where there is room.
  function tens(low, high, count) {
    const made = [];
    for (let k = Math.floor(low); k <= Math.ceil(high); k++) for (const m of high - low < count / 3 ? [1, 2, 5] : [1]) made.push(k + Math.log10(m));
    const inside = made.filter(v => v >= low - 1e-9 && v <= high + 1e-9);
    if (inside.length > 1) return inside;
    return ticks(low, high, count).made;
  }

  function ticks(low, high, count) {
    const raw = (high - low) / Math.max(count, 1), power = Math.pow(10, Math.floor(Math.log10(raw)));
    const step = [1, 2, 5, 10].map(k => k * power).find(k => k >= raw * 0.999) || power;
    const made = [];
    for (let i = Math.ceil(low / step - 1e-9); i * step <= high + step * 1e-9; i++) made.push(i * step);
    return { made, step };
  }

  function shown(value, step) {
    if (value === 0) return "0";
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const size = Math.abs(value);
    const text = size >= 1e5 || digits > 5 ? value.toExponential(Math.max(0, Math.floor(Math.log10(size) + 1e-9) + digits)) : value.toFixed(digits);
    return text.replace(/-/g, "−").replace("e+", "e");
  }

  function nice(value) { return Number(value.toPrecision(5)).toString().replace(/-/g, "−"); }
  function named(label, unit) { const u = unit && unit !== "1" && unit !== "*" ? "[" + unit.replaceAll(".", "·") + "]" : ""; return (label + " " + u).trim(); }

  class Plot {
    constructor(figure, chart) {
      this.figure = figure;
      this.chart = chart;
      this.log = chart.x.log;
      if (this.log) for (const view of chart.views) for (const panel of view.panels) for (const trace of panel.traces) {
        trace.x = trace.y.map((_, i) => Math.log10(xOf(trace, i)));
      }
      this.hidden = new Set(chart.hidden);
      this.choice = 0;
      this.reading = make("p", { class: "reading", "aria-live": "polite" });
      this.area = make("div", { class: "area", tabindex: "0", role: "group", "aria-roledescription": "plot" });
      this.legend = make("div", { class: "legend", role: "group", "aria-label": "Curves; press to hide or show" });
      figure.append(this.tools(), this.legend, this.area, this.reading);
      this.listen();
      this.choose(0);
      new ResizeObserver(() => this.draw()).observe(this.area);
    }

    tools() {
      const row = make("div", { class: "tools" });
      if (this.chart.views.length > 1) {
        const label = this.figure.dataset.choice || "Show";
        const select = make("select", { "aria-label": label + " shown in the plot" });
        this.chart.views.forEach((view, i) => select.append(make("option", { value: i }, view.name)));
        select.addEventListener("change", () => this.choose(Number(select.value)));
        this.select = select;
        row.append(make("label", {}, label + ": ", select));
      } else if (this.chart.views[0] && this.chart.views[0].name) row.append(make("span", {}, this.chart.views[0].name));
      row.append(make("span", { class: "gap" }));
      const buttons = [
        ["+", "Zoom in", () => this.zoom(0.5)], ["−", "Zoom out", () => this.zoom(2)],
        ["←", "Earlier", () => this.move(-0.25)], ["→", "Later", () => this.move(0.25)],
        ["Reset", "Show all", () => this.reset()],
      ];
      for (const [sign, name, act] of buttons) {
        const button = make("button", { type: "button", title: name, "aria-label": name }, sign);
        button.addEventListener("click", act);
        row.append(button);
      }
      return row;
    }

    show(name) {
      const number = this.chart.views.findIndex(view => view.name === name);
      if (number < 0) return;
      if (this.select) this.select.value = number;
      this.choose(number);
    }

    choose(number) {
      this.choice = number;
      this.view = this.chart.views[number];
      let low = Infinity, high = -Infinity;
      for (const panel of this.view.panels) for (const trace of panel.traces) if (trace.y.length) {
        low = Math.min(low, xOf(trace, 0)); high = Math.max(high, xOf(trace, trace.y.length - 1));
      }
      if (!(high > low)) { const at = isFinite(low) ? low : 0; low = at - 0.5; high = at + 0.5; }
      // Points at the ends are to be seen whole.
      const pad = this.view.panels.some(p => p.traces.some(t => t.points)) ? (high - low) * 0.02 : 0;
      low -= pad; high += pad;
      this.full = [low, high];
      this.range = [low, high];
      this.entries();
      this.draw();
    }

    entries() {
      const seen = new Map();
      for (const panel of this.view.panels) for (const trace of panel.traces) if (!seen.has(trace.name)) seen.set(trace.name, trace);
      this.legend.replaceChildren();
      for (const [name, trace] of seen) {
        const sign = { class: (trace.points ? "mark " : "trace ") + trace.style, d: trace.points ? "M10 5a3 3 0 1 0 6 0a3 3 0 1 0 -6 0" : "M0 5H26" };
        const line = make("svg", { "aria-hidden": "true", viewBox: "0 0 26 10" }, make("path", sign));
        const button = make("button", { type: "button", "aria-pressed": String(!this.hidden.has(name)) }, line, name);
        button.addEventListener("click", () => {
          if (!this.hidden.delete(name)) this.hidden.add(name);
          button.setAttribute("aria-pressed", String(!this.hidden.has(name)));
          this.draw();
        });
        this.legend.append(button);
      }
      const bands = new Set(this.view.panels.filter(p => p.bandName).map(p => p.bandName));
      for (const band of bands) {
        const swatch = make("svg", { "aria-hidden": "true", viewBox: "0 0 26 10" }, make("rect", { class: "noise", width: 26, height: 10 }));
        this.legend.append(make("span", { class: "note" }, swatch, " " + band));
      }
    }

    // -- zooming -----------------------------------------------------------------------------------------------------

    // A place on the x axis in words.
    said(x) { return nice(this.log ? Math.pow(10, x) : x); }

    limit(low, high) {
      const whole = this.full[1] - this.full[0], least = whole * 1e-5;
      let span = Math.min(Math.max(high - low, least), whole);
      low = Math.min(Math.max((low + high - span) / 2, this.full[0]), this.full[1] - span);
      this.range = [low, low + span];
      this.draw();
      const unit = this.chart.x.unit ? " " + this.chart.x.unit : "";
      this.reading.textContent = this.chart.x.label + " from " + this.said(low) + unit + " to " + this.said(low + span) + unit;
    }
    zoom(factor, at) {
      const [low, high] = this.range, centre = at === undefined ? (low + high) / 2 : at;
      this.limit(centre - (centre - low) * factor, centre + (high - centre) * factor);
    }
    move(share) { const d = (this.range[1] - this.range[0]) * share; this.limit(this.range[0] + d, this.range[1] + d); }
    reset() { this.limit(...this.full); }

    listen() {
      this.area.addEventListener("keydown", event => {
        const acts = { ArrowLeft: () => this.move(-0.25), ArrowRight: () => this.move(0.25), ArrowUp: () => this.zoom(0.5), ArrowDown: () => this.zoom(2),
          "+": () => this.zoom(0.5), "=": () => this.zoom(0.5), "-": () => this.zoom(2), "0": () => this.reset(), Home: () => this.reset() };
        if (!acts[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        acts[event.key]();
      });
      let start = null;
      this.area.addEventListener("pointerdown", event => {
        if (event.pointerType !== "mouse" || event.button !== 0) return;
        start = this.at(event);
        this.area.setPointerCapture(event.pointerId);
      });
      this.area.addEventListener("pointermove", event => {
        const x = this.at(event);
        this.mark(x, start);
      });
      this.area.addEventListener("pointerup", event => {
        if (start === null) return;
        const x = this.at(event), one = start;
        start = null;
        this.mark(null, null);
        if (Math.abs(this.place(x) - this.place(one)) > 6) this.limit(Math.min(one, x), Math.max(one, x));
      });
      this.area.addEventListener("pointerleave", () => { if (start === null) this.mark(null, null); });
      this.area.addEventListener("dblclick", () => this.reset());
      this.area.addEventListener("wheel", event => {
        if (!event.ctrlKey) return;
        event.preventDefault();
        this.zoom(event.deltaY > 0 ? 1.25 : 0.8, this.at(event));
      }, { passive: false });
    }

    at(event) {
      const box = this.area.getBoundingClientRect();
      const share = (event.clientX - box.left - this.left) / (this.width - this.left - RIGHT);
      return this.range[0] + Math.min(Math.max(share, 0), 1) * (this.range[1] - this.range[0]);
    }
    place(x) { return this.left + (x - this.range[0]) / (this.range[1] - this.range[0]) * (this.width - this.left - RIGHT); }

    // The cursor with the values under it, or the stretch that is being dragged over.
    mark(x, start) {
      this.over.replaceChildren();
      if (x === null) { this.reading.textContent = ""; return; }
      const a = this.place(x);
      if (start !== null) {
        const b = this.place(start);
        this.over.append(make("rect", { class: "brush", x: Math.min(a, b), y: 0, width: Math.abs(a - b), height: this.height - AXIS }));
      }
      this.over.append(make("line", { class: "cursor", x1: a, x2: a, y1: 0, y2: this.height - AXIS }));
      const parts = [];
      for (const panel of this.view.panels) for (const trace of panel.traces) {
        if (this.hidden.has(trace.name) || !trace.y.length) continue;
        let i = Math.min(from(trace, x), trace.y.length - 1);
        if (i > 0 && x - xOf(trace, i - 1) < xOf(trace, i) - x) i -= 1;
        if (trace.y[i] !== null) parts.push((panel.label && panel.label !== trace.name ? panel.label + ", " : "") + trace.name + " " + nice(trace.y[i]) + (panel.unit && panel.unit !== "1" ? " " + panel.unit : ""));
      }
      this.reading.textContent = this.chart.x.label + " " + this.said(x) + " " + this.chart.x.unit + ": " + parts.join("; ");
    }

    // -- drawing -----------------------------------------------------------------------------------------------------

    draw() {
      const width = this.area.clientWidth;
      if (!width || !this.view) return;
      this.width = width;
      this.left = width < 500 ? 54 : LEFT;
      const panels = this.view.panels;
      const height = panels.length > 1 ? PANEL : 280;
      this.height = panels.length * (height + TOP + BOTTOM) + AXIS;
      const svg = make("svg", { viewBox: "0 0 " + width + " " + this.height, height: this.height, role: "img", "aria-label": this.words() });
      panels.forEach((panel, i) => this.panel(svg, panel, i * (height + TOP + BOTTOM) + TOP, height));
      const bottom = this.height - AXIS, room = (width - this.left) / 90, { made, step } = ticks(this.range[0], this.range[1], room);
      for (const x of this.log ? tens(this.range[0], this.range[1], room) : made) {
        const text = this.log ? Number(Math.pow(10, x).toPrecision(3)).toString().replace(/-/g, "−") : shown(x, step);
        svg.append(make("text", { class: "tick", x: this.place(x), y: bottom + 14, "text-anchor": "middle" }, text));
      }
      svg.append(make("text", { x: (this.left + width - RIGHT) / 2, y: this.height - 6, "text-anchor": "middle" }, named(this.chart.x.label, this.chart.x.unit)));
      this.over = make("g");
      svg.append(this.over);
      this.area.replaceChildren(svg);
      this.area.setAttribute("aria-label", this.figure.dataset.title + ": arrow keys move and zoom, 0 shows all");
    }

    short(text) {
      const most = Math.floor(this.width / 8);
      return text.length > most ? text.slice(0, most - 12) + "…" + text.slice(-10) : text;
    }

    words() {
      const parts = this.view.panels.map(p => named(p.label, p.unit) + ": " + p.traces.map(t => t.name).join(", "));
      return this.figure.dataset.title + (this.view.name ? ", " + this.view.name : "") + ". " + parts.join(". ");
    }

    panel(svg, panel, top, height) {
      const visible = panel.traces.filter(t => !this.hidden.has(t.name));
      let low = Infinity, high = -Infinity;
      for (const trace of visible) {
        const end = Math.min(from(trace, this.range[1]) + 1, trace.y.length);
        for (let i = Math.max(from(trace, this.range[0]) - 1, 0); i < end; i++) {
          for (const v of [trace.y[i], trace.low && trace.low[i], trace.high && trace.high[i]]) if (typeof v === "number") { low = Math.min(low, v); high = Math.max(high, v); }
        }
      }
      if (panel.band && isFinite(low)) { low = Math.min(low, panel.band[0]); high = Math.max(high, panel.band[1]); }
      if (!isFinite(low)) { low = 0; high = 1; }
      if (high - low <= 1e-12 * Math.max(Math.abs(low), Math.abs(high), 1e-300)) { const pad = Math.abs(low) || 1; low -= pad / 2; high += pad / 2; }
      const pad = (high - low) * 0.06;
      low -= pad; high += pad;
      const y = v => top + height - (v - low) / (high - low) * height;
      const right = this.width - RIGHT, { made, step } = ticks(low, high, height / 45);
      svg.append(make("text", { x: 2, y: top - 8, "font-weight": "bold" }, this.short(named(panel.label, panel.unit))));
      for (const v of made) {
        svg.append(make("line", { class: "grid", x1: this.left, x2: right, y1: y(v), y2: y(v) }));
        svg.append(make("text", { class: "tick", x: this.left - 6, y: y(v) + 4, "text-anchor": "end" }, shown(v, step)));
      }
      const inner = make("svg", { x: this.left, y: top, width: Math.max(right - this.left, 1), height });
      if (panel.band) inner.append(make("rect", { class: "noise", x: 0, width: right - this.left, y: y(panel.band[1]) - top, height: Math.max(y(panel.band[0]) - y(panel.band[1]), 1) }));
      const px = x => this.place(x) - this.left, py = v => y(v) - top;
      for (const trace of visible) {
        if (trace.low) inner.append(make("path", { class: "halo " + trace.style, d: this.halo(trace, px, py) }));
        const kind = trace.points ? "mark " : "trace ", d = trace.points ? this.marks(trace, px, py) : this.path(trace, px, py);
        inner.append(make("path", { class: kind + trace.style, d }, make("title", {}, trace.name)));
      }
      svg.append(inner, make("path", { class: "axis", d: "M" + this.left + " " + top + "V" + (top + height) + "H" + right }));
    }

    // A path with at most four points for each column of pixels: first, least, greatest and last.
    path(trace, px, py) {
      const begin = Math.max(from(trace, this.range[0]) - 1, 0), end = Math.min(from(trace, this.range[1]) + 1, trace.y.length);
      let text = "", pen = "M", column = null, group = [];
      const flush = () => {
        if (!group.length) return;
        let least = 0, most = 0;
        group.forEach((p, i) => { if (p[1] < group[least][1]) least = i; if (p[1] > group[most][1]) most = i; });
        for (const i of [...new Set([0, least, most, group.length - 1])].sort((a, b) => a - b)) {
          text += pen + group[i][0].toFixed(1) + " " + group[i][1].toFixed(1);
          pen = "L";
        }
        group = [];
      };
      for (let i = begin; i < end; i++) {
        if (trace.y[i] === null) { flush(); pen = "M"; column = null; continue; }
        const x = px(xOf(trace, i)), c = Math.floor(x);
        if (c !== column) { flush(); column = c; }
        group.push([x, py(trace.y[i])]);
      }
      flush();
      return text || "M0 0";
    }

    marks(trace, px, py) {
      let text = "";
      trace.y.forEach((v, i) => {
        if (v !== null) text += "M" + (px(xOf(trace, i)) - 3).toFixed(1) + " " + py(v).toFixed(1) + "a3 3 0 1 0 6 0a3 3 0 1 0 -6 0";
      });
      return text || "M0 0";
    }

    halo(trace, px, py) {
      const up = [], down = [];
      trace.y.forEach((_, i) => {
        if (trace.low[i] === null || trace.high[i] === null) return;
        up.push(px(xOf(trace, i)).toFixed(1) + " " + py(trace.high[i]).toFixed(1));
        down.unshift(px(xOf(trace, i)).toFixed(1) + " " + py(trace.low[i]).toFixed(1));
      });
      return up.length ? "M" + up.concat(down).join("L") + "Z" : "M0 0";
    }
  }

  const charts = new Map(JSON.parse(document.getElementById("data").textContent).map(c => [c.key, c]));
  const plots = new Map();
  for (const figure of document.querySelectorAll("figure[data-plot]"))
    plots.set(figure.dataset.plot, new Plot(figure, charts.get(figure.dataset.plot)));
  for (const link of document.querySelectorAll("a[data-show]"))
    link.addEventListener("click", () => plots.has(link.dataset.show) && plots.get(link.dataset.show).show(link.dataset.view));
})();
