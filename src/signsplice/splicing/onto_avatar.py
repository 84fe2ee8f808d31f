"""A spliced sentence brought to an avatar's body, once it is whole: transitions keep their contacts too."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING

from signsplice.body.retarget import retarget

if TYPE_CHECKING:
    from signsplice.body.capsules import Avatar
    from signsplice.splicing.result import SpliceResult


def onto_avatar(result: SpliceResult, avatar: Avatar) -> SpliceResult:
    """The sentence on an avatar. Spans and seams are those of the sentence before; ``avatar`` says what the hands touch
    and whether they do there.
    """
    done = retarget(result.clip, avatar)
    found = {"name": avatar.label, "contacts": [asdict(contact) for contact in done.contacts]}
    return replace(result, clip=done.clip, warnings=(*result.warnings, *done.warnings), avatar=found)
