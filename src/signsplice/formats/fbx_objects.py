"""The objects of an FBX file by their ids, and which hang on which."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from signsplice.formats.fbx_records import MAGIC, Record, read_records
from signsplice.formats.gltf_skeleton import printable
from signsplice.formats.limits import ReadLimits
from signsplice.motion.arrays import FloatArray

Id = int | str
_TICKS, _NEW_TICKS, _OLD_DEFINITION, _DEFINED_FROM = 46186158000.0, 141120000.0, 127, 1004
"""Units of time in a second, of nearly all files and of those that say so in a header of at least this version."""
_NEW_FORM, _BITS_FROM = 7000, 7200
"""From these versions on, takes are objects, and text files write the bits of key attributes as whole numbers."""
_WANTED = ("Model", "AnimationStack", "AnimationLayer", "AnimationCurveNode", "AnimationCurve", "Deformer", "Pose",
           "Geometry", "Material", "Texture", "Video")  # fmt: skip


class FbxObjects:
    """The objects of a file.

    top: the record that holds all others.
    records: id -> object; in files of version 6 its name is its id.
    sources: id -> what hangs on it, each with the property that it drives, empty for none.
    ticks: units of time in a second.
    has_old_takes: whether takes are no objects.
    has_bits: whether the bits of key attributes are written as whole numbers.
    """

    def __init__(self, content: bytes, file: str, limits: ReadLimits) -> None:
        self.top, version = read_records(content, file, limits)
        header = self.top.find("FBXHeaderExtension")
        self.ticks = _TICKS if header is None else _ticks(header)
        self.has_old_takes = version < _NEW_FORM
        self.has_bits = version >= _BITS_FROM and not content.startswith(MAGIC[:20])
        self.records: dict[Id, Record] = {r.values[0]: r for r in within(self.top, "Objects", _WANTED) if r.values}
        self.sources: dict[Any, list[tuple[Any, str]]] = defaultdict(list)
        for record in within(self.top, "Connections", ("C", "Connect")):
            _, source, target, what = (*record.values, "")[:4]
            self.sources[target].append((source, what))

    def on(self, target: Any, name: str, kind: str = "") -> Iterator[tuple[Id, str]]:
        """What hangs on an object, with the property that it drives: records of a name and, where given, a kind."""
        for source, what in self.sources.get(target, ()):
            record = self.records.get(source)
            if record is not None and record.name == name and (not kind or record.values[-1] == kind):
                yield source, what

    def all(self, name: str, kind: str = "") -> Iterator[tuple[Id, Record]]:
        """The objects whose records have a name and, where given, a kind."""
        for key, record in self.records.items():
            if record.name == name and (not kind or record.values[-1] == kind):
                yield key, record


def within(top: Record, name: str, kinds: Collection[str]) -> list[Record]:
    """The records of some kinds within a part of the file; none where it lacks the part."""
    part = top.find(name)
    return [] if part is None else [record for record in part.children if record.name in kinds]


def numbers_of(record: Record) -> dict[str, FloatArray]:
    """Property -> its numbers, of a record's properties in the form of version 7 or 6."""
    found: dict[str, FloatArray] = {}
    for name, kind, first in (("Properties70", "P", 4), ("Properties60", "Property", 3)):
        part = record.find(name)
        for row in part.all(kind) if part is not None else ():
            numbers = row.values[first:]
            if numbers and all(isinstance(number, int | float) for number in numbers):
                found[row.values[0]] = np.array(numbers, np.float64)
    return found


def name_of(text: Any) -> str:
    """A name without the kind of record that stands before it, or, in binary files, behind it."""
    return printable(str(text).split("\x00\x01")[0].rpartition("::")[2], "unnamed")


def _ticks(header: Record) -> float:
    """Units of time in a second, as a file's header defines them."""
    flags, version = header.find("OtherFlags"), header.numbers("FBXHeaderVersion")
    defined = np.empty(0) if flags is None else flags.numbers("TCDefinition")
    if len(defined) and len(version) and version[0] >= _DEFINED_FROM and defined[0] != _OLD_DEFINITION:
        return _NEW_TICKS
    return _TICKS
