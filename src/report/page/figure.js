// Zoom, crosshair and linked axes for the figures of this page. Every figure was drawn before; this draws it again at the size of the
// window from the block of data behind it, and whenever its axis changes.
"use strict";
(() => {
  const SVG = "http://www.w3.org/2000/svg";
  const MARGIN = { left: 66, right: 10, top: 8, gap: 16, bottom: 40 };
  const figures = [];

  const element = (name, attributes, parent) => {
    const made = document.createElementNS(SVG, name);
    for (const key in attributes) made.setAttribute(key, attributes[key]);
    if (parent) parent.appendChild(made);
    return made;
  };
  const written = (parent, x, y, text, attributes) => {
    element("text", { x: x.toFixed(1), y: y.toFixed(1), ...attributes }, parent).textContent = text;
  };

  // Axes

  const scale = (low, high, logarithmic, from, to) => {
    const of = logarithmic ? Math.log : (v) => v;
    const back = logarithmic ? Math.exp : (v) => v;
    const [a, b] = [of(low), of(high)];
    return {
      low, high, logarithmic,
      place: (v) => (logarithmic && v <= 0 ? NaN : from + ((of(v) - a) / (b - a)) * (to - from)),
      value: (p) => back(a + ((p - from) / (to - from)) * (b - a)),
    };
  };

  const around = (values, margin, logarithmic) => {
    let [low, high] = [Infinity, -Infinity];
    for (const v of values) {
      if (v === null || v === undefined || (logarithmic && v <= 0)) continue;
      if (v < low) low = v;
      if (v > high) high = v;
    }
    if (low > high) return logarithmic ? [0.1, 10] : [0, 1];
    if (logarithmic) {
      const stretch = high > low ? Math.pow(high / low, margin) : 2;
      return [low / stretch, high * stretch];
    }
    const extra = high > low ? margin * (high - low) : Math.max(Math.abs(high), 1) / 2;
    return [low - extra, high + extra];
  };

  const label = (v, step) => {
    const size = Math.max(Math.abs(v), step);
    const sign = (text) => text.replace(/-/g, "\u2212");
    if (size < 1e-4 || size >= 1e6) {
      return sign(v.toExponential(Math.min(8, Math.max(0, Math.ceil(Math.log10(size / step))))).replace("e+", "e"));
    }
    return sign(v.toFixed(Math.min(8, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)))));
  };

  const ticks = (axis, count) => {
    const decades = Math.log10(axis.high / axis.low);
    const found = [];
    if (axis.logarithmic && decades > 0.7) {
      const first = Math.floor(Math.log10(axis.low)), last = Math.ceil(Math.log10(axis.high));
      const every = Math.max(1, Math.floor((last - first) / count / 2));
      for (let p = first; p <= last; p += every) {
        for (const s of decades > 2.5 ? [1] : [1, 2, 5]) {
          const v = s * Math.pow(10, p);
          if (v >= axis.low && v <= axis.high) found.push([v, label(v, v)]);
        }
      }
      return found;
    }
    const raw = (axis.high - axis.low) / Math.max(1, count);
    const power = Math.pow(10, Math.floor(Math.log10(raw)));
    const far = (s) => Math.abs(Math.log(s / raw));
    const step = [1, 2, 5, 10].map((s) => s * power).reduce((a, b) => (far(b) < far(a) ? b : a));
    const first = Math.ceil(axis.low / step);
    const many = Math.min(50, Math.floor(axis.high / step) - first);
    for (let k = 0; k <= many; k++) found.push([(first + k) * step, label((first + k) * step, step)]);
    return found;
  };

  // The names of things where there is room for all, else round numbers, between things and whole numbers none.
  const across = (data, x, width) => {
    const names = data.names;
    if (names && 7 * (Math.max(...names.map((n) => n.length)) + 2) * names.length <= width - MARGIN.left - MARGIN.right) {
      return data.at.map((v, k) => [v, names[k]]).filter(([v]) => v >= x.low && v <= x.high);
    }
    const whole = !data.logarithmic && data.at.every(Number.isInteger);
    const most = whole ? Math.max(1, Math.floor(x.high - x.low)) : Infinity;
    const room = Math.floor(width / 95);
    const found = ticks(x, Math.min(room, most));
    // one number says nothing of the scale
    return found.length < 2 ? ticks(x, Math.min(2 * room, most)) : found;
  };

  // Drawing

  const path = (figure, values, x, y, from, to) => {
    let text = "", before = 0;
    for (let k = from; k < to; k++) {
      const v = values[k];
      const [px, py] = v === null ? [NaN, NaN] : [x.place(figure.at[k]), y.place(v)];
      if (!(isFinite(px) && isFinite(py))) {
        if (before === 1) text += "h0";
        before = 0;
        continue;
      }
      text += (before ? "L" : "M") + px.toFixed(1) + " " + py.toFixed(1);
      before++;
    }
    return before === 1 ? text + "h0" : text;
  };

  const mark = (figure, m, x, y, from, to, parent) => {
    if (m.shape === "dots") {
      for (let k = from; k < to; k++) {
        const [px, py] = m.values[k] === null ? [NaN, NaN] : [x.place(figure.at[k]), y.place(m.values[k])];
        if (isFinite(px) && isFinite(py)) {
          element("circle", { class: "dot " + m.look, cx: px.toFixed(1), cy: py.toFixed(1), r: 2.2 }, parent);
        }
      }
    } else if (m.shape === "line") {
      element("path", { class: m.look + " line", d: path(figure, m.values, x, y, from, to) }, parent);
    } else if (m.shape === "band") {
      const points = [];
      for (let k = from; k < to; k++) if (m.values[k] !== null) points.push([x.place(figure.at[k]), y.place(m.values[k])]);
      for (let k = to - 1; k >= from; k--) if (m.low[k] !== null) points.push([x.place(figure.at[k]), y.place(m.low[k])]);
      const text = points.map((p, k) => (k ? "L" : "M") + p[0].toFixed(1) + " " + p[1].toFixed(1)).join("");
      element("path", { class: m.look + " band", d: text ? text + "Z" : "" }, parent);
    } else if (m.shape === "columns") {
      const half = 0.5 * figure.at.reduce((least, v, k) => (k ? Math.min(least, v - figure.at[k - 1]) : least), Infinity);
      let text = "";
      for (let k = from; k < to; k++) {
        if (m.values[k] === null) continue;
        const [a, b] = [x.place(figure.at[k] - half), x.place(figure.at[k] + half)].map((p) => p.toFixed(1));
        text += "M" + a + " " + y.place(m.low[k]).toFixed(1) + "V" + y.place(m.values[k]).toFixed(1) + "H" + b + "V" + y.place(m.low[k]).toFixed(1);
      }
      element("path", { class: m.look + " columns", d: text }, parent);
    } else {
      let text = "";
      for (let k = from; k < to; k++) {
        if (m.values[k] === null || m.low[k] === null) continue;
        const px = x.place(figure.at[k]).toFixed(1);
        text += "M" + px + " " + y.place(m.low[k]).toFixed(1) + "V" + y.place(m.values[k]).toFixed(1);
      }
      element("path", { class: m.look + " line " + m.shape, d: text }, parent);
    }
  };

  // The first place that is not below a value.
  const search = (at, v) => {
    let [low, high] = [0, at.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (at[middle] < v) low = middle + 1;
      else high = middle;
    }
    return low;
  };

  const draw = (figure, own) => {
    const width = own ?? Math.max(240, Math.floor(figure.canvas.clientWidth));
    const data = figure.data;
    const [low, high] = figure.group.view || figure.whole;
    const x = scale(low, high, data.logarithmic, MARGIN.left, width - MARGIN.right);
    const marked = across(data, x, width);
    const from = Math.max(0, search(figure.at, low) - 1), to = Math.min(figure.at.length, search(figure.at, high) + 2);
    let top = MARGIN.top;
    const height = data.panels.reduce((sum, p) => sum + p.height + MARGIN.gap, MARGIN.top - MARGIN.gap + MARGIN.bottom);
    const svg = figure.svg;
    svg.replaceChildren();
    svg.setAttribute("viewBox", "0 0 " + width + " " + height);
    svg.setAttribute("width", width);
    svg.setAttribute("height", height);
    figure.frames = data.panels.map((panel, k) => {
      const values = [];
      for (const m of panel.marks) {
        for (let i = from; i < to; i++) {
          values.push(m.values[i]);
          if (m.low) values.push(m.low[i]);
        }
      }
      const y = scale(...around(values, 0.04, panel.logarithmic), panel.logarithmic, top + panel.height, top);
      const frame = { top, bottom: top + panel.height, x, y, panel };
      const clip = figure.id + "-clip-" + k;
      const box = { x: MARGIN.left, y: top, width: width - MARGIN.right - MARGIN.left, height: panel.height };
      element("rect", box, element("clipPath", { id: clip }, svg));
      for (const [v] of marked) {
        const at = x.place(v).toFixed(1);
        element("line", { class: "grid", x1: at, x2: at, y1: top, y2: frame.bottom }, svg);
      }
      for (const [v, text] of ticks(y, Math.floor(panel.height / 30))) {
        const at = y.place(v);
        element("line", { class: "grid", x1: MARGIN.left, x2: width - MARGIN.right, y1: at.toFixed(1), y2: at.toFixed(1) }, svg);
        written(svg, MARGIN.left - 6, at + 4, text, { class: "tick", "text-anchor": "end" });
      }
      element("rect", { class: "frame", ...box }, svg);
      const inside = element("g", { "clip-path": "url(#" + clip + ")" }, svg);
      for (const m of panel.marks) mark(figure, m, x, y, from, to, inside);
      const turned = { class: "label", "text-anchor": "middle", transform: "translate(13 " + (top + panel.height / 2) + ") rotate(-90)" };
      written(svg, 0, 0, panel.label, turned);
      top += panel.height + MARGIN.gap;
      return frame;
    });
    const bottom = height - MARGIN.bottom;
    for (const [v, text] of marked) written(svg, x.place(v), bottom + 15, text, { class: "tick", "text-anchor": "middle" });
    written(svg, (MARGIN.left + width - MARGIN.right) / 2, height - 6, data.label, { class: "label", "text-anchor": "middle" });
    figure.over = element("g", { "pointer-events": "none" }, svg);
    svg.setAttribute("data-low", low);
    svg.setAttribute("data-high", high);
    figure.drawn = true;
    figure.width = width;
  };

  // Crosshair: the sample that is nearest to the pointer, the same in all figures of a group

  const nearest = (figure, v) => {
    const k = search(figure.at, v);
    if (k === 0) return 0;
    if (k >= figure.at.length) return figure.at.length - 1;
    return v - figure.at[k - 1] < figure.at[k] - v ? k - 1 : k;
  };

  const show = (figure, k) => {
    figure.over.replaceChildren();
    figure.readout.textContent = "";
    figure.chosen = k;
    if (k === null || k === undefined || !figure.at.length) return;
    const names = figure.data.names;
    const said = [names ? names[k] : figure.data.label.replace(/ \[.*/, "") + " = " + figure.at[k]];
    for (const frame of figure.frames) {
      const px = frame.x.place(figure.at[k]);
      element("line", { class: "hair", x1: px, x2: px, y1: frame.top, y2: frame.bottom }, figure.over);
      for (const m of frame.panel.marks) {
        const v = m.values[k];
        if (v === null || m.name === "") continue;
        const between = m.low && m.shape !== "stems" && m.shape !== "columns" ? m.low[k] + " to " + v : v;
        said.push(m.name + " = " + between);
        if (!m.low) element("circle", { class: "dot " + m.look, cx: px, cy: frame.y.place(v), r: 3.5 }, figure.over);
      }
    }
    figure.readout.textContent = said.join("   ");
  };

  const showAll = (figure, k) => {
    const at = k === null ? null : figure.at[k];
    for (const other of figure.group.members) {
      if (other.drawn) show(other, at === null ? null : other === figure ? k : nearest(other, at));
    }
  };

  const zoom = (figure, low, high) => {
    const [first, last] = figure.whole;
    const positive = figure.data.logarithmic;
    low = Math.max(first, low);
    high = Math.min(last, high);
    const least = positive ? high / low > 1.0001 : high - low > (last - first) * 1e-6;
    if (!least) return;
    figure.group.view = low <= first && high >= last ? null : [low, high];
    for (const other of figure.group.members) if (other.drawn) draw(other);
  };

  // By a factor about a place in pixels.
  const magnify = (figure, factor, px) => {
    const { x } = figure.frames[0];
    const [a, b] = [x.place(x.low), x.place(x.high)];
    zoom(figure, x.value(px - (px - a) * factor), x.value(px + (b - px) * factor));
  };

  const reset = (figure) => zoom(figure, ...figure.whole);

  // Hands

  const listen = (figure) => {
    const svg = figure.svg;
    const pointers = new Map();
    let start = null, spread = null;
    const at = (event) => {
      const box = svg.getBoundingClientRect();
      return ((event.clientX - box.left) / box.width) * figure.width;
    };
    const inside = (px) => Math.min(figure.width - MARGIN.right, Math.max(MARGIN.left, px));
    const distance = () => {
      const [a, b] = [...pointers.values()];
      return Math.max(10, Math.abs(a - b));
    };
    svg.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      pointers.set(event.pointerId, at(event));
      start = event.pointerType === "mouse" && pointers.size === 1 ? inside(at(event)) : null;
      spread = pointers.size === 2 ? distance() : null;
      if (event.isTrusted) svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointermove", (event) => {
      const px = at(event);
      if (pointers.has(event.pointerId)) pointers.set(event.pointerId, px);
      if (spread !== null && pointers.size === 2) {
        const now = distance();
        const [a, b] = [...pointers.values()];
        if (Math.abs(now - spread) > 4) {
          magnify(figure, spread / now, (a + b) / 2);
          spread = now;
        }
        return;
      }
      showAll(figure, nearest(figure, figure.frames[0].x.value(inside(px))));
      if (start !== null && Math.abs(px - start) > 4) {
        const [a, b] = [Math.min(start, inside(px)), Math.max(start, inside(px))];
        for (const f of figure.frames) {
          element("rect", { class: "chosen", x: a, y: f.top, width: b - a, height: f.bottom - f.top }, figure.over);
        }
      }
    });
    const end = (event) => {
      const px = inside(at(event));
      pointers.delete(event.pointerId);
      spread = null;
      if (event.type === "pointerup" && start !== null && Math.abs(px - start) > 4) {
        const { x } = figure.frames[0];
        zoom(figure, x.value(Math.min(start, px)), x.value(Math.max(start, px)));
      }
      start = null;
    };
    svg.addEventListener("pointerup", end);
    svg.addEventListener("pointercancel", end);
    svg.addEventListener("pointerleave", () => pointers.size || showAll(figure, null));
    svg.addEventListener("dblclick", () => reset(figure));
    svg.addEventListener("wheel", (event) => {
      // the wheel alone moves the page
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      magnify(figure, Math.exp(Math.max(-1, Math.min(1, event.deltaY * 0.002))), inside(at(event)));
    }, { passive: false });
    svg.addEventListener("keydown", (event) => {
      const k = figure.chosen ?? 0;
      const middle = figure.frames[0].x.place(figure.at[k]);
      const act = {
        ArrowLeft: () => showAll(figure, Math.max(0, k - 1)),
        ArrowRight: () => showAll(figure, Math.min(figure.at.length - 1, k + 1)),
        "+": () => magnify(figure, 0.5, inside(middle)),
        "-": () => magnify(figure, 2, inside(middle)),
        Escape: () => reset(figure),
      }[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    });
  };

  // Beginning: what is seen is drawn; the rest when it comes into view

  const groups = new Map();
  const begin = (holder) => {
    const data = JSON.parse(holder.querySelector("script").textContent);
    const svg = holder.querySelector("svg");
    const name = holder.dataset.group;
    if (!groups.has(name)) groups.set(name, { members: [], view: null });
    const figure = {
      id: holder.id, data, at: data.at, svg, canvas: holder.querySelector(".canvas"), readout: holder.querySelector(".readout"),
      group: groups.get(name), drawn: false, paper: svg.viewBox.baseVal.width, chosen: null, whole: around(data.at, data.margin, data.logarithmic),
    };
    figure.group.members.push(figure);
    figures.push(figure);
    svg.classList.add("live");
    draw(figure);
    listen(figure);
    return figure;
  };
  const known = new Map();
  const seen = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      if (isIntersecting && !known.has(target)) known.set(target, begin(target));
    }
  }, { rootMargin: "200px" });
  document.querySelectorAll("figure.plot").forEach((holder) => {
    // keys reach what is out of view, and bring it there
    holder.querySelector("svg").setAttribute("tabindex", "0");
    seen.observe(holder);
  });
  new ResizeObserver(() => {
    for (const figure of figures) if (figure.canvas.clientWidth && Math.floor(figure.canvas.clientWidth) !== figure.width) draw(figure);
  }).observe(document.body);

  // Paper shows everything, as wide as it was drawn for paper; the switch between light and dark

  addEventListener("beforeprint", () => {
    document.querySelectorAll("details.run").forEach((d) => { d.open = true; });
    figures.forEach((figure) => draw(figure, figure.paper));
  });
  addEventListener("afterprint", () => figures.forEach((figure) => draw(figure)));
  const root = document.documentElement, button = document.getElementById("theme");
  button.hidden = false;
  button.addEventListener("click", () => {
    const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = dark ? "light" : "dark";
  });
})();
