"""Files of every format, each by the software of its own ecosystem: read to the bit, then 200 times truncated and 200 times with one bit flipped.

    pip install numpy scipy h5py pyarrow pyulog pymavlink
    cargo build --release -p fdm-readers --example digest --features hdf5,parquet
    python studies/records/damage.py target/release/examples/digest target/damage

A changed file counts as accepted silently if it is read as whole and holds other numbers than the file it was made from.
"""

import gzip
import random
import struct
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
from pymavlink import DFReader
from pyulog import ULog

digest, out = Path(sys.argv[1]).resolve(), Path(sys.argv[2])
TIMES = int(sys.argv[3]) if len(sys.argv) > 3 else 200
out.mkdir(parents=True, exist_ok=True)
rng = np.random.default_rng(1)
N = 400
t = np.arange(N) / 100
p, q, u = rng.normal(size=N), rng.normal(size=(N, 3)), rng.integers(0, 3, N).astype(np.int16)


def ulog(path):
    """A log with two topics of their own clocks; pyulog reads it and writes it anew."""
    def message(kind, body):
        return struct.pack("<HB", len(body), ord(kind)) + body
    first = path.with_suffix(".first")
    with open(first, "wb") as f:
        f.write(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000))
        f.write(message("B", bytes(40)))
        f.write(message("F", b"rate:uint64_t timestamp;float[3] xyz;"))
        f.write(message("F", b"servo:uint64_t timestamp;float pos;uint8_t[4] _padding0;"))
        f.write(message("A", struct.pack("<BH", 0, 0) + b"rate"))
        f.write(message("A", struct.pack("<BH", 0, 1) + b"servo"))
        for k in range(N):
            f.write(message("D", struct.pack("<HQ3f", 0, 1000 + 10000 * k, *q[k])))
            if k % 4 == 0:
                f.write(message("D", struct.pack("<HQf", 1, 3000 + 10000 * k, p[k])))
    ULog(str(first)).write_ulog(str(path))
    first.unlink()


def dataflash(path):
    """As ArduPilot writes it: formats, then messages; pymavlink has a reader only, which is the judge."""
    def form(kind, length, name, types, labels):
        return struct.pack("<3B", 0xA3, 0x95, 128) + struct.pack("<BB4s16s64s", kind, length, name, types, labels)
    with open(path, "wb") as f:
        f.write(form(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"))
        f.write(form(10, 3 + 20, b"IMU", b"Qfff", b"TimeUS,GyrX,GyrY,GyrZ"))
        f.write(form(11, 3 + 12, b"RCOU", b"QHh", b"TimeUS,C1,C2"))
        for k in range(N):
            f.write(struct.pack("<3BQ3f", 0xA3, 0x95, 10, 1000 + 10000 * k, *q[k]))
            if k % 4 == 0:
                f.write(struct.pack("<3BQHh", 0xA3, 0x95, 11, 3000 + 10000 * k, 1500 + k % 100, -k))
    reader = DFReader.DFReader_binary(str(path), False)
    seen = []
    while (m := reader.recv_match(type="IMU")) is not None:
        seen.append([m.GyrX, m.GyrY, m.GyrZ])
    assert np.array_equal(np.array(seen, dtype=np.float32), q.astype(np.float32)), "pymavlink reads the same"


def hdf5(path, **kwargs):
    with h5py.File(path, "w") as f:
        for name, value in {"t": t, "p": p, "q": q, "u": u}.items():
            f.create_dataset(name, data=value, **kwargs)


def matlab73(path):
    with h5py.File(path, "w", userblock_size=512) as f:
        for name, value in {"t": t.reshape(-1, 1), "p": p.reshape(-1, 1), "q": q}.items():
            f.create_dataset(name, data=value.T, compression="gzip").attrs["MATLAB_class"] = np.bytes_("double")
    with open(path, "r+b") as f:
        f.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")


def parquet(path, checksum):
    table = pa.table({"t [s]": t, "p": p, "u": u})
    pq.write_table(table, path, row_group_size=128, write_page_checksum=checksum)


MAKE = {
    "stored.npz": lambda f: np.savez(f, t=t, p=p, q=q, u=u),
    "packed.npz": lambda f: np.savez_compressed(f, t=t, p=p, q=q, u=u),
    "one.npy": lambda f: np.save(f, np.column_stack([t, p])),
    "plain.mat": lambda f: scipy.io.savemat(f, {"t": t, "p": p, "q": q, "u": u}),
    "packed.mat": lambda f: scipy.io.savemat(f, {"t": t, "p": p, "q": q, "u": u}, do_compression=True),
    "flight.ulg": ulog,
    "flight.bin": dataflash,
    "plain.h5": hdf5,
    "checked.h5": lambda f: hdf5(f, chunks=True, compression="gzip", fletcher32=True),
    "matlab73.mat": matlab73,
    "plain.parquet": lambda f: parquet(f, False),
    "checked.parquet": lambda f: parquet(f, True),
}


def read(files):
    found = {}
    for k in range(0, len(files), 500):
        text = subprocess.run([digest, *map(str, files[k:k + 500])], capture_output=True, text=True, check=True).stdout
        for line in text.splitlines():
            name, state, value, said = line.split("\t", 3)
            found[name] = (state, value, said)
    return found


print(f"{'file':16} {'':10} {'refused':>8} {'damaged':>8} {'same':>6} {'silent':>7}")
for name, make in MAKE.items():
    path = out / name
    make(path)
    whole = path.read_bytes()
    state, value, said = read([path])[str(path)]
    assert state == "whole", (name, state, said)
    draw = random.Random(name)
    for what in ["truncated", "flipped"]:
        files = []
        for k in range(TIMES):
            if what == "truncated":
                changed = whole[: draw.randrange(len(whole))]
            else:
                changed = bytearray(whole)
                changed[draw.randrange(len(whole))] ^= 1 << draw.randrange(8)
            file = out / f"{what}_{k}_{name}"
            file.write_bytes(bytes(changed))
            files.append(file)
        found = read(files)
        states = [found[str(f)] for f in files]
        silent = [f for f in files if found[str(f)][0] == "whole" and found[str(f)][1] != value]
        same = sum(s == "whole" and v == value for s, v, _ in states)
        refused, damaged = (sum(s == w for s, _, _ in states) for w in ("refused", "damaged"))
        print(f"{name:16} {what:10} {refused:8} {damaged:8} {same:6} {len(silent):7}")
        for f in files:
            if f not in silent[:3]:
                f.unlink()
