"""A glider crosses an eddy: what does the water do to a straight course?

The eddy is written to a netCDF file as an ocean model would, with velocities on a grid of latitude
and longitude, and the glider flies in that file. Its guidance knows the heading, not the eddy.
"""

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

import twin

LATITUDE, LONGITUDE, RADIUS, SPEED = 45.0, -20.0, 6000.0, 0.25  # [degree], [m], [m/s]

latitude = LATITUDE + np.linspace(-0.2, 0.2, 61)
longitude = LONGITUDE + np.linspace(-0.3, 0.3, 61)
north = (latitude - LATITUDE)[:, None] * 111_130.0
east = (longitude - LONGITUDE)[None, :] * 111_320.0 * np.cos(np.radians(LATITUDE))
distance = np.hypot(north, east) / RADIUS
swirl = SPEED / RADIUS * np.exp(0.5 * (1 - distance**2))  # fastest at one radius
u, v = -swirl * north, swirl * east  # anticlockwise: a cyclone
grid = {"lat": latitude, "lon": longitude}
eddy = xr.Dataset({"u": (("lat", "lon"), u), "v": (("lat", "lon"), v)}, coords=grid)
eddy.u.attrs["units"] = eddy.v.attrs["units"] = "m s-1"
eddy.lat.attrs["units"], eddy.lon.attrs["units"] = "degrees_north", "degrees_east"
eddy.to_netcdf("eddy.nc")

mission = twin.Mission(
    duration_s=14 * 3600.0,
    segments=(twin.SawTooth(max_depth_m=150, pitch_deg=26, heading_deg=90),),
)
figure, axes = plt.subplots(figsize=(7, 4.8), layout="constrained")
thin = slice(None, None, 3)
arrows = axes.quiver(
    longitude[thin],
    latitude[thin],
    u[thin, thin],
    v[thin, thin],
    color="0.6",
    scale=4,
    width=0.004,
)
axes.quiverkey(arrows, 0.9, 0.95, SPEED, f"current of {SPEED} m/s", labelpos="W")
for offset in (0.06, 0.0, -0.06):
    start = {"latitude": LATITUDE + offset, "longitude": LONGITUDE - 0.17}
    run = twin.simulate(mission=mission, current="grid:eddy.nc", start=start, sample_period=20)
    track = run.geographic_position()
    axes.plot(track[1], track[0], lw=2, label=f"from {LATITUDE + offset:.2f}° N")
    axes.plot(track[1][0], track[0][0], "o", color=axes.lines[-1].get_color())
    bent = run["true_north"][-1]
    print(f"start {offset:+.2f} degree: ends {bent:+6.0f} m north of its course")
axes.legend(loc="lower right", fontsize="small", title="glider, 14 h")
axes.set(xlabel="longitude [degree]", ylabel="latitude [degree]", title="Course east, in an eddy")
axes.set(xlim=(LONGITUDE - 0.22, LONGITUDE + 0.22), ylim=(LATITUDE - 0.16, LATITUDE + 0.16))
axes.locator_params(nbins=5)
axes.set_aspect(1 / np.cos(np.radians(LATITUDE)))
figure.savefig("glider_in_an_eddy.png", dpi=150)
