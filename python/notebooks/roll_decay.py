# %% [markdown]
# # Roll decay of a tanker, and what a linear model lacks
#
# A tanker model was heeled in a towing tank and let go. The record has 6674 samples of the roll angle. We fit a linear model, ask what it
# lacks, and compare with the model that the answer gives.

# %%
from pathlib import Path

import matplotlib.pyplot as plt

import fdm

models = next(p for p in [Path.cwd(), *Path.cwd().parents] if (p / "models").is_dir()) / "models" / "ship_roll_decay"
run = fdm.Run.read(models / "run.csv")

# %% [markdown]
# ## A linear model
# Restoring moment and damping are proportional to angle and rate. The text is checked when it is read: names, units, every derivative.

# %%
linear = fdm.model("""
model roll_linear "tanker in free roll, linear" {
  state phi "roll angle" [rad]   = free;
  state p   "roll rate"  [rad/s] = free;

  param omega2 = 6.0  in [0, 100] [1/s^2] "restoring moment / inertia";
  param d1     = 0.02 in [0, 10]  [1/s]   "linear damping";

  der(phi) = p;
  der(p)   = -omega2*phi - d1*p;

  output roll "measured roll angle" [deg] = rad2deg(phi);
}
""")
fit = linear.fit(run)
print(fit)

# %%
fit.plot()
fit.plot_residuals()
plt.close("all")

# %% [markdown]
# The residual swings with the ship: its autocorrelation is far outside of its bounds. What is missing?

# %%
diagnosis = linear.diagnose(run, only=["quadratic_damping", "cubic_stiffness"], progress=False)
print(diagnosis.verdict)
for cause in diagnosis.causes:
    print(cause.effect, cause.targets, f"{cause.loss:.0f}")
assert diagnosis.verdict == "effect_found" and diagnosis.extended is not None
diagnosis.plot()
plt.close("all")

# %% [markdown]
# The extended model is our own text with new lines. It is a model like any other.

# %%
print(diagnosis.extended.text)
better = diagnosis.extended.fit(run)
print(better.params)
before, after = fit.outputs[0].rms, better.outputs[0].rms
print(f"RMS of the residual {before:.3f} deg, then {after:.3f} deg")
assert after < before / 3

# %% [markdown]
# Errors hold for coloured residuals too: `corrected` is the one to be trusted.

# %%
for name in ("omega2", "d1"):
    p = better.params[name]
    print(f"{name}: {p.value:.5g} {p.unit}, Cramer-Rao {p.std_error:.2g}, corrected {p.corrected:.2g}, 95 % {p.interval}")
assert all(p.corrected > p.std_error for p in better.params.values() if p.corrected)
