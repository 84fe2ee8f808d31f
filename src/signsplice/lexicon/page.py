"""A page about a lexicon: lengths and rest of its words, stature of its signers, joint speeds, and doubtful words with
pictures.
"""

from __future__ import annotations

import base64
from collections import Counter
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from signsplice.errors import InputError
from signsplice.formats import atomic
from signsplice.lexicon import Lexicon
from signsplice.motion import Clip, rotation
from signsplice.progress import Progress, track_progress
from signsplice.render.sheet import Strip, write_strips
from signsplice.rig.info import rig_info
from signsplice.rig.inspection import clip_warnings
from signsplice.rig.rest_pose import with_rest_pose

_PERCENTILES = (0, 5, 50, 95, 100)
_MOST_SHOWN = 30
"""Maximum number of doubtful words with pictures."""
_N_PICTURES = 8
"""Frames shown of each doubtful word."""
_LEAST_S = 0.3
"""Shorter words are doubtful, seconds."""
_MOST_S = 8.0
"""Longer words are doubtful, seconds."""
_MOST_DEG_S = 3000.0
"""Words in which a joint turns faster are doubtful, degrees/s."""
_STYLE = "body{font:15px sans-serif;margin:2em}td,th{padding:2px 10px;text-align:left}img{max-width:100%}"


@dataclass(frozen=True)
class WordFacts:
    """Facts about a word on the page.

    gloss: its gloss.
    seconds: its length.
    rest_before_s, rest_after_s: rest within that length, seconds; NaN if the arms are unknown.
    stature_m: stature of its signer, metres.
    fastest_deg_s: highest angular speed of a joint between two frames, degrees/s.
    doubts: possible faults, one line each.
    """

    gloss: str
    seconds: float
    rest_before_s: float
    rest_after_s: float
    stature_m: float
    fastest_deg_s: float
    doubts: tuple[str, ...]


def write(words: Lexicon, page: Path, progress: Progress | None = None) -> list[WordFacts]:
    """Write the page as one HTML file with embedded pictures. Returns the facts about each word, the most doubtful
    first. Unreadable words are doubtful; doubts that most words share are listed once.
    """
    facts = [_facts(words, gloss) for gloss in track_progress([*words.glosses], progress)]
    counts = Counter(line for fact in facts for line in fact.doubts)
    of_the_rig = [line for line, count in counts.items() if count > max(1, len(facts) // 2)]
    facts = [replace(fact, doubts=tuple(line for line in fact.doubts if line not in of_the_rig)) for fact in facts]
    facts.sort(key=lambda fact: (-len(fact.doubts), fact.gloss))
    doubtful = [fact for fact in facts if fact.doubts]
    parts = [f"<h1>{escape(words.path.name)}: {len(facts)} words, {len(doubtful)} of them doubtful</h1>"]
    parts += [f"<p>Of most words: {escape(line)}</p>" for line in of_the_rig]
    head = ("", *(f"{percent} %" for percent in _PERCENTILES))
    parts += _table(head, [(name, *_percentiles(facts, field)) for name, field in _MEASURES.items()])
    if doubtful:
        parts += ["<h2>Doubtful words</h2>", _pictures(words, doubtful[:_MOST_SHOWN])]
        parts += _table(("gloss", "what may be wrong"), [(fact.gloss, "; ".join(fact.doubts)) for fact in doubtful])
    parts.append("<h2>All words</h2>")
    rows = [(fact.gloss, *(f"{getattr(fact, field):.2f}" for field in _MEASURES.values())) for fact in facts]
    parts += _table(("gloss", *_MEASURES), sorted(rows))
    head_ = f'<!doctype html><meta charset="utf-8"><title>{escape(words.path.name)}</title><style>{_STYLE}</style>'
    atomic.write(page, "\n".join([head_, *parts]) + "\n")
    return facts


_MEASURES = {
    "seconds": "seconds",
    "s of rest before": "rest_before_s",
    "s of rest after": "rest_after_s",
    "stature, m": "stature_m",
    "fastest joint, degrees/s": "fastest_deg_s",
}
"""Heading -> field of ``WordFacts``."""


def _facts(words: Lexicon, gloss: str) -> WordFacts:
    entry = words.entry(gloss)
    before, after = (np.nan if rest is None else rest / entry.fps for rest in (entry.rest_before, entry.rest_after))
    try:
        clip = words.clip(gloss)
        doubts, stature = [*clip_warnings(clip)], rig_info(clip.skeleton).sizes.unit.stature_m
    except InputError as error:
        return WordFacts(gloss, entry.seconds, before, after, np.nan, np.nan, (str(error),))
    fastest = _fastest(clip)
    if not _LEAST_S <= entry.seconds <= _MOST_S:
        doubts.append(f"it takes {entry.seconds:.2f} s")
    if fastest > _MOST_DEG_S:
        doubts.append(f"a joint turns by {fastest:,.0f} degrees/s")
    return WordFacts(gloss, entry.seconds, before, after, stature, fastest, tuple(doubts))


def _fastest(clip: Clip) -> float:
    """Return the highest angular speed of a joint, degrees/s."""
    if len(clip) < 2:
        return 0.0
    steps = rotation.angle_between(clip.local_rotations[:-1], clip.local_rotations[1:])
    return float(np.rad2deg(steps.max()) * clip.fps)


def _percentiles(facts: list[WordFacts], field: str) -> list[str]:
    values = np.array([getattr(fact, field) for fact in facts])
    known = values[np.isfinite(values)]
    return [f"{value:.2f}" for value in np.percentile(known, _PERCENTILES)] if len(known) else []


def _pictures(words: Lexicon, doubtful: list[WordFacts]) -> str:
    """Return one HTML image with a row of frames for each word that can be drawn."""
    strips = []
    for fact in doubtful:
        try:
            clip = with_rest_pose(words.clip(fact.gloss))
            _ = rig_info(clip.skeleton).arm_joints
        except InputError:
            continue
        frames = np.linspace(0, len(clip) - 1, min(_N_PICTURES, len(clip))).round().astype(int).tolist()
        strips.append(Strip(clip, f"{fact.gloss}: {fact.doubts[0]}", frames))
    if not strips:
        return ""
    with TemporaryDirectory() as folder:
        file = Path(folder, "strips.png")
        write_strips(strips, file)
        return f'<img alt="" src="data:image/png;base64,{base64.b64encode(file.read_bytes()).decode()}">'


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    cells = [[f"<th>{escape(cell)}" for cell in head], *([f"<td>{escape(cell)}" for cell in row] for row in rows)]
    return ["<table>", *(f"<tr>{''.join(row)}" for row in cells), "</table>"]
