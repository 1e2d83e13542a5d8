# %% [markdown]
# # From flight records to a validated model
#
# A helicopter of 6 kg was flown with swept controls. We look at the frequency responses of the first half of the record, fit a
# model to them, and validate it with the second half.

# %%
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import fdm

models = next(p for p in [Path.cwd(), *Path.cwd().parents] if (p / "models").is_dir()) / "models" / "trex550"
model = fdm.Model(models / "model.fdm")
first, second = models / "first_half.csv", models / "second_half.csv"
print(model)

# %% [markdown]
# ## What the record holds
# A response can be trusted where the coherence is high.

# %%
spectra = model.spectra(first, band=(0.2, 8.0))
for output, input in spectra.pairs:
    coherent = (spectra.coherence(output, input) > 0.6).mean()
    print(f"{output} / {input}: {100 * coherent:.0f} % of the frequencies have a coherence above 0.6")
spectra.plot()
plt.close("all")

# %% [markdown]
# ## Fit in the frequency domain
# Magnitudes and phases are weighted by their coherence.

# %%
with warnings.catch_warnings():
    warnings.simplefilter("ignore", fdm.ResultWarning)
    responses = model.fit(first, method="frequency-response", progress=False)
print(responses.params)
responses.plot_bode()
plt.close("all")

# %% [markdown]
# ## Fit in the time domain, and the second half as validation

# %%
with warnings.catch_warnings():
    warnings.simplefilter("ignore", fdm.ResultWarning)
    fit = model.fit(first, validation=second, progress=False)
print(fit)
assert fit.validation is not None
for output in fit.validation.outputs:
    print(f"{output.name}: R^2 {output.r2:.3f} of a record that was not fitted")
fit.plot()
fit.validation.plot()
plt.close("all")

# %% [markdown]
# ## The linear model
# Poles with standard errors, and a state space for control design.

# %%
print(model.modes(fit.values()).table("dict")["frequency"])
linear = fit.linear()
assert np.isfinite(linear.poles).all() and linear.A.shape == (len(model.states),) * 2

# %% [markdown]
# The page has everything: `fit.report("flight.html")`; the folder is read by the command too: `fit.save("flight")`.

# %%
assert fit.report().startswith("<!DOCTYPE html>")
