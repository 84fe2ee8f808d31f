"""Makes one shard: recipes k*n .. (k+1)*n-1 in order, with their samples in a tar file and their rows of the index."""

from __future__ import annotations

import json
import tarfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from signsplice.bulk import job as jobs
from signsplice.bulk import recipes
from signsplice.bulk.job import BulkJob
from signsplice.bulk.maker import WORDS_KEPT, FailedSentence, MadeSentence, SentenceMaker
from signsplice.errors import FormatError, InputError, SignspliceError
from signsplice.formats import FORMATS, encode, live_link, npz, save
from signsplice.formats.atomic import replacing
from signsplice.lexicon.lexicon import open_lexicon
from signsplice.motion import Clip
from signsplice.motion.cache import CACHE
from signsplice.motion.kinematics import forward, tip_positions
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES, finger_roles
from signsplice.splicing import report as reports
from signsplice.splicing.options import open_learned
from signsplice.splicing.result import Span

Float32 = NDArray[np.float32]

UPPER_POSE = ("head", "neck", *(side + part for side in SIDES for part in ("UpperArm", "LowerArm", "Hand")))
"""Joints of ``upper_pose``, in order: in each arm shoulder, elbow and wrist."""


def poses(clip: Clip) -> dict[str, Float32]:
    """Return joint positions in metres, ``upper_pose`` (T, 8, 3), ``left_hand`` and ``right_hand`` (T, 21, 3): the
    wrist, then three joints and the tip of each finger from thumb to little finger, in MediaPipe's order. Axes are
    those of the clip.

    A joint that the rig lacks has the position of its nearest existing parent. Empty if the rig's arms are not known by
    name.
    """
    info = rig_info(clip.skeleton)
    if not info.has_arms:
        return {}
    rotations, positions = forward(clip)
    tips = tip_positions(clip, rotations, positions)
    tip_of = {site.joint: tips[:, k] for k, site in enumerate(clip.skeleton.end_sites)}
    joints, metres = info.roles.joints, info.sizes.unit.metres

    def place(*roles: str) -> NDArray[np.float64]:
        return positions[:, next((joints[role] for role in roles if role in joints), 0)]

    pose_points = {"upper_pose": [place(role, "head", "neck") for role in UPPER_POSE]}
    for side in SIDES:
        points = [place(f"{side}Hand")]
        for finger in FINGERS:
            line = [f"{side}Hand"]
            for role in finger_roles(finger):
                line.insert(0, side + role)
                points.append(place(*line))
            last = next(joints[role] for role in line if role in joints)
            points.append(tip_of.get(last, points[-1]))
        pose_points[f"{side}_hand"] = points
    return {name: (metres * np.stack(points, 1)).astype(np.float32) for name, points in pose_points.items()}


def signs(spans: Sequence[Span], fps: float) -> list[dict[str, Any]]:
    """Return the signs of a sentence: first and last frame, inclusive, their times in ms, and ``lemma``, the gloss."""
    sign_spans = [(span.name, span.output) for span in spans if span.kind == "sign" and span.output[1] > span.output[0]]
    return [
        {
            "start_frame": start,
            "end_frame": stop - 1,
            "start_ms": round(1e3 * start / fps),
            "end_ms": round(1e3 * (stop - 1) / fps),
            "lemma": name,
        }
        for name, (start, stop) in sign_spans
    ]


TOGETHER = 64
"""Number of sentences that the engine makes at a time, i.e. that are in memory."""
INDEX_SCHEMA = pa.schema(
    [
        ("row", pa.int64()),
        ("key", pa.string()),
        ("shard", pa.int32()),
        ("offset", pa.int64()),
        ("n_bytes", pa.int64()),
        ("glosses", pa.list_(pa.string())),
        ("signer", pa.string()),
        ("frames", pa.int32()),
        ("fps", pa.float64()),
        ("seams", pa.int32()),
        ("warnings", pa.int32()),
        ("recipe_sha256", pa.string()),
        ("motion_sha256", pa.string()),
        ("error", pa.string()),
    ]
)
"""A row of the index. offset, n_bytes: location of the clip's bytes in the tar file. error: reason of a failure, null
for a sentence; unknown values of a failed row are null.
"""

_MOTIONS = pa.schema([INDEX_SCHEMA.field(name) for name in ("row", "motion_sha256")])


@dataclass(frozen=True)
class ShardResult:
    """The result of making a shard.

    shard: its number.
    n_rows, n_failed: numbers of recipes, and of failed ones.
    n_seams, n_frames: of all its sentences.
    n_bytes: of its files.
    cpu_s: processor time used, seconds.
    """

    shard: int
    n_rows: int
    n_failed: int
    n_seams: int
    n_frames: int
    n_bytes: int
    cpu_s: float


def make_shard(out: str, shard: int, n_words_kept: int) -> ShardResult:
    """Make a complete shard of the folder ``out``. The process keeps words and networks for the next one.

    n_words_kept: number of words to keep. Raises ``InputError`` if this process finds another lexicon, bundle or
    version than the job's.
    """
    began = time.process_time()
    folder = Path(out)
    job = jobs.read_job(folder)
    maker = CACHE.recent(open_maker, folder, n_words_kept, job.sha256, most=1)
    rows: list[dict[str, Any]] = []
    progress = jobs.progress_path(folder, shard)
    with _samples(folder, job, shard) as samples:
        todo = recipes.rows(folder / jobs.RECIPES, job.rows(shard).start, job.rows(shard).stop)
        for start in range(0, len(todo), TOGETHER):
            for n, sentence in enumerate(maker.make(todo[start : start + TOGETHER]), job.rows(shard).start + start):
                rows.append({"row": n, "key": f"{n:09d}", "shard": shard, **_row(sentence, samples, f"{n:09d}")})
            progress.write_text(str(len(rows)))
    tar_bytes = jobs.tar_path(folder, shard).stat().st_size if samples is not None else 0
    metadata = {"job": job.sha256, "tar_bytes": str(tar_bytes)}
    with replacing(jobs.index_path(folder, shard)) as temporary:
        pq.write_table(pa.Table.from_pylist(rows, INDEX_SCHEMA.with_metadata(metadata)), temporary, compression="zstd")
    progress.unlink(missing_ok=True)
    return ShardResult(
        shard,
        len(rows),
        sum(row["error"] is not None for row in rows),
        sum(row["seams"] or 0 for row in rows),
        sum(row["frames"] or 0 for row in rows),
        tar_bytes + jobs.index_path(folder, shard).stat().st_size,
        time.process_time() - began,
    )


def open_maker(out: Path, n_words_kept: int, _: str = "") -> SentenceMaker:
    """Return the maker of the sentences of a folder of shards; the unused job hash distinguishes cached makers. Raises
    ``InputError`` as ``make_shard`` does.
    """
    job = jobs.read_job(out)
    words = open_lexicon(*jobs.lexicon_paths(job.lexicon))
    checks: dict[str, tuple[object, object, object]] = {
        "package": (version("signsplice"), job.signsplice, "signsplice"),
        "libraries": (jobs.libraries(), job.made_with, ", ".join(map(" ".join, job.made_with.items()))),
        "lexicon": (jobs.hash_of_words(words), job.lexicon_sha256, " and ".join(jobs.lexicon_paths(job.lexicon))),
        "bundle": (open_learned(job.bundle).sha256, job.bundle_sha256, job.bundle or "the one that ships"),
    }
    for what, (actual, expected, where) in checks.items():
        if actual != expected:
            raise InputError(
                f"{out}: its {what}, {where}, is another in this process than when it was begun; "
                "put that one back there"
            )
    return SentenceMaker(words, job.bundle, n_words_kept)


def remake(out: str, row: int, output: str, report: str | None) -> str:
    """Make one row of a folder of shards again and write its clip and its report. Returns the line to print.

    Raises ``InputError`` if the row does not exist, fails again or has a broken index, and ``SignspliceError`` if its
    motion differs from that in the index.
    """
    folder = Path(out)
    job = jobs.read_job(folder)
    if not 0 <= row < job.n_recipes:
        raise InputError(f"{out}: row {row}, expected 0 to {job.n_recipes - 1}")
    (sentence,) = open_maker(folder, WORDS_KEPT).make(recipes.rows(folder / jobs.RECIPES, row, row + 1))
    if isinstance(sentence, FailedSentence):
        raise InputError(f"{out}: row {row}: {sentence.reason}")
    index = jobs.index_path(folder, row // job.shard_size)
    stored_sha256 = _motion_of(index, row, row % job.shard_size) if index.exists() else None
    if stored_sha256 not in (None, sentence.motion_sha256):
        where = f"this machine has {jobs.processor()}" if jobs.processor() != job.processor else "the same processor"
        raise SignspliceError(
            f"{out}: row {row}: the motion is not that of the index, bit for bit; it was made on {job.processor} with "
            f"{', '.join(' '.join(library) for library in job.made_with.items())}; {where}"
        )
    save(sentence.result.clip, output)
    if report is not None:
        reports.write(sentence.report(), report)
    clip = sentence.result.clip
    comparison = "bit for bit that of the index" if stored_sha256 else "not in the index yet"
    return f"{output}: {len(clip)} frames, {clip.seconds:.2f} s, {comparison}"


def _motion_of(index: Path, row: int, place: int) -> str | None:
    """Return the motion hash of a row, at position ``place`` in a shard's file of the index.

    Raises ``FormatError`` if the file is broken or belongs to another shard.
    """
    try:
        with pq.ParquetFile(index) as file:
            table = file.read(columns=["row", "motion_sha256"]).cast(_MOTIONS)
        if table["row"][place].as_py() != row:
            raise ValueError(f"row {table['row'][place]}, expected {row}")
        sha256: str | None = table["motion_sha256"][place].as_py()
    except (pa.ArrowException, OSError, LookupError, ValueError) as error:
        what = f"cannot be read as the index of row {row} ({str(error)[:200]})"
        raise FormatError(
            f"{what}; remove it, and the call that began the folder makes it anew", file=str(index)
        ) from error
    return sha256


def _row(made: MadeSentence | FailedSentence, samples: _Samples | None, key: str) -> dict[str, Any]:
    """Add the sample of a sentence to the shard, and return its row of the index."""
    recipe = made.recipe
    row: dict[str, Any] = dict.fromkeys(INDEX_SCHEMA.names[3:])
    row |= {"glosses": list(recipe.glosses), "signer": recipe.signer, "recipe_sha256": recipe.sha256}
    if isinstance(made, FailedSentence):
        return row | {"error": made.reason}
    try:
        place = {} if samples is None else samples.add(key, made)
    except InputError as error:  # the format cannot hold the clip
        return row | {"error": str(error)}
    clip, seams = made.result.clip, made.result.seams
    n_warnings = len(made.result.warnings) + sum(len(seam.warnings) for seam in seams)
    n_warnings += sum(bool(token.warning) for token in made.tokens)
    row |= {"signer": made.signer, "frames": len(clip), "fps": clip.fps, "seams": len(seams), "warnings": n_warnings}
    return row | place | {"motion_sha256": made.motion_sha256}


@contextmanager
def _samples(out: Path, job: BulkJob, shard: int) -> Iterator[_Samples | None]:
    """Yield the writer of a shard's samples, whose file is put in place if the block succeeds; None without samples."""
    if job.store != jobs.STORE_SAMPLES:
        yield None
        return
    with replacing(jobs.tar_path(out, shard)) as file, tarfile.open(file, "w", format=tarfile.USTAR_FORMAT) as tar:
        yield _Samples(tar, job)


class _Samples:
    """Samples of WebDataset in a tar file: members named KEY.SUFFIX, without time or owner."""

    def __init__(self, tar: tarfile.TarFile, job: BulkJob) -> None:
        self._tar, self._job = tar, job

    def add(self, key: str, made: MadeSentence) -> dict[str, int]:
        """Add a sentence; return the offset and the number of its clip's bytes."""
        clip = made.result.clip
        form = self._job.format
        content = npz.encode(clip, rounded=True) if form == jobs.NPZ32 else encode(clip, f"{key}.{form}")
        suffix = ".npz" if form == jobs.NPZ32 else f".{form}"
        self._add_member(f"{key}{suffix}", content)
        place = {"offset": self._tar.offset - -(-len(content) // 512) * 512, "n_bytes": len(content)}
        if clip.face is not None and not FORMATS[suffix].holds_faces:
            self._add_member(f"{key}.face.csv", live_link.encode(clip))
        self._add_member(f"{key}.json", json.dumps(made.report(), ensure_ascii=False).encode())
        if self._job.poses:
            for name, positions in poses(clip).items():
                stored = BytesIO()
                np.save(stored, positions)
                self._add_member(f"{key}.pose.{name}.npy", stored.getvalue())
            rows = signs(made.result.spans, clip.fps)
            self._add_member(f"{key}.annotations.both_hands.json", json.dumps(rows, ensure_ascii=False).encode())
            self._add_member(f"{key}.signer.txt", made.signer.encode())
        return place

    def _add_member(self, name: str, content: bytes) -> None:
        member = tarfile.TarInfo(name)
        member.size = len(content)
        self._tar.addfile(member, BytesIO(content))
