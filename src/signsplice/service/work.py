"""Jobs of a worker process, one at a time: splices for requests, and growing sentences for streams."""

from __future__ import annotations

import pickle
import signal
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from signsplice.body.capsules import Avatar
from signsplice.children import end_with_parent
from signsplice.errors import InputError, UnknownGlossError
from signsplice.formats import parse as parse_file
from signsplice.formats.avatar import in_file_axes, morph_weights, parse_avatar, read_avatar, with_bones
from signsplice.lexicon import Lexicon, sentence
from signsplice.lexicon.gloss import LETTER_MARK
from signsplice.lexicon.languages import read_languages
from signsplice.lexicon.lexicon import open_lexicon
from signsplice.motion import Clip
from signsplice.service import scene, wire
from signsplice.service.settings import MIB, Settings
from signsplice.splicing import options as methods
from signsplice.splicing import report as reports
from signsplice.splicing.engine import Piece, SpliceOptions, Stream, onto_avatar, splice
from signsplice.splicing.faces import RULES
from signsplice.splicing.report import plain
from signsplice.splicing.word import Word, words_of
from signsplice.written.files import SUFFIXES as WRITTEN_SUFFIXES

_MOST_WRITTEN_BYTES = 256 << 10
"""Maximum size of a file of written signs, bytes; each sign takes some 50 ms to animate."""
_N_CACHED_AVATARS = 8
_N_CACHED_CLIPS = 256
"""Words that a process keeps in memory, about 0.3 MB each."""

QUICK_SECONDS = 0.15
"""Most work of a quick job, s: about 20 words. A job of another client waits as long for a worker."""
_LEAST_SECONDS = {
    "word": 0.005,  # joined
    "form": 0.2,  # made by the synthetic signer, as forms of signs and written signs are
    "system": 0.02,  # a word, beside its joining, where a system joins whole words
    "frame": 3e-5,  # of the words as stored, at the output's rate: encoded
    "fit": 8e-4,  # such a frame fitted to an avatar
    "png": 0.13 / 53,  # a word on a contact sheet, for each joint: other signers are drawn with less
    "gif": 0.022 / 53,  # a frame of a film, likewise
}
"""Processor time of parts of a job, the least of 2 to 9 runs with sentences of 1 to 160 words that ship, one thread on
an AMD EPYC core. A loaded core takes up to half as much again."""
_WARM_WORD_SECONDS = 0.003
"""Processor time of a word of the sentence that warms up a process, as soon as it is warm, on the same core, s."""
_LEAST_SHARES = {"letter": 0.24, "sign": 0.36}
"""Least length of a sentence in these runs, as a share of that of its words as stored."""

_N_WARMING = 3
"""Number of signs, and of letters, in the sentence that warms up a process."""


@dataclass(frozen=True)
class Answer:
    """The answer to a request.

    content: the body.
    media_type: of the body.
    name: of the file to download; None for JSON.
    """

    content: bytes
    media_type: str = "application/json"
    name: str | None = None


@dataclass
class _OpenStream:
    """A stream's growing sentence.

    opening: options of its client.
    avatar: that signs, or None.
    n_frames: number of frames sent; the skeleton is sent before them.
    """

    stream: Stream
    options: SpliceOptions
    opening: wire.OpenMessage
    avatar: Avatar | None = None
    n_frames: int = 0


class _WorkerState:
    """State of a worker process between jobs.

    clip: reads and caches words of the lexicon, with the features that networks computed of them.
    owns: reads and caches the channels of their own.
    avatar: reads and caches avatars of the settings by name.
    streams: growing sentences, by the key of their stream.
    pace: how many times as long as ``_LEAST_SECONDS`` this processor takes.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings, self.pace = settings, 1.0
        self.lexicon: Lexicon = open_lexicon(*settings.lexicons)
        self.clip = lru_cache(_N_CACHED_CLIPS)(self.lexicon.clip)
        self.owns = lru_cache(_N_CACHED_CLIPS)(self.lexicon.owns)
        self.avatar = lru_cache(_N_CACHED_AVATARS)(lambda name: read_avatar(settings.avatar_files[name]))
        self.streams: dict[str, _OpenStream] = {}


_worker: _WorkerState
"""State of this process; only ``start_worker`` sets it, before the first job. Jobs are plain functions, which can be
sent to the process; this keeps state between them."""


def start_worker(settings: Settings) -> None:
    """Make this process a worker: it ignores the terminal's interrupt, ends with its parent, and has bounded memory."""
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    if sys.platform == "linux":
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (settings.worker_bytes, settings.worker_bytes))
    _worker = _WorkerState(settings)


def warm_up(is_quick: bool) -> None:
    """Warm up with a sentence of signs and letters, as a request, and as a stream if the process is for quick jobs:
    read the networks, build the mannequin's mesh, and read an unknown word and avatars. Measures the pace.
    """
    lexicon = _worker.lexicon
    for name in [*_worker.settings.avatar_files][:_N_CACHED_AVATARS]:
        _worker.avatar(name)
    with suppress(InputError):  # reads the notation of the shipped signs, to look for a form, and a dictionary
        sentence.parse("NO-SUCH-WORD", lexicon)
    glosses = sorted(lexicon, key=lambda gloss: gloss.startswith(LETTER_MARK))
    n_letters = sum(gloss.startswith(LETTER_MARK) for gloss in glosses)
    glosses = [*glosses[:_N_WARMING], *glosses[len(glosses) - n_letters :][:_N_WARMING]]
    if is_quick:
        key = "warming"
        open_stream(key, wire.OpenMessage(type="open"))
        for gloss in glosses:
            for word in parse_message(key, wire.TextMessage("text", gloss))[0]:
                add_word(key, word)
        end_stream(key)
        close_stream(key)
    request = wire.SentenceRequest(glosses=glosses, face_rules=True, formats=list(wire.FORMAT_NAMES))
    splice_glosses(request, None)
    spent = []
    for _ in range(3):
        began = time.process_time()
        splice_glosses(wire.SentenceRequest(glosses=glosses, formats=[]), None)
        spent.append(time.process_time() - began)
    _worker.pace = max(1.0, min(spent) / (_WARM_WORD_SECONDS * len(glosses)))


# --- requests ---


Requested = wire.SentenceRequest | wire.SpliceRequest


def pickle_avatar(name: str, content: bytes) -> bytes:
    """Return the avatar in an uploaded file for later jobs, their ``upload``. Raises ``InputError``, also if it takes
    too much memory.
    """
    pickled = pickle.dumps(parse_avatar(content, name, _worker.settings.read_limits), pickle.HIGHEST_PROTOCOL)
    limit = _worker.settings.max_avatar_bytes // 4
    if len(pickled) > limit:
        sizes = f"{len(pickled) / MIB:.1f} MiB in memory, expected at most {limit / MIB:.1f} MiB"
        raise InputError(f"{name}: takes {sizes}; simplify its mesh or textures")
    return pickled


def _avatar(name: str | None, upload: bytes | None) -> Avatar | None:
    """Return an uploaded avatar, else one of the service's by name."""
    if upload is None:
        return None if name is None else _worker.avatar(name)
    avatar: Avatar = pickle.loads(upload)
    return avatar


def splice_if_quick(
    request: wire.SentenceRequest, file: wire.AnswerFile | None, upload: bytes | None = None
) -> Answer | float:
    """Answer a sentence as ``splice_glosses`` if that is quick, else return the work that it takes at least, seconds.

    Raises ``InputError`` as it does, and for work that does not fit ``work_seconds``.
    """
    units = _units(request.text or " ".join(request.glosses or ()), request, request.compounds)
    glosses = sentence.token_glosses(units)
    stored = [_worker.lexicon.entry(gloss) for gloss in glosses if _worker.lexicon.lists(gloss)]
    fps = request.fps or min((entry.fps for entry in stored), default=scene.FILM_FPS)
    seconds = _LEAST_SECONDS["form"] * len({gloss for gloss in glosses if not _worker.lexicon.lists(gloss)})
    least = sum(_LEAST_SHARES[entry.kind] * entry.seconds for entry in stored) / request.sign_speed
    n_joints = len(_worker.clip(stored[0].gloss).skeleton) if stored and request.avatar is None else 0
    seconds += _check_work(len(glosses), n_joints, least, sum(entry.seconds for entry in stored), fps, request, file)
    is_quick = seconds <= QUICK_SECONDS and file not in wire.PICTURES
    return splice_glosses(request, file, upload) if is_quick else seconds


def _check_work(
    n_words: int,
    n_joints: int,
    seconds_long: float,
    stored_seconds: float,
    fps: float,
    request: Requested,
    file: str | None,
) -> float:
    """Return the least work that joining, fitting and drawing take, seconds. ``n_joints``: of the signer, 0 if unknown;
    ``seconds_long``, ``stored_seconds``: length of the sentence, and of its words as stored.

    Raises ``InputError`` if it is over ``work_seconds``.
    """
    limit, n_frames = _worker.settings.work_seconds, stored_seconds / request.sign_speed * fps
    amounts = {
        "word": n_words,
        "system": n_words * (request.system is not None),
        "frame": n_frames,
        "fit": n_frames * (request.avatar is not None),
        "png": n_words * n_joints * (file == "png"),
        "gif": seconds_long * min(fps, scene.FILM_FPS) * n_joints * (file == "gif"),
    }
    seconds = _worker.pace * sum(_LEAST_SECONDS[part] * amount for part, amount in amounts.items())
    if seconds > limit:
        n_fitting = int(n_words * limit / seconds)
        raise InputError(
            f"{n_words} words as {file or 'files'} take about {seconds:.0f} s of work, expected at most {limit:g} s; "
            f"send about {n_fitting} words at a time, or ask for another file"
        )
    return seconds


def splice_glosses(request: wire.SentenceRequest, file: wire.AnswerFile | None, upload: bytes | None = None) -> Answer:
    """Answer a sentence with one ``file`` of it, or all as JSON, on an avatar if one is named or uploaded. Raises
    ``InputError``.
    """
    units = _units(request.text or " ".join(request.glosses or ()), request, request.compounds)
    sentence.token_glosses(units)  # raises if every word was left out
    avatar = _avatar(request.avatar, upload)
    words = words_of(units, _worker.clip, request.pauses, _worker.owns)
    return _answer(words, request, file, units, avatar, sentence.line_warnings(units, request.language))


def splice_files(
    files: Sequence[tuple[str, bytes]],
    request: wire.SpliceRequest,
    file: wire.AnswerFile | None,
    upload: bytes | None = None,
) -> Answer:
    """Answer files (name, content), in order, with one ``file`` of the splice, or all as JSON. A file of written signs
    stands for all of its signs.

    Raises ``InputError``.
    """
    clips = list[Clip]()
    for name, content in files:
        clips += _clips(name, content, _worker.settings.max_glosses - len(clips))
    return _answer([Word(clip) for clip in clips], request, file, (), _avatar(request.avatar, upload))


def _clips(name: str, content: bytes, most: int) -> Iterator[Clip]:
    """Yield the clip of a file, or the clips of at most ``most`` written signs."""
    if Path(name).suffix.lower() not in WRITTEN_SUFFIXES:
        yield parse_file(content, name, _worker.settings.read_limits)
        return
    from signsplice.written import signing

    if len(content) > _MOST_WRITTEN_BYTES:
        raise InputError(f"{name}: {len(content):,} bytes, expected at most {_MOST_WRITTEN_BYTES:,} of written signs")
    yield from signing.clips(content, name, most)


def _answer(
    words: list[Word],
    request: Requested,
    file: str | None,
    units: Sequence[sentence.SentenceToken],
    avatar: Avatar | None,
    warnings: Sequence[str] = (),
) -> Answer:
    limit, fps = _worker.settings.max_frames, request.fps or words[0].clip.fps
    seconds = sum(word.clip.seconds for word in words) / request.sign_speed
    if seconds * fps > limit:
        raise InputError(f"{seconds:.0f} s at {fps:g} fps are {seconds * fps:.0f} frames, expected at most {limit}")
    result = splice(words, options(request))
    result = replace(result, warnings=(*warnings, *result.warnings))
    n_joints = len(result.clip.skeleton) if avatar is None else 0
    _check_work(len(words), n_joints, result.clip.seconds, seconds * request.sign_speed, fps, request, file)
    if avatar is not None:
        result = onto_avatar(result, avatar)
    glb_has = {"mesh": request.mesh, "whole_face": isinstance(request, wire.SentenceRequest) and request.whole_face}
    if file is not None:
        name = scene.safe_name(result.clip.name.replace(" ", "-")) + "." + file
        if file in wire.PICTURES:
            return Answer(scene.picture(result, file), f"image/{file}", name)
        return Answer(scene.encode(result.clip, file, **glb_has), scene.media_type(file), name)
    rows = [asdict(unit) for unit in units]
    return Answer(
        scene.to_json(scene.splice_response(result.clip, reports.describe(result), request.formats, rows, **glb_has))
    )


def options(dials: wire.Dials) -> SpliceOptions:
    """Return a caller's dials as the engine's options."""
    chosen = {field.name: getattr(dials, field.name) for field in fields(wire.Dials)}
    time = dials.transition_time
    chosen |= {"duration": time, "transition_time": None} if isinstance(time, str) else {"duration": methods.AUTO}
    rules = RULES if isinstance(dials, wire.SentenceRequest | wire.OpenMessage) and dials.face_rules else ()
    return SpliceOptions(**chosen, face_rules=rules, limits=_worker.settings.read_limits)


def _units(text: str, wanted: wire.SentenceRequest | wire.OpenMessage, compounds: bool) -> list[sentence.SentenceToken]:
    """Parse a line of glosses. Raises ``InputError``, also for more words or letters than a sentence may have."""
    limit, lexicon = _worker.settings.max_glosses, _worker.lexicon
    n_words = len(sentence.split_words(text, lexicon.__contains__, read_languages(wanted.language)[0]))
    if n_words > limit:  # before look-up, which is slow for many words
        raise InputError(f"{n_words} words, expected at most {limit}")
    try:
        drops, languages = wanted.drop_function_words, (wanted.language, wanted.one_language)
        units = sentence.parse(text, lexicon, wanted.spell, compounds, drops, *languages)
    except UnknownGlossError:
        raise
    except InputError as error:  # callers need not know the lexicon's folder
        raise InputError(str(error).removeprefix(f"{lexicon.where}: ")) from error
    n_glosses = sum(len(unit.glosses) for unit in units)
    if n_glosses > limit:
        raise InputError(f"{n_glosses} words and letters, expected at most {limit}")
    return units


# --- streams ---


def open_stream(key: str, opening: wire.OpenMessage, upload: bytes | None = None) -> None:
    """Begin a growing sentence, of words that are fitted to an avatar if one is named or uploaded. Raises
    ``InputError``.
    """
    avatar = _avatar(opening.avatar, upload)
    chosen = replace(options(opening), onto=avatar)
    _worker.streams[key] = _OpenStream(Stream(chosen), chosen, opening, avatar)


Typed = wire.WordMessage | wire.TextMessage
"""Typed input of a stream's client."""


def parse_message(key: str, typed: Typed) -> tuple[list[sentence.LineGloss], list[dict[str, Any]]]:
    """Return the words and letters that sign a stream's typed input, and messages about how it was read.

    Raises ``InputError``.
    """
    opening = _worker.streams[key].opening
    line, compounds = (typed.text, opening.compounds) if isinstance(typed, wire.TextMessage) else (typed.gloss, False)
    units = _units(line, opening, compounds)
    words = sentence.line_glosses(units)
    if not opening.pauses:
        words = [replace(word, pause=None) for word in words]
    said = [*(unit.warning for unit in units if unit.warning), *sentence.line_warnings(units, opening.language)]
    warnings = [{"type": "warning", "warning": warning} for warning in said]
    return words, [*({"type": "unit", "unit": asdict(unit)} for unit in units), *warnings]


def add_word(key: str, word: sentence.LineGloss) -> list[dict[str, Any] | bytes]:
    """Add a word, or a letter of a spelled word, to a stream and return the messages that become final.

    Raises ``InputError`` if the word cannot become part of the sentence.
    """
    opened, clip = _worker.streams[key], _worker.clip(word.gloss)
    options, limit = opened.options, _worker.settings.max_frames
    n_frames = clip.seconds / options.sign_speed * (options.fps or clip.fps)
    if n_frames > limit:
        raise InputError(f"{word.gloss} has {n_frames:.0f} frames at this speed and rate, expected at most {limit}")
    owns = _worker.owns(word.gloss)
    return _messages(opened, opened.stream.push(Word(clip, word.starts, word.pause, word.brow, owns)))


def end_stream(key: str) -> list[dict[str, Any] | bytes]:
    """End a stream and return its last messages."""
    opened = _worker.streams[key]
    messages = _messages(opened, opened.stream.end())
    return [*messages, {"type": "done", "frames": opened.n_frames}]


def close_stream(key: str) -> None:
    """Forget a stream."""
    _worker.streams.pop(key, None)


def _messages(opened: _OpenStream, pieces: Iterable[Piece]) -> list[dict[str, Any] | bytes]:
    messages: list[dict[str, Any] | bytes] = []
    file = None if opened.avatar is None else opened.avatar.file
    for piece in pieces:
        clip, warnings, face = piece.clip, piece.warnings, piece.clip.face
        channels = None if face is None else (face.channels, face.weights)
        if file is not None:
            channels = morph_weights(clip, file)
            clip = in_file_axes(with_bones(clip, file), file)
        if not opened.n_frames:
            names = {"cutter": opened.stream.cutter, "transition": opened.stream.transition}
            nodes = None if file is None else list(file.nodes)
            messages.append({**scene.skeleton(clip), "nodes": nodes, **names})
            warnings = (*(() if opened.avatar is None else opened.avatar.warnings), *warnings)
        messages += [{"type": "warning", "warning": line} for line in warnings]
        if piece.seam is not None:
            messages.append({"type": "seam", "seam": plain(asdict(piece.seam))})
        messages.append({"type": "span", "span": plain(asdict(piece.span))})
        if channels is not None:
            rows = {"channels": list(channels[0]), "weights": channels[1].round(4).tolist()}
            messages.append({"type": "face", "first": opened.n_frames, **rows})
        messages.append(scene.frames(clip, opened.n_frames))
        opened.n_frames += len(clip)
    return messages
