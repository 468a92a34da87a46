"""Vehicle file with the airbrake of airbrake.py and the hull law of slender.py: own.xml."""

from pathlib import Path

from twin.vehicle.additions import with_law, with_part

vehicle = with_part(
    "glider",
    "airbrake",
    kind="airbrake",
    travel=(0.0, 1.0),
    lag=1.0,
    rate=0.5,
    place=(-0.2, 0.0, 0.1),
    numbers={"drag_area": 0.02},
)
vehicle = with_law(vehicle, "slender", {"slender": (7, 440, 800, 60, 5, 50)})
Path("own.xml").write_text(vehicle.xml)
