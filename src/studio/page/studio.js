// The application: steps, theme, and what the server tells.

import { command, listen, say, store } from "./ask.js";
import { fit, missing, model, record, report } from "./views.js";

const models = model();
const views = [record(), models, fit(models), missing(models), report()];
const steps = document.getElementById("steps"), main = document.getElementById("view");
const go = (k) => {
  views.forEach((v, i) => { v.element.hidden = i !== k; steps.children[i].setAttribute("aria-current", i === k ? "step" : "false"); });
  command(views[k].element.said ?? "fdm studio");
  history.replaceState(null, "", `#${k + 1}`);
  store.state && views[k].update(store.state);
};
views.forEach((view, k) => {
  const step = document.createElement("button");
  step.type = "button";
  step.innerHTML = `<b>${k + 1}</b>`;
  step.append(view.name);
  step.title = `Alt+${k + 1}`;
  step.addEventListener("click", () => go(k));
  steps.append(step);
  main.append(view.element);
});
addEventListener("keydown", (e) => { if (e.altKey && e.key >= "1" && e.key <= "5") { e.preventDefault(); go(Number(e.key) - 1); views[Number(e.key) - 1].element.querySelector("button, textarea, select")?.focus(); } });

document.getElementById("theme").addEventListener("click", () => {
  const root = document.documentElement, dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
  for (const frame of document.querySelectorAll("iframe")) if (frame.contentDocument) frame.contentDocument.documentElement.dataset.theme = root.dataset.theme;
  dispatchEvent(new Event("theme"));
});
document.getElementById("copy").addEventListener("click", () => navigator.clipboard?.writeText(document.getElementById("command").textContent).then(() => say("copied"), () => say("the browser does not let it be copied", true)));
// whatever goes wrong in the page is said
addEventListener("unhandledrejection", (e) => say(String(e.reason?.message ?? e.reason), true));
store.on((state) => {
  document.title = `${state.name} · fdm studio`;
  document.getElementById("name").textContent = state.name;
  if (state.project.wrong) say(`fdm.toml: ${state.project.wrong}`, true);
  views.forEach((v) => v.update(state));
});
go(Math.min(4, Math.max(0, (Number(location.hash.slice(1)) || 1) - 1)));
listen();
