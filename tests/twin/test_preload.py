"""Triton's library goes before OpenGL, so that it does not bind to Mesa's LLVM."""

import importlib.util
import json
import os
import shutil
import sys
from pathlib import Path

import numpy.random.bit_generator as any_library
import pytest
from processes import python

from twin.extras import preload_triton
from twin.show.render.context import available_backend

ROOT = Path(__file__).parents[2]
REPORT = """
import json
import sys
opened = []
def listen(event, arguments):
    if event == "ctypes.dlopen":
        opened.append(str(arguments[0]))
sys.addaudithook(listen)
"""
"""Notes every library that ctypes opens: PyOpenGL, GLFW and this project open OpenGL through it."""
PLACES = {
    "context": "from twin.show.render.context import available_backend; available_backend()",
    "suite": "import twin.control.dm_suite",
    "screen": """
import os
os.environ["DISPLAY"] = ":987"
from twin.show.render.context import NoScreen, require_screen
try:
    require_screen()
except NoScreen:
    pass
""",
    "window": """
from types import SimpleNamespace
from queue import SimpleQueue
import mujoco.viewer
from twin.show.render.context import NoScreen
from twin.show.render.window import Window
def no_window(*arguments, **options):
    opened.append("glfw window")
    raise RuntimeError("none here")
mujoco.viewer.launch_passive = no_window
opened.clear()  # the import of MuJoCo finds OpenGL's libraries and opens none
try:
    with Window._open(
        SimpleNamespace(_stage=SimpleNamespace(model=None), _data=None, _keys=SimpleQueue())
    ):
        pass
except NoScreen:
    pass
""",
}
"""Each place of the project that opens OpenGL"""
DRAWN_BEFORE = {
    "by the suite": """
import twin.control
environment = twin.control.load("hold", task_kwargs={"random": 1})
assert environment.physics.render(camera_id=0).std() > 0
""",
    "by a picture": """
from twin.show.render.context import new_context
new_context(64, 64)
""",
    "by the user": """
import mujoco
mujoco.GLContext(64, 64).make_current()
from twin.extras import preload_triton
preload_triton()
""",
}
TRAIN = """
import torch
weight = torch.nn.Parameter(torch.ones(1))
torch.optim.Adam([weight], lr=0.1)
print("alive", "triton" in sys.modules)
"""


def printed(code: str, *folders: Path, **variables: str) -> str:
    """What a process of its own prints."""
    known = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    path = os.pathsep.join(map(str, (*folders, ROOT)))
    done = python("-c", code, env=known, **{"PYTHONPATH": path, **variables})
    assert done.returncode == 0, f"exit code {done.returncode}: {done.stderr}"
    return done.stdout


@pytest.fixture
def stand_in(tmp_path):
    """A folder with a package `triton` whose library is some small one; importing it fails."""
    library = tmp_path / "triton" / "_C" / "libtriton.so"
    library.parent.mkdir(parents=True)
    shutil.copy(any_library.__file__, library)
    (tmp_path / "triton" / "__init__.py").write_text("raise SystemError('imported')\n")
    return tmp_path


def is_opengl(library: str) -> bool:
    return any(name in library.lower() for name in ("egl", "osmesa", "glfw", "libgl", "libopengl"))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Mesa's LLVM is Linux's affair")
@pytest.mark.parametrize("backend", ["", "egl"])
@pytest.mark.parametrize("place", PLACES)
def test_triton_is_opened_before_opengl(place, backend, stand_in):
    if backend and available_backend() is None:
        pytest.skip("nothing here can draw")
    code = f"{REPORT}{PLACES[place]}\nprint(json.dumps(opened))"
    opened = json.loads(printed(code, stand_in, MUJOCO_GL=backend).splitlines()[-1])
    triton = opened.index(str(stand_in / "triton" / "_C" / "libtriton.so"))
    opengl = [k for k, library in enumerate(opened) if is_opengl(library)]
    assert opengl, opened
    assert triton < opengl[0], opened


def test_a_library_that_does_not_load_is_left_alone(stand_in):
    (stand_in / "triton" / "_C" / "libtriton.so").write_text("no library")
    code = f"{REPORT}from twin.extras import preload_triton\npreload_triton()\nprint(opened)"
    assert "libtriton.so" in printed(code, stand_in)


def test_without_triton_nothing_is_opened(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.delitem(sys.modules, "triton", raising=False)
    opened: list[str] = []
    monkeypatch.setattr("ctypes.CDLL", lambda library, **_: opened.append(library))
    preload_triton.cache_clear()
    preload_triton()
    assert opened == []


@pytest.mark.skipif(
    importlib.util.find_spec("triton") is None,
    reason="triton is not installed; it comes with PyTorch's CUDA build",
)
@pytest.mark.skipif(available_backend() is None, reason="nothing here can draw")
@pytest.mark.parametrize("who", DRAWN_BEFORE)
def test_training_after_drawing(who):
    code = f"import sys\n{DRAWN_BEFORE[who]}{TRAIN}"
    assert printed(code, MUJOCO_GL=available_backend() or "") == "alive True\n"
