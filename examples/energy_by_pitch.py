"""At which pitch does a kilometre cost least, and what does a stronger current change?

A Seaglider flies one yo to 200 m at each pitch, against currents of no, 0.1 and 0.2 m/s. The
energy is all that electronics, pump and battery drives take; the way is that over ground.
"""

import matplotlib.pyplot as plt
import numpy as np

import twin

pitches = [11, 14, 17, 20, 23, 26, 30, 35, 40, 50]  # [degree]
currents = [0.0, 0.1, 0.2]  # [m/s], against the glider
vehicle = twin.load_vehicle("seaglider")


def scenario(pitch: float, current: float) -> twin.Scenario:
    """One yo to the north, in a current to the south."""
    dive = twin.SawTooth(max_depth_m=200, pitch_deg=pitch, heading_deg=0, yos=1)
    return twin.Scenario(
        vehicle=vehicle,
        mission=twin.Mission(segments=(dive,)),
        current=twin.Uniform(north=-current, east=0.0),
    )


flown = twin.simulate_many([scenario(p, c) for c in currents for p in pitches], threads=2)
parts = ("hotel", "pump", "shift", "rotation")
taken = [sum(run[f"true_energy_{part}"][-1] for part in parts) for run in flown]  # [J]
north = np.array([run["true_north"][-1] for run in flown])  # [m]
cost = np.where(north > 0.0, taken / np.abs(north), np.inf)  # [J/m], so kJ/km; no way costs all
cost = cost.reshape(len(currents), -1)

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for current, row in zip(currents, cost, strict=True):
    axes.plot(pitches, row, "o-", label=f"{current:g} m/s against it")
    print(f"against {current:4.2f} m/s: {row.min():.1f} kJ/km at {pitches[row.argmin()]} degree")
axes.set(xlabel="pitch [degree]", ylabel="energy over ground [kJ/km]", yscale="log")
axes.set_title("What a kilometre costs a Seaglider")
axes.grid(alpha=0.3)
axes.legend()
figure.savefig("energy_by_pitch.png", dpi=150)
