"""The golden set: the same commands by two programs, every number compared to the bit and every page by its elements.

python3 studies/golden/golden.py PROGRAM FOLDER     makes the set of `commands.txt`, beside what is there already
python3 studies/golden/golden.py --compare A B      prints what differs: file, how many values, the first of them

To be run in the root of the repository. Bits depend on the processor's vector unit; so two programs are asked on one machine, and no answer is
kept in the repository. Durations, dates and names of folders are left out.
"""
import html.parser
import json
import os
import pathlib
import re
import shlex
import subprocess
import sys
import time
from collections import Counter

# lines as they are, whatever the terminal
WIDE = {**os.environ, "COLUMNS": "100000"}
HERE = pathlib.Path(__file__).resolve().parent
# what a clock decides: in text, and by key
CLOCK = re.compile(r"\b\d+(\.\d+)? (s|ms|min|h)\b|\b\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d)?Z?")
CLOCKED = {"seconds", "elapsed", "started", "ended", "cpu_seconds", "date"}
# by run, not by numbers
LEFT_OUT = ("manifest.json", "lock")


def commands():
    for line in (HERE / "commands.txt").read_text().splitlines():
        if line.strip() and not line.startswith("#"):
            name, words = line.split(": ", 1)
            yield name, shlex.split(words)


def make(program, folder):
    folder.mkdir(parents=True, exist_ok=True)
    for name, words in commands():
        told = folder / f"{name}.txt"
        if told.exists():
            continue
        begun = time.monotonic()
        words = [word.replace("{o}", str(folder)) for word in words]
        done = subprocess.run([program, "--no-project", *words], capture_output=True, text=True, errors="replace", env=WIDE)
        text = f"exit {done.returncode}\n{done.stdout}\n----\n{done.stderr if done.returncode else ''}"
        told.write_text(text.replace(str(folder), "{o}"))
        print(f"{name}: exit {done.returncode}, {time.monotonic() - begun:.1f} s", flush=True)


def of_json(value, place=""):
    """Leaves of a document, with their places."""
    if isinstance(value, dict):
        for key, inner in value.items():
            if key not in CLOCKED:
                yield from of_json(inner, f"{place}.{key}")
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from of_json(inner, f"{place}[{k}]")
    else:
        yield place, CLOCK.sub("", value) if isinstance(value, str) else repr(value)


class Elements(html.parser.HTMLParser):
    """Elements and texts of a page, in their order."""

    def __init__(self):
        super().__init__()
        self.seen = []

    def handle_starttag(self, tag, attrs):
        self.seen.append((tag, CLOCK.sub("", repr(sorted((k, v or "") for k, v in attrs)))))

    def handle_data(self, data):
        words = CLOCK.sub("", " ".join(data.split()))
        if words:
            self.seen.append(("text", words))


def leaves(path, folder):
    text = path.read_text(errors="replace").replace(str(folder), "{o}")
    if path.suffix == ".json":
        return list(of_json(json.loads(text)))
    if path.suffix in (".html", ".svg"):
        page = Elements()
        page.feed(text)
        return page.seen
    first, _, rest = text.partition("\n")
    if path.suffix == ".txt" and rest.startswith("{"):
        try:
            return [("exit", first), *of_json(json.loads(rest.rsplit("\n----\n", 1)[0]))]
        except json.JSONDecodeError:
            pass
    return list(enumerate(CLOCK.sub("", text).splitlines()))


def compare(a, b):
    files = {f: {p.relative_to(f) for p in f.rglob("*") if p.is_file() and p.name not in LEFT_OUT} for f in (a, b)}
    equal = different = 0
    for name in sorted(files[a] | files[b]):
        if name not in files[a] or name not in files[b]:
            different += 1
            print(f"{name}: only in {a if name in files[a] else b}")
            continue
        same = (a / name).read_bytes() == (b / name).read_bytes()
        one, two = ([], []) if same else (leaves(a / name, a), leaves(b / name, b))
        if one == two:
            equal += 1
            continue
        different += 1
        # what stands at one place in both is compared there; of what was renamed, the values
        gone, new = Counter(one) - Counter(two), Counter(two) - Counter(one)
        places = {place for place, _ in gone} & {place for place, _ in new}
        changed = [(x, y) for x in gone for y in new if x[0] == y[0]] if len(places) < 200 else []
        moved = Counter(value for _, value in gone.elements()) == Counter(value for _, value in new.elements())
        said = "other names, equal values" if moved and not places else f"{len(places)} values differ"
        print(f"{name}: {said}; {sum(gone.values())} gone, {sum(new.values())} new")
        for x, y in changed[:3]:
            print(f"    {str(x)[:140]}\n    {str(y)[:140]}")
        for x in [x for x in gone if x[0] not in places][:2]:
            print(f"    - {str(x)[:140]}")
        for y in [y for y in new if y[0] not in places][:2]:
            print(f"    + {str(y)[:140]}")
    print(f"{equal} files equal, {different} not")
    return different


if __name__ == "__main__":
    if sys.argv[1] == "--compare":
        sys.exit(1 if compare(pathlib.Path(sys.argv[2]).resolve(), pathlib.Path(sys.argv[3]).resolve()) else 0)
    make(sys.argv[1], pathlib.Path(sys.argv[2]).resolve())
