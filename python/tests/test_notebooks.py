"""Notebooks are scripts with cells (`# %%`), as Jupytext and editors read them; each runs from its first line to its last."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

NOTEBOOKS = sorted((ROOT / "python/notebooks").glob("*.py"))


def test_there_are_four():
    assert len(NOTEBOOKS) == 4


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebooks_run(notebook: Path, tmp_path: Path):
    pytest.importorskip("scipy")
    pytest.importorskip("matplotlib")
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    ended = subprocess.run(
        [sys.executable, notebook], cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=900
    )
    assert ended.returncode == 0, ended.stderr[-3000:]


@pytest.mark.parametrize("page", ["docs/guide/first-record.md", "docs/guide/python.md", "README.md"])
def test_the_code_of_the_pages_runs(page: str, tmp_path: Path):
    """Blocks of Python on a page are one program, from the root of the repository."""
    blocks, inside = [], False
    for line in (ROOT / page).read_text().splitlines():
        if line.startswith("```"):
            inside = line == "```python"
        elif inside:
            blocks.append(line)
    assert blocks
    program = tmp_path / "page.py"
    program.write_text("\n".join(blocks) + "\n")
    (ROOT / "target/guide").mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    ended = subprocess.run([sys.executable, program], cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=600)
    assert ended.returncode == 0, ended.stderr[-3000:]
