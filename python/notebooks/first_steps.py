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
# # First steps
#
# A mass on a preloaded Hertzian contact, under white noise: q'' + 2 zeta q' + G(q) = f(t). Everything is dimensionless:
# displacement q in 2/3 of the static compression, time in 1/Omega, force in the static load. Contact is lost at
# q < -3/2.

# %%
import vibroimpact as vi

scene = vi.Scene(
    {
        "title": "first steps",
        "oscillator": {"zeta": 0.05, "h": 2e-2},
        "initial": {"mean": [1.0, 0.0], "deviation": [0.4, 0.4]},
        "outputs": {"stationary": True, "moments_at": {"every": 0.5, "until": 20}, "density_at": [2, 20]},
    }
)
scene

# %% [markdown]
# What would be computed, and what it would take:

# %%
print(vi.plan(scene))

# %%
r = vi.run(scene, progress=True)
r

# %% [markdown]
# A number has its error beside it; a curve is two arrays.

# %%
loss = r["stationary"]["contact_loss_probability"]
print("probability of contact loss in the stationary motion:", loss)
assert loss.error < 1e-9

t, rising = r["transient"]["t"], r["transient"]["contact_loss_probability"]
print(f"at t = {t[-1]:g}: {rising[-1]}, error at most {rising.error.max():.0e}")
assert abs(rising.value[-1] - loss.value) < 0.1

# %% [markdown]
# The density p(q, v), as an array and as a picture.

# %%
d = r.density(20)
print(d)
assert d.p.shape == (d.q.size, d.v.size)

# %%
d.plot()

# %% [markdown]
# The same scene on a rig, in newtons and hertz:

# %%
rig = {"static_load": 110.0, "frequency": 232.0, "static_compression": 7.0e-6}
on_rig = vi.run(vi.scene("stationary").replace("rig", rig))
print("deviation of the force:", on_rig["rig"]["std_force_n"], "N")
assert on_rig["rig"]["std_force_n"].value > 0

# %% [markdown]
# A scene that is wrong says what is wrong with it:

# %%
try:
    scene.replace("oscillator.zeta", -0.05)
except vi.SceneError as error:
    print(error)
    assert (error.key, error.value) == ("oscillator.zeta", "-0.05")
