// The editor of a model: a text area over its own coloured text, with findings, completion and hover. Undo is the browser's own.

import { calm, h, latest, send } from "./ask.js";

const WORDS = new Set("model input state param const let output time prior noise trim tie reactions table use as effect in fixed held per run group known free if then else and or not log when limit smooth process der".split(" "));
const TOKEN = /(\/\/[^\n]*|\/\*[\s\S]*?(?:\*\/|$))|("(?:[^"\\\n]|\\.)*"?)|(\[[^\]\n]*\]?)|(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+)|([A-Za-z_\u0370-\u03ff][\w\u0370-\u03ff.]*)|(\s+|[\s\S])/g;
const escaped = (text) => text.replace(/[&<>]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[c]);
const coloured = (text) => text.replace(TOKEN, (all, comment, string, unit, digits, word) => {
  const kind = comment ? "comment" : string ? "string" : unit ? "unit" : digits ? "digits" : word && WORDS.has(word) ? "word" : null;
  return kind ? `<span class="${kind}">${escaped(all)}</span>` : escaped(all);
});

export class Editor {
  constructor(changed) {
    this.changed = changed; this.findings = []; this.items = []; this.at = 0;
    this.area = h("textarea", { spellcheck: false, autocapitalize: "off", autocomplete: "off", wrap: "off", "aria-label": "text of the model", "aria-describedby": "findings" });
    this.paint = h("pre.paint", { "aria-hidden": "true" });
    this.marks = h("pre.marks", { "aria-hidden": "true" });
    this.lines = h("pre.lines", { "aria-hidden": "true" });
    this.list = h("ul.complete", { role: "listbox", id: "complete", hidden: true });
    this.tip = h("div.tip", { role: "tooltip", hidden: true });
    this.inner = h("div.inner", {}, this.marks, this.paint, this.area, this.list, this.tip);
    this.element = h("div.editor", {}, this.lines, this.inner);
    this.area.addEventListener("input", (e) => { this.show(); this.changed(this.area.value); if (/[\w[]$/.test(e.data ?? "")) this.complete(); else this.close(); });
    this.area.addEventListener("keydown", (e) => this.key(e));
    this.area.addEventListener("blur", () => setTimeout(() => this.close(), 150));
    this.area.addEventListener("mousemove", (e) => this.hover(e));
    this.area.addEventListener("mouseleave", () => { this.tip.hidden = true; });
    this.hover = calm(250, (e) => this.explain(e));
    this.complete = latest(() => this.ask());
  }

  get value() { return this.area.value; }
  set value(text) {
    if (text === this.area.value) return;
    const [a, b] = [this.area.selectionStart, this.area.selectionEnd];
    this.area.value = text;
    this.area.setSelectionRange(Math.min(a, text.length), Math.min(b, text.length));
    this.show();
  }
  // Puts a text in the place of all, so that the browser can undo it.
  replace(text) {
    this.area.focus();
    this.area.select();
    if (!document.execCommand("insertText", false, text)) { this.value = text; this.changed(text); }
    this.show();
  }

  show() {
    const text = this.area.value;
    this.paint.innerHTML = `${coloured(text)}\n`;
    const wrong = new Map(this.findings.map((f) => [f.line, f.error]));
    this.lines.replaceChildren(...text.split("\n").map((_, k) => h(`span${wrong.has(k + 1) ? (wrong.get(k + 1) ? ".bad" : ".reserved") : ""}`, {}, `${k + 1}\n`)));
    this.underline();
  }

  underline() {
    const text = this.area.value;
    let at = 0, html = "";
    for (const f of [...this.findings].sort((a, b) => a.from - b.from)) {
      if (f.from < at || f.from > text.length) continue;
      const end = Math.max(f.to, f.from + 1);
      html += `${escaped(text.slice(at, f.from))}<u class="${f.error ? "bad" : "reserved"}">${escaped(text.slice(f.from, end)) || " "}</u>`;
      at = end;
    }
    this.marks.innerHTML = `${html}${escaped(text.slice(at))}\n`;
  }

  find(findings) { this.findings = findings.map((f) => ({ ...f, line: f.place[0][0] + 1, from: this.offset(f.place[0]), to: this.offset(f.place[1]) })); this.show(); }
  // Units of a text area for a line and a column.
  offset([line, character]) { return this.area.value.split("\n").slice(0, line).reduce((sum, row) => sum + row.length + 1, 0) + character; }
  go(at) { this.area.focus(); this.area.setSelectionRange(at, at); this.element.scrollTop = Math.max(0, (this.place(at).line - 4) * this.metrics().line); }

  place(offset) {
    const before = this.area.value.slice(0, offset), line = before.split("\n").length - 1;
    return { line, character: offset - (before.lastIndexOf("\n") + 1) };
  }
  metrics() {
    const probe = h("span", {}, "0".repeat(40));
    this.paint.append(probe);
    const box = probe.getBoundingClientRect();
    probe.remove();
    return { letter: box.width / 40, line: parseFloat(getComputedStyle(this.paint).lineHeight) };
  }

  async ask() {
    const offset = this.area.selectionStart, place = this.place(offset);
    const all = await send("suggestions", { text: this.area.value, place: [place.line, place.character] }).catch(() => []);
    if (this.area.selectionStart !== offset) return;
    const begun = this.area.value.slice(0, offset).match(/[\w]*$/)[0];
    this.items = all.filter((i) => i.label.toLowerCase().startsWith(begun.toLowerCase()) && i.label !== begun).slice(0, 12);
    this.begun = begun; this.at = 0;
    this.list.replaceChildren(...this.items.map((item, k) => h("li", { role: "option", id: `complete-${k}`, title: item.declared ?? "", mousedown: (e) => { e.preventDefault(); this.at = k; this.take(); } }, h("b", {}, item.label), h("span", {}, item.detail ?? ""))));
    const { letter, line } = this.metrics();
    this.list.style.left = `${(place.character - begun.length) * letter}px`;
    this.list.style.top = `${(place.line + 1) * line + 8}px`;
    this.list.hidden = this.items.length === 0;
    this.choose(0);
  }
  choose(k) {
    this.at = (k + this.items.length) % Math.max(1, this.items.length);
    [...this.list.children].forEach((li, i) => li.setAttribute("aria-selected", i === this.at));
    this.list.children[this.at]?.scrollIntoView({ block: "nearest" });
    this.area.setAttribute("aria-activedescendant", this.list.hidden ? "" : `complete-${this.at}`);
  }
  take() {
    const item = this.items[this.at], end = this.area.selectionStart;
    if (!item) return;
    const text = item.called ? `${item.label}()` : item.label;
    this.area.setSelectionRange(end - this.begun.length, end);
    document.execCommand("insertText", false, text);
    if (item.called) this.area.setSelectionRange(this.area.selectionStart - 1, this.area.selectionStart - 1);
    this.close();
  }
  close() { this.list.hidden = true; this.area.removeAttribute("aria-activedescendant"); }

  key(e) {
    if (!this.list.hidden) {
      const keys = { ArrowDown: () => this.choose(this.at + 1), ArrowUp: () => this.choose(this.at - 1), Enter: () => this.take(), Tab: () => this.take(), Escape: () => this.close() };
      if (keys[e.key]) { e.preventDefault(); e.stopPropagation(); keys[e.key](); return; }
    }
    if (e.key === " " && e.ctrlKey) { e.preventDefault(); this.complete(); }
  }

  // What stands under the mouse: a finding, or a name.
  async explain(e) {
    const { letter, line } = this.metrics(), box = this.paint.getBoundingClientRect();
    const place = { line: Math.floor((e.clientY - box.top - 8) / line), character: Math.floor((e.clientX - box.left) / letter) };
    const rows = this.area.value.split("\n"), row = rows[place.line];
    if (row === undefined || place.character >= row.length || !this.area.matches(":hover")) { this.tip.hidden = true; return; }
    const offset = this.offset([place.line, place.character]), finding = this.findings.find((f) => f.from <= offset && offset < Math.max(f.to, f.from + 1));
    let text = finding?.message;
    if (!text && /\w/.test(row[place.character])) {
      const found = await send("explained", { text: this.area.value, place: [place.line, place.character] }).catch(() => null);
      text = found?.replace(/```\w*\n?|\*\*|`/g, "").replace(/\n{2,}/g, "\n").trim();
    }
    this.tip.hidden = !text;
    this.tip.textContent = text ?? "";
    this.tip.style.left = `${place.character * letter}px`;
    this.tip.style.top = `${(place.line + 1) * line + 10}px`;
  }
}
