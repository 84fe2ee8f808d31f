"""Reads plain sentences by command, Python, service and stream, and counts what is signed, spelled and left out.

    python workshop/runs/typed_lines.py [--ngt FOLDER] [--page workshop/docs/measured/typed-lines.md]

The sentences are those of tests/data/typed_lines.tsv. Greek, whose letters do not ship, is read with a lexicon made
here, whose Greek letters have the clips of Latin ones. FOLDER holds the signs of NGT in SiGML (docs/hamnosys.md): Dutch
sentences are then also read with them. Exits with status 1 if a line is silenced, or read differently in one way.
"""

from __future__ import annotations

import argparse
import csv
import json
import signal
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any
from unittest.mock import patch

import httpx
from websockets.sync.client import connect

import signsplice as ss
from signsplice import lexicon
from signsplice.cli.commands import app
from signsplice.lexicon import Lexicon
from signsplice.lexicon.sentence import SentenceToken

ROOT = Path(__file__).resolve().parents[2]
LINES = ROOT / "tests" / "data" / "typed_lines.tsv"
CODES = {"en": "en", "de": "gsg", "nl": "dse", "fr": "fr", "el": "gss"}
"""Language of a line -> the option under which it is read."""
NAMES = {"en": "English", "de": "German", "nl": "Dutch", "fr": "French", "el": "Greek"}
GREEK = dict(zip("ΑΒΓΔΕΖΗΘΙΚΛΜΝΞΟΠΡΣΤΥΦΧΨΩ", "ABCDEFGHIJKLMNOPQRSTUVWX", strict=True))
WAYS = ("command", "Python", "service", "stream")

Reading = list[tuple[str, tuple[str, ...]]]
"""Each word of a line, and the glosses that sign it."""


@dataclass(frozen=True)
class Line:
    """A sentence, and how it was read in each of ``WAYS``; empty where it was refused."""

    language: str
    text: str
    readings: tuple[Reading, ...]


def make_greek(folder: Path) -> Path:
    """Makes a lexicon of Greek letters, digits and three glosses, with clips that ship, and returns its folder."""
    with ss.open_lexicon() as shipped, lexicon.building(folder) as builder:
        clips = {f"fs-{greek}": f"fs-{latin}" for greek, latin in GREEK.items()}
        clips |= {f"fs-{digit}": f"fs-{digit}" for digit in "0123456789"}
        clips |= {"ΓΡΑΦΩ": "WRITE", "ΣΠΙΤΙ": "HOUSE", "ΜΗΤΕΡΑ": "MOTHER"}
        for gloss, source in clips.items():
            builder.add(shipped.clip(source), gloss, extensions={"language": b"gss"})
    return folder


@contextmanager
def serve(folder: str) -> Iterator[str]:
    """Yields the address of a service with a lexicon."""
    call = [sys.executable, "-m", "signsplice", "serve", "--port", "0", "--workers", "1", "--lexicon", folder]
    process = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        yield line[line.index("http://") :].split()[0].rstrip("/")
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(60)


def reading(units: Sequence[dict[str, object]]) -> Reading:
    """Returns how a line was read, from the units of a report or a stream."""
    return [(str(unit["token"]), tuple(unit["glosses"])) for unit in units]  # type: ignore[arg-type]


def by_command(text: str, code: str, folder: str, out: Path) -> Reading:
    """Reads a line by `signsplice sentence`; its clip is written."""
    call = [
        "sentence",
        "--language",
        code,
        "--lexicon",
        folder,
        "-o",
        str(out / "o.npz"),
        "--report",
        str(out / "r.json"),
    ]
    with patch("sys.stdout", StringIO()), patch("sys.stderr", StringIO()):
        app.main([*call, "--", text], standalone_mode=False)
    return reading(json.loads((out / "r.json").read_text("utf-8"))["units"])


def by_python(text: str, code: str, words: Lexicon) -> Reading:
    """Reads a line by ``ss.parse`` and splices it."""
    tokens = ss.parse(text, words, language=code)
    assert len(ss.splice(ss.words_of(tokens, words.clip, owns_of=words.owns)).clip) > 1
    return [(token.token, token.glosses) for token in tokens]


def by_service(text: str, code: str, address: str) -> Reading:
    """Reads a line by POST /v1/sentence."""
    answer = httpx.post(f"{address}/v1/sentence", json={"text": text, "language": code, "formats": []}, timeout=300)
    return reading(answer.json()["units"]) if answer.status_code == 200 else []


def by_stream(text: str, code: str, address: str) -> Reading:
    """Reads a line by the WebSocket /v1/stream."""
    units, n_frames = list[dict[str, object]](), 0
    with connect(address.replace("http", "ws", 1) + "/v1/stream", max_size=None, open_timeout=300) as socket:
        opening = {"type": "open", "paced": False, "language": code}
        for sent in (opening, {"type": "text", "text": text}, {"type": "end"}):
            socket.send(json.dumps(sent))
        for received in socket:
            message: dict[str, Any] = json.loads(received) if isinstance(received, str) else {}
            units += [message["unit"]] if message.get("type") == "unit" else []
            n_frames = message.get("frames", n_frames)
    return reading(units) if n_frames > 1 else []


def read_lines() -> list[Line]:
    """Reads every line of the table in each of ``WAYS``."""
    with LINES.open(encoding="utf-8", newline="") as file:
        rows = [row[:2] for row in csv.reader(file, delimiter="\t", quoting=csv.QUOTE_NONE)][1:]
    lines = []
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        out = Path(folder)
        folders = dict.fromkeys(CODES, "default") | {"el": str(make_greek(out / "greek"))}
        services = {name: stack.enter_context(serve(name)) for name in dict.fromkeys(folders.values())}
        opened = {name: stack.enter_context(ss.open_lexicon(name)) for name in services}
        for language, text in rows:
            code, name = CODES[language], folders[language]
            ways = (
                lambda: by_command(text, code, name, out),  # noqa: B023
                lambda: by_python(text, code, opened[name]),  # noqa: B023
                lambda: by_service(text, code, services[name]),  # noqa: B023
                lambda: by_stream(text, code, services[name]),  # noqa: B023
            )
            lines.append(Line(language, text, tuple(attempt(way) for way in ways)))
    return lines


def attempt(way: object) -> Reading:
    """Returns a reading, empty if the line is refused."""
    try:
        return way()  # type: ignore[operator,no-any-return]
    except ss.InputError as error:
        print(error, file=sys.stderr)
        return []


def kinds(line: Line) -> list[str]:
    """Returns of each word of a line whether it is signed, spelled or left out."""
    of = [(token, "spelled" if glosses[:1] and glosses[0].startswith("fs-") else "signed" if glosses else "left out")
          for token, glosses in line.readings[1]]  # fmt: skip
    return [kind for token, kind in of for _ in token.split()]


def count_ngt(lines: Sequence[Line], folder: str) -> tuple[int, int]:
    """Returns the words of Dutch lines, and those that the signs of NGT sign."""
    with ss.open_lexicon(fallback=folder, language="dse") as words:
        tokens: list[SentenceToken] = []
        for line in lines:
            tokens += ss.parse(line.text, words, language="dse") if line.language == "nl" else []
    n_words = [len(token.token.split()) for token in tokens]
    is_ngt = [bool(token.glosses) and not token.spelled and token.language == "dse" for token in tokens]
    return sum(n_words), sum(n for n, signed in zip(n_words, is_ngt, strict=True) if signed)


def main() -> None:
    """Reads all lines, prints the table, and writes it to a page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ngt", metavar="FOLDER")
    parser.add_argument("--page", metavar="PAGE.md", type=Path)
    call = parser.parse_args()
    lines = read_lines()
    silenced = {way: sum(not line.readings[n] for line in lines) for n, way in enumerate(WAYS)}
    different = [line.text for line in lines if any(one != line.readings[0] for one in line.readings)]
    n_silent, n_readings = sum(silenced.values()), len(lines) * len(WAYS)
    finding = f"""{len(lines)} plain sentences ([table](../../../tests/data/typed_lines.tsv)) by command, Python,
        service and stream: {n_silent} of {n_readings} readings are silent, {len(different)} sentences are read
        differently in one way. English and French are spelled with the American alphabet, German and Dutch with their
        own; Greek, whose letters do not ship, with clips of Latin ones. Whether an English label means the word of
        another language is not asked."""
    page = ["# Typed lines", "", *textwrap.wrap(" ".join(finding.split()), 118, break_on_hyphens=False), ""]
    page += ["| language | `--language` | lines | words | signed | spelled | left out |", "| --- " * 7 + "|"]
    for language, code in CODES.items():
        of = [line for line in lines if line.language == language]
        words = [kind for line in of for kind in kinds(line)]
        counts = [words.count(kind) for kind in ("signed", "spelled", "left out")]
        page.append("| " + " | ".join(map(str, (NAMES[language], f"`{code}`", len(of), len(words), *counts))) + " |")
    if call.ngt:
        n_words, n_signed = count_ngt(lines, call.ngt)
        page += ["", f"With the NGT signs as `--fallback`, {n_signed} of the {n_words} Dutch words are signed in NGT."]
    page += ["", "Made by `workshop/runs/typed_lines.py --ngt FOLDER --page workshop/docs/measured/typed-lines.md`."]
    print(*page, *(f"differs: {text}" for text in different), sep="\n")
    if call.page:
        call.page.write_text("\n".join(page) + "\n", encoding="utf-8")
    sys.exit(bool(different or any(silenced.values())))


if __name__ == "__main__":
    main()
