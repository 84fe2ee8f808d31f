"""Equal skeletons as one object: each file has a copy of its own, and what is known of a rig is kept by object."""

from __future__ import annotations

from weakref import WeakKeyDictionary

from signsplice.lexicon.index import describe
from signsplice.motion.clip import Clip, Skeleton, unchecked_copy


class SharedSkeletons:
    """The first of equal skeletons; finding roles and sizes of a rig takes longer than reading a clip."""

    def __init__(self) -> None:
        self._by_description: dict[str, Skeleton] = {}
        self._first: WeakKeyDictionary[Skeleton, Skeleton] = WeakKeyDictionary()

    def of(self, clip: Clip) -> Clip:
        """The clip on the first skeleton that equals its own. Raises ``InputError`` for more joints than are read."""
        first = self._first.get(clip.skeleton)
        if first is None:
            first = self._by_description.setdefault(describe(clip.skeleton), clip.skeleton)
            self._first[clip.skeleton] = first
        return clip if first is clip.skeleton else unchecked_copy(clip, skeleton=first)
