# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Contact loss over level and damping
#
# The stationary law depends on T = pi h/(2 zeta) alone: the probability of contact loss is constant along lines h/zeta.
# How long it takes to get there is another matter.

# %%
import numpy as np

import vibroimpact as vi

h = np.geomspace(2e-4, 2e-2, 25)
zeta = np.geomspace(2e-3, 5e-2, 21)

base = vi.Scene({"oscillator": {"zeta": zeta[0], "h": h[0]}})
m = vi.map(base, over={"oscillator.h": h, "oscillator.zeta": zeta})
loss, error = m["stationary.contact_loss_probability"].value, m["stationary.contact_loss_probability"].error
print(m)
print(f"{loss.size} scenes; the largest error is {error.max():.0e}")
assert loss.shape == (len(h), len(zeta)) and error.max() < 1e-9

# %% [markdown]
# It grows with the level and falls with the damping:

# %%
assert (np.diff(loss, axis=0) > 0).all() and (np.diff(loss, axis=1) < 0).all()

# %% [markdown]
# Along a line of constant h/zeta it is the same number:

# %%
line = [vi.run({"oscillator": {"zeta": z, "h": 0.4 * z}})["stationary"]["contact_loss_probability"] for z in zeta]
print(line[0], line[-1])
assert np.ptp([it.value for it in line]) < 1e-12

# %%
try:
    import matplotlib.pyplot as plt
except ImportError:
    print("pip install matplotlib for the picture")
else:
    figure, ax = plt.subplots()
    levels = [1e-12, 1e-8, 1e-4, 1e-2, 0.05, 0.1, 0.2, 0.3]
    contours = ax.contour(zeta, h, loss, levels=levels)
    ax.clabel(contours, fmt="%g")
    ax.set(xscale="log", yscale="log", xlabel="damping ratio zeta", ylabel="level h", title="P(contact loss)")
