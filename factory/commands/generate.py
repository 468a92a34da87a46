"""Commands `factory generate`, `reference`, `finish`, `distributions`: make randomised missions."""

from __future__ import annotations

import contextlib
import os
import shlex
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.options import EngineOption, Hours, StoreArgument
from twin.cli.program import interruption
from twin.errors import InputError, unknown_name

if TYPE_CHECKING:
    from factory.generation import StorePart, Summary, Watcher
    from factory.sampling import Recipe

DEPLOYMENTS = "faulty", "piloted"
"""Presets that make whole deployments; NAME-satellite keeps only the data sent by satellite."""
DEFAULT_OUT = Path("data/missions.zarr")
MOST_NAMED = 8
"""Number of differing arrays that are named, the first by name; further ones are counted."""
BLAS_THREADS = "OPENBLAS_NUM_THREADS"


@dataclass(frozen=True, kw_only=True)
class Generate(EngineOption, JsonOption):
    """Fly randomised missions in parallel and store them; --workers does not change the bytes.

    Examples:

        factory generate --hours 10
        factory generate --preset field --vehicle seaglider --hours 100 --seed 3 --out field.zarr
    """

    hours: Hours | None = None
    """simulated time of all missions together, such as 10 (hours), 90min or 2d [default: 10];
    presets faulty, piloted make whole deployments of at least this time together [default: 240]"""
    preset: str = "paper"
    """paper: noise-free, constant current; with a propeller: still water, the paper's instruments.
    field: sensor errors, sheared and tidal currents, changed vehicles, GPS at the surface.
    family: as field, but the vehicles differ widely from their file, and the missions are longer.
    paper-test: the paper's three test missions of a glider.
    faulty: deployments of 20 to 60 dives, stored like imported logs; half have a labelled fault.
    piloted: as faulty, with a pilot who changes settings, and with gaps in the log.
    faulty-satellite, piloted-satellite: only the data sent by satellite (docs/howto/health.md)"""
    seed: int = 0
    """root of every random draw"""
    out: StoreArgument = DEFAULT_OUT
    """the store: a folder, or an address such as s3://bucket/missions.zarr (needs the extra: pip
    install "glider-twin[cloud]")"""
    workers: int | None = None
    """number of processes [default: the CPUs that this process may use]"""
    scheduler: str | None = None
    """address of a dask scheduler, tcp://HOST:PORT, whose workers fly the missions; they must see
    --out under the same path (needs the extra: pip install "glider-twin[cluster]")"""
    set: tuple[str, ...] = ()
    """replace distributions: NAME=DISTRIBUTION ..., such as mission.pitch_deg="uniform(15,35)";
    `factory distributions` lists the names"""
    config: Path | None = None
    """TOML file with distributions to replace: tables [mission], [vehicle], [current], [water],
    [floor]"""
    vehicle: str = "glider"
    """shipped vehicle name, or the path of an MJCF file; :PRESET after it selects a preset in it"""
    sensors: str | None = None
    """sensor suite instead of the preset's: ideal, field, field-uncalibrated, field-no-dvl, survey
    or survey-field; +NAME adds a sensor of an installed plugin"""
    labels: Literal["truth", "camera"] = "truth"
    """velocities that networks can learn: the truth, or beside it those by a camera that sees
    markers on the vehicle (plugins/vision)"""
    current: str | None = None
    """one current for all missions instead of sampled ones, as in `twin simulate`, such as
    grid:FILE.nc,lat=49,lon=-16,time=2000-01-05"""
    shard: str | None = None
    """i/n: fly part i of n (0 to n - 1) and stop; the commands for all parts may run at once, on
    machines that share --out, and `factory finish` completes the store [default: the task's part
    in a Slurm job array]"""
    resume: bool = False
    """complete a store that an earlier run left incomplete; start it if it is missing"""
    overwrite: bool = False
    """replace an existing store, once the new one is complete"""

    def run(self, console: Console) -> int:
        """Generate with a progress bar, and summarise."""
        import_numpy_with_one_thread()
        from factory.generation import dask_executor, generate, parse_part, slurm_part

        if self.preset.startswith(DEPLOYMENTS):
            return self._deployments(console)
        part = slurm_part() if self.shard is None else parse_part(self.shard)
        recipe = self._recipe()
        history = shlex.join([console.prog, *sys.argv[1:]])
        names = ("workers", "resume", "overwrite")
        how: dict[str, Any] = {name: getattr(self, name) for name in names}
        try:
            if part is not None:
                return self._part(recipe, part, history, console)
            with contextlib.ExitStack() as stack:
                executor = None
                if self.scheduler is not None:
                    executor = stack.enter_context(dask_executor(self.scheduler))
                watch = stack.enter_context(watching(recipe.plan.hours, console))
                summary = generate(
                    recipe, self.out, executor=executor, history=history, watch=watch, **how
                )
        except (KeyboardInterrupt, SystemError) as error:
            if interruption(error) is None:
                raise
            raise KeyboardInterrupt(
                f"finished shards of missions are kept beside {self.out}; the same command with "
                "--resume goes on from there"
            ) from None
        if summary.flown == 0:
            console.note(f"store {self.out} was already complete")
        show_summary(recipe, summary, console)
        return 0

    def _deployments(self, console: Console) -> int:
        """Make deployments of many dives, half of them with a fault."""
        from factory.facade import make_deployments

        drawn = ("set", "config", "sensors", "labels", "current", "shard", "resume", "scheduler")
        for name in drawn:
            if getattr(self, name) != getattr(Generate, name):
                raise InputError(
                    f"--{name} does not go with preset {self.preset}: its deployments are drawn as "
                    "they are, by this machine, whole or not at all"
                )
        if not isinstance(self.out, Path):
            raise InputError(f"preset {self.preset} is written into a folder, not to {self.out}")
        names = ("vehicle", "preset", "hours", "seed", "workers", "overwrite")
        given = {name: getattr(self, name) for name in names}
        with watching(240.0 if self.hours is None else self.hours, console) as watch:
            made = make_deployments(self.out, **given, watch=lambda hours: watch(hours, 0))
        console.answer(
            out=made.store, preset=self.preset, seed=self.seed, deployments=made.deployments,
            faulty=made.faulty, dives=made.dives, days=made.days,
        )  # fmt: skip
        console.pairs(
            {
                "store": str(made.store),
                "deployments": f"{made.deployments}, {made.faulty} with a fault",
                "dives": made.dives,
                "under way": f"{made.days:.1f} d",
            },
            title=f"preset {self.preset}, seed {self.seed}",
        )
        return 0

    def _part(self, recipe: Recipe, part: StorePart, history: str, console: Console) -> int:
        from factory.generation import generate_part, hours_of

        for name in ("overwrite", "workers", "scheduler"):
            if getattr(self, name):
                raise InputError(
                    f"--{name} does not go with --shard: a part is flown by one process and only "
                    "adds what is missing"
                )
        with watching(hours_of(recipe, part), console) as watch:
            flown, missions = generate_part(recipe, self.out, part, history=history, watch=watch)
        console.answer(
            out=self.out, part=part.index, parts=part.count, missions=missions, flown=flown
        )
        console.note(
            f"part {part.index} of {part.count}: {missions} missions, {flown} flown now; when all "
            f"parts have run: factory finish {self.out}"
        )
        return 0

    def _recipe(self) -> Recipe:
        from factory.sampling import PRESETS, check_room, make_recipe, read_changes

        if self.preset not in PRESETS:
            satellite = (f"{name}-satellite" for name in DEPLOYMENTS)
            presets = [*PRESETS, *DEPLOYMENTS, *satellite]
            raise InputError(unknown_name("preset", self.preset, presets))
        # a resumed store may be nearly complete, and an object storage has no disk that could fill
        if self.hours is not None and not self.resume and isinstance(self.out, Path):
            check_room(self.hours, self.out)
        names = ("preset", "hours", "seed", "vehicle", "sensors", "labels", "current", "engine")
        given = {name: getattr(self, name) for name in names}
        return make_recipe(changes=read_changes(self.config, self.set), **given)


@dataclass(frozen=True, kw_only=True)
class WriteReference(JsonOption):
    """Make the reference set of 200 h and compare every array with its checksum, so that different
    groups have results on the same data. The exit code is 1 if an array differs.

    Example:

        factory reference --out data/reference.zarr
    """

    name: str = "field-200h"
    """name of the set: field-200h, or field-2h for a quick try"""
    out: Path = Path("data/reference.zarr")
    """the store"""
    compare: bool = False
    """compare an existing store without flying"""
    workers: int | None = None
    """processes [default: the CPUs that this process may use]"""
    resume: bool = False
    """complete a store that an earlier run left incomplete"""
    overwrite: bool = False
    """replace an existing store, once the new one is complete"""

    def run(self, console: Console) -> int:
        """Generate, compare, and print the differences."""
        import_numpy_with_one_thread()
        from factory.generation import generate
        from factory.sampling import make_recipe, reference_set
        from twin import load_vehicle
        from twin.records.storage import array_checksums

        wanted = reference_set(self.name)
        if self.compare and (self.overwrite or self.resume or self.workers is not None):
            raise InputError(
                "--compare does not fly: leave out --workers, --resume and --overwrite"
            )
        physics = load_vehicle().physics_version
        if wanted.physics != physics:
            raise InputError(
                f"the checksums of {wanted.name} are of physics {wanted.physics}, this is physics "
                f"{physics}: install the version of glider-twin that has them"
            )
        if not self.compare:
            recipe = make_recipe(preset=wanted.preset, hours=wanted.hours, seed=wanted.seed)
            names = ("workers", "resume", "overwrite")
            how: dict[str, Any] = {name: getattr(self, name) for name in names}
            history = f"factory reference --name {wanted.name}"
            with watching(recipe.plan.hours, console) as watch:
                summary = generate(recipe, self.out, history=history, watch=watch, **how)
            show_summary(recipe, summary, console)
        elif not self.out.exists():
            raise InputError(f"{self.out} is not there: leave --compare out to make it")
        wrong = wanted.differences(array_checksums(self.out))
        console.answer(reference=wanted.name, arrays=len(wanted.arrays), differences=wrong)
        if not wrong:
            console.say(f"{self.out} is {wanted.name}: {len(wanted.arrays)} arrays, all as listed")
            return 0
        named = list(wrong.items())[:MOST_NAMED]
        more = f" and {len(wrong) - len(named)} more" if len(wrong) > len(named) else ""
        listing = ", ".join(f"{name} {what}" for name, what in named)
        console.item(
            f"{self.out} is NOT {wanted.name}, {len(wrong)} of {len(wanted.arrays)} arrays: "
            f"{listing}{more}"
        )
        console.item(
            "The lists are of x86_64 and the library versions of constraints.txt; `factory info` "
            "names what a store was made with."
        )
        return 1


@dataclass(frozen=True, kw_only=True)
class Finish(JsonOption):
    """Complete a store that `factory generate --shard` made in parts; a single run would make the
    same bytes. If parts are missing, list them in the form of Slurm's --array.

    Example:

        factory finish big.zarr
    """

    store: Annotated[StoreArgument, tyro.conf.Positional]
    """the store"""

    def run(self, console: Console) -> int:
        """Finish and summarise."""
        import_numpy_with_one_thread()
        from factory.generation import finish

        summary, recipe = finish(self.store)
        show_summary(recipe, summary, console)
        return 0


@dataclass(frozen=True, kw_only=True)
class Distributions(JsonOption):
    """List every parameter with its distribution, unit and reason.

    Examples:

        factory distributions --preset field
        factory distributions --set mission.pitch_deg="uniform(15,35)"
    """

    preset: Literal["paper", "field", "family", "paper-test"] = "paper"
    """preset whose distributions are listed"""
    set: tuple[str, ...] = ()
    """replaced distributions, as in `factory generate`"""
    vehicle: str = "glider"
    """shipped vehicle name, or the path of an MJCF file; :PRESET after it selects a preset in it"""
    config: Path | None = None
    """TOML file with replaced distributions"""

    def run(self, console: Console) -> int:
        """Print the table."""
        from factory.sampling import PRESETS, override, parameter_table, read_changes
        from twin import load_vehicle

        changes = read_changes(self.config, self.set)
        table = parameter_table(load_vehicle(self.vehicle))
        drawn = override(PRESETS[self.preset].distributions(table), changes)
        texts = {name: distribution.text() for name, distribution in drawn.items()}
        console.table(
            [
                {
                    "parameter": name,
                    "distribution": text,
                    "unit": table[name].unit,
                    "what": table[name].long_name,
                    "why": table[name].why,
                }
                for name, text in texts.items()
            ]
        )
        console.answer(preset=self.preset, vehicle=self.vehicle, distributions=texts)
        return 0


def show_summary(recipe: Recipe, summary: Summary, console: Console) -> None:
    """Show the summary of a run as a table and as JSON."""
    from twin.physics import ENGINES
    from twin.records import SPLITS

    raw, size = recipe.float32_bytes, summary.stored_bytes
    engine = {} if recipe.engine == ENGINES[0] else {"engine": recipe.engine}
    console.answer(
        out=summary.store,
        preset=recipe.preset,
        seed=recipe.seed,
        **engine,
        missions=summary.missions,
        hours=summary.hours,
        flown=summary.flown,
        failed=summary.failed,
        wall_s=summary.wall_s,
        times_real_time=summary.times_real_time,
        stored_bytes=size,
        float32_bytes=raw,
    )
    counts = {name: recipe.plan.splits.count(i) for i, name in enumerate(SPLITS)}
    splits = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
    speed = f", {summary.times_real_time:,.0f} times real time" if summary.flown else ""
    console.pairs(
        {
            "store": str(summary.store),
            **engine,
            "missions": f"{summary.missions} ({splits})",
            "simulated": f"{summary.hours:.4g} h",
            "failed and replaced": summary.failed,
            "time": f"{summary.wall_s:.1f} s{speed}",
            "size": f"{size / 1e6:.1f} MB, {size / 1e6 / summary.hours:.2f} MB per simulated hour, "
            f"{100 * size / raw:.0f} % of float32 uncompressed",
        },
        title=f"preset {recipe.preset}, seed {recipe.seed}",
    )


@contextlib.contextmanager
def watching(hours: float, console: Console) -> Iterator[Watcher]:
    """Show a progress bar over `hours` [h]; yields the function to call for a finished mission."""
    with console.progress(total=hours, label="generate", unit="h") as progress:

        def watch(flown: float, failures: int) -> None:
            progress.update(flown)
            if failures:
                progress.note(f"a mission failed {failures} times and was replaced")

        yield watch


def import_numpy_with_one_thread() -> None:
    """Import numpy with a BLAS that starts no threads, unless numpy is imported already.

    Worker processes share the CPUs, and forks are safest from a process with one thread. BLAS
    reads the environment variable once; the environment is unchanged afterwards.
    """
    if BLAS_THREADS in os.environ:
        return
    os.environ[BLAS_THREADS] = "1"
    try:
        import numpy  # noqa: F401
    finally:
        del os.environ[BLAS_THREADS]
