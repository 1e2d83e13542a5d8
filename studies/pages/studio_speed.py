#!/usr/bin/env python3
"""How fast `fdm studio` draws, by a real Chromium: 10^6 samples of 20 channels that are panned, and the response of an aircraft in six
degrees of freedom to a slider that is dragged, over 10,000 samples. Standard library only; load averages stand beside the figures.

    python3 studies/pages/studio_speed.py PROGRAM [--chromium PATH] [--pictures FOLDER]
"""

import argparse
import base64
import json
import math
import os
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

SAMPLES, CHANNELS = 1_000_000, 20
RATE, LENGTH = 100, 100  # Hz, s: the record of the aircraft
FRAMES, MOVES = 300, 120
PATIENCE = 600  # s


class Window:
    """A window of Chromium on an address, steered by its own protocol over the streams 3 and 4."""

    def __init__(self, chromium, address, width=1280, height=800, dark=False):
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.process = subprocess.Popen(
            ["sh", "-c", 'exec "$0" "$@" 3<&0 4>&1 >/dev/null 2>&1', chromium, "--headless", "--no-sandbox", "--disable-gpu",
             "--remote-debugging-pipe", f"--window-size={width},{height}", f"--user-data-dir={self.profile.name}", "about:blank"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.last, self.session, self.kept, self.said = 0, None, b"", []
        page = next(t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page")
        self.session = self.call("Target.attachToTarget", targetId=page["targetId"], flatten=True)["sessionId"]
        for domain in ["Runtime", "Log", "Page"]:
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600)
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])
        self.address = address

    def open(self):
        self.call("Page.navigate", url=self.address)

    def message(self):
        while b"\0" not in self.kept:
            part = os.read(self.process.stdout.fileno(), 1 << 20)
            if not part:
                raise SystemExit("the browser has gone")
            self.kept += part
        one, self.kept = self.kept.split(b"\0", 1)
        return json.loads(one)

    def heard(self, message):
        """What the browser tells unasked: complaints are kept."""
        if message.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded"):
            self.said.append(message["params"])

    def call(self, method, **params):
        self.last += 1
        message = {"id": self.last, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        own = self.last
        self.process.stdin.write(json.dumps(message).encode() + b"\0")
        self.process.stdin.flush()
        while True:
            message = self.message()
            if message.get("id") == own:
                if "error" in message:
                    raise SystemExit(f"{method}: {message['error']}")
                return message["result"]
            self.heard(message)

    def run(self, script):
        found = self.call("Runtime.evaluate", expression=f"(async () => {{ {script} }})()", awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in found:
            raise SystemExit(f"{script}: {found}")
        return found["result"].get("value")

    def until(self, expression):
        begun = time.time()
        while not self.run(f"return Boolean({expression});"):
            if time.time() - begun > PATIENCE:
                raise SystemExit(f"{expression}: {self.said}")
            time.sleep(0.05)

    def mouse(self, kind, x, y, **more):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def picture(self, path):
        Path(path).write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))

    def close(self):
        self.process.kill()
        self.process.wait()
        self.profile.cleanup()


class Studio:
    """The program over a folder."""

    def __init__(self, program, folder):
        self.process = subprocess.Popen([str(program), "studio", "--no-browser"], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.address = self.process.stdout.readline().strip()

    def close(self):
        self.process.kill()
        self.process.wait()


def long_record(path):
    with open(path, "w") as out:
        out.write("t [s]," + ",".join(f"c{k}" for k in range(CHANNELS)) + "\n")
        for n in range(SAMPLES):
            t = 0.001 * n
            out.write(f"{t:.3f}," + ",".join(f"{math.sin((0.3 + 0.05 * k) * t) + 0.1 * math.sin(61 * t + k):.4f}" for k in range(CHANNELS)) + "\n")


def aircraft(program, folder):
    """The aircraft of `fdm new` in ordinary flight: sums of sines in its sticks, the response of its own model."""
    subprocess.run([program, "new", "aircraft.fdm", "--kind", "aircraft-6dof", "-q"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    head, first = (folder / "aircraft.csv").read_text().splitlines()[:2]
    names, trim = head.split(","), float(first.split(",")[4])
    assert names[4].startswith("thrust")

    def stick(t, phase):
        return 0.002 * sum(math.sin(2 * math.pi * f * t + phase + 7 * f) for f in (0.13, 0.31, 0.57, 0.93, 1.37))

    inputs = [[n / RATE, *(stick(n / RATE, k) for k in range(3)), trim] for n in range(RATE * LENGTH)]
    rows = [[f"{v:.5f}" for v in row] for row in inputs]
    table = folder / "aircraft.csv"
    start = first.split(",")[5:]
    table.write_text("\n".join([head] + [",".join(row + start) for row in rows]) + "\n")
    subprocess.run([program, "simulate", "aircraft.fdm", "aircraft.csv", "--output", "response.csv", "-q"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    response = (folder / "response.csv").read_text().splitlines()[1:]
    table.write_text("\n".join([head] + [",".join(row + own.split(",")[1:]) for row, own in zip(rows, response)]) + "\n")
    (folder / "response.csv").unlink()
    (folder / "fdm.toml").write_text('model = "aircraft.fdm"\ndata = ["aircraft.csv"]\n')


def shares(values):
    ordered = sorted(values)
    return statistics.median(ordered), ordered[len(ordered) // 10], ordered[(9 * len(ordered)) // 10]


def load():
    return "load " + " ".join(f"{l:.1f}" for l in os.getloadavg())


PANNED = """
const c = document.querySelector('.record-view canvas'), box = c.getBoundingClientRect(), frame = () => new Promise(requestAnimationFrame);
const send = (kind, x) => c.dispatchEvent(new PointerEvent(kind, { pointerId: 1, clientX: box.left + x, clientY: box.top + 60, bubbles: true }));
c.setPointerCapture = () => {};
c.focus();
for (let k = 0; k < 8; k++) { c.dispatchEvent(new WheelEvent('wheel', { ctrlKey: true, deltaY: -120, clientX: box.left + 400, clientY: box.top + 60, bubbles: true, cancelable: true })); await frame(); }
const all = [], took = [];
send('pointerdown', 700);
let last = await frame();
for (let k = 0; k < %d; k++) { send('pointermove', 700 + 300 * Math.sin(k / 15)); const now = await frame(); all.push(now - last); last = now; took.push(Number(c.dataset.took)); }
send('pointerup', 700);
return { all, took };
"""

# from the event of the slider to the painting of its response, and to the frame behind it
DRAGGED = """
const frame = () => new Promise(requestAnimationFrame), s = document.querySelectorAll('.slider input[type=range]')[%d], c = document.querySelector('.model-view canvas');
const [low, high] = [Number(s.min), Number(s.max)], all = [];
for (let k = 0; k < %d; k++) {
  await frame();
  const begun = performance.now(), painted = new Promise((done, late) => { new MutationObserver((_, own) => { own.disconnect(); done(); }).observe(c, { attributes: true, attributeFilter: ['data-painted'] }); setTimeout(late, 5000); });
  s.value = low + (high - low) * (0.5 + 0.05 * Math.sin(k / 7)); s.dispatchEvent(new Event('input'));
  await painted;
  const seen = performance.now() - begun;
  await frame();
  all.push([seen, performance.now() - begun]);
}
return all;
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("--chromium", default="chromium")
    parser.add_argument("--pictures", type=Path)
    asked = parser.parse_args()
    program = asked.program.resolve()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        long_record(folder / "long.csv")
        studio = Studio(program, folder)
        window = Window(asked.chromium, studio.address)
        try:
            window.open()
            begun = time.time()
            window.until("document.querySelector('.record-view canvas')?.getAttribute('aria-label')?.includes('c3')")
            print(f"{SAMPLES} samples x {CHANNELS} channels: first drawn after {time.time() - begun:.1f} s")
            window.run("for (const b of document.querySelectorAll('.channels input:not(:checked)')) b.click();")
            window.until(f"document.querySelector('.record-view canvas').getAttribute('aria-label').includes('c{CHANNELS - 1}')")
            found = window.run(PANNED % FRAMES)
            middle, _, slow = shares(found["all"])
            own, _, longest = shares(found["took"])
            print(f"panned: {1000 / middle:.0f} frames a second (median), {1000 / slow:.0f} (tenth percentile); a drawing takes {own:.1f} ms (90 % below {longest:.1f}); {load()}")
            if asked.pictures:
                window.picture(asked.pictures / "panned.png")
        finally:
            window.close()
            studio.close()
        (folder / "long.csv").unlink()
        aircraft(program, folder)
        studio = Studio(program, folder)
        window = Window(asked.chromium, studio.address)
        try:
            window.open()
            window.until("document.querySelectorAll('#steps button').length === 5")
            window.run("document.querySelectorAll('#steps button')[1].click();")
            window.until("document.querySelectorAll('.slider').length > 10")
            count = window.run("return document.querySelectorAll('.slider').length;")
            all = []
            for k in range(0, count, max(1, count // 6)):
                found = window.run(DRAGGED % (k, MOVES // 6))
                all += found
            for what, times in zip(["painted", "the frame behind it"], zip(*all)):
                middle, _, slow = shares(times)
                print(f"aircraft, {RATE * LENGTH} samples: slider to response, {what}: {middle:.1f} ms (median), {slow:.1f} ms (90 %); {load()}")
            if asked.pictures:
                window.picture(asked.pictures / "dragged.png")
        finally:
            window.close()
            studio.close()


if __name__ == "__main__":
    main()
