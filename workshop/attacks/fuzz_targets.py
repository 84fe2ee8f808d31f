"""Lists the targets of fuzzing: for each kind of file valid ones to start from, the reader, and the next
step that a user of the read data takes.
"""

from __future__ import annotations

import itertools
import json
import shutil
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import fuzz_oracles as oracles
import fuzz_seeds as seeds
import signsplice as ss
from fuzz_seeds import CLASSICAL, N_REPORTED, ROOT, make_clip, read_seeds
from fuzz_trees import unpack
from signsplice import formats, lexicon
from signsplice.body import collision
from signsplice.body.capsules import Avatar
from signsplice.body.retarget import retarget
from signsplice.bulk import drawing, job, recipes, shards
from signsplice.bulk.maker import FailedSentence, SentenceMaker
from signsplice.errors import InputError, SignspliceError
from signsplice.formats import live_link
from signsplice.formats import roles as roles_files
from signsplice.formats.avatar import read_avatar
from signsplice.lexicon import recordings, sentence
from signsplice.motion import Clip, kinematics, rotation
from signsplice.motion.cache import CACHE
from signsplice.rig.info import rig_info
from signsplice.service import scene
from signsplice.signer import notation, planner
from signsplice.signer.pose import ELBOW_LIMIT, FOREARM_LIMIT, WRIST_LIMITS
from signsplice.signer.signer import JOINTS
from signsplice.splicing import report as reports
from signsplice.splicing.options import open_learned
from signsplice.written import files as written
from signsplice.written import signing
from signsplice.written.compiler import compile_sign
from signsplice_workshop.corpora.pairs import KINDS, Pairs

CORPUS = ROOT / "workshop" / "tests" / "fuzz_corpus"
_MAX_SECONDS, _MAX_STEP_DEG, _SLACK, _DEEP_CM = 60.0, 90.0, np.deg2rad(1.0), 0.5
"""Limits of every sign: its length, s; turn of a joint in a frame at 30 fps, degrees; beyond the limits of elbows and
wrists, radians; depth of a hand in the body, cm, that no note tells of.
"""


@dataclass(frozen=True)
class Target:
    """A kind of file that is fuzzed.

    name: of the kind.
    seeds: returns valid files.
    put: writes the bytes into an empty folder and returns the path to read.
    load: reads that path; raises ``InputError``, which names the path.
    use: takes the next step with the read data; raises ``InputError``.
    unpacked: returns the size of a file's content once unpacked.
    oracle: of ``fuzz_oracles``: returns whether it has judged the read data; raises ``WrongMotionError``.
    """

    name: str
    seeds: Callable[[], list[bytes]]
    put: Callable[[bytes, Path], Path]
    load: Callable[[Path], Any]
    use: Callable[[Any], None]
    unpacked: Callable[[bytes], int] = len
    oracle: Callable[[bytes, Any], bool] | None = None

    def exercise(self, content: bytes, folder: Path) -> tuple[Any, bool]:
        """Puts, loads and uses a file; returns the loaded data, None if it was refused, and whether they were used.

        Raises ``AssertionError`` for a refusal that is not one line with the file's name, and any other error that the
        reader lets through.
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
        """Returns whether the oracle has judged what was read of a file. Raises ``WrongMotionError``."""
        return self.oracle is not None and loaded is not None and self.oracle(content, loaded)


def check_message(text: str, name: str) -> None:
    """Raises ``AssertionError`` for an error that is not one line of fair length, or does not name the file."""
    assert 0 < len(text) < 1500, f"a message of {len(text)} characters"
    assert len(text.splitlines()) == 1, f"a message of several lines: {text!r}"
    assert name in text, f"a message without the file's name: {text!r}"


def use_clip(read_clip: Clip) -> None:
    """Splices a clip with a known one, and reads its rig before."""
    rig = rig_info(read_clip.skeleton)
    kinematics.forward(read_clip)
    _ = rig.roles, rig.sizes
    if rig.has_arms:
        ss.splice([make_clip(), read_clip], CLASSICAL)
    else:
        ss.splice([read_clip, read_clip], ss.SpliceOptions("ends", "hermite", "tempo"))


def _put_as(name: str | Callable[[bytes], str]) -> Callable[[bytes, Path], Path]:
    def put(content: bytes, folder: Path) -> Path:
        path = folder / (name if isinstance(name, str) else name(content))
        path.write_bytes(content)
        return path

    return put


def _name_gltf(content: bytes) -> str:
    is_vrma = b"VRMC_vrm_animation" in content
    return "case.gltf" if content[:4] != b"glTF" else "case.vrma" if is_vrma else "case.glb"


def _put_folder(content: bytes, folder: Path) -> Path:
    path = folder / "case"
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir()
    try:
        files = unpack(content)
    except Exception:  # bytes that libFuzzer has cut are not tested here
        files = {}
    for name, file_bytes in files.items():
        file = path.joinpath(*(part for part in Path(name).parts if part not in ("..", "/")))
        if file != path:
            file.parent.mkdir(exist_ok=True)
            file.write_bytes(file_bytes)
    return path


def _measure_unpacked_npz(content: bytes) -> int:
    try:
        return len(content) + sum(map(len, unpack(content).values()))
    except Exception:  # whatever zipfile raises for a damaged archive, nothing was unpacked
        return len(content)


def _use_lexicon(words: lexicon.Lexicon) -> None:
    """Does what `lexicon list`, `lexicon check` and `sentence` do."""
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
    """Splices two small clips by the networks of a bundle."""
    chosen: dict[str, Any] = {"cutter": "pose-velocity", "transition": "hermite", "duration": "tempo"}
    for kind, table in (("cutter", methods.cutters), ("transition", methods.transitions)):
        if table:
            chosen[kind] = next(iter(table.values()))
    ss.splice([make_clip(), make_clip(1)], ss.SpliceOptions(**chosen, avoid_collisions=False))


def _use_signs(signs: Any) -> None:
    """Makes the motion of the first sign that is read: each takes some 20 ms."""
    for sign in itertools.islice(signs.values(), 1):
        _check_signing(planner.synthesize_word(sign).clip)


def _use_report(report: Any) -> None:
    """Does what `view` and `render` do with a report."""
    from signsplice.render.sheet import Mark, caption, sheet_frames

    shown = scene.from_clip(make_clip(), report, ())
    json.dumps(reports.plain({"scenes": [shown], "live": False}), allow_nan=False).encode()
    marks = [Mark(span["kind"], span["name"] or "", *span["output"]) for span in report["spans"]]
    for frame in sheet_frames(N_REPORTED, marks):
        caption(marks, frame)[0].encode()


def _load_recipes(path: Path) -> tuple[Path, list[Any]]:
    return path, list(recipes.read(path))


def _use_recipes(loaded: tuple[Path, list[Any]]) -> None:
    """Does what `bulk sentences` does: stores the recipes, reads them again, and makes the first sentences."""
    path, batches = loaded
    stored = path.with_name("stored.parquet")
    n_rows = recipes.write(stored, batches)
    assert recipes.is_same(stored, recipes.read(path)), "recipes are others when they are read again"
    rows = recipes.rows(stored, 0, min(n_rows, 3)) if n_rows else []
    for row in rows:
        _ = row.sha256
    for made_sentence in _open_maker().make(list(filter(_is_short, rows))):
        if isinstance(made_sentence, FailedSentence):
            check_message(made_sentence.reason, "")
            assert not made_sentence.reason.startswith("unexpected"), made_sentence.reason


def _is_short(row: recipes.SentenceRecipe) -> bool:
    """Returns whether a sentence is made quickly: a letter takes as long as a word."""
    return len("-".join(row.glosses)) < 40


def _open_maker() -> SentenceMaker:
    """Returns a maker of sentences of the words that ship, opened once."""
    return CACHE.recent(SentenceMaker, lexicon.open_shipped_lexicon(), most=1)


def _use_lines(drawn: tuple[list[Any], list[str]]) -> None:
    """Reads recipes and warnings of lines of glosses."""
    for batch in drawn[0]:
        recipes.recipes_of(batch)
    for line in drawn[1]:
        check_message(line, "")


def _use_shards(bulk_job: job.BulkJob, folder: Path) -> None:
    """Does what `bulk make` does."""
    job.is_whole(folder, bulk_job, 0)
    if bulk_job.n_recipes and _is_short(recipes.rows(folder / job.RECIPES, 0, 1)[0]):
        shards.remake(str(folder), 0, str(folder / "made.npz"), None)


def _use_avatar(avatar: Avatar) -> None:
    """Does what `convert --avatar` does: fits a clip to the avatar's body and writes it."""
    for line in avatar.warnings:
        check_message(line, "")
    fitted = retarget(make_clip(), avatar)
    for suffix in (".bvh", ".vrma") if len(avatar) < 100 else ():
        formats.encode(fitted.clip, f"case{suffix}")


def _use_pairs(pairs: Pairs) -> None:
    """Reads the first pairs of each split, as clips."""
    for name in pairs.head["splits"]:
        for number in pairs.split(name, "test")[:2]:
            pairs.clip(number)
            pairs.transition_clip(number)
            for kind in KINDS:
                pairs.utterance(number, kind)
    for word in range(min(len(pairs.head["words"]), 2)):
        pairs.word_clip(word)
        pairs.space(word)


def _use_written(written_signs: written.WrittenSigns) -> None:
    """Does what a lexicon does with signs that were read: compiles some, and animates one."""
    for error in itertools.islice(written_signs.refused, 20):
        check_message(str(error), "case")
    for gloss, sign in written_signs.signs.items():
        assert gloss == sign.gloss
        assert all(len(note.splitlines()) == 1 for note in sign.notes), sign.notes
    compiled = None
    for sign in itertools.islice(written_signs.signs.values(), 12):
        try:
            compile_sign(sign)
            compiled = sign
        except InputError as error:
            check_message(str(error), sign.gloss)
    if compiled is None:
        return
    clip = signing.animate_sign(compiled)
    _check_signing(clip)
    is_deep = collision.hand_depths(clip).max() > _DEEP_CM
    assert not is_deep or any("deep in the body" in note for note in clip.notes), "a hand lies deep and no note says so"


def _check_signing(clip: Clip) -> None:
    """Raises ``AssertionError`` for a clip that no person could sign and that no note tells of."""
    quats = clip.local_rotations
    assert np.isfinite(quats).all()
    assert np.isfinite(clip.root_positions).all()
    assert 2 <= len(clip) <= _MAX_SECONDS * clip.fps, f"{len(clip)} frames"
    if next(signing.jumps(clip), "") != "":
        return
    step_deg = np.rad2deg(rotation.angle_between(quats[1:], quats[:-1])).max()
    assert step_deg < _MAX_STEP_DEG, f"a joint turns by {step_deg:.0f} degrees in a frame"
    twist, bend = 0.5 * FOREARM_LIMIT, float(np.linalg.norm(np.abs(WRIST_LIMITS).max(axis=1)))
    for name, limit in itertools.product(("Left", "Right"), (("ForeArm", ELBOW_LIMIT + twist), ("Hand", bend + twist))):
        angle = rotation.angle_between(quats[:, JOINTS[name + limit[0]]], rotation.IDENTITY).max()
        assert angle < limit[1] + _SLACK, f"{name}{limit[0]} turns by {np.rad2deg(angle):.0f} degrees"


@cache
def _collect_truth() -> dict[str, list[Clip]]:
    """Returns gloss or synonym -> its clips in the lexicons that fuzzing starts from, each stored in its form."""
    truth: dict[str, list[Clip]] = {}
    for content in seeds.make_lexicon_seeds():
        with tempfile.TemporaryDirectory() as name, lexicon.open(_put_folder(content, Path(name))) as words:
            for gloss in (*words, "HI"):
                truth.setdefault(gloss, []).append(words.clip(gloss))
    return truth


TARGETS = {
    target.name: target
    for target in (
        Target("bvh", lambda: seeds.make_clip_seeds(".bvh"), _put_as("case.bvh"), formats.load, use_clip,
               oracle=oracles.judge_bvh),
        Target("npz", lambda: seeds.make_clip_seeds(".npz"), _put_as("case.npz"), formats.load, use_clip,
               _measure_unpacked_npz, oracles.judge_npz),
        Target("smplx", seeds.make_smplx_seeds, _put_as("case.npz"), formats.load, use_clip, _measure_unpacked_npz),
        Target("pickle", seeds.make_pickle_seeds, _put_as("case.pkl"), formats.load, use_clip),
        Target("array", seeds.make_array_seeds, _put_as("case.npy"), formats.load, use_clip),
        Target("pose", seeds.make_pose_seeds, _put_as("case.pose"), formats.load, use_clip),
        Target("landmarks", seeds.make_landmarks_seeds, _put_folder, lexicon.open, _use_lexicon, _measure_unpacked_npz),
        Target("gltf", seeds.make_gltf_seeds, _put_as(_name_gltf), formats.load, use_clip, oracle=oracles.judge_gltf),
        Target("fbx", seeds.make_fbx_seeds, _put_as("case.fbx"), formats.load, use_clip),
        Target("fbxavatar", lambda: seeds.make_fbx_seeds()[1:2], _put_as("case.fbx"), read_avatar, _use_avatar),
        Target("avatar", seeds.make_avatar_seeds, _put_as("case.vrm"), read_avatar, _use_avatar,
               oracle=oracles.judge_avatar),
        Target("lexicon", seeds.make_lexicon_seeds, _put_folder, lexicon.open, _use_lexicon, _measure_unpacked_npz,
               lambda _, read: oracles.judge_lexicon(_collect_truth(), read)),
        Target("bundle", seeds.make_bundle_seeds, _put_folder, open_learned, _use_bundle,
               lambda _: 1 << 30),  # a bundle is a program: nothing limits the memory that its networks take
        Target("recipes", seeds.make_recipes_seeds,
               _put_as(lambda content: "case.parquet" if content[:4] == b"PAR1" else "case.csv"),
               _load_recipes, _use_recipes),
        Target("lines", lambda: read_seeds("lines.txt"), _put_as("case.txt"),
               lambda path: drawing.lines(path, lexicon.open_shipped_lexicon()), _use_lines),
        Target("shards", seeds.make_shards_seeds, _put_folder, lambda path: (job.read_job(path), path),
               lambda read: _use_shards(*read), _measure_unpacked_npz),
        Target("pairs", seeds.make_pairs_seeds, _put_folder, Pairs, _use_pairs, _measure_unpacked_npz),
        Target("signs", lambda: read_seeds("signs.signs"), _put_as("case.signs"), notation.read, _use_signs),
        Target("written", seeds.make_written_seeds,
               _put_as(lambda content: "case.sigml" if content.lstrip()[:1] == b"<" else "case.csv"),
               written.read, _use_written),
        Target("roles", lambda: read_seeds("roles.json"), _put_as("case.json"), roles_files.read,
               lambda read: use_clip(roles_files.with_roles(make_clip(4, "other"), read))),
        Target("report", seeds.make_report_seeds, _put_as("case.json"), lambda path: reports.read(path, N_REPORTED),
               _use_report),
        Target("face", lambda: [live_link.encode(seeds.with_face(make_clip()))], _put_as("case.csv"),
               lambda path: live_link.with_face(make_clip(), path), use_clip),
        Target("glosses", lambda: read_seeds("glosses.csv"), _put_as("glosses.csv"), recordings.read_table,
               lambda _: None),
    )
}  # fmt: skip
"""Name -> target."""
