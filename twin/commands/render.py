"""Command `twin render`: a picture, a video or a page of a stored mission, without a screen."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from twin.cli.console import Console, JsonOption
from twin.errors import FloorError, InputError

if TYPE_CHECKING:
    from twin.show.render import Shot, Subject


OUT, SIZE = Path("mission.mp4"), "1280x720"  # default file and size
VIDEO_FPS, GIF_FPS = 30.0, 12.5
"""[1/s] Default frame rates of videos and gifs. A gif's clock counts hundredths of a second."""
OF_A_SHOT = [
    "camera",
    "speed_up",
    "start",
    "end",
    "colour",
    "exaggeration",
    "floor",
    "hud",
    "inset",
]
"""Options that are fields of `Shot`, under equal names"""


@dataclass(frozen=True, kw_only=True)
class Render(JsonOption):
    """Draw a stored mission: .png is one picture, .mp4 and .gif are videos, .html is a page that
    replays it in any browser.

    Examples:

        twin render run.zarr --out dive.png --time 2500
        twin render run.zarr --html dive.html
    """

    store: Annotated[Path, tyro.conf.Positional]
    """store (zarr) that holds the mission"""
    mission: int = 0
    """index of the mission in the store"""
    missions: str | None = None
    """dives of a log in one picture, such as 0-11,14, or all; in place of --mission"""
    out: Path = OUT
    """file to write: .png, .mp4, .gif or .html; an existing file is replaced without asking"""
    html: Path | None = None
    """page to write, in place of --out: one .html file that replays the mission offline; an
    existing file is replaced without asking"""
    camera: Literal["orbit", "side", "map", "chase"] = "orbit"
    """orbit circles the track, side and map show the whole track, chase follows the glider"""
    size: str | None = None
    """width x height in pixels; default: 1280x720"""
    fps: float | None = None
    """frames per second of a video; default: 30, for a gif 12.5"""
    speed_up: float | None = None
    """mission seconds per video second; default: the video lasts 20 s, a page's replay about 60"""
    start: float | None = None
    """first mission time shown [s]"""
    end: float | None = None
    """last mission time shown [s]"""
    time: float | None = None
    """mission time of a .png, or first time that a page shows [s]; default: the last known moment
    for a .png, the first for a page"""
    colour: Literal["speed", "current", "depth", "error"] | None = None
    """quantity that colours the track; default: speed, or depth in a log without speed; error is
    that of the first of --tracks"""
    tracks: Path | None = None
    """dead-reckoned tracks to draw beside the true one: .nc, .zarr, .npz or .csv"""
    only: str | None = None
    """names of the tracks to draw, separated by commas; default: all tracks of the file"""
    exaggeration: float | None = None
    """vertical over horizontal scale; default: chosen to fit"""
    floor: float | None = None
    """depth [m] of the picture's lower end; default: below the mission's sea floor, or for a
    mission without one a little below the deepest point, on a made-up floor"""
    hud: bool = True
    """draw readouts, labels and legend"""
    inset: bool = True
    """draw a close-up of the glider"""
    title: str | None = None
    """first line of the picture; default: from the store"""
    vehicle: str | None = None
    """for a log: vehicle to draw, by name or MJCF file (:PRESET after it), whose flight model
    gives the velocities; default: the shipped vehicle of the log's type"""
    workers: int | None = None
    """number of processes that draw a video; default: one per core"""

    def run(self, console: Console) -> int:
        """Draw the picture, video or page, and write the file."""
        import time

        from twin.show.render import STILL_FORMATS, VIDEO_FORMATS, Shot
        from twin.show.web import ENDINGS, save_page

        out = self._target()
        suffix = out.suffix.lower()
        if suffix not in (*STILL_FORMATS, *VIDEO_FORMATS, *ENDINGS):
            allowed = ", ".join((*STILL_FORMATS, *VIDEO_FORMATS, ENDINGS[0]))
            raise InputError(f"--out {out}: the ending must be one of {allowed}")
        width, height = parse_size(self.size or SIZE)
        fps = self.fps if self.fps is not None else (GIF_FPS if suffix == ".gif" else VIDEO_FPS)
        given = {name: getattr(self, name) for name in OF_A_SHOT}
        shot = Shot(width=width, height=height, fps=fps, **given)
        if suffix in ENDINGS:
            idle = {
                "--size": self.size is not None,
                "--fps": self.fps is not None,
                "--no-hud": not self.hud,
                "--no-inset": not self.inset,
                "--workers": self.workers is not None,
            }
            if odd := [name for name, here in idle.items() if here]:
                raise InputError(
                    f"{', '.join(odd)}: not for a page, which fills its window and draws in the "
                    "browser; --camera, --time, --start, --end, --speed-up, --colour, --tracks, "
                    "--exaggeration and --floor are"
                )
        elif self.time is not None and suffix not in STILL_FORMATS:
            raise InputError("--time is for a .png or a page; for a video give --start and --end")
        subject, begun = self._subject(console), time.perf_counter()
        if suffix in ENDINGS:
            answer = {"bytes": save_page(out, subject, shot, self.time)}
            told, then = "", "; open it in a browser"
        else:
            answer = {"frames": self._draw(console, out, subject, shot)}
            answer |= {"width": width, "height": height, "bytes": out.stat().st_size}
            frames, then = answer["frames"], ""
            many = f"{frames} frames, {frames / shot.fps:.1f} s of video, " if frames > 1 else ""
            told = f"{many}{width}x{height}, "
        seconds = time.perf_counter() - begun
        console.say(f"{out}: {told}{answer['bytes'] / 1e6:.2f} MB, made in {seconds:.1f} s{then}")
        console.answer(out=out, **answer, seconds=seconds)
        return 0

    def _target(self) -> Path:
        """Path of the file to write."""
        if self.html is None:
            return self.out
        if self.out != OUT:
            raise InputError(f"--out {self.out} and --html {self.html}: give one of them")
        if self.html.suffix.lower() not in (".html", ".htm"):
            raise InputError(f"--html {self.html}: the ending must be .html")
        return self.html

    def _subject(self, console: Console) -> Subject:
        """Read the flight to draw, and report what is missing from it."""
        from twin.show.render import OTHER_TRACKS, read_subject

        read = functools.partial(
            read_subject,
            self.store,
            self.mission,
            missions=self._missions(),
            vehicle=self.vehicle,
            tracks=self.tracks,
            names=self.only,
            title=self.title,
        )
        try:
            subject = read()
        except FloorError as error:
            console.warn(f"{error}; what is drawn has a made-up sea floor or none")
            subject = read(floor=False)
        colours = len(OTHER_TRACKS)
        if len(subject.tracks) > colours:
            console.note(
                f"{len(subject.tracks)} tracks share {colours} colours; --only chooses some"
            )
        unflown = getattr(subject.trajectory, "unflown", "")  # only trajectories of logs have this
        if unflown:
            console.note(f"without a flight model, by the log's own track: {unflown}")
        return subject

    def _draw(self, console: Console, out: Path, subject: Subject, shot: Shot) -> int:
        """Write a picture or a video and return its number of frames."""
        from twin.show.render import STILL_FORMATS, default_workers, save_still, save_video

        if out.suffix.lower() in STILL_FORMATS:
            save_still(out, subject, shot, self.time)
            return 1
        total = len(shot.frame_times(subject.trajectory.time))
        workers = default_workers() if self.workers is None else self.workers
        with console.progress(total=total, label="render", unit="frames") as progress:
            return save_video(out, subject, shot, workers=workers, progress=progress.update)

    def _missions(self) -> list[int] | None:
        """Dives that --missions names; None without the option."""
        if self.missions is None:
            return None
        from twin.cli.options import parse_rows
        from twin.records import MissionStore

        if self.tracks is not None:
            raise InputError("--tracks are of one mission; give --mission in place of --missions")
        rows = parse_rows(self.missions)
        if rows is not None:
            return rows
        with MissionStore(self.store) as store:
            return list(range(len(store)))


def parse_size(text: str) -> tuple[int, int]:
    """Parse width and height [pixel] from a text such as 1280x720; raise InputError if it fails."""
    width, separator, height = text.lower().partition("x")
    if not (separator and width.isdecimal() and height.isdecimal()):
        raise InputError(f"--size {text!r} must be WIDTHxHEIGHT in pixels, such as 1280x720")
    return int(width), int(height)
