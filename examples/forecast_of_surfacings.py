"""Where will it surface next, and how surely? Forty members of a forecast, flown.

Nothing is known of the current, so each member draws one. The ellipses hold 50 and 90 % of the
surfacings to expect.
"""

import matplotlib.pyplot as plt
from matplotlib.patches import Ellipse

import twin
from glider_twin_ops.forecast import Request, forecast, known_without_logs, mission_to

LATITUDE, LONGITUDE = 36.80, -122.20
UNIX_TIME = 1_795_000_000.0  # [s] in November 2026, for the tide

mission = mission_to("36.84,-122.20", depth=80, pitch_deg=26, surface_after_s=1800, radius=300)
request = Request(
    vehicle=twin.load_vehicle("slocum-200"),
    mission=mission,
    place=twin.Origin(latitude_deg=LATITUDE, longitude_deg=LONGITUDE, time="2026-11-18T12:00"),
    hours=1.8,
    members=40,
)
found = forecast(request, known_without_logs(LATITUDE, UNIX_TIME), threads=2)

figure, axes = plt.subplots(figsize=(6, 5.6), layout="constrained")
axes.plot(0, 0, "k^", ms=9, label="start")
print("surfacing  time               north m  east m  90 % ellipse m   energy kJ")
for one in found.surfacings:
    (dots,) = axes.plot(*one.members.T[::-1], ".", ms=5, label=f"surfacing {one.number}")
    for part in (0.5, 0.9):
        shape = one.ellipse(part)
        size = 2 * shape.semi_minor_m, 2 * shape.semi_major_m
        outline = Ellipse((one.east, one.north), *size, angle=-shape.bearing_deg, fill=False)
        outline.set_edgecolor(dots.get_color())
        axes.add_patch(outline)
    ellipse = one.ellipse(0.9)
    print(
        f"{one.number:9d}  {found.moment(one.time_s):17}  {one.north:7.0f} {one.east:7.0f}"
        f"  {ellipse.semi_major_m:5.0f} x {ellipse.semi_minor_m:5.0f}  {one.energy_kj:10.1f}"
    )
axes.set(xlabel="east [m]", ylabel="north [m]", title="Surfacings of forty members", aspect="equal")
axes.grid(alpha=0.3)
axes.legend()
figure.savefig("forecast_of_surfacings.png", dpi=150)
