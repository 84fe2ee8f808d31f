"""Pickles (``.pkl``) of SMPL-X poses, read as data: nothing that a file names is imported or called.

A pickle is a program for a stack machine (``pickletools`` describes its instructions). This one runs those that build
numbers, texts, lists, dicts and NumPy arrays, and refuses all others.
"""

from __future__ import annotations

import math
import pickletools
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.formats import smplx
from signsplice.formats.reading import JOINT_FRAME_BYTES, ReadLimits
from signsplice.motion import Clip

_STEP_BYTES = 128
"""Memory that an instruction takes beside the bytes that it holds: at most an empty dict (64), or a place in the memo
(about 100).
"""
_MOST_DEPTH = 3
"""Dicts of dicts in which poses are looked for."""
_MOST_INDEX = 1 << 32
"""Whole numbers below may be keys. Larger ones can be chosen so that a dict takes quadratic time."""
_FIRST_BYTES = {b"PK": "a zip file, as torch.save writes", b"\x1f\x8b": "compressed", b"x": "compressed"}
_HINT = "save the poses in an .npz of NumPy arrays"
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False, "EMPTY_TUPLE": ()}
_LITERALS = {
    "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT",
    "STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8",
    "BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8",
}  # fmt: skip
_FUNCTIONS = {
    "collections.OrderedDict", "_codecs.encode", "numpy.ndarray", "numpy.dtype", "numpy.core.multiarray._reconstruct",
    "numpy.core.multiarray.scalar", "numpy.core.numeric._frombuffer",
}  # fmt: skip
_NUMBERS = re.compile(r"b1|[iu][1248]|f[248]")


def parse(content: bytes, file: str, limits: ReadLimits) -> Clip:
    """Parse a pickle of SMPL-X poses into a clip. Raises ``InputError`` if it holds none, or what is not admitted."""
    return smplx.build_clip(parse_arrays(content, file, limits), file, limits, len(content))


def parse_arrays(content: bytes, file: str, limits: ReadLimits) -> dict[str, NDArray[Any]]:
    """Parse the arrays of a pickle: of a dict, which may lie in another, of a list of dicts, one a frame, or one array.
    Raises as ``parse`` does.
    """
    for first, what in _FIRST_BYTES.items():
        if content.startswith(first):
            raise InputError(f"it is {what}, expected a plain pickle; {_HINT}")
    value = _Machine(limits, len(content), file).run(content)
    if not isinstance(value, list):
        return _named_arrays(value)
    if not value:
        raise InputError("it holds no frames")
    n_bytes = len(value) * max(smplx.N_NUMBERS.values()) * JOINT_FRAME_BYTES
    limits.check_memory(f"{len(value):,} frames", n_bytes, len(content), file)  # one dict may stand for many frames
    named = {id(frame): _named_arrays(frame) for frame in {id(frame): frame for frame in value}.values()}
    frames = [named[id(frame)] for frame in value]
    n_bytes = sum(array.nbytes for arrays in frames for array in arrays.values())
    limits.check_memory(f"{len(value):,} frames", n_bytes, len(content), file)
    return smplx.join_frames(frames, [f"frame {n}" for n in range(len(value))])


def _named_arrays(value: Any) -> dict[str, NDArray[Any]]:
    """Return the arrays of poses in a dict, or in the only dict within it that holds poses."""
    for _ in range(_MOST_DEPTH):
        if not isinstance(value, dict) or smplx.is_smplx([key for key in value if not isinstance(value[key], dict)]):
            break
        inner = [part for part in value.values() if isinstance(part, dict)]
        inner = [part for part in inner if smplx.is_smplx(part)] or inner
        if len(inner) != 1:
            break
        value = {key: value[key] for key in smplx.RATES if key in value} | inner[0]
    if isinstance(value, _StoredArray):
        value = {smplx.PACKED: value}
    if not isinstance(value, dict) or not smplx.is_smplx(value):
        what = "a dict without poses" if isinstance(value, dict) else _describe(value)
        raise InputError(f"it holds {what}, expected arrays of SMPL-X by name, or a list of frames; {_HINT}")
    return {name: _number_array(name, value[name]) for name in smplx.NAMES if value.get(name) is not None}


def _number_array(name: str, value: Any) -> NDArray[Any]:
    if type(value) in (int, float):
        return np.array(float(value))
    array = value.array if isinstance(value, _StoredArray) else None
    if array is None or (array.ndim and array.dtype.kind != "f"):
        raise InputError(f"{name} is {_describe(value)}, expected an array of floats; {_HINT}")
    return array


def _describe(value: Any) -> str:
    """Describe a value in an error message."""
    if isinstance(value, _StoredArray):
        return "an array without numbers" if value.array is None else f"an array of {value.array.dtype}"
    if isinstance(value, _Function):
        return f"what {value.name!r:.80} makes"
    return f"a value of type {type(value).__name__.strip('_')}"


@dataclass(frozen=True)
class _Function:
    """A function or class that a pickle names, or what it returns, if that is not read."""

    name: str


@dataclass
class _StoredType:
    """An array's type: letter with size, and order of bytes."""

    code: str
    order: str = "<"

    def view(self, content: Any, shape: Any, is_fortran: bool) -> NDArray[Any] | None:
        """Return bytes as an array; None if this is no type of numbers. Raises ``InputError`` if they do not match."""
        if not _NUMBERS.fullmatch(self.code) or not isinstance(content, bytes):
            return None
        dtype = np.dtype(self.order + self.code)
        if not isinstance(shape, tuple) or len(shape) > 4 or not all(map(_is_index, shape)):
            raise InputError("the shape of an array is not valid")
        if math.prod(shape) * dtype.itemsize != len(content):
            raise InputError(f"an array has shape {shape} in {len(content)} bytes")
        return np.frombuffer(content, dtype).reshape(shape, order="F" if is_fortran else "C")


@dataclass
class _StoredArray:
    """An array; None before its state is set, and if it holds other things than numbers."""

    array: NDArray[Any] | None = None


@dataclass
class _Machine:
    """The stack machine. A pickle of ``given_bytes`` may take the memory that ``limits`` allow."""

    limits: ReadLimits
    given_bytes: int
    file: str
    stack: list[Any] = field(default_factory=list)
    marks: list[int] = field(default_factory=list)
    memo: dict[int, Any] = field(default_factory=dict)
    n_bytes: int = 0

    def run(self, content: bytes) -> Any:
        """Return the value that a pickle describes. Raises ``InputError`` for an instruction that is not admitted."""
        for instruction, argument, _ in pickletools.genops(content):
            self._add_bytes(_STEP_BYTES)
            if instruction.name == "STOP":
                break
            self._step(instruction.name, argument)
        return self.stack.pop()

    def _step(self, name: str, argument: Any) -> None:
        """Run an instruction. Raises ``InputError`` if it is not admitted."""
        stack = self.stack
        match name:
            case _ if name in _LITERALS:
                stack.append(bytes(argument) if name == "BYTEARRAY8" else argument)
            case _ if name in _CONSTANTS:
                stack.append(_CONSTANTS[name])
            case "PUT" | "BINPUT" | "LONG_BINPUT":
                self.memo[_check_key(argument)] = stack[-1]
            case "GET" | "BINGET" | "LONG_BINGET":
                stack.append(self.memo[argument])
            case "PROTO" | "FRAME":
                pass
            case "MARK":
                self.marks.append(len(stack))
            case "MEMOIZE":
                self.memo[len(self.memo)] = stack[-1]
            case "POP":
                stack.pop()
            case "DUP":
                stack.append(stack[-1])
            case "EMPTY_LIST":
                stack.append([])
            case "EMPTY_DICT":
                stack.append({})
            case "TUPLE1" | "TUPLE2" | "TUPLE3":
                stack.append(tuple(self._pop(int(name[-1]))))
            case "TUPLE":
                stack.append(tuple(self._pop_mark()))
            case "LIST":
                stack.append(self._pop_mark())
            case "APPEND" | "APPENDS":
                items = self._pop(1) if name == "APPEND" else self._pop_mark()
                list.extend(stack[-1], items)
            case "DICT" | "SETITEM" | "SETITEMS":
                items = self._pop(2) if name == "SETITEM" else self._pop_mark()
                if name == "DICT":
                    stack.append({})
                pairs = zip(map(_check_key, items[::2]), items[1::2], strict=True)
                dict.update(stack[-1], pairs)
            case "GLOBAL" | "STACK_GLOBAL":
                stack.append(_find_function(*(argument.split(" ", 1) if argument else self._pop(2))))
            case "REDUCE":
                function, arguments = self._pop(2)
                stack.append(self._call(function, arguments))
            case "BUILD":
                (state,) = self._pop(1)
                self._set_state(stack[-1], state)
            case _:
                raise InputError(f"it holds the instruction {name}, expected arrays, lists and dicts; {_HINT}")

    def _call(self, function: Any, arguments: Any) -> Any:
        """Return what stands for the result of a function."""
        if not isinstance(function, _Function):
            raise InputError(f"it calls {_describe(function)}; {_HINT}")
        match function.name, arguments:
            case "collections.OrderedDict", ():
                return {}
            case "_codecs.encode", (str() as text, "latin1"):
                return self._encode(text)
            case "numpy.dtype", (str() as code, *_):
                return _StoredType(code)
            case "numpy.core.multiarray._reconstruct", _:
                return _StoredArray()
            case "numpy.core.multiarray.scalar", (_StoredType() as dtype, content):
                return _StoredArray(dtype.view(self._encode(content), (), False))
            case "numpy.core.numeric._frombuffer", (content, _StoredType() as dtype, shape, order):
                return _StoredArray(dtype.view(content, shape, order == "F"))
        if function.name.startswith("torch."):
            return function
        raise InputError(f"it calls {function.name!r:.80} with arguments that are not admitted; {_HINT}")

    def _set_state(self, value: Any, state: Any) -> None:
        match value, state:
            case _StoredType(), (int(), "<" | ">" | "|" as order, *_):
                value.order = order
            case _StoredArray(), (int(), shape, _StoredType() as dtype, is_fortran, content):
                value.array = dtype.view(self._encode(content), shape, is_fortran is True)
            case _Function(), _:
                pass
            case _:
                raise InputError(f"it sets the state of {_describe(value)}; {_HINT}")

    def _encode(self, content: Any) -> Any:
        """Return the bytes of a text in which Python 2 stored them; anything else unchanged."""
        if not isinstance(content, str):
            return content
        self._add_bytes(len(content))
        return content.encode("latin-1")

    def _add_bytes(self, n_bytes: int) -> None:
        self.n_bytes += n_bytes
        self.limits.check_memory("its instructions", self.n_bytes, self.given_bytes, self.file)

    def _pop(self, n: int) -> list[Any]:
        return [self.stack.pop() for _ in range(n)][::-1]

    def _pop_mark(self) -> list[Any]:
        mark = self.marks.pop()
        items = self.stack[mark:]
        del self.stack[mark:]
        return items


def _check_key(key: Any) -> Any:
    """Return a key of a dict. Raises ``InputError`` if it is neither text nor a usual whole number."""
    if type(key) is str or _is_index(key):
        return key
    raise InputError(f"a key in it is {_describe(key)}, expected text")


def _is_index(value: Any) -> bool:
    return type(value) is int and 0 <= value < _MOST_INDEX


def _find_function(module: Any, name: Any) -> _Function:
    """Return what stands for a function or class. Raises ``InputError`` if it is not admitted."""
    if type(module) is not str or type(name) is not str:
        raise InputError("it names a function by what is no text")
    name = f"{module}.{name}".replace("numpy._core.", "numpy.core.")
    if name in _FUNCTIONS or name.startswith("torch."):
        return _Function(name)
    raise InputError(f"it holds {name!r:.80}, expected NumPy arrays, lists and dicts; {_HINT}")
