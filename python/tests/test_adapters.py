"""Adapters, each against its real package; one whose package is missing is left out."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
import pytest
from conftest import MODELS, rolling

import fdm
from fdm import adapters


@pytest.fixture(scope="module")
def residuals(roll):
    return roll.prepare(rolling(roll), noise={"p_m": 0.3, "phi_m": 0.005})


@pytest.fixture(scope="module")
def best(roll):
    fit = roll.fit(rolling(roll), noise={"p_m": 0.3, "phi_m": 0.005})
    return np.array([fit.params[n].value for n in ("d", "k", "b")]), fit


def test_scipy(residuals, best):
    pytest.importorskip("scipy")
    found = adapters.scipy_least_squares(residuals)
    assert np.allclose(found.x, best[0], rtol=1e-5) and found.names == ["d", "k", "b"]
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    assert np.allclose(covariance, best[1].cov_cramer_rao, rtol=1e-3)


def test_scipy_steps_back_from_what_cannot_be_simulated():
    """y = log(1 - a t) has no value beyond t = 1/a: steps from where the record is nearly flat go there."""
    pytest.importorskip("scipy")
    m = fdm.Model.from_text("model m { state x; param a = 0.1 in [0.01, 50]; der(x) = a; output y = log(1 - x); }")
    t = np.linspace(0, 1, 41)
    residuals = m.prepare(fdm.Run(t=t, outputs={"y": np.log(1 - 0.98 * t)}))
    with pytest.raises(fdm.NumericalError):
        residuals.r([40.0])
    # a step that SciPy would take without knowing where it ends
    with pytest.raises(fdm.NumericalError):
        adapters.scipy_least_squares(residuals, strict=True)
    found = adapters.scipy_least_squares(residuals)
    assert found.success and found.x == pytest.approx([0.98], rel=1e-6)
    with pytest.raises(fdm.NumericalError):
        adapters.scipy_least_squares(residuals, x0=[40.0])


def test_control(roll, best):
    control = pytest.importorskip("control")
    system = adapters.control_ss(best[1])
    assert np.allclose(np.sort_complex(control.poles(system)), np.sort_complex(best[1].linear().poles))
    assert system.state_labels == ["p", "phi"] and system.input_labels == ["aileron"]
    t = np.linspace(0, 5, 200)
    step = control.forced_response(system, t, np.full(200, 2.0)).outputs
    ours = best[1].simulate(fdm.Run(t=t, inputs={"aileron": np.full(200, 2.0)})).outputs.T
    assert np.allclose(step, ours, atol=1e-3 * np.abs(ours).max())
    with pytest.raises(ValueError, match="act later"):
        roll.extend("input_delay(aileron)").linear().to_control()


def test_emcee(residuals, best):
    emcee = pytest.importorskip("emcee")
    density = adapters.emcee_log_density(residuals)
    assert density([-1.0, 1.0, 1.0]) == -np.inf
    rng = np.random.default_rng(1)
    np.random.seed(1)
    start = best[0] + 1e-3 * rng.standard_normal((16, 3))
    sampler = emcee.EnsembleSampler(16, 3, density)
    sampler.run_mcmc(start, 400, progress=False)
    chain = sampler.get_chain(discard=150, flat=True)
    errors = np.sqrt(np.diag(best[1].cov_cramer_rao))
    assert np.all(np.abs(chain.mean(0) - best[0]) < 0.4 * errors)
    assert np.allclose(chain.std(0), errors, rtol=0.35)


def test_jax(residuals):
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    function = adapters.jax_residuals(residuals)
    half = jax.jit(lambda theta: 0.5 * (function(theta) ** 2).sum())
    r, J = residuals()
    assert float(half(residuals.start)) == pytest.approx(0.5 * r @ r)
    assert np.allclose(jax.grad(half)(residuals.start), r @ J)


def test_sklearn(roll):
    pytest.importorskip("sklearn")
    from sklearn.base import clone
    from sklearn.model_selection import LeaveOneOut, cross_val_score

    runs = np.empty(4, dtype=object)
    runs[:] = [rolling(roll, seed=k, name=f"r{k}") for k in range(4)]
    estimator = adapters.sklearn_estimator(roll, fix=[])
    scores = cross_val_score(clone(estimator), runs, cv=LeaveOneOut())
    assert scores.shape == (4,) and np.all(scores > 0.97)
    # a wrong model predicts worse
    wrong = cross_val_score(adapters.sklearn_estimator(roll, set={"k": 0.1}, fix=["k"]), runs, cv=LeaveOneOut())
    assert wrong.mean() < scores.mean() - 0.05
    estimator.fit(runs[:3])
    assert estimator.predict(runs[3:])[0].shape == (800, 2)


@pytest.mark.filterwarnings("ignore")
def test_pypesto(residuals, best):
    pypesto = pytest.importorskip("pypesto")
    optimize = pytest.importorskip("pypesto.optimize")
    objective = adapters.pypesto_objective(residuals, log10=True)
    x = np.log10([0.6, 1.7, 2.0])
    checked = objective.check_grad(x, eps=1e-5, verbosity=0)
    assert np.abs(checked["rel_err"]).max() < 1e-4
    assert np.allclose(objective(x, sensi_orders=(2,)), objective(x, mode="mode_res", sensi_orders=(1,)).T @ objective(x, mode="mode_res", sensi_orders=(1,)))
    low, high = np.full(3, -1.0), np.full(3, 1.5)
    problem = pypesto.Problem(objective, low, high, x_scales=["log10"] * 3)
    found = optimize.minimize(problem, optimize.ScipyOptimizer("ls_trf"), n_starts=5, progress_bar=False)
    assert 10 ** found.optimize_result[0].x == pytest.approx(best[0], rel=1e-4)
    assert objective(found.optimize_result[0].x) == pytest.approx(-best[1].log_likelihood, rel=1e-6)
    assert list(problem.x_names) == ["d", "k", "b"]
    free = adapters.pypesto_objective(residuals, estimate_noise=True)
    assert np.abs(free.check_grad(10**x, eps=1e-5, mode="mode_fun", verbosity=0)["rel_err"]).max() < 1e-4


@pytest.mark.filterwarnings("ignore")
def test_pypesto_reaches_the_best_known_minimum():
    """Boehm and others 2014, from a copy of the PEtab benchmark collection (`FDM_PETAB`): many starts reach its published likelihood."""
    folder = os.environ.get("FDM_PETAB")
    if not folder:
        pytest.skip("FDM_PETAB names no copy of the benchmark collection")
    pypesto = pytest.importorskip("pypesto")
    optimize = pytest.importorskip("pypesto.optimize")
    pandas = pytest.importorskip("pandas")
    table = pandas.read_csv(next(Path(folder).glob("Boehm*/measurementData_*.tsv")), sep="\t")
    m = fdm.Model(MODELS / "petab/boehm.fdm")
    wide = table.pivot_table(index="time", columns="observableId", values="measurement")
    residuals = m.prepare(fdm.Run(wide), integrator="radau")
    objective = adapters.pypesto_objective(residuals, log10=True, estimate_noise=True)
    low, high = (np.log10(b) for b in residuals.bounds)
    problem = pypesto.Problem(objective, low, high, x_scales=["log10"] * len(low))
    np.random.seed(1)
    found = optimize.minimize(problem, optimize.ScipyOptimizer("L-BFGS-B"), n_starts=30, progress_bar=False)
    # minus the logarithm of the likelihood at the parameters of the collection
    assert found.optimize_result[0].fval < 138.221_997 + 1e-3


@pytest.mark.filterwarnings("ignore")
def test_pymc_agrees_with_the_reference_posterior():
    """Lynx and hare: NUTS with the priors of the reference, against the posterior that stands beside the model."""
    pymc = pytest.importorskip("pymc")
    pt = pytest.importorskip("pytensor.tensor")
    import pytensor

    m = fdm.Model(MODELS / "lynx_hare/model.fdm")
    residuals = m.prepare(MODELS / "lynx_hare/run.csv")
    op = adapters.pymc_op(residuals)
    at, factors = pt.dvector(), pt.dvector()
    function = pytensor.function([at, factors], pt.grad(op(at, factors), [at, factors]), mode="FAST_COMPILE")
    theta, sigma = residuals.start * 1.02, np.array([0.3, 0.4])
    gradient = np.concatenate(function(theta, sigma))
    value = pytensor.function([at, factors], op(at, factors), mode="FAST_COMPILE")
    both = np.concatenate([theta, sigma])
    for k in range(len(both)):
        step = np.zeros(len(both))
        step[k] = 1e-5 * max(1e-2, abs(both[k]))
        up, down = both + step, both - step
        difference = (value(up[:6], up[6:]) - value(down[:6], down[6:])) / (2 * step[k])
        assert gradient[k] == pytest.approx(difference, rel=1e-4, abs=1e-4)

    found = m.fit(MODELS / "lynx_hare/run.csv")
    start = {n: found.params[n].value for n in residuals.names}
    with pymc.Model():
        rates = [pymc.TruncatedNormal(n, mean, deviation, lower=0, initval=start[n]) for n, mean, deviation in
                 [("alpha", 1, 0.5), ("beta", 0.05, 0.05), ("gamma", 1, 0.5), ("delta", 0.05, 0.05)]]  # fmt: skip
        initial = [pymc.Normal(n, np.log(10), 1, initval=start[n]) for n in ("hare0", "lynx0")]
        sigma = [pymc.LogNormal(f"sigma_{k}", -1, 1, initval=0.25) for k in range(2)]
        pymc.Potential("data", op(pt.stack(rates + initial), pt.stack(sigma)))
        trace = pymc.sample(500, tune=500, chains=2, cores=1, random_seed=1, progressbar=False, compute_convergence_checks=False)
    reference = {row["name"]: row for row in _reference()}
    drawn = [trace.posterior[n].values.ravel() for n in ("alpha", "beta", "gamma", "delta")]
    for k, values in enumerate(drawn, start=1):
        mean, deviation = reference[f"theta[{k}]"]["mean"], reference[f"theta[{k}]"]["sd"]
        # a thousand draws that hang together are worth some hundred
        assert abs(values.mean() - mean) < 0.3 * deviation
        assert values.std() == pytest.approx(deviation, rel=0.25)


def _reference():
    with open(MODELS / "lynx_hare/reference_posterior.csv") as file:
        for row in csv.DictReader(file):
            yield {"name": row[""], "mean": float(row["mean"]), "sd": float(row["sd"])}
