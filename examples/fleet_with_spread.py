"""Fifty gliders are built alike, but not quite: how far apart do they surface?

Each glider's drag differs by some per cent from the drawing. Its guidance trusts the drawing.
All of them meet the same tide, and each its own share of a steady current.
"""

import matplotlib.pyplot as plt
import numpy as np

import twin

GLIDERS = 50
drawn = twin.load_vehicle("glider")
mission = twin.Mission(
    segments=(twin.SawTooth(max_depth_m=60, pitch_deg=25, heading_deg=90, yos=1),)
)
tide = twin.parse_current("tide:m2=0.2,direction=30")
random = np.random.default_rng(7)

scenarios = [
    twin.Scenario(
        vehicle=drawn.replace(drag=tuple(np.array(drawn.law.drag) * random.normal(1.0, 0.05))),
        believed=drawn,
        mission=mission,
        current=tide + twin.Uniform(north=random.normal(0.05, 0.02), east=0.0),
        start={"latitude": 36.8, "longitude": -121.8},
    )
    for _ in range(GLIDERS)
]
runs = twin.simulate_many(scenarios, threads=2)

# A run that leaves the finite numbers comes back as an error; here none does.
flown = [run for run in runs if isinstance(run, twin.Trajectory)]
ends = np.array([run.position[-1, :2] for run in flown])
print(f"{len(flown)} of {GLIDERS} gliders flew the mission")
print(f"they surface around {ends.mean(axis=0).round()} m north and east of the start")
print(f"with a standard deviation of {ends.std(axis=0).round(1)} m")

figure, axes = plt.subplots(figsize=(6, 4.6), layout="constrained")
for run in flown:
    axes.plot(run["true_east"], run["true_north"], color="0.7", lw=0.6)
axes.plot(ends[:, 1], ends[:, 0], "o", ms=4, label="surfacings")
axes.set(xlabel="east [m]", ylabel="north [m]", title="Fifty gliders, one mission")
axes.legend()
figure.savefig("fleet_with_spread.png", dpi=150)
