"""`factory reference`: the reference set, made and compared with its list of checksums."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from factory.commands.generate import import_numpy_with_one_thread, show_summary, watching
from twin.cli.console import Console, JsonOption
from twin.errors import InputError

MOST_NAMED = 8
"""Arrays that are named when more than so many differ."""


@dataclass(frozen=True, kw_only=True)
class WriteReference(JsonOption):
    """Make the reference set of 200 h and compare every array with its checksum, so that results of
    different groups are results on the same data. Exit code 1 when an array differs.

    Example:

        factory reference --out data/reference.zarr
    """

    name: str = "field-200h"
    """which set: field-200h, or field-2h to try"""
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
        """Generate, compare, and say what differs."""
        import_numpy_with_one_thread()
        from factory.sampling import reference_set
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
            self._generate(console)
        elif not self.out.exists():
            raise InputError(f"{self.out} is not there: leave --compare out to make it")
        wrong = wanted.differences(array_checksums(self.out))
        console.answer(reference=wanted.name, arrays=len(wanted.arrays), differences=wrong)
        if not wrong:
            console.say(f"{self.out} is {wanted.name}: {len(wanted.arrays)} arrays, all as listed")
            return 0
        named = list(wrong.items())[:MOST_NAMED]
        more = f" and {len(wrong) - len(named)} more" if len(wrong) > len(named) else ""
        console.item(
            f"{self.out} is NOT {wanted.name}, {len(wrong)} of {len(wanted.arrays)} arrays: "
            + ", ".join(f"{name} {what}" for name, what in named)
            + more
        )
        console.item(
            "The lists are of x86_64 and the library versions of constraints.txt; `factory info` "
            "names what a store was made with."
        )
        return 1

    def _generate(self, console: Console) -> None:
        from factory.generation import generate
        from factory.sampling import make_recipe, reference_set

        wanted = reference_set(self.name)
        recipe = make_recipe(preset=wanted.preset, hours=wanted.hours, seed=wanted.seed)
        with watching(recipe.plan.hours, console) as watch:
            summary = generate(
                recipe,
                self.out,
                workers=self.workers,
                resume=self.resume,
                overwrite=self.overwrite,
                history=f"factory reference --name {wanted.name}",
                watch=watch,
            )
        show_summary(recipe, summary, console)
