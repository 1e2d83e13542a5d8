# %% [markdown]
# # Bring your own residual
#
# `Model.prepare` gives residuals and their exact Jacobian as arrays. Any optimiser or sampler of Python can use them, and they can be
# joined with residuals of your own.

# %%
import numpy as np
from scipy.optimize import least_squares

import fdm

model = fdm.model("""
model tank "a tank that empties through a hole" {
  input inflow [m^3/s];
  state h "level" [m] = 1;
  const g = 9.81 [m/s^2];
  param hole = 0.005 in [0.0001, 1] [m^2] "effective area of the hole", area = 1 in [0.1, 10] [m^2] "of the tank";
  der(h) = (inflow - hole*sqrt(2*g*max(h, 0)))/area;
  output level [m] = h;
  noise level = 0.005;
}
""")

rng = np.random.default_rng(4)
t = np.linspace(0, 120, 400)
inflow = np.where((t > 40) & (t < 80), 0.05, 0.0)
truth = model.simulate(fdm.Run(t=t, inputs={"inflow": inflow}), {"hole": 0.007, "area": 1.4})["level"]
run = fdm.Run(t=t, inputs={"inflow": inflow}, outputs={"level": truth + 0.005 * rng.standard_normal(t.size)})

# %% [markdown]
# ## SciPy, with a measurement of another kind
# Somebody has measured the area with a tape: 1.45 m^2, give or take 0.05. That is one residual more.

# %%
residuals = model.prepare(run)
k = residuals.names.index("area")


def r(theta):
    return np.append(residuals.r(theta), (theta[k] - 1.45) / 0.05)


def J(theta):
    return np.vstack([residuals.J(theta), np.eye(2)[k] / 0.05])


found = least_squares(r, residuals.start, jac=J, bounds=residuals.bounds, x_scale="jac")
covariance = np.linalg.inv(found.jac.T @ found.jac)
for name, value, error in zip(residuals.names, found.x, np.sqrt(np.diag(covariance))):
    print(f"{name} = {value:.5f} +- {error:.5f}")
assert abs(found.x[k] - 1.4) < 4 * np.sqrt(covariance[k, k])

# %% [markdown]
# The same knowledge can stand in the model, as `prior area ~ normal(1.45, 0.05);`. Then `fit` and the command know it too.

# %%
informed = fdm.Model.from_text(model.text.replace("noise level", "prior area ~ normal(1.45, 0.05);\n  noise level"))
fit = informed.fit(run, progress=False)
assert np.allclose([fit.params[n].value for n in residuals.names], found.x, rtol=1e-5)

# %% [markdown]
# ## The whole posterior
# With PyMC, `pymc_op` gives the log-likelihood with its gradient, so that NUTS can be used.

# %%
try:
    import pymc
    import pytensor.tensor as pt
except ImportError:
    print("PyMC is not installed")
else:
    from fdm.adapters import pymc_op

    with pymc.Model():
        hole = pymc.LogNormal("hole", np.log(0.007), 0.5, initval=found.x[0])
        area = pymc.Normal("area", 1.45, 0.05, initval=found.x[1])
        pymc.Potential("record", pymc_op(residuals)(pt.stack([hole, area])))
        trace = pymc.sample(300, tune=300, chains=2, cores=1, random_seed=1, progressbar=False, compute_convergence_checks=False)
    drawn = trace.posterior["area"].values.ravel()
    print(f"area = {drawn.mean():.4f} +- {drawn.std():.4f}")
    assert abs(drawn.mean() - found.x[k]) < np.sqrt(covariance[k, k])
