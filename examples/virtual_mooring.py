"""A glider keeps station for eighteen hours in a tide: a virtual mooring.

It dives to 100 m and comes up every hour for a fix. Under water it does not know the
current, only what the last dives told. How near to its place does it come up?
"""

import matplotlib.pyplot as plt
import numpy as np

import twin

mission = twin.Mission(
    name="virtual mooring",
    at_end="hold",  # fly to the last target again and again
    duration_s=18 * 3600.0,
    segments=(
        twin.Waypoint(
            targets=[{"north_m": 0.0, "east_m": 0.0}],
            max_depth_m=100,
            pitch_deg=26,
            surface_after_s=3600,
            surface_at_target=False,
        ),
    ),
)
run = twin.simulate(
    mission=mission,
    vehicle="slocum-200",
    current="tide:m2=0.15,minor=0.05,direction=60+uniform:0.04,0.02",
    start={"latitude": 54.0, "longitude": -12.0},
    sample_period=10.0,
)

# It comes up where the depth passes one metre on the way up. A drifter goes with the water.
depth, position = run["true_depth"], run.position[:, :2]
up = np.flatnonzero((depth[1:] < 1.0) & (depth[:-1] >= 1.0)) + 1
away = np.hypot(*position[up].T)
current = np.stack([run["true_current_north"], run["true_current_east"]], axis=1)
drifter = np.hypot(*np.cumsum(current * 10.0, axis=0).T)
print(f"{len(up)} surfacings, {np.median(away):.0f} m from the mooring in the median")
print(f"the farthest {away.max():.0f} m; a drifter comes to {drifter.max():.0f} m")

figure, axes = plt.subplots(1, 2, figsize=(9, 4.2), layout="constrained")
hours = run.time / 3600
axes[0].plot(position[:, 1], position[:, 0], lw=0.6, color="0.6", label="track")
axes[0].scatter(position[up, 1], position[up, 0], c=hours[up], zorder=3)
axes[0].plot(0, 0, "k+", ms=14, mew=2, label="mooring")
axes[0].set(xlabel="east [m]", ylabel="north [m]", title="Eighteen hours in a tide")
axes[0].axis("equal")
axes[0].legend()
axes[1].plot(hours, drifter / 1000, "0.6", label="drifter")
axes[1].scatter(hours[up], away / 1000, c=hours[up], zorder=3, label="surfacings")
axes[1].set(xlabel="time [h]", ylabel="distance from the mooring [km]")
axes[1].legend()
figure.savefig("virtual_mooring.png", dpi=150)
