"""On-board cost on a small processor: the exported C code on an emulated Cortex-M4F.

    pip install ziglang unicorn
    python -m benchmarks.onboard_cortex STORE [--kinds ema] [--members 1] [--run RUN]
                                        [--samples 7200] [--optimise 2]

`ziglang` is a C compiler for the processor, `unicorn` an emulator of it. The networks are those of
`benchmarks.onboard_step`, over the first samples of the store's longest mission. Printed are

- the bytes of code and constants, of the state, and of the stack that a step uses;
- the counted instructions of a step;
- the difference of the velocities from those of the same code on this machine;
- the routines for double, or for float in software, that the image holds.

Cycles are an estimate, since the emulator counts none. Each instruction has the cycles of the
Cortex-M4's manual (ARM DDI 0439B, tables 3-1 and 7-1), without memory wait states.
"""

from __future__ import annotations

import dataclasses
import re
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import command
from benchmarks.onboard_step import Asked, candidates
from learn.data.dataset import MissionSequence
from learn.networks.c_export import c_header, find_compiler, run_c
from learn.networks.predictor import Ensemble
from twin.navigation.c_math import c_features
from twin.navigation.settings import sources
from twin.vehicle.vehicle import Vehicle

MEGAHERTZ = 168
"""[MHz] Clock rate for the printed times: an STM32F4's"""
TARGET = ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m4+vfp4d16sp")
FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Wdouble-promotion", "-Werror", "-fno-math-errno", "-g")
LIBRARY = {
    "math.h": '#define INFINITY __builtin_inff()\n#define NAN __builtin_nanf("")\n'
    "#define sqrtf __builtin_sqrtf\n#define fabsf __builtin_fabsf\n",
    "string.h": "#include <stddef.h>\n#define memcpy __builtin_memcpy\n"
    "#define memmove __builtin_memmove\n#define memset __builtin_memset\n",
}
"""C library functions that the header uses; the compiler replaces most by instructions"""
MAIN = """\
#include "glider_velocity.h"
glider_state state;
glider_sample sample;
glider_velocity velocity;
int step(void) { return glider_step(&state, &sample, &velocity); }
void _start(void) { glider_reset(&state), step(); }
"""
SOFTWARE = re.compile(
    r"__aeabi_(?:[df](?:add|sub|rsub|mul|div|neg|cmp|2)|[iul]+2[df]|c[df])|"
    r"__(?:add|sub|mul|div|neg|cmp|eq|ne|l[te]|g[te]|fix|float|extend|trunc)\w*[sdt]f"
)
"""Names of routines for floating point in software"""
STACK, ROOM, PAINT = 0x20000000, 1 << 16, 0xA5
HOME = 0x30000000
"""Return address of a step"""


def packages() -> tuple[Any, Any]:
    """Import unicorn and its ARM constants.

    Raises:
      SystemExit: a package is missing.
    """
    try:
        import unicorn
        import ziglang  # noqa: F401
        from unicorn import arm_const
    except ImportError as error:
        raise SystemExit(
            f"{error.name} is missing: this benchmark needs a C compiler for the Cortex-M4F and an "
            "emulator of it, `pip install ziglang unicorn`"
        ) from None
    return unicorn, arm_const


def compiled(header: str, folder: Path, optimise: str) -> bytes:
    """Compile a header's step to an image (ELF) for a Cortex-M4F."""
    for name, text in (LIBRARY | {"glider_velocity.h": header, "main.c": MAIN}).items():
        (folder / name).write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "ziglang", "cc", *TARGET, *FLAGS, f"-O{optimise}", "-I."]
    subprocess.run([*command, "main.c", "-o", "image", "-Wl,--gc-sections"], cwd=folder, check=True)
    return (folder / "image").read_bytes()


@dataclasses.dataclass(frozen=True)
class Image:
    """Program in 32-bit ELF."""

    data: bytes

    def segments(self) -> list[tuple[int, bytes, int]]:
        """Address, bytes, and size in memory of each loaded segment."""
        start, size, count = (
            *struct.unpack_from("<I", self.data, 28),
            *struct.unpack_from("<HH", self.data, 42),
        )
        rows = (struct.unpack_from("<8I", self.data, start + k * size) for k in range(count))
        return [(r[2], self.data[r[1] : r[1] + r[4]], r[5]) for r in rows if r[0] == 1 and r[5]]

    def symbols(self) -> dict[str, tuple[int, int]]:
        """Address and size of each symbol by name."""
        start, size, count = (
            *struct.unpack_from("<I", self.data, 32),
            *struct.unpack_from("<HH", self.data, 46),
        )
        sections = [struct.unpack_from("<10I", self.data, start + k * size) for k in range(count)]
        (table,) = (s for s in sections if s[1] == 2)
        names, found = sections[table[6]][4], {}
        for k in range(table[4], table[4] + table[5], 16):
            name, address, length = struct.unpack_from("<3I", self.data, k)
            end = self.data.index(b"\0", names + name)
            found[self.data[names + name : end].decode()] = (address, length)
        return found

    def software(self) -> list[str]:
        """Floating-point routines in software."""
        return sorted(name for name in self.symbols() if SOFTWARE.match(name))


def cost(code: bytes) -> tuple[int, int]:
    """Instructions and cycles of a block of Thumb code, run from start to end."""
    count = cycles = k = 0
    while k < len(code):
        first = struct.unpack_from("<H", code, k)[0]
        long = first >> 11 in (0b11101, 0b11110, 0b11111)
        second = struct.unpack_from("<H", code, k + 2)[0] if long else 0
        k, count, cycles = k + (4 if long else 2), count + 1, cycles + _cycles(first, second, long)
    return count, cycles + 2  # a block mostly ends with a taken branch


def _cycles(first: int, second: int, long: bool) -> int:
    """Cycles of one instruction."""
    if not long:
        several = first >> 12 == 0b1100 or first & 0xF600 == 0xB400  # LDM, STM; PUSH, POP
        single = first >> 12 in (5, 6, 7, 8, 9) or first >> 11 == 0b01001
        return 1 + (first & 0x1FF).bit_count() if several else 2 if single else 1
    if first & 0xFF00 == 0xEE00 and second & 0x0E00 == 0x0A00 and not second & 0x10:
        kind = first & 0xB0
        if kind == 0x80 or (kind == 0xB0 and first & 0xF == 1 and second & 0xC0 == 0xC0):
            return 14  # VDIV, VSQRT
        return 3 if kind in (0x00, 0x10, 0x90, 0xA0) else 1  # multiply-accumulate
    if first & 0xFE00 == 0xEC00:  # VLDR, VSTR; VLDM, VSTM, VPUSH, VPOP
        return 2 if first & 0x0120 == 0x0100 else 1 + (second & 0xFF)
    if first & 0xFE40 == 0xE800:  # LDM, STM, PUSH, POP
        return 1 + second.bit_count()
    if first & 0xFE00 == 0xF800 or first & 0xFE40 == 0xE840:  # LDR, STR, LDRD, STRD
        return 2 if first & 0x0200 == 0 and first >> 9 == 0x7C else 3
    divides = first & 0xFFD0 == 0xFB90
    return 12 if divides else 1


class Processor:
    """Emulated Cortex-M4F that runs an image."""

    def __init__(self, image: Image) -> None:
        unicorn, arm = packages()
        self._arm, self.symbols = arm, image.symbols()
        self._uc = uc = unicorn.Uc(
            unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS
        )
        uc.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        pages = {a >> 12 for start, _, size in image.segments() for a in range(start, start + size)}
        for page in (*pages, HOME >> 12):
            uc.mem_map(page << 12, 1 << 12)
        uc.mem_map(STACK, ROOM)
        for address, data, _ in image.segments():
            uc.mem_write(address, data)
        uc.mem_write(STACK, bytes([PAINT]) * ROOM)
        self._blocks: dict[tuple[int, int], tuple[int, int]] = {}
        self._spent = np.zeros(2, np.int64)
        uc.hook_add(unicorn.UC_HOOK_BLOCK, self._see)

    def _see(self, uc: Any, address: int, size: int, _: Any) -> None:
        key = (address, size)
        if key not in self._blocks:
            self._blocks[key] = cost(bytes(uc.mem_read(address, size)))
        self._spent += self._blocks[key]

    def step(self, sample: bytes) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Run a step: velocity and its standard deviations, (4,); instructions and cycles used."""
        self._spent[:] = 0
        self._uc.mem_write(self.symbols["sample"][0], sample)
        self._uc.reg_write(self._arm.UC_ARM_REG_SP, STACK + ROOM)
        self._uc.reg_write(self._arm.UC_ARM_REG_LR, HOME | 1)
        self._uc.emu_start(self.symbols["step"][0] | 1, HOME)
        assert self._uc.reg_read(self._arm.UC_ARM_REG_R0) == 1, "a channel had no good value"
        said = bytes(self._uc.mem_read(*self.symbols["velocity"]))
        return np.frombuffer(said, np.float32), self._spent.copy()

    def stack(self) -> int:
        """Bytes of the stack that were written."""
        room = bytes(self._uc.mem_read(STACK, ROOM))
        return len(room.lstrip(bytes([PAINT])))


@dataclasses.dataclass(frozen=True)
class Cost:
    """Cost of steps on the processor."""

    image: Image
    velocities: NDArray[np.float32]
    """Surge, sway and their standard deviations [m/s], (time, 4)"""
    spent: NDArray[np.int64]
    """Instructions and cycles of each step, (time, 2)"""
    stack: int

    def lines(self, here: NDArray[np.float32]) -> list[str]:
        """Lines to print; `here` are the velocities by the same code on this machine."""
        loaded, symbols = self.image.segments(), self.image.symbols()
        median, most = np.median(self.spent, 0), self.spent.max(0)
        off = np.abs(self.velocities[:, :2] - here[: len(self.velocities), :2])
        at = [f"{n:.0f} ({1e-3 * n / MEGAHERTZ:.2f} ms)" for n in (median[1], most[1])]
        return [
            f"code and constants {sum(len(d) for _, d, _ in loaded)} B, state "
            f"{symbols['state'][1]} B, stack {self.stack} B",
            f"instructions per step: median {median[0]:.0f}, largest {most[0]:.0f}",
            f"cycles per step, estimated, at {MEGAHERTZ} MHz: median {at[0]}, largest {at[1]}",
            f"from the same code on this machine: {off.max():.1g} m/s at most, "
            f"{np.sqrt(np.mean(off**2)):.1g} m/s in root mean square",
            f"routines for floats in software: {', '.join(self.image.software()) or 'none'}",
        ]


def measured(
    networks: dict[str, Ensemble],
    mission: MissionSequence,
    vehicle: Vehicle | None,
    samples: int,
    optimise: str = "2",
) -> tuple[Cost, NDArray[np.float32]]:
    """Run a mission's first samples on the processor, and all samples on this machine."""
    packages()
    channels = sources(c_features(networks["surge"].members[0].features, mission.period).channels)
    given = np.stack([mission.signals[name] for name in channels], 1).astype(np.float32)[:samples]
    header = c_header(networks, mission.period, vehicle)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        image = Image(compiled(header, folder, optimise))
        here, _ = run_c(folder / "glider_velocity.h", networks, mission, find_compiler())
    processor = Processor(image)
    steps = [processor.step(row.tobytes()) for row in given]
    velocities, spent = (np.array(found) for found in zip(*steps, strict=True))
    return Cost(image, velocities, spent, processor.stack()), here


def main(
    asked: command.OmitArgPrefixes[Asked], *, samples: int = 7200, optimise: str = "2"
) -> None:
    """Print the cost of a step for each network type. optimise: -O of the compiler, s, 2 or 3."""
    packages()
    for name, networks, missions, vehicle in candidates(asked):
        cost, here = measured(networks, missions[0], vehicle, samples, optimise)
        print(f"{name}, {len(cost.spent)} samples, -O{optimise}")
        for line in cost.lines(here):
            print(f"  {line}", flush=True)


if __name__ == "__main__":
    sys.exit(command.run(main))
