"""Mistakes of callers with clips and options, each as an error that says what was given and what is expected."""

from __future__ import annotations

from signsplice.motion.clip import Clip

_SOURCES = "a file's is load(path), a gloss's open_lexicon(path).clip(gloss)"


def not_clips(clips: Clip | str) -> TypeError:
    """The error for one clip, or a text, in place of the clips of a sentence."""
    if isinstance(clips, Clip):
        return TypeError("clips is one Clip, expected a list of them: splice([a, b])")
    return TypeError(f"clips is the text {clips[:60]!r}, expected a list of Clips; {_SOURCES}")


def not_a_clip(clip: object, index: int) -> TypeError:
    """The error for something else among the clips of a sentence."""
    what = repr(clip)[:60] if isinstance(clip, str) else f"a {type(clip).__name__}"
    return TypeError(f"clip {index} is {what}, expected a Clip; {_SOURCES}")


def not_options(options: object, expected: type) -> TypeError:
    """The error for something else in place of options: often the second of two clips."""
    hint = "; clips go into one list: splice([a, b])" if isinstance(options, Clip) else ""
    return TypeError(f"options is a {type(options).__name__}, expected {expected.__name__}{hint}")
