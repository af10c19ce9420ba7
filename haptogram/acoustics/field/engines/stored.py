"""Machine code of the compiled loops, kept so that it runs without numba.

numba takes half a second to import and to load its own cache. So the code that it made is kept once
more, with the types of its arguments, and linked by llvmlite alone. A call takes some 10 us more.
"""

from __future__ import annotations

import ctypes
import hashlib
import operator
import os
import pickle
import re
import struct
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Final, TypeAlias, cast

from haptogram.errors import HaptogramError

Described: TypeAlias = Any  # "int", "float", "bool", "none", (dtype, ndim) or a list of them

_NONE_IS_RETURNED: Final = -2
#: Each scalar: its type as an argument, its format in a result, and the way to it.
_SCALARS: Final[Mapping[str, tuple[Any, str, Callable[[Any], Any]]]] = {
    "int": (ctypes.c_int64, "q", operator.index),
    "float": (ctypes.c_double, "d", float),
    "bool": (ctypes.c_bool, "?", bool),
    "none": (None, "", bool),
}
#: The part of numba's runtime that loops need: memory after a header, whose first number counts the
#: references and whose fourth says where the data are. All else is for calls from Python, which are
#: not made here.
_RUNTIME: Final = """
declare ptr @malloc(i64)
declare void @free(ptr)
define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %all = add i64 %size, 128
  %info = call ptr @malloc(i64 %all)
  %begin = ptrtoint ptr %info to i64
  %behind = add i64 %begin, 127
  %place = and i64 %behind, -64
  %field = getelementptr i64, ptr %info, i64 3
  store i64 1, ptr %info
  store i64 %place, ptr %field
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
_PROVIDED: Final = {
    "NRT_MemInfo_alloc_aligned", "NRT_MemInfo_call_dtor", "NRT_incref", "NRT_decref",
    *_NEVER_CALLED,
}  # fmt: skip


#: Symbols of numba, and of Intel's mathematics that numba uses on some machines.
_SYMBOL: Final = rb"\0((?:NRT|numba|__svml)_\w+)(?=\0)"


class _OtherTypesError(HaptogramError):
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
        self._engine = _linked([code for code, *_ in stored["loops"].values()])  # owns the code
        vars(self).update(stored["constants"])
        for name, (_, symbol, result, kinds) in stored["loops"].items():
            flat = [one for kind in kinds for one in _flat_types(kind)]
            called = ctypes.PYFUNCTYPE(ctypes.c_int32, *[ctypes.c_void_p] * 2, *flat)
            if address := self._engine.get_function_address(symbol):  # a call of 0 ends the process
                vars(self)[name] = self._loop(name, called(address), result, kinds)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._compiled(), name)

    def _loop(
        self, name: str, function: Callable[..., int], result: Described, kinds: list[Described]
    ) -> Callable[..., Any]:
        """Return a function that calls the loop *name*, whose stored machine code is *function*.

        *kinds* and *result* are the types of its arguments and result; with arguments of other
        types it calls the loop that numba compiles.
        """
        form = struct.Struct(_result_format(result))

        def call(*values: Any) -> Any:
            flat: list[Any] = []
            try:
                _flatten(kinds, values, flat)
            except (_OtherTypesError, TypeError):  # a fraction where an integer is stored, too
                return getattr(self._compiled(), name)(*values)
            found, error = ctypes.create_string_buffer(max(8, form.size)), ctypes.c_void_p()
            status = function(ctypes.addressof(found), ctypes.addressof(error), *flat)
            if status not in (0, _NONE_IS_RETURNED):
                raise RuntimeError(f"{name} failed with the status {status}")
            return _value(result, iter(form.unpack_from(found)))

        return call


def stored_name(digest: str) -> str:
    """Return the name of the file with the code for this processor and these sources."""
    import llvmlite
    import llvmlite.binding as llvm  # each version of numba has its own

    features = llvm.get_host_cpu_features().flatten()
    machine = f"{llvm.get_host_cpu_name()} {features} {llvmlite.__version__} {_numba_version()}"
    digest += hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:8]
    return f"{digest}-{hashlib.sha256(machine.encode()).hexdigest()[:12]}.loops"


def _numba_version() -> str:
    """Return the version of numba as its own module says it: importlib.metadata takes 15 ms."""
    found = find_spec("numba")
    assert found is not None
    assert found.origin is not None
    return Path(found.origin).with_name("_version.py").read_text(encoding="utf-8")


def store_kernels(kernels: ModuleType, path: Path) -> None:
    """Write what numba has compiled of *kernels* to *path*, with what is there already."""
    known = (read_stored(path) or {"loops": {}})["loops"]
    values = {name: getattr(kernels, name) for name in kernels.__all__}
    new = {n: next(_codes(f), None) for n, f in values.items() if callable(f) and n not in known}
    loops = known | {name: made for name, made in new.items() if made is not None}
    if len(loops) > len(known):
        constants = {name: value for name, value in values.items() if not callable(value)}
        content = pickle.dumps({"constants": constants, "loops": loops})
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(hashlib.sha256(content).digest() + content)
        os.chmod(file.name, 0o644)  # for all users that load what numba has cached there
        os.replace(file.name, path)


def read_stored(path: Path) -> dict[str, Any] | None:
    """Return the loops that :func:`store_kernels` wrote; None: there are none, or damaged ones."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    digest, content = data[:32], data[32:]
    return pickle.loads(content) if hashlib.sha256(content).digest() == digest else None


def _codes(loop: Any) -> Iterator[tuple[bytes, str, Described, list[Described]]]:
    """Yield machine code, symbol, result and arguments of each compiled version of a loop.

    A version that is not in numba's cache, or that others cannot call, is left out.
    """
    cache = loop._cache  # noqa: SLF001  numba shows machine code nowhere else
    for given, made in loop.overloads.items():
        key = cache._index_key(given, loop.targetctx.codegen())  # noqa: SLF001  as above
        kept = cache._cache_file.load(key)  # noqa: SLF001  as above
        if kept is None:
            continue
        (_, _, (code, _)), described, *_ = kept  # perhaps by another process, under its own name
        needed = {name.decode() for name in re.findall(_SYMBOL, code)}
        result, *types = map(_described, (made.signature.return_type, *made.signature.args))
        if needed <= _PROVIDED and None not in types and result is not None:
            yield code, described.llvm_func_name, result, types


def _described(kind: Any) -> Described | None:
    """Return a numba type as plain values; None if a stored loop cannot take its values."""
    from numba import types

    if isinstance(kind, types.BaseTuple):
        parts = [_described(one) for one in cast("Any", kind)]
        return None if None in parts else parts
    if isinstance(kind, types.Array):
        return (str(kind.dtype), kind.ndim) if kind.layout == "C" else None
    plain = {types.int64: "int", types.float64: "float", types.boolean: "bool", types.none: "none"}
    return plain.get(kind)


def _linked(codes: list[bytes]) -> Any:
    """Return an llvmlite engine with these object files linked."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    nothing = "".join(f"define void @{name}() {{ ret void }}\n" for name in _NEVER_CALLED)
    machine = llvm.Target.from_default_triple().create_target_machine(jit=True)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(_RUNTIME + nothing), machine)
    for code in codes:
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine


def _flat_types(kind: Described) -> list[Any]:
    """Return the ctypes types of the numbers that represent an argument."""
    if isinstance(kind, list):
        return [one for part in kind for one in _flat_types(part)]
    if isinstance(kind, tuple):
        return [ctypes.c_int64] * (5 + 2 * kind[1])
    return [_SCALARS[kind][0]]


def _flatten(kinds: list[Described], values: Iterable[Any], flat: list[Any]) -> None:
    """Append to *flat* the numbers that represent arguments: scalars, and the fields of arrays.

    An array of another type or order raises _OtherTypesError.
    """
    for kind, value in zip(kinds, values, strict=True):
        if isinstance(kind, str):
            flat.append(_SCALARS[kind][2](value))
        elif isinstance(kind, list):
            _flatten(kind, value, flat)
        elif value.dtype == kind[0] and value.ndim == kind[1] and value.flags.c_contiguous:
            flat += (0, 0, value.size, value.itemsize, value.ctypes.data)
            flat += (*value.shape, *value.strides)
        else:
            raise _OtherTypesError


def _result_format(kind: Described) -> str:
    """Return the :mod:`struct` format of a result."""
    return "".join(map(_result_format, kind)) if isinstance(kind, list) else _SCALARS[kind][1]


def _value(kind: Described, numbers: Iterator[Any]) -> Any:
    """Return a result as Python objects, from its unpacked *numbers*; None where it has none."""
    if isinstance(kind, list):
        return tuple([_value(part, numbers) for part in kind])
    return next(numbers, None)
