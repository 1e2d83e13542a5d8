// What all views share: requests, the state that the server tells, elements, and the command that does the same.

// An element: "div.card#id", attributes (functions are listeners), children.
export const h = (what, attributes = {}, ...children) => {
  const [, tag, rest] = what.match(/^([a-z0-9]*)(.*)$/);
  const element = document.createElement(tag || "div");
  for (const part of rest.match(/[.#][^.#]+/g) ?? []) part[0] === "." ? element.classList.add(part.slice(1)) : element.id = part.slice(1);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (name in element && typeof value !== "string") element[name] = value;
    else if (value !== null && value !== undefined && value !== false) element.setAttribute(name, value);
  }
  element.append(...children.flat().filter((c) => c !== null && c !== undefined && c !== false));
  return element;
};

export class Refused extends Error {
  constructor(status, said) { super(said); this.status = status; }
}

const answered = async (answer) => {
  if (answer.ok) return answer;
  throw new Refused(answer.status, (await answer.text()).trim());
};
const query = (parts) => Object.entries(parts).map(([k, v]) => `${k}=${encodeURIComponent(v)}`).join("&");
export const get = async (path, parts = {}) => answered(await fetch(`${path}?${query(parts)}`));
export const read = async (path, parts) => (await get(path, parts)).json();
export const post = async (path, body) => answered(await fetch(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) }));
export const send = async (path, body) => (await post(path, body)).json();
export const drop = async (file) => answered(await fetch(`drop?${query({ name: file.name })}`, { method: "POST", body: file }));

// A document and the numbers behind it.
export const unpack = (buffer) => {
  const length = new DataView(buffer).getUint32(0, true);
  const told = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let at = 4 + length;
  for (const column of told.columns) {
    column.values = new Float64Array(buffer, at, column.length);
    at += 8 * column.length;
  }
  return told;
};

// The command that does the same as the last click.
export const command = (...words) => { document.getElementById("command").textContent = words.join(" "); };
// The command of a view, which is shown while the view is.
export const teller = (element) => (...words) => { element.said = words.join(" "); if (!element.hidden) command(element.said); };
export const shell = (word) => (/^[\w\-./=,:+@%]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);

let told = null;
export const say = (text, bad = false) => {
  const status = document.getElementById("status");
  status.textContent = text;
  status.classList.toggle("warning", bad);
  clearTimeout(told);
  if (!bad) told = setTimeout(() => { status.textContent = ""; }, 6000);
};
// Does something, and says why it could not be done.
export const attempt = async (work) => {
  try { return await work(); } catch (e) { say(e instanceof Refused ? e.message : `fdm studio is not reached: ${e.message}`, true); }
};

// Number, as many digits as an engineer reads.
export const shown = (value, digits = 5) => {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value), text = size !== 0 && (size >= 1e6 || size < 1e-4) ? value.toExponential(digits - 1).replace(/\.?0+e/, "e") : String(Number(value.toPrecision(digits)));
  return text.replace("-", "−");
};
// A unit; none of pure numbers.
export const unit = (of) => (of && of !== "1" ? of : "");
export const bracketed = (of) => (unit(of) ? ` [${of}]` : "");
export const bytes = (count) => (count < 1e4 ? `${count} B` : count < 1e7 ? `${Math.round(count / 1e3)} kB` : `${Math.round(count / 1e6)} MB`);

// What runs in the folder, by role, of the project file or of its table of runs.
export const store = {
  state: null, heard: [],
  on(f) { this.heard.push(f); if (this.state) f(this.state); },
  put(state) { this.state = state; for (const f of this.heard) f(state); },
  // once the folder is seen as a click made it: the next one goes on from there
  until(holds) {
    return new Promise((done) => this.on(function seen(state) {
      if (!holds(state)) return;
      store.heard = store.heard.filter((f) => f !== seen);
      done();
    }));
  },
  files(kind) { return (this.state?.files ?? []).filter((f) => f.kind === kind); },
  job(id) { return this.state?.jobs.find((j) => j.id === id); },
};
export const listen = () => {
  const events = new EventSource("events");
  events.onmessage = (e) => { document.body.classList.remove("lost"); store.put(JSON.parse(e.data)); };
  events.onerror = () => { document.body.classList.add("lost"); say("fdm studio has ended or does not answer; files are safe in the folder", true); };
};

// Begins work and follows it: `seen` hears of it until it has ended.
export const work = async (verb, words, seen) => {
  const id = await send("work", { verb, words });
  store.on(function follow() {
    const job = store.job(id);
    if (!job) return;
    command(job.command);
    seen(job);
    if (job.ended) store.heard = store.heard.filter((f) => f !== follow);
  });
  return id;
};
// Work that is waited for.
export const ended = (verb, words) => new Promise((done, failed) => { work(verb, words, (job) => { if (job.ended) done(job); }).catch(failed); });
export const stop = (id) => attempt(() => post("stop", id));
export const run = async (verb, words) => {
  const done = await send("command", { verb, words });
  command(done.command);
  return done;
};
// A later call takes the place of an earlier one that waits.
export const calm = (wait, f) => { let timer; return (...all) => { clearTimeout(timer); timer = setTimeout(() => f(...all), wait); }; };
// One call at a time; the last that came meanwhile follows.
export const latest = (f) => {
  let busy = false, next = null;
  const go = async (...all) => {
    if (busy) { next = all; return; }
    busy = true;
    try { await f(...all); } finally { busy = false; if (next) { const again = next; next = null; go(...again); } }
  };
  return go;
};
