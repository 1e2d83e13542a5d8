"""Several runs: values that they bring, groups, masks, tables and patterns; records judged by the doctor."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas
import pytest
from conftest import command, rolling

import fdm

COOLING = """model cooling {
  known  T0 per run [K];
  input  Ta [K];
  state  T [K] = T0;
  param  k = 0.1 in [0, 10] [1/s] per group make;
  der(T) = -k*(T - Ta);
  output Tm [K] = T;
}"""
# Name, temperature at the start, make, and the constant of cooling
BODIES = [("a", 350.0, "A", 0.2), ("b", 340.0, "B", 0.5), ("c", 320.0, "A", 0.2), ("v", 330.0, "B", 0.5)]


def cooled(start: float, k: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    t = np.linspace(0, 10, 101)
    return t, 290 + (start - 290) * np.exp(-k * t) + 0.05 * np.random.default_rng(seed).standard_normal(t.size)


def bodies() -> list[fdm.Run]:
    found = []
    for seed, (name, start, make, k) in enumerate(BODIES):
        t, T = cooled(start, k, seed)
        given = dict(t=t, inputs={"Ta": np.full(t.size, 290.0)}, outputs={"Tm": T})
        found.append(fdm.Run(**given, known={"T0": start}, groups={"make": make}, name=name))
    return found


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """The same runs as files, with a table of them."""
    (tmp_path / "cooling.fdm").write_text(COOLING)
    lines = ["file,run,role,T0 [degC],make"]
    for seed, (name, start, make, k) in enumerate(BODIES):
        t, T = cooled(start, k, seed)
        rows = np.column_stack([t, np.full(t.size, 290.0), T])
        np.savetxt(tmp_path / f"{name}_run.csv", rows, delimiter=",", header="t [s],Ta [K],Tm [K]", comments="", fmt="%.17g")
        lines.append(f"{name}_run.csv,{name},{'validation' if name == 'v' else 'fit'},{start - 273.15:.17g},{make}")
    (tmp_path / "runs.csv").write_text("\n".join(lines) + "\n")
    return tmp_path / "runs.csv"


def test_runs_bring_values_and_belong_to_groups():
    m, runs = fdm.Model.from_text(COOLING), bodies()
    assert [k.name for k in m.known] == ["T0"] and m.groupings == ["make"] and [i.name for i in m.inputs] == ["Ta"]
    fit = m.fit(runs[:3], validation=runs[3])
    for make, k in (("A", 0.2), ("B", 0.5)):
        found = fit.params[f"k[{make}]"]
        assert abs(found.value - k) < 4 * found.error and found.error < 0.01
    assert fit.validation is not None and fit.validation.outputs[0].rms == pytest.approx(0.05, rel=0.3)
    # the same in another unit, and as words
    for start in ((76.85, "degC"), "76.85 degC"):
        other = fdm.Run({n: runs[0][n] for n in runs[0].channels}, known={"T0": start}, groups={"make": "A"}, name="a")
        assert m.fit([other, *runs[1:3]]).params["k[A]"].value == pytest.approx(fit.params["k[A]"].value, rel=1e-9)
    # without groups all runs share one value
    shared = [fdm.Run({n: r[n] for n in r.channels}, known={"T0": b[1]}) for r, b in zip(runs, BODIES)]
    assert list(m.fit(shared[:3]).params) == ["k"]
    r, J = m.residuals(runs[:3])
    assert J.shape == (303, 2) and not J[101:202, 0].any() and J[101:202, 1].any()
    assert m.simulate(runs[1], {"k[B]": 0.5})["Tm"][-1] == pytest.approx(290 + 50 * np.exp(-5), abs=1e-3)


def test_a_run_that_does_not_say_its_group_is_refused():
    m, runs = fdm.Model.from_text(COOLING), bodies()
    fit = m.fit(runs[:3])
    strange = fdm.Run({n: runs[3][n] for n in runs[3].channels}, known={"T0": 330.0}, groups={"make": "C"}, name="strange")
    with pytest.raises(fdm.InputError, match="no fitted run has the make `C`: its groups are A, B"):
        fit.predict(strange)
    strange.groups.clear()
    with pytest.raises(fdm.InputError, match="`strange` does not say its `make`"):
        fit.predict(strange)
    with pytest.raises(fdm.RunError, match="no channel `T1`; did you mean `T0`"):
        m.fit(fdm.Run({n: runs[0][n] for n in runs[0].channels}, known={"T1": 330.0}))
    with pytest.raises(TypeError, match="value of `T0`"):
        fdm.Run({"t": [0, 1]}, known={"T0": "warm"})


def test_a_table_of_runs_is_that_of_the_command(table, tmp_path):
    m = fdm.Model(tmp_path / "cooling.fdm")
    fit = m.fit(fdm.RunTable(table))
    fit.save(tmp_path / "python")
    ended = command("fit", tmp_path / "cooling.fdm", "--runs", table, "--quiet", "--out", tmp_path / "command")
    assert ended.returncode == 0, ended.stderr
    for name in ("result.json", "quality.json", "result.txt"):
        assert (tmp_path / "python" / name).read_bytes() == (tmp_path / "command" / name).read_bytes(), name
    ours, theirs = (json.loads((tmp_path / d / "manifest.json").read_text()) for d in ("python", "command"))
    for key in ("identity", "data", "groups", "reading"):
        assert ours.get(key) == theirs.get(key), key
    assert fit.runs == ["a", "b", "c"] and fit.validation is not None and fit.validation.histories[0].run == "v"
    in_memory = m.fit(bodies()[:3])
    assert [p.value for p in in_memory.params.values()] == pytest.approx([p.value for p in fit.params.values()], rel=1e-9)
    # a folder knows its groups
    again = fdm.load(tmp_path / "python")
    assert list(again.params) == ["k[A]", "k[B]"]
    predicted = again.predict(fdm.RunTable(table))
    ended = command("validate", "--from-result", tmp_path / "command", "--runs", table, "--json")
    assert [o.rms for o in predicted.outputs] == [o["rms"] for o in json.loads(ended.stdout)["outputs"]]


def test_patterns_and_options_of_reading(table, tmp_path):
    m = fdm.Model.from_text(COOLING.replace(" per group make", ""))
    by_pattern = m.fit(tmp_path / "*_run.csv", known={"T0": 300.0}, every=2)
    assert by_pattern.runs == ["a_run", "b_run", "c_run", "v_run"] and len(by_pattern.histories[0].time) == 51
    one = m.fit(fdm.Run.read(tmp_path / "a_run.csv", known={"T0": "76.85 degC"}, to=5.0, name="first"))
    assert one.runs == ["first"] and one.params["k"].value == pytest.approx(0.2, rel=0.02)
    with pytest.raises(fdm.UnknownOption, match="`every` is for files") as caught:
        m.fit(bodies()[0], every=2)
    assert caught.value.option == "every"
    with pytest.raises(fdm.InputError, match="no file has such a name"):
        m.fit(tmp_path / "*_rin.csv")
    (tmp_path / "wrong.csv").write_text("file,T1\na_run.csv,1\n")
    with pytest.raises(fdm.InputError, match="column `T1`.*did you mean `T0`"):
        m.fit(fdm.RunTable(tmp_path / "wrong.csv"))


def test_masks_say_what_is_compared(roll, tmp_path):
    run = rolling(roll)
    columns = {n: run[n] for n in run.channels}
    good = (np.arange(len(run)) % 7 != 0).astype(float)
    spoiled = {**columns, "p_m": np.where(good == 0, 1e3, columns["p_m"])}
    gaps = {**columns, "p_m": np.where(good == 0, np.nan, columns["p_m"])}
    expected = [p.value for p in roll.fit(gaps).params.values()]
    for mask in ({"p_m": good}, {"p_m": "ok"}):
        found = roll.fit(fdm.Run({**spoiled, "ok": good}, mask=mask))
        assert [p.value for p in found.params.values()] == expected
    both = roll.fit(fdm.Run({**spoiled, "ok": good}, mask="ok"))
    assert np.isnan(both.residuals["run"][::7]).all()
    pandas.DataFrame({**spoiled, "ok": good}).to_csv(tmp_path / "run.csv", index=False)
    file = roll.fit(fdm.Run.read(tmp_path / "run.csv", mask={"p_m": "ok"}))
    assert [p.value for p in file.params.values()] == pytest.approx(expected, rel=1e-9)
    with pytest.raises(KeyError, match="no column `okay`"):
        fdm.Run(columns, mask="okay")
    with pytest.raises(KeyError, match="`aileron`, which is no output"):
        roll.fit(fdm.Run(columns, mask={"aileron": good}))
    with pytest.raises(ValueError, match="mask has 3 samples"):
        fdm.Run(columns, mask=[1, 1, 0])


def test_the_doctor_is_that_of_the_command(roll, tmp_path):
    run = rolling(roll)
    columns = {n: run[n].copy() for n in run.channels}
    columns["p_m"] = -columns["p_m"]
    frame = pandas.DataFrame(columns).rename(columns={"t": "t [s]", "aileron": "aileron [deg]", "p_m": "p_m [deg/s]", "phi_m": "phi_m [rad]"})
    frame.to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "roll.fdm").write_text(roll.text)
    found = fdm.Model(tmp_path / "roll.fdm").doctor(tmp_path / "run.csv")
    ended = command("doctor", tmp_path / "roll.fdm", "--data", tmp_path / "run.csv", "--json", "--fix", tmp_path / "map.toml")
    theirs = json.loads(ended.stdout)
    assert [(f.fault, f.channels, f.log_odds) for f in found.findings] == [(f["fault"], f["channels"], f["log_odds"]) for f in theirs["findings"]]
    assert not found.good and found.findings[0].fault == "sign" and found.findings[0].channels == ["p_m"]
    assert found.map == (tmp_path / "map.toml").read_text() and found.report().startswith("<!DOCTYPE html>")
    assert "sign" in found._repr_html_() and len(found.table()) == len(found.findings)
    found.save_map(tmp_path / "own.toml")
    # with the repairs the record is that of the model
    mended = roll.fit(fdm.Run.read(tmp_path / "run.csv", map=tmp_path / "own.toml"))
    assert mended.params["d"].value == pytest.approx(roll.fit(run).params["d"].value, rel=1e-6)
    in_memory = roll.doctor(columns)
    assert [f.fault for f in in_memory.findings][0] == "sign"
    (tmp_path / "mine.toml").write_text("mine")
    with pytest.raises(fdm.InputError, match="no map that fdm wrote"):
        found.save_map(tmp_path / "mine.toml")
    with pytest.raises(fdm.UnknownOption, match="`fix` is an option of the command alone"):
        roll.doctor(columns, fix="map.toml")


def test_records_are_judged_without_a_model(tmp_path):
    rng = np.random.default_rng(2)
    t = 0.02 * np.arange(2000)
    rate = np.cumsum(rng.standard_normal(2000)) * 0.01
    rate[700:900] = rate[700]
    run = fdm.Run({"t": t, "p [rad/s]": rate}, name="flight")
    found = fdm.doctor(run)
    np.savetxt(tmp_path / "flight.csv", np.column_stack([t, rate]), delimiter=",", header="t [s],p [rad/s]", comments="", fmt="%.17g")
    by_file = fdm.doctor(tmp_path / "flight.csv")
    ended = command("doctor", "--data", tmp_path / "flight.csv", "--json")
    assert [f.fault for f in by_file.findings] == [f["fault"] for f in json.loads(ended.stdout)["findings"]]
    assert [(f.fault, f.channels) for f in found.findings] == [(f.fault, f.channels) for f in by_file.findings]
    assert any(f.channels == ["p"] and f.place is not None for f in found.findings)
    assert fdm.doctor({"t": t, "p": np.cumsum(rng.standard_normal(2000)) * 0.01}).good


def test_strict_refuses_records_with_findings(roll):
    run = rolling(roll)
    columns = {n: run[n].copy() for n in run.channels}
    columns["p_m"][300:420] = columns["p_m"][300]
    with pytest.raises(fdm.NumericalError, match="`strict` refuses"):
        roll.fit(columns, strict=True)
    assert roll.fit(run, strict=True).good
