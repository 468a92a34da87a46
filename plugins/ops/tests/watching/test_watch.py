"""`twin watch`: a deployment's folder from the files that arrive, in any order, and its page."""

import dataclasses
import datetime
import json
import re
import shutil
import urllib.request

import netCDF4
import numpy as np
import pytest
import xarray as xr
from PIL import Image

from factory.samples import Flight
from factory.samples.archives import write_og1
from factory.samples.gliders import write_basestation, write_dbd, write_slocum
from glider_twin_ops.commands.watch import _late
from glider_twin_ops.files import commanded, read_commands, read_science, read_targets
from glider_twin_ops.forecast import LoggedLeg, NoticeBox, legs_of, mission_to, notice_boxes
from glider_twin_ops.health import CHANNELS, DeploymentHealth, KindVerdict
from glider_twin_ops.health.judgement import follow
from glider_twin_ops.watching import SurfaceDialogue, WatchedDeployment, one_pass, watch_pass
from glider_twin_ops.watching.changes import _moved, apart, news, surfaced
from glider_twin_ops.watching.expected_plan import _onward, proposed_files
from glider_twin_ops.watching.log_of_files import LOG, content_of, log_of_files
from glider_twin_ops.watching.morning import Morning, morning
from glider_twin_ops.watching.watch_pass import (
    BELIEFS,
    PARTS,
    alone,
    noticed,
)
from glider_twin_protocols.auv_samples import write_mat
from twin import load_vehicle
from twin.errors import InputError, MissionError, WriteError
from twin.navigation.current import Leg
from twin.records import LogStore, write_store
from twin.records.coordinates import utc_minute
from twin.records.storage import temporary_name
from twin.records.storage.checksums import store_hash

pytestmark = pytest.mark.usefixtures("no_figures")
DIVES = 4


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """Basestation files of a Seaglider, one a dive."""
    return write_basestation(tmp_path_factory.mktemp("base"), Flight(dives=DIVES))


@pytest.fixture
def full(base, source):
    """The source with all of them."""
    return [shutil.copy(path, source) for path in base]


def page_of(made, name="index.html"):
    return (made.folder / "page" / name).read_text()


def at(hours):
    """[s] unix."""
    return datetime.datetime(2026, 3, 1, tzinfo=datetime.UTC).timestamp() + 3600.0 * hours


def leg_of(start=0.0, way=(1000.0, 0.0), through=(900.0, 0.0), hours=1.0, targets=()):
    leg = Leg(start=start, duration=3600.0 * hours, over_ground=way, through_water=through)
    return LoggedLeg(
        mission=0, leg=leg, method="", begin=(49.0, -58.0), onboard=None, targets=targets
    )


# --- the command ------------------------------------------------------------------------------


def test_a_new_deployment_of_an_empty_folder_has_a_page_that_says_what_is_missing(
    tmp_path, source, run
):
    folder = tmp_path / "calypso"
    code, said, err = run("--new", folder, "--from", source, "--vehicle", "seaglider")
    assert (code, err) == (0, "")
    assert "deployment.toml" in said
    told = [json.loads(run(folder, "--once", "--json")[1]) for _ in range(2)]
    assert told[0]["verdict"] == "calypso: nothing can be judged yet"
    assert [one["changed"] for one in told] == [True, False]
    for name in ("index.html", "summary.txt"):
        assert "no file has arrived" in (folder / "page" / name).read_text()
    assert json.loads((folder / "page" / "forecast.geojson").read_text())["features"] == []
    shutil.rmtree(folder / "page")
    code, said, err = run(folder, "--once")
    assert (code, (said + err).count("no file has arrived")) == (0, 1)


@pytest.mark.parametrize(("vehicle", "warned"), [("tethys", True), ("slocum-200", False)])
def test_a_vehicle_of_another_kind_than_the_files_is_warned_of(
    tmp_path, source, run, vehicle, warned
):
    write_slocum(source, Flight(dives=1))
    code, _, err = run("--new", tmp_path / vehicle, "--from", source, "--vehicle", vehicle)
    assert code == 0
    assert (f"vehicle {vehicle} ({vehicle}) is of another kind" in err) == warned
    assert ("(slocum): it did not fly these dives" in err) == warned


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--new", "--from is missing"),
        ("--new --from nowhere", "there is no such folder"),
        ("--new --once", "--once: leave it out with --new"),
        ("--once --vehicle seaglider", "--vehicle: it is for --new"),
        ("--json", "watching never ends"),
        ("--once --every 5", "--every is for passes without end"),
        ("--every 0.5", "--every 0.5 must be 1 s or more"),
        ("--once --serve", "--serve is for passes without end"),
        ("--once --port 0", "--port is for --serve"),
        ("--once --as-of monday", "must be a time in UTC"),
        ("--to-learn --once", "--to-learn makes no pass"),
        ("--once", "holds no deployment.toml"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(tmp_path, run, words, message):
    code, _, err = run(tmp_path / "calypso", *words.split())
    assert (code, message in err, err.count("\n")) == (2, True, 1), err


def test_an_existing_deployment_is_never_replaced(tmp_path, watched):
    made = watched()
    with pytest.raises(WriteError, match="is there already"):
        made.write()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("x")
    with pytest.raises(WriteError, match="did not write it"):
        dataclasses.replace(made, folder=tmp_path / "mine").write()


@pytest.mark.parametrize(
    ("was", "becomes", "message"),
    [
        ("members", "member", "did you mean 'members'"),
        ("members = 10", 'members = "10"', "must be a whole number"),
        ("members = 10", "members = 8", "members = 8 must be from 10"),
        ("energy_kwh = 3.5", "energy_kwh = -1", "must be 0 or above"),
        ('"seaglider"  # of', '"seaglyder"  # of', "unknown kind"),
        ('variation_deg = ""', 'variation_deg = "W"', "must be degrees"),
        ("source", "# source", "key source is missing"),
        ('home = ""', 'home = "harbour"', "must be LAT,LON"),
        ('mission = ""', 'mission = "a.mi"', "goto or mission, not both"),
        ("hours = 2.0", "hours = -3.0", "toml: forecast: hours = -3 must be above 0"),
        ('"49.5,-58.0"', '"here"', "goto 'here': write LAT,LON"),
        ('current = ""', 'current = "here"', "unknown current 'here'"),
        ('current = ""', 'current = "file:a.nc"', "unknown current 'file'"),
        ('current = ""', 'current = "uniform:fast"', "uniform"),
        ("days = 30.0", "days = 0.0", "days 0 must be within"),
        ('cache = ""', 'cache = "lists"', "cache = 'lists' is no folder"),
        ("^vehicle = .*$", 'vehicle = "slocum-20"', "slocum-200"),
    ],
)
def test_wrong_settings_are_named(watched, was, becomes, message):
    made = watched(goto="49.5,-58.0", energy_kwh=3.5, kind="seaglider")
    assert WatchedDeployment.read(made.folder) == made
    path = made.folder / "deployment.toml"
    path.write_text(re.sub(was, becomes, path.read_text(), flags=re.MULTILINE))
    with pytest.raises(InputError, match=message):
        WatchedDeployment.read(made.folder)


@pytest.mark.parametrize("text", ["forecast.nc", "grid:forecast.nc", "uniform:0.1,0"])
def test_a_current_s_file_lies_from_the_deployment_s_folder_on(watched, text):
    made = watched()
    path = made.folder / "deployment.toml"
    help_ = next(line for line in path.read_text().splitlines() if line.startswith("current = "))
    assert text in help_ or text[:4] == "unif"
    path.write_text(path.read_text().replace('current = ""', f'current = "{text}"'))
    assert WatchedDeployment.read(made.folder).field == text
    file = made.folder / "forecast.nc"
    file.write_bytes(b"")
    assert WatchedDeployment.read(made.folder).field == text.replace("forecast.nc", str(file))


def test_why_there_is_no_forecast_is_the_first_of_what_is_missing(watched, source, base):
    shutil.copy(base[0], source)
    made = watched(current="forecast.nc")
    one_pass(made)
    said = page_of(made, "summary.txt")
    assert re.search(r"current of the last 0\.\d\d m/s towards \d{3} degree\n", said)
    last = said.splitlines()[-1]
    assert last.startswith("Missing: forecast: ")
    assert "no file 'forecast.nc'" in last


def test_a_file_that_ends_too_early_is_named_with_how_far_it_goes(watched, source, run):
    pytest.importorskip("dbdreader")
    flight = Flight(dives=2)
    log, _ = write_dbd(source, flight)
    whole = log.read_bytes()
    log.write_bytes(whole[: len(whole) * 3 // 4])
    made = watched(vehicle="slocum-200")
    code, said, err = run(made.folder, "--once")
    assert code == 0, err
    (told,) = re.findall(rf"{log.name} is truncated: goes to (.*) UTC", said + err)
    moment = datetime.datetime.fromisoformat(told).replace(tzinfo=datetime.UTC).timestamp()
    assert abs(moment - np.interp(0.75, [0.0, 1.0], flight.time[[0, -1]])) < 300.0
    assert f"{log.name} is truncated: goes to {told}" in page_of(made)
    (event,) = (made.folder / "events.jsonl").read_text().splitlines()
    assert json.loads(event)["event"] == "short file"
    code, said, err = run(made.folder, "--once")
    assert "nothing new" in said
    assert f"{log.name} is truncated" in err


def test_a_junk_file_hides_no_missing_list_of_sensors(tmp_path, watched, source, run):
    pytest.importorskip("dbdreader")
    (source / "aaa.sbd").write_bytes(b"junk")
    for k in range(3):
        log, cache = write_dbd(tmp_path, Flight(dives=2), f"unit{k}")
        shutil.copy(log, source / f"unit1-2023-317-0-{k}.sbd")
    cache.rename(tmp_path / "kept.cac")
    made = watched(vehicle="slocum-200")
    code, said, err = run(made.folder, "--once")
    assert code == 0
    for words in (
        "aaa.sbd is not a Slocum", "0badcafe.cac is missing", "that cache in deployment.toml names",
    ):  # fmt: skip
        assert (said + err).count(words) == 1, said + err
        assert words in page_of(made, "summary.txt")
    assert "--cache" not in said + err
    (tmp_path / "lists").mkdir()
    (tmp_path / "kept.cac").rename(tmp_path / "lists" / "0badcafe.cac")
    settings = made.folder / "deployment.toml"
    settings.write_text(settings.read_text().replace('cache = ""', 'cache = "../lists"'))
    code, said, err = run(made.folder, "--once")
    assert (said + err).count("aaa.sbd is not a Slocum") == 1, said + err
    assert "0badcafe" not in said + err
    assert (made.folder / LOG).exists()


def test_why_there_is_no_dive_is_said_again_beside_what_else_cannot_be_read(watched, source):
    pytest.importorskip("dbdreader")
    write_dbd(source, Flight(dives=2), without=("m_depth", "m_pressure"))
    made = watched(vehicle="slocum-200")
    first = log_of_files(made, made.folder)
    assert "neither depth nor pressure" in first.missing
    assert log_of_files(made, made.folder) == first
    (source / "b.txt").write_text("x")
    both = log_of_files(made, made.folder).missing
    assert both.startswith(f"{first.missing}; ")
    assert "b.txt" in both


def test_a_second_pass_at_the_same_time_does_nothing(watched, run):
    made = watched()
    with alone(made.folder) as free:
        assert free
        code, _, err = run(made.folder, "--once")
    assert code == 0
    assert "another pass" in err
    assert not (made.folder / "page").exists()


def test_what_killed_passes_left_is_removed(watched, full):
    """Where the page was written, the next pass has nothing to do, and no writer removes it."""
    made = watched()
    copied = made.folder / ".log.zarr.writing-0badcafe"
    copied.mkdir()
    (copied / "p9990001.nc").write_bytes(b"half")
    assert one_pass(made).changed
    assert not copied.exists()
    left = temporary_name(made.folder / "page")
    (left / "deeper").mkdir(parents=True)
    assert not one_pass(made).changed
    assert not left.exists()


# --- files ----------------------------------------------------------------------------------------


def test_a_corrected_value_of_a_file_that_grows_is_read(watched, source):
    made = watched(kind="og1", variation_deg=-20.0)
    path = write_og1(source / "grows.nc", Flight(dives=5))
    log_of_files(made, made.folder)
    with netCDF4.Dataset(path, "a") as file:
        pitch = file["PITCH"]
        half = len(pitch) // 2
        pitch[half - 50 : half + 50] = pitch[half - 50 : half + 50] + 0.01
    assert log_of_files(made, made.folder).changed
    corrected = store_hash(made.folder / LOG)
    log_of_files(made, made.folder, again=True)
    assert store_hash(made.folder / LOG) == corrected


def test_the_logs_of_an_lrauv_are_one_deployment(watched, source):
    for day in range(2):
        path = source / f"{day}" / "shore.mat"
        path.parent.mkdir()
        write_mat(path, Flight(dives=2))
        with netCDF4.Dataset(path, "a") as file:  # the second one a day later
            for group in file.groups.values():
                group["time"][:] = group["time"][:] + day
    made = watched(kind="lrauv", recursive=True)
    assert log_of_files(made, made.folder).changed
    with LogStore(made.folder / LOG) as logs:
        assert len(logs) == 4
        assert set(logs.deployments) == {"shore"}


def test_a_source_that_says_nothing_leaves_the_log_as_it_was(watched, source, base):
    made = watched()
    path = source / shutil.copy(base[0], source)
    first = log_of_files(made, made.folder)
    assert first.changed
    path.write_bytes(path.read_bytes()[:100])
    broken = log_of_files(made, made.folder)
    assert str(source) in broken.missing or path.name in broken.missing
    assert ".writing-" not in broken.missing
    assert not list(made.folder.glob(".*writing*"))
    assert broken.store == first.store


def test_a_damaged_log_is_said_and_what_is_not_its_own_is_not_removed(
    tmp_path, watched, source, base, run
):
    made = watched()
    shutil.copy(base[0], source)
    log = made.folder / LOG
    log_of_files(made, made.folder)
    path = log / "zarr.json"
    path.write_bytes(path.read_bytes()[:40])
    code, said, err = run(made.folder, "--once")
    assert code == 0, err
    assert (said + err).count("log.zarr was damaged, and is made again: zarr.json is changed") == 1
    assert log_of_files(made, made.folder).damage == ""
    path.write_bytes(b"{")
    (log / "notes.txt").write_text("mine")  # nobody's to remove
    shutil.copy(base[1], source)
    with pytest.raises(WriteError, match=r"log\.zarr exists and glider-twin did not write it"):
        log_of_files(made, made.folder)
    (log / "notes.txt").unlink()
    with pytest.raises(WriteError, match="exists and is damaged, or another thing of glider-twin"):
        write_store(xr.Dataset(), log.rename(tmp_path / "other.zarr"), overwrite=True)


def test_no_path_and_no_time_of_a_run_is_in_what_is_kept(tmp_path, watched, full, figures):
    made = watched()
    one_pass(made)
    today = f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}".encode()
    for path in (made.folder / name for name in PARTS):
        for file in [path] if path.is_file() else [p for p in path.rglob("*") if p.is_file()]:
            content = file.read_bytes()
            for word in (str(tmp_path).encode(), b".writing-", today):
                assert word not in content, (file, word)


# --- passes ---------------------------------------------------------------------------------------


def test_a_pass_writes_beliefs_and_a_page_and_a_replay_gives_the_same_bytes(
    watched, base, source, run, figures
):
    made = watched()
    for path in base[:-1]:
        shutil.copy(path, source)
    first = one_pass(made)
    assert first.changed
    page = page_of(made)
    assert "too few to judge" in first.verdict
    for title in ("Next surfacings", "Track and currents", "Health", "What is missing"):
        assert f"<h2>{title}</h2>" in page
    assert "http" not in page.replace("http://www.w3.org", "")
    found = xr.open_zarr(made.folder / BELIEFS)
    assert found["level"].shape == (DIVES - 1, len(CHANNELS))
    assert np.isfinite(found["value"].sel(channel="rate_dive")).all()
    assert found["parameter_value"].shape == (DIVES - 1, 2)
    assert (found["parameter_deviation"] > 0.0).all()
    assert len(page_of(made, "summary.txt").splitlines()) <= 10
    features = json.loads(page_of(made, "forecast.geojson"))["features"]
    assert {one["geometry"]["type"] for one in features} >= {"LineString", "Polygon", "Point"}

    assert not one_pass(made).changed
    shutil.copy(base[-1], source)
    second = one_pass(made)
    assert second.new[0] == f"1 new dive, {DIVES}"
    assert any(said.startswith("Surfacing foretold") for said in second.new)

    code, said, err = run(made.folder, "--replay", "--json")
    assert code == 0, err
    assert json.loads(said)["same"] == dict.fromkeys(PARTS, True)
    shutil.rmtree(made.folder / LOG)
    shutil.rmtree(made.folder / BELIEFS)
    kept = store_hash(one_pass(made, replay=True).page.parent.parent / BELIEFS)
    assert kept == store_hash(made.folder / BELIEFS)


def test_a_pass_that_was_killed_goes_on(tmp_path, deployment, watched, base, source, monkeypatch):
    made = watched()
    shutil.copy(base[0], source)
    one_pass(made)
    for path in base:
        shutil.copy(path, source)

    def killed(*_, **__):
        raise KeyboardInterrupt

    for step in ("write_beliefs", "write_events", "write_morning"):
        with monkeypatch.context() as patch:
            patch.setattr(watch_pass, step, killed)
            with pytest.raises(KeyboardInterrupt):
                one_pass(made)
    after = one_pass(made)
    assert after.changed
    assert after.new[0] == f"{DIVES - 1} new dives, 2 to {DIVES}"
    clean = deployment(tmp_path / "clean", source)
    one_pass(clean)
    for name in PARTS:
        assert content_of(made.folder / name) == content_of(clean.folder / name)


def test_the_plan_of_a_pilot_lies_beside_the_page_as_files_for_the_vehicle(watched, full, source):
    made = watched(goto="49.52,-57.98;49.7,-57.9", samples=0.5)
    (source / "science").write_text("100 5 111 60\n1000 10 101 120\n")
    (source / "cmdfile").write_text("$D_TGT,40\n$GO\n")
    told = one_pass(made).told
    folder = made.folder / "page"
    first, second = read_targets(folder / "targets")
    assert first.latitude == pytest.approx(49.52, abs=1e-5)
    assert (first.goto, second.goto) == ("T2", "T2")
    page = page_of(made)
    for words in ("Proposal", "What its last dives did", "which it flies now", "take "):
        assert words in page
    assert told.plan.startswith("to the places of deployment.toml")
    rows = {row["what"]: row for row in told.changes}
    assert rows["next place"]["proposed"] == "49.52,-57.98"
    assert rows["depth [m]"]["now"] == rows["depth [m]"]["proposed"]
    # what the twin flies is what a reader finds in the files
    (flown,) = told.surfacings.request.mission.segments
    commands = read_commands(folder / "cmdfile")
    (said,) = commanded(commands, (first, second), load_vehicle("seaglider")).segments
    assert flown == said
    # against what lies in the source
    assert [one.seconds for one in read_science(folder / "science")] == [10.0, 20.0]
    assert set(told.proposed.changes) == {"cmdfile", "science"}
    assert "-$D_TGT,40\n" in told.proposed.changes["cmdfile"]
    assert "+100 10 111 60" in told.proposed.changes["science"]
    # ways to the next place
    assert "<h2>Routes</h2>" in page
    lines = json.loads((folder / "routes.geojson").read_text())["features"]
    assert lines[0]["properties"]["name"] == "straight"
    assert lines[0]["geometry"]["coordinates"][-1] == pytest.approx([-57.98, 49.52], abs=1e-4)
    assert 0.05 < told.routes.speed < 0.4
    (source / "cmdfile").write_text("$D_TGT,41\n$GO\n")
    one_pass(dataclasses.replace(made, goto=""))
    assert not (folder / "targets").exists()
    assert not (folder / "routes.geojson").exists()


def test_files_that_are_not_written_are_refused_by_name():
    vehicle, asked = load_vehicle("seaglider"), {"depth": 60.0, "pitch_deg": 26.0}
    mission = mission_to("49.6,-57.9", surface_after_s=900.0, radius=500.0, **asked)
    for kind, samples, message in (
        ("seaexplorer", 1.0, "SeaExplorer are not written: no public text says what its sea.msn"),
        ("og1", 1.0, "files of og1 vehicles are not written"),
        ("slocum", 0.5, "a Seaglider alone has a science file"),
        ("seaglider", 0.5, "the source has no file science"),
    ):
        with pytest.raises(MissionError, match=message):
            proposed_files(kind, mission, vehicle, {}, samples)
    same = proposed_files("seaglider", mission, vehicle, {})
    again = proposed_files("seaglider", mission, vehicle, same.files)
    assert again.changes == {"targets": "", "cmdfile": ""}


def test_as_of_a_moment_only_the_dives_that_had_ended_are_known(watched, full, run):
    made = watched()
    flight = Flight(dives=DIVES)
    end = flight.dive_times(1)[1]
    moment = datetime.datetime.fromtimestamp(round(end + flight.surface / 2), datetime.UTC)
    passed = one_pass(made, until=moment)
    assert passed.told.dives == (1, 2)
    assert not (made.folder / LOG).exists()
    assert "What came" not in passed.page.read_text()
    log_of_files(made, made.folder)
    code, _, err = run(made.folder, "--as-of", f"{moment:%Y-%m-%dT%H:%M:%S}", "--replay")
    assert code == 0, err
    page = passed.page.read_text()
    assert "What came" in page
    assert "Surfacing foretold" in page
    early = datetime.datetime(2000, 1, 1, tzinfo=datetime.UTC)
    assert "no dive had ended" in one_pass(made, until=early).log.missing


def test_logs_without_fixes_and_without_a_counter_are_told_of(watched, source):
    write_slocum(source, Flight(dives=3))
    (source / "unit1_gps.csv").unlink()
    made = watched(vehicle="slocum-200", energy_kwh=2.0)
    assert "variation_deg in deployment.toml" in one_pass(made).log.missing
    told = one_pass(dataclasses.replace(made, variation_deg=-20.0)).told
    assert told.surfacings is None
    said = " ".join(told.lacking)
    assert "no dive lies between two fixes" in said
    assert "no counter of charge" in said


NORTH = (49.0 + 51_000.0 / 111_200.0, -58.0)


@pytest.mark.parametrize(
    ("targets", "goes", "guessed"),
    [
        (((0.0, 9000.0),), (49.0, -58.0 + 9000.0 / 73_000.0), False),
        (((1000.0, 100.0),), NORTH, True),  # it is there
        ((), NORTH, True),
    ],
)
def test_where_it_goes_is_said_by_the_log_or_guessed(targets, goes, guessed):
    place, words, is_guess = _onward(leg_of(targets=targets))
    assert [float(word) for word in place.split(",")] == pytest.approx(goes, abs=2e-3)
    assert is_guess is guessed
    assert ("waypoint" in words) is not guessed


# --- what is noticed ------------------------------------------------------------------------------


def health(alarm, level=0.0):
    """Of ten dives, whose first channel has a level."""
    values = np.full((10, len(CHANNELS)), np.nan)
    values[:, 0] = level
    kind = KindVerdict(
        kind="leak", says="water in the hull", probability=0.9, since_dive=6, size=0.1,
        size_deviation=0.02, unit="kg", dives=(6, 7), channels=("air",),
        also=("fouling",), otherwise="a new ballast", find_out="look at the vacuum",
    )  # fmt: skip
    called = {"alarm": True, "kind": "leak", "since_dive": 6, "noticed_dive": 8} if alarm else {}
    return DeploymentHealth(
        name="unit", days=1.0, dives=tuple(range(1, 11)), probability=0.9, kinds=(kind,),
        evidence=np.zeros(10), threshold=3.0, levels=follow(values), values=values,
        time=1.7e9 + 3600.0 * np.arange(10), lacking=tuple(c.name for c in CHANNELS[1:]),
        remarks=(), **called,
    )  # fmt: skip


@pytest.fixture
def nothing(watched):
    """The log of an empty source."""
    made = watched()
    return log_of_files(made, made.folder)


def test_an_alarm_has_the_times_of_its_dives(nothing):
    assert [one["event"] for one in noticed(nothing, health(False))] == ["nothing to import"]
    alarm = noticed(nothing, health(True))[-1]
    assert alarm["event"] == "alarm"
    assert (alarm["since_dive"], alarm["noticed_dive"], alarm["dives"]) == (6, 8, [6, 7])
    assert alarm["noticed"] == "2023-11-15T05:13Z"
    assert alarm["also"] == ["fouling"]


def test_levels_that_moved_are_news(nothing):
    before, same, after = (
        Morning(
            title="calypso", log=nothing, deployment="unit", dives=tuple(range(1, 11)),
            health=health(False, level),
        )
        for level in (0.0, 0.001, 0.3)
    )  # fmt: skip
    was = json.loads(json.dumps(before.describe()))
    assert news(was, same) == ["No new dive"]
    (moved,) = (said for said in news(was, after) if "sinks" in said)
    assert moved.startswith("In dives it sinks 42.9 % faster than ")
    assert news(None, after) == []
    assert apart(0.001, 0.3) == ("0.001", "0.3")
    assert apart(5.581, 5.5834) == ("5.581", "5.583")


# --- what a pilot gets ----------------------------------------------------------------------------


def test_beside_the_page_lie_a_picture_and_boxes_that_hold_the_forecast(watched, full, figures):
    passed = one_pass(watched(hours=20.0))
    found, page = passed.told.surfacings, passed.page.parent
    with Image.open(page / "mail.png") as picture:
        assert picture.width > picture.height / 2 > 300
    first, second = json.loads((page / "boxes.geojson").read_text())["features"]
    assert first["properties"]["end"] == second["properties"]["begin"]
    assert first["properties"]["holds"] == pytest.approx(1.0 - 4.0 / (found.flown + 1))
    assert len((page / "boxes.txt").read_text().splitlines()) == 3
    for one in found.surfacings:
        box = second if one.late_s > 12 * 3600.0 else first
        if one.early_s <= 12 * 3600.0 <= one.late_s:
            continue
        (west, south), (east, north) = (box["geometry"]["coordinates"][0][k] for k in (0, 2))
        assert south < one.latitude < north
        assert west < one.longitude < east
    middle = notice_boxes(found, hours=10.0)
    assert [round((one.end - one.begin).total_seconds() / 3600.0) for one in middle] == [10, 10]


def test_a_box_across_the_date_line_is_written_in_degrees_and_minutes():
    begin = datetime.datetime(2026, 1, 2, tzinfo=datetime.UTC)
    box = NoticeBox(
        begin=begin, end=begin + datetime.timedelta(hours=12), south=-12.5, north=0.0,
        west=179.95, east=-179.9, holds=0.96,
    )  # fmt: skip
    assert box.text() == (
        "2026-01-02 00:00 to 2026-01-02 12:00 UTC: 12-30.0S to 00-00.0N, 179-57.0E to 179-54.0W"
    )
    ring = box.feature()["geometry"]["coordinates"][0]
    assert max(x for x, _ in ring) == pytest.approx(180.1)


def test_files_below_an_empty_source_are_pointed_at(watched, source, base):
    (source / "calypso-2026").mkdir()
    shutil.copy(base[0], source / "calypso-2026")
    made = watched()
    for words in ("1 file in folders below it, such as calypso-2026", "recursive = true"):
        assert words in log_of_files(made, made.folder).missing
    assert log_of_files(dataclasses.replace(made, recursive=True), made.folder).changed


@pytest.fixture
def passed(watched, full):
    """A deployment whose files all arrived, and what a pass tells."""
    made = watched()
    return made, one_pass(made).told


def test_a_forecast_begins_at_a_newer_fix_of_a_dialogue(passed):
    made, before = passed
    fix = before.last_fix
    place = (fix.latitude + 0.01, fix.longitude)
    dialogue = SurfaceDialogue(
        vehicle=before.deployment, fix=place, fix_time=fix.time + 600.0, aborts=None, sensors={},
        why="", time=fix.time + 660.0,
    )  # fmt: skip
    log = log_of_files(made, made.folder)
    told = morning(made, log, dialogue)
    start = told.surfacings.request.place
    assert (start.latitude_deg, start.longitude_deg) == pytest.approx(place)
    begins = told.surfacings.begins.replace(tzinfo=datetime.UTC).timestamp()
    assert begins == pytest.approx(fix.time + 600.0, abs=1.0)
    other = morning(made, log, dataclasses.replace(dialogue, vehicle="another"))
    assert other.last_fix == fix
    assert any("of another" in why for why in other.lacking)


def test_it_was_last_where_it_came_up_though_nobody_knows_its_way_there(passed, monkeypatch):
    made, whole = passed
    assert whole.last_fix.time == pytest.approx(whole.legs[-1].leg.end)
    assert not any(why.startswith("current:") for why in whole.lacking)
    monkeypatch.setattr(
        "glider_twin_ops.watching.morning.legs_of", lambda logs, name: legs_of(logs, name)[:-1]
    )
    told = morning(made, log_of_files(made, made.folder))
    assert told.last_fix == whole.last_fix
    assert told.legs[-1].leg.end < whole.last_fix.time - 600.0
    (said,) = [why for why in told.lacking if why.startswith("current:")]
    assert f"of 1 dive since {utc_minute(told.legs[-1].leg.end)} UTC ({whole.dives[-1]})" in said
    assert told.surfacings.moment(0.0) == told.last_fix.describe()["time"].rstrip("Z")


def test_a_pass_says_how_old_the_last_fix_is_when_nothing_came_too(passed, run, monkeypatch):
    made, told = passed
    latest = told.describe()
    fix = datetime.datetime.fromtimestamp(round(told.last_fix.time), datetime.UTC)
    assert _late(latest, fix + datetime.timedelta(minutes=30)) == ""
    assert _late(latest, fix + datetime.timedelta(days=365)) == ""
    due = datetime.timedelta(seconds=round(told.surfacings.surfacings[0].late_s))
    late = _late(latest, fix + due + datetime.timedelta(hours=5.0))
    assert "had come up again 5.0 h ago" in late
    hours = (due + datetime.timedelta(hours=5.0)).total_seconds() / 3600.0
    assert late.startswith(f"The last fix is {hours:.1f} h old; 95 of 100 draws")
    monkeypatch.setattr("glider_twin_ops.commands.watch.PAST_DAYS", 1e6)
    code, said, _ = run(made.folder, "--once")
    assert code == 0
    for words in ("nothing new", "The last fix is ", "its files are late, or the vehicle is"):
        assert words in said


def test_a_vehicle_that_was_not_identified_is_said_with_an_alarm(nothing):
    vehicle = load_vehicle("seaglider")
    told = Morning(title="calypso", log=nothing, health=health(True), vehicle=vehicle)
    assert told.verdict.endswith("judged by seaglider, not by a vehicle identified from its logs")
    assert "identified" not in dataclasses.replace(told, health=health(False)).verdict


def test_surfacings_that_were_foretold_are_told_however_far_off_they_came():
    ellipse = {"bearing_deg": 0.0, "semi_major_m": 500.0, "semi_minor_m": 400.0}
    told = {"latitude": 49.0, "longitude": -58.0, "ellipse_90": ellipse}
    foretold = {
        "start": {"time": "2026-03-01T00:00:00"},
        "surfacings": [told | {"time": f"2026-03-01T0{k}:00:00"} for k in (1, 2)],
    }
    legs = [
        leg_of(start, (300.0 * k, 0.0), (0.0, 0.0), 5.0)
        for k, start in enumerate((at(-5.0), at(0.0) + 60.0, at(6.0)))
    ]
    first, second = surfaced(foretold, legs)
    assert "241 min later, 0.30 km away, inside" in first
    assert "540 min later, 0.60 km away, outside" in second
    assert surfaced(foretold, legs[:1]) == []
    assert surfaced(None, legs) == []


def test_power_and_current_that_changed_are_news(nothing):
    now = Morning(title="calypso", log=nothing).describe()
    before, after = (
        {**now, "energy": {"power_w": power}, "days_left": days, "current": [0.1, east]}
        for power, days, east in ((3.0, 20.0, 0.0), (4.0, 14.0, 0.3))
    )
    assert _moved(now, after) == []
    assert _moved(before, after) == [
        "Power so far went from 3.00 to 4.00 W, the days left from 20.0 to 14.0",
        "The current of the last dive differs by 0.30 m/s from that before",
    ]


def test_the_page_is_served_and_renewed_at_one_address(
    watched, base, source, run, monkeypatch, capsys
):
    made, pages, addresses = watched(), [], []

    def looked(_):
        addresses[:] = capsys.readouterr().err.partition("open ")[2].split()[:1] or addresses
        with urllib.request.urlopen(addresses[0]) as answer:
            pages.append(answer.read().decode())
        if len(pages) == 2:
            raise KeyboardInterrupt
        shutil.copy(base[0], source)

    monkeypatch.setattr("time.sleep", looked)
    run(made.folder, "--serve", "--port", "0")
    assert addresses[0].startswith("http://127.0.0.1:")
    assert "no file has arrived" in pages[0]
    assert "no file has arrived" not in pages[1]
