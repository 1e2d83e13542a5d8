"""Asks `fdm diagnose` for the cases of the second blind set and prints one table; misses follow, one a line.

    python3 studies/world/score.py CASES ANSWERS [--fdm target/release/fdm] [--apart] [--limit 100] [--both]

CASES is the folder that cases.py made, ANSWERS keeps what the command said: a folder for each build. One process at a time.
"""

import argparse
import hashlib
import json
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from asking import answer
from noises import Noise

ROOT = Path(__file__).resolve().parents[2]
STEADY = ("constant", "output_bias", "input_bias", "drift")
NOTHING = ("no_effect_found", "no_missing_effect_detected")
LAW = ("unmodelled_law", "law", "unmodelled_nonlinearity")


def matches(right, cause):
    """Whether a cause has one of the names of a truth."""
    return any(r["effect"] == cause["effect"] and set(r["targets"]) <= set(cause["targets"]) for r in right)


def grouped(right, cause):
    return any(matches(right, member) for member in [cause, *cause.get("group", [])])


def said(d):
    """A diagnosis in one line."""
    if d is None:
        return "no answer"
    causes = []
    for c in d.get("causes", []):
        others = [f"{m['effect']}({', '.join(m['targets'])})" for m in c.get("group", [])]
        causes.append(f"{c['effect']}({', '.join(c['targets'])}) {c['loss']:.0f}" + (f" [or {', '.join(others[:4])}]" if others else ""))
    sites = sites_of(d)
    site = f", site {sites[0]['name']}" if d["verdict"] in ("disturbance", "law") and sites else ""
    return f"{d['verdict']}{site} ({d['explanations'][0]['probability']:.2f}): " + ("; ".join(causes) or "-")


def sites_of(d):
    """Places of what has no name, the likeliest first."""
    law = d["verdict"] == "law"
    return [u for u in d.get("unnamed", []) if bool(u["signal"]) == law]


def straight(d):
    """Whether the faults of a diagnosis are but inputs that were taken for held: motion.py has them straight between samples."""
    faults = (d.get("mended") or {}).get("faults", [])
    return bool(faults) and all(f["fault"] == "hold" and "straight lines between samples, where" in f["what"] for f in faults)


def named(d):
    """Verdict and causes, to compare two answers."""
    return d and (d["verdict"], [(c["effect"], c["targets"]) for c in d["causes"]])


def nats(noise, deviation, residual):
    """Half the sum of squares of a residual in its noise."""
    return 0.5 * float(np.sum(noise.whiten(residual[:, None], deviation) ** 2))


class Case:
    def __init__(self, folder):
        self.folder = folder
        self.truth = json.loads((folder / "truth.json").read_text())
        self.runs = [folder / f"run_{k + 1}.csv" for k in range(self.truth["runs"])]
        self.validation = [folder / "validation.csv"] * self.truth["validation"]

    def table(self, path):
        lines = path.read_text().splitlines()
        head = [h.split("[")[0].strip() for h in lines[0].split(",")]
        values = np.array([[float(c) for c in row.split(",")] for row in lines[1:]])
        return {h: values[:, j] for j, h in enumerate(head)}

    def noises(self, n):
        """The noise of every output, as the case was made with."""
        truth = self.truth
        return [Noise(truth["colour"], n, o["size"], o["numbers"]) for o in truth["noise"].values()]


def judge(case, found):
    """All that the table counts of one case."""
    truth, d = case.truth, found["diagnosis"]
    row = {"case": truth["case"], "truth": truth, "said": said(d), "seconds": found["seconds"], "answered": d is not None}
    causes = d["causes"] if d else []
    right = truth["right"]
    row["effect"] = bool(d) and d["verdict"] == "effect_found"
    row["straight"] = bool(d) and d["verdict"] == "record_fault" and straight(d)
    row["detected"] = bool(d) and d["verdict"] not in NOTHING and not row["straight"]
    row["first"] = bool(causes) and len(right) == 1 and matches(right[0], causes[0])
    row["group"] = bool(causes) and all(any(grouped(r, c) for c in causes) for r in right) and bool(right)
    row["alone"] = row["group"] and len(causes) == len(right)
    row["size"] = float(np.mean([len(c.get("group", [c])) for c in causes])) if causes else None
    if truth["kind"] == "pair":
        taken = [{k for k, c in enumerate(causes) if grouped(r, c)} for r in right]
        row["group"] = all(taken) and len(set.union(*taken)) >= 2
    words = json.dumps(d.get("unnamed")) if d else ""
    if truth["kind"] == "outside":
        kind, place = truth["hidden"][0]["kind"], truth["hidden"][0]["place"]
        sites = [s["name"] for s in sites_of(d)] if d else []
        row["place"] = bool(sites) and place in sites[:1]
        if kind == "gust":
            row["group"] = bool(d) and d["verdict"] == "disturbance"
        else:
            told = any(w in words for w in ("unmodelled nonlinearity", "unmodelled law"))
            row["group"] = bool(d) and d["verdict"] != "disturbance" and (d["verdict"] in LAW or told)
        row["first"] = row["group"] and row["place"]
    # what is printed beside what the written text does
    outputs = d["outputs"] if d else []
    names = list(truth["noise"])
    held = [o for o in outputs if o["validation"] and o["rms_after"] is not None]
    level = {name: noise["size"] for name, noise in truth["noise"].items()}
    if held and causes:
        before = sum((o["rms_before"] / level[o["output"]]) ** 2 for o in held)
        after = sum((o["rms_after"] / level[o["output"]]) ** 2 for o in held)
        row["worse"] = after > before * 1.002
        row["ratio"] = float(np.sqrt(after / before))
    if causes and "does" in found:
        refit = found["refit"]
        row["refit"] = refit["code"] == 0 and refit["termination"] == "converged"
        row["refit_how"] = f"code {refit['code']}, {refit['termination']}, {refit['seconds']:.0f} s"
        off = []
        runs = [p.stem for p in [*case.runs, *case.validation]]
        for path, does in zip([*case.runs, *case.validation], found["does"]):
            record = case.table(path)
            for o in outputs:
                if o["run"] == path.stem and o["rms_after"] is not None:
                    if not does or o["output"] not in does:
                        off.append((np.inf, path.stem, o["output"]))
                        continue
                    rms = float(np.sqrt(np.mean((record[o["output"]] - np.array(does[o["output"]])) ** 2)))
                    off.append((abs(rms / o["rms_after"] - 1), path.stem, o["output"], o["rms_after"], rms))
        row["off"] = max(off)[0] if off else None
        row["off_at"] = max(off)[1:] if off else None
        # where initial states are estimated again, weights of outputs differ a little
        row["differs"] = bool(off) and row["off"] > (0.02 if truth["free"] else 0.005)
        if truth["validation"] and truth["gain_validation"] and truth["gain_validation"] > 3:
            record, does = case.table(case.validation[0]), found["does"][-1]
            clean = np.load(case.folder / "clean.npy")[:, :, truth["runs"]]
            cost = np.inf
            if does:
                cost = 0
                for o, (name, noise) in enumerate(zip(names, case.noises(len(clean)))):
                    cost += nats(noise, noise.deviations(clean[:, o]), record[name] - np.array(does[name]))
            row["gained"] = (truth["cost_naive_validation"] - cost) / truth["gain_validation"]
    elif truth["validation"] and truth["gain_validation"] and truth["gain_validation"] > 3 and truth["kind"] in ("single", "pair"):
        row["gained"] = 0.0
    return row


def share(rows, key):
    rows = [r for r in rows if r.get(key) is not None]
    return f"{np.mean([bool(r[key]) for r in rows]):.2f} ({sum(bool(r[key]) for r in rows)} of {len(rows)})" if rows else "-"


def table(rows):
    """The table in Markdown."""
    single = [r for r in rows if r["truth"]["kind"] == "single"]
    strong = [r for r in single if r["truth"]["gain"] >= 15]
    weak = [r for r in single if r["truth"]["gain"] < 15]
    steady = [r for r in single if r["truth"]["hidden"][0]["kind"] in STEADY]
    nothing = [r for r in rows if r["truth"]["kind"] == "nothing"]
    pairs = [r for r in rows if r["truth"]["kind"] == "pair"]
    outside = [r for r in rows if r["truth"]["kind"] == "outside"]
    laws = [r for r in outside if r["truth"]["hidden"][0]["kind"] != "gust"]
    gusts = [r for r in outside if r["truth"]["hidden"][0]["kind"] == "gust"]
    gained = [r["gained"] for r in rows if r.get("gained") is not None]
    worse = [r for r in rows if r.get("worse") is not None]
    lines = ["| | figure | wanted |", "|---|---|---|"]
    lines.append(f"| gain above 15: named first | {share(strong, 'first')} | 0.93 |")
    lines.append(f"| gain above 15: in the group | {share(strong, 'group')} | 0.97 |")
    lines.append(f"| gain above 15: in the group and nothing else named | {share(strong, 'alone')} | |")
    sizes = [r["size"] for r in strong if r["group"] and r["size"]]
    lines.append(f"| gain above 15: detected; mean group | {share(strong, 'detected')}; {np.mean(sizes) if sizes else float('nan'):.2f} | |")
    lines.append(f"| gain 5 to 15: in the group | {share(weak, 'group')} | 0.75 |")
    lines.append(f"| constant forces, offsets, drifts: above 15, in the group | {share([r for r in steady if r in strong], 'group')} | 0.90 |")
    lines.append(f"| constant forces, offsets, drifts: above 15, named first | {share([r for r in steady if r in strong], 'first')} | |")
    lines.append(f"| nothing hidden: another verdict | {share(nothing, 'detected')} | 0.06 |")
    lines.append(f"| nothing hidden: inputs that were taken for held told to be straight, as they are | {share(nothing, 'straight')} | |")
    lines.append(f"| pairs: both | {share(pairs, 'group')} | 0.90 |")
    lines.append(f"| outside the catalogue: law | {share(laws, 'group')} | 0.90 |")
    lines.append(f"| gusts: disturbance; at the right place | {share(gusts, 'group')}; {share(gusts, 'first')} | 0.90 |")
    if gained:
        low = float(np.quantile(gained, 0.05, method="lower"))
        lines.append(f"| validation gain over the truth's: median, 5 % quantile | {np.median(gained):.2f}, {low:.2f} ({len(gained)}) | 1.00, 0.95 |")
    lines.append(f"| printed validation RMS worse than the naive one | {sum(r['worse'] for r in worse)} of {len(worse)} | 0 |")
    off = [r for r in rows if r.get("differs") is not None]
    lines.append(f"| printed RMS is not that of the written text (0.5 %; 2 % with free initial states) | {sum(r['differs'] for r in off)} of {len(off)} | 0 |")
    refit = [r for r in rows if r.get("refit") is not None]
    lines.append(f"| refit of the written text fails or takes more than 60 s | {sum(not r['refit'] for r in refit)} of {len(refit)} | 0 |")
    seconds = [r["seconds"] for r in rows]
    lines.append(f"| no answer within 60 s of processor time | {sum(not r['answered'] for r in rows)} of {len(rows)} | 0 |")
    lines.append(f"| seconds of processor time: median, 95 %, most | {np.median(seconds):.1f}, {np.quantile(seconds, 0.95):.1f}, {max(seconds):.1f} | |")
    for title, of in (("family", lambda r: r["truth"]["family"]), ("noise", lambda r: r["truth"]["colour"]),
                      ("start", lambda r: r["truth"]["start"]), ("form", lambda r: "Newton" if r["truth"]["newton"] else "der"),
                      ("hidden", lambda r: r["truth"]["hidden"][0]["kind"])):
        lines += ["", f"| {title} | gain above 15: first | in the group | gain 5 to 15: in the group |", "|---|---|---|---|"]
        for value in sorted({of(r) for r in single}):
            a, b = [r for r in strong if of(r) == value], [r for r in weak if of(r) == value]
            lines.append(f"| {value} | {share(a, 'first')} | {share(a, 'group')} | {share(b, 'group')} |")
    return lines


def misses(rows):
    """Every miss in one line: the case, the truth, what was said."""
    lines = []
    for r in rows:
        truth = r["truth"]
        hidden = "; ".join(f"{h['kind']}({h['place']}{', ' + h['other'] if h['other'] else ''})" for h in truth["hidden"]) or "nothing"
        gain = "" if truth["gain"] is None else f" {truth['gain']:.0f} nats"
        near = truth.get("rivals", {})
        close = f"; nearest {min(near, key=near.get)} lacks {min(near.values()):.1f}" if near else ""
        about = f"`{r['case']}` {hidden}{gain}, {truth['colour']}, {truth['start']}, {truth['runs']}+{truth['validation']} runs{close}"
        wrong = []
        if not r["answered"]:
            wrong.append("no answer")
        if truth["kind"] == "nothing" and r["detected"]:
            wrong.append("false alarm")
        if truth["kind"] == "single" and not r["group"]:
            wrong.append("not in the group" + ("" if truth["gain"] >= 15 else " (weak)"))
        elif truth["kind"] == "single" and not r["first"] and truth["gain"] >= 15:
            wrong.append("not first")
        if truth["kind"] in ("pair", "outside") and not r["group"]:
            wrong.append("missed")
        if r.get("worse"):
            wrong.append(f"validation RMS worse ({r['ratio']:.2f} x)")
        if r.get("differs"):
            wrong.append(f"printed RMS off by {100 * r['off']:.1f} % at {r['off_at']}")
        if r.get("refit") is False:
            wrong.append("refit: " + r["refit_how"])
        if r.get("gained") is not None and r["gained"] < 0.5 and r["group"]:
            wrong.append(f"gains {r['gained']:.2f} of the truth on validation")
        if wrong:
            lines.append(f"- {', '.join(wrong)}: {about} -> {r['said']}")
    return lines


def build_of(command):
    return hashlib.sha256(Path(command).read_bytes()).hexdigest()[:12]


def ask(work):
    command, folder, kept, other = work
    case = Case(folder)
    model = folder / ("other_form.fdm" if other else "model.fdm")
    return answer(command, model, case.runs, case.validation, kept / (folder.name + ("-other" if other else "")))


def main():
    given = argparse.ArgumentParser()
    given.add_argument("cases", type=Path)
    given.add_argument("answers", type=Path)
    given.add_argument("--fdm", default=str(ROOT / "target" / "release" / "fdm"))
    given.add_argument("--apart", action="store_true", help="the families kept apart, and only these")
    given.add_argument("--only", default="", help="cases whose names contain one of these texts, with commas between them")
    given.add_argument("--limit", type=int, default=10**9)
    given.add_argument("--both", action="store_true", help="ask for the other form of each text too, and compare")
    given.add_argument("--table", action="store_true", help="of what has been answered")
    asked = given.parse_args()
    kept = asked.answers / build_of(asked.fdm)
    folders = sorted(p.parent for p in asked.cases.glob("*/truth.json"))
    folders = [f for f in folders if json.loads((f / "truth.json").read_text())["apart"] == asked.apart]
    folders = [f for f in folders if any(w in f.name for w in asked.only.split(","))]
    # by number, so that a part of the cases has all families
    folders = sorted(folders, key=lambda f: (int(f.name.rsplit("-", 1)[1]), f.name))[: asked.limit]
    if asked.table:
        folders = [f for f in folders if (kept / f.name / "answer.json").exists()]
    with ProcessPoolExecutor(int(os.environ.get("FDM_PROCESSES", "1"))) as pool:
        answers = list(pool.map(ask, [(asked.fdm, f, kept, False) for f in folders]))
        others = list(pool.map(ask, [(asked.fdm, f, kept, True) for f in folders])) if asked.both else []
    rows = [judge(Case(f), a) for f, a in zip(folders, answers)]
    print(f"{len(rows)} cases, build {kept.name}\n")
    print("\n".join(table(rows)))
    if others:
        apart = [
            (r["case"], r["said"], said(o["diagnosis"]))
            for r, a, o in zip(rows, answers, others) if named(a["diagnosis"]) != named(o["diagnosis"])
        ]
        print(f"\nThe other form of the text is answered otherwise in {len(apart)} of {len(others)}:\n")
        print("\n".join(f"- `{c}`: {a} || {b}" for c, a, b in apart))
    print("\n## Misses\n")
    print("\n".join(misses(rows)))


if __name__ == "__main__":
    main()
