"""Which glider flies how fast, and how flat? The glide polars of the shipped vehicles.

Each curve is one vehicle with the net mass of its usual dive, at pitches from 14 to 60 degree: its
steady speed forward against the speed at which it sinks. The dot is its usual dive.
"""

import math

import matplotlib.pyplot as plt
import numpy as np

import twin
from twin.mission.glide_balance import steady_glide

pitches = np.radians(np.arange(14, 61, 2))
figure, axes = plt.subplots(figsize=(8, 4.2), layout="constrained")
print(f"{'vehicle':12} {'net mass kg':>11} {'forward m/s':>11} {'down m/s':>9} {'glide slope':>11}")
for name in ("seaglider", "slocum-200", "slocum-1000", "spray", "seaexplorer", "glider"):
    vehicle = twin.load_vehicle(name)
    usual, net_mass = vehicle.usual_glide
    glides = [steady_glide(vehicle, -pitch, net_mass) for pitch in (*pitches, usual)]
    down = np.array([glide.vertical_speed for glide in glides])
    forward = np.sqrt(np.array([glide.speed for glide in glides]) ** 2 - down**2)
    (line,) = axes.plot(forward[:-1], down[:-1], label=f"{name}, {net_mass:g} kg")
    axes.plot(forward[-1], down[-1], "o", color=line.get_color())
    slope = math.degrees(math.atan2(down[-1], forward[-1]))
    print(f"{name:12} {net_mass:11.2f} {forward[-1]:11.3f} {down[-1]:9.3f} {slope:8.0f} deg")

axes.invert_yaxis()
axes.set(xlabel="speed forward [m/s]", ylabel="speed down [m/s]", title="Glide polars")
axes.grid(alpha=0.3)
figure.legend(loc="outside right upper")
figure.savefig("compare_vehicles.png", dpi=150)
