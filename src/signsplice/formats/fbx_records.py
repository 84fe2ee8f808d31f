"""The records of an FBX file, binary or text, with their names, values and child records, read on demand; and its
objects by id, with their connections.

Binary records begin with the offset of their end, so that meshes and textures can be skipped without decoding.
"""

from __future__ import annotations

import re
import struct
import zlib
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from signsplice.errors import FormatError
from signsplice.formats.gltf_document import printable
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits
from signsplice.motion import FloatArray

MAGIC = b"Kaydara FBX Binary  \x00\x1a\x00"
_WIDE_HEADS = 7500
"""From this version on, the numbers in a record's head have 64 bits."""
_SCALARS = {ord(kind): struct.Struct(f"<{form}") for kind, form in zip("YCBIFDL", "hbbifdq", strict=True)}
_ARRAYS = {
    ord(kind): np.dtype(form) for kind, form in zip("fdlibc", ("<f4", "<f8", "<i8", "<i4", "i1", "i1"), strict=True)
}
_TEXT = ord("S")
"""Type code of a text value."""
_RAW = ord("R")
"""Type code of a value of raw bytes."""
_HEADS = {False: struct.Struct("<IIIB"), True: struct.Struct("<QQQB")}
"""Head of a record: its end, the number and bytes of its values, the length of its name; True: 64 bits."""
_RECORD_BYTES = 400
"""Most bytes of memory that a record takes, besides its bytes in the file."""
_VALUE_BYTES = 64
"""Most bytes of memory that a value takes, besides its bytes in the file."""
_NAME = r"[A-Za-z_][\w|-]*:"
_STATEMENT = re.compile(
    rf"""\s*(?:;[^\n]*|(?P<close>\}})|(?P<name>{_NAME})"""
    # Values may span lines, until a line begins with a name, a comment or a brace.
    rf"""(?P<values>(?:"[^"]*"|[^"{{}};\n]+|\n(?![^\S\n]*(?:{_NAME}|[}};])))*)(?P<open>\{{)?)"""
)
_VALUE = re.compile(r'"(?P<text>[^"]*)"|(?P<word>[^\s,"]+)')


class Record(ABC):
    """A record of a file.

    name: the record's name.
    budget: the budget of its file.
    """

    __slots__ = ("_named", "_values", "budget", "name")

    def __init__(self, name: str, budget: Budget) -> None:
        self.name, self.budget = name, budget
        self._named: dict[str, Record] | None = None
        self._values: list[Any] | None = None

    @property
    def values(self) -> list[Any]:
        """Its values: numbers, text, bytes, and arrays (N,)."""
        if self._values is None:
            self._values = self._read_values()
        return self._values

    @abstractmethod
    def _read_values(self) -> list[Any]: ...

    @property
    @abstractmethod
    def children(self) -> list[Record]:
        """The child records, in order."""

    @property
    def child_by_name(self) -> dict[str, Record]:
        """The first child record of each name."""
        if self._named is None:
            self._named = {child.name: child for child in reversed(self.children)}
        return self._named

    def find(self, name: str) -> Record | None:
        """Return the first child record of a name."""
        return self.child_by_name.get(name)

    def all(self, name: str) -> list[Record]:
        """Return the child records of a name."""
        return [child for child in self.children if child.name == name]

    def numbers(self, name: str) -> FloatArray:
        """Return the numbers (N,) of the first child record of a name, empty if there is none; text counts as 0."""
        child = self.find(name)
        values = [] if child is None else child.values
        if values and isinstance(values[0], np.ndarray):
            return np.asarray(values[0], np.float64)
        return np.array([0.0 if isinstance(value, str | bytes) else value for value in values], np.float64)


class Budget:
    """Counts the memory of a file's records, and raises ``LimitError`` if it far exceeds the file's size.

    content: bytes of the file.
    head: format of the record heads of a binary file.
    """

    def __init__(self, content: bytes, file: str, limits: ReadLimits, head: struct.Struct = _HEADS[False]) -> None:
        n_bytes = len(content)
        self.content, self.file, self.n_bytes, self.limits, self.head = content, file, n_bytes, limits, head
        self.taken, self.most = 0, limits.free_bytes + limits.growth * n_bytes

    def take(self, n_bytes: int) -> None:
        """Count bytes before they are allocated."""
        self.taken += n_bytes
        if self.taken > self.most:
            self.limits.check_memory("records", self.taken, self.n_bytes, self.file)


def read_records(content: bytes, file: str, limits: ReadLimits = DEFAULT_LIMITS) -> tuple[Record, int]:
    """Return the top record, and the version times 1000. Raises ``FormatError`` if it is not an FBX file."""
    if content.startswith(MAGIC[:20]):
        (version,) = struct.unpack_from("<I", content, len(MAGIC))
        budget = Budget(content, file, limits, _HEADS[version >= _WIDE_HEADS])
        return _BinaryRecord("", (len(MAGIC) + 4,) * 2 + (len(content),), 0, budget), version
    if re.match(rb"[\xef\xbb\xbf\s]*(;|FBXHeaderExtension)", content[:4096]) is None:
        raise FormatError("is no FBX file: it begins neither as a binary nor as a text one", file=file)
    top = _text_records(content.decode("utf-8-sig", "replace"), Budget(content, file, limits))
    header = top.find("FBXHeaderExtension")
    version = 0 if header is None else int(next(iter(header.numbers("FBXVersion")), 0))
    return top, version


class _BinaryRecord(Record):
    """A record of a binary file; ``at``: offsets of the start and end of its values, and of the record's end."""

    __slots__ = ("_at", "_children", "_n_values")

    def __init__(self, name: str, at: tuple[int, int, int], n_values: int, budget: Budget) -> None:
        super().__init__(name, budget)
        self._at, self._n_values = at, n_values
        self._children: list[Record] | None = None

    def _read_values(self) -> list[Any]:
        content, (start, stop, _) = self.budget.content, self._at
        self.budget.take(self._n_values * _VALUE_BYTES)
        values: list[Any] = []
        for _ in range(self._n_values):
            kind, start = content[start], start + 1
            if (scalar := _SCALARS.get(kind)) is not None:
                values.append(scalar.unpack_from(content, start)[0])
                start += scalar.size
            elif kind in (_TEXT, _RAW):
                size = int.from_bytes(content[start : start + 4], "little")
                start += 4 + size
                raw = content[start - size : start]
                values.append(raw.decode("utf-8", "replace") if kind == _TEXT else raw)
            elif kind in _ARRAYS:
                count, packed, size = struct.unpack_from("<III", content, start)
                values.append(self._array(_ARRAYS[kind], count, packed, start + 12, size))
                start += 12 + size
            else:
                raise FormatError(f"{self.name}: a value of type {chr(kind)!r}", file=self.budget.file)
            if start > stop:
                raise FormatError(f"{self.name}: its values end early", file=self.budget.file)
        return values

    def _array(self, dtype: np.dtype[Any], count: int, packed: int, start: int, size: int) -> np.ndarray[Any, Any]:
        n_bytes = count * dtype.itemsize
        self.budget.take(n_bytes)
        raw = self.budget.content[start : start + (size if packed else n_bytes)]
        if packed:
            raw = zlib.decompressobj().decompress(raw, n_bytes + 1)
        if len(raw) != n_bytes or (not packed and size != n_bytes):
            raise FormatError(f"{self.name}: {len(raw)} bytes, expected {count} numbers", file=self.budget.file)
        return np.frombuffer(raw, dtype)

    @property
    def children(self) -> list[Record]:
        if self._children is None:
            self._children = self._read_children()
        return self._children

    def _read_children(self) -> list[Record]:
        budget, (_, start, stop) = self.budget, self._at
        content, read, size = budget.content, budget.head.unpack_from, budget.head.size
        children: list[Record] = []
        while start + size <= stop:
            end, n_values, n_bytes, n_letters = read(content, start)
            if end == 0:
                break
            begin = start + size + n_letters
            if not begin + n_bytes <= end <= stop or n_values > n_bytes:
                raise FormatError(
                    f"a record ends at byte {end}, expected at most {stop}: it is cut off or damaged", file=budget.file
                )
            name = content[start + size : begin].decode("utf-8", "replace")
            children.append(_BinaryRecord(name, (begin, begin + n_bytes, end), n_values, budget))
            start = end
        self.budget.take(_RECORD_BYTES * len(children))
        return children


class _TextRecord(Record):
    """A record of a text file."""

    __slots__ = ("_children", "_text")

    def __init__(self, name: str, text: str, budget: Budget) -> None:
        super().__init__(name, budget)
        self._text = text
        self._children: list[Record] = []

    @property
    def children(self) -> list[Record]:
        return self._children

    def _read_values(self) -> list[Any]:
        self.budget.take((1 + self._text.count(",")) * _VALUE_BYTES)
        return [_number(m["word"]) if m["text"] is None else m["text"] for m in _VALUE.finditer(self._text)]

    def numbers(self, name: str) -> FloatArray:
        """Return the numbers (N,) of the first child record of a name; long lists without an object for each number."""
        child = self.find(name)
        inner = None if child is None else child.find("a")
        if not isinstance(inner, _TextRecord):
            return super().numbers(name)
        cells = inner._text.split(",")
        return np.array(cells if inner._text.strip() else [], np.float64)


def _number(word: str) -> Any:
    """Parse a word as a number; the word itself if it is none."""
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            continue
    return word


def _text_records(text: str, budget: Budget) -> _TextRecord:
    """Parse a text file; returns the top record."""
    stack, position = [_TextRecord("", "", budget)], 0
    while match := _STATEMENT.match(text, position):
        position = match.end()
        if match["close"]:
            if len(stack) > 1:
                stack.pop()
        elif match["name"]:
            budget.take(_RECORD_BYTES)
            record = _TextRecord(match["name"][:-1], match["values"], budget)
            stack[-1]._children.append(record)
            if match["open"]:
                stack.append(record)
    rest = text[position:].strip()
    if rest:
        line = text.count("\n", 0, position) + 1
        raise FormatError(f"no record begins with {rest[:20]!r}", file=budget.file, line=line)
    return stack[0]


Id = int | str
_TICKS = 46186158000.0
"""Units of time in a second, in nearly all files."""
_NEW_TICKS = 141120000.0
"""Units of time in a second, in files whose header defines a new unit."""
_OLD_DEFINITION = 127
"""``TCDefinition`` of the usual unit."""
_DEFINED_FROM = 1004
"""Lowest version of a header that defines the unit."""
_NEW_FORM = 7000
"""From this version on, takes are objects."""
_BITS_FROM = 7200
"""From this version on, text files write the bits of key attributes as whole numbers."""
_CLASS = re.compile(r"^K?Fbx")
"""Begin of the name of a class of the SDK, as templates are named."""
_WANTED = ("Model", "AnimationStack", "AnimationLayer", "AnimationCurveNode", "AnimationCurve", "Deformer", "Pose",
           "Geometry", "Material", "Texture", "Video")  # fmt: skip


class FbxObjects:
    """The objects of a file.

    top: the top record.
    records: id -> object; in files of version 6 its name is its id.
    sources: id -> the objects connected to it, each with the property that it drives, empty for none.
    templates: name of a record -> class of its objects -> the numbers of the properties that they may leave out.
    ticks: units of time in a second.
    has_old_takes: whether takes are not objects.
    has_bits: whether the bits of key attributes are written as whole numbers.
    """

    def __init__(self, content: bytes, file: str, limits: ReadLimits) -> None:
        self.top, version = read_records(content, file, limits)
        header = self.top.find("FBXHeaderExtension")
        self.ticks = _TICKS if header is None else _ticks(header)
        self.has_old_takes = version < _NEW_FORM
        self.has_bits = version >= _BITS_FROM and not content.startswith(MAGIC[:20])
        self.records: dict[Id, Record] = {r.values[0]: r for r in within(self.top, "Objects", _WANTED) if r.values}
        self.templates: dict[str, dict[str, dict[str, FloatArray]]] = {
            str(kind.values[0]): {
                _CLASS.sub("", str(*template.values[:1])): numbers_of(template)
                for template in kind.all("PropertyTemplate")
            }
            for kind in within(self.top, "Definitions", ("ObjectType",))
            if kind.values
        }
        self.sources: dict[Any, list[tuple[Any, str]]] = defaultdict(list)
        for record in within(self.top, "Connections", ("C", "Connect")):
            _, source, target, what = (*record.values, "")[:4]
            self.sources[target].append((source, what))

    def on(self, target: Any, name: str, kind: str = "") -> Iterator[tuple[Id, str]]:
        """Yield the objects connected to one, with the property they drive: records of a name and, if given, a kind."""
        for source, what in self.sources.get(target, ()):
            record = self.records.get(source)
            if record is not None and record.name == name and (not kind or record.values[-1] == kind):
                yield source, what

    def numbers_of(self, record: Record) -> dict[str, FloatArray]:
        """Return property -> numbers of an object: its own, over those of the template of its class.

        Classes of deformers have different properties; of other objects, the first template counts if none is named as
        their kind.
        """
        templates = self.templates.get(record.name, {})
        first = {} if record.name == "Deformer" else next(iter(templates.values()), {})
        return templates.get(str(*record.values[-1:]), first) | numbers_of(record)

    def all(self, name: str, kind: str = "") -> Iterator[tuple[Id, Record]]:
        """Yield the objects whose records have a name and, if given, a kind."""
        for key, record in self.records.items():
            if record.name == name and (not kind or record.values[-1] == kind):
                yield key, record


def within(top: Record, name: str, kinds: Collection[str]) -> list[Record]:
    """Return the records of some kinds in a section of the file; empty if it lacks the section."""
    part = top.find(name)
    return [] if part is None else [record for record in part.children if record.name in kinds]


def numbers_of(record: Record) -> dict[str, FloatArray]:
    """Return property -> numbers that stand in a record, in the form of version 7 or 6."""
    properties: dict[str, FloatArray] = {}
    for name, kind, first in (("Properties70", "P", 4), ("Properties60", "Property", 3)):
        part = record.find(name)
        for row in part.all(kind) if part is not None else ():
            numbers = row.values[first:]
            if numbers and all(isinstance(number, int | float) for number in numbers):
                properties[row.values[0]] = np.array(numbers, np.float64)
    return properties


def name_of(text: Any) -> str:
    """Return a name without the kind of record before it or, in binary files, after it."""
    return printable(str(text).split("\x00\x01")[0].rpartition("::")[2], "unnamed")


def _ticks(header: Record) -> float:
    """Return the units of time in a second, as a file's header defines them."""
    flags, version = header.find("OtherFlags"), header.numbers("FBXHeaderVersion")
    defined = np.empty(0) if flags is None else flags.numbers("TCDefinition")
    if len(defined) and len(version) and version[0] >= _DEFINED_FROM and defined[0] != _OLD_DEFINITION:
        return _NEW_TICKS
    return _TICKS
