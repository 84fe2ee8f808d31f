"""New frames of gaps, kept by everything that decides them: a pair of words that comes again is not filled again.

The key of a gap is a digest of what a transition sees: every number of the frames that the gap shows on either side,
the skeleton, the rate, the number of new frames, and the passes that fill it, with the file of the transition's
network. Which words, cuts and options led to these frames does not matter, since they act through them alone. Whatever
differs in one bit has another key.
"""

from __future__ import annotations

import hashlib
import struct
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from signsplice.motion import Clip, Skeleton, unchecked_copy
from signsplice.motion.cache import CACHE
from signsplice.splicing.gap import FilledGap, Gap
from signsplice.splicing.passes.seam_pass import GapPasses

MOST_BYTES = 64_000_000
"""Memory of the frames that are kept by default: about 3,500 transitions of a rig with fingers."""
_ENTRY_BYTES = 1000
"""Memory of an entry besides its frames."""


class TransitionCache:
    """The transitions that were used last, as many as ``most_bytes`` of memory hold; in one process.

    hits, misses: gaps that were found, and gaps that had to be filled.
    """

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self.most_bytes = most_bytes
        self.hits = self.misses = self.nbytes = 0
        self._kept: OrderedDict[bytes, FilledGap] = OrderedDict()

    def fill(self, passes: GapPasses, gaps: Sequence[Gap]) -> list[FilledGap]:
        """The new frames of every gap, bit for bit those of ``passes.fill``. Those of transitions whose frames do not
        follow from what is known of them (``Transition.identity``), and on avatars, are always made anew.
        """
        keys = [gap_key(passes, gap) for gap in gaps]
        known: dict[bytes, FilledGap] = {}
        asked: dict[bytes | int, int] = {}  # the row of each gap that has to be filled
        for row, key in enumerate(keys):
            if key is not None and key in self._kept:
                self._kept.move_to_end(key)
                known[key] = self._kept[key]
            else:
                asked.setdefault(row if key is None else key, row)
        made = passes.fill([gaps[row] for row in asked.values()])
        self.misses += len(made)
        self.hits += len(gaps) - len(made)
        out = dict(zip(asked.values(), made, strict=True))
        for row, filled in list(out.items()):
            if (key := keys[row]) is not None:
                known[key] = self._keep(key, filled)
        for row, key in enumerate(keys):
            if row not in out and key is not None:
                out[row] = _given(known[key], gaps[row])
        return [out[row] for row in range(len(gaps))]

    def _keep(self, key: bytes, filled: FilledGap) -> FilledGap:
        clip = filled.clip
        compact = unchecked_copy(
            clip,
            local_rotations=np.array(clip.local_rotations),  # it may be a view of the frames of many gaps
            root_positions=np.array(clip.root_positions),
            translations=None if clip.translations is None else np.array(clip.translations),
            channels=None,
        )
        kept = self._kept[key] = replace(filled, clip=compact)
        self.nbytes += compact.nbytes + _ENTRY_BYTES
        while self.nbytes > self.most_bytes:
            _, oldest = self._kept.popitem(last=False)
            self.nbytes -= oldest.clip.nbytes + _ENTRY_BYTES
        return kept


def _given(kept: FilledGap, gap: Gap) -> FilledGap:
    """New frames that were kept, for a gap with the same numbers."""
    channels = gap.before.channels
    clip = unchecked_copy(
        kept.clip,
        skeleton=gap.before.skeleton,
        channels=None if channels is None else channels.forgotten(len(kept.clip)),
    )
    return replace(kept, clip=clip)


def gap_key(passes: GapPasses, gap: Gap) -> bytes | None:
    """A digest of all that decides the frames of a gap; None where that is not known."""
    signature, skeleton = passes.signature(lambda transition: transition.identity), gap.before.skeleton
    if any(None in one for one in signature) or type(skeleton) is not Skeleton:
        return None
    digest = hashlib.blake2b(repr(signature).encode(), digest_size=32)
    digest.update(CACHE.of(skeleton, _skeleton_key))
    digest.update(struct.pack("<qdqq", gap.n_frames, gap.before.fps, len(gap.before), len(gap.after)))
    for clip in (gap.before, gap.after):
        _add_frames(digest, clip)
    return digest.digest()


def _add_frames(digest: hashlib.blake2b, clip: Clip) -> None:
    for array in (clip.local_rotations, clip.root_positions, clip.translations):
        digest.update(b"-" if array is None else b"+" + np.ascontiguousarray(array).tobytes())


def _skeleton_key(skeleton: Skeleton) -> bytes:
    """A digest of a skeleton: names, parents, offsets, tips, roles and rest pose."""
    tips = [(site.joint, site.offset.tobytes()) for site in skeleton.end_sites]
    roles = None if skeleton.roles is None else sorted(skeleton.roles.items())
    rest = None if skeleton.rest_pose is None else skeleton.rest_pose.tobytes()
    what = (skeleton.names, skeleton.parents.tolist(), skeleton.offsets.tobytes(), tips, roles, rest)
    return hashlib.blake2b(repr(what).encode(), digest_size=32).digest()
