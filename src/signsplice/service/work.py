"""What a worker process does: splices for requests, and sentences that grow for streams. One job at a time."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from multiprocessing import parent_process
from multiprocessing.process import BaseProcess
from typing import Any

from signsplice.errors import InputError, UnknownGlossError
from signsplice.formats import parse as parse_file
from signsplice.lexicon import Lexicon, shipped
from signsplice.lexicon.sentence import SentenceToken, parse
from signsplice.motion.clip import Clip
from signsplice.service import scene
from signsplice.service.settings import Settings
from signsplice.service.wire import Dials, Format, SentenceRequest, SpliceRequest
from signsplice.splicing import methods
from signsplice.splicing.engine import Piece, SpliceOptions, Stream, splice
from signsplice.splicing.report import plain

_N_KEPT = 256
"""Words that a process keeps in memory, some 0.3 MB each."""


@dataclass(frozen=True)
class Answer:
    """What a request is answered with."""

    content: bytes
    media_type: str = "application/json"
    name: str | None = None


@dataclass
class _Growing:
    """A stream's sentence; n_out: frames that were sent."""

    stream: Stream
    options: SpliceOptions
    spell: bool
    n_out: int = 0
    begun: bool = False


class _WorkerState:
    """What a process keeps between jobs: the lexicon, the words that were signed last, sentences that grow. A word that
    is kept need not be read again, nor told again what a network sees in it.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.lexicon: Lexicon = open_words(settings)
        self.clip = lru_cache(_N_KEPT)(self.lexicon.clip)
        self.growing: dict[str, _Growing] = {}


_worker: _WorkerState


def open_words(settings: Settings) -> Lexicon:
    """The service's words. Raises ``InputError``."""
    return shipped() if settings.lexicon is None else Lexicon(settings.lexicon)


def begin(settings: Settings) -> None:
    """Make this process a worker: deaf to the terminal's interrupt, mortal with its parent, bounded in memory."""
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent,), daemon=True).start()
    if sys.platform == "linux":
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (settings.worker_bytes, settings.worker_bytes))
    _worker = _WorkerState(settings)


def _follow(parent: BaseProcess) -> None:
    """End this process when its parent ends."""
    parent.join()
    os._exit(1)


def warm(skin: bool) -> None:
    """Do once what is slow at first: networks are read, two words are spliced, a skin is made."""
    words = _worker.lexicon.glosses[:2]
    result = splice([_worker.lexicon.clip(gloss) for gloss in words])
    if skin:
        scene.encode(result.clip, "glb")


def identity() -> int:
    """The number of the process."""
    return os.getpid()


def sign(request: SentenceRequest, file: Format | None) -> Answer:
    """The answer to a sentence. Raises ``InputError``."""
    units = _units(request.glosses, request.spell)
    line = [gloss for unit in units for gloss in unit.glosses]
    if len(line) > _worker.settings.max_glosses:
        raise InputError(f"{len(line)} words and letters, expected at most {_worker.settings.max_glosses}")
    return _answer([_worker.clip(gloss) for gloss in line], request, file, units)


def join(files: Sequence[tuple[str, bytes]], request: SpliceRequest, file: Format | None) -> Answer:
    """The answer to files that are to be spliced. Raises ``InputError``."""
    limit = _worker.settings.max_frames
    clips = []
    for name, content in files:
        clip = parse_file(content, name)
        if len(clip) > limit:
            raise InputError(f"{name}: {len(clip)} frames, expected at most {limit}")
        clips.append(clip)
    return _answer(clips, request, file, ())


def _answer(
    clips: list[Clip], request: SentenceRequest | SpliceRequest, file: Format | None, units: Iterable[SentenceToken]
) -> Answer:
    chosen = options(request)
    limit, fps = _worker.settings.max_frames, request.fps or clips[0].fps
    seconds = sum(clip.seconds for clip in clips) / request.sign_speed
    if seconds * fps > limit:
        raise InputError(f"{seconds:.0f} s at {fps:g} fps are {seconds * fps:.0f} frames, expected at most {limit}")
    result = splice(clips, chosen)
    if file is not None:
        name = scene.safe_name(result.clip.name.replace(" ", "-")) + "." + file
        return Answer(scene.encode(result.clip, file), scene.MEDIA_TYPES[file], name)
    return Answer(scene.to_json(scene.spliced(result, request.formats, [asdict(unit) for unit in units])))


def options(dials: Dials) -> SpliceOptions:
    """A caller's dials as the engine has them."""
    time = dials.transition_time
    return SpliceOptions(
        cutter=dials.cutter,
        transition=dials.transition,
        duration=time if isinstance(time, str) else methods.AUTO,
        transition_time=None if isinstance(time, str) else time,
        sign_speed=dials.sign_speed,
        fps=dials.fps,
        avoid_collisions=dials.body_sense,
    )


def _units(tokens: Sequence[str], spell: bool) -> list[SentenceToken]:
    try:
        return parse(" ".join(tokens), _worker.lexicon, spell)
    except UnknownGlossError:
        raise
    except InputError as error:
        raise InputError(str(error).removeprefix(f"{_worker.lexicon.path}: ")) from error


# --- streams ---


def open_stream(key: str, dials: Dials, spell: bool) -> None:
    """Begin a sentence that grows. Raises ``InputError``."""
    chosen = options(dials)
    _worker.growing[key] = _Growing(Stream(chosen), chosen, spell)


def read(key: str, token: str) -> tuple[list[str], list[str]]:
    """The words and letters that sign a stream's token, and what has to be said of it. Raises ``InputError``."""
    units = _units([token], _worker.growing[key].spell)
    return [gloss for unit in units for gloss in unit.glosses], [unit.warning for unit in units if unit.warning]


def feed(key: str, gloss: str) -> list[dict[str, Any] | bytes]:
    """The messages that are final now that a stream has one more word or letter. Raises ``InputError``; the word is
    then no part of the sentence.
    """
    growing, clip = _worker.growing[key], _worker.clip(gloss)
    options, limit = growing.options, _worker.settings.max_frames
    n_frames = clip.seconds / options.sign_speed * (options.fps or clip.fps)
    if n_frames > limit:
        raise InputError(f"{gloss} has {n_frames:.0f} frames so slowly, expected at most {limit}")
    return _messages(growing, growing.stream.push(clip))


def end_stream(key: str) -> list[dict[str, Any] | bytes]:
    """The last messages of a stream."""
    growing = _worker.growing[key]
    out = _messages(growing, growing.stream.end())
    return [*out, {"type": "done", "frames": growing.n_out}]


def close_stream(key: str) -> None:
    """Forget a stream."""
    _worker.growing.pop(key, None)


def _messages(growing: _Growing, pieces: Iterable[Piece]) -> list[dict[str, Any] | bytes]:
    out: list[dict[str, Any] | bytes] = []
    for piece in pieces:
        if not growing.begun:
            growing.begun = True
            named = {"cutter": growing.stream.cutter, "transition": growing.stream.transition}
            out.append({**scene.skeleton(piece.clip), **named})
        out += [{"type": "warning", "warning": line} for line in piece.warnings]
        if piece.seam is not None:
            out.append({"type": "seam", "seam": plain(asdict(piece.seam))})
        out.append({"type": "span", "span": plain(asdict(piece.span))})
        out.append(scene.frames(piece.clip, growing.n_out))
        growing.n_out += len(piece.clip)
    return out
