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

way = np.hypot(store.true_surge, store.true_heave)  # [m/s] through the water
missions = xr.Dataset(
    {
        "hours": store.duration / 3600,
        "speed": way.mean("time"),
        "deepest": store.true_depth.max("time"),
        "current": np.hypot(store.true_current_north, store.true_current_east).mean("time"),
        "compass": abs(store.measured_heading - store.true_heading).where(lambda e: e < 180).mean("time"),
    }
).compute()
print(missions.to_dataframe()[[*missions]].round(2).to_string())

# Speed by depth: bins of 20 m over all missions, dives and climbs apart.
figure, axes = plt.subplots(figsize=(6, 4.4), layout="constrained")
for sign, label in ((-1, "dives"), (1, "climbs")):
    chosen = way.where((store.true_pitch * sign > 10) & (store.true_depth > 5))
    flat = xr.Dataset({"speed": chosen, "depth": store.true_depth}).stack(sample=("mission", "time"))
    groups = flat.speed.groupby_bins(flat.depth, np.arange(0, 201, 20))
    middle = [interval.mid for interval in groups.mean().depth_bins.values]
    axes.errorbar(groups.mean(), middle, xerr=groups.std(), fmt="o-", capsize=3, label=label)
axes.invert_yaxis()
axes.set(xlabel="speed through the water [m/s]", ylabel="depth [m]", title="Six hours of missions")
axes.legend()
figure.savefig("store_with_xarray.png", dpi=150)
