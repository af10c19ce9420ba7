"""Machine code of the compiled loops, kept so that it runs without numba.

numba takes half a second to import and to load its own cache. So the code that it made is kept once
more, with the types of its arguments, and linked by llvmlite alone.
"""

from __future__ import annotations

import ctypes
import hashlib
import itertools
import os
import pickle
import re
import struct
import tempfile
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any, Final, TypeAlias

import numpy as np

Described: TypeAlias = Any  # "int", "float", "bool", "none", (dtype, ndim) or a list of them

_NONE_IS_RETURNED: Final = -2
_FORMS: Final = {"int": "q", "float": "d", "bool": "?", "none": ""}
_TO_SCALAR: Final[Mapping[str, Callable[[Any], Any]]] = {"int": int, "float": float, "bool": bool}
#: What the loops need of numba's runtime: memory with a header (count of references, destructor and
#: its argument, data, size, allocator). All else is for calls from Python, which are not made here.
_RUNTIME: Final = """
declare ptr @malloc(i64)
declare void @free(ptr)
define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %all = add i64 %size, 112
  %info = call ptr @malloc(i64 %all)
  %begin = ptrtoint ptr %info to i64
  %behind = add i64 %begin, 111
  %place = and i64 %behind, -64
  %data = inttoptr i64 %place to ptr
  store [6 x i64] [i64 1, i64 0, i64 0, i64 0, i64 0, i64 0], ptr %info
  %field = getelementptr i64, ptr %info, i64 3
  store ptr %data, ptr %field
  ret ptr %info
}
define void @NRT_MemInfo_call_dtor(ptr %info) {
  call void @free(ptr %info)
  ret void
}
"""
_NEVER_CALLED: Final = (
    "NRT_Free", "NRT_adapt_ndarray_from_python", "NRT_adapt_ndarray_to_python_acqref",
    "numba_do_raise", "numba_runtime_build_excinfo_struct", "numba_unpickle",
)  # fmt: skip
_IN_THE_CODE: Final = ("NRT_incref", "NRT_decref")
_HERE: Final = ("NRT_MemInfo_alloc_aligned", "NRT_MemInfo_call_dtor")
_PROVIDED: Final = {*_HERE, *_IN_THE_CODE, *_NEVER_CALLED}


class _OtherTypesError(TypeError):
    """An argument is of another type than the code was made for."""


class StoredKernels:
    """The names of the package of loops; what is not stored comes from the package itself.

    Parameters
    ----------
    stored : mapping
        As :func:`store_kernels` writes it.
    compiled : callable
        Returns the package.
    """

    def __init__(self, stored: Mapping[str, Any], compiled: Callable[[], ModuleType]) -> None:
        self._compiled = compiled
        engine = _linked(stored["loops"])
        vars(self).update(stored["constants"])
        for name, (_, _, result, arguments) in stored["loops"].items():
            vars(self)[name] = _StoredLoop(engine, name, result, arguments, compiled)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._compiled(), name)


class _StoredLoop:
    """One loop; arguments of other types than it was made for go to numba."""

    def __init__(
        self, engine: Any, name: str, result: Described, arguments: list[Described],
        compiled: Callable[[], ModuleType],
    ) -> None:  # fmt: skip
        self._engine = engine  # owns the code
        self._name, self._compiled = name, compiled
        self._result, self._form = result, struct.Struct(_form_of(result))
        self._found = ctypes.create_string_buffer(max(8, self._form.size))
        self._error = ctypes.c_void_p()
        ends = itertools.accumulate(len(_flat_types(kind)) for kind in arguments)
        self._arguments = list(zip(arguments, (0, *ends), strict=False))
        self._last: list[Any] = [object()] * len(arguments)  # which are often the same again
        self._slots = (ctypes.c_int64 * max(1, sum(len(_flat_types(k)) for k in arguments)))()
        self._floats = (ctypes.c_double * len(self._slots)).from_buffer(self._slots)
        kind = ctypes.PYFUNCTYPE(ctypes.c_int32, *[ctypes.c_void_p] * 3)
        self._function = kind(engine.get_function_address(f"call_{name}"))
        self._places = tuple(map(ctypes.addressof, (self._slots, self._found, self._error)))

    def __call__(self, *values: Any) -> Any:
        try:
            self._set(values)
        except _OtherTypesError:
            return getattr(self._compiled(), self._name)(*values)
        status = self._function(*self._places)
        if status not in (0, _NONE_IS_RETURNED):
            raise RuntimeError(f"{self._name} failed with the status {status}")
        return _value(self._result, iter(self._form.unpack_from(self._found)))

    def _set(self, values: tuple[Any, ...]) -> None:
        last = self._last
        for number, value in enumerate(values):
            if value is not last[number]:
                kind, place = self._arguments[number]
                for at, one in enumerate(_flattened(kind, value), place):
                    if type(one) is float:
                        self._floats[at] = one
                    else:
                        self._slots[at] = one
                last[number] = value


def stored_path(folder: Path, digest: str) -> Path:
    """Return where the code for this processor and these sources lies in *folder*."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    machine = f"{llvm.get_host_cpu_name()} {features} {version('llvmlite')} {version('numba')}"
    return folder / f"{digest}-{hashlib.sha256(machine.encode()).hexdigest()[:12]}.loops"


def store_kernels(kernels: ModuleType, path: Path) -> None:
    """Write what numba has compiled of *kernels* to *path*, with what is there already."""
    stored = read_stored(path) or {"constants": {}, "loops": {}}
    known = set(stored["loops"])
    for name in kernels.__all__:
        value = getattr(kernels, name)
        if not callable(value):
            stored["constants"][name] = value
        elif name not in known and (made := next(_compiled_codes(value), None)) is not None:
            stored["loops"][name] = made
    if set(stored["loops"]) != known:
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(pickle.dumps(stored))
        os.replace(file.name, path)


def read_stored(path: Path) -> dict[str, Any] | None:
    """Return what :func:`store_kernels` wrote; None: nothing."""
    try:
        found: dict[str, Any] = pickle.loads(path.read_bytes())
    except (OSError, EOFError, pickle.UnpicklingError):
        return None
    return found


def _compiled_codes(
    dispatcher: Any,
) -> Iterator[tuple[bytes, str, Described, list[Described]]]:
    """Yield code, symbol, result and arguments of what numba has compiled of a loop."""
    cache = dispatcher._cache  # noqa: SLF001  numba shows machine code nowhere else
    for given, made in dispatcher.overloads.items():
        key = cache._index_key(given, dispatcher.targetctx.codegen())  # noqa: SLF001  as above
        (_, _, (code, _)), *_ = cache._cache_file.load(key)  # noqa: SLF001  as above
        needed = {name.decode() for name in re.findall(rb"\0((?:NRT|numba)_\w+)(?=\0)", code)}
        types = [_described(kind) for kind in made.signature.args]
        result = _described(made.signature.return_type)
        if needed <= _PROVIDED and None not in types and result is not None:
            yield code, made.fndesc.llvm_func_name, result, types


def _described(kind: Any) -> Described | None:
    """Return a type of numba in plain values; None: it is none that can be handed over here."""
    from numba import types

    if isinstance(kind, types.BaseTuple):
        parts = [_described(one) for one in kind]
        return None if None in parts else parts
    if isinstance(kind, types.Array):
        return (str(kind.dtype), kind.ndim) if kind.layout == "C" else None
    plain = {types.int64: "int", types.float64: "float", types.boolean: "bool", types.none: "none"}
    return plain.get(kind)


def _linked(loops: Mapping[str, Any]) -> Any:
    """Return an engine of llvmlite with the code of *loops*, and a function that calls each."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    parts = [_RUNTIME, *(f"define void @{name}() {{ ret void }}\n" for name in _NEVER_CALLED)]
    parts += [_caller(name, symbol, kinds) for name, (_, symbol, _, kinds) in loops.items()]
    machine = llvm.Target.from_default_triple().create_target_machine(opt=0, jit=True)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly("".join(parts)), machine)
    for code, *_ in loops.values():
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine


def _caller(name: str, symbol: str, kinds: list[Described]) -> str:
    """Return a function in LLVM's language that takes the arguments of a loop out of an array."""
    flat = [one for kind in kinds for one in _flat_types(kind)]
    steps = []
    for place, one in enumerate(flat):
        read = "i64" if one == "i1" else one
        steps.append(f"%p{place} = getelementptr i64, ptr %slots, i64 {place}")
        steps.append(f"%w{place} = load {read}, ptr %p{place}")
        steps.append(
            f"%v{place} = trunc i64 %w{place} to i1"
            if one == "i1"
            else f"%v{place} = bitcast {one} %w{place} to {one}"
        )
    given = ", ".join(["ptr %result", "ptr %error", *(f"{t} %v{n}" for n, t in enumerate(flat))])
    return (
        f'declare i32 @"{symbol}"({", ".join(["ptr", "ptr", *flat])})\n'
        f"define i32 @call_{name}(ptr %slots, ptr %result, ptr %error) {{\n"
        + "\n".join(steps)
        + f'\n%status = call i32 @"{symbol}"({given})\nret i32 %status\n}}\n'
    )


def _flat_types(kind: Described) -> list[str]:
    """Return LLVM's types of the numbers that stand for an argument."""
    if isinstance(kind, list):
        return [one for part in kind for one in _flat_types(part)]
    if isinstance(kind, tuple):
        return ["ptr", "ptr", "i64", "i64", "ptr", *["i64"] * (2 * kind[1])]
    return [{"int": "i64", "float": "double", "bool": "i1"}[kind]]


def _flattened(kind: Described, value: Any) -> Iterator[Any]:
    """Yield the numbers that stand for an argument."""
    if isinstance(kind, str):
        yield _TO_SCALAR[kind](value)
    elif isinstance(kind, list):
        for part, one in zip(kind, value, strict=True):
            yield from _flattened(part, one)
    elif type(value) is np.ndarray and (value.dtype.name, value.ndim) == kind:
        if not value.flags.c_contiguous:
            raise _OtherTypesError
        yield from (0, 0, value.size, value.itemsize, value.ctypes.data)
        yield from value.shape
        yield from value.strides
    else:
        raise _OtherTypesError


def _form_of(kind: Described) -> str:
    """Return the format of a result in memory."""
    return "".join(map(_form_of, kind)) if isinstance(kind, list) else _FORMS[kind]


def _value(kind: Described, numbers: Iterator[Any]) -> Any:
    """Return a result as Python has it."""
    if isinstance(kind, list):
        return tuple([_value(part, numbers) for part in kind])
    return next(numbers, None)
