"""What callers give by mistake for clips and options, said in one line."""

from __future__ import annotations

from signsplice.motion.clip import Clip


def check_clips(clips: object) -> None:
    """Raise ``TypeError`` where one clip or a text stands for the clips of a sentence."""
    if isinstance(clips, Clip):
        raise TypeError("clips is one Clip, expected a list of them: splice([a, b])")
    if isinstance(clips, str):
        raise TypeError(f"clips is the text {clips[:60]!r}, expected a list of Clips; {_SOURCES}")


def check_clip(clip: object, index: int) -> None:
    """Raise ``TypeError`` where something else stands among the clips of a sentence."""
    if not isinstance(clip, Clip):
        what = repr(clip)[:60] if isinstance(clip, str) else f"a {type(clip).__name__}"
        raise TypeError(f"clip {index} is {what}, expected a Clip; {_SOURCES}")


def check_options(options: object, expected: type) -> None:
    """Raise ``TypeError`` where options are something else: often the second of two clips."""
    if not isinstance(options, expected):
        hint = "; clips go into one list: splice([a, b])" if isinstance(options, Clip) else ""
        raise TypeError(f"options is a {type(options).__name__}, expected {expected.__name__}{hint}")


_SOURCES = "a file's is load(path), a gloss's open_lexicon(path).clip(gloss)"
