"""Writes the files of src/doors/readers/samples, each by the software of its own ecosystem.

    pip install numpy scipy h5py pyarrow openpyxl
    python studies/records/make.py src/doors/readers/samples

Every number is a multiple of 1/128, so that the tests compute the same bits.
"""

import sys
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io

out = Path(sys.argv[1])
k = np.arange(200)
t = k / 128
p = (k * k % 97) / 16 - 3
y = np.column_stack([k / 4, -k / 8, (k % 7) / 2])
u = (k % 3).astype(np.int16)

np.savez(out / "plain.npz", t=t, p=p, y=y, u=u, mass=np.float64(2.5), name=np.array("flight"))
np.savez_compressed(out / "packed.npz", t=t, p=p.astype(np.float32), y=np.asfortranarray(y), u=u.astype(">i2"))
np.save(out / "array.npy", np.column_stack([t, p]))
record = {"t": t.reshape(-1, 1), "p": p, "y": y, "u": u, "run": {"q": p.reshape(-1, 1), "note": "steady"}, "label": "flight"}
cells = np.empty((1, 2), dtype=object)
cells[0, 0], cells[0, 1] = p.reshape(-1, 1), y
scipy.io.savemat(out / "plain.mat", {**record, "cells": cells})
scipy.io.savemat(out / "packed.mat", record, do_compression=True)
with h5py.File(out / "table.h5", "w") as f:
    f["t"] = t
    f["t"].attrs["units"] = "s"
    f.create_dataset("flight/p", data=p, compression="gzip", chunks=(50,), fletcher32=True)
    f["flight/p"].attrs["units"] = "rad/s"
    f["flight/y"] = y
    f["flight/u"] = u
# as MATLAB writes version 7.3: 512 bytes of its own, then HDF5, arrays transposed, with their class beside them
with h5py.File(out / "matlab73.mat", "w", userblock_size=512) as f:
    for name, value in {"t": t.reshape(-1, 1), "p": p.reshape(-1, 1), "y": y}.items():
        f.create_dataset(name, data=value.T, compression="gzip").attrs["MATLAB_class"] = np.bytes_("double")
with open(out / "matlab73.mat", "r+b") as f:
    f.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")
table = pa.table({"t [s]": t, "p [rad/s]": pa.array([None if i == 5 else v for i, v in enumerate(p)]), "u": u})
pq.write_table(table, out / "table.parquet", row_group_size=64, write_page_checksum=True)
book = openpyxl.Workbook()
sheet, clock = book.active, book.create_sheet("clock")
sheet.title = "flight"
sheet.append(["t [s]", "p [rad/s]", "y", "u", "note"])
for row in zip(t, p, -k / 8, u):
    sheet.append([float(v) for v in row] + ["steady"])
clock.append(["when"])
for v in t:
    clock.append([45000 + float(v)])
    clock.cell(clock.max_row, 1).number_format = "yyyy-mm-dd hh:mm:ss.000"
book.save(out / "table.xlsx")
book = openpyxl.Workbook()
for row in [["t", "p", "q", "when"], [0, 1, 1, 5], [1, "#DIV/0!", 2, 6], [2, 3, "n/a", 7]]:
    book.active.append(row)
book.active.cell(2, 4).number_format = "yyyy-mm-dd"
book.save(out / "wrong.xlsx")
