"""Two small networks learn a glider's velocities and dead-reckon a mission that they never saw.

Eight hours of missions are flown, two networks are trained for a few seconds of computing, and
the track of an unseen mission is reckoned from attitude, depth and their velocities.
"""

import matplotlib.pyplot as plt
import numpy as np

import factory
import learn
import twin
from twin.navigation.dead_reckoning import AttitudeSeries, true_water_track, water_track

PERIOD = 0.5  # [s]

if __name__ == "__main__":
    factory.generate("missions.zarr", hours=8, seed=5, workers=2, overwrite=True)
    run = learn.fit("missions.zarr", folder="run", members=1, seconds=2, overwrite=True)

    figure, axes = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
    print("mission  way m   error at its end m   % of the way")
    for flown in run.predict("missions.zarr", split="test"):
        signals = twin.open_trajectory("missions.zarr", flown.mission)
        truth = true_water_track(signals, PERIOD)
        attitude = AttitudeSeries.of(signals)
        reckoned = water_track(flown.surge, flown.sway, signals["measured_depth"], attitude, PERIOD)
        error = np.hypot(*(reckoned - truth).T)
        way = np.hypot(*np.diff(truth, axis=0).T).sum()
        print(f"{flown.mission:7d}  {way:5.0f}   {error[-1]:18.2f}   {100 * error[-1] / way:.3f}")
        axes[1].plot(flown.time / 60, error)
    axes[0].plot(truth[:, 1], truth[:, 0], lw=3, color="0.7", label="truth")
    axes[0].plot(reckoned[:, 1], reckoned[:, 0], lw=1, label="networks")
    axes[0].set(xlabel="east [m]", ylabel="north [m]", title="One unseen mission")
    axes[0].axis("equal")
    axes[0].legend()
    axes[1].set(xlabel="time [min]", ylabel="error [m]", title="All of them")
    figure.savefig("train_and_dead_reckon.png", dpi=150)
