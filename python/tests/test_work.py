"""Long work: interruption, progress, threads, forks; and the other commands."""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import signal
import threading
import time
import warnings

import matplotlib.pyplot as plt
import numpy as np
import pytest
from conftest import MODELS, command, decaying, plain, rolling

import fdm

# a process that a shell has started behind `&` ignores interrupts
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="module")
def slow():
    """A model and run whose fit with many starts takes a minute or more."""
    m = fdm.Model(MODELS / "lynx_hare/model.fdm")
    return m, MODELS / "lynx_hare/run.csv"


def test_ctrl_c_keeps_the_best_so_far(slow):
    m, run = slow
    timer = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))
    begun = time.monotonic()
    timer.start()
    with pytest.warns(fdm.InterruptedWarning):
        fit = m.fit(run, starts=100_000, progress=False)
    assert fit.interrupted and not fit.good and time.monotonic() - begun < 20
    assert all(np.isfinite(p.value) for p in fit.params.values())
    # afterwards nothing is left of it
    assert not m.fit(run, progress=False).interrupted


def test_ctrl_c_of_work_without_a_result_is_raised(tanker_run):
    m, pressed = fdm.Model(MODELS / "ship_roll_decay/linear.fdm"), []

    def press(state):
        if not pressed:
            pressed.append(True)
            os.kill(os.getpid(), signal.SIGINT)

    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt, match="before there was a result"):
        m.diagnose(tanker_run, progress=press)
    assert pressed and time.monotonic() - begun < 30


def test_time_limit(slow):
    m, run = slow
    begun = time.monotonic()
    with pytest.warns(fdm.ResultWarning):
        fit = m.fit(run, starts=100_000, time_limit=0.5, progress=False)
    assert time.monotonic() - begun < 20 and not fit.good and not fit.interrupted


def test_progress_is_told_and_may_stop_the_work(slow):
    m, run = slow
    seen = []

    def look(state):
        seen.append(state)
        if len(seen) == 5:
            raise StopIteration

    with pytest.warns(fdm.InterruptedWarning):
        fit = m.fit(run, starts=100_000, progress=look)
    assert fit.interrupted and len(seen) == 5
    assert set(seen[0]) == {"doing", "iteration", "cost", "step", "values", "done", "total"}
    assert seen[-1]["total"] in (None, 100_000)

    def fail(state):
        raise ZeroDivisionError("in the user's own function")

    with pytest.raises(ZeroDivisionError):
        m.fit(run, starts=100_000, progress=fail)
    with pytest.raises(TypeError, match="progress"):
        m.fit(run, progress=5)


def test_tqdm_is_driven(slow):
    tqdm = pytest.importorskip("tqdm")
    m, run = slow
    with open(os.devnull, "w") as nowhere, tqdm.tqdm(total=1, file=nowhere) as bar:
        m.study(run, repeats=60, progress=bar)
        assert bar.n > 1 or bar.total == 60 or bar.n == 0
    fit = m.fit(run, progress=tqdm.tqdm)
    assert fit.converged


def test_rich_is_driven(slow):
    progress = pytest.importorskip("rich.progress")
    m, run = slow
    with open(os.devnull, "w") as nowhere:
        shown = progress.Progress(console=pytest.importorskip("rich.console").Console(file=nowhere))
        study = m.study(run, repeats=40, progress=shown)
    [task] = shown.tasks
    assert study.good and task.total == 40 and task.completed == 40 and "study" in task.description


def test_a_sub_interpreter_is_refused_or_works():
    """NumPy has no sub-interpreters: fdm must neither crash nor hang there, and go on working here."""
    import subprocess
    import sys

    program = """
try:
    import _interpreters as inner
except ImportError:
    import _xxsubinterpreters as inner
import fdm
own = inner.create()
said = "try:\\n    import fdm\\nexcept ImportError as e:\\n    print('refused', e)\\nelse:\\n    print('works')"
inner.run_string(own, said)
inner.destroy(own)
m = fdm.Model.from_text("model d { param k = 1; output y = k; }")
print(m.simulate({"y": [0.0, 0.0]})["y"])
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=120)
    assert ended.returncode == 0, ended.stderr
    first, last = ended.stdout.splitlines()[0], ended.stdout.splitlines()[-1]
    assert first.startswith(("refused", "works")) and last == "[1. 1.]"


def test_threads_work_at_once_and_give_the_same_bits(decay):
    runs = [decaying(seed=k) for k in range(8)]
    alone = [decay.fit(run, progress=False).params["k"].value for run in runs]
    found = [None] * 8

    def work(k):
        for _ in range(5):
            found[k] = decay.fit(runs[k], progress=False).params["k"].value

    workers = [threading.Thread(target=work, args=(k,)) for k in range(8)]
    [w.start() for w in workers]
    [w.join(60) for w in workers]
    assert found == alone


def test_the_lock_is_released(slow):
    """A thread of Python goes on while a fit works."""
    m, run = slow
    counted, ended = 0, threading.Event()

    def work():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            m.fit(run, starts=100_000, time_limit=1.0, progress=False)
        ended.set()

    worker = threading.Thread(target=work)
    worker.start()
    while not ended.is_set():
        counted += 1
        time.sleep(0.001)
    worker.join()
    assert counted > 100


def test_bits_do_not_depend_on_the_number_of_threads(tanker, tanker_run, tanker_fit):
    before = fdm.threads()
    try:
        for count in (1, 3):
            fdm.set_threads(count)
            assert fdm.threads() == count
            assert dict(tanker.fit(tanker_run, starts=1).files)["result.json"] == dict(tanker_fit.files)["result.json"]
    finally:
        fdm.set_threads(before)


def _in_child(state):
    model, run = pickle.loads(state)
    return model.fit(run, progress=False).params["k"].value


@pytest.mark.parametrize("way", ["fork", "spawn"])
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_child_processes(decay, way):
    run = decaying()
    here = decay.fit(run, progress=False).params["k"].value
    with multiprocessing.get_context(way).Pool(2) as pool:
        there = pool.map_async(_in_child, [pickle.dumps((decay, run))] * 2).get(120)
    assert there == [here, here]


def test_models_are_pickled_as_they_are(roll):
    m = roll.changed(set={"d": 0.7}, fix="k")
    again = pickle.loads(pickle.dumps(m))
    assert again.parameters == m.parameters and again.text == m.text and again.name == "roll"


def test_residuals_are_written_where_they_are_wanted(roll):
    run = rolling(roll)
    residuals = roll.prepare(run, noise={"p_m": 0.3, "phi_m": 0.005})
    r, J = residuals()
    assert r.shape == (1600,) and J.shape == (1600, 3) and residuals.names == ["d", "k", "b"]
    for g in range(3):
        step = np.eye(3)[g] * 1e-6
        difference = (residuals.r(residuals.start + step) - residuals.r(residuals.start - step)) / 2e-6
        assert np.allclose(difference, J[:, g], rtol=1e-5, atol=1e-5 * np.abs(J[:, g]).max())
    into = np.empty(1600), np.empty((1600, 3))
    given = residuals(residuals.start, out=into)
    assert given[0] is into[0] and given[1] is into[1] and np.array_equal(into[1], J)
    # another order or shape would scramble the Jacobian
    columns = np.empty((1600, 3), order="F")
    for wrong in (columns, np.empty((3, 1600)), np.empty((1600, 6))[:, ::2], np.empty((1600, 3), np.float32)):
        with pytest.raises((TypeError, ValueError)):
            residuals(residuals.start, out=(np.empty(1600), wrong))
    with pytest.raises((TypeError, ValueError)):
        residuals(residuals.start, out=(np.empty(3200)[::2], np.empty((1600, 3))))
    locked = np.empty((1600, 3))
    locked.flags.writeable = False
    with pytest.raises((TypeError, ValueError)):
        residuals(residuals.start, out=(np.empty(1600), locked))
    again = roll.residuals(run, {"d": 0.5})
    assert again[0].shape == r.shape
    value, gradient = residuals.gradient(residuals.start)
    assert value == residuals.log_likelihood(residuals.start) and np.allclose(gradient, -r @ J)
    with pytest.raises(ValueError, match="2 parameters, expected 3"):
        residuals([1.0, 2.0])
    with pytest.raises(KeyError, match="`dd` is not estimated"):
        residuals({"dd": 1.0})


def test_no_copy_of_a_jacobian_is_kept(roll):
    """The memory of residuals is that of the arrays that are given back."""
    import tracemalloc

    t = 0.01 * np.arange(200_000)
    run = fdm.Run(t=t, inputs={"aileron": np.sign(np.sin(t))}, outputs={"p_m": np.zeros_like(t), "phi_m": np.zeros_like(t)})
    residuals = roll.prepare(run)
    into = np.empty(len(residuals)), np.empty((len(residuals), 3))
    residuals(residuals.start, out=into)
    before = _resident()
    tracemalloc.start()
    for _ in range(3):
        residuals(residuals.start, out=into)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # the Jacobian alone has 9.6 MB
    assert peak < 100_000 and _resident() - before < 2_000_000


def _resident() -> int:
    pages = int(open("/proc/self/statm").read().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


# The other commands


def test_diagnosis_is_that_of_the_command(tmp_path):
    m, run = fdm.Model(MODELS / "ship_roll_decay/linear.fdm"), MODELS / "ship_roll_decay/run.csv"
    found = m.diagnose(run, every=5, only=["quadratic_damping", "cubic_stiffness"])
    ended = command("diagnose", m.file, "--data", run, "--every", "5", "--only", "quadratic_damping,cubic_stiffness", "--json", "--quiet")
    assert json.loads(ended.stdout) == json.loads(json.dumps(plain(found.document)))
    assert found.causes[0].effect == "cubic_stiffness" and found.verdict == "effect_found"
    assert found.extended is not None and "k_p_phi" in found.extended.parameters
    axes = found.plot()
    assert axes.shape == (1, 1) and len(axes[0, 0].lines) == 3
    found.save(tmp_path / "d")
    assert (tmp_path / "d/extended.fdm").read_text() == found.extended.text
    assert "<svg" in found._repr_html_() and found.report().startswith("<!DOCTYPE html>")
    plt.close("all")


def test_study_profile_and_design(roll):
    run = rolling(roll)
    study = roll.study(run, repeats=20, seed=3)
    assert study.converged == 20 and study.good and len(study.table()) == 20
    profiles = roll.profile(run, ["d", "k"])
    low, high = profiles.intervals["d"]
    assert low < 0.8 < high and profiles["k"].points[0].rise >= 0
    assert profiles.plot().shape == (2,)
    with pytest.raises(KeyError, match="was not profiled"):
        profiles["b"]
    fit = roll.fit(run)
    design = fit.design(run, next_runs=1, amplitude={"aileron": "0.1 rad"})
    [planned] = design.runs
    moved = planned["aileron"] - run["aileron"][0]
    assert np.abs(moved).max() == pytest.approx(np.degrees(0.1), rel=1e-4)
    assert roll.simulate(planned).outputs.shape == (len(planned), 2)
    plt.close("all")


def test_spectra_and_bode(roll):
    run = rolling(roll, n=4000)
    spectra = roll.spectra(run, band=(0.1, 2.0))
    response = spectra.response("p_m", "aileron")
    exact = roll.linear({"d": 0.8, "k": 2.0, "b": 3.0}).response(spectra.frequency)[:, 0, 0]
    trusted = spectra.coherence("p_m", "aileron") > 0.95
    assert trusted.sum() > 5 and np.allclose(response[trusted], exact[trusted], rtol=0.15)
    fit = roll.fit(run)
    assert fit.plot_bode(run, band=(0.1, 2.0)).shape == (2, 2) and spectra.plot().shape == (3, 2)
    plt.close("all")


def test_modes_check_effects_extend(roll):
    modes = roll.modes({"d": 0.4, "k": 2.0})
    assert np.allclose(sorted(modes.poles.imag), [-np.sqrt(2 - 0.04), np.sqrt(2 - 0.04)]) and len(modes.table()) == 2
    assert roll.check().good
    assert "input_delay" in str(roll.effects(only="input_delay"))
    delayed = roll.extend("input_delay(aileron)")
    assert len(delayed.parameters) == len(roll.parameters) + 1
    linear = delayed.linear()
    assert linear.delayed == ("aileron",)
    later = linear.response(0.5)[0, 0, 0] / roll.linear().response(0.5)[0, 0, 0]
    assert later == pytest.approx(np.exp(-2j * np.pi * 0.5 * linear.delays[0]))


def test_figures_are_axes_that_can_be_changed(tanker_fit):
    axes = tanker_fit.plot()
    assert axes.shape == (2, 1) and axes[0, 0].get_ylabel() == "roll [deg]"
    figure, own = plt.subplots(2, 1)
    assert tanker_fit.plot(axes=own, bands=False)[0, 0] is own[0]
    assert tanker_fit.plot_residuals().shape == (1, 3)
    plt.close("all")
    html = tanker_fit._repr_html_()
    assert "omega2" in html and "<svg" in html and "convergence" in "".join(tanker_fit.figures())


def test_figures_of_frequency_responses():
    m = fdm.Model(MODELS / "trex550/model.fdm")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = m.fit(MODELS / "trex550/first_half.csv", method="frequency-response")
    assert fit.plot_bode().shape[0] == 2
    plt.close("all")


def test_the_command_is_there():
    assert command("--version").stdout.startswith("fdm ")
    assert command("fit").returncode == 2
    assert command("check", "models/ship_roll_decay/model.fdm").returncode == 0


def test_ctrl_c_ends_the_command_with_the_best_so_far():
    import subprocess
    import sys

    words = ["fit", MODELS / "lynx_hare/model.fdm", "--data", MODELS / "lynx_hare/run.csv", "--starts", "100000"]
    process = subprocess.Popen([sys.executable, "-m", "fdm", *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(3)
    process.send_signal(signal.SIGINT)
    out, said = process.communicate(timeout=60)
    assert process.returncode == 1 and "Cramer-Rao" in out and "interrupted" in said


def test_draws_come_as_arrays_and_agree_with_the_fit(tmp_path):
    m = fdm.Model.from_text("model decay { state x = 1; param k = 0.3 [1/s], b = 0 per run; der(x) = -k*x; output y = x + b; }")
    fit = m.fit(decaying(), progress=False)
    draws = fit.sample(chains=2, draws=300, warmup=200, seed=2, bands=True, progress=False)
    assert draws.good, draws.text
    k = draws["k"]
    assert k.shape == (2, 300) and abs(k.mean() - fit.params["k"].value) < 0.5 * fit.params["k"].error
    assert draws["b", "decay"].shape == (2, 300) and (draws["noise y"] > 0).all()
    assert {"posterior", "sample_stats", "observed_data"} <= set(draws.arviz) and draws.arviz["sample_stats"]["diverging"].dtype == bool
    table = draws.table()
    assert len(table) == 600 and table["draw"].max() == 299
    assert draws.bands[0].name == "y" and len(draws.bands[0].time) == 200
    draws.save(tmp_path / "draws.json")
    assert json.loads((tmp_path / "draws.json").read_text())["posterior"]["k"][0][0] == k[0, 0]
    draws.report(tmp_path / "draws.html")
    assert "Traces and ranks" in (tmp_path / "draws.html").read_text()
    plt.close(draws.plot()[0, 0].figure)
    with pytest.raises(KeyError, match="there is no `q`"):
        draws["q"]
    # the same bits from a folder and with other threads
    fdm.set_threads(1)
    again = fit.sample(chains=2, draws=300, warmup=200, seed=2, progress=False)
    fdm.set_threads(None)
    assert (again["k"] == k).all()
    ranks = m.calibrate(decaying(n=40), repeats=2, warmup=50, progress=False)
    assert ranks.done == 2 and sum(ranks.parameters[0].counts) == 2
