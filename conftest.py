"""Fixtures that the tests of all three distributions share: generated motions, real clips where they are present, and
running services.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import httpx
import numpy as np
import pytest
from hypothesis import settings

from serving import http_client, wait_until_warm
from signing import sign
from signsplice.formats import load
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, EndSite, Skeleton, rotation
from signsplice_workshop.corpora.pairs import Pairs, Recipe, write_pairs

if TYPE_CHECKING:
    from signsplice_workshop.corpora.pairs import Pairs


ROOT = Path(__file__).resolve().parent
REAL = ROOT.parent / "shared" / "data" / "bvh"
GOLDEN = ROOT / "tests" / "golden"

settings.register_profile("signsplice", derandomize=True, deadline=None, max_examples=40)
settings.load_profile("signsplice")


@pytest.fixture(scope="session")
def real_clips() -> dict[str, Clip]:
    """Real clips by name; the test is skipped where they are absent."""
    if not REAL.is_dir():
        pytest.skip("real clips not present")
    return {path.stem: load(path) for path in sorted(REAL.glob("*.bvh"))}


@pytest.fixture(scope="session")
def words() -> dict[str, Clip]:
    """Five of the words that ship."""
    with open_shipped_lexicon() as lexicon:
        return {gloss: lexicon.clip(gloss) for gloss in ("HELLO", "I", "DEAF", "SIGN", "THANK-YOU")}


@pytest.fixture(scope="session")
def sentence(words: dict[str, Clip]) -> list[Clip]:
    """The words of the demo's sentence, in order."""
    return [words[gloss] for gloss in ("HELLO", "I", "DEAF", "I", "SIGN", "THANK-YOU")]


@pytest.fixture(scope="session")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Pairs:
    """A small corpus: all 25 ordered pairs of five signs by the first signer, and 3 by another."""
    from signsplice_workshop.corpora.pairs import Pairs

    recipe = Recipe(tuple(sign(gloss) for gloss in ("I", "MOTHER", "BOOK", "YES", "fs-A")), n_other=3)
    return Pairs(write_pairs(recipe, tmp_path_factory.mktemp("corpus") / "pairs", processes=1))


def rooted(clip: Clip) -> Clip:
    """A clip whose hips and legs do not move; the signer of the shipped words sways a little."""
    local = np.array(clip.local_rotations)
    legs = [n for n, name in enumerate(clip.skeleton.names) if any(part in name for part in ("Leg", "Foot", "Toe"))]
    local[:, [0, *legs]] = rotation.IDENTITY
    return replace(clip, local_rotations=local, root_positions=np.tile(clip.skeleton.offsets[0], (len(clip), 1)))


def random_skeleton(rng: np.random.Generator, n_joints: int = 12) -> Skeleton:
    """A random tree of joints in depth-first order, every leaf with an end site."""
    parents = [-1]
    path = [0]
    for joint in range(1, n_joints):
        path = path[: int(rng.integers(1, len(path) + 1))]
        parents.append(path[-1])
        path.append(joint)
    leaves = [j for j in range(n_joints) if j not in parents]
    return Skeleton(
        names=tuple(f"joint{j}" for j in range(n_joints)),
        parents=np.array(parents),
        offsets=rng.normal(size=(n_joints, 3)),
        end_sites=tuple(EndSite(j, rng.normal(size=3)) for j in leaves),
    )


def random_clip(seed: int, n_frames: int = 20, n_joints: int = 12, fps: float = 30.0) -> Clip:
    """A smooth random motion of a random skeleton."""
    rng = np.random.default_rng(seed)
    skeleton = random_skeleton(rng, n_joints)
    times = np.arange(n_frames)[:, None, None] / fps
    waves = rng.normal(size=(n_joints, 3)) * np.sin(
        2.0 * np.pi * (rng.uniform(0.2, 1.5, (n_joints, 3)) * times + rng.random(3))
    )
    roots = rng.normal(size=3) + 0.1 * np.cumsum(rng.normal(size=(n_frames, 3)), axis=0)
    return Clip(skeleton, rotation.exp(waves), roots, fps, f"random{seed}")


TIGHT = {
    "max_body_bytes": 300_000,
    "max_files": 3,
    "max_glosses": 6,
    "max_frames": 600,
    "max_streams": 2,
    "max_stream_words": 2,
    "work_seconds": 3.0,
}


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """A client of a service with its default limits and one worker."""
    with http_client("serve", "--workers=1", cwd=tmp_path_factory.mktemp("service")) as client:
        wait_until_warm(client)
        yield client


@pytest.fixture(scope="session")
def tight_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the tight service runs and has its temporary files; no file may be left there."""
    return tmp_path_factory.mktemp("tight")


@pytest.fixture(scope="session")
def tight(tight_folder: Path) -> Iterator[httpx.Client]:
    """A client of a service that allows little, with one worker. Its time limits are the default ones, or count
    processor time: honest requests keep to them on a loaded machine too. It finds no EGL: numpy draws, so that a
    picture can be endless.
    """
    limits = [f"--limit={name}={value}" for name, value in TIGHT.items()]
    no_egl = {"__EGL_VENDOR_LIBRARY_DIRS": str(tight_folder)}
    with http_client("serve", "--workers=1", *limits, cwd=tight_folder, **no_egl) as client:
        wait_until_warm(client)
        yield client
