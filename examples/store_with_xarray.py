"""A store of missions is plain zarr: what was drawn, and what came of it, with xarray alone.

Six hours of randomised missions are flown. Then nothing of this project is needed: every
signal has its unit, and everything that was drawn stands beside it.
"""

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

import factory

factory.generate("missions.zarr", preset="field", hours=6, seed=11, workers=2, overwrite=True)

store = xr.open_zarr("missions.zarr")
print(store["measured_pitch"].attrs["long_name"], "in", store["measured_pitch"].attrs["units"])

speed = np.hypot(store.true_surge, store.true_heave)  # [m/s] through the water
compass = (store.measured_heading - store.true_heading + 180) % 360 - 180
missions = xr.Dataset(
    {
        "hours": store.duration / 3600,
        "speed": speed.mean("time"),
        "deepest": store.true_depth.max("time"),
        "current": np.hypot(store.true_current_north, store.true_current_east).mean("time"),
        "compass": compass.std("time"),
    }
)
print(missions.to_dataframe()[[*missions]].round(2).to_string())

# Speed by depth over all missions, dives and climbs apart.
figure, axes = plt.subplots(figsize=(6, 4.4), layout="constrained")
for sign, label in ((-1, "dives"), (1, "climbs")):
    chosen = speed.where((store.true_pitch * sign > 10) & (store.true_depth > 5))
    table = xr.Dataset({"speed": chosen, "depth": store.true_depth}).to_dataframe().dropna()
    groups = table.groupby(20 * (table.depth // 20) + 10).speed
    axes.errorbar(groups.mean(), groups.mean().index, xerr=groups.std(), fmt="o-", label=label)
axes.invert_yaxis()
axes.set(xlabel="speed through the water [m/s]", ylabel="depth [m]", title="Six hours of missions")
axes.legend()
figure.savefig("store_with_xarray.png", dpi=150)
