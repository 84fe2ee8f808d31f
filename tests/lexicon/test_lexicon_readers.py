"""Readers beside a builder: whole lexicons, the old or the new one, whatever the moment at which it is killed."""

from __future__ import annotations

import os
import random
import signal
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from conftest import random_clip

from signsplice import lexicon
from signsplice.lexicon import Lexicon, store

N_WORDS = 12
CLIPS = [random_clip(seed, n_frames=8, n_joints=4) for seed in range(N_WORDS)]


def write(path: Path, version: int) -> None:
    """Write a lexicon each of whose words stands at ``version``; the number of words and their order change with it."""
    with lexicon.building(path) as builder:
        for k in range(N_WORDS - version % 3):
            clip = CLIPS[(k + version) % N_WORDS]
            builder.add(replace(clip, root_positions=np.full((len(clip), 3), float(version))), f"WORD-{k}")


def version_of(lex: Lexicon) -> int:
    """The version of every word of a lexicon. Raises ``AssertionError`` where words are of two, or one is damaged."""
    assert list(lex.faults()) == []
    versions = {float(value) for gloss in lex for value in lex.clip(gloss).root_positions.flat}
    assert len(versions) == 1, f"a mix of versions {versions}"
    assert len(lex) == N_WORDS - int(min(versions)) % 3
    return int(min(versions))


@pytest.mark.parametrize("before", ["_check_path", "Index", "_mmap_frames"])
def test_a_lexicon_that_is_replaced_while_it_is_opened_is_the_new_one(
    before: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "lex", 1)
    versions = [2]
    step: Callable[..., object] = getattr(store, before)

    def replaced_before(*arguments: object) -> object:
        if versions:
            write(tmp_path / "lex", versions.pop())
        return step(*arguments)

    monkeypatch.setattr(store, before, replaced_before)
    with lexicon.open(tmp_path / "lex") as lex:
        assert version_of(lex) == 2


def forked(work: Callable[[], None]) -> int:
    """The number of a new process that does some work; it ends with 1 where that raises an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks beside threads; this work has none
        child = os.fork()
    if not child:
        try:
            work()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(1)
    return child


def ended(process: int) -> int:
    """The exit status of a process, negative for a signal."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")
def test_readers_beside_a_builder_see_one_lexicon_or_the_next(tmp_path: Path) -> None:
    path, stop = tmp_path / "lex", tmp_path / "stop"
    write(path, 0)

    def build() -> None:
        for version in count(1):
            write(path, version)
            if stop.exists():
                return

    def read() -> None:
        last, n_seen = 0, 0
        while not stop.exists():
            with lexicon.open(path) as lex:
                version = version_of(lex)
            assert version >= last, f"version {version} after {last}"
            n_seen += version != last
            last = version
        assert n_seen > 2, "hardly a lexicon was replaced meanwhile"

    processes = [forked(build), *(forked(read) for _ in range(6))]
    time.sleep(8.0)
    stop.touch()
    assert [ended(process) for process in processes] == [0] * 7


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")
def test_a_kill_of_the_builder_leaves_the_old_lexicon_or_the_new_one(tmp_path: Path) -> None:
    path, rng = tmp_path / "lex", random.Random(5)
    write(path, 0)
    last = n_unfinished = 0

    def build() -> None:
        for version in count(last + 1):
            write(path, version)

    for _ in range(40):
        builder = forked(build)
        time.sleep(rng.uniform(0.0, 0.25))
        os.kill(builder, signal.SIGKILL)
        assert ended(builder) == -signal.SIGKILL
        n_unfinished += len(list(tmp_path.iterdir())) > 1
        with lexicon.open(path) as lex:
            version = version_of(lex)
        assert version >= last
        last = version
    assert n_unfinished > 5, "hardly a kill met the builder at work"
    write(path, last + 1)
    assert [entry.name for entry in tmp_path.iterdir()] == ["lex"]
    with lexicon.open(path) as lex:
        assert version_of(lex) == last + 1
