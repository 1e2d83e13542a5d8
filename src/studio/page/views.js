// The five steps: record, model, fit, what is missing, report. Each is made once and hears of every change of the folder.

import { attempt, bracketed, bytes, calm, drop, ended, get, h, latest, post, read, run, say, send, shell, shown, stop, store, teller, unit, unpack, work } from "./ask.js";
import { Editor } from "./editor.js";
import { Plot } from "./plot.js";

const choice = (values, own, changed, label) => {
  const select = h("select", { change: () => changed(select.value), "aria-label": label });
  options(select, values, own);
  return select;
};
// Options as [value, text]; nothing moves where they are the same.
const options = (select, values, own) => {
  const key = JSON.stringify(values);
  if (select.dataset.key !== key) { select.replaceChildren(...values.map(([value, text]) => h("option", { value }, text))); select.dataset.key = key; }
  if (own !== undefined) select.value = own;
};
const button = (text, click, more = {}) => h("button", { type: "button", click, ...more }, text);
const project = () => store.state?.project ?? { data: [], validation: [] };
const set = (key, ...values) => post("project", { key, values });
const frame = (title) => h("iframe", { title, load: (e) => { const theme = document.documentElement.dataset.theme, page = e.target.contentDocument; if (theme && page) page.documentElement.dataset.theme = theme; } });
const point = (own, address) => { if (own.dataset.at !== address) { own.dataset.at = address; own.src = address; } };
const result = (seen) => `result?path=${encodeURIComponent(seen.path)}&at=${seen.stamp}`;
const diff = (text) => h("pre.diff", {}, text.split("\n").filter((l) => !/^(---|\+\+\+|@@)/.test(l)).map((l) => (l[0] === "+" ? h("ins", {}, l) : l[0] === "-" ? h("del", {}, l) : `${l}\n`)));
const words = (text) => [...text.matchAll(/'([^']*)'|"([^"]*)"|(\S+)/g)].map((m) => m[1] ?? m[2] ?? m[3]);
const details = (summary, ...inside) => h("details", {}, h("summary", {}, summary), ...inside);

// The text of the model as a result had it: what was accepted since is undone, after any number of windows and days.
const back = (models, seen, name = "Back to this text") => button(name, () => attempt(async () => {
  const { path, over, open } = models.editor(), text = await (await get("document", { path: seen.path, name: "model.fdm" })).text();
  await send("text", { path, text, over });
  await open(path);
  say(`${path} is as ${seen.path} had it`);
}), { title: `the text of the model as ${seen.path} had it` });

// Patterns of the project file stand for the records that they name.
const matches = (pattern, path) => new RegExp(`^${pattern.split("*").map((p) => p.replace(/[.+^${}()|[\]\\?]/g, "\\$&")).join("[^/]*")}$`).test(path);
const named = (list) => { const records = store.files("record").map((f) => f.path); return list.flatMap((p) => { const found = records.filter((r) => matches(p, r)); return found.length ? found : [p]; }); };

// The table of runs: rows by their titles.
const table = {
  async read() {
    const path = project().runs;
    if (!path) {
      const rows = (list, role) => named(list).map((file) => ({ file, run: "", role, from: "", to: "" }));
      return { path: "runs.csv", over: null, titles: ["file", "run", "role", "from", "to"], rows: [...rows(project().data, "fit"), ...rows(project().validation, "validation")] };
    }
    const { text, fingerprint } = await read("text", { path });
    const cells = (line) => [...line.matchAll(/("(?:[^"]|"")*"|[^,]*)(?:,|$)/g)].map((m) => m[1].replace(/^"|"$/g, "").replaceAll('""', '"').trim());
    const [head, ...lines] = text.split(/\r?\n/).filter((l) => l.trim() && l[0] !== "#").map(cells);
    const titles = head.filter(Boolean);
    return { path, over: fingerprint, titles, rows: lines.map((l) => Object.fromEntries(titles.map((t, k) => [t, l[k] ?? ""]))) };
  },
  async write({ path, over, titles, rows }) {
    for (const row of rows) for (const t of Object.keys(row)) if (row[t] && !titles.includes(t)) titles.push(t);
    const cell = (text = "") => (/[",]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
    const text = [titles, ...rows.map((r) => titles.map((t) => r[t]))].map((r) => r.map((c) => cell(c)).join(",")).join("\n");
    await send("text", { path, text: `${text}\n`, over });
    if (project().runs !== path) await set("runs", path);
  },
};

// ---- 1 record

export const record = () => {
  let path = null, contents = null, findings = [], segment = null;
  const chosen = new Map(), kept = new Map();
  const plot = new Plot({ label: "record", height: 120, chosen: (span) => { segment = span; offer(); } });
  const files = h("ul.files"), channels = h("div.channels"), segments = h("div.segment"), runs = h("div"), judged = h("div.findings", { "aria-live": "polite" }), notes = h("div");
  const input = h("input", { type: "file", multiple: true, hidden: true, change: () => add(input.files) });
  const zone = h("div.drop", { dragover: (e) => { e.preventDefault(); zone.classList.add("over"); }, dragleave: () => zone.classList.remove("over"), drop: (e) => { e.preventDefault(); zone.classList.remove("over"); add(e.dataTransfer.files); } },
    h("p", {}, "Drop a record here: CSV, MAT, XLSX, ULog, DataFlash"), button("Choose files", () => input.click()), input);
  const selecting = button("Choose a segment", () => { plot.selecting = !plot.selecting; selecting.setAttribute("aria-pressed", plot.selecting); }, { "aria-pressed": "false" });
  const judge = button("Judge the record", () => attempt(async () => {
    judged.replaceChildren(h("p.note", {}, "at work …"));
    await work("doctor", ["--no-project", `--data=${path}`, ...(project().map ? [`--map-file=${project().map}`] : [])], async (job) => {
      if (!job.ended) return;
      findings = (await attempt(() => read("doctor")))?.findings ?? [];
      // what is told of a channel is seen beside it
      for (const [t, topic] of contents.topics.entries()) for (const [f, field] of topic.fields.entries()) if (f !== topic.time && findings.some((o) => o.severity === "finding" && o.channels.includes(field.name))) chosen.get(path).add(`${t}:${f}`);
      list();
      await attempt(() => draw(true));
      report(job.ended.text);
    });
  }), { class: "first" });
  const element = h("section.view.record-view", {},
    h("aside", {}, h("h2", {}, "Records"), files, zone, runs, h("h2", {}, "Channels"), channels),
    h("div.work", {}, h("div.tools", {}, judge, selecting, button("All of it", () => plot.whole && plot.move([...plot.whole])), h("span.note", {}, "drag to zoom, then to pan; Ctrl + wheel zooms; double click shows all")), segments, judged, plot.element, notes));
  const tell = teller(element);

  const add = (list) => attempt(async () => {
    for (const file of list) { say(`reading ${file.name}`); await drop(file); tell("cp", shell(file.name), "."); }
    const own = [...list].find((f) => !/\.(fdm|toml)$/.test(f.name))?.name;
    if (own && !project().data.length && !project().runs) await set("data", own);
    say("");
    if (own) await open(own);
  });
  const role = (file) => (named(project().data).includes(file) ? "fit" : named(project().validation).includes(file) ? "validation" : "");
  const turn = (file, to) => attempt(async () => {
    if (project().runs) {
      const t = await table.read();
      t.rows = to ? t.rows.some((r) => r.file === file) ? t.rows.map((r) => (r.file === file ? { ...r, role: to } : r)) : [...t.rows, { file, role: to }] : t.rows.filter((r) => r.file !== file);
      return table.write(t);
    }
    const lists = { fit: named(project().data).filter((f) => f !== file), validation: named(project().validation).filter((f) => f !== file) };
    lists[to]?.push(file);
    await set("data", ...lists.fit);
    await set("validation", ...lists.validation);
    tell("# fdm.toml:", to === "validation" ? "validation" : "data", "=", JSON.stringify(lists[to || "fit"]));
  });
  const open = (file) => attempt(async () => {
    path = file;
    contents = await read("record", { path });
    [findings, segment] = [[], null];
    plot.marks = []; plot.segment = null;
    judged.replaceChildren(); segments.replaceChildren();
    notes.replaceChildren(...(contents.notes.length ? [details(`${contents.notes.length} note${contents.notes.length > 1 ? "s" : ""} of the reader`, h("ul", {}, contents.notes.map((n) => h("li", {}, n))))] : []));
    tell("fdm data", shell(path));
    if (!chosen.has(path)) {
      const size = (t) => (t.time === null ? 0 : t.rows * t.fields.length), topic = contents.topics.reduce((best, t, k) => (size(t) > size(contents.topics[best]) ? k : best), 0);
      chosen.set(path, new Set(contents.topics[topic].fields.map((f, k) => [f, k]).filter(([f, k]) => !f.texts && k !== contents.topics[topic].time).slice(0, 4).map(([, k]) => `${topic}:${k}`)));
    }
    list(); update(store.state);
    await draw(false);
  });
  const column = async (topic, field) => {
    const key = `${path} ${store.files("record").find((f) => f.path === path)?.stamp} ${topic} ${field}`;
    if (!kept.has(key)) kept.set(key, new Float64Array(await (await get("samples", { path, topic, field })).arrayBuffer()));
    return kept.get(key);
  };
  const draw = async (keep) => {
    const rows = [];
    for (const key of chosen.get(path) ?? []) {
      const [t, f] = key.split(":").map(Number), topic = contents.topics[t], field = topic.fields[f], values = await column(t, f);
      const time = topic.time === null ? Float64Array.from(values, (_, k) => k) : await column(t, topic.time);
      plot.unit = topic.time === null ? "sample" : `${topic.fields[topic.time].name} [${topic.fields[topic.time].unit ?? "s"}]`;
      rows.push({ name: field.name, title: `${topic.name ? `${topic.name}.` : ""}${field.name}${bracketed(field.unit)}`, traces: [{ name: field.name, time, values, colour: "residual" }] });
    }
    if (rows.length) plot.show(rows, keep);
  };
  const list = () => {
    const own = chosen.get(path);
    channels.replaceChildren(...contents.topics.map((topic, t) => {
      const boxes = topic.fields.map((field, f) => (field.texts || f === topic.time ? null : h("label", {}, h("input", { type: "checkbox", checked: own.has(`${t}:${f}`), change: (e) => { e.target.checked ? own.add(`${t}:${f}`) : own.delete(`${t}:${f}`); attempt(() => draw(true)); } }), field.name, h("span.note", {}, field.unit ?? ""))));
      return contents.topics.length === 1 ? h("div", {}, h("p.note", {}, `${topic.rows} samples`), boxes) : h("details", { open: [...own].some((k) => k.startsWith(`${t}:`)) }, h("summary", {}, topic.name, " ", h("span.note", {}, `${topic.rows}`)), boxes);
    }));
  };
  const offer = () => {
    const [from, to] = segment.map((t) => String(Number(t.toPrecision(6))));
    const take = (role) => () => attempt(async () => {
      const t = await table.read(), name = path.replace(/.*\//, "").replace(/\..*$/, ""), count = t.rows.filter((r) => r.file === path && r.from).length;
      // a record of which a segment is chosen is not used as a whole too
      t.rows = [...t.rows.filter((r) => r.file !== path || r.from || r.to), { file: path, run: `${name}_${count + 1}`, role, from, to }];
      await table.write(t);
      tell("# runs.csv:", [path, `${name}_${count + 1}`, role, from, to].join(","));
      segment = plot.segment = null; plot.draw(); segments.replaceChildren();
    });
    segments.replaceChildren(h("span", {}, `Segment ${from} to ${to}`), button("Fit it", take("fit")), button("Validate with it", take("validation")), button("Leave it", () => { segment = plot.segment = null; plot.draw(); segments.replaceChildren(); }));
  };
  const report = (text) => {
    const factor = { ms: 1e-3, us: 1e-6, ns: 1e-9, min: 60, h: 3600 }[contents.topics.find((t) => t.time !== null)?.fields[contents.topics.find((t) => t.time !== null).time].unit] ?? 1;
    const mark = (f, focus) => (f.place ? { from: f.place.from / factor, to: f.place.to / factor, rows: f.channels.includes("t") ? null : f.channels, colour: f.severity === "finding" ? "bad" : "reserved", focus } : null);
    plot.marks = findings.map((f) => mark(f, false)).filter(Boolean);
    plot.draw();
    if (!findings.length) { judged.replaceChildren(h("p", {}, text)); return; }
    const row = (f, k) => h("tr", {}, h("th", { scope: "row", class: f.severity === "finding" ? "large" : "" }, f.fault.replaceAll("_", " ")), h("td", {}, f.channels.join(", ")), h("td.reason", {}, f.what),
      h("td", {}, f.place && button("Show", () => { const m = mark(f, true), wide = Math.max(m.to - m.from, 0.05 * (plot.whole[1] - plot.whole[0])); plot.marks = findings.map((o, i) => mark(o, i === k)).filter(Boolean); plot.move([m.from - wide, m.to + wide]); })),
      h("td", {}, f.repair ? button("Repair", (e) => attempt(async () => { const own = e.target, map = await send("repair", [k]); await store.until((s) => s.project.map === map); own.textContent = `in ${map}`; own.disabled = true; tell("fdm doctor --fix", map, shell(path)); }), { title: f.repair.line }) : ""));
    judged.replaceChildren(h("h2", {}, "What the doctor finds"), h("div.scroll", {}, h("table", {}, h("thead", {}, h("tr", {}, ["fault", "channels", "what it is", "", ""].map((t) => h("th", {}, t)))), h("tbody", {}, findings.map(row)))));
  };
  const update = (state) => {
    const records = store.files("record").filter((f) => f.path !== project().runs && !/^results\//.test(f.path));
    const key = JSON.stringify([records, project(), path, state.files.find((f) => f.path === project().runs)?.stamp]);
    if (files.dataset.key === key) return;
    files.dataset.key = key;
    files.replaceChildren(...records.map((f) => h("li", { class: f.path === path ? "at" : "" }, button(f.path, () => open(f.path), { class: "plain", title: bytes(f.bytes) }),
      choice([["", "–"], ["fit", "fit"], ["validation", "validation"]], role(f.path), (to) => turn(f.path, to), `role of ${f.path}`))));
    if (project().runs) attempt(async () => {
      const t = await table.read();
      runs.replaceChildren(h("h2", {}, "Runs"), h("ul.files", {}, t.rows.map((r, k) => h("li", {}, h("span", {}, `${r.run || r.file}${r.from || r.to ? ` ${r.from || "…"}–${r.to || "…"}` : ""}`), choice([["fit", "fit"], ["validation", "validation"]], r.role || "fit", (to) => attempt(async () => { const now = await table.read(); now.rows[k].role = to; await table.write(now); }), `role of ${r.run || r.file}`),
        button("×", () => attempt(async () => { const now = await table.read(); now.rows.splice(k, 1); await (now.rows.length ? table.write(now) : set("runs")); }), { "aria-label": `take ${r.run || r.file} out`, class: "plain" })))));
    });
    else runs.replaceChildren();
    if (!path && records.length) open((records.find((f) => role(f.path)) ?? records[0]).path);
    else if (path && !contents && records.some((f) => f.path === path)) open(path);
  };
  return { name: "Record", element, update };
};

// ---- 2 model

const KINDS = ["second-order", "kinetics", "short-period", "lateral", "aircraft-6dof", "helicopter-hover", "quadrotor-axis", "ship-mmg", "nomoto", "roll-decay", "servo", "cstr", "batch", "thermal"];

export const model = () => {
  let path = null, over = null, pending = false, stamp = null, told = null, values = {}, at = 0, opening = false;
  const editor = new Editor(() => { pending = true; saved.textContent = "…"; write_now(); check(); });
  const equations = h("div.equations", { "aria-label": "equations", "aria-live": "off" }), list = h("ul#findings.found", { "aria-live": "polite" }), saved = h("span.note"), sliders = h("div.sliders"), faults = h("p.warning");
  const plot = new Plot({ label: "measurement and response", height: 150 });
  const file = choice([], "", (to) => attempt(async () => { await set("model", to); tell("# fdm.toml: model =", JSON.stringify(to)); await open(to); }), "model");
  const runs = choice([], 0, (k) => { at = Number(k); start(); }, "run"), fits = choice([["", "values of …"]], "", (to) => { take(to); fits.value = ""; }, "values of a fit");
  const name = h("input", { type: "text", value: "first.fdm", "aria-label": "name of the new model", size: 12 }), kind = choice(KINDS.map((k) => [k, k]), "second-order", () => {}, "kind");
  const create = (from) => attempt(async () => {
    const before = new Set(store.files("record").map((f) => f.path));
    const done = await run("new", [name.value, from ? `--from=${named(project().data)[0] ?? store.files("record")[0]?.path}` : `--kind=${kind.value}`]);
    if (!done.good) return say(done.text, true);
    await set("model", name.value);
    const state = await read("state"), made = state.files.find((f) => f.kind === "record" && !before.has(f.path));
    if (made && !project().data.length && !project().runs) await set("data", made.path);
    fresh.open = false;
    store.put(await read("state"));
    await open(name.value);
  });
  const fresh = h("details.new", {}, h("summary", {}, "New"), h("div.tools", {}, name, kind, button("By kind", () => create(false)), button("From the record", () => create(true))));
  const element = h("section.view.model-view", {},
    h("div.text", {}, h("div.tools", {}, file, fresh, saved), editor.element, list),
    h("div.beside", {}, h("h2", {}, "Equations"), equations),
    h("div.response", {}, h("div.tools", {}, h("h2", {}, "Response"), runs, h("span.note", {}, h("span.key", {}, h("span.swatch.measured"), "measured"), " ", h("span.key", {}, h("span.swatch.model"), "model"))), faults, plot.element),
    h("div.parameters", {}, h("div.tools", {}, h("h2", {}, "Parameters"), fits, button("Into the text", () => write()), button("Back", () => { values = {}; start(); })), sliders));
  const tell = teller(element);

  const open = (to) => attempt(async () => {
    const now = await read("text", { path: to });
    [path, over, pending, values] = [to, now.fingerprint, false, {}];
    stamp = store.files("model").find((f) => f.path === to)?.stamp;
    editor.value = now.text;
    saved.textContent = "saved";
    tell("fdm check", shell(to));
    check();
    if (store.state) update();
  });
  const write_now = latest(async () => {
    if (!pending || !path) return;
    const text = editor.value;
    try {
      over = await send("text", { path, text, over });
      if (editor.value === text) { pending = false; saved.textContent = "saved"; }
      later();
    } catch (e) {
      saved.replaceChildren(h("span.warning", {}, e.message), " ", button("take the other", () => { pending = false; open(path); }), button("keep this", async () => { over = (await read("text", { path })).fingerprint; write_now(); }));
    }
  });
  const later = calm(300, () => start());
  const check = calm(120, latest(async () => {
    const { findings, equations: set } = await send("check", { path, text: editor.value });
    editor.find(findings);
    list.replaceChildren(...editor.findings.slice(0, 8).map((f) => h("li", { class: f.error ? "bad" : "reserved" }, button(`line ${f.line}: ${f.message}`, () => editor.go(f.from), { class: "plain", title: f.code }))));
    // MathML of the server, which escapes what names say
    if (set !== null) equations.innerHTML = set;
  }));
  const start = latest(async () => {
    if (!path || !(project().data.length || project().runs) || project().model !== path) { sliders.replaceChildren(h("p.note", {}, project().model === path ? "Choose a record: its response is drawn here." : "This is not the model of the project.")); return; }
    const answer = await post("simulate", { run: at, set: Object.entries(values), measured: true }).catch((e) => {
      // mistakes of the text stand below it
      faults.textContent = editor.findings.some((f) => f.error) ? "" : e.message;
    });
    if (!answer) return;
    told = unpack(await answer.arrayBuffer());
    options(runs, told.runs.map((r, k) => [k, r]), at);
    runs.hidden = told.runs.length < 2;
    show(told, false);
    move();
    settle();
  });
  const show = (now, keep) => {
    const of = (kind, all) => all.columns.filter((c) => c.kind === kind), time = of("time", told)[0].values;
    faults.textContent = now.faults.join("; ");
    plot.unit = `time [${told.time}]`;
    const measured = of("measured", told), inputs = of("input", told);
    const rows = of("model", now).map((c, k) => ({ name: c.name, title: `${c.name}${bracketed(c.unit)}`, traces: [(measured[k].trace ??= { name: "measured", time, values: measured[k].values, colour: "measured", wide: 2.6 }), { name: "model", time, values: c.values, colour: "model", aside: false }] }));
    rows.push(...inputs.map((c) => ({ name: c.name, title: `${c.name}${bracketed(c.unit)}`, traces: [(c.trace ??= { name: c.name, time, values: c.values, colour: "input" })] })));
    plot.height = rows.length > 2 ? 110 : 190;
    plot.show(rows, keep || plot.whole?.[1] === time[time.length - 1]);
    for (const row of plot.rows) for (const [k, t] of row.traces.entries()) if (t.name === "measured") measured.find((m) => m.name === row.name).trace = t; else if (!k && t.name === row.name) inputs.find((i) => i.name === row.name).trace = t;
  };
  // what is drawn while a slider moves is right to a pixel; where it comes to rest the numbers of the command follow, which may take longer
  const respond = async (exact) => {
    const set = Object.entries(values), asked = JSON.stringify([at, set]);
    const answer = await post("simulate", { run: at, set, exact }).catch((e) => { faults.textContent = e.message; });
    if (answer && (!exact || JSON.stringify([at, Object.entries(values)]) === asked)) show(unpack(await answer.arrayBuffer()), true);
    if (exact) tell("fdm simulate", ...set.map(([n, v]) => shell(`--set=${n}=${v}`)));
  };
  const follow = latest(() => respond(false));
  const settle = latest(() => respond(true));
  const move = () => {
    sliders.replaceChildren(...[...told.params].sort((a, b) => a.fixed - b.fixed).map((p) => {
      const now = () => values[p.name] ?? p.value;
      const reach = Math.abs(now()) || (p.upper !== null && p.lower !== null ? (p.upper - p.lower) / 4 : 1);
      const low = Math.max(p.lower ?? -Infinity, now() - 2 * reach), high = Math.min(p.upper ?? Infinity, now() + 2 * reach);
      const change = (value, exact) => { values[p.name] = value; number.value = String(Number(value.toPrecision(6))); slider.value = value; follow(); if (exact) settle(); };
      const slider = h("input", { type: "range", min: String(low), max: String(high), step: "any", "aria-label": `${p.name}${p.unit ? ` in ${p.unit}` : ""}`, input: () => change(Number(slider.value), false), change: () => change(Number(slider.value), true),
        keydown: (e) => { const by = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[e.key]; if (by) { e.preventDefault(); change(Math.min(high, Math.max(low, now() + by * (high - low) / 200)), true); } } });
      slider.value = now();
      const number = h("input", { type: "text", inputMode: "decimal", value: String(Number(now().toPrecision(6))), "aria-label": p.name, change: () => { const v = Number(number.value); if (Number.isFinite(v)) change(v, true); } });
      return h("label.slider", { title: p.doc }, h("code", {}, p.name), slider, number, h("span.note", {}, unit(p.unit), p.fixed ? " fixed" : "", p.per_run ? " per run" : ""));
    }));
  };
  const take = (from) => {
    const seen = store.state.results.find((r) => r.path === from);
    for (const p of seen?.parameters ?? []) if (told?.params.some((own) => own.name === p.name) && (!p.run || p.run === told.runs[at])) values[p.name] = p.value;
    start();
  };
  const write = () => {
    let text = editor.value;
    for (const [n, v] of Object.entries(values)) {
      const own = n.replace(/[.*+?^${}()|[\]\\]/g, "\\$&").replace(/\\\(0\\\)$/, "");
      text = text.replace(new RegExp(`((?:param|,)\\s*${own}\\s*=\\s*)[-+]?(?:\\d+\\.?\\d*|\\.\\d+)(?:[eE][-+]?\\d+)?`), `$1${Number(v.toPrecision(6))}`);
    }
    editor.replace(text);
    values = {};
  };
  const update = () => {
    const models = store.files("model").filter((f) => !/^results\//.test(f.path));
    options(file, models.map((f) => [f.path, f.path]), path ?? project().model ?? "");
    options(fits, [["", "values of …"], ...store.state.results.filter((r) => r.parameters.length).map((r) => [r.path, r.path])], "");
    if (!models.length !== update.none) fresh.open = update.none = !models.length;
    const now = models.find((f) => f.path === path);
    const wanted = project().model ?? models[0]?.path;
    if (!path) {
      // what it shows follows once it is open
      if (wanted && !opening && models.some((f) => f.path === wanted)) { opening = true; if (!project().model) attempt(() => set("model", wanted)); open(wanted).finally(() => { opening = false; }); }
      return;
    }
    // another window or another program has written it
    if (now && now.stamp !== stamp && !pending) { stamp = now.stamp; attempt(async () => { const before = over, text = await read("text", { path }); if (!pending && over === before && text.fingerprint !== over) await open(path); }); }
    const key = JSON.stringify([project(), path, now?.stamp, store.files("record").map((f) => f.stamp)]);
    if (key !== update.key) { update.key = key; start(); }
  };
  return { name: "Model", element, update, editor: () => ({ editor, path, over, open }) };
};

// Buttons for work: one that begins it, one that stops it, and how far it is.
const worker = (label, verb, asked, ended) => {
  let id = null, costs = [];
  const text = h("p.doing", { role: "status" }), numbers = h("p.note"), curve = h("canvas.curve", { width: 260, height: 56, "aria-hidden": "true" });
  const begin = button(label, () => attempt(async () => {
    costs = []; end.hidden = false; begin.disabled = true; text.textContent = "…"; numbers.textContent = "";
    try { id = await work(verb, asked(), seen); } catch (e) { end.hidden = true; begin.disabled = false; text.textContent = ""; throw e; }
  }), { class: "first" });
  const end = button("Stop, keep the best", () => stop(id), { hidden: true });
  const seen = (job) => {
    if (job.cost !== null && costs.at(-1)?.[0] !== job.iteration) { if (job.iteration < costs.at(-1)?.[0]) costs = []; costs.push([job.iteration, job.cost]); }
    text.textContent = job.ended ? (job.ended.kept ? `${job.place}, ${job.ended.took}` : job.ended.text) : `${job.stopped ? "stopping: " : ""}${job.doing}`;
    text.classList.toggle("warning", Boolean(job.ended && !job.ended.kept));
    numbers.textContent = job.ended ? "" : job.values.slice(0, 8).map(([n, v]) => `${n} ${shown(v, 4)}`).join("   ");
    draw();
    if (job.ended) { end.hidden = true; begin.disabled = false; ended(job); }
  };
  const draw = () => {
    const g = curve.getContext("2d"), all = costs.map(([, c]) => c), low = Math.min(...all), high = Math.max(...all);
    g.clearRect(0, 0, 260, 56);
    curve.hidden = all.length < 2;
    g.strokeStyle = getComputedStyle(document.documentElement).getPropertyValue("--model"); g.lineWidth = 2; g.beginPath();
    all.forEach((c, k) => g.lineTo(4 + k / Math.max(1, all.length - 1) * 252, 52 - (c - low) / (high - low || 1) * 48));
    g.stroke();
  };
  curve.hidden = true;
  return { begin, end, said: h("div.progress", {}, curve, h("div", {}, text, numbers)) };
};

// ---- 3 fit

// Of a fit in a line, and of its validation in another.
const errors = (all, what) => all.length ? h("p.note", {}, `${what}RMS ${all.slice(0, 4).map((e) => `${e.output}${all.some((o) => o.run !== e.run) ? ` (${e.run})` : ""} ${shown(e.rms, 3)} ${unit(e.unit)}`).join(", ")}${all.length > 4 ? ", …" : ""}`) : "";

export const fit = (models) => {
  let own = null;
  const compared = new Set();
  const method = choice([["", "output error"], ["--method=filter-error", "filter error"], ["--method=equation-error", "equation error"], ["--domain=frequency", "frequency domain"], ["--method=frequency-response", "frequency responses"]], "", () => {}, "method");
  const starts = h("input", { type: "number", min: "1", max: "1000", value: "1" }), limit = h("input", { type: "text", placeholder: "none", size: 5 }), more = h("input", { type: "text", placeholder: "--noise full …", size: 22 });
  const asked = () => [method.value, Number(starts.value) > 1 ? `--starts=${starts.value}` : "", limit.value ? `--time-limit=${limit.value}` : "", ...words(more.value)].filter(Boolean);
  const at = worker("Fit", "fit", asked, (job) => { if (job.ended.kept) { own = job.place; update(store.state); } });
  const list = h("ol.history"), page = frame("the fit"), compare = button("Compare the two", () => attempt(async () => {
    const done = await run("compare", [...compared, "--report=results/comparison.html"]);
    if (store.state.files.some((f) => f.path === "results/comparison.html") || done.text.includes("RMS") || done.good) { own = null; point(page, `page?path=results/comparison.html&at=${Date.now()}`); } else say(done.text, true);
  }), { disabled: true });
  const element = h("section.view.fit-view", {}, h("div.tools", {}, at.begin, at.end, h("label", {}, "method ", method), h("label", {}, "starts ", starts), h("label", {}, "time limit ", limit), h("label", {}, "more options ", more)), at.said,
    h("aside", {}, h("div.tools", {}, h("h2", {}, "History"), compare), list), page);
  const tell = teller(element);
  const update = (state) => {
    const fits = state.results.filter((r) => r.kind !== "diagnosis" && r.parameters.length);
    own = fits.some((r) => r.path === own) ? own : page.dataset.at?.startsWith("page") ? own : fits[0]?.path;
    const text = models.editor().over, key = JSON.stringify([fits.map((r) => [r.path, r.stamp]), own, text]);
    if (list.dataset.key === key) return;
    list.dataset.key = key;
    list.replaceChildren(...fits.map((r, k) => {
      const before = fits[k + 1], changed = before && details(`changed since ${before.path.replace(/.*\//, "")}`);
      changed?.addEventListener("toggle", () => attempt(async () => {
        const c = await read("changes", { then: before.path, now: r.path });
        changed.replaceChildren(changed.firstChild, c.model ? diff(c.model) : "", ...c.others.map((o) => h("p.note", {}, o)), c.model || c.others.length ? "" : h("p.note", {}, "nothing"));
      }), { once: true });
      return h("li", { class: r.path === own ? "at" : "" }, h("div.tools", {}, h("input", { type: "checkbox", "aria-label": `compare ${r.path}`, checked: compared.has(r.path), change: (e) => { e.target.checked ? compared.add(r.path) : compared.delete(r.path); compare.disabled = compared.size !== 2; } }), button(r.path.replace(/^results\//, ""), () => { own = r.path; update(store.state); }, { class: "plain" })),
        [false, true].map((validation) => errors(r.errors.filter((e) => e.validation === validation), validation ? "validation " : "")), h("p.says", {}, r.says), changed, text && r.text !== text ? back(models, r) : "");
    }));
    const seen = fits.find((r) => r.path === own);
    if (seen) { point(page, result(seen)); tell(...(seen.command.length ? seen.command.map((w, k) => (k ? shell(w) : "fdm")) : ["fdm fit"])); }
    page.hidden = !page.dataset.at;
  };
  return { name: "Fit", element, update };
};

// ---- 4 what is missing

export const missing = (models) => {
  let own = null;
  const limit = h("input", { type: "text", value: "60s", size: 5 }), more = h("input", { type: "text", placeholder: "--only input_delay …", size: 22 });
  const at = worker("Find what is missing", "diagnose", () => [limit.value ? `--time-limit=${limit.value}` : "", ...words(more.value)].filter(Boolean), (job) => { if (job.ended.kept) { own = job.place; update(store.state); } });
  const planned = next(), found = choice([], "", (to) => { own = to; update(store.state); }, "diagnosis"), card = h("div.card", { "aria-live": "polite" }), page = frame("the diagnosis"), undo = h("div.tools", {});
  const element = h("section.view.missing-view", {}, h("div.tools", {}, at.begin, at.end, h("label", {}, "time limit ", limit), h("label", {}, "more options ", more), found, planned.begin), at.said, planned.element, undo, card, page);
  const tell = teller(element);
  const accept = (what, words) => attempt(async () => {
    const { path, over, open } = models.editor();
    await send("accept", { path, over, ...what });
    tell(...words);
    await open(path);
    say("written into the model: fit it");
  });
  // Models with one cause each, fitted, and the manoeuvre after which their fits differ most.
  const separate = (c) => attempt(async () => {
    const fits = [];
    for (const rival of [c, c.group[0]]) {
      const text = `${own}-${rival.effect}-${rival.targets.join("-")}.fdm`.replace(/[^\w./-]/g, "_");
      if (!store.files("model").some((f) => f.path === text)) {
        const done = await run("extend", [`${own}/model.fdm`, `--effect=${place(rival)}`, `--write=${text}`]);
        if (!done.good) return say(done.text, true);
      }
      say(`fitting ${place(rival)}`);
      const job = await ended("fit", [text]);
      if (!job.ended.kept) return say(job.ended.text, true);
      fits.push(job.place);
    }
    say("");
    planned.design([`--between=${fits.join(",")}`, "--runs=1"]);
  });
  const place = (c) => `${c.effect}(${c.targets.join(", ")})`;
  const show = async (seen) => {
    const d = JSON.parse(await (await get("document", { path: seen.path, name: "diagnosis.json" })).text());
    const text = d.causes.length ? await get("document", { path: seen.path, name: "extended.diff" }).then((a) => a.text()).catch(() => null) : null;
    card.replaceChildren(h("h2", {}, seen.says),
      h("div.causes", {}, d.causes.map((c) => h("article", {}, h("h3", {}, c.doc), h("p", {}, h("code", {}, place(c))), h("p", {}, c.parameters.map((p) => `${p.name} = ${shown(p.value)}${p.standard_error ? ` ± ${shown(p.standard_error, 2)}` : ""} ${unit(p.unit)}`).join(", ")),
        h("p.note", {}, `${c.group.length ? `probability ${shown(c.probability, 2)}; ` : ""}without it alone ${shown(c.loss, 4)} nats are lost`),
        c.group.length ? h("p.note", {}, `These records cannot tell it from ${c.group.map((o) => `${place(o)} (${shown(o.probability, 2)})`).join(", ")}.`) : "",
        h("div.tools", {}, button("Accept this alone", () => accept({ effect: place(c) }, ["fdm extend", shell(models.editor().path), `--effect=${shell(place(c))}`])),
          c.group.length ? button("Design the experiment that tells them apart", () => separate(c), { title: c.separating_experiment }) : "")))),
      d.outputs.length ? h("div.scroll", {}, h("table", {}, h("thead", {}, h("tr", {}, ["run", "output", "RMS before", "after", "noise"].map((t) => h("th", {}, t)))), h("tbody", {}, d.outputs.map((o) => h("tr", {}, h("th", { scope: "row" }, `${o.run}${o.validation ? " (validation)" : ""}`), h("td", {}, `${o.output}${bracketed(o.unit)}`), h("td.number", {}, shown(o.rms_before, 3)), h("td.number", {}, shown(o.rms_after, 3)), h("td.number", {}, shown(o.noise_level, 3))))))) : "",
      ...(text ? [h("div.tools", {}, button("Accept all of it", () => accept({ result: seen.path }, ["fdm diagnose --write", shell(models.editor().path)]), { class: "first" }), h("span.note", {}, "the text with its estimates, as a difference:")), diff(text)] : []));
  };
  const update = (state) => {
    const all = state.results.filter((r) => r.kind === "diagnosis");
    own = all.some((r) => r.path === own) ? own : all[0]?.path;
    options(found, all.map((r) => [r.path, r.path.replace(/^results\//, "")]), own);
    found.hidden = !all.length;
    planned.update(state);
    const seen = all.find((r) => r.path === own), key = seen && `${seen.path} ${seen.stamp}`, text = models.editor().over;
    if (undo.dataset.key !== `${key} ${text}`) {
      undo.dataset.key = `${key} ${text}`;
      undo.replaceChildren(...(seen && text && seen.text !== text ? [h("span", {}, "The model has changed since this diagnosis."), back(models, seen, "Undo")] : []));
    }
    if (key === card.dataset.key) return;
    card.dataset.key = key ?? "";
    page.hidden = !seen;
    if (!seen) return card.replaceChildren();
    point(page, result(seen));
    attempt(() => show(seen));
  };
  return { name: "What is missing", element, update };
};

// The next run: a manoeuvre, drawn, as a table to be flown.
const next = () => {
  let file = null;
  const plot = new Plot({ label: "next run", height: 110 }), said = h("pre", {}), line = h("p.doing", { role: "status" });
  const save = button("Save the manoeuvre", () => attempt(async () => {
    const { text } = await read("text", { path: file }), link = h("a", { href: URL.createObjectURL(new Blob([text], { type: "text/csv" })), download: file.replace(/^results\//, "").replaceAll("/", "-") });
    link.click();
    URL.revokeObjectURL(link.href);
  }));
  const shownRun = h("div", { hidden: true }, h("div.tools", {}, h("h2", {}, "The next run"), save), plot.element, details("in figures", said));
  const design = (words) => attempt(async () => {
    line.textContent = "comparing manoeuvres …";
    const job = await ended("design", words);
    line.textContent = job.ended.kept ? `${job.place}, ${job.ended.took}` : "";
    if (!job.ended.kept) return say(job.ended.text, true);
    said.textContent = job.ended.text;
    await draw(`${job.place}/run_1.csv`);
  });
  const draw = async (path) => {
    const [topic] = (await read("record", { path })).topics, values = async (field) => new Float64Array(await (await get("samples", { path, topic: 0, field })).arrayBuffer());
    const time = await values(topic.time), rows = [];
    for (const [k, field] of topic.fields.entries()) if (k !== topic.time) rows.push({ name: field.name, title: `${field.name}${bracketed(field.unit)}`, traces: [{ name: field.name, time, values: await values(k), colour: "input", held: true }] });
    plot.unit = `t [${topic.fields[topic.time].unit ?? "s"}]`;
    file = path; shownRun.hidden = false;
    plot.show(rows);
  };
  const begin = button("Design the next run", () => attempt(async () => {
    // a result alone says neither how long a run is nor how far inputs may move
    const fitted = store.state.results.find((r) => r.parameters.length && r.kind !== "diagnosis").path, files = new Set((await table.read()).rows.filter((r) => r.role !== "validation").map((r) => r.file));
    await design([`--from-result=${fitted}`, ...[...files].map((f) => `--data=${f}`), ...(project().map ? [`--map-file=${project().map}`] : []), "--runs=1"]);
  }), { title: "The manoeuvre that reduces the errors of the newest fit most" });
  return { begin, design, element: h("div", {}, line, shownRun), update: (state) => { begin.disabled = !state.results.some((r) => r.parameters.length && r.kind !== "diagnosis"); } };
};

// ---- 5 report

export const report = () => {
  let own = null, wanted = null;
  const of = choice([], "", (to) => { wanted = to; update(store.state); }, "result"), said = h("pre", { "aria-live": "polite", hidden: true }), page = frame("the report");
  const give = (verb, words) => attempt(async () => { const done = await run(verb, words()); said.hidden = false; said.textContent = done.text || "written"; say(done.good ? "written into the folder" : "not written", !done.good); });
  const name = () => own.replace(/.*\//, "");
  const to = (kind, ending, ...more) => button(kind, () => give("export", () => [`--from-result=${own}`, `--to=${ending.split(".")[0]}`, ...more, `--output=${name()}.${ending.split(".")[1]}`]));
  const element = h("section.view.report-view", {}, h("div.tools", {}, of, button("Write the page", () => give("report", () => [own]), { class: "first" }), h("span.note", {}, "for other tools:"), to("FMU", "fmu.fmu"), to("C", "c.c"), to("Rust", "rust.rs"), to("JSBSim", "jsbsim.xml"), to("state space", "control.json")), said, page);
  const update = (state) => {
    own = state.results.some((r) => r.path === wanted) ? wanted : (state.results.find((r) => r.parameters.length) ?? state.results[0])?.path;
    options(of, state.results.map((r) => [r.path, `${r.path.replace(/^results\//, "")}: ${r.kind}`]), own);
    const seen = state.results.find((r) => r.path === own);
    page.hidden = !seen;
    if (seen) point(page, result(seen));
    // a diagnosis has no estimates to hand on
    for (const b of element.querySelectorAll(".tools button")) b.disabled = !seen || (b.className !== "first" && !seen.parameters.length);
  };
  return { name: "Report", element, update };
};
