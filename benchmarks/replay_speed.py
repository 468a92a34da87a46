"""Replay speed: frame rate, opening time and size of replay pages, in Chromium without a GPU.

    python -m benchmarks.replay_speed                  # an hour, and a made-up month of dives
    python -m benchmarks.replay_speed real.zarr        # all dives of a log too

Chromium renders with SwiftShader on the CPU: a phone or a laptop is faster. If frames are slow, the
page renders moving pictures with fewer pixels; it does so in this benchmark too.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from browser import Browser
from pictures import month

from twin.mission.shipped_missions import load_mission_for
from twin.physics.scenario import Scenario
from twin.physics.simulation import simulate
from twin.records.reader import MissionStore
from twin.show.render.subject import CAMERAS, Shot, Subject, read_subject
from twin.show.web.page import LARGEST, save_page
from twin.vehicle.vehicle import load_vehicle

SECONDS = 3.0
"""[s] Playing time for each camera"""
LEAST = 20.0
"""[1/s] Required frame rate at 1280x720"""
COUNT = """new Promise(done => {
  page.setPlaying(true);
  let frames = 0;
  const begin = performance.now(), next = now => {
    frames++;
    if (now - begin < 1000 * SECONDS) requestAnimationFrame(next);
    else { page.setPlaying(false); done(1000 * frames / (now - begin)); }
  };
  requestAnimationFrame(next);
})""".replace("SECONDS", str(SECONDS))


def hour() -> Subject:
    """Load an hour of the shipped mission."""
    vehicle = load_vehicle("glider")
    flown = simulate(
        Scenario(vehicle=vehicle, mission=load_mission_for(vehicle, None), duration=3600.0)
    )
    return Subject(trajectory=flown, vehicle=vehicle, title="an hour")


def log(store: Path) -> Subject:
    """Load all dives of a log."""
    return read_subject(store, missions=range(len(MissionStore(store))), title=store.name)


def main(stores: list[str]) -> int:
    """Print a row for each page; exit code 1 if a camera is too slow or a page too large."""
    subjects = [hour(), month(), *(log(Path(store)) for store in stores)]
    bad = False
    cameras = "".join(f"{name:>8}" for name in CAMERAS)
    print(f"{'page':24}{'MB':>6}{'open s':>8}{cameras}   frames per second")
    with tempfile.TemporaryDirectory() as folder, Browser() as browser:
        for k, subject in enumerate(subjects):
            path = Path(folder) / f"{k}.html"
            size = save_page(path, subject, Shot())
            begin = time.perf_counter()
            browser.open(path)
            browser.drawn()
            opened = time.perf_counter() - begin
            rates = []
            for camera in CAMERAS:
                browser.run(f"page.chooseCamera('{camera}'), page.seek(page.recording.last / 2)")
                browser.drawn()
                rates.append(browser.run(COUNT))
            bad |= min(rates) < LEAST or size > LARGEST
            shown = "".join(f"{rate:8.1f}" for rate in rates)
            print(f"{subject.title[:23]:24}{size / 1e6:6.2f}{opened:8.2f}{shown}")
    return int(bad)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
