"""Runs from files, arrays, dictionaries and frames; units; several rates."""

from __future__ import annotations

import numpy as np
import pandas
import polars
import pytest
from conftest import MODELS, decaying, rolling

import fdm


def values(fit: fdm.Fit) -> list[float]:
    return [p.value for p in fit.params.values()]


def test_every_form_gives_the_same_bits(roll):
    run = rolling(roll)
    columns = {name: run[name] for name in ("t", "aileron", "p_m", "phi_m")}
    frame = pandas.DataFrame(columns)
    expected = values(roll.fit(run))
    forms = [
        columns,
        frame,
        polars.DataFrame(columns),
        frame.set_index("t"),
        fdm.Run(columns, name="other"),
        frame.rename(columns={"p_m": "gyro", "t": "time"}).pipe(lambda f: fdm.Run(f, map={"p_m": "gyro"})),
        frame.assign(unrelated=1.0),
        fdm.Run(t=columns["t"], inputs={"aileron": fdm.Signal(run["aileron"])}, outputs={"p_m": (run["p_m"], "deg/s"), "phi_m": run["phi_m"]}),
    ]
    for form in forms:
        assert values(roll.fit(form)) == expected


def test_a_file_and_its_columns_are_the_same(tanker, tanker_run, tanker_fit):
    frame = pandas.read_csv(tanker_run)
    in_memory = tanker.fit(fdm.Run(frame, name="run"))
    assert [p.value for p in in_memory.params.values()] == pytest.approx(values(tanker_fit), rel=1e-9)


def test_units_are_converted(roll):
    run = rolling(roll)
    ours = fdm.Run(
        {"t [ms]": 1000 * run["t"], "aileron [rad]": np.radians(run["aileron"]), "p_m [rad/s]": np.radians(run["p_m"]), "phi_m": run["phi_m"]}
    )
    assert values(roll.fit(ours)) == pytest.approx(values(roll.fit(run)), rel=1e-6)
    said = fdm.Run({"t": run["t"], "aileron": np.radians(run["aileron"]), "p_m": run["p_m"], "phi_m": run["phi_m"]}, units={"aileron": "rad"})
    assert values(roll.fit(said)) == pytest.approx(values(roll.fit(run)), rel=1e-6)
    frame = pandas.DataFrame({"t": run["t"], "aileron": np.radians(run["aileron"]), "p_m": run["p_m"], "phi_m": run["phi_m"]})
    frame.attrs["units"] = {"aileron": "rad"}
    assert values(roll.fit(frame)) == values(roll.fit(said))
    with pytest.raises(fdm.RunError, match="deg") as caught:
        roll.fit(fdm.Run({"t": run["t"], "aileron [m]": run["aileron"], "p_m": run["p_m"], "phi_m": run["phi_m"]}))
    assert caught.value.run == "run" and len(caught.value.faults) == 1


def test_times_of_frames_become_seconds(decay):
    run = decaying()
    stamps = pandas.Timestamp("2024-05-01T12:00") + pandas.to_timedelta(np.round(run["t"] * 1e9).astype(int), unit="ns")
    for index in (stamps, stamps - stamps[0]):
        found = decay.fit(pandas.DataFrame({"y": run["y"]}, index=index))
        assert found.params["k"].value == pytest.approx(decay.fit(run).params["k"].value, rel=1e-6)
    timed = polars.DataFrame({"time": stamps.to_numpy(), "y": run["y"]})
    assert decay.fit(timed).params["k"].value == pytest.approx(decay.fit(run).params["k"].value, rel=1e-6)


def test_channels_of_several_rates_are_put_on_all_times(roll):
    run = rolling(roll)
    slow = run["t"][::4]
    mixed = fdm.Run(t=run["t"], inputs={"aileron": run["aileron"]}, outputs={"p_m": run["p_m"], "phi_m": fdm.Signal(run["phi_m"][::4], t=slow)})
    gaps = run["phi_m"].copy()
    gaps[np.arange(len(gaps)) % 4 != 0] = np.nan
    same = fdm.Run(t=run["t"], inputs={"aileron": run["aileron"]}, outputs={"p_m": run["p_m"], "phi_m": gaps})
    assert values(roll.fit(mixed)) == values(roll.fit(same))
    series = pandas.Series(run["phi_m"][::4], index=slow)
    assert values(roll.fit(fdm.Run(t=run["t"], inputs={"aileron": run["aileron"]}, outputs={"p_m": run["p_m"], "phi_m": series}))) == values(roll.fit(same))
    # two rates without common times
    odd = fdm.Run(inputs={"aileron": fdm.Signal(run["aileron"], t=run["t"])}, outputs={"p_m": fdm.Signal(run["p_m"][1::3], t=run["t"][1::3] + 0.01), "phi_m": fdm.Signal(run["phi_m"], t=run["t"])})
    assert len(odd) == 800 + len(run["t"][1::3])
    assert values(roll.fit(odd)) == pytest.approx(values(roll.fit(run)), rel=0.1)


def test_missing_values_of_frames_are_gaps(decay):
    run = decaying()
    y = run["y"].copy()
    y[5:9] = np.nan
    expected = values(decay.fit(fdm.Run(t=run["t"], outputs={"y": y})))
    missing = pandas.Series(y).convert_dtypes()
    assert values(decay.fit(pandas.DataFrame({"t": run["t"], "y": missing}))) == expected
    assert values(decay.fit(polars.DataFrame({"t": run["t"], "y": pandas.Series(y).where(~np.isnan(y), None).tolist()}))) == expected


def test_an_output_may_be_measured_in_another_run(roll):
    whole, part = rolling(roll, seed=1, name="a"), rolling(roll, seed=2, name="b")
    lacking = fdm.Run(t=part["t"], inputs={"aileron": part["aileron"]}, outputs={"p_m": part["p_m"]}, name="b")
    fit = roll.fit([whole, lacking])
    assert np.isnan(fit.residuals["b"][:, 1]).all() and fit.good
    with pytest.raises(fdm.RunError, match="no samples for the output `phi_m`"):
        roll.fit(lacking)
    alone = fdm.Run(t=part["t"], inputs={"aileron": part["aileron"]}, outputs={"p_m": part["p_m"]}, without_output="phi_m")
    assert roll.fit(alone).params["d"].value == pytest.approx(0.8, abs=0.1)


def test_files_are_read_with_the_options_of_the_command(tanker, tanker_run):
    run = fdm.Run.read(tanker_run, from_=30.0, to=60.0, every=2, map={"roll": "roll"})
    fit = tanker.fit(run)
    assert 1495 < len(fit.histories[0].time) < 1505
    with pytest.raises(fdm.UnknownOption, match="there is no option `evry`; did you mean `every`") as caught:
        tanker.fit(fdm.Run.read(tanker_run, evry=2))
    assert caught.value.option == "evry"
    noted = fdm.Run(MODELS / "tclab/step_1.csv")
    fdm.Model(MODELS / "tclab/model.fdm").fit(noted)
    assert isinstance(noted.notes, list)


def test_held_inputs(roll):
    run = rolling(roll)
    held, straight = (
        fdm.Run(t=run["t"], inputs={"aileron": run["aileron"]}, outputs={"p_m": run["p_m"], "phi_m": run["phi_m"]}, **{word: "aileron"})
        for word in ("zoh", "linear")
    )
    # it moves only at samples, all at once: taken for held in memory as in a file
    assert values(roll.fit(held)) == values(roll.fit(run)) != values(roll.fit(straight))
    with pytest.raises(fdm.RunError, match="ailron"):
        roll.fit(fdm.Run(t=run["t"], inputs={"aileron": run["aileron"]}, outputs={"p_m": run["p_m"], "phi_m": run["phi_m"]}, zoh="ailron"))


@pytest.mark.parametrize("samples", [5, 16_384, 50_000])
def test_every_order_of_memory_is_the_same_run(samples):
    names = [f"y{k}" for k in range(3)]
    text = "model wide { param a = 1 [m]; " + " ".join(f"output {n} [m] = a;" for n in names) + " }"
    m = fdm.Model.from_text(text)
    rows = np.random.default_rng(0).standard_normal((samples, 3))
    rows[samples // 2, 1] = np.nan
    wide, backwards = np.zeros((2 * samples, 4)), rows[::-1].copy()
    wide[::2, 1:] = rows
    for whole in (rows, np.asfortranarray(rows), wide[::2, 1:], backwards[::-1]):
        [record] = fdm._run.Campaign.of(m, fdm.Run({n: whole[:, k] for k, n in enumerate(names)})).records
        assert np.array_equal(record.measured(), rows, equal_nan=True)
        [record] = fdm._run.Campaign.of(m, fdm.Run({f"{n} [cm]": whole[:, k] for k, n in enumerate(names)})).records
        assert np.allclose(record.measured(), 0.01 * rows, rtol=1e-15, equal_nan=True)
        mixed = {n: np.ascontiguousarray(whole[:, k]) if k == 1 else whole[:, k] for k, n in enumerate(names)}
        [record] = fdm._run.Campaign.of(m, fdm.Run(mixed)).records
        assert np.array_equal(record.measured(), rows, equal_nan=True)
    rows[samples - 1, 2] = np.inf
    with pytest.raises(fdm.RunError, match=f"sample {samples - 1} of `y2` is inf"):
        fdm._run.Campaign.of(m, fdm.Run({n: rows[:, k] for k, n in enumerate(names)}))


def test_wrong_samples_are_refused_by_name(decay):
    t = np.arange(5.0)
    with pytest.raises(TypeError, match="`y` are no numbers"):
        fdm.Run(t=t, outputs={"y": ["a"] * 5})
    with pytest.raises(fdm.Error, match="`y` are no numbers"):
        fdm.Run({"t": t, "y": np.array(["a"] * 5)})
    with pytest.raises(ValueError, match=r"`y` have the shape \(5, 2\)"):
        fdm.Run(t=t, outputs={"y": np.zeros((5, 2))})
    with pytest.raises(fdm.RunError) as caught:
        decay.fit(fdm.Run(t=t[::-1], outputs={"yy": np.zeros(4)}))
    assert len(caught.value.faults) == 3 and "did you mean `y`?" in str(caught.value)
    with pytest.raises(TypeError, match="not int"):
        fdm.Run(5)
    with pytest.raises(KeyError, match="no column `speed`"):
        fdm.Run({"t": t, "y": t}, map={"y": "speed"})
    with pytest.raises(TypeError, match="a file has its own"):
        fdm.Run("a.csv", t=t)


def test_what_is_masked_was_not_measured(decay):
    t = 0.1 * np.arange(60.0)
    y = 3 * np.exp(-0.8 * t)
    bad = np.arange(60) % 7 == 3
    masked = np.ma.array(np.where(bad, 1e6, y), mask=bad)
    missing = np.where(bad, np.nan, y)
    assert np.array_equal(fdm.Run(t=t, outputs={"y": masked})["y"], missing, equal_nan=True)
    assert np.array_equal(fdm.Run(t=t, outputs={"y": (masked, "1")})["y"], missing, equal_nan=True)
    assert np.array_equal(fdm.Run(t=t, outputs={"y": np.ma.array(y)})["y"], y)
    with pytest.raises(fdm.Error, match="some of which are masked"):
        fdm.Run(t=np.ma.array(np.arange(60).astype("datetime64[s]"), mask=bad), outputs={"y": y})


def test_a_run_begins_where_it_is_said(decay):
    t, k = np.arange(5.0, 12.0, 0.5), 0.3
    y = np.exp(-k * t)
    y[2] = np.nan
    # x is 1 at 0, and the first sample comes at 5
    early = decay.fit(fdm.Run({"t": t, "y": y}, begin=0.0))
    assert early.params["k"].value == pytest.approx(k, rel=1e-6)
    with pytest.raises(fdm.RunError, match="behind its first sample"):
        decay.fit(fdm.Run({"t": t, "y": y}, begin=6.0))


def test_a_beginning_that_a_clock_cannot_mean_is_refused(decay):
    t = 1.7e9 + np.arange(0.0, 12.0, 0.5)
    with pytest.raises(fdm.RunError, match="times its length"):
        decay.fit(fdm.Run({"t": t, "y": np.exp(-0.3 * (t - t[0]))}, begin=0.0))
