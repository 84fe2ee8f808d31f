"""Commands on lexicons: build one, list its words, check it."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from signsplice.cli.clips import check_apart, check_output, limits, read_as, reads_clips
from signsplice.cli.options import AS_JSON, flag, option
from signsplice.cli.terminal import note, one_line, progress, warn
from signsplice.errors import InputError

if TYPE_CHECKING:
    from signsplice.lexicon import Entry, Lexicon


@click.group()
def lexicon() -> None:
    """Build, list and check lexicons: gloss -> clip."""


_OUTPUT = option("-o --output", "LEX", "Folder to make; a lexicon there is replaced.", required=True)
_COMPACT = flag("--compact", "Rotations in 16 bits: half the size, within 0.0001 rad.")
_JOBS = option("--jobs", "N", "Processes.  [default: one a core, for many]", type=click.IntRange(1))
_LENIENT = flag("--lenient", "Of written signs, leave out what is not understood, with a warning.")
_STRICT = flag("--strict", "Exit status 1 where a written sign was left out.")

_LANGUAGE = option("--language", "CODE", "Signed language, such as ase, where glosses.csv does not say.", default="")
_WARNINGS = option("--warnings all_warnings", "FILE", "Write every warning to FILE, one a line.")
_MOST_WARNINGS = 20
"""If there are more warnings, they are grouped by kind, with the count of each kind."""


@lexicon.command()
@click.argument("inputs", nargs=-1, required=True, metavar="IN...")
@_OUTPUT
@_COMPACT
@option("--signer", "NAME", "Who signs, where glosses.csv does not say.", default="")
@_LANGUAGE
@flag("--skip-broken", "Leave broken clips out, with a warning each.")
@option("--recipe", "NAME|FILE", "How an archive names its words: see docs/archives.md.", default="")
@_JOBS
@_LENIENT
@_STRICT
@_WARNINGS
@reads_clips
def build(inputs: tuple[str, ...], output: str, recipe: str, **others: Any) -> None:
    """Make a lexicon of every clip below folders, and of signs written in SiGML or HamNoSys.

    Glosses are the files' names, or stand in DIR/glosses.csv. With --recipe what is broken, or fits no word, is left
    out, and a build that was stopped goes on. IN may also be a .sigml file or a folder of them, or a table of the
    columns gloss and hamnosys (.csv), or its like in .json or .txt (docs/hamnosys.md).
    """
    check_apart(output, [*inputs, recipe] if len(inputs) > 1 else [recipe])
    _build(inputs, output, read=read_as(), recipe=recipe, limits=limits(), **others)


@lexicon.command()
@click.argument("folder", metavar="FOLDER")
@_OUTPUT
@_COMPACT
@_JOBS
@_STRICT
@_WARNINGS
def ngt(folder: str, output: str, **others: Any) -> None:
    """Make a lexicon of the signs of NGT that the SignON project wrote, from a folder of their .sigml files.

    They are data/dictionaries/NGT/Glosses of github.com/upf-gti/performs (Apache-2.0, whose licence file is beside
    them). None ships here. No signer has checked the motion.
    """
    from signsplice.lexicon.folder import is_written

    if not Path(folder).is_dir() or not is_written(folder):
        raise InputError(
            f"{folder}: expected a folder of .sigml files, such as data/dictionaries/NGT/Glosses of performs"
        )
    check_apart(output, [folder])
    _build((folder,), output, language="dse", **others)
    print("no signer has checked these signs; whether you may pass them on, their licence says")


def _build(inputs: tuple[str, ...], output: str, strict: bool, all_warnings: str | None, **others: Any) -> None:
    """Build a lexicon and print a summary."""
    from signsplice.formats import atomic
    from signsplice.lexicon import build as build_lexicon
    from signsplice.lexicon.folder import reasons
    from signsplice.splicing.cards import make_card

    with progress(f"building {Path(output).name}") as advance:
        built = build_lexicon(inputs, output, progress=advance, make_card=make_card, **others)
    if all_warnings:
        atomic.write(all_warnings, "".join(f"{one_line(line)}\n" for line in built.warnings))
    if len(built.warnings) <= _MOST_WARNINGS:
        warn(built.warnings)
    else:
        warn(f"{count:,} times, first in {where}: {reason}" for count, reason, where in reasons(built.warnings))
        where = all_warnings or f"of a build with --warnings FILE: all {len(built.warnings):,}, one a line"
        warn([f"every warning: {where}"])
    for count, reason, _ in reasons(built.left_out):
        print(f"{count:6} left out: {one_line(reason.removesuffix('; left out'))}")
    for line in built.unread:
        print(f"       {one_line(line)}")
    print(f"{output}: {_count(built.n_words, built.n_letters)}, {built.n_bytes / 1e6:.1f} MB, {built.form}")
    if strict and built.left_out:
        sys.exit(1)


@lexicon.command("list")
@click.argument("path", metavar="[LEX]", required=False)
@option("--search", "TEXT", "Only words with TEXT in their gloss or a synonym, in any case.")
@AS_JSON
def list_words(path: str | None, search: str | None, as_json: bool) -> None:
    """List the words of a lexicon; default the one that ships."""
    with open_words(path) as words:
        entries = words.search(search or "")
        if as_json:
            head = {"version": 1, "lexicon": str(words.path), "form": words.form, "bytes": words.n_bytes}
            rows = [_facts(entry) | {"language": words.language_of(entry.gloss)} for entry in entries]
            print(json.dumps(head | {"words": rows}, indent=2, ensure_ascii=False))
            return
        for entry in entries:
            print(one_line(_line(entry)))
        n_letters = sum(entry.kind == "letter" for entry in entries)
        print(f"{words.path}: {_count(len(entries), n_letters)}" + (f" of {len(words)}" if search else ""))


def _facts(entry: Entry) -> dict[str, Any]:
    return {
        "gloss": entry.gloss,
        "kind": entry.kind,
        "synonyms": list(entry.synonyms),
        "fps": entry.fps,
        "frames": entry.n_frames,
        "seconds": round(entry.seconds, 3),
        "rest_before": entry.rest_before,
        "rest_after": entry.rest_after,
        "signer": entry.signer,
        "source": entry.source,
        "checked": entry.checked,
        "sha256": entry.sha256,
    }


def _line(entry: Entry) -> str:
    notes = [entry.signer, "checked" if entry.checked else ""]
    notes.append(f"also {', '.join(entry.synonyms)}" if entry.synonyms else "")
    joined = "; ".join(note for note in notes if note)
    return f"{entry.gloss:24} {entry.kind:6} {entry.seconds:6.2f} s {entry.fps:7.2f} fps  {joined}".rstrip()


def _count(n_words: int, n_letters: int) -> str:
    words = f"{n_words} word{'s' if n_words != 1 else ''}"
    return words + (f", {n_letters} of them letters" if n_letters else "")


@lexicon.command()
@click.argument("path", metavar="DIR")
@option("--page", "PAGE.html", "Of a lexicon: write a page of its lengths, sizes and doubtful words.")
@_LANGUAGE
@reads_clips
def check(path: str, page: str | None, language: str) -> None:
    """Name every fault of a folder of clips, or of a lexicon.

    The exit status is 1 where there is one; what else `inspect` names is warned of.
    """
    from signsplice.lexicon import folder
    from signsplice.lexicon.store import INDEX

    if (Path(path) / INDEX).exists():
        with open_words(path) as words:
            contents = _count(len(words), 0)
            with progress(f"checking {Path(path).name}") as advance:
                faults = list(words.faults(advance))
            with progress(f"looking for stray frames in {Path(path).name}") as advance:
                warnings = list(words.warnings(advance))
            if page is not None:
                _write_page(words, page)
    elif page is not None:
        raise InputError(f"{path}: is no lexicon, expected one for --page; build it first")
    else:
        with progress(f"checking {Path(path).name}") as advance:
            checked = folder.check(path, None, advance, limits(), read_as(), language)
        faults, warnings = checked.faults, checked.warnings
        contents = f"{checked.n_clips} clip{'s' if checked.n_clips != 1 else ''}"
        note(checked.unread)
    warn(warnings)
    for fault in faults:
        print(one_line(fault))
    print(f"{path}: {contents}, {len(faults) or 'no'} fault{'s' if len(faults) != 1 else ''}")
    if faults:
        sys.exit(1)


def _write_page(words: Lexicon, page: str) -> None:
    """Write a page about a lexicon."""
    from signsplice.lexicon import page as lexicon_page

    check_output(page, [words.path])
    with progress(f"writing {Path(page).name}") as advance:
        facts = lexicon_page.write(words, Path(page), advance)
    print(f"{page}: {sum(bool(fact.doubts) for fact in facts)} of {len(facts)} words are doubtful")


def open_words(*paths: str | None, fallback: str | None = None, language: str = "") -> Lexicon:
    """Open the lexicons at ``paths`` as one, by default the shipped one with the forms of its signs, and with the
    written signs of ``fallback`` for words that all of them lack; those of a signed ``language`` come first.
    """
    from signsplice.lexicon import open_lexicon

    return open_lexicon(*paths, fallback=fallback, language=language)


COMMANDS = (lexicon,)
