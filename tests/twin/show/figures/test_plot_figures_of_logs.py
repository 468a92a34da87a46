"""Every figure of a log: what stands for the truth, and that its labels say so; the command."""

import dataclasses
import datetime

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from pictures import call, refused
from PIL import Image
from simulated_logs import simulated_log

from factory.importing.import_run import import_logs
from factory.samples import Flight
from factory.samples.gliders import write_slocum
from twin.errors import InputError, VehicleError
from twin.geodesy import offset
from twin.logs import estimate_flight, logged_trajectory, write_flight
from twin.records.coordinates import METHOD, METHODS
from twin.records.logged import LogStore
from twin.records.reader import MissionStore
from twin.records.store import write_store
from twin.show.figures import FIGURES, figure
from twin.show.figures.map_ground import COAST_NOTE, land_within
from twin.show.figures.section import along_track
from twin.show.flight_figures import FLIGHT_FIGURES, read_flight
from twin.show.style import DateFormatter, DateLocator
from twin.vehicle.vehicle import load_vehicle

FLIGHT = Flight(dives=3)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Dives of a simulated glider as a real log has them: one row, two fixes."""
    return simulated_log(tmp_path_factory.mktemp("log"), load_vehicle("slocum-200"))


@pytest.fixture(scope="module")
def logged(dives):
    return logged_trajectory(dives, [0, 1, 2])


@pytest.fixture(scope="module")
def first(dives):
    return logged_trajectory(dives)


@pytest.fixture(scope="module")
def flown(log):
    return logged_trajectory(log)


@pytest.fixture(scope="module")
def flight(dives, tmp_path_factory):
    """The flight of the dives, read from its file."""
    path = tmp_path_factory.mktemp("flight") / "a.nc"
    write_flight(estimate_flight(dives), path)
    return read_flight(path)


def titles(drawn: Figure) -> list[str]:
    return [axes.get_title(loc="left") for sub in (drawn, *drawn.subfigs) for axes in sub.axes]


def labels(drawn: Figure) -> str:
    """All that the axes of a figure say."""
    texts = []
    for axes in drawn.axes:
        texts += [axes.get_xlabel(), axes.get_ylabel(), axes.get_title(loc="left")]
        texts += axes.get_legend_handles_labels()[1]
        texts += [text.get_text() for text in axes.texts]
    return "\n".join(texts)


def test_the_track_goes_through_the_fixes_and_the_sources_say_what_each_signal_is(dives, logged):
    found = estimate_flight(dives)
    one = logged_trajectory(dives, [1])
    np.testing.assert_allclose(
        np.stack([one["true_north"], one["true_east"]], axis=1), found.missions[1].position,
        atol=20.0,  # drifts of the whole deployment and of one dive differ before the first fix
    )  # fmt: skip
    for name in ("north", "east"):
        gps = one[f"measured_gps_{name}"]
        fixed = np.isfinite(gps)
        assert fixed.sum() >= 2
        np.testing.assert_allclose(one[f"true_{name}"][fixed], gps[fixed], atol=1e-6)
    assert one.sources["true_north"] == "corrected track"
    assert one.sources["true_pitch"] == "measured"
    assert one.sources["true_surge"] == "flight model"
    assert one.sources["true_current_north"] == "depth-averaged current"
    assert logged.vehicle == "seaglider"


def test_without_a_model_the_track_is_the_stores_own_and_meets_the_fixes(tmp_path):
    data, _ = import_logs("slocum", write_slocum(tmp_path, Flight()))
    lacking = [name for name in data if str(name).endswith(("_pitch", "_pump"))]
    for name in data.variables:
        data[name].encoding.clear()
    data[METHOD][:] = [*METHODS].index("onboard_track")
    store = write_store(data.drop_vars(lacking), tmp_path / "real.zarr")
    logs = LogStore(store)
    one = logged_trajectory(store)
    assert one.unflown
    latitude, longitude, how = logs.positions(0)
    assert how == METHODS["onboard_track"]
    assert one.sources["true_north"] == "corrected on-board track"
    for found, stored in zip(one.geographic_position(), (latitude, longitude), strict=True):
        np.testing.assert_allclose(found, stored, atol=1e-6)
    last = latitude[-1], longitude[-1]
    np.testing.assert_allclose(last, logs.fixes(0)[1], atol=1e-6)


def test_dives_together_lie_where_the_vehicle_was(dives, logged):
    logs = LogStore(dives)
    assert len(logged.starts) == 3
    assert (np.diff(logged.time) > 0.0).all()
    first = logs.fixes(0)[0]
    for mission, start in enumerate(logged.starts):
        expected = offset(*map(np.float64, logs.fixes(mission)[0]), *first)
        found = logged["true_north"][start], logged["true_east"][start]
        np.testing.assert_allclose(found, [float(v) for v in expected], atol=0.1)
        elapsed = logs.starts[mission] - logs.starts[0]
        assert logged.time[start] == pytest.approx(elapsed, abs=1e-6)
    latitude, longitude = logged.geographic_position()
    end = logs.fixes(2)[1]
    known = np.flatnonzero(np.isfinite(logged["measured_gps_north"]))[-1]
    north, east = offset(latitude[known], longitude[known], *end)
    assert np.hypot(north, east) < 1.0


@pytest.mark.parametrize("name", [name for name in FIGURES if name != "log"])
def test_every_figure_takes_a_log(first, flown, name):
    trajectory = first
    if name == "sensor":
        with pytest.raises(InputError, match="no truth to compare its sensors with; the log fig"):
            figure(trajectory, name)
        trajectory = flown
    drawn = figure(trajectory, name)
    drawn.canvas.draw()
    said = labels(drawn) + "\n".join(titles(drawn))
    for sub in drawn.subfigs:
        said += "\n".join(axes.get_xlabel() + axes.get_ylabel() for axes in sub.axes)
    wanted = {
        "overview": ("corrected track", "measured pitch", "depth-averaged current [m/s]"),
        "track": ("corrected track", "fix"),
        "section": ("flight model", "depth [m]"),
        "velocity": ("surge, flight model", "speed over ground, corrected track"),
        "actuator": ("measured pitch", "measured"),
        "sensor": ("simulated truth", "difference: mean"),
        "current": ("depth-averaged current [m/s]",),
        "map": ("corrected track", "GPS fix", "depth-averaged current", "latitude", "longitude"),
        "hydrography": ("temperature (measured)", "[°C]", "time, UTC"),
        "transect": ("distance along the corrected track", "salinity (measured"),
        "ts": ("absolute salinity", "[g/kg]", "conservative temperature", "depth [m]"),
    }.get(name, ())
    for text in wanted:
        assert text in said, (text, said)
    if name == "track_3d":
        (legend,) = drawn.legends
        assert "corrected track" in [text.get_text() for text in legend.get_texts()]
    assert "truth" not in said.replace("simulated truth", "")
    assert "true" not in said


def test_the_lines_are_the_log_s(dives, first):
    axes = figure(first, "velocity").axes[0]
    np.testing.assert_allclose(axes.lines[0].get_ydata(), first["true_surge"])
    line = figure(first, "current").axes[0].lines[0]
    flight = estimate_flight(dives, missions=[0])
    assert flight.currents
    known = line.get_xdata()[np.isfinite(line.get_xdata())]
    values = [current.north for current in flight.currents]
    assert np.abs(known[:, None] - values).min(axis=1).max() < 1e-9


def test_arrows_of_the_map_are_the_currents_of_the_dives(logged):
    axes = figure(logged, "map").axes[0]
    (arrows,) = [c for c in axes.collections if isinstance(c, Quiver)]
    assert len(arrows.U) == FLIGHT.dives
    np.testing.assert_allclose(arrows.V, FLIGHT.north, atol=0.06)
    np.testing.assert_allclose(arrows.U, FLIGHT.east, atol=0.06)
    latitude, longitude = logged.geographic_position()
    (track,) = [line for line in axes.lines if line.get_label() == "corrected track"]
    np.testing.assert_allclose(track.get_ydata(), latitude, equal_nan=True)
    np.testing.assert_allclose(track.get_xdata(), longitude, equal_nan=True)


def test_time_of_a_log_is_told_by_dates(logged):
    axes = figure(logged, "hydrography").axes[1]
    assert axes.get_xlabel() == "time, UTC"
    texts = axes.xaxis.get_major_formatter().format_ticks(axes.get_xticks())
    begin = str(logged.provenance["start_time"])
    day, clock = begin[:10], begin[11:16]
    assert texts[0].endswith(f"\n{day}")
    assert "\n" not in texts[1]
    assert sum(text[:5] >= clock for text in texts) >= 2


def test_dates_of_days_and_of_midnight():
    start = datetime.datetime(2023, 12, 31, 22, tzinfo=datetime.UTC).timestamp()
    hours = DateFormatter(start, 3600.0)
    assert hours.format_ticks([0.0, 1.0, 2.0, 3.0]) == [
        "22:00\n2023-12-31", "23:00", "00:00\n2024-01-01", "01:00"
    ]  # fmt: skip
    assert hours.format_ticks([2.0, 26.0]) == ["01-01\n2024", "01-02"]
    ticks = np.array(DateLocator(start, 3600.0).tick_values(0.0, 10.0)) * 3600.0 + start
    assert len(ticks) >= 3
    assert np.allclose(np.round(ticks) % 3600.0, 0.0)


def test_no_mark_of_the_water_lies_above_the_surface(logged):
    depth = logged["true_depth"].copy()
    depth[:5] = -0.8
    signals = {**logged.signals, "true_depth": depth}
    axes = figure(dataclasses.replace(logged, signals=signals), "hydrography").axes[0]
    assert axes.get_ylim()[1] == 0.0
    assert np.asarray(axes.collections[0].get_offsets())[:, 1].min() == 0.0


def test_a_map_with_land_says_how_coarse_its_coast_is(logged):
    def notes(latitude: float, longitude: float) -> bool:
        place = {"start_latitude": latitude, "start_longitude": longitude}
        moved = dataclasses.replace(logged, provenance={**logged.provenance, **place})
        return COAST_NOTE in labels(figure(moved, "map"))

    shore = np.concatenate(land_within(-122.5, -121.5, 36.5, 37.5))  # about Monterey Bay
    nearest = np.abs(shore - [-122.0, 37.0]).sum(axis=1).argmin()
    assert notes(float(shore[nearest, 1]), float(shore[nearest, 0]))
    assert notes(37.3, -121.0)  # inland
    assert not notes(45.0, -35.0)


def test_a_transect_counts_the_way_over_ground(logged):
    way = along_track(logged)
    assert (np.diff(way) >= 0.0).all()
    known = np.isfinite(logged["true_north"])
    steps = np.hypot(np.diff(logged["true_north"][known]), np.diff(logged["true_east"][known]))
    assert way[-1] == pytest.approx(steps.sum())


def test_a_log_that_no_model_flies_shows_its_own_track(dives, tmp_path):
    data = MissionStore(dives).dataset.load().drop_vars("measured_pump")
    plain = write_store(data, tmp_path / "plain.zarr")
    one = logged_trajectory(plain, [0])
    assert one.vehicle is None
    assert "measured_pump" in one.unflown
    assert one.sources["true_north"] == "corrected track"  # as the import found it
    assert "true_surge" not in one
    with pytest.raises(InputError, match="no signal true_surge"):
        figure(one, "velocity")
    with pytest.raises(InputError, match="two fixes about a dive"):
        figure(one, "current")
    with pytest.raises(VehicleError):
        logged_trajectory(dives, [0], "no-such-vehicle")


def test_a_log_of_a_simulation_keeps_its_truth(flown):
    assert flown.sources["true_pitch"] == "simulated truth"
    assert flown.sources["true_north"] == "corrected track"
    axes = figure(flown, "velocity").axes[0]
    assert axes.get_title(loc="left") == "surge, simulated truth"
    np.testing.assert_allclose(axes.lines[0].get_ydata(), flown["true_surge"])


def test_the_command_draws_dives_together(dives, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("twin.commands.plot.PRINT_DPI", 40)
    words = ("--missions", "all", "--figure", "map", "--out", tmp_path / "map.svg")
    code, _, err = call(capsys, "plot", dives, *words)
    assert (code, err) == (0, "")
    text = (tmp_path / "map.svg").read_text()
    assert "missions 0 to 2" in text
    assert "seaglider" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--missions", "0-9"), "has missions 0 to 2, not 3"),
        (("--vehicle", "seagliderr"), "seaglider"),
        (("--missions", "0", "--tracks", "none.csv"), "give --mission in place of --missions"),
        (("--figure", "mapp"), "did you mean 'map'"),
    ],
)
def test_refusals_of_logs_are_one_line(dives, capsys, tmp_path, words, message, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert message in refused(capsys, "plot", dives, *words)
    assert not list(tmp_path.iterdir())


def test_a_flight_is_drawn_from_its_file_and_named_elsewhere(dives, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("twin.commands.plot.PRINT_DPI", 40)
    assert call(capsys, "flight", dives, "--out", "a.nc")[0] == 0
    assert call(capsys, "flight", dives, "--out", "b.zarr")[0] == 0
    for name in ("a.nc", "b.zarr"):
        code, out, err = call(capsys, "plot", name, "--figure", "all", "--out", f"of_{name}")
        assert (code, err) == (0, "")
        drawn = {path.name for path in (tmp_path / f"of_{name}").iterdir()}
        assert drawn == {"w_section.png", "w_histogram.png", "map.png"}
        assert len(out.splitlines()) == 3
        for words in (("render", name), ("identify", name, "--out", "x.xml")):
            told = refused(capsys, *words)
            assert f"{name} is a flight, which `twin flight` wrote: `twin plot {name}` dr" in told
    told = refused(capsys, "plot", "a.nc", "--figure", "overview")
    assert "figure of a flight 'overview'" in told
    assert "w_section" in told


def test_the_flight_s_map_is_the_file_s(flight):
    axes = FLIGHT_FIGURES["map"](flight).axes[0]
    tracks = [line for line in axes.lines if len(line.get_xdata()) > 20]
    count = int(flight["n_samples"][0])
    np.testing.assert_allclose(tracks[0].get_ydata(), flight["latitude"].values[0, :count])
    (arrows,) = [c for c in axes.collections if isinstance(c, Quiver)]
    np.testing.assert_allclose(arrows.V, flight["dac_north"].values)
    bar = FLIGHT_FIGURES["w_section"](flight).axes[0].collections[-1]
    low, high = bar.get_clim()
    assert low == -high
    assert bar.get_cmap().name == "balance"


def test_dives_without_vertical_velocity_are_seen(flight, tmp_path):
    still = 1e-6 * np.sign(flight["w_water"])  # the white of the map
    figure = FLIGHT_FIGURES["w_section"](flight.assign(w_water=still + 0.0 * flight["w_water"]))
    figure.axes[0].collections[-1].set_clim(-0.05, 0.05)
    figure.axes[0].set_axis_off()
    figure.axes[1].remove()
    figure.savefig(tmp_path / "still.png")
    with Image.open(tmp_path / "still.png") as picture:
        grey = np.asarray(picture.convert("L"))
    assert (grey < 190).mean() > 0.005
