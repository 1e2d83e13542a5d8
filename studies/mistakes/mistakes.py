"""Thirty mistakes of newcomers, and what `fdm` says of each: where it is, what was expected, and the nearest fix.

    python3 studies/mistakes/mistakes.py target/release/fdm [results.csv]

A mistake has three patterns: the place (file, line, column, channel, option), what is wrong or was expected, and a fix that works. Each that the message holds is a point;
an exit code that says that all is well, where the command could not do what was meant, is none at all. The patterns were written before the messages were looked at, and are
words that a person would look for; two places were widened afterwards, where two channels determine only together that one of them is wrong. What counts are the sentences that the one command prints, not its tables; a fix may be to ask `fdm doctor`, where that then says what is
wrong.

`files` and `options` are mistakes that must be refused (exit code 2). `data` are records that `fit` can fit and should not be believed: it must say so.
"""
import csv
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROLL = """model roll "roll of an aircraft" {
  input da "aileron" [deg];
  state p "roll rate" [deg/s] = 0, phi "bank" [deg] = 0;
  param Lp = -2 in [-50, 0] [1/s], Lda = 3 in [0, 50] [1/s^2];
  der(p) = Lp*p + Lda*da;
  der(phi) = p;
  output p_m [deg/s] = p, phi_m [deg] = phi;
}
"""
DT = 0.02


def flight(seed, seconds=20.0, lp=-3.0, lda=12.0, cubic=0.0, delay=0.0, start=(0.0, 0.0)):
    """Times, aileron, roll rate and bank angle: steps and doublets, held between samples."""
    rng = np.random.default_rng(seed)
    n = int(seconds / DT)
    t = DT * np.arange(n)
    da = np.zeros(n)
    for begin, sign in ((1, 1), (2, -1), (5, -1), (6.5, 1), (9, 1), (9.6, -1), (13, -1), (14, 1), (17, 1), (17.5, -1)):
        da[(t >= begin) & (t < begin + 0.9)] += sign * (3 + rng.random())
    late = np.interp(t - delay, t, da)
    p, phi = np.zeros(n), np.zeros(n)
    p[0], phi[0] = start
    for k in range(1, n):
        x, y = p[k - 1], phi[k - 1]
        for _ in range(20):
            x, y = x + DT / 20 * (lp * x + cubic * x**3 + lda * late[k - 1]), y + DT / 20 * x
        p[k], phi[k] = x, y
    return t, da, p + 0.1 * rng.standard_normal(n), phi + 0.1 * rng.standard_normal(n)


def table(t, da, p, phi, head="t [s],da [deg],p_m [deg/s],phi_m [deg]"):
    return head + "\n" + "".join(f"{a:.4f},{b:.4f},{c:.5f},{d:.5f}\n" for a, b, c, d in zip(t, da, p, phi))


T, DA, P, PHI = flight(1)
GOOD = table(T, DA, P, PHI)


def broken(change):
    """The record with lines changed."""
    lines = GOOD.splitlines()
    change(lines)
    return "\n".join(lines) + "\n"


def cell(row, column, text):
    def change(lines):
        cells = lines[row].split(",")
        cells[column] = text
        lines[row] = ",".join(cells)
    return broken(change)


def with_rows(change):
    columns = [T.copy(), DA.copy(), P.copy(), PHI.copy()]
    columns = change(*columns) or columns
    return table(*columns)


FIT = ["fit", "roll.fdm", "run.csv"]
# name, content of run.csv, command, patterns of place, expectation and fix
FILES = [
    ("text in a column of numbers", cell(40, 2, "lost"), FIT, [r"line 41|p_m", r"expected a number", r"--missing lost|leave .*empty"]),
    ("decimal comma between commas", GOOD.replace("deg/s]", "deg/s]", 1).replace(",3.", ",3,"), FIT, [r"line \d+", r"cells|columns", r"header|separat|decimal|semicolon"]),
    ("a unit of another kind", GOOD.replace("da [deg]", "da [m]"), FIT, [r"\bda\b", r"\bdeg\b", r"--map|header|declare|input"]),
    ("a channel that is not there", GOOD.replace("phi_m", "bank"), FIT, [r"phi_m", r"bank", r"--map \"?phi_m=|--without-output phi_m"]),
    ("time that falls", broken(lambda lines: lines.insert(60, lines.pop(20))), FIT, [r"line \d+", r"rise|later", r"split|--from|--runs-by|sort"]),
    ("an empty file", "", FIT, [r"run\.csv", r"empty|no rows|header|nothing", r"header|name \[unit\]|t \[s\]|rows|write"]),
    ("the model in the place of the record", ROLL, FIT, [r"run\.csv", r"model|\.fdm|table", r"record|CSV|behind the model|fdm fit"]),
    ("a time with dots of thousands", broken(lambda lines: lines.__setitem__(slice(1, None), ["1." + line.replace(".", ".", 1) for line in lines[1:]])), FIT, [r"line \d+|column `?t", r"number|time", r"missing|separat|write|unit"]),
    ("no time column", "\n".join(line.split(",", 1)[1] for line in GOOD.splitlines()) + "\n", FIT, [r"time|`t`", r"da \[deg\]|da|column", r"--rate|--map"]),
]
OPTIONS = [
    ("an option misspelt", GOOD, [*FIT, "--metod", "filter-error"], [r"--metod", r"--method", r"--method"]),
    ("a method misspelt", GOOD, [*FIT, "--method", "filter"], [r"--method", r"filter-error", r"output-error|filter-error"]),
    ("a parameter that is not there", GOOD, [*FIT, "--fix", "Lpp"], [r"Lpp", r"parameter|param", r"Lp\b"]),
    ("a value without a name", GOOD, [*FIT, "--set", "3"], [r"--set", r"NAME=VALUE", r"NAME=VALUE|Lp=|name"]),
    ("words in the wrong order", GOOD, ["fit", "run.csv", "roll.fdm", "--zoh"], [r"--zoh", r"INPUT|input|value", r"INPUT|da|--zoh <"]),
    ("an output that is held", GOOD, [*FIT, "--zoh", "p_m"], [r"p_m", r"output", r"input|da"]),
    ("a window beyond the record", GOOD, [*FIT, "--from", "100"], [r"--from|100|window|selected", r"19\.98|0 to|to 19", r"--from|--to|choose|from 0"]),
    ("options of two methods", GOOD, [*FIT, "--method", "equation-error", "--starts", "5"], [r"--starts", r"equation-error|equation error", r"leave|output-error|output error|without"]),
    ("a verb misspelt", GOOD, ["fitt", "roll.fdm", "run.csv"], [r"fitt", r"\bfit\b", r"\bfit\b"]),
]
SURE = r"does not explain|against the model|not explained|against|doubt"
DATA = [
    ("sign of the input", with_rows(lambda t, da, p, phi: [t, -da, p, phi]), [r"\bda\b|\bLda\b|p_m|phi_m", r"sign|turned|-1\b|against|mirror|negative", r"sign = -1|sign|bound"]),
    ("a rate in rad/s that says deg/s", with_rows(lambda t, da, p, phi: [t, da, np.radians(p), phi]), [r"p_m|phi_m", r"57\.3|rad/s|rad|scale|unit", r"rad/s|scale|57\.3"]),
    ("columns swapped", with_rows(lambda t, da, p, phi: [t, da, phi, p]), [r"p_m|phi_m", r"swap|exchang|interchang|each other|in place of|column", r"--map|swap"]),
    ("an output late by 0.4 s", with_rows(lambda t, da, p, phi: [t, da, p, np.interp(t - 0.4, t, phi)]), [r"phi_m", r"late|delay|0\.4", r"delay"]),
    ("mirror image", with_rows(lambda t, da, p, phi: [t, da, -p, phi]), [r"p_m", r"sign|turned|-1\b|against|mirror", r"sign|-1\b"]),
    ("another vehicle: unstable in roll angle", table(*[*(flight(2)[:2]), *[np.cumsum(np.random.default_rng(9).standard_normal(T.size)) for _ in range(2)]]), [r"p_m|phi_m", SURE, r"diagnose|model"]),
    ("time in milliseconds that says seconds", table(1000 * T, DA, P, PHI), [r"time|\bt\b", r"1000|milli|\bms\b|sixt|unit of time|bound|lower bound|fast", r"\bms\b|unit|--map"]),
    ("the input of another flight", with_rows(lambda t, da, p, phi: [t, flight(7)[1][::-1], p, phi]), [r"p_m|phi_m", SURE, r"diagnose|the input|another run"]),
    ("bank with an offset of 100 deg", with_rows(lambda t, da, p, phi: [t, da, p, phi + 100]), [r"phi", r"initial|offset|bias|free", r"= free|free|bias|offset"]),
    ("a bank sensor that is stuck from the middle on", with_rows(lambda t, da, p, phi: [t, da, p, np.where(t > 9, phi[450], phi)]), [r"phi_m", r"stuck|constant|does not change|same value", r"--to|mask|without|empty"]),
    ("angles in rad that say deg", with_rows(lambda t, da, p, phi: [t, da, p, np.radians(phi)]), [r"p_m|phi_m", r"57\.3|rad\b|scale|unit", r"rad|scale|57\.3"]),
    ("a record that begins under way", table(*flight(3, start=(40.0, 30.0))), [r"\bp\b|\bphi\b|initial", r"initial|begin|stated", r"free"]),
]


def run(fdm, folder, content, command):
    (folder / "roll.fdm").write_text(ROLL)
    (folder / "run.csv").write_text(content)
    done = subprocess.run([fdm, *command], cwd=folder, capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout + "\n" + done.stderr


def sentences(said):
    """What was printed, in one line, without the rows of tables: those of three numbers and more."""
    number = re.compile(r"^-?[\d.]+(e[-+]?\d+)?!?$")
    rows = [line for line in said.splitlines() if sum(bool(number.match(word)) for word in line.split()) < 3]
    return " ".join(" ".join(rows).split())


def judge(fdm, folder, out):
    code, said = run(fdm, folder, GOOD, FIT)
    assert code == 0, said
    rows, worst = [], []
    for kind, mistakes in (("files", FILES), ("options", OPTIONS), ("data", [(n, c, FIT, p) for n, c, p in DATA])):
        for name, content, command, patterns in mistakes:
            code, said = run(fdm, folder, content, command)
            flat = sentences(said) if kind == "data" else " ".join(said.split())
            held = [bool(re.search(pattern, flat)) for pattern in patterns]
            if kind == "data" and not held[2] and "fdm doctor" in flat:
                _, doctor = run(fdm, folder, content, ["doctor", "roll.fdm", "run.csv"])
                held[2] = bool(re.search(patterns[1], sentences(doctor)))
            # where nothing is said of the mistake, a name of the channel is no place of it
            told = kind != "data" or held[1]
            points = sum(held) if told and (kind == "data" or code == 2) else 0
            rows.append((kind, name, code, points))
            if points < 3:
                lacks = [what for what, has in zip(("place", "what", "fix"), held) if not has]
                worst.append(f"{kind}: {name} ({points}, exit {code}, lacks {' '.join(lacks) or 'nothing'})\n    " + "\n    ".join(said.strip().splitlines()[:14]))
    print("\n".join(worst))
    for kind in ("files", "options", "data"):
        own = [row[3] for row in rows if row[0] == kind]
        print(f"{kind}: {sum(own) / len(own):.2f} of 3 over {len(own)}")
    if out:
        with open(out, "w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([("kind", "mistake", "exit", "points"), *rows])


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        judge(str(Path(sys.argv[1]).resolve()), Path(place), sys.argv[2] if len(sys.argv) > 2 else None)
