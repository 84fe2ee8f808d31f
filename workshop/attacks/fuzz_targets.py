"""What is fuzzed: for each kind of file valid ones to start from, a mutation, the reader, and the next step that a user
of what was read takes.
"""

from __future__ import annotations

import itertools
import json
import random
import shutil
import tempfile
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import fuzz_avatars
import fuzz_clips
import fuzz_folders
import fuzz_mutators
import fuzz_oracles
import fuzz_recipes
import fuzz_seeds
import fuzz_written
import signsplice as ss
from fuzz_clips import unpacked
from fuzz_seeds import CLASSICAL, N_REPORTED, ROOT, clip
from signsplice import formats, lexicon
from signsplice.body.capsules import Avatar
from signsplice.body.retarget import retarget
from signsplice.bulk import drawing, job, recipes, shards
from signsplice.bulk.maker import FailedSentence, SentenceMaker
from signsplice.errors import SignspliceError
from signsplice.formats import live_link
from signsplice.formats import roles as roles_files
from signsplice.formats.avatar import read_avatar
from signsplice.lexicon import recordings, sentence
from signsplice.motion import Clip, kinematics
from signsplice.motion.cache import CACHE
from signsplice.rig.info import rig_info
from signsplice.service import scene
from signsplice.signer import notation, planner
from signsplice.splicing import report as reports
from signsplice.splicing.options import open_learned
from signsplice.written import files as written
from signsplice_workshop.corpora.pairs import KINDS, Pairs

CORPUS = ROOT / "workshop" / "tests" / "fuzz_corpus"


@dataclass(frozen=True)
class Target:
    """A kind of file that is fuzzed.

    name: of the kind.
    seeds: valid files.
    mutate: another file from the bytes of one.
    put: writes the bytes into an empty folder and returns the path that is read.
    load: what the program reads at that path; raises ``InputError``, which names the path.
    use: the next step with what was read; raises ``InputError``.
    unpacked: the size of a file's content once unpacked.
    oracle: of ``fuzz_oracles``: whether it has judged what was read; raises ``WrongMotionError``.
    """

    name: str
    seeds: Callable[[], list[bytes]]
    mutate: fuzz_mutators.Mutator
    put: Callable[[bytes, Path], Path]
    load: Callable[[Path], Any]
    use: Callable[[Any], None]
    unpacked: Callable[[bytes], int] = len
    oracle: Callable[[bytes, Any], bool] | None = None

    def mutated(self, seeds: Sequence[bytes], rng: random.Random) -> bytes:
        """One of the seeds, mutated once or some times."""
        content = rng.choice(seeds)
        for _ in range(1 + min(int(rng.expovariate(0.9)), 6)):
            try:
                content = self.mutate(content, rng)
            except Exception:  # of a file that is broken already, which has no structure left
                break
        return content

    def exercise(self, content: bytes, folder: Path) -> tuple[Any, bool]:
        """What is read of a file that is put, loaded and used, None where it was refused; and whether it was used.

        Raises ``AssertionError`` for a refusal that is not one line with the file's name, and whatever else the reader
        lets through.
        """
        path = self.put(content, folder)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                loaded = self.load(path)
            except ss.InputError as error:
                check_message(str(error), path.name)
                return None, False
            try:
                self.use(loaded)
            except SignspliceError as error:
                check_message(str(error), "")
                return loaded, False
        return loaded, True

    def judge(self, content: bytes, loaded: Any) -> bool:
        """Whether the oracle has judged what was read of a file. Raises ``WrongMotionError``."""
        return self.oracle is not None and loaded is not None and self.oracle(content, loaded)


def check_message(text: str, name: str) -> None:
    """Raise ``AssertionError`` for an error that is not one line of fair length, or does not name the file."""
    assert 0 < len(text) < 1500, f"a message of {len(text)} characters"
    assert len(text.splitlines()) == 1, f"a message of several lines: {text!r}"
    assert name in text, f"a message without the file's name: {text!r}"


def use_clip(read: Clip) -> None:
    """A splice of a clip with a known one, and what is asked of its rig before."""
    rig = rig_info(read.skeleton)
    kinematics.forward(read)
    _ = rig.roles, rig.sizes
    if rig.has_arms:
        ss.splice([clip(), read], CLASSICAL)
    else:
        ss.splice([read, read], ss.SpliceOptions("ends", "hermite", "tempo"))


def _put_as(name: str) -> Callable[[bytes, Path], Path]:
    def put(content: bytes, folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content)
        return path

    return put


def _put_gltf(content: bytes, folder: Path) -> Path:
    suffix = ".gltf" if content[:4] != b"glTF" else ".vrma" if b"VRMC_vrm_animation" in content else ".glb"
    return _put_as(f"case{suffix}")(content, folder)


def _put_folder(content: bytes, folder: Path) -> Path:
    path = folder / "case"
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir()
    try:
        files = unpacked(content)
    except Exception:  # bytes that libFuzzer has cut: not what is tested here
        files = {}
    for name, inner in files.items():
        file = path.joinpath(*(part for part in Path(name).parts if part not in ("..", "/")))
        if file != path:
            file.parent.mkdir(exist_ok=True)
            file.write_bytes(inner)
    return path


def _unpacked_npz(content: bytes) -> int:
    try:
        return len(content) + sum(map(len, unpacked(content).values()))
    except Exception:  # whatever zipfile says of a damaged archive, nothing was unpacked
        return len(content)


def _mutate_gltf(content: bytes, rng: random.Random) -> bytes:
    mutate = fuzz_clips.of_glb if content[:4] == b"glTF" else fuzz_clips.of_gltf
    return mutate(content, rng)


def _use_lexicon(words: lexicon.Lexicon) -> None:
    """What `lexicon list`, `lexicon check` and `sentence` do."""
    with words:
        from signsplice.cli.lexicon import _facts, _line

        for entry in words.entries():
            json.dumps(_facts(entry), ensure_ascii=False).encode()
            _line(entry).encode()
        for fault in words.faults():
            check_message(" ".join(fault.splitlines()), "")
        words.search("h")
        for gloss in itertools.islice(words, 100):
            use_clip(words.clip(gloss))
        sentence.parse("HELLO fs-A HI", words)


def _use_bundle(methods: Any) -> None:
    """A splice of two small clips by whatever networks there are."""
    chosen: dict[str, Any] = {"cutter": "pose-velocity", "transition": "hermite", "duration": "tempo"}
    for kind, table in (
        ("cutter", methods.cutters),
        ("transition", methods.transitions),
    ):
        if table:
            chosen[kind] = next(iter(table.values()))
    ss.splice([clip(), clip(1)], ss.SpliceOptions(**chosen, avoid_collisions=False))


def _use_signs(signs: Any) -> None:
    """The motion of the first sign that is read: each takes some 20 ms."""
    for sign in itertools.islice(signs.values(), 1):
        planner.synthesize_word(sign)


def _use_report(read: Any) -> None:
    """What `view` and `render` make of a report."""
    from signsplice.render.sheet import Mark, caption, sheet_frames

    shown = scene.from_clip(clip(), read, ())
    json.dumps(reports.plain({"scenes": [shown], "live": False}), allow_nan=False).encode()
    marks = [Mark(span["kind"], span["name"] or "", *span["output"]) for span in read["spans"]]
    for frame in sheet_frames(N_REPORTED, marks):
        caption(marks, frame)[0].encode()


def _put_recipes(content: bytes, folder: Path) -> Path:
    return _put_as("case.parquet" if content[:4] == b"PAR1" else "case.csv")(content, folder)


def _put_written(content: bytes, folder: Path) -> Path:
    return _put_as("case.sigml" if content.lstrip()[:1] == b"<" else "case.csv")(content, folder)


def _load_recipes(path: Path) -> tuple[Path, list[Any]]:
    return path, list(recipes.read(path))


def _use_recipes(read: tuple[Path, list[Any]]) -> None:
    """What `bulk sentences` does: the recipes are stored, read again, and the first sentences made."""
    path, batches = read
    stored = path.with_name("stored.parquet")
    n_rows = recipes.write(stored, batches)
    assert recipes.is_same(stored, recipes.read(path)), "recipes are others when they are read again"
    rows = recipes.rows(stored, 0, min(n_rows, 3)) if n_rows else []
    for row in rows:
        _ = row.sha256
    for made in _maker().make(list(filter(_is_short, rows))):
        if isinstance(made, FailedSentence):
            check_message(made.reason, "")
            assert not made.reason.startswith("unexpected"), made.reason


def _is_short(row: recipes.SentenceRecipe) -> bool:
    """Whether a sentence is soon made: a letter takes as long as a word."""
    return len("-".join(row.glosses)) < 40


def _maker() -> SentenceMaker:
    """Makes sentences of the words that ship, opened once."""
    return CACHE.recent(SentenceMaker, lexicon.open_shipped_lexicon(), most=1)


def _use_lines(found: tuple[list[Any], list[str]]) -> None:
    """Recipes and warnings of lines of glosses."""
    for batch in found[0]:
        recipes.recipes_of(batch)
    for line in found[1]:
        check_message(line, "")


def _use_shards(made: job.BulkJob, folder: Path) -> None:
    """What `bulk make` does."""
    job.is_whole(folder, made, 0)
    if made.n_recipes and _is_short(recipes.rows(folder / job.RECIPES, 0, 1)[0]):
        shards.remake(str(folder), 0, str(folder / "made.npz"), None)


def _use_avatar(avatar: Avatar) -> None:
    """What `convert --avatar` does: a clip is brought to the avatar's body and written."""
    for line in avatar.warnings:
        check_message(line, "")
    done = retarget(clip(), avatar)
    for suffix in (".bvh", ".vrma") if len(avatar) < 100 else ():
        formats.encode(done.clip, f"case{suffix}")


def _use_pairs(pairs: Pairs) -> None:
    """The first pairs of each split, as clips."""
    for name in pairs.head["splits"]:
        for number in pairs.split(name, "test")[:2]:
            pairs.clip(number)
            pairs.transition_clip(number)
            for kind in KINDS:
                pairs.utterance(number, kind)
    for word in range(min(len(pairs.head["words"]), 2)):
        pairs.word_clip(word)
        pairs.space(word)


@cache
def _truth() -> dict[str, list[Clip]]:
    """Gloss or synonym -> what the lexicons that fuzzing starts from have of it, each stored in its form."""
    found: dict[str, list[Clip]] = {}
    for content in fuzz_seeds.lexicon_seeds():
        with tempfile.TemporaryDirectory() as name, lexicon.open(_put_folder(content, Path(name))) as words:
            for gloss in (*words, "HI"):
                found.setdefault(gloss, []).append(words.clip(gloss))
    return found


TARGETS = {
    target.name: target
    for target in (
        Target("bvh", lambda: fuzz_seeds.clip_seeds(".bvh"), fuzz_mutators.of_text, _put_as("case.bvh"), formats.load,
               use_clip, oracle=fuzz_oracles.of_bvh),
        Target("npz", lambda: fuzz_seeds.clip_seeds(".npz"), fuzz_clips.of_npz, _put_as("case.npz"), formats.load,
               use_clip, _unpacked_npz, fuzz_oracles.of_npz),
        Target("smplx", fuzz_seeds.smplx_seeds, fuzz_clips.of_npz, _put_as("case.npz"), formats.load, use_clip,
               _unpacked_npz),
        Target("gltf", fuzz_seeds.gltf_seeds, _mutate_gltf, _put_gltf, formats.load, use_clip,
               oracle=fuzz_oracles.of_gltf),
        Target("fbx", fuzz_seeds.fbx_seeds, fuzz_clips.of_fbx, _put_as("case.fbx"), formats.load, use_clip),
        Target("fbxavatar", lambda: fuzz_seeds.fbx_seeds()[1:2], fuzz_clips.of_fbx, _put_as("case.fbx"), read_avatar,
               _use_avatar),
        Target("avatar", lambda: fuzz_avatars.seeds(clip().skeleton), fuzz_clips.of_glb, _put_as("case.vrm"),
               read_avatar, _use_avatar, oracle=fuzz_oracles.of_avatar),
        Target("lexicon", fuzz_seeds.lexicon_seeds, fuzz_folders.of_lexicon, _put_folder, lexicon.open, _use_lexicon,
               _unpacked_npz, lambda _, read: fuzz_oracles.of_lexicon(_truth(), read)),
        Target("bundle", fuzz_seeds.bundle_seeds, fuzz_folders.of_bundle, _put_folder, open_learned, _use_bundle,
               _unpacked_npz),
        Target("recipes", fuzz_recipes.seeds, fuzz_recipes.mutated, _put_recipes, _load_recipes, _use_recipes),
        Target("lines", lambda: [fuzz_seeds.LINES], fuzz_mutators.of_text, _put_as("case.txt"),
               lambda path: drawing.lines(path, lexicon.open_shipped_lexicon()), _use_lines),
        Target("shards", fuzz_seeds.shards_seeds, fuzz_folders.of_shards, _put_folder,
               lambda path: (job.read_job(path), path), lambda read: _use_shards(*read), _unpacked_npz),
        Target("pairs", fuzz_seeds.pairs_seeds, fuzz_folders.of_pairs, _put_folder, Pairs, _use_pairs, _unpacked_npz),
        Target("signs", lambda: [fuzz_seeds.SIGNS], fuzz_mutators.of_text, _put_as("case.signs"), notation.read,
               _use_signs),
        Target("written", fuzz_written.seeds, fuzz_written.mutated, _put_written, written.read, fuzz_written.use),
        Target("roles", fuzz_seeds.roles_seeds, fuzz_mutators.of_json, _put_as("case.json"), roles_files.read,
               lambda read: use_clip(roles_files.with_roles(clip(4, "other"), read))),
        Target("report", fuzz_seeds.report_seeds, fuzz_mutators.of_json, _put_as("case.json"),
               lambda path: reports.read(path, N_REPORTED), _use_report),
        Target("face", lambda: [live_link.encode(fuzz_seeds.with_face(clip()))], fuzz_mutators.of_text,
               _put_as("case.csv"), lambda path: live_link.with_face(clip(), path), use_clip),
        Target("glosses", lambda: [fuzz_seeds.GLOSSES], fuzz_mutators.of_text, _put_as("glosses.csv"),
               recordings.read_table, lambda _: None),
    )
}  # fmt: skip
"""Name -> what is fuzzed."""
