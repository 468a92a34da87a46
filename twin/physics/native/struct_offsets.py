"""Struct offsets: bytes at which MuJoCo stores the fields that the native callbacks use.

The offsets are derived from MuJoCo's own introspection tables, laid out by ctypes under C rules.
Each is then proven on live structs of two differently sized probe models: its word must hold the
address (or value) that MuJoCo's Python API reports. A mismatch raises `LayoutError`, because a
wrong offset must never become a wild write.

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

_MODEL_FIELDS = (
    "nnumericdata", "numeric_data", "nq", "nv", "nu", "na", "nbody", "nuserdata", "nmocap",
)  # fmt: skip
_DATA_FIELDS = (
    "time", "qpos", "qvel", "act", "ctrl", "userdata", "xfrc_applied", "xpos", "xmat", "xipos", "M",
    "qfrc_passive", "mocap_pos", "mocap_quat", "ncon",
)  # fmt: skip
_FIELDS = [("mjModel", n) for n in _MODEL_FIELDS] + [("mjData", n) for n in _DATA_FIELDS]
"""Fields that native code reads, by slot of the table; the time step takes the last slot."""
SLOTS = len(_FIELDS) + 1
(
    M_NUMERIC_COUNT, M_NUMERIC_DATA, M_NQ, M_NV, M_NU, M_NA, M_NBODY, M_NUSERDATA, M_NMOCAP,
    D_TIME, D_QPOS, D_QVEL, D_ACT, D_CTRL, D_USERDATA, D_XFRC_APPLIED, D_XPOS, D_XMAT, D_XIPOS,
    D_MASS, D_QFRC_PASSIVE, D_MOCAP_POS, D_MOCAP_QUAT, D_NCON, M_TIMESTEP,
) = range(SLOTS)  # fmt: skip
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
    """Translate an introspected C type into its ctypes equivalent."""
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
    """Table of byte offsets, int64, shape (SLOTS,), from the introspection tables."""
    structs: dict[str, Any] = {
        name: _structure(name, STRUCTS[name].fields) for name in ("mjModel", "mjData", "mjOption")
    }
    try:
        table = [getattr(structs[owner], name).offset for owner, name in _FIELDS]
        table.append(structs["mjModel"].opt.offset + structs["mjOption"].timestep.offset)
    except AttributeError as error:
        raise LayoutError(f"MuJoCo {mujoco.__version__}: {error}; {_ADVICE}") from error
    return np.array(table, np.int64)


def prove(table: np.ndarray, numeric_size: int, user_size: int) -> None:
    """Check every offset against a live probe model and data of unusual sizes.

    Raises:
      LayoutError: a field is not where the table says; the message names the first one.
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
    mujoco.mj_fwdPosition(model, data)  # makes three contacts, so that ncon is not 0
    owners = {"mjModel": model, "mjData": data}
    checks = [(owner, name, getattr(owners[owner], name)) for owner, name in _FIELDS]
    checks.append(("mjModel", "opt.timestep", timestep))
    assert checks[M_NUMERIC_COUNT][2] == numeric_size
    assert checks[D_TIME][2] == time
    for slot, (owner, name, value) in enumerate(checks):
        expected = value.ctypes.data if isinstance(value, np.ndarray) else value
        whole = ctypes.c_int32 if slot == D_NCON else ctypes.c_int64
        kind: Any = ctypes.c_double if isinstance(value, float) else whole
        found = kind.from_address(owners[owner]._address + int(table[slot])).value
        if found != expected:
            raise LayoutError(
                f"MuJoCo {mujoco.__version__}: {owner}.{name} is not at byte {table.tolist()}: "
                f"found {found}, expected {expected}; {_ADVICE}"
            )


@functools.cache
def publish() -> np.ndarray:
    """Derive, prove and return the layout table, and publish its address to native code.

    Raises:
      LayoutError: the structs of this MuJoCo differ from their introspection.
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
    """Publish the address of a text buffer to native code under `name`, and keep the buffer."""
    _TEXTS.append(text)
    _define_address(name, ctypes.addressof(text))


_TEXTS: list[Any] = []


def library_path() -> Path:
    """Path of the MuJoCo shared library that this process runs."""
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco.so.*", "libmujoco.*.dylib", "mujoco.dll"):
        for path in sorted(folder.glob(pattern)):
            return path
    raise LayoutError(f"MuJoCo {mujoco.__version__}: no shared library in its package; {_ADVICE}")


_ENGINES: list[Any] = []


def _define_address(name: str, address: int) -> None:
    """Define a native function `int64 name(void)` that returns `address`."""
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
