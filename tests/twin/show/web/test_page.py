"""The page of `twin render --html`: what is in it, how exactly, how large, and what is refused."""

import dataclasses
import json
import re
from collections import Counter
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pictures import (
    dead_reckoned,
    month,
    short_scenario,
    unpack,
    write_tracks,
)

from twin.__main__ import PROGRAM
from twin.errors import InputError
from twin.faults.hull import WingLost
from twin.logs import logged_trajectory
from twin.physics.simulation import simulate
from twin.records.store import read_trajectory
from twin.records.trajectory import Trajectory
from twin.show.render.playback import poses
from twin.show.render.subject import Shot, Subject
from twin.show.web.channels import read_channels, thin
from twin.show.web.page import LARGEST, ROWS, describe, page_text
from twin.show.web.solid import lathe, pack, read_solid, smooth_normals
from twin.vehicle.presets import vehicle_names
from twin.vehicle.vehicle import load_vehicle


def mission_of(text: str) -> dict[str, Any]:
    """The data that a page holds."""
    (data,) = re.findall(r'<script type="application/json" id="mission">(.*?)</script>', text, re.S)
    return json.loads(data)


def channel(mission: dict[str, Any], name: str) -> np.ndarray:
    return unpack(mission["channels"][name])


@given(
    st.lists(st.floats(-1e5, 1e5) | st.just(float("nan")), min_size=1, max_size=50),
    st.sampled_from([1e-3, 0.01, 0.5]),
)
def test_what_is_packed_comes_back_within_half_a_step(values, step):
    array = np.array(values)
    found = unpack(pack(array, step))
    np.testing.assert_array_equal(np.isnan(found), np.isnan(array))
    known = np.isfinite(array)
    assert np.abs(found[known] - array[known]).max(initial=0.0) <= 0.501 * step + 1e-9


def test_too_wide_a_range_for_its_step_is_refused():
    with pytest.raises(InputError, match="from 0 to 1e"):
        pack(np.array([0.0, 1e12]), 1e-3)


def test_thinning_keeps_every_turn_of_a_dive():
    time = np.arange(100_000)
    depth = 100.0 * np.abs((time / 2000.0) % 2.0 - 1.0)
    kept = thin(depth, 1000)
    assert len(kept) <= 1000
    assert kept[0] == 0
    assert kept[-1] == len(depth) - 1
    turns = np.flatnonzero((np.diff(depth)[1:] * np.diff(depth)[:-1]) < 0) + 1
    assert np.isin(turns, kept).all()
    np.testing.assert_array_equal(thin(depth, len(depth)), time)


def test_a_page_of_a_simulated_mission_holds_what_the_store_holds(page, store):
    mission = mission_of(page.read_text())
    trajectory = read_trajectory(store, 0)
    assert len(channel(mission, "time")) == len(trajectory.time)
    signals = {"north": 1.0, "east": 1.0, "depth": 1.0, "surge": 1.0, "net_mass": 1.0}
    for name in (*signals, "roll", "pitch", "heading", "current_north", "current_east"):
        step = mission["channels"][name]["step"]
        away = channel(mission, name) - trajectory[f"true_{name}"]
        if name == "heading":
            away = (away + 180.0) % 360.0 - 180.0
        assert np.abs(away).max() <= 0.502 * step + 1e-9, name
    ground = np.hypot(trajectory["true_velocity_north"], trajectory["true_velocity_east"])
    assert np.abs(channel(mission, "ground_speed") - ground).max() <= 0.51e-4
    found = poses(trajectory, trajectory.time)
    for i, part in enumerate(mission["parts"]):
        packed = mission["channels"][part["name"]]
        assert np.abs(unpack(packed) - found.parts[:, i]).max() <= 0.502 * packed["step"]
    assert mission["notes"][0].startswith(f"All {len(trajectory.time)} samples")


def test_a_page_of_a_log_holds_its_corrected_track_and_says_so(dives, tmp_path):
    out = tmp_path / "log.html"
    assert PROGRAM.main(["render", str(dives), "--missions", "all", "--out", str(out)]) == 0
    mission = mission_of(out.read_text())
    log = logged_trajectory(dives, [0, 1, 2])
    known = np.isfinite(log["true_north"]) & np.isfinite(log["true_depth"])
    for name in ("north", "east", "depth"):
        away = channel(mission, name)[known] - log[f"true_{name}"][known]
        assert np.abs(away).max() <= 0.0051
    assert "net_mass" not in mission["channels"]
    assert "pumped" in mission["channels"]
    assert any(fact.startswith("track: corrected") for fact in mission["facts"])
    assert mission["unix"] is not None


def test_a_page_loads_nothing(store, tmp_path):
    trajectory = read_trajectory(store, 0)
    tracks = write_tracks(tmp_path / "tracks.npz", trajectory)
    out = tmp_path / "dive.html"
    words = ["--tracks", str(tracks), "--title", "</script><b>&"]
    assert PROGRAM.main(["render", str(store), "--html", str(out), *words]) == 0
    text = out.read_text()
    assert not re.search(r"https?:|src=|href=|@import|url\(", text)
    assert "default-src 'none'" in text
    assert mission_of(text)["title"] == "</script><b>&"
    names = [track["name"] for track in mission_of(text)["tracks"]]
    assert names == ["network", "steady flight"]
    track = mission_of(text)["tracks"][0]
    expected = dead_reckoned(trajectory)[0]
    assert np.abs(unpack(track["north"]) - expected.north).max() <= 0.0051


def test_the_page_of_a_long_log_stays_small():
    subject = month()
    time, depth = subject.trajectory.time, subject.trajectory["true_depth"]
    text = page_text(subject, Shot())
    assert len(text.encode()) <= LARGEST
    mission = mission_of(text)
    rows = channel(mission, "time")
    assert 0.9 * ROWS < len(rows) <= ROWS
    assert rows[0] == 0.0
    assert rows[-1] == time[-1]
    assert np.isin(np.rint(rows), time).all()
    # what the page says of its thinning is true
    said = re.search(r"([\d.]+) m of depth", " ".join(mission["notes"]))
    assert said is not None
    away = np.abs(np.interp(time, rows, channel(mission, "depth")) - depth).max()
    assert away <= float(said[1]) + 0.06
    assert len(page_text(subject, Shot(), largest=1_000_000).encode()) <= 1_000_000


def test_a_part_and_a_moment_are_kept(store):
    trajectory = read_trajectory(store, 0)
    subject = Subject(trajectory=trajectory, vehicle=load_vehicle("glider"))
    mission = describe(subject, Shot(start=50.0, end=150.0, camera="map"), 10_000, 120.0)
    times = channel(mission, "time")
    assert (times[0], times[-1]) == (50.0, 150.0)
    assert (mission["opening"]["time"], mission["opening"]["camera"]) == (120.0, "map")
    with pytest.raises(InputError, match="outside the shown part"):
        describe(subject, Shot(start=50.0, end=150.0), 10_000, 170.0)


def test_the_sea_floor_is_in_the_page_with_the_altitude():
    from twin.physics.model_block import floor_table
    from twin.water.floor import parse_floor

    scenario = dataclasses.replace(short_scenario(), floor=parse_floor("depth:60"))
    trajectory = simulate(scenario)
    subject = Subject(
        trajectory=trajectory,
        vehicle=scenario.vehicle,
        floor=floor_table(scenario, scenario.run_time()),
    )
    mission = describe(subject, Shot(), 10_000)
    assert mission["floor"] is not None
    np.testing.assert_allclose(unpack(mission["floor"]["depths"]), 60.0, atol=0.051)
    np.testing.assert_allclose(channel(mission, "bottom"), 60.0, atol=0.026)


def test_still_water_has_no_current(subject):
    signals = {
        name: np.zeros_like(v) if "current" in name else v for name, v in subject.trajectory.items()
    }
    still = dataclasses.replace(subject.trajectory, signals=signals)
    mission = describe(dataclasses.replace(subject, trajectory=still), Shot(), 10_000)
    assert mission["profile"] is None
    assert "current_north" not in mission["channels"]


def test_a_mission_without_positions_is_refused():
    time = np.arange(10.0)
    bare = Trajectory(time=time, signals={"true_depth": time}, states=np.zeros((0, 0)))
    with pytest.raises(InputError, match="no signal true_north"):
        read_channels(bare, np.ones(10, bool), time, None, 100)


@pytest.mark.parametrize("name", vehicle_names())
def test_every_vehicle_has_its_shape(name):
    vehicle = load_vehicle(name)
    bodies = read_solid(vehicle)
    hull = bodies[0]
    assert hull.parent == -1
    length = np.ptp(hull.corners[..., 0])
    assert 0.8 * vehicle.hull_length < length < 1.8 * vehicle.hull_length
    for body in bodies:
        assert len(body.corners) == len(body.normals) == len(body.colours)
        np.testing.assert_allclose(np.linalg.norm(body.normals, axis=-1), 1.0, atol=1e-9)
    moved = {move["part"] for body in bodies for move in body.moves}
    model = mujoco.MjModel.from_xml_string(vehicle.xml)
    joints = {model.joint(k).name for k in range(model.njnt)} - {"hull"}
    assert joints <= moved
    drawn = {part.name for part in vehicle.parts if part.drawn_axis is not None}
    named = {model.body(k).name for k in range(model.nbody)}
    assert drawn & named <= moved


def test_normals_are_smooth_on_a_round_side_and_sharp_at_an_edge():
    angle = np.linspace(0, 2 * np.pi, 37)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    low, high = (np.column_stack([ring, np.full(37, z)]) for z in (0.0, 1.0))
    a, b, c, d = low[:-1], low[1:], high[1:], high[:-1]
    lid = np.stack([np.tile([0.0, 0.0, 1.0], (36, 1)), d, c], axis=1)
    corners = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1), lid])
    normals = smooth_normals(corners)
    side = normals[:72]
    outward = corners[:72] * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(side, outward, atol=0.05)
    np.testing.assert_allclose(
        normals[72:], np.broadcast_to([0.0, 0.0, 1.0], (36, 3, 3)), atol=1e-9
    )


def test_a_turned_body_is_closed_and_of_its_volume():
    """Each edge, both ways once, is of two triangles; the volume by the divergence theorem."""
    arc = np.linspace(0.0, np.pi, 41)
    corners = lathe(np.stack([np.sin(arc), np.cos(arc)], axis=-1))
    a, b, c = corners.swapaxes(0, 1)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    assert volume == pytest.approx(4.0 / 3.0 * np.pi, rel=0.02)
    places = np.unique(np.rint(corners.reshape(-1, 3) * 1e6), axis=0, return_inverse=True)[1]
    triangles = places.reshape(-1, 3)
    edges = Counter(pair for t in triangles.tolist() for pair in zip(t, t[1:] + t[:1], strict=True))
    assert set(edges.values()) == {1}
    assert all((last, first) in edges for first, last in edges)


def test_a_lost_wing_is_a_body_that_ends():
    vehicle = load_vehicle("glider")
    whole = read_solid(vehicle)
    torn = read_solid(vehicle, [WingLost(side="port", start=150.0)])
    assert [body.until for body in torn] == [np.inf] * len(whole) + [150.0]
    wing = torn[-1]
    assert torn[wing.parent].parent == -1
    # the port wing alone, and nothing of the vehicle twice or not at all
    assert (wing.corners[..., 1] > 0.08).all()
    assert sum(len(body.corners) for body in torn) == sum(len(body.corners) for body in whole)
