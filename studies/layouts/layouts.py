"""Files as loggers and laboratories write them: does `fdm fit` read each rightly, at once or with the one option that its message names?

    python3 studies/layouts/layouts.py target/release/fdm [results.csv] [further|fresh]

Two records are simulated here, a first-order lag under a command that is held, and an oral dose; each is written in every layout, and the estimates of each
file are compared with those of the plain file. A file that is refused gets the option that the message names, nothing else: a person who follows the
message. `further` and `fresh` write layouts that were gathered from manuals of loggers after the readers were finished (`further.py`, `fresh.py`). HDF5 wants h5py, XLSX
openpyxl; where they are missing, these layouts are left out and told.
"""
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

LAG = """model lag "first order lag" {
  input u [V];
  state x = free [1];
  param K = 1 in [-20, 20] [1/V], T = 0.5 in [0.0001, 1e6] [s];
  der(x) = (K*u - x)/T;
  output y [1] = x;
}
"""
ORAL = """model oral "one compartment, oral dose of 320 mg at time 0" {
  time [h];
  state depot [mg] = 320, amount [mg] = 0;
  param ka = 1 in [0, 20] [1/h], V = 30 in [1, 200] [L], CL = 3 in [0, 50] [L/h];
  der(depot) = -ka*depot;
  der(amount) = ka*depot - CL/V*amount;
  output conc [mg/L] = amount/V;
}
"""
MODELS = {"lag": (LAG, ["K", "T"]), "oral": (ORAL, ["ka", "V", "CL"])}
RATE = 50.0


def lag(n=200):
    """Times, command and output of the lag, as a logger rounds them."""
    rng = np.random.default_rng(60)
    t = np.arange(n) / RATE
    u = 1.0 + 0.5 * np.sign(np.sin(2.1 * t)) * (t > 0.4)
    x = np.zeros(n)
    decay = np.exp(-1 / RATE / 0.25)
    for k in range(1, n):
        x[k] = 1.8 * u[k - 1] + decay * (x[k - 1] - 1.8 * u[k - 1])
    return t, np.round(u, 4), np.round(x + 0.02 * rng.standard_normal(n), 5)


def oral():
    """Times in hours and concentrations after a dose."""
    rng = np.random.default_rng(61)
    t = np.array([0, 0.25, 0.5, 1, 2, 3.5, 5, 7, 9, 12, 24])
    ka, v, cl = 1.5, 33, 2.8
    c = 320 * ka / v / (ka - cl / v) * (np.exp(-cl / v * t) - np.exp(-ka * t))
    return t, np.round(c * (1 + 0.03 * rng.standard_normal(t.size)), 4)


def rows(columns, separator=",", form="{:.5f}", end="\n"):
    cell = lambda v: v if isinstance(v, str) else "" if v is None or v != v else form.format(v) if isinstance(v, float) else str(v)
    return "".join(separator.join(cell(v) for v in row) + end for row in zip(*columns))


def floats(a):
    return [float(v) for v in a]


class Layouts:
    """Each method writes one file into a folder and gives: file, model, map of channels that the names ask for."""

    def __init__(self, folder):
        self.folder = folder

    def text(self, name, text, encoding="utf-8"):
        path = self.folder / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
        return path


def layouts(folder):
    """Name, file, model and the channels that a person maps because they have other names in the file."""
    put = Layouts(folder).text
    t, u, y = (floats(a) for a in lag())
    h, c = (floats(a) for a in oral())
    c0 = [None] + c[1:]
    n = len(t)
    ms = [int(round(1532 + 1000 * v)) for v in t]
    since = 1_790_000_000
    stamp = lambda v: f"2026-09-21 14:{13 + int(v + 20) // 60:02d}:{(v + 20) % 60:06.3f}"
    clock = lambda v: f"14:{13 + int(v + 20) // 60:02d}:{(v + 20) % 60:06.3f}"
    yield "CSV with units", put("plain.csv", "t [s],u [V],y [1]\n" + rows([t, u, y])), "lag", {}
    yield "semicolons and decimal commas", put("de.csv", "t [s];u [V];y [1]\n" + rows([t, u, y], ";").replace(".", ",")), "lag", {}
    yield "tabulators", put("tab.txt", "time\tu\ty\n" + rows([t, u, y], "\t")), "lag", {}
    yield "aligned by spaces", put("a.dat", "     t         u         y\n" + rows([t, u, y], " ", "{:10.5f}")), "lag", {}
    yield "header behind #", put("h.dat", "# lag of a heater\n# t u y\n" + rows([t, u, y], " ")), "lag", {}
    words = ["base"] * n
    yield "header behind % beside text cells", put("ros.csv", "%time,field.header.frame_id,field.u,field.y\n"
                                                   + rows([[str(int((since + v) * 1e9)) for v in t], words, u, y])), "lag", {"u": "field.u", "y": "field.y"}
    yield "trailing separators, CRLF, byte order mark", put("tr.csv", "\ufeff\"time\",\"u\",\"y\",\r\n" + rows([t, u, y, [""] * n], end="\r\n")), "lag", {}
    yield "time_ms", put("ms.csv", "time_ms,u,y\n" + rows([ms, u, y])), "lag", {}
    yield "timestamp in microseconds since boot", put("px4.csv", "timestamp,u,y\n" + rows([[1000 * v for v in ms], u, y])), "lag", {}
    yield "milliseconds since 1970", put("e3.csv", "time,u,y\n" + rows([[since * 1000 + v for v in ms], u, y])), "lag", {}
    yield "nanoseconds since 1970", put("e9.csv", "Time,u,y\n" + rows([[since * 10**9 + v * 10**6 for v in ms], u, y])), "lag", {}
    yield "settings above the header", put("bb.csv", '"Product","recorder"\n"firmwareType","3"\n"rollPID","45,80,40"\n"looptime","125"\n"time","u","y"\n'
                                           + rows([t, u, y])), "lag", {}
    quoted = "".join(f'"{a:.3f}","{b:.4f}","{d:.5f}"\n' for a, b, d in zip(t, u, y))
    yield "quoted, Latin-1, row of units below a blank line", put(
        "race.csv", '"Format","Race CSV",,,"Book","a"\n"Place","pad"\n"Sample Rate","50.000","Hz"\n"Duration","4.0","s"\n\n"Time","u","y","Temp"\n"s","V","1","°C"\n\n'
        + quoted.replace("\n", ',"20.1"\n'), "latin-1"), "lag", {}
    yield "lines of a serial monitor", put("serial.txt", "Starting...\nSensor connection successful\nmillis\tu\ty\n" + rows([ms, u, y], "\t")), "lag", {}
    yield "row of units in brackets", put("ub.csv", "time,u,y\n[s],[V],[-]\n" + rows([t, u, y])), "lag", {}
    yield "row of bare units", put("uu.csv", "time,u,y\nms,mV,-\n" + rows([floats(ms), [1000 * v for v in u], y])), "lag", {}
    yield "station: four lines of header", put(
        "toa5.dat", '"TOA5","st","CR1000","1","os","prog","7","Table1"\n"TIMESTAMP","RECORD","u","y"\n"TS","RN","Volts",""\n"","","Smp","Smp"\n'
        + rows([[f'"{stamp(v)}"' for v in t], list(range(n)), u, y])), "lag", {}
    yield "flight deck: units, names, date and clock", put(
        "g1000.csv", '#airframe_info, log_version="1.03"\n#yyy-mm-dd, hh:mm:ss, hh:mm,  volt, 1\n  Lcl Date, Lcl Time, UTCOfst, u, y\n'
        + rows([["2026-09-21"] * n, [" " + clock(v) for v in t], ["-08:00"] * n, u, y])), "lag", {}
    yield "clock with format words", put("cl.csv", "Time (hh:mm:ss),u (V),y\n" + rows([[clock(v) for v in t], u, y])), "lag", {}
    yield "plot title, zones and serial numbers in names", put(
        "hobo.csv", '"Plot Title: lag"\n"#","Date Time, GMT-05:00","u, V (LGR S/N: 9, SEN S/N: 9)","y (LGR S/N: 9)"\n'
        + rows([list(range(1, n + 1)), ["09/21/26 02:" + stamp(v)[14:] + " PM" for v in t], u, y])), "lag", {"u": "u, V (LGR S/N: 9, SEN S/N: 9)", "y": "y (LGR S/N: 9)"}
    yield "UTF-16", put("u16.txt", ("time\tu\ty\r\n" + rows([t, u, y], "\t", end="\r\n")), "utf-16"), "lag", {}
    sparse = "".join(f"{a:.6f},{b:.4f},,\n{a:.6f},,{d:.5f},\n" for a, b, d in zip(t, u, y))
    yield "one value a row, columns apart", put("wide.csv", "Timestamp,/drive/voltage,/drive/velocity,state\n0.000000,,,forward\n" + sparse), "lag", {
        "u": "/drive/voltage", "y": "/drive/velocity"}
    long = "".join(f"{a:.6f},u,{b:.4f}\n{a:.6f},y,{d:.5f}\n" for a, b, d in zip(t, u, y))
    yield "time, name, value", put("long.csv", "time,signal,value\n" + long), "lag", {}
    yield "no column for the time", put("nt.csv", "u,y\n" + rows([u, y])), "lag", {}
    yield "rows counted", put("count.csv", "sample,u,y\n" + rows([list(range(n)), u, y])), "lag", {}
    yield "signals in rows", put("lying.csv", "".join(name + "," + ",".join(f"{v:.5f}" for v in row) + "\n" for name, row in [("t", t), ("u", u), ("y", y)])), "lag", {}
    objects = [{"time": a, "u": b, "y": d} for a, b, d in zip(t, u, y)]
    yield "JSON: array of objects", put("a.json", json.dumps(objects)), "lag", {}
    yield "JSON: object of arrays", put("o.json", json.dumps({"t": t, "u": u, "y": y})), "lag", {}
    yield "JSON: a line for each row", put("l.jsonl", "".join(json.dumps(o) + "\n" for o in objects)), "lag", {}
    np.save(folder / "s.npy", np.array(list(zip(t, u, y)), dtype=[("t", "f8"), ("u", "f4"), ("y", "f8")]))
    yield "structured NumPy array", folder / "s.npy", "lag", {}
    pair = lambda name, scale: put(name, "time [h],conc [mg/L]\n" + "".join(f"{a},{b * scale:.5f}\n" for a, b in zip(h[1:], c[1:])))
    twice = "".join(f"{a},{b * s:.5f}\n" for a, b in zip(h[1:], c[1:]) for s in (0.96, 1.05))
    yield "repeats in rows of one time", put("rep.csv", "time [h],conc [mg/L]\n" + twice), "oral", {}, {"truth": [pair("r1.csv", 0.96), pair("r2.csv", 1.05)]}
    subject = lambda k: "".join(f"{k},{a},{'320' if a == 0 else '.'},{'.' if b is None else b},{int(a == 0)},{60 + 5 * k}\n" for a, b in zip(h, c0))
    yield "four subjects in one table", put("nm.csv", "ID,TIME,AMT,DV,EVID,WT\n" + "".join(subject(k) for k in range(1, 5))), "oral", {"conc": "DV"}, {"truth": [put(
        f"s{k}.csv", "time [h],conc [mg/L]\n0,\n" + "".join(f"{a},{b}\n" for a, b in zip(h[1:], c0[1:]))) for k in range(1, 5)]}
    yield "hours and minutes, 08:00", put("hhmm.csv", "time,conc [mg/L]\n" + "".join(
        f"{8 + int(a):02d}:{int(a % 1 * 60):02d},{'' if b is None else b}\n" for a, b in zip(h[:-1], c0))), "oral", {}, {"truth": [put(
            "hhmm0.csv", "time [h],conc [mg/L]\n0,\n" + "".join(f"{a},{b}\n" for a, b in zip(h[1:-1], c0[1:])))]}
    yield "below the limit: <0.5", put("blq.csv", "time [h],conc [mg/L]\n" + "".join(f"{a},{'<0.5' if b is None else b}\n" for a, b in zip(h, c0))), "oral", {}
    yield "-999 where nothing was measured", put("code.csv", "time [h],conc [mg/L]\n" + "".join(
        f"{a},{-999 if a == 5 or b is None else b}\n" for a, b in zip(h, c0))), "oral", {}, {"truth": [put(
            "code0.csv", "time [h],conc [mg/L]\n0,\n" + "".join(f"{a},{b}\n" for a, b in zip(h[1:], c0[1:]) if a != 5))]}
    try:
        import openpyxl
        def sheet(name, lines, merged=()):
            book = openpyxl.Workbook()
            for line in lines:
                book.active.append(line)
            for cells in merged:
                book.active.merge_cells(cells)
            book.save(folder / name)
            return folder / name
        body = [[a, b] for a, b in zip(h, c0)]
        yield "XLSX with titles and a row of units", sheet("u.xlsx", [["Study ABC-01, subject 7"], ["Analyst: X"], [], ["time", "conc"], ["h", "mg/L"]] + body), "oral", {}
    except ImportError:
        print("XLSX is left out: there is no openpyxl")
    try:
        import h5py
        with h5py.File(folder / "c.h5", "w") as file:
            file["data"] = np.array(list(zip(t, u, y)), dtype=[("t", "f8"), ("u", "f4"), ("y", "f8")])
        yield "compound set of HDF5", folder / "c.h5", "lag", {}
    except ImportError:
        print("HDF5 is left out: there is no h5py")


def fit(fdm, model, file, extra):
    files = file if isinstance(file, list) else [file]
    command = [fdm, "fit", model, *(w for f in files for w in ("--data", f)), "--json", "--quiet", *extra]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=120)
    try:
        found = json.loads(done.stdout)
    except ValueError:
        return None, done.stderr.strip()
    return {p["name"]: p["value"] for p in found["parameters"]} | {"log-likelihood": found["log_likelihood"]}, done.stderr.strip()


ANSWERS = {"--rate": "50", "--runs-by": None, "--below-limit": None, "--replicates": None}


def advised(message, truth):
    """The one option that a message names, with what a person knows: the unit of the clock, the rate, the order of dates."""
    message = " ".join(message.split())
    option = truth.get("option")
    if option and f"--{option}" in message:
        return [f"--{option}", str(RATE)]
    found = re.search(r'(--map "t=(?!COLUMN)[^"]*")', message)
    if found:
        text = found.group(1)[7:-1]
        unit = truth.get("unit", "s")
        text = text.replace("[UNIT]", f"[{unit}]")
        text = re.sub(r"\[(ms|us|ns|s)\]", f"[{unit}]", text)
        text = re.sub(r"\[(dd/mm/yyyy|mm/dd/yyyy)\]", f"[{truth.get('order', 'dd/mm/yyyy')}]", text)
        return ["--map", text]
    found = re.search(r"--(rate|runs-by|below-limit|replicates|missing)(?: (\"[^\"]*\"|[^\s,;)]+))?", message)
    if not found:
        return None
    option, value = found.groups()
    if option == "rate":
        return ["--rate", str(truth.get("rate", RATE))]
    return [f"--{option}"] + ([] if option == "replicates" else [value.strip('"')])


UNITS = {"timestamp in microseconds since boot": "us"}


def judge(fdm, folder, kinds, out):
    models = {}
    for name, (text, _) in MODELS.items():
        models[name] = folder / f"{name}.fdm"
        models[name].write_text(text)
    t, u, y = lag()
    plain = folder / "truth.csv"
    plain.write_text("t [s],u [V],y [1]\n" + rows([floats(t), floats(u), floats(y)]))
    h, c = oral()
    dose = folder / "dose.csv"
    dose.write_text("time [h],conc [mg/L]\n" + rows([floats(h), [None] + floats(c)[1:]], form="{:.4f}"))
    truth = {"lag": fit(fdm, models["lag"], plain, [])[0], "oral": fit(fdm, models["oral"], dose, [])[0]}
    assert all(truth.values()), truth
    table = []
    for name, file, kind, mapped, *more in kinds(folder):
        known = dict(more[0]) if more else {"unit": UNITS.get(name)}
        known = {k: v for k, v in known.items() if v is not None}
        extra = [w for channel, column in mapped.items() for w in ("--map", f"{channel}={column}")]
        found, message = fit(fdm, models[kind], file, extra)
        how, option = "as it is", None
        if found is None:
            option = advised(message, known)
            if option:
                found, after = fit(fdm, models[kind], file, extra + option)
                how = "with " + " ".join(option)
                message = message if found is not None else f"{message} // {after}"
        reference = fit(fdm, models[kind], known["truth"], [])[0] if "truth" in known else truth[kind]
        right = found is not None and all(
            abs(found[p] - reference[p]) <= 3e-3 * abs(reference[p]) for p in [*MODELS[kind][1], "log-likelihood"])
        verdict = "refused" if found is None else "right" if right else "WRONG"
        table.append((name, how if found is not None else "", verdict))
        print(f"{verdict:8} {name:52} {how if found is not None else ''}", flush=True)
        if verdict != "right":
            print("         " + "\n         ".join(message.splitlines()[:4]), found or "")
    opened = sum(v == "right" for _, _, v in table)
    wrong = sum(v == "WRONG" for _, _, v in table)
    print(f"{opened} of {len(table)} open and are right, {sum(h == 'as it is' and v == 'right' for _, h, v in table)} of them as they are; {wrong} read wrongly")
    if out:
        Path(out).write_text("layout,opened,read\n" + "".join(f'"{a}",{b.replace(",", " ")},{d}\n' for a, b, d in table))
    return wrong == 0


if __name__ == "__main__":
    kinds = layouts
    words = [w for w in sys.argv[1:] if w not in ("further", "fresh")]
    if "further" in sys.argv[1:]:
        from further import layouts as kinds
    if "fresh" in sys.argv[1:]:
        from fresh import layouts as kinds
    with tempfile.TemporaryDirectory() as place:
        sys.exit(0 if judge(words[0], Path(place), kinds, words[1] if len(words) > 1 else None) else 1)
