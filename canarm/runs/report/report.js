// Draws the charts of a report: SVG from the data in the page, zoomed by dragging. It loads nothing and asks nobody.
(() => {
  "use strict";
  const NS = "http://www.w3.org/2000/svg", WIDTH = 900, HEIGHT = 230, LEFT = 64, RIGHT = 12, TOP = 16, BOTTOM = 34;
  const charts = JSON.parse(document.getElementById("charts").textContent);
  const views = [];
  let shared = null; // the stretch of time that all charts over time show; null is the whole run

  const make = (parent, name, attributes, text) => {
    const element = parent.appendChild(document.createElementNS(NS, name));
    for (const key in attributes) element.setAttribute(key, attributes[key]);
    if (text !== undefined) element.textContent = text;
    return element;
  };
  const ticks = (low, high, count) => {
    const rough = (high - low) / count, decade = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((factor) => factor * decade).find((each) => each >= rough);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k++) found.push(k * step);
    return found;
  };
  const label = (value) => String(Number(value.toPrecision(6)));
  const first = (values, limit) => { // the first place whose value is not below the limit
    let low = 0, high = values.length;
    while (low < high) { const middle = (low + high) >> 1; if (values[middle] < limit) low = middle + 1; else high = middle; }
    return low;
  };

  class View {
    constructor(chart, place) {
      this.chart = chart; this.place = place; this.own = null; this.hidden = new Set();
      this.svg = make(place, "svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": chart.title });
      this.said = place.appendChild(document.createElement("div")); this.said.className = "said";
      const legend = place.appendChild(document.createElement("div")); legend.className = "legend";
      chart.series.forEach((series, number) => {
        const button = legend.appendChild(document.createElement("button"));
        button.className = `k${series.colour}${series.dashed ? " dashed" : ""}`; button.textContent = series.name;
        button.setAttribute("aria-pressed", "true");
        button.addEventListener("click", () => {
          if (!this.hidden.delete(number)) this.hidden.add(number);
          button.setAttribute("aria-pressed", String(!this.hidden.has(number))); this.draw();
        });
      });
      this.svg.addEventListener("pointerdown", (event) => { this.from = this.at(event); if (event.isTrusted) this.svg.setPointerCapture(event.pointerId); });
      this.svg.addEventListener("pointermove", (event) => this.move(event));
      this.svg.addEventListener("pointerup", (event) => this.zoom(event));
      this.svg.addEventListener("dblclick", () => this.show(null));
    }
    get whole() {
      if (this.chart.x_range) return this.chart.x_range;
      const ends = this.chart.series.filter((each) => each.x.length).map((each) => [each.x[0], each.x[each.x.length - 1]]);
      const low = Math.min(...ends.map((each) => each[0])), high = Math.max(...ends.map((each) => each[1]));
      return !ends.length ? [0, 1] : low < high ? [low, high] : [low - 0.5, low + 0.5];
    }
    get range() { return (this.chart.over_time ? shared : this.own) || this.whole; }
    at(event) {
      const box = this.svg.getBoundingClientRect(), [low, high] = this.range;
      const share = ((event.clientX - box.left) / box.width * WIDTH - LEFT) / (WIDTH - LEFT - RIGHT);
      return low + Math.min(Math.max(share, 0), 1) * (high - low);
    }
    move(event) {
      const x = this.at(event), [low, high] = this.range;
      const across = LEFT + (x - low) / (high - low) * (WIDTH - LEFT - RIGHT);
      this.cursor.setAttribute("d", `M${across} ${TOP}V${HEIGHT - BOTTOM}`);
      if (this.from !== undefined) {
        const start = LEFT + (this.from - low) / (high - low) * (WIDTH - LEFT - RIGHT);
        this.chosen.setAttribute("x", Math.min(start, across)); this.chosen.setAttribute("width", Math.abs(across - start));
      }
      const values = this.chart.series.filter((_, number) => !this.hidden.has(number)).map((series) => {
        const place = Math.min(first(series.x, x), series.x.length - 1), value = series.y[place];
        return `${series.name} ${value === null || value === undefined ? "–" : label(value)}`;
      });
      this.said.textContent = `${label(x)} ${this.chart.x_unit}: ${values.join(", ")}`;
    }
    zoom(event) {
      const from = this.from, to = this.at(event), [low, high] = this.range;
      this.from = undefined; this.chosen.setAttribute("width", 0);
      if (from !== undefined && Math.abs(to - from) > (high - low) * 0.01) this.show([Math.min(from, to), Math.max(from, to)]);
    }
    show(range) {
      if (this.chart.over_time) { shared = range; views.forEach((view) => view.chart.over_time && view.draw()); }
      else { this.own = range; this.draw(); }
    }
    draw() {
      const svg = this.svg, chart = this.chart, [low, high] = this.range;
      svg.replaceChildren();
      const shown = chart.series.filter((_, number) => !this.hidden.has(number));
      const parts = shown.map((series) => [series, Math.max(first(series.x, low) - 1, 0), Math.min(first(series.x, high) + 1, series.x.length)]);
      let bottom = Infinity, top = -Infinity;
      for (const [series, begin, end] of parts) for (let k = begin; k < end; k++) {
        const value = series.y[k];
        if (value !== null) { if (value < bottom) bottom = value; if (value > top) top = value; }
      }
      if (chart.bars) bottom = Math.min(bottom, 0);
      if (!(bottom <= top)) { bottom = 0; top = 1; }
      const spare = (top - bottom) * 0.05 || Math.abs(top) * 0.05 || 0.5;
      top += spare; if (!chart.bars) bottom -= spare;
      const across = (x) => LEFT + (x - low) / (high - low) * (WIDTH - LEFT - RIGHT);
      const down = (y) => HEIGHT - BOTTOM - (y - bottom) / (top - bottom) * (HEIGHT - TOP - BOTTOM);
      const inside = (x) => Math.min(Math.max(across(x), LEFT), WIDTH - RIGHT);
      for (const [begin, end, text] of chart.bands) {
        if (end < low || begin > high) continue;
        const band = make(svg, "rect", { class: "band", x: inside(begin), y: TOP, width: Math.max(inside(end) - inside(begin), 1.5), height: HEIGHT - TOP - BOTTOM });
        make(band, "title", {}, text);
      }
      for (const x of ticks(low, high, 9)) {
        make(svg, "path", { class: "grid", d: `M${across(x)} ${TOP}V${HEIGHT - BOTTOM}` });
        make(svg, "text", { x: across(x), y: HEIGHT - BOTTOM + 15, "text-anchor": "middle" }, label(x));
      }
      for (const y of ticks(bottom, top, 5)) {
        make(svg, "path", { class: "grid", d: `M${LEFT} ${down(y)}H${WIDTH - RIGHT}` });
        make(svg, "text", { x: LEFT - 6, y: down(y) + 4, "text-anchor": "end" }, label(y));
      }
      for (const [series, begin, end] of parts) {
        let path = "", pen = "M";
        for (let k = begin; k < end; k++) {
          const y = series.y[k];
          if (y === null) { pen = "M"; continue; }
          const x = Math.min(Math.max(across(series.x[k]), LEFT - 1), WIDTH - RIGHT + 1);
          path += chart.bars ? `M${x.toFixed(1)} ${down(0).toFixed(1)}V${down(y).toFixed(1)}` : `${pen}${x.toFixed(1)} ${down(y).toFixed(1)}`;
          pen = "L";
        }
        make(svg, "path", { class: `line k${series.colour}${series.dashed ? " dashed" : ""}${chart.bars ? " bars" : ""}`, d: path });
      }
      for (const [x, text, number] of chart.marks) {
        if (x < low || x > high) continue;
        const mark = make(svg, "path", { class: "mark", d: `M${across(x)} ${TOP}V${HEIGHT - BOTTOM}` });
        make(mark, "title", {}, text);
        make(svg, "text", { class: "number", x: across(x), y: TOP - 4, "text-anchor": "middle" }, number);
      }
      make(svg, "path", { class: "axis", d: `M${LEFT} ${TOP}V${HEIGHT - BOTTOM}H${WIDTH - RIGHT}` });
      make(svg, "text", { x: WIDTH - RIGHT, y: HEIGHT - 4, "text-anchor": "end" }, chart.x_label);
      this.cursor = make(svg, "path", { class: "cursor" });
      this.chosen = make(svg, "rect", { class: "chosen", y: TOP, width: 0, height: HEIGHT - TOP - BOTTOM });
    }
  }
  for (const place of document.querySelectorAll("[data-chart]")) {
    const view = new View(charts[place.dataset.chart], place);
    views.push(view); view.draw();
  }
  document.getElementById("whole").addEventListener("click", () => { shared = null; views.forEach((view) => { view.own = null; view.draw(); }); });
  document.documentElement.dataset.drawn = String(views.length);
})();
