"""Mornings: pages as of three moments in the past of real deployments, compared with what came.

    python -m benchmarks.mornings FOLDER [NAME ...] [--out PAGES]

FOLDER holds real logs whose licence lets pages of them be shown, as `DEPLOYMENTS` names them. Each
deployment's files are watched by `--as-of` at a quarter, a half and three quarters of its dives,
with the shipped vehicle of its kind: nothing is tuned on what follows. Printed is a row a morning.
"""

from __future__ import annotations

import datetime
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks import command
from glider_twin_ops.forecast import legs_of
from glider_twin_ops.pages.morning_page import LATEST, PAGE
from glider_twin_ops.watching import WatchedDeployment, one_pass
from glider_twin_ops.watching.changes import surfaced
from glider_twin_ops.watching.deployment_folder import SETTINGS
from glider_twin_ops.watching.log_of_files import LOG, log_of_files
from glider_twin_ops.watching.watch_pass import PAST
from twin.records.logged import LogStore

DEPLOYMENTS = {
    "unit334 2023-09": ("slocum_unit334_2023", "unit334_*.*", "slocum-200"),
    "comet 2016-06": (
        "slocum_comet_dvl_2016",
        "comet2016_flight.parquet comet2016_gps.csv",
        "slocum-200",
    ),
    "SG171 2024": ("seaglider_apl_ad2cp", "sg171_*_samples.parquet sg171_*_dives.csv", "seaglider"),
    "SG561 2016-05": ("seaglider_apl_basestation3", "sg561_*", "seaglider"),
    "SEA035 M12": ("seaexplorer_pyglider", "sea035_M12_gli.csv.gz", "seaexplorer"),
    "modena 2016-09": ("slocum_seus_2016", "modena-*/*.sbd cache/*", "slocum-200"),
    "salacia 2017-07": ("slocum_seus_2017", "salacia-*/*.sbd", "slocum-200"),
}
"""Folder, patterns of files in it, and shipped vehicle"""
PARTS = (0.25, 0.5, 0.75)
PAUSE = 600.0
"""[s] Time from a dive's end to the moment of the page"""


def mornings(name: str, folder: Path, place: Path) -> list[dict[str, str]]:
    """Rows of a deployment, one for each moment.

    Args:
      folder: folder of all real logs. place: folder in which the deployment is made.
    """
    where, patterns, vehicle = DEPLOYMENTS[name]
    source = place / "arrived"
    source.mkdir(parents=True, exist_ok=True)
    for pattern in patterns.split():
        for path in sorted((folder / where).glob(pattern)):
            if not (source / path.name).exists():
                (source / path.name).symlink_to(path)
    made = WatchedDeployment(
        folder=place / name.replace(" ", "-"), source=str(source), vehicle=vehicle
    )
    if not (made.folder / SETTINGS).exists():
        made.write()
    log = log_of_files(made, made.folder)
    if log.store is None:
        raise SystemExit(f"{name}: {log.missing}")
    with LogStore(made.folder / LOG) as logs:
        newest = logs.deployments[int(np.argmax(np.nan_to_num(logs.starts, nan=-np.inf)))]
        legs = legs_of(logs, newest)
    rows = []
    for part in PARTS:
        end = legs[max(round(part * len(legs)) - 1, 0)].leg.end
        moment = datetime.datetime.fromtimestamp(round(end + PAUSE), datetime.UTC)
        one_pass(made, until=moment)
        page = made.folder / PAST / f"{moment:%Y-%m-%dT%H%M%S}" / PAGE / LATEST
        said = json.loads(page.read_text())
        found = said["forecast"]["surfacings"] if said["forecast"] else []
        came = surfaced(said["forecast"], legs)
        next_one, days, what = "not told", said["days_left"], "nothing yet"
        if found:
            axes = (found[0]["ellipse_90"][f"semi_{one}_m"] / 1e3 for one in ("major", "minor"))
            next_one = "{}, {:.2f} x {:.2f} km".format(found[0]["time"][11:16], *axes)
        if came:  # when and where it was against what was foretold
            what = ", ".join(came[0].partition("it came up ")[2].split(", ")[1:3])
        rows.append({
            "deployment": name,
            "as of, UTC": f"{moment:%Y-%m-%d %H:%M}",
            "dives": f"{len(said['dives'])}",
            "verdict": said["verdict"].partition(";")[0].rpartition(": ")[2],
            "next surfacing": next_one,
            "days left": "not known" if days is None else f"{days:.1f}",
            "what came": what,
            "inside": f"{sum(', inside the' in one for one in came)} of {len(came)}",
        })  # fmt: skip
    return rows


def main(
    folder: command.Positional[Path],
    names: command.Positional[tuple[str, ...]] = (),
    *,
    out: Path | None = None,
) -> None:
    """Print a table in Markdown; the pages stay in --out.

    Args:
      names: of deployments; all if not given.
    """
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        for name in names or DEPLOYMENTS:
            place = (out or Path(temporary)) / name.replace(" ", "-")
            rows += mornings(name, folder.resolve(), place)
    print(command.markdown(list(rows[0]), [list(row.values()) for row in rows]))


if __name__ == "__main__":
    sys.exit(command.run(main))
