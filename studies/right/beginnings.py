"""Stated beginnings: 100 records whose stated beginning is wrong, 100 whose stated beginning is right; what `fdm fit` says of them.

    python3 studies/right/beginnings.py target/release/fdm [COUNT] [--out FILE.csv]

Records are simulated by SciPy. Wrong ones: half have another initial value than the text, half begin later than the instant at which the text's initial
values hold, in a time scale whose 0 is that instant. Told is a remark `initial`, or the note that the first row is taken for time 0. Of the clean ones half
have white noise, half AR(1) noise with rho 0.8; every time of theirs begins at 0, so that only the remark can be wrong.
"""
import csv, json, os, subprocess, sys, tempfile
import numpy as np
from scipy.integrate import solve_ivp


def boat(rng):
    d1, d2, m = rng.uniform(5, 20), rng.uniform(8, 25), 60.0
    text = """model surge { input thrust [N]; state u [m/s] = %r; const m = 60 [kg];
      param d1 = 10 [kg/s], d2 = 12 [kg/m]; der(u) = (thrust - d1*u - d2*u*abs(u))/m; output y [m/s] = u; }"""
    f = lambda t, x, u: [(u - d1 * x[0] - d2 * x[0] * abs(x[0])) / m]
    return dict(text=text, f=f, y=lambda x: x[0], x0=[rng.choice([0.0, 1.0])], off=[rng.choice([-1, 1]) * rng.uniform(0.5, 1.5)],
                dt=0.1, n=400, input=("thrust [N]", 20.0, 60.0), time="s", out="y [m/s]")


def oscillator(rng):
    k, c, b = rng.uniform(1, 5), rng.uniform(0.2, 0.8), rng.uniform(1, 3)
    text = """model swing { input u; state p = %r, r = %r; param k = 2 in [0, 50], c = 0.5 in [0, 20], b = 1.5;
      der(p) = r; der(r) = -k*p - c*r + b*u; output y = p; }"""
    f = lambda t, x, u: [x[1], -k * x[0] - c * x[1] + b * u]
    return dict(text=text, f=f, y=lambda x: x[0], x0=[rng.choice([0.0, 1.0]), 0.0], off=[rng.choice([-1, 1]) * rng.uniform(0.5, 1.0), 0.0],
                dt=0.1, n=300, input=("u", 0.5, 1.0), time="s", out="y [1]")


def kinetics(rng):
    k1, k2 = rng.uniform(0.5, 1.5), rng.uniform(0.1, 0.4)
    text = """model chain { state a = %r, b = %r; param k1 = 0.8 in [0, 20], k2 = 0.2 in [0, 20];
      der(a) = -k1*a; der(b) = k1*a - k2*b; output y = b; }"""
    f = lambda t, x, u: [-k1 * x[0], k1 * x[0] - k2 * x[1]]
    return dict(text=text, f=f, y=lambda x: x[1], x0=[1.0, 0.0], off=[0.0, rng.uniform(0.15, 0.4)], dt=0.2, n=60, input=None, time="s", out="y [1]")


def oral(rng):
    ka, v, cl = rng.uniform(0.8, 2), rng.uniform(20, 40), rng.uniform(2, 5)
    text = """model oral { time [h]; state depot [mg] = %r, amount [mg] = %r;
      param ka = 1 in [0, 20] [1/h], V = 30 in [1, 300] [L], CL = 3 in [0, 50] [L/h];
      der(depot) = -ka*depot; der(amount) = ka*depot - CL/V*amount; output y [mg/L] = amount/V; }"""
    f = lambda t, x, u: [-ka * x[0], ka * x[0] - cl / v * x[1]]
    times = np.array([0, 0.25, 0.5, 0.75, 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24.0])
    return dict(text=text, f=f, y=lambda x: x[1] / v, x0=[320.0, 0.0], off=[0.0, rng.uniform(60, 120)], times=times, input=None, time="h", out="y [mg/L]")


def thermal(rng):
    c, h = rng.uniform(300, 600), rng.uniform(1, 3)
    text = """model oven { input p [W]; state T [K] = %r; const Ta = 293 [K]; param C = 400 in [10, 5000] [J/K], h = 2 in [0, 50] [W/K];
      der(T) = (p - h*(T - Ta))/C; output y [K] = T; }"""
    f = lambda t, x, u: [(u - h * (x[0] - 293)) / c]
    return dict(text=text, f=f, y=lambda x: x[0], x0=[293.0], off=[rng.uniform(4, 12)], dt=5.0, n=200, input=("p [W]", 10.0, 40.0), time="s", out="y [K]")


KINDS = [boat, oscillator, kinetics, oral, thermal]


def noise(rng, n, size, rho):
    white = rng.standard_normal(n)
    e = np.empty(n)
    e[0] = white[0]
    for k in range(1, n):
        e[k] = rho * e[k - 1] + np.sqrt(1 - rho**2) * white[k]
    return size * e


def case(folder, number, kind, fault):
    rng = np.random.default_rng([57, number, ["clean", "initial", "time"].index(fault)])
    s = kind(rng)
    t = s["times"] if "times" in s else s["dt"] * np.arange(s["n"])
    u = np.zeros(len(t))
    if s["input"]:
        low, high = s["input"][1:]
        level, k = low, 0
        while k < len(t):
            u[k:] = level
            k += int(rng.integers(len(t) // 12, len(t) // 5))
            level = rng.uniform(low, high)
    x0 = np.array(s["x0"]) + (np.array(s["off"]) if fault == "initial" else 0)
    drive = lambda now: np.interp(now, t, u)
    found = solve_ivp(lambda now, x: s["f"](now, x, drive(now)), (t[0], t[-1]), x0, t_eval=t, rtol=1e-9, atol=1e-10, max_step=np.diff(t).max())
    y = s["y"](found.y)
    rho = 0.8 if fault == "clean" and number % 2 else 0.0
    y = y + noise(rng, len(t), 0.03 * np.std(y), rho)
    first = 0
    if fault == "time":
        first = max(1, int(len(t) * rng.uniform(0.05, 0.2)))
    model, record = os.path.join(folder, "m.fdm"), os.path.join(folder, "r.csv")
    open(model, "w").write(s["text"] % tuple(float(v) for v in s["x0"]))
    head = ["t [%s]" % s["time"]] + ([s["input"][0]] if s["input"] else []) + [s["out"].replace(" [1]", "")]
    rows = np.c_[(t, u, y) if s["input"] else (t, y)][first:]
    np.savetxt(record, rows, delimiter=",", header=",".join(head), comments="", fmt="%.8g")
    return model, record


def main():
    program, rest = sys.argv[1], sys.argv[2:]
    count = int(rest[0]) if rest and rest[0].isdigit() else 100
    out = open(rest[rest.index("--out") + 1], "w", newline="") if "--out" in rest else None
    table = csv.writer(out) if out else None
    if table:
        table.writerow(["number", "kind", "fault", "code", "remark", "note", "gain"])
    totals = {}
    for number in range(count):
        kind = KINDS[number % len(KINDS)]
        for fault in ["initial" if (number // len(KINDS)) % 2 else "time", "clean"]:
            with tempfile.TemporaryDirectory() as folder:
                model, record = case(folder, number, kind, fault)
                ran = subprocess.run([program, "fit", model, "--data", record, "--json", "--no-project"], capture_output=True, text=True)
            try:
                document = json.loads(ran.stdout)
            except ValueError:
                document = {}
            doubted = document.get("doubted_initials")
            remark, note = doubted is not None, "taken for the model's time 0" in ran.stderr
            if table:
                table.writerow([number, kind.__name__, fault, ran.returncode, int(remark), int(note), "%.4g" % doubted["gain"] if doubted else ""])
            total = totals.setdefault((fault, kind.__name__), [0, 0, 0, 0])
            for k, one in enumerate([1, remark, note, remark or note]):
                total[k] += int(one)
    print("%-8s %-11s %5s %7s %5s %5s" % ("fault", "kind", "count", "remark", "note", "told"))
    for (fault, kind), total in sorted(totals.items()):
        print("%-8s %-11s %5d %7d %5d %5d" % (fault, kind, *total))
    for faults in [("initial", "time"), ("clean",)]:
        whole = np.sum([t for (f, _), t in totals.items() if f in faults], axis=0)
        print("%-20s %5d %7d %5d %5d" % ("+".join(faults), *whole))


main()
