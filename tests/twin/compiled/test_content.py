"""Compiled code follows the content of its sources, where no other user can write."""

import json
import math
import os
import pickle
import shutil
import tempfile
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from patience import HANG_S
from processes import python
from trees import keep_compiled

from twin.compiled import cfunc, changed, content, dispatch, elementary, folder, jit
from twin.compiled.portable import portable

ROOT = Path(__file__).parents[3]
FLY = """
import json
import numpy as np
from twin.navigation.estimators.ekf import Ekf
from twin.identify.translation import AttitudeFlight, fly
from twin.vehicle.vehicle import load_vehicle

vehicle = load_vehicle("glider")
n = 200
level = np.zeros(n)
pitch = np.full(n, -0.4)
depth = 5.0 + 0.05 * np.arange(n)
pump = np.full(n, -200.0)
names = ("roll", "heading", "roll_rate", "pitch_rate", "yaw_rate", "shift", "rotation")
signals = {f"measured_{name}": level for name in names}
signals |= {"measured_pitch": pitch, "measured_depth": depth, "measured_pump": pump}
ekf = Ekf(vehicle, 0.5).batch(signals).surge[-1]
(motion,) = fly([AttitudeFlight(
    vehicle=vehicle, period=0.5, net_mass=np.full(n, 0.2), immersion=np.ones(n), roll=level,
    pitch=pitch, rates=np.zeros((3, n)))])
print(json.dumps({"ekf": ekf, "identify": motion.surge[-1]}))
"""


def test_an_edited_force_law_reaches_the_ekf_and_the_identification(tmp_path):
    """Both are in other packages than the law, and keep their compiled code between processes."""
    for package in ("twin", "learn", "assets"):
        shutil.copytree(ROOT / package, tmp_path / package,
                        ignore=shutil.ignore_patterns("__pycache__"))  # fmt: skip
    keep_compiled(tmp_path / "twin")  # so that only what is edited is compiled
    law = tmp_path / "twin" / "vehicle" / "laws" / "flow_frame.py"
    before = law.read_text()

    def run(text: str) -> dict[str, float]:
        law.write_text(text)
        os.utime(law, (1e9, 1e9))  # the time stamp tells nothing
        out = python("-c", FLY, cwd=tmp_path, PYTHONPATH=str(tmp_path))
        assert out.returncode == 0, out.stderr
        return json.loads(out.stdout)

    first = run(before)
    versions = {path.name for path in (tmp_path / "twin" / "__pycache__" / "compiled").iterdir()}
    drag = before.replace("    drag = (c[K_D0]", "    drag = 3.0 * (c[K_D0]")
    drag = drag.replace(
        "square * (one * drag + s * all_drag)", "3.0 * square * (one * drag + s * all_drag)"
    )
    assert drag.count("3.0 * ") == before.count("3.0 * ") + 2
    tripled = run(drag)
    assert tripled["ekf"] < 0.9 * first["ekf"]
    assert tripled["identify"] < 0.999 * first["identify"]
    # Both versions are kept side by side, and the first is found again as it was.
    kept = {path.name for path in (tmp_path / "twin" / "__pycache__" / "compiled").iterdir()}
    assert versions < kept
    assert {name.partition("-")[0] for name in kept - versions} >= {
        "twin.navigation.estimators.ekf",
        "twin.identify.translation",
    }
    assert run(before) == first
    assert {p.name for p in (tmp_path / "twin" / "__pycache__" / "compiled").iterdir()} == kept


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of files that nothing imports; it returns the stamp of its module `law`."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(content, "_STARTED", math.inf)
    root = tmp_path / "stamped"
    root.mkdir()
    files = {
        "__init__.py": "",
        "law.py": "from typing import TYPE_CHECKING\n"
        "import math, numpy as np\n"
        "from . import near  # (a note)\n"
        "from stamped.many import (  # one) two\n    first,\n    second as other,\n)\n"
        "from stamped \\\n    import far\n"
        "if TYPE_CHECKING:\n    from stamped.typed import T\n",
        "near.py": "from .deep import x as y\n",
        "deep.py": "x = 1\n\ndef late():\n    from stamped.bare import nothing\n",
        "bare/no_python.txt": "",
        "many/__init__.py": "",
        "many/first.py": "a = 1\n",
        "many/second.py": "a = 1\n",
        "far.py": "a = 1\n",
        "typed.py": "T = int\n",
        "alone.py": "a = 1\n",
    }
    for name, text in files.items():
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_text(text)

    def stamp(changed: str | None = None) -> str | None:
        if changed is not None:
            (root / changed).write_text(files[changed] + "# changed\n")
        content._stamp.cache_clear()
        content._search.cache_clear()
        return content.stamp("stamped.law")

    return stamp


@pytest.mark.parametrize(
    "name", ["law.py", "near.py", "deep.py", "many/first.py", "many/second.py", "far.py"]
)
def test_every_module_that_is_imported_counts(package, name):
    assert package() == package()
    assert package() != package(name)


@pytest.mark.parametrize("name", ["typed.py", "alone.py"])
def test_other_files_do_not(package, name):
    assert package() == package(name)


def test_source_that_changed_after_the_start_is_not_kept(package, monkeypatch):
    assert package() is not None
    monkeypatch.setattr(content, "_STARTED", time.time() - 3600.0)
    assert package() is None


def test_code_without_a_file_is_compiled_and_not_kept():
    space = {"__name__": "a_notebook", "jit": jit}
    exec("@jit\ndef twice(x):\n    return 2.0 * x\n", space)
    assert content.stamp("a_notebook") is None
    assert space["twice"](4.0) == 8.0


def test_numba_is_loaded_by_the_first_call_only():
    code = (
        "import sys, twin.compiled, twin.fossen.terms as f; before = 'numba' in sys.modules;"
        "assert abs(f.wet_section(0.1, 0.2) - 0.5) < 1e-15; print(before, 'numba' in sys.modules)"
    )
    out = python("-c", code)
    assert out.stdout.split() == ["False", "True"]


@jit
def half(x):
    """Half of x."""
    return 0.5 * x


def test_a_compiled_function_keeps_its_name_and_can_be_pickled():
    from twin.fossen.terms import wet_section

    assert (half.__name__, half.__doc__, half.__module__) == ("half", "Half of x.", __name__)
    assert pickle.loads(pickle.dumps(wet_section)) is wet_section


KERNELS = {1: half}
_of_kind = dispatch("_of_kind", ("x",), lambda: KERNELS, 0.0, module=__name__)


@jit
def by_kind(code, x):
    return _of_kind(code, x)


@jit
def by_module(x):
    return elementary.by_kind_of_a_test(1, x)


def closed_over(function):
    return jit(lambda code, x: function[0](code, x))


def test_a_new_kind_counts_for_what_calls_its_table_alone(monkeypatch):
    monkeypatch.setattr(elementary, "by_kind_of_a_test", by_kind, raising=False)

    def stamps():
        above = (by_kind, by_module, closed_over((by_kind,)), portable(by_kind), _of_kind)
        return [one._content() for one in above], [half._content(), portable(half)._content()]

    def plain(code, x):
        return by_kind(code, x)

    (through, others), callback = stamps(), content.stamp(__name__, plain)
    assert None not in (*through, *others, callback)
    monkeypatch.setitem(KERNELS, 2, elementary.sincos)
    changed()
    try:
        (after, same), again = stamps(), content.stamp(__name__, plain)
    finally:
        monkeypatch.undo()
        changed()
    assert all(one != other for one, other in zip(through, after, strict=True))
    assert again != callback
    assert same == others


def test_without_a_folder_it_compiles_and_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(folder, "candidates", lambda: iter([tmp_path / "file" / "x"]))
    (tmp_path / "file").write_text("")
    with pytest.warns(RuntimeWarning, match=r"not kept .*file.*; set XDG_CACHE_HOME"):
        assert folder.cache_root.__wrapped__() is None
    monkeypatch.setattr("twin.compiled.folder.cache_root", lambda: None)

    @jit
    def third(x):
        return x / 3.0

    assert third(6.0) == 2.0


def test_two_threads_that_compile_do_not_wait_for_each_other():
    from numba import types
    from numba.core.compiler_lock import global_compiler_lock

    later = threading.Thread(
        target=lambda: cfunc(types.void(types.float64))(lambda x: None), daemon=True
    )
    made = []

    def compiling() -> None:
        with global_compiler_lock:  # as numba holds it while it compiles what calls `half`
            later.start()
            time.sleep(0.3)  # until the other thread waits for that lock
            made.append(half.dispatcher)

    half = jit(lambda x: 0.5 * x)
    first = threading.Thread(target=compiling, daemon=True)
    first.start()
    first.join(HANG_S)
    assert len(made) == 1
    later.join(HANG_S)
    assert not later.is_alive()


# --- the folder that keeps it ---------------------------------------------------------------------


ME, OTHER = 1000, 1001
HOME = {"/": (0, 0o755), "/home": (0, 0o755), "/home/me": (ME, 0o700), "/home/me/c": (ME, 0o700)}
TEMPORARY = {"/": (0, 0o755), "/tmp": (0, 0o1777), "/tmp/c": (ME, 0o700)}


def refusal(monkeypatch, levels: dict[str, tuple[int, int]]) -> str | None:
    """What `folder.refusal` says of the last level when the file system looks like that."""
    monkeypatch.setattr(os, "getuid", lambda: ME)

    def stat(self, **_):
        owner, mode = levels[str(self)]
        return SimpleNamespace(st_uid=owner, st_mode=0o040000 | mode)

    monkeypatch.setattr(Path, "stat", stat)
    return folder.refusal(Path(list(levels)[-1]))


@pytest.mark.parametrize("levels", [HOME, TEMPORARY, {**HOME, "/home/me": (ME, 0o755)}])
def test_a_folder_of_this_user_is_trusted(monkeypatch, levels):
    assert refusal(monkeypatch, levels) is None


@pytest.mark.parametrize(
    ("levels", "message"),
    [
        ({**HOME, "/home/me/c": (OTHER, 0o700)}, "/home/me/c belongs to user 1001"),
        ({**HOME, "/home/me/c": (0, 0o755)}, "/home/me/c belongs to user 0"),
        ({**HOME, "/home": (OTHER, 0o755)}, "/home belongs to user 1001"),
        ({**HOME, "/home/me": (ME, 0o777)}, "/home/me can be written by others"),
        ({**HOME, "/home/me": (ME, 0o770)}, "/home/me can be written by others"),
        ({**HOME, "/home/me/c": (ME, 0o1777)}, "/home/me/c can be written by others"),
        ({**TEMPORARY, "/tmp": (0, 0o777)}, "/tmp can be written by others"),
        ({**TEMPORARY, "/tmp": (OTHER, 0o1777)}, "/tmp belongs to user 1001"),
        ({**TEMPORARY, "/": (0, 0o777)}, "/ can be written by others"),
    ],
)
def test_whoever_else_could_write_is_named(monkeypatch, levels, message):
    assert refusal(monkeypatch, levels) == message


def test_the_first_trusted_folder_is_taken(monkeypatch, tmp_path):
    places = [tmp_path / name for name in ("first", "second", "third")]
    monkeypatch.setattr(folder, "candidates", lambda: iter(places))
    real = folder.refusal
    monkeypatch.setattr(folder, "refusal", lambda path: "no" if path == places[0] else real(path))
    assert folder.cache_root.__wrapped__() == places[1].resolve()
    assert places[1].stat().st_mode & 0o777 == 0o700
    assert not places[2].exists()


def test_the_package_of_another_user_is_not_a_place(monkeypatch):
    package = Path(folder.__file__).parents[1]
    assert package / "__pycache__" / "compiled" in set(folder.candidates())
    monkeypatch.setattr(os, "getuid", lambda: package.stat().st_uid + 1)
    assert not any(package in place.parents for place in folder.candidates())


def test_only_versions_that_nobody_uses_are_removed(tmp_path):
    now = time.time()
    ages = {"old-1": 40.0, "used-1": 29.0, "new-1": 0.0}
    for name, days in ages.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "code").write_text("")
        os.utime(tmp_path / name, (now - days * 86_400.0,) * 2)
    folder.version_folder(tmp_path, "used-1")  # a process reads it: marked
    assert now - (tmp_path / "used-1").stat().st_mtime < 60.0
    assert (tmp_path / "old-1").exists()
    folder.version_folder(tmp_path, "newest-1")
    assert {path.name for path in tmp_path.iterdir()} == {"used-1", "new-1", "newest-1"}


def test_no_name_in_a_shared_folder_is_a_place(monkeypatch, tmp_path):
    """Others could make it first, or a link to a folder of ours whose old files would then go."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    assert not any(tmp_path in place.parents for place in folder.candidates())


@pytest.mark.parametrize("left", ["link", "open", "file"])
def test_what_others_left_in_the_folder_is_never_read(tmp_path, left):
    """A version's folder from a time when its root was open to others."""
    root, elsewhere = tmp_path / "root", tmp_path / "elsewhere"
    root.mkdir()
    elsewhere.mkdir()
    (elsewhere / "code").write_text("theirs")
    if left == "link":
        (root / "v-1").symlink_to(elsewhere)
    elif left == "file":
        (root / "v-1").write_text("theirs")
    else:
        (root / "v-1").mkdir()
        (root / "v-1" / "code").write_text("theirs")
        (root / "v-1").chmod(0o777)
    found = folder.version_folder(root, "v-1")
    assert list(found.iterdir()) == []
    assert found.stat().st_mode & 0o777 == 0o700
    assert (elsewhere / "code").exists()
