"""Where MuJoCo keeps the fields that the native callbacks use, derived and proven at load.

Offsets come from MuJoCo's own introspection tables, laid out by ctypes under the C rules. They
are then proven against live structs of two differently sized probe models: each word must hold
the address (or value) that MuJoCo's Python API reports, and native code must read the same.
Anything else raises `LayoutError`: a wrong offset must never become a wild write.

Native code reads the table through the symbol `glider_twin_layout`, so compiled code stays
valid in its cache when MuJoCo changes.
"""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import mujoco
import numpy as np
from llvmlite import ir
from mujoco.introspect import ast_nodes
from mujoco.introspect.structs import STRUCTS

from twin.errors import LayoutError

# Slots of the table that native code reads.
M_NUMERIC_COUNT, M_NUMERIC_DATA, M_TIMESTEP = 0, 1, 2
D_TIME, D_QPOS, D_QVEL, D_ACT, D_CTRL, D_USERDATA = 3, 4, 5, 6, 7, 8
D_XFRC_APPLIED, D_XPOS, D_XMAT, D_XIPOS, D_MASS = 9, 10, 11, 12, 13
D_QFRC_PASSIVE = 20
M_NQ, M_NV, M_NU, M_NA, M_NBODY, M_NUSERDATA = 14, 15, 16, 17, 18, 19
M_NMOCAP, D_MOCAP_POS, D_MOCAP_QUAT, D_NCON = 21, 22, 23, 24
SLOTS = 25

_MODEL_FIELDS = {
    M_NUMERIC_COUNT: "nnumericdata",
    M_NUMERIC_DATA: "numeric_data",
    M_NQ: "nq",
    M_NV: "nv",
    M_NU: "nu",
    M_NA: "na",
    M_NBODY: "nbody",
    M_NUSERDATA: "nuserdata",
    M_NMOCAP: "nmocap",
}
_DATA_FIELDS = {
    D_TIME: "time",
    D_QPOS: "qpos",
    D_QVEL: "qvel",
    D_ACT: "act",
    D_CTRL: "ctrl",
    D_USERDATA: "userdata",
    D_XFRC_APPLIED: "xfrc_applied",
    D_XPOS: "xpos",
    D_XMAT: "xmat",
    D_XIPOS: "xipos",
    D_MASS: "M",
    D_QFRC_PASSIVE: "qfrc_passive",
    D_MOCAP_POS: "mocap_pos",
    D_MOCAP_QUAT: "mocap_quat",
    D_NCON: "ncon",
}
_HALF_WORDS = (D_NCON,)
"""Slots of 32-bit integers"""
_SCALARS: dict[str, Any] = {
    "mjtSize": ctypes.c_int64,
    "mjtNum": ctypes.c_double,
    "mjtBool": ctypes.c_bool,
    "int": ctypes.c_int32,
    "float": ctypes.c_float,
    "char": ctypes.c_char,
    "size_t": ctypes.c_size_t,
    "uintptr_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
}
_ADVICE = "install the MuJoCo version that constraints.txt pins"


def _ctype(node: Any) -> Any:
    """The ctypes equivalent of an introspected C type."""
    if isinstance(node, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(node, ast_nodes.ArrayType):
        ctype = _ctype(node.inner_type)
        for extent in reversed(node.extents):
            ctype = ctype * extent
        return ctype
    if isinstance(node, ast_nodes.AnonymousStructDecl):
        return _structure("anonymous", node.fields)
    if node.name in _SCALARS:
        return _SCALARS[node.name]
    if node.name in STRUCTS:
        return _structure(node.name, STRUCTS[node.name].fields)
    raise LayoutError(f"MuJoCo {mujoco.__version__}: unknown C type {node.name!r}; {_ADVICE}")


def _structure(name: str, fields: Any) -> type[ctypes.Structure]:
    layout = [(field.name, _ctype(field.type)) for field in fields]
    return type(name, (ctypes.Structure,), {"_fields_": layout})


def derive() -> np.ndarray:
    """The table of byte offsets, int64, shape (SLOTS,), from the introspection tables."""
    model = _structure("mjModel", STRUCTS["mjModel"].fields)
    data = _structure("mjData", STRUCTS["mjData"].fields)
    option = _structure("mjOption", STRUCTS["mjOption"].fields)
    table = np.zeros(SLOTS, np.int64)
    try:
        for slot, name in _MODEL_FIELDS.items():
            table[slot] = getattr(model, name).offset
        table[M_TIMESTEP] = model.opt.offset + option.timestep.offset
        for slot, name in _DATA_FIELDS.items():
            table[slot] = getattr(data, name).offset
    except AttributeError as error:
        raise LayoutError(f"MuJoCo {mujoco.__version__}: {error}; {_ADVICE}") from error
    return table


def prove(table: np.ndarray, numeric_size: int, user_size: int) -> None:
    """Check every offset against a live probe model and data of unusual sizes.

    Raises:
      LayoutError: naming the first field that is not where the table says.
    """
    timestep, time = 0.0123, 98765.4321
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}"/><size nuserdata="{user_size}"/>
        <custom><numeric name="probe" size="{numeric_size}" data="0"/></custom>
        <worldbody><body mocap="true"><geom size="1"/><geom size="2"/><geom size="3"/>
        </body><body><freejoint/><geom size="1" mass="0"/>
        <inertial pos="0.1 0 0" mass="3" diaginertia="1 1 1"/>
        <body><joint name="j" type="slide"/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
        </body></body></worldbody>
        <actuator><general joint="j" dyntype="integrator"/><pid joint="j"/></actuator></mujoco>"""
    )
    data = mujoco.MjData(model)
    data.time = time
    mujoco.mj_fwdPosition(model, data)  # finds three contacts

    def word(owner: Any, slot: int, kind: Any) -> Any:
        return kind.from_address(owner._address + int(table[slot])).value

    checks: list[tuple[str, Any, Any]] = [
        ("mjModel.nnumericdata", word(model, M_NUMERIC_COUNT, ctypes.c_int64), numeric_size),
        ("mjModel.opt.timestep", word(model, M_TIMESTEP, ctypes.c_double), timestep),
        ("mjData.time", word(data, D_TIME, ctypes.c_double), time),
    ]
    for owner, fields, label in ((model, _MODEL_FIELDS, "mjModel"), (data, _DATA_FIELDS, "mjData")):
        for slot, name in fields.items():
            value = getattr(owner, name)
            if isinstance(value, int):
                kind = ctypes.c_int32 if slot in _HALF_WORDS else ctypes.c_int64
                checks.append((f"{label}.{name}", word(owner, slot, kind), value))
            if isinstance(value, np.ndarray):
                address = word(owner, slot, ctypes.c_size_t)
                checks.append((f"{label}.{name}", address, value.ctypes.data))
    for name, found, expected in checks:
        if found != expected:
            raise LayoutError(
                f"MuJoCo {mujoco.__version__}: {name} is not at byte {table.tolist()}: "
                f"found {found}, expected {expected}; {_ADVICE}"
            )


@functools.cache
def publish() -> np.ndarray:
    """Derive, prove and publish the layout table to native code; returns it.

    Raises:
      LayoutError: the structs of this MuJoCo are not as introspected.
    """
    if np.dtype(mujoco.MJTNUM_DTYPE) != np.float64:
        raise LayoutError(
            "this MuJoCo was built with single-precision mjtNum; use a standard build"
        )
    table = derive()
    prove(table, 487, 3917)
    prove(table, 389, 4409)
    _define_address("glider_twin_layout", table.ctypes.data)
    return table


def publish_text(name: str, text: ctypes.Array) -> None:
    """Let native code find the characters of an immortal buffer by `name`."""
    _TEXTS.append(text)
    _define_address(name, ctypes.addressof(text))


_TEXTS: list[Any] = []


def library_path() -> Path:
    """The MuJoCo shared library that this process runs."""
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco.so.*", "libmujoco.*.dylib", "mujoco.dll"):
        for path in sorted(folder.glob(pattern)):
            return path
    raise LayoutError(f"MuJoCo {mujoco.__version__}: no shared library in its package; {_ADVICE}")


_ENGINES: list[Any] = []


def _define_address(name: str, address: int) -> None:
    """Define the native function `int64 name(void)` that returns `address`."""
    module = ir.Module(name)
    function = ir.Function(module, ir.FunctionType(ir.IntType(64), []), name)
    ir.IRBuilder(function.append_basic_block()).ret(ir.Constant(ir.IntType(64), address))
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(str(module)), machine)
    engine.finalize_object()
    _ENGINES.append(engine)  # owns the code
    llvm.add_symbol(name, engine.get_function_address(name))
