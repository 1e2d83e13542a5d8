"""Turned frames: twelve turned copies of two right records, and right records of other flights.

    python3 studies/doctor/frames.py FOLDER [--fdm target/release/fdm] [--right 20]

An aeroplane shows attitude, rates and accelerations, a multirotor attitude, velocity and position; both fly by rotation matrices over a flat earth.
A copy is right when the first finding names the frame and the record, read by the map of `--fix`, has no finding. Nothing in a record tells where
north is: of the two frames that are turned with their attitude the usual one is named, and the other as nearly as likely. Right records get none.
"""

import argparse
import csv
import json
import math
import random
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
G, DT, N = 9.80665, 0.02, 2000
DOWN = [0.0, 0.0, G]


# ---- vectors and rotations; a matrix turns body axes into world axes
def times(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def apply(a, v):
    return [sum(a[i][k] * v[k] for k in range(3)) for i in range(3)]


def transposed(a):
    return [list(row) for row in zip(*a)]


def rotated(a, rate, dt):
    """A rotation behind a time with these body rates (Rodrigues)."""
    angle = math.sqrt(sum(w * w for w in rate)) * dt
    if angle == 0:
        return a
    x, y, z = (w * dt / angle for w in rate)
    s, c = math.sin(angle), 1 - math.cos(angle)
    k = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    kk = times(k, k)
    return times(a, [[(i == j) + s * k[i][j] + c * kk[i][j] for j in range(3)] for i in range(3)])


def angles(a):
    """Roll, pitch and yaw, by turns about z, y and x."""
    return [math.atan2(a[2][1], a[2][2]), -math.asin(max(-1.0, min(1.0, a[2][0]))), math.atan2(a[1][0], a[0][0])]


def wander(luck, size, slow):
    """A random command that goes on smoothly."""
    waves = [(size * luck.uniform(0.3, 0.7), slow * luck.uniform(0.4, 1.8), luck.uniform(0, 2 * math.pi)) for _ in range(4)]
    return lambda t: sum(a * math.sin(f * t + b) for a, f, b in waves)


# ---- flights: rows of (time, rotation, rates, specific force, velocity, position) in north-east-down and forward-right-down
def flown(luck, attitude, velocity, force, steer):
    rows, position, parts = [], [0.0, 0.0, -100.0], 4
    for k in range(N):
        for part in range(parts):
            t = (k + part / parts) * DT
            wind = apply(transposed(attitude), velocity)
            f, rate = force(t, attitude, wind), steer(t, attitude, wind)
            if part == 0:
                rows.append((k * DT, attitude, rate, f, velocity, position))
            h = DT / parts
            a = [x + y for x, y in zip(apply(attitude, f), DOWN)]
            position = [p + h * v + 0.5 * h * h * w for p, v, w in zip(position, velocity, a)]
            velocity = [v + h * w for v, w in zip(velocity, a)]
            attitude = rotated(attitude, rate, h)
    return rows


def aeroplane(luck):
    bank, climb, speed = wander(luck, 0.4, 0.5), wander(luck, 0.08, 0.6), luck.uniform(25, 45)
    trim = 0.07
    start = rotated([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, luck.uniform(-3, 3)], 1.0)

    def force(t, a, v):
        size = (v[0] / speed) ** 2
        return [G * math.sin(angles(a)[1]) + 0.5 * (speed - v[0]), -8.0 * v[1] / v[0] * size, -G / trim * v[2] / v[0] * size]

    def steer(t, a, v):
        phi, theta, _ = angles(a)
        turn = G * math.tan(phi) / v[0]
        return [2.0 * (bank(t) - phi), 1.5 * (trim + climb(t) - theta) + turn * math.sin(phi), turn * math.cos(phi) + 1.5 * v[1] / v[0]]

    velocity = apply(start, [speed, 0.0, trim * speed])
    return flown(luck, rotated(start, [0, trim, 0], 1.0), velocity, force, steer)


def multirotor(luck):
    roll, pitch, yaw, lift = wander(luck, 0.2, 0.9), wander(luck, 0.2, 0.8), wander(luck, 0.3, 0.3), wander(luck, 1.0, 0.7)
    start = rotated([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, luck.uniform(-3, 3)], 1.0)

    def force(t, a, v):
        return [-0.3 * v[0], -0.3 * v[1], -(G + lift(t)) / max(a[2][2], 0.5) - 0.4 * v[2]]

    def steer(t, a, v):
        phi, theta, _ = angles(a)
        return [4.0 * (roll(t) - phi), 4.0 * (pitch(t) - theta), yaw(t)]

    return flown(luck, start, [0.0] * 3, force, steer)


# ---- frames: what turns north-east-down and forward-right-down into them
WORLD = {"ned": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "enu": [[0, 1, 0], [1, 0, 0], [0, 0, -1]], "nwu": [[1, 0, 0], [0, -1, 0], [0, 0, -1]]}
BODY = {"frd": WORLD["ned"], "flu": WORLD["nwu"]}


def shown(rows, what, frame, degrees, luck):
    """Columns of a record in a frame, with noise of the sensors."""
    world, body = (WORLD[frame[:3]], BODY[frame[4:]])
    both = (frame[:3] != "ned") == (frame[4:] != "frd")
    turn = 180 / math.pi if degrees else 1.0
    unit, of_rate = ("deg", "deg/s") if degrees else ("rad", "rad/s")
    force, of_force = (1 / G, "g") if degrees else (1.0, "m/s^2")
    head = ["t [s]"] + [f"{name} [{unit}]" for name in ("phi", "theta", "psi")]
    head += [f"{n} [{of_rate}]" for n in "pqr"] + [f"a{n} [{of_force}]" for n in "xyz"] if what == "rates" else \
        [f"v{n} [m/s]" for n in "xyz"] + [f"{n} [m]" for n in "xyz"]
    noise = lambda values, size: [v + luck.gauss(0, size) for v in values]
    lines, before = [], None
    for t, a, rate, f, velocity, position in rows:
        if both:
            a = times(times(world, a), transposed(body))
        row = noise(angles(a), 0.005)
        before = row[2] if before is None else row[2] + 2 * math.pi * round((before - row[2]) / (2 * math.pi))
        row[2] = before
        row = [turn * v for v in row]
        if what == "rates":
            row += [turn * v for v in noise(apply(body, rate), 0.01)] + [force * v for v in noise(apply(body, f), 0.1)]
        else:
            row += noise(apply(world, velocity), 0.05) + noise(apply(world, position), 0.1)
        lines.append([t] + row)
    return [head] + lines


def write(path, lines):
    with open(path, "w", newline="") as file:
        out = csv.writer(file)
        out.writerow(lines[0])
        out.writerows([f"{v:.5f}" for v in line] for line in lines[1:])


def doctor(arguments, path, *more):
    done = subprocess.run([arguments.fdm, "doctor", "--data", path, *more, "--json"], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{path}: {done.stderr}")
    return [f for f in json.loads(done.stdout)["findings"] if f["severity"] == "finding"]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fdm", default=str(ROOT / "target/release/fdm"))
    parser.add_argument("--right", type=int, default=20)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    flights = [("aeroplane", aeroplane, "rates", ["enu-flu", "nwu-flu", "ned-flu"]),
               ("multirotor", multirotor, "track", ["enu-flu", "enu-frd", "nwu-frd"])]
    right = copies = 0
    for name, flight, what, frames in flights:
        rows = flight(random.Random(name))
        for frame in frames:
            for degrees in (False, True):
                copies += 1
                place = arguments.folder / f"{name}_{frame}_{'deg' if degrees else 'rad'}.csv"
                write(place, shown(rows, what, frame, degrees, random.Random(f"{place.name}")))
                fix = place.with_suffix(".toml")
                found = doctor(arguments, place, "--fix", fix)
                said = found[0]["repair"]["line"] if found else "nothing"
                alike = {"enu-flu", "nwu-flu"} if frame in ("enu-flu", "nwu-flu") else {frame}
                named = any(said == f'frame = "{f}"' for f in alike)
                left = doctor(arguments, place, "--map-file", fix) if named else []
                right += named and not left
                odds = f"log odds {found[0]['log_odds']:.0f}, {len(found)} finding(s)" if found else ""
                print(f"{'right' if named and not left else 'WRONG'}  {name}, {frame}, {'deg' if degrees else 'rad'}: {said}; {odds}", flush=True)
    alarms = 0
    for name, flight, what, _ in flights:
        for seed in range(arguments.right // 2):
            place = arguments.folder / f"{name}_right_{seed}.csv"
            luck = random.Random(f"{name} {seed or ''}".strip())
            write(place, shown(flight(luck), what, "ned-frd", seed % 2 == 1, luck))
            found = doctor(arguments, place)
            alarms += bool(found)
            for finding in found:
                print(f"ALARM  {place.name}: {finding['channels']} {finding['fault']}: {finding['what']}", flush=True)
    print(f"{right} of {copies} turned copies right; findings on {alarms} of {arguments.right // 2 * 2} right records")


if __name__ == "__main__":
    main()
