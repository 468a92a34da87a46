"""Pictures: what is in them, whichever camera; framing; refusals."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from pictures import dead_reckoned, needs_gl, short_scenario
from PIL import Image

import twin
from twin.errors import InputError
from twin.faults.hull import WingLost
from twin.physics.true_signals import declare_parts
from twin.show.render import canvas as palette
from twin.show.render import hud, sea, tags
from twin.show.render.camera import (
    Frame,
    block_view,
    fit,
    nice_step,
    plan,
    principal_azimuth,
    ticks,
)
from twin.show.render.canvas import (
    BASE_WIDTH,
    LABEL,
    LEGEND,
    NAME,
    SMALLEST_FONT,
    TITLE,
    VALUE,
    Canvas,
)
from twin.show.render.film import save_still, still
from twin.show.render.painter import Painter
from twin.show.render.ribbon import ArrowProfile, ladder
from twin.show.render.shapes import GLIDER_GROUPS
from twin.show.render.subject import CAMERAS, Shot, read_subject
from twin.vehicle.vehicle import load_vehicle

SIZE = {"width": 256, "height": 144}
HIDDEN_GROUP = 4
"""No picture shows it"""
SEEN = 25
"""Summed difference of the colours from which a pixel has changed"""

every_camera = pytest.mark.parametrize("camera", CAMERAS)


@pytest.fixture(scope="module")
def with_tracks(subject):
    return dataclasses.replace(subject, tracks=dead_reckoned(subject.trajectory))


def painter_of(subject, at=(200.0,), **settings):
    shot = Shot(**{**SIZE, "hud": False, "inset": False, **settings})
    return Painter(subject, shot, np.array(at))


def without(painter, geoms, seen=SEEN):
    """Where the picture changes when these geoms are hidden: mask and the colours shown there."""
    model = painter.stage.model
    before, groups = painter.paint(0).astype(float), model.geom_group.copy()
    model.geom_group[list(geoms)] = HIDDEN_GROUP
    after = painter.paint(0)
    model.geom_group[:] = groups
    changed = np.abs(before - after).sum(axis=-1) > seen
    return changed, before[changed]


def geoms_named(painter, start):
    model = painter.stage.model
    return [i for i in range(model.ngeom) if (model.geom(i).name or "").startswith(start)]


@needs_gl
@every_camera
def test_a_still_shows_glider_ribbon_and_current(subject, camera):
    with painter_of(subject, camera=camera) as painter:
        frame = painter.paint(0)
        assert frame.shape == (144, 256, 3)
        assert len(np.unique(frame.reshape(-1, 3), axis=0)) > 150
        assert frame.std() > 5.0

        groups = painter.stage.model.geom_group
        hull, colours = without(painter, np.flatnonzero(np.isin(groups, GLIDER_GROUPS)))
        rows, columns = np.nonzero(hull)
        # 2 m of hull among hundreds of metres of sea must still be a glider to the eye.
        assert max(np.ptp(rows), np.ptp(columns)) > 14
        yellow = (colours[:, 0] > 120) & (colours[:, 2] < colours[:, 0] - 60)
        assert yellow.mean() > 0.2

        line = painter.stage.lines[0]
        ribbon, colours = without(painter, [*line.chunks, line.head], 6 * SEEN)
        assert ribbon.sum() > 40
        warm = colours[:, 0] > colours[:, 2] + 40.0  # the water is the other way round
        assert warm.mean() > 0.5

        arrows = geoms_named(painter, "ladder_" if camera == "chase" else "current_arrows")
        assert without(painter, arrows)[0].sum() > 30


@needs_gl
@every_camera
def test_dead_reckoned_tracks_are_drawn_in_their_colours(with_tracks, camera):
    with painter_of(with_tracks, camera=camera) as painter:
        if camera == "chase":  # the glider fills the picture; the tracks are metres away
            assert [line.name for line in painter.stage.lines] == [
                "truth", "network", "steady flight",
            ]  # fmt: skip
            return
        green = []
        for line in painter.stage.lines[1:]:
            mask, colours = without(painter, [*line.chunks, line.head])
            assert mask.sum() > 20
            strong = colours[np.argsort(colours.sum(axis=1))[-10:]].mean(axis=0)
            green.append(strong[1] - strong[0])
        assert green[0] > green[1] + 20.0  # the first is green; white is for the current


@needs_gl
def test_what_is_to_come_is_not_drawn_as_flown(subject):
    with painter_of(subject, at=(60.0, 250.0)) as painter:
        warm = []
        for index in range(2):
            frame = painter.paint(index).astype(int)
            warm.append(((frame[..., 0] > 150) & (frame[..., 2] < frame[..., 0] - 60)).sum())
    assert warm[1] > 1.5 * warm[0]


@needs_gl
def test_the_running_end_of_the_ribbon_has_the_colour_of_its_time(subject):
    at = (30.0, 200.0)
    with painter_of(subject, at=at) as painter:
        model, line = painter.stage.model, painter.stage.lines[0]
        mesh = model.geom_dataid[line.head]
        first, count = model.mesh_texcoordadr[mesh], model.mesh_texcoordnum[mesh]
        for index, time in enumerate(at):
            painter.paint(index)
            along = model.mesh_texcoord[first : first + count, 0]
            assert along.max() == pytest.approx(float(line.ribbon.along(np.array(time))), abs=1e-6)


@needs_gl
def test_a_frame_depends_on_its_index_only(subject):
    for camera in ("orbit", "chase"):
        with painter_of(subject, at=np.linspace(50.0, 60.0, 12), camera=camera) as painter:
            alone = painter.paint(7)
            for index in range(12):
                painter.paint(index)
            np.testing.assert_array_equal(painter.paint(7), alone)


@needs_gl
@every_camera
def test_the_display_is_drawn_and_changes_with_time(subject, camera):
    at = np.array([100.0, 200.0])
    shot = Shot(camera=camera, width=640, height=360)
    canvas = Canvas(width=640, height=360)
    with Painter(dataclasses.replace(subject, title="a title"), shot, at) as painter:
        frames = [painter.paint(i) for i in range(2)]
    values = [f[canvas.strip_top + canvas.px(34) :, : canvas.curve[0]] for f in frames]
    assert all((v.min(axis=-1) > 200).sum() > 150 for v in values)  # white letters
    assert (values[0] != values[1]).any(axis=-1).sum() > 100
    title = frames[0][: canvas.px(40), : canvas.px(200)]
    assert (title.min(axis=-1) > 200).sum() > 20
    legend = frames[0][canvas.strip_top - canvas.px(60) : canvas.strip_top, -canvas.px(270) :]
    colours = (255 * palette.track_colours(np.array([0.0, 1.0]), 0.0, 1.0)).astype(int)
    for colour in colours:  # both ends of the colour bar
        assert (np.abs(legend.astype(int) - colour).max(axis=-1) < 12).sum() > 3


@needs_gl
def test_a_wing_is_missing_from_when_it_is_lost(subject, tmp_path):
    scenario = dataclasses.replace(short_scenario(), faults=[WingLost(side="port", start=150.0)])
    store = twin.simulate(scenario).save(tmp_path / "faulty.zarr")
    faulty = dataclasses.replace(subject, faults=read_subject(store).faults)
    shot = Shot(**SIZE, hud=False, camera="chase")
    for time, lost in ((100.0, False), (200.0, True)):
        changed = still(faulty, shot, time) != still(subject, shot, time)
        assert bool(changed.any()) is lost
    with painter_of(subject, camera="chase") as painter:
        wing, _ = without(painter, geoms_named(painter, "vehicle/wing_port"))
    # what is gone is the port wing, and nothing else
    assert np.mean(changed.any(axis=-1)[wing]) > 0.95
    assert changed.any(axis=-1).sum() < 2.0 * wing.sum()
    assert WingLost(part=0.2).gone == ()
    assert WingLost(side="both").gone == ("wing_port", "wing_starboard")


@needs_gl
@pytest.mark.parametrize(("heading", "start"), [(0.0, (0.2, 3.0)), (90.0, (3.0, -0.2))])
def test_arrows_beside_the_glider_point_where_the_water_goes(heading, start):
    """They begin 3 m to port and 0.2 m ahead; the axes of a picture are north, west and up."""
    eastward = ArrowProfile(depth=np.array([0.0, 99.0]), velocity=np.array([[0.0, 0.2]] * 2))
    found = ladder(eastward, 50.0, np.radians(heading), 51.5)
    assert [depth for depth, _, _ in found] == [48.0, 49.0, 50.0, 51.0]
    for depth, place, arrow in found:
        np.testing.assert_allclose(place, [*start, 50.0 - depth], atol=1e-9)
        np.testing.assert_allclose(arrow, [0.0, -1.0, 0.0], atol=1e-9)


def test_the_close_up_shows_the_glider_large(subject):
    shot = Shot(width=640, height=360, hud=False)
    with Painter(subject, shot, np.array([200.0])) as painter:
        frame = painter.paint(0)
    left, top, wide, high = Canvas(width=640, height=360).inset
    inset = frame[top : top + high, left : left + wide].astype(int)
    yellow = (inset[..., 0] > 120) & (inset[..., 2] < inset[..., 0] - 60)
    assert np.ptp(np.nonzero(yellow)[1]) > 0.3 * wide


@needs_gl
@pytest.mark.parametrize("size", [(64, 64), (96, 200), (300, 80)])
def test_pictures_of_any_shape(with_tracks, size):
    for camera in ("orbit", "map"):
        shot = Shot(camera=camera, width=size[0], height=size[1])
        frame = still(with_tracks, shot, at=150.0)
        assert frame.shape == (size[1], size[0], 3)
        assert frame.std() > 3.0


GOLDEN_SHOT = Shot(width=320, height=180, camera="side")
GOLDEN_BLOCKS = 4
"""[pixel] over which both pictures are averaged: rasterisers differ at edges, not in areas"""
MEAN_LIMIT, WORST_LIMIT = 2.0, 25.0
"""Largest mean and 99.5th percentile of the difference, of 255"""


def blocks(picture):
    height, width, _ = picture.shape
    shape = (height // GOLDEN_BLOCKS, GOLDEN_BLOCKS, width // GOLDEN_BLOCKS, GOLDEN_BLOCKS, 3)
    return picture.astype(float).reshape(shape).mean(axis=(1, 3))


@needs_gl
def test_the_golden_still(with_tracks, request, tmp_path):
    """The same picture as in golden_side.png; delete that file's successor only after a look."""
    golden = np.asarray(Image.open(request.path.with_name("golden_side.png")).convert("RGB"))
    drawn = tmp_path / "drawn.png"
    save_still(drawn, with_tracks, GOLDEN_SHOT, at=200.0)
    now = np.asarray(Image.open(drawn))

    def distance(picture):
        apart = np.abs(blocks(picture) - blocks(golden))
        return apart.mean(), np.percentile(apart, 99.5)

    mean, worst = distance(now)
    assert mean < MEAN_LIMIT, f"look at {drawn}"
    assert worst < WORST_LIMIT, f"look at {drawn}"
    # The limits tell pictures apart: a minute and a half earlier is another one.
    mean, worst = distance(still(with_tracks, GOLDEN_SHOT, at=110.0))
    assert worst > WORST_LIMIT


def test_round_steps():
    assert nice_step(0.7) == 0.5
    assert nice_step(35.0) == 50.0
    np.testing.assert_allclose(ticks(0.0, 103.0), [0, 20, 40, 60, 80, 100])


def test_the_block_lies_along_the_track():
    angle = np.deg2rad(130.0)
    along = np.linspace(0.0, 900.0, 50)[:, None] * [np.cos(angle), np.sin(angle)]
    assert principal_azimuth(along) == pytest.approx(angle)


@pytest.mark.parametrize("size", [(1280, 720), (720, 1280), (640, 640)])
def test_framed_cameras_hold_the_whole_block(size):
    generator = np.random.default_rng(1)
    track = np.cumsum(generator.normal(size=(200, 3)) * [30.0, 10.0, 0.0], axis=0)
    track[:, 2] = 60.0 + 60.0 * np.sin(np.arange(200) / 9.0)
    frame = Canvas(width=size[0], height=size[1]).frame
    for camera, phase in (("orbit", 0.1), ("orbit", 0.9), ("side", None), ("map", None)):
        layout = plan(
            [track], hull_length=2.0, floor=None, exaggeration=None, camera=camera, frame=frame
        )
        corners = layout.corners()[:4] if camera == "map" else layout.corners()
        x, y, _ = block_view(camera, layout, frame, phase).project(corners).T
        assert x.min() > frame.left - 0.02
        assert x.max() < 1.0 - frame.right + 0.02
        assert y.min() > frame.top - 0.02
        assert y.max() < 1.0 - frame.bottom + 0.02
        inside = layout.to_block(track)
        assert (inside >= layout.low - 1e-9).all()
        assert (inside <= layout.high + 1e-9).all()


def test_fit_fills_the_frame():
    points = np.random.default_rng(2).normal(size=(30, 3))
    frame = Frame(aspect=1.5)
    view = fit(points, np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), half_height=0.3, frame=frame)
    x, y, _ = view.project(points).T
    assert max(np.ptp(x), np.ptp(y)) == pytest.approx(0.92, abs=0.01)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"camera": "orbt"}, "did you mean 'orbit'"),
        ({"colour": "sped"}, "did you mean 'speed'"),
        ({"width": 8}, "width 8 must be 64 to 7680"),
        ({"fps": 0.0}, "fps 0.0 must be positive"),
        ({"speed_up": float("nan")}, "speed-up nan must be positive"),
    ],
)
def test_shots_that_cannot_be(settings, message):
    with pytest.raises(InputError, match=message):
        Shot(**settings)


def test_parts_outside_the_mission_are_refused(subject):
    time = subject.trajectory.time
    with pytest.raises(InputError, match="must be inside the mission, 0 to 300 s"):
        Shot(start=100.0, end=400.0).part(time)
    with pytest.raises(InputError, match="outside the shown part"):
        Shot(end=100.0).still_time(time, 200.0)


@needs_gl
def test_colour_by_error_needs_tracks(subject, with_tracks):
    with pytest.raises(InputError, match="give --tracks"):
        still(subject, Shot(**SIZE, colour="error"))
    with painter_of(with_tracks, colour="error") as painter:
        assert painter.stage.scale.label == "position error of network [m]"
        assert painter.stage.scale.high >= 40.0


def test_words_of_a_poster_are_read_at_half_its_width():
    """As in a README beside a column, on a screen of 640 pixels."""
    assert min(NAME, LABEL, LEGEND, TITLE, VALUE) * 640 / BASE_WIDTH >= SMALLEST_FONT


def test_every_label_of_a_map_has_distance_unit_and_direction(monkeypatch):
    canvas = SimpleNamespace(px=lambda n: n, width=1280, height=720)
    layout = SimpleNamespace(low=(-1100.0, -1600.0, 0.0), display_block=lambda points: points)
    view = SimpleNamespace(project=lambda points: points)
    values = {0: np.array([-1000.0, -500.0, 0.0]), 1: np.array([-1500.0, 0.0, 500.0])}
    monkeypatch.setattr(sea, "grid_values", lambda layout, axis: values[axis])
    monkeypatch.setattr(tags, "scale_bar", lambda *_: (500.0, (0, 0, 100, 4)))
    texts = [mark.text for mark in tags.map_marks(canvas, layout, view)]
    assert texts[:3] == ["1000 m S", "500 m S", "0 m N"]
    assert texts[3:] == ["1500 m W", "0 m E", "500 m E", "500 m"]


def test_the_first_tracks_have_not_the_colour_of_the_current():
    for colour in palette.OTHER_TRACKS[:4]:
        assert np.abs(colour - palette.CURRENT).max() > 0.2
    assert len({tuple(colour) for colour in palette.OTHER_TRACKS}) == len(palette.OTHER_TRACKS)


def test_a_tethers_length_is_in_metres_and_a_batterys_travel_in_millimetres():
    declare_parts(load_vehicle("bluerov2"))
    assert hud._part("tether", 15.0, fine=False).value == "15.0 m"
    assert hud._part("shift", -0.0212, fine=False).value.endswith("21 mm")
