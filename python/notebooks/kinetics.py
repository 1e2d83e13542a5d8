# %% [markdown]
# # Reaction kinetics with profile intervals
#
# Alpha-pinene isomerises along five paths. Eight samples of five concentrations give five rates. How well are they known, and do the
# intervals hold?

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import fdm

models = next(p for p in [Path.cwd(), *Path.cwd().parents] if (p / "models").is_dir()) / "models" / "pinene"
model, run = fdm.Model(models / "model.fdm"), fdm.Run.read(models / "run.csv")
print(model)
print([p.name for p in model.parameters.values()])

# %%
fit = model.fit(run, progress=False)
print(fit)
fit.plot()
plt.close("all")

# %% [markdown]
# ## Profiles
# A parameter is moved, all others are fitted anew, until the cost has risen by what noise explains. Such intervals need no
# symmetry.

# %%
name = next(p.name for p in fit.params.values() if p.status == "estimated")
profiles = model.profile(run, name, progress=False)
print(profiles)
low, high = profiles.intervals[name]
assert low is not None and high is not None and low < fit.params[name].value < high
profiles.plot()
plt.close("all")

# %% [markdown]
# ## Do the intervals hold?
# A Monte Carlo study repeats the fit with other noise, and counts how often the truth is inside.

# %%
study = model.study(run, repeats=60, seed=1, progress=False)
print(study)
assert study.converged >= 55

# %% [markdown]
# ## Another optimiser
# The same residuals, with their exact Jacobian, in SciPy: the same minimum.

# %%
from fdm.adapters import scipy_least_squares

deviations = dict(zip([o.name for o in model.outputs], np.sqrt(np.diag(fit.noise_cov))))
found = scipy_least_squares(model.prepare(run, noise=deviations))
for key, value in zip(found.names, found.x):
    print(f"{key}: fdm {fit.params[key].value:.6g}, SciPy {value:.6g}")
    assert abs(value - fit.params[key].value) < 0.1 * fit.params[key].std_error
