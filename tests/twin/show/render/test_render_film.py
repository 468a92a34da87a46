"""Files that `twin render` writes, with one worker or two; OpenGL found, released or missing."""

import gc
import os
import shutil
import warnings
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from pictures import call, needs_gl, refused, write_tracks
from PIL import Image
from processes import python

from twin.records.store import read_trajectory
from twin.show.render import context
from twin.show.render.context import NoOpenGL, new_context
from twin.show.render.film import save_video
from twin.show.render.subject import Shot


def read_video(path):
    """Metadata and frames of a video."""
    with warnings.catch_warnings():
        # the reader leaves its pipes to the garbage collector, which must not wait for another test
        warnings.simplefilter("ignore", ResourceWarning)
        reader = imageio_ffmpeg.read_frames(str(path))
        meta = next(reader)
        width, height = meta["size"]
        frames = [np.frombuffer(f, np.uint8).reshape(height, width, 3) for f in reader]
        reader.close()
        del reader
        gc.collect()
    return meta, frames


@needs_gl
def test_mp4(capsys, store, tmp_path):
    out = tmp_path / "new" / "dive.mp4"
    words = ("render", store, "--mission", 1, "--out", out, "--size", "160x96", "--fps", 10)
    code, said, _ = call(capsys, *words, "--start", 100, "--end", 200, "--speed-up", 100)
    assert code == 0
    assert "11 frames" in said
    meta, frames = read_video(out)
    assert meta["size"] == (160, 96)
    assert meta["fps"] == pytest.approx(10.0)
    assert meta["duration"] == pytest.approx(1.1, abs=0.06)
    assert len(frames) == 11
    assert all(frame.std() > 5.0 for frame in frames)
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 60
    assert not list(out.parent.glob(".*"))  # no draft is left


@needs_gl
def test_gif(capsys, store, tmp_path):
    out = tmp_path / "dive.gif"
    words = ("render", store, "--out", out, "--size", "160x96", "--camera", "side", "--workers", 1)
    assert call(capsys, *words, "--fps", 5, "--speed-up", 300)[0] == 0
    with Image.open(out) as gif:
        assert gif.size == (160, 96)
        assert gif.n_frames == 6
        assert gif.info["loop"] == 0
        durations = []
        for index in range(gif.n_frames):
            gif.seek(index)
            durations.append(gif.info["duration"])
            assert len(gif.convert("RGB").getcolors(1 << 16)) > 30
    assert sum(durations) == pytest.approx(1200, abs=30)


@needs_gl
def test_png_of_a_moment(capsys, store, tmp_path):
    out, tracks = tmp_path / "dive.png", tmp_path / "tracks.npz"
    write_tracks(tracks, read_trajectory(store))
    words = ("render", store, "--out", out, "--size", "160x96", "--time", 150)
    code, _, err = call(capsys, *words, "--tracks", tracks, "--only", "steady_flight")
    assert (code, err) == (0, "")
    with Image.open(out) as picture:
        assert picture.size == (160, 96)
    told = refused(capsys, *words, "--tracks", tracks, "--only", "netwrk")
    assert "did you mean 'network'" in told


@needs_gl
def test_two_workers_give_the_same_frames_as_one(subject, tmp_path):
    shot = Shot(width=128, height=80, fps=10.0, speed_up=300.0, camera="chase")
    videos = []
    for workers in (1, 2):
        path = tmp_path / f"{workers}.gif"
        assert save_video(path, subject, shot, workers=workers) == 11
        videos.append(path.read_bytes())
    assert videos[0] == videos[1]


PAINT = """
import sys
from twin.show.render import context
if sys.argv[1] == "osmesa":
    context._egl_works = lambda: False
from pictures import short_subject
from twin.show.render.film import still
from twin.show.render.subject import Shot
subject = short_subject()
shot = Shot(width=96, height=64)
for _ in range(2):
    frame = still(subject, shot, at=100.0)
# one context is left open on purpose: the end of the process has to release it
kept = context.new_context(64, 64)
print(context.available_backend(), round(float(frame.std())))
"""


def painted_by(backend):
    chosen = ("MUJOCO_GL", "PYOPENGL_PLATFORM", "DISPLAY")
    environment = {k: v for k, v in os.environ.items() if k not in chosen}
    environment["PYTHONPATH"] = str(Path(__file__).parents[3])
    return python("-W", "always::ResourceWarning", "-c", PAINT, backend, env=environment)


@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_contexts_are_released_without_a_word(backend):
    works = {"egl": context._egl_works, "osmesa": context._osmesa_works}[backend]
    if not works():
        pytest.skip(f"{backend} is not installed: {context.BACKENDS[backend]}")
    done = painted_by(backend)
    assert done.returncode == 0, done.stderr
    name, spread = done.stdout.split()
    assert name == backend
    assert int(spread) > 10
    assert done.stderr == ""


def test_without_egl_it_takes_osmesa(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    monkeypatch.setattr(context, "_egl_works", lambda: False)
    monkeypatch.setattr(context, "_osmesa_works", lambda: True)
    assert context.available_backend() == "osmesa"


@pytest.mark.parametrize("switch", ["", "egl", "osmesa", "disable"])
def test_with_neither_it_names_the_packages(capsys, store, tmp_path, monkeypatch, switch):
    monkeypatch.setenv("MUJOCO_GL", switch)
    monkeypatch.setattr(context, "_egl_works", lambda: False)
    monkeypatch.setattr(context, "_osmesa_works", lambda: False)
    with pytest.raises(NoOpenGL, match=r"libegl1 libopengl0 libgl1-mesa-dri.* libosmesa6"):
        new_context(64, 64)
    code, _, err = call(capsys, "render", store, "--out", tmp_path / "a.png")
    assert code == 1
    assert "libosmesa6" in err
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


DAMAGE = {
    "empty chunk": (lambda s: next(_chunks(s, "true_depth")).write_bytes(b""), "true_depth"),
    "missing array": (lambda s: shutil.rmtree(s / "true_pitch"), "true_pitch is gone"),
    "missing states": (lambda s: shutil.rmtree(s / "simulation_state"), "simulation_state is gone"),
    "no states": (
        lambda s: [chunk.unlink() for chunk in _chunks(s, "simulation_state")],
        "its array simulation_state is gone",
    ),
    "truncated metadata": (
        lambda s: (s / "zarr.json").write_text((s / "zarr.json").read_text()[:400]),
        "its zarr.json cannot be read",
    ),
    "no samples": (
        lambda s: [c.unlink() for c in _chunks(s, "n_samples")],
        "its array n_samples is gone",
    ),
}


def _chunks(store, name):
    return (path for path in sorted((store / name / "c").rglob("*")) if path.is_file())


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_store_is_one_line(capsys, store, tmp_path, damage):
    broken = shutil.copytree(store, tmp_path / "broken.zarr")
    inflict, message = DAMAGE[damage]
    inflict(broken)
    for command, out in (("render", "a.png"), ("plot", "b.png")):
        told = refused(capsys, command, broken, "--out", tmp_path / out)
        assert message in told
        assert str(broken) in told
        assert "bug" not in told
        assert not (tmp_path / out).exists()
