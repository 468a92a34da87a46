"""Shared set-ups of the tests that draw: a short mission in a sheared current, and its store."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from logs import stored

from factory.samples import Flight
from factory.samples.gliders import write_seaglider
from twin.__main__ import PROGRAM
from twin.mission import Mission, SawTooth
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.records.mission_dataset import dataset_of
from twin.records.store import write_store
from twin.records.tracks import NamedTrack
from twin.records.trajectory import Trajectory
from twin.show.render.context import available_backend
from twin.show.render.subject import Shot, Subject
from twin.show.web.page import page_text
from twin.vehicle.vehicle import load_vehicle
from twin.water.current.profile import Profile

needs_gl = pytest.mark.skipif(
    available_backend() is None, reason="this machine has no OpenGL without a screen"
)
SHEAR = Profile(depth=(0.0, 30.0, 60.0), north=(0.25, 0.10, 0.0), east=(0.0, 0.15, 0.10))
PLAN = Mission(
    name="short",
    start_heading_deg=40,
    segments=(SawTooth(max_depth_m=40, pitch_deg=35, heading_deg=40, yos=1),),
)
DURATION = 300.0
DAY = 86400.0
"""[s]"""
PLACED = {
    "start_latitude": 49.9,
    "start_longitude": -5.9,
    "start_time": "2003-08-01T00:00:00",
}
"""Where and when it began: south-west of Cornwall"""


def short_scenario() -> Scenario:
    """One yo to 40 m."""
    return Scenario(vehicle=load_vehicle("glider"), mission=PLAN, duration=DURATION, current=SHEAR)


def measured(trajectory: Trajectory) -> Trajectory:
    """The trajectory with a place and plausible sensors; GPS only at the surface, a DVL in two
    modes, a CTD.
    """
    generator = np.random.default_rng(0)
    signals = dict(trajectory.signals)
    count = len(trajectory.time)
    for name in ("pitch", "roll", "heading", "depth", "yaw_rate", "specific_force_x"):
        signals[f"measured_{name}"] = signals[f"true_{name}"] + 0.1 * generator.normal(size=count)
    for name in ("surge", "sway", "heave"):
        signals[f"measured_dvl_{name}"] = signals[f"true_{name}"] + 0.01
    signals["measured_dvl_mode"] = np.where(np.arange(count) < count // 2, 2.0, 1.0)
    for name in ("north", "east"):
        signals[f"measured_onboard_{name}"] = signals[f"true_{name}"] * 1.1
        fix = np.where(signals["true_depth"] < 1.0, signals[f"true_{name}"] + 3.0, np.nan)
        signals[f"measured_gps_{name}"] = fix
    signals["measured_temperature"] = 16.0 - 0.1 * signals["true_depth"]
    signals["measured_salinity"] = 35.0 + 0.01 * signals["true_depth"]
    return Trajectory(
        time=trajectory.time, signals=signals, states=trajectory.states, provenance=dict(PLACED)
    )


def dead_reckoned(trajectory: Trajectory) -> tuple[NamedTrack, ...]:
    """Two tracks that drift away to either side."""
    time, north, east = trajectory.time, trajectory["true_north"], trajectory["true_east"]
    aside = 40.0 * time / time[-1]
    return (
        NamedTrack(name="network", time=time, north=north + aside, east=east - aside),
        NamedTrack(name="steady_flight", time=time, north=north - aside, east=east + aside),
    )


def month() -> Subject:
    """A made-up glider that dives to 1000 m for 30 days, with a sample every 4 s."""
    time = np.arange(0.0, 30 * DAY, 4.0)
    wave = np.sin(2 * np.pi * time / 12_000.0)
    depth = 500.0 * (1.0 - np.cos(2 * np.pi * time / 12_000.0))
    signals = {
        "true_north": 0.3 * time, "true_east": 2000.0 * np.sin(time / DAY), "true_depth": depth,
        "true_roll": 3.0 * wave, "true_pitch": 25.0 * wave, "true_heading": (time / 500.0) % 360.0,
        "true_surge": 0.3 + 0.01 * wave, "true_sway": 0.01 * wave, "true_heave": 0.02 * wave,
        "true_velocity_north": np.full_like(time, 0.3), "true_velocity_east": 0.1 * wave,
        "true_net_mass": 0.2 * wave, "true_current_north": 0.1 * wave,
        "true_current_east": 0.1 - 0.05 * wave,
    }  # fmt: skip
    trajectory = Trajectory(time=time, signals=signals, states=np.zeros((0, 0)))
    return Subject(trajectory=trajectory, vehicle=load_vehicle("glider"), title="a month")


def short_subject() -> Subject:
    """The mission as the subject of pictures, without tracks."""
    scenario = short_scenario()
    return Subject(trajectory=simulate(scenario), vehicle=scenario.vehicle, title="short")


def write_short_store(path: Path) -> Path:
    """A store of two missions, as `twin simulate` writes it."""
    scenario = short_scenario()
    trajectory = measured(simulate(scenario))
    attributes = {"scenario": json.dumps(scenario.describe())}
    return write_store(dataset_of([trajectory, trajectory], attributes=attributes), path)


def write_dives(folder: Path, dives: int) -> Path:
    """A store of dives of an imaginary Seaglider, with a CTD and currents."""
    files = write_seaglider(folder, Flight(dives=dives), "SG1")
    return stored(folder / "dives.zarr", "seaglider", files)


def call(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    """Exit code, output and errors of `twin`."""
    code = PROGRAM.main([str(word) for word in words])
    out = capsys.readouterr()
    return code, out.out, out.err


def refused(capsys: pytest.CaptureFixture[str], *words: object, code: int = 2) -> str:
    """The one line with which `twin` refuses words, saying nothing else."""
    found, out, err = call(capsys, *words)
    assert (found, out) == (code, "")
    (line,) = err.strip().splitlines()
    return line


def write_page(path: Path, subject: Subject, **shot: Any) -> Path:
    """A page of a subject at this path."""
    path.write_text(page_text(subject, Shot(**shot)), encoding="utf-8")
    return path


def write_tracks(path: Path, trajectory: Trajectory) -> Path:
    """The dead-reckoned tracks as a file that commands read."""
    arrays = {"time": trajectory.time}
    for track in dead_reckoned(trajectory):
        arrays |= {f"{track.name}_north": track.north, f"{track.name}_east": track.east}
    np.savez(path, **arrays)
    return path


def unpack(packed: dict[str, Any]) -> np.ndarray:
    """The numbers of `twin.show.web.solid.pack`, shape (n,); NaN where there was none."""
    kind = np.dtype(packed["type"])
    whole = np.frombuffer(base64.b64decode(packed["data"]), kind.newbyteorder("<"))
    values = packed["offset"] + packed["step"] * whole.astype(float)
    return np.where(whole == np.iinfo(kind).min, np.nan, values)
