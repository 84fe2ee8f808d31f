"""The job of a folder of shards, stored in the folder, so that only the same job can resume a run."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, get_type_hints

import pyarrow as pa
import pyarrow.parquet as pq

from signsplice.bulk import recipes
from signsplice.errors import FormatError, InputError
from signsplice.formats import atomic
from signsplice.formats.json_files import check_type, read_json
from signsplice.lexicon.lexicon import Lexicon, lexicon_folder, open_lexicon
from signsplice.splicing.options import open_learned

JOB = "job.json"
"""File of the job in a folder of shards."""
RECIPES = "recipes.parquet"
"""File of the recipes in a folder of shards."""
SUMMARY = "summary.json"
"""File of the summary in a folder of shards."""
INDEX = "index"
"""Folder of the index in a folder of shards."""
UNFINISHED = "unfinished"
"""Empty folder that exists during a run, and after one that was interrupted."""
_NEW_RECIPES = ".new-recipes.parquet"
"""File of the recipes until the job is written; no other program uses this name."""
STORE_SAMPLES = "frames"
STORES = (STORE_SAMPLES, "recipes")
"""What a folder holds: "frames": samples in tar files; "recipes": nothing beside recipes and index."""
NPZ32 = "npz32"
FORMATS = ("npz", NPZ32, "bvh", "glb")
"""Formats of clips; ``NPZ32``: npz with frames rounded to 32 bits."""
VERSION = 1
_LIBRARIES = ("numpy", "scipy", "onnxruntime")
_LONGEST = 1000
"""Limit on the length of a name or path of a job, characters."""
_FREE = ("lexicon", "bundle", "processor")
"""Fields that may differ when a run resumes: locations of words and networks, not their content; and the processor."""


@dataclass(frozen=True)
class BulkJob:
    """Determines every clip and sample of a folder of shards.

    version: of this description.
    signsplice: version of the package.
    n_recipes, recipes_sha256: number of recipes, and hash of their file.
    lexicon, lexicon_sha256: path of the words, a list for several lexicons, and hash of their content.
    bundle, bundle_sha256: path of the networks, None for the shipped ones; and their hash, None without networks.
    store: one of ``STORES``.
    format: of clips, one of ``FORMATS``.
    poses: whether each sample has joint positions and annotations beside its clip.
    shard_size: recipes per shard.
    made_with: versions of the numerical libraries.
    processor: of the machine that began the job.
    """

    version: int
    signsplice: str
    n_recipes: int
    recipes_sha256: str
    lexicon: str | list[str]
    lexicon_sha256: str
    bundle: str | None
    bundle_sha256: str | None
    store: str
    format: str
    poses: bool
    shard_size: int
    made_with: dict[str, str]
    processor: str

    @property
    def n_shards(self) -> int:
        """Number of shards of the complete folder."""
        return -(-self.n_recipes // self.shard_size)

    def rows(self, shard: int) -> range:
        """Return the rows of a shard."""
        return range(shard * self.shard_size, min((shard + 1) * self.shard_size, self.n_recipes))

    @property
    def sha256(self) -> str:
        """Hash of the fields that must not differ when a run resumes."""
        decided = {name: value for name, value in asdict(self).items() if name not in _FREE}
        return hashlib.sha256(json.dumps(decided, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True)
class BulkOptions:
    """Options of a call; fields as in ``BulkJob``. Raises ``InputError`` for values out of range."""

    lexicon: str | Sequence[str]
    bundle: str | None = None
    store: str = STORE_SAMPLES
    format: str = "npz"
    poses: bool = True
    shard_size: int = 1000

    def __post_init__(self) -> None:
        for what, value, known in (("store", self.store, STORES), ("format", self.format, FORMATS)):
            if value not in known:
                raise InputError(f"{what} {value[:40]!r}, expected {', '.join(known)}")
        if not 1 <= self.shard_size <= 1_000_000:
            raise InputError(f"shard_size {self.shard_size}, expected 1 to 1,000,000 sentences")


def prepare(out: Path, options: BulkOptions, make_batches: Callable[[], Iterable[pa.RecordBatch]]) -> BulkJob:
    """Begin the job of a new or empty folder, or resume that of an existing one if it is the same; write and return it.

    make_batches: makes the recipes, anew at each call. Raises ``InputError``, which names the difference, if the folder
    was begun with other recipes, words, networks or options; if its recipes have changed; and as ``check_folder`` does.
    """
    check_folder(out)
    with open_lexicon(*lexicon_paths(options.lexicon)) as words:
        lexicon_sha256 = hash_of_words(words)
    decided: dict[str, Any] = {
        "version": VERSION,
        "signsplice": version("signsplice"),
        "lexicon_sha256": lexicon_sha256,
        "bundle_sha256": open_learned(options.bundle).sha256,
        **{name: getattr(options, name) for name in ("store", "format", "poses", "shard_size")},
        "made_with": libraries(),
    }
    folders = [str(lexicon_folder(path).resolve()) for path in lexicon_paths(options.lexicon)]
    places: dict[str, Any] = {
        "lexicon": folders if folders[1:] else folders[0],
        "bundle": None if options.bundle is None else str(Path(options.bundle).resolve()),
    }
    new_recipes = out / _NEW_RECIPES
    if (out / JOB).exists():
        job = read_job(out)
        if new_recipes.exists():  # the call ended before the file was renamed
            new_recipes.replace(out / RECIPES)
        for name, value in decided.items():
            if getattr(job, name) != value:
                raise InputError(
                    f"{out}: was begun with {name} {_short(getattr(job, name))}, this call has {_short(value)}; "
                    "call it as it was begun, or name a new folder"
                )
        if not recipes.is_same(out / RECIPES, make_batches()):
            raise InputError(f"{out}: was begun with other recipes; give the same, or name a new folder")
        if _hash_of(out / RECIPES) != job.recipes_sha256:
            raise InputError(
                f"{out / RECIPES}: is not the file that {JOB} names; put that one back, or name a new folder"
            )
        return _write_job(replace(job, **places), out)
    out.mkdir(exist_ok=True)
    n_recipes = recipes.write(new_recipes, make_batches())
    if not n_recipes:
        new_recipes.unlink()
        raise InputError("no recipes, expected one row or more")
    digest = _hash_of(new_recipes)
    job = BulkJob(**decided, **places, n_recipes=n_recipes, recipes_sha256=digest, processor=processor())
    _write_job(job, out)
    new_recipes.replace(out / RECIPES)
    return job


def lexicon_paths(lexicon: str | Sequence[str]) -> Sequence[str]:
    """Return the folders of one lexicon, or of several."""
    return [lexicon] if isinstance(lexicon, str) else lexicon


def _write_job(job: BulkJob, out: Path) -> BulkJob:
    atomic.write(out / JOB, json.dumps(asdict(job), indent=2, ensure_ascii=False) + "\n")
    return job


def _hash_of(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def check_folder(out: Path) -> None:
    """Raise ``InputError`` if a folder cannot be made; if it has no job, but anything visible other than
    ``UNFINISHED``; or if ``UNFINISHED`` is there and not an empty folder.
    """
    atomic.check_place(out)
    mark = out / UNFINISHED
    if mark.exists() and (not mark.is_dir() or mark.is_symlink() or any(mark.iterdir())):
        raise InputError(f"{mark}: is no empty folder, expected none of that name; move it, or name a new folder")
    if (out / JOB).exists():
        return
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: is a file, expected a folder or a new name")
    names = sorted(path.name for path in out.glob("*") if not path.name.startswith(".") and path.name != UNFINISHED)
    if names:
        raise InputError(f"{out}: holds {names[0]} and no {JOB}; name a new folder, or an empty one")


def _short(value: object) -> str:
    return value[:12] if isinstance(value, str) and len(value) == 64 else str(value)


def read_job(out: Path) -> BulkJob:
    """Read the job of a folder of shards. Raises ``InputError`` if there is none."""
    if not (out / JOB).is_file():
        raise InputError(
            f"{out}: holds no {JOB}, expected a folder that `signsplice bulk sentences` or `bulk pairs` made"
        )
    stored = read_json(out / JOB, "the job of a folder of shards")
    try:
        for name, kind in get_type_hints(BulkJob).items():
            check_type(stored[name], kind, name)
        if stored["version"] != VERSION:
            raise ValueError(f"version {stored['version']}, expected {VERSION}")
        texts = [str(value) for row in (stored, stored["made_with"]) for value in (*row, *row.values())]
        if not all(text.isprintable() and len(text) < _LONGEST for text in texts):
            raise ValueError("a name or path is no line of text")
        BulkOptions(**{row.name: stored[row.name] for row in fields(BulkOptions)})  # raises for values out of range
        return BulkJob(**{row.name: stored[row.name] for row in fields(BulkJob)})
    except (KeyError, TypeError, ValueError, InputError) as error:
        raise FormatError(f"is no job of a folder of shards ({str(error)[:200]})", file=str(out / JOB)) from error


def hash_of_words(words: Lexicon) -> str:
    """Return the hash of everything that a splice reads of a lexicon: glosses, synonyms, signers, rates, motions and
    owned channels.
    """
    digest = hashlib.sha256()
    for entry in (entry for source in words.sources for entry in source.entries()):
        owns = words.owns(entry.gloss)
        row = [entry.gloss, entry.kind, entry.synonyms, entry.signer, entry.sha256]
        digest.update(json.dumps(row if owns is None else [*row, sorted(owns)]).encode())
    return digest.hexdigest()


def libraries() -> dict[str, str]:
    """Return the versions of the numerical libraries."""
    return {name: version(name) for name in _LIBRARIES}


def processor() -> str:
    """Return the name of the processor, or its architecture if the name is unknown."""
    try:
        names = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    except OSError:
        names = []
    return names[0].partition(":")[2].strip() if names else platform.processor() or platform.machine()


def tar_path(out: Path, shard: int) -> Path:
    """Return the file of a shard's samples."""
    return out / f"shard-{shard:06d}.tar"


def progress_path(out: Path, shard: int) -> Path:
    """Return the file with the number of finished rows of a shard that is not in the index yet. Its name lets
    ``atomic.sweep`` remove it.
    """
    return out / INDEX / f".signsplice-{shard:016x}.rows"


def rows_in_progress(out: Path, shards: Iterable[int]) -> int:
    """Return the number of finished rows of incomplete shards."""
    n_rows = 0
    for shard in shards:
        with suppress(OSError, ValueError):  # not there yet, already removed, or being written
            n_rows += int(progress_path(out, shard).read_text())
    return n_rows


def index_path(out: Path, shard: int) -> Path:
    """Return the file of a shard's rows of the index. It is written last: a shard that has it is complete."""
    return out / INDEX / f"{shard:06d}.parquet"


def is_whole(out: Path, job: BulkJob, shard: int) -> bool:
    """Return whether a shard of this job exists, and its samples have their original size."""
    try:
        metadata = pq.read_metadata(index_path(out, shard)).metadata or {}
        size = tar_path(out, shard).stat().st_size if job.store == STORE_SAMPLES else 0
    except (OSError, ValueError, pa.ArrowException):
        return False
    return metadata.get(b"job") == job.sha256.encode() and metadata.get(b"tar_bytes") == str(size).encode()
