"""What does a log say of the current? Depth-averaged currents from fixes, beside the truth.

A glider with sensor errors flies dives between surfacings. Its flight model says how it moved
through the water, the fixes how it moved over ground; the current is the difference.
"""

import matplotlib.pyplot as plt
import numpy as np

import factory
import twin

factory.generate(
    "log.zarr",
    preset="field",
    hours=9,
    seed=4,
    changes={"mission.duration_h": 3, "vehicle.ballast_g": 0},
    workers=2,
    overwrite=True,
)
flight = twin.estimate_flight("log.zarr", vehicle="glider")
store = twin.open_store("log.zarr")

rows = []
for dive in flight.currents:
    samples = {"mission": dive.mission, "time": slice(dive.first, dive.last + 1)}
    truth = [float(store[f"true_current_{way}"].isel(samples).mean()) for way in ("north", "east")]
    rows.append([dive.mission, dive.north, truth[0], dive.east, truth[1], dive.deviation])
table = np.array(rows)

print("mission  north m/s (true)   east m/s (true)   deviation")
for mission, north, true_north, east, true_east, deviation in rows:
    ways = f"{north:+.3f} ({true_north:+.3f})    {east:+.3f} ({true_east:+.3f})"
    print(f"{mission:7d}  {ways}   {deviation:.3f}")
error = table[:, [1, 3]] - table[:, [2, 4]]
print(f"root mean square error {np.sqrt(np.mean(error**2)):.3f} m/s of {len(rows)} dives")

figure, axes = plt.subplots(figsize=(5.4, 5), layout="constrained")
for name, column in (("north", 1), ("east", 3)):
    axes.errorbar(table[:, column + 1], table[:, column], table[:, 5], fmt="o", label=name)
ends = axes.get_xlim()
axes.plot(ends, ends, "k", lw=0.8)
axes.set(xlabel="true mean current of the dive [m/s]", ylabel="current of the log [m/s]")
axes.set_title("Depth-averaged currents")
axes.legend()
figure.savefig("current_from_a_log.png", dpi=150)
