"""MuJoCo for compiled code: the address of its step function, and where its contacts lie.

MuJoCo's Python bindings cost as much per physics step as the step itself. A compiled loop needs
only addresses: of ``mj_step``, of the model and the state, and of the contacts within the state.
The offsets follow from the struct descriptions that MuJoCo ships (`mujoco.introspect`). Before any
plant relies on them, they are compared with the addresses and values that the bindings show of a
ball on a plane.

One thing differs from the bindings: they turn a fatal error inside MuJoCo (such as too little
memory for its solver) into an exception, while here it ends the process.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from llvmlite import ir
from mujoco.introspect import ast_nodes
from mujoco.introspect.structs import STRUCTS
from numba import carray, njit, types
from numba import config as numba_config
from numba.extending import intrinsic

from simloop.physics.track_model import ContactArrays

_C_TYPES: dict[str, Any] = {
    "int": ctypes.c_int,
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "mjtBool": ctypes.c_bool,
    "size_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "uintptr_t": ctypes.c_size_t,
    "float": ctypes.c_float,
}
_BALL = (
    "<mujoco><worldbody><geom type='plane' size='1 1 1'/><body pos='0 0 .09'><freejoint/>"
    "<geom size='.1'/></body></worldbody></mujoco>"
)
_LIBRARIES = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")


class Engine(NamedTuple):
    """MuJoCo's addresses, as compiled code takes them.

    Attributes:
        step: Address of ``mj_step``.
        model: Address of the ``mjModel``.
        data: Address of the ``mjData``.
        contact_count: Address of the number of contacts.
        contacts: Address of the pointer to the contacts.
        row_count: Address of the number of constraints.
        forces: Address of the pointer to the constraints' forces.
        size: Size of a contact, bytes.
        pos: Offset of a contact's position, bytes.
        frame: Offset of its axes.
        geom: Offset of its geoms.
        row: Offset of its row among the constraints.
    """

    step: int
    model: int
    data: int
    contact_count: int
    contacts: int
    row_count: int
    forces: int
    size: int
    pos: int
    frame: int
    geom: int
    row: int


@contextmanager
def warnings_heard() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings instead of having them printed and written to a file.

    Yields:
        The texts, in order, as they come.
    """
    heard: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(heard.append)
    try:
        yield heard
    finally:
        mujoco.set_mju_user_warning(before)


@cache
def _struct(name: str) -> type[ctypes.Structure]:
    """Build the ctypes twin of one of MuJoCo's structs."""
    fields = [(f.name, _c_type(f.type)) for f in STRUCTS[name].fields]  # type: ignore[union-attr]
    return type(name, (ctypes.Structure,), {"_fields_": fields})


def _c_type(node: Any) -> Any:
    """Return the ctypes twin of a described type."""
    if isinstance(node, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(node, ast_nodes.ArrayType):
        made = _c_type(node.inner_type)
        for extent in reversed(node.extents):
            made = made * extent
        return made
    return _C_TYPES[node.name] if node.name in _C_TYPES else _struct(node.name)


def _step_address() -> int:
    """Return the address of ``mj_step`` in the library that the bindings use."""
    folder = Path(mujoco.__file__).parent
    path = next(path for pattern in _LIBRARIES for path in sorted(folder.glob(pattern)))
    library = ctypes.CDLL(str(path))
    if library.mj_version() != mujoco.mj_version():
        raise OSError(f"{path}: not the version that the bindings use")
    address = ctypes.cast(library.mj_step, ctypes.c_void_p).value
    assert address is not None
    return address


def find_engine(model: mujoco.MjModel, data: mujoco.MjData) -> Engine | None:
    """Find the addresses for a model and its state.

    Args:
        model: The model.
        data: Its state; both must outlive the result.

    Returns:
        The addresses; None where they cannot be trusted, because MuJoCo's description of its
        structs is missing a type, its library is not found or of another version, or the bindings
        say otherwise. None also where kernels are not compiled (NUMBA_DISABLE_JIT=1), because only
        compiled code can call an address.
    """
    if numba_config.DISABLE_JIT:
        return None
    return _engine(model, data) if _is_trusted() else None


def _engine(model: mujoco.MjModel, data: mujoco.MjData) -> Engine:
    """Compute the addresses, right or wrong."""
    state, contact, at = _struct("mjData"), _struct("mjContact"), data._address
    in_state = [getattr(state, name).offset for name in ("ncon", "contact", "nefc", "efc_force")]
    in_contact = [getattr(contact, n).offset for n in ("pos", "frame", "geom", "efc_address")]
    fields = [at + offset for offset in in_state] + [ctypes.sizeof(contact), *in_contact]
    return Engine(_step_address(), model._address, at, *fields)


@cache
def _is_trusted() -> bool:
    """Whether the addresses of a ball on a plane lead to the numbers that the bindings show."""
    model = mujoco.MjModel.from_xml_string(_BALL)
    data, twin = mujoco.MjData(model), mujoco.MjData(model)
    try:
        engine = _engine(model, data)
    except (KeyError, StopIteration, OSError, AttributeError):
        return False
    for one in (data, twin):
        mujoco.mj_forward(model, one)
    count = ctypes.c_int.from_address(engine.contact_count).value
    rows = ctypes.c_int.from_address(engine.row_count).value
    if not data.ncon or (count, rows) != (data.ncon, data.nefc):
        return False
    if not _leads_to(engine, data):  # nothing is read through a pointer that may be wrong
        return False
    mine: tuple[Any, ...] = contacts_of(engine)
    theirs: tuple[Any, ...] = contact_arrays(data)
    if not all(np.array_equal(a, b) for a, b in zip(mine, theirs, strict=True)):
        return False
    step_engine(engine)
    mujoco.mj_step(model, twin)
    return bool(data.time == twin.time > 0.0 and np.array_equal(data.qpos, twin.qpos))


def _leads_to(engine: Engine, data: mujoco.MjData) -> bool:
    """Whether the arrays of contacts and forces lie where the bindings have them."""
    first = ctypes.c_size_t.from_address(engine.contacts).value
    forces = ctypes.c_size_t.from_address(engine.forces).value
    theirs = contact_arrays(data)
    offsets = (engine.geom, engine.pos, engine.frame, engine.row)
    found = [first + offset for offset in offsets] + [forces]
    strides = {array.strides[0] for array in theirs[:-1]}
    return found == [array.ctypes.data for array in theirs] and strides == {engine.size}


def contact_arrays(data: mujoco.MjData) -> ContactArrays:
    """Return MuJoCo's present contacts by way of the bindings.

    Args:
        data: The state.

    Returns:
        The contacts, valid until the next step.
    """
    contact = data.contact
    return ContactArrays(
        contact.geom, contact.pos, contact.frame, contact.efc_address, data.efc_force
    )


@intrinsic  # type: ignore[untyped-decorator]
def _pointer(typing_context: Any, address: Any) -> Any:
    """Turn an address into a pointer."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], ir.PointerType(ir.IntType(8)))

    return types.voidptr(types.int64), generate


@intrinsic  # type: ignore[untyped-decorator]
def _call(typing_context: Any, function: Any, first: Any, second: Any) -> Any:
    """Call a C function, ``void f(void*, void*)``, by its address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [ir.IntType(64), ir.IntType(64)])
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), generate


@njit(cache=True)
def step_engine(engine: Engine) -> None:
    """Do one ``mj_step``. A fatal error inside MuJoCo ends the process.

    Args:
        engine: The addresses.
    """
    _call(engine.step, engine.model, engine.data)


@njit(cache=True)
def contacts_of(engine: Engine) -> ContactArrays:
    """Return MuJoCo's present contacts.

    Args:
        engine: The addresses.

    Returns:
        The contacts, valid until the next step.
    """
    n = carray(_pointer(engine.contact_count), 1, np.int32)[0]
    rows = carray(_pointer(engine.row_count), 1, np.int32)[0]
    at = carray(_pointer(engine.contacts), 1, np.int64)[0]
    force = carray(_pointer(carray(_pointer(engine.forces), 1, np.int64)[0]), rows, np.float64)
    numbers = carray(_pointer(at), (n, engine.size // 8), np.float64)
    integers = carray(_pointer(at), (n, engine.size // 4), np.int32)
    pos, frame, geom = engine.pos // 8, engine.frame // 8, engine.geom // 4
    return ContactArrays(
        integers[:, geom : geom + 2],
        numbers[:, pos : pos + 3],
        numbers[:, frame : frame + 9],
        integers[:, engine.row // 4],
        force,
    )
