// Signals over time on a canvas: rows one below the other, as many samples as there are. A pyramid of least and greatest values, each level
// four times as coarse, makes a view of any width cost as much as its pixels.

const FACTOR = 4, MARGIN = { left: 64, right: 12, top: 20, bottom: 30 }, GAP = 26;

// Least and greatest values of groups of 4, 16, 64, ... samples.
const pyramid = (values) => {
  const levels = [];
  let low = values, high = values;
  while (low.length > 4 * FACTOR) {
    const count = Math.ceil(low.length / FACTOR), nextLow = new Float64Array(count), nextHigh = new Float64Array(count);
    for (let k = 0; k < count; k++) {
      let l = Infinity, g = -Infinity;
      for (let i = k * FACTOR; i < Math.min((k + 1) * FACTOR, low.length); i++) {
        // NaN is neither
        if (low[i] < l) l = low[i];
        if (high[i] > g) g = high[i];
      }
      nextLow[k] = l; nextHigh[k] = g;
    }
    levels.push([nextLow, nextHigh]);
    [low, high] = [nextLow, nextHigh];
  }
  return levels;
};
const ticks = (low, high, most) => {
  const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw)), step = [1, 2, 5, 10].find((m) => m * power >= raw) * power;
  const all = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step && all.length < 100; k++) all.push(k * step);
  return [all, Math.max(0, Math.min(8, -Math.floor(Math.log10(step) + 1e-9)))];
};
const number = (value, digits) => (Math.abs(value) >= 1e6 || (value !== 0 && Math.abs(value) < 1e-6) ? value.toExponential(2) : value.toFixed(digits)).replace("-", "−");

export class Plot {
  // `chosen` hears of a segment that was dragged, in time.
  constructor({ label, chosen = null, height = 150 }) {
    this.rows = []; this.marks = []; this.height = height; this.chosen = chosen; this.selecting = false; this.segment = null; this.hair = null;
    this.canvas = document.createElement("canvas");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.label = label;
    this.readout = document.createElement("output");
    this.readout.className = "readout";
    this.element = document.createElement("div");
    this.element.className = "plotted";
    this.element.append(this.canvas, this.readout);
    new ResizeObserver(() => this.draw()).observe(this.element);
    addEventListener("theme", () => this.draw());
    addEventListener("scroll", () => this.draw(), { capture: true, passive: true });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    this.listen();
  }

  // Rows of traces: { title, traces: [{ name, time, values, colour, wide, dots }] }; the view stays where the times are the same.
  show(rows, keep = false) {
    this.rows = rows.map((row) => ({ ...row, traces: row.traces.map((t) => ({ ...t })) }));
    const times = rows.flatMap((r) => r.traces.map((t) => t.time)).filter((t) => t.length > 0);
    const whole = [Math.min(...times.map((t) => t[0])), Math.max(...times.map((t) => t[t.length - 1]))];
    if (!keep || !this.view) this.view = [...whole];
    this.whole = whole;
    this.canvas.setAttribute("aria-label", `${this.label}: ${rows.map((r) => r.title).join(", ")}; arrow keys move the crosshair, + and - zoom, 0 shows all`);
    // what follows a slider is seen in the next frame, not in the one behind it
    keep ? this.paint() : this.draw();
  }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.paint(); });
  }

  colours() {
    const style = getComputedStyle(document.documentElement), of = (n) => style.getPropertyValue(`--${n}`).trim();
    return Object.fromEntries(["ink", "faint", "rule", "grid", "paper", "measured", "model", "residual", "input", "other", "bound", "bad", "reserved", "link"].map((n) => [n, of(n)]));
  }

  // Pixels of a time, and back, by the width of the last drawing: asking the page for each sample would lay it out again.
  x(t) { const [a, b] = this.view; return MARGIN.left + (t - a) / (b - a) * (this.width - MARGIN.left - MARGIN.right); }
  t(x) { const [a, b] = this.view; return a + (x - MARGIN.left) / (this.width - MARGIN.left - MARGIN.right) * (b - a); }

  // How much of the rows is seen, from how far down: by the element that scrolls them.
  seen(whole) {
    let port = this.element.parentElement;
    while (port !== document.body && !/auto|scroll/.test(getComputedStyle(port).overflowY)) port = port.parentElement;
    const box = port.getBoundingClientRect(), style = getComputedStyle(port), own = this.element.getBoundingClientRect().top;
    const top = Math.max(own, box.top + parseFloat(style.paddingTop)), end = box.top + port.clientHeight - parseFloat(style.paddingBottom) - this.readout.offsetHeight;
    return [Math.min(whole - (top - own), Math.max(120, end - top)), top - own];
  }

  paint() {
    const width = this.element.clientWidth, whole = MARGIN.top + this.rows.length * (this.height + GAP) + MARGIN.bottom - GAP, scale = devicePixelRatio || 1, own = this.canvas;
    if (width < 50 || !this.view) return;
    const begun = performance.now();
    this.width = width;
    // what is out of sight costs nothing; scrolling draws it
    const [height, above] = this.seen(whole);
    this.element.style.gridTemplateRows = `${whole}px auto`;
    if (own.width !== Math.round(width * scale) || own.height !== Math.round(height * scale)) {
      own.width = Math.round(width * scale); own.height = Math.round(height * scale);
      own.style.width = `${width}px`; own.style.height = `${height}px`;
    }
    const g = own.getContext("2d"), c = this.colours();
    g.setTransform(scale, 0, 0, scale, 0, 0);
    g.clearRect(0, 0, width, height);
    g.font = `11px ${getComputedStyle(document.body).fontFamily}`;
    const right = width - MARGIN.right, bottom = height - MARGIN.bottom, [times, timeDigits] = ticks(...this.view, Math.max(2, width / 110));
    g.fillStyle = c.faint; g.textAlign = "center"; g.textBaseline = "top";
    for (const t of times) g.fillText(number(t, timeDigits), this.x(t), bottom + 6);
    g.textAlign = "right"; g.fillText(this.unit ?? "time [s]", right, bottom + 18);
    g.save(); g.beginPath(); g.rect(0, 0, width, bottom + 1); g.clip();
    this.rows.forEach((row, k) => {
      const top = MARGIN.top + k * (this.height + GAP) - Math.round(above), end = top + this.height;
      if (end < 0 || top - GAP > bottom) return;
      let [low, high] = this.range(row);
      if (!(high > low)) { const size = Math.abs(low) || 1; low = (Number.isFinite(low) ? low : 0) - 0.1 * size; high = low + 0.2 * size; }
      const pad = 0.06 * (high - low); low -= pad; high += pad;
      const y = (v) => end - (v - low) / (high - low) * this.height, [values, digits] = ticks(low, high, Math.max(2, this.height / 26));
      g.strokeStyle = c.grid; g.lineWidth = 1; g.beginPath();
      for (const t of times) { const x = Math.round(this.x(t)) + 0.5; g.moveTo(x, top); g.lineTo(x, end); }
      for (const v of values) { const at = Math.round(y(v)) + 0.5; g.moveTo(MARGIN.left, at); g.lineTo(right, at); }
      g.stroke();
      g.save(); g.beginPath(); g.rect(MARGIN.left, top, right - MARGIN.left, this.height); g.clip();
      for (const mark of this.marks.filter((m) => !m.rows || m.rows.includes(row.name))) {
        const a = this.x(mark.from), b = Math.max(this.x(mark.to), a + 2);
        g.globalAlpha = mark.focus ? 0.45 : 0.18; g.fillStyle = c[mark.colour] ?? mark.colour; g.fillRect(a, top, b - a, this.height); g.globalAlpha = 1;
      }
      for (const trace of row.traces) this.line(g, trace, y, c[trace.colour] ?? trace.colour, width);
      if (this.segment) {
        const [a, b] = this.segment.map((t) => this.x(t));
        g.globalAlpha = 0.16; g.fillStyle = c.link; g.fillRect(a, top, b - a, this.height); g.globalAlpha = 1;
      }
      g.restore();
      g.strokeStyle = c.rule; g.strokeRect(MARGIN.left + 0.5, top + 0.5, right - MARGIN.left - 1, this.height - 1);
      g.fillStyle = c.faint; g.textAlign = "right"; g.textBaseline = "middle";
      for (const v of values) g.fillText(number(v, digits), MARGIN.left - 6, y(v));
      g.textAlign = "left"; g.textBaseline = "bottom"; g.fillStyle = c.ink;
      g.fillText(row.title, MARGIN.left, top - 4);
    });
    g.restore();
    if (this.hair !== null) {
      g.strokeStyle = c.faint; g.setLineDash([3, 3]); g.beginPath();
      const x = Math.round(this.x(this.hair)) + 0.5; g.moveTo(x, 0); g.lineTo(x, bottom); g.stroke(); g.setLineDash([]);
    }
    if (this.dragged) { g.globalAlpha = 0.15; g.fillStyle = c.link; g.fillRect(Math.min(...this.dragged), 0, Math.abs(this.dragged[1] - this.dragged[0]), bottom); g.globalAlpha = 1; }
    // milliseconds of a drawing, and how many there were, to be looked at
    own.dataset.took = (performance.now() - begun).toFixed(1);
    own.dataset.painted = 1 + Number(own.dataset.painted ?? 0);
  }

  // Samples in view, one more on each side.
  span(time) {
    const first = (t) => { let a = 0, b = time.length; while (a < b) { const m = (a + b) >> 1; time[m] < t ? a = m + 1 : b = m; } return a; };
    return [Math.max(0, first(this.view[0]) - 1), Math.min(time.length, first(this.view[1]) + 2)];
  }

  // The level of the pyramid for so many samples on so many pixels, its groups' size, and the least and greatest values.
  level(trace, samples, pixels) {
    // of rows that are seen
    trace.levels ??= pyramid(trace.values);
    let k = -1;
    while (k + 1 < trace.levels.length && samples / FACTOR ** (k + 1) > 2 * pixels) k++;
    return k < 0 ? [1, trace.values, trace.values] : [FACTOR ** (k + 1), ...trace.levels[k]];
  }

  range(row) {
    let low = Infinity, high = -Infinity;
    for (const trace of row.traces.filter((t) => !t.aside)) {
      const [a, b] = this.span(trace.time), [group, lows, highs] = this.level(trace, b - a, 1000);
      for (let k = Math.floor(a / group); k < Math.ceil(b / group); k++) { if (lows[k] < low) low = lows[k]; if (highs[k] > high) high = highs[k]; }
    }
    return [low, high];
  }

  line(g, trace, y, colour, width) {
    const [a, b] = this.span(trace.time), { time, values } = trace, [group, lows, highs] = this.level(trace, b - a, width);
    g.strokeStyle = colour; g.fillStyle = colour; g.lineWidth = trace.wide ?? 1.2; g.lineJoin = "bevel"; g.beginPath();
    if (group === 1) {
      let up = true;
      for (let k = a; k < b; k++) {
        if (Number.isNaN(values[k])) { up = true; continue; }
        const x = this.x(time[k]);
        if (trace.held && !up) g.lineTo(x, y(values[k - 1]));
        up ? g.moveTo(x, y(values[k])) : g.lineTo(x, y(values[k]));
        up = false;
      }
      g.stroke();
      if (b - a < width / 12) { g.beginPath(); for (let k = a; k < b; k++) { g.moveTo(this.x(time[k]) + 2, y(values[k])); g.arc(this.x(time[k]), y(values[k]), 2, 0, 7); } g.fill(); }
      return;
    }
    let up = true;
    for (let k = Math.floor(a / group); k < Math.ceil(b / group); k++) {
      if (!(highs[k] >= lows[k])) { up = true; continue; }
      const x = this.x(time[Math.min(k * group, time.length - 1)]);
      up ? g.moveTo(x, y(lows[k])) : g.lineTo(x, y(lows[k]));
      g.lineTo(x, y(highs[k]));
      up = false;
    }
    g.stroke();
  }

  move([a, b]) {
    const [low, high] = this.whole, least = (high - low) * 1e-7 || 1e-9, length = Math.min(Math.max(b - a, least), high - low);
    a = Math.min(Math.max(a, low), high - length);
    this.view = [a, a + length];
    this.draw();
  }

  zoom(at, factor) { const [a, b] = this.view; this.move([at - (at - a) * factor, at + (b - at) * factor]); }

  point(t) {
    this.hair = t === null ? null : Math.min(Math.max(t, this.view[0]), this.view[1]);
    if (this.hair !== null) {
      const value = (trace) => { const [a, b] = this.span(trace.time); let k = a; while (k + 1 < b && trace.time[k + 1] <= this.hair) k++; return trace.values[k]; };
      const of = (row) => row.traces.map((t) => `${t.name} ${Number((value(t) ?? NaN).toPrecision(5))}`).join(", ");
      this.readout.textContent = `t ${Number(this.hair.toPrecision(7))}: ${this.rows.map(of).join(" · ")}`;
    }
    this.draw();
  }

  listen() {
    const own = this.canvas, at = (e) => e.clientX - own.getBoundingClientRect().left;
    own.addEventListener("wheel", (e) => {
      if (!this.view || !(e.ctrlKey || e.shiftKey || document.activeElement === own || Math.abs(e.deltaX) > Math.abs(e.deltaY))) return;
      e.preventDefault();
      const [a, b] = this.view;
      if (e.shiftKey || Math.abs(e.deltaX) > Math.abs(e.deltaY)) { const by = (e.deltaX || e.deltaY) / own.clientWidth * (b - a); this.move([a + by, b + by]); }
      else this.zoom(this.t(at(e)), Math.exp(e.deltaY * 0.0015));
    }, { passive: false });
    own.addEventListener("pointerdown", (e) => {
      if (!this.view || e.button > 1) return;
      own.setPointerCapture(e.pointerId);
      // in view panning needs no pencil: what is whole is zoomed, what is zoomed is panned
      const whole = this.view[1] - this.view[0] > 0.999 * (this.whole[1] - this.whole[0]);
      this.grip = { x: at(e), view: [...this.view], pan: !this.selecting && !e.shiftKey && !whole };
    });
    own.addEventListener("pointermove", (e) => {
      if (!this.view) return;
      if (!this.grip) { this.point(this.t(at(e))); return; }
      const { x, view, pan } = this.grip;
      if (pan) { const by = (x - at(e)) / (own.clientWidth - MARGIN.left - MARGIN.right) * (view[1] - view[0]); this.move([view[0] + by, view[1] + by]); }
      else { this.dragged = [x, at(e)]; this.draw(); }
    });
    own.addEventListener("pointerup", (e) => {
      const { x, pan } = this.grip ?? {}, to = at(e);
      this.grip = this.dragged = null;
      if (!pan && x !== undefined && Math.abs(to - x) > 4) {
        const span = [this.t(Math.min(x, to)), this.t(Math.max(x, to))].map((t) => Math.min(Math.max(t, this.whole[0]), this.whole[1]));
        if (this.selecting) { this.segment = span; this.chosen?.(span); } else this.move(span);
      }
      this.draw();
    });
    own.addEventListener("pointerleave", () => { if (!this.grip) { this.hair = null; this.draw(); } });
    own.addEventListener("dblclick", () => { if (this.whole) this.move([...this.whole]); });
    own.addEventListener("keydown", (e) => {
      if (!this.view) return;
      const [a, b] = this.view, middle = this.hair ?? (a + b) / 2, step = (b - a) / (e.shiftKey ? 10 : 100);
      const keys = {
        ArrowLeft: () => this.point(middle - step), ArrowRight: () => this.point(middle + step), "+": () => this.zoom(middle, 0.7), "-": () => this.zoom(middle, 1 / 0.7),
        0: () => this.move([...this.whole]), PageUp: () => this.move([a - (b - a) / 2, b - (b - a) / 2]), PageDown: () => this.move([a + (b - a) / 2, b + (b - a) / 2]),
      };
      if (keys[e.key]) { e.preventDefault(); keys[e.key](); }
    });
  }
}
