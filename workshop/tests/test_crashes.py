"""What is written is old and whole or new and whole, whichever operation on the disk is the last, or fails.

After the next call nothing is left over.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import socket
import stat
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import random_clip

from faults import DONE_DESPITE, KILLED, REFUSED, every_operation
from signing import sign
from signsplice import SpliceOptions, lexicon, splice
from signsplice.errors import InputError
from signsplice.formats import atomic, save
from signsplice.splicing import report
from signsplice_workshop.corpora import pairs, training_data, truth
from signsplice_workshop.corpora.pairs import Recipe, write_pairs
from signsplice_workshop.train.bundles import write_bundle

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs processes that fork")

Content = dict[str, bytes]


def write_splice(folder: Path, seed: int) -> None:
    result = spliced(seed)
    save(result.clip, folder / "out.bvh")
    report.write(report.describe(result, {"load": 1.0, "save": 1.0}), folder / "report.json")


@lru_cache
def spliced(seed: int) -> Any:
    one, other = random_clip(seed), random_clip(seed + 1)
    clips = [one, replace(other, skeleton=one.skeleton)]
    return splice(clips, SpliceOptions("ends", "linear", "fixed"))


def write_words(folder: Path, seed: int) -> None:
    with lexicon.building(folder / "lex") as builder:
        builder.add(random_clip(seed), f"WORD{seed}")


def write_networks(folder: Path, seed: int) -> None:
    write_bundle(
        folder / "bundle", {"system": "lpt"}, {"a.onnx": b"%d" % seed, f"{seed}.onnx": b"x"}, {"a.jsonl": b"{}"}
    )


def write_checkpoint(folder: Path, seed: int) -> None:
    torch = pytest.importorskip("torch")
    from signsplice_workshop.train import checkpoint

    network = torch.nn.Linear(2, 2)
    torch.nn.init.constant_(network.weight, seed)
    torch.nn.init.zeros_(network.bias)
    checkpoint.save(folder, seed, network, torch.optim.SGD(network.parameters(), 0.1), "recipe")


def write_corpus(folder: Path, seed: int) -> None:
    write_pairs(Recipe((sign("I"),), seed, n_other=1), folder / "pairs", processes=1)


def write_training_data(folder: Path, seed: int) -> None:
    training_data.write(training_data.TrainingDataPlan(2, 2, 0, seed), folder, processes=1)


WRITERS: dict[str, Callable[[Path, int], None]] = {
    "splice": write_splice,
    "lexicon": write_words,
    "bundle": write_networks,
    "checkpoint": write_checkpoint,
    "pairs": write_corpus,
    "training data": write_training_data,
}


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Motion is computed once, and parts are small: what is tested is how they are written."""
    monkeypatch.setattr(pairs, "_synthesize_word", word)
    monkeypatch.setattr(truth, "splice", true_splice)
    monkeypatch.setattr(training_data, "make_part", lambda plan, number: {"turns": np.full(3, plan.seed + number)})


word = lru_cache(pairs._synthesize_word)
true_splice = lru_cache(truth.splice)


def content(folder: Path) -> dict[str, Content]:
    """Visible name in a folder -> relative path -> content of what is there."""
    return {
        top.name: {
            path.relative_to(folder).as_posix(): path.read_bytes() for path in [top, *top.rglob("*")] if path.is_file()
        }
        for top in folder.iterdir()
        if not top.name.startswith(".")
    }


def assert_whole(found: dict[str, Content], old: dict[str, Content], new: dict[str, Content], at: int) -> None:
    for name in old.keys() | new.keys():
        assert found.get(name) in (old.get(name), new.get(name)), f"{name} after operation {at}"


FAULTS = (
    ("new", None, "kill"),
    ("replacing", None, "kill"),
    ("new", errno.ENOSPC, "full disk"),
    ("replacing", errno.EIO, "I/O error"),
)
CASES = [
    pytest.param(writer, start, fault, step, id=f"{writer}, {start}, {name}", marks=marks)
    for writer in WRITERS
    for start, fault, name in FAULTS
    for step, marks in (((19, ()), (1, pytest.mark.slow)) if writer == "pairs" else ((1, ()),))  # 127 operations
]


@pytest.mark.parametrize(("writer", "start", "fault", "step"), CASES)
def test_every_operation_may_be_the_last_or_fail(
    writer: str, start: str, fault: int | None, step: int, tmp_path: Path
) -> None:
    write = WRITERS[writer]
    (tmp_path / "old").mkdir()
    if start == "replacing":
        write(tmp_path / "old", 1)
    old = content(tmp_path / "old")
    shutil.copytree(tmp_path / "old", tmp_path / "new")
    write(tmp_path / "new", 2)
    new = content(tmp_path / "new")

    def prepare(at: int) -> None:
        shutil.copytree(tmp_path / "old", tmp_path / str(at))

    def faulty(at: int) -> None:
        write(tmp_path / str(at), 2)

    statuses = []
    for at, status in every_operation(prepare, faulty, fault, step):
        folder = tmp_path / str(at)
        statuses.append(status)
        assert_whole(content(folder), old, new, at)
        write(folder, 2)
        assert content(folder) == new
        assert sorted(os.listdir(folder)) == sorted(new), f"left over after operation {at}"
        shutil.rmtree(folder)
    assert set(statuses) <= ({KILLED} if fault is None else {REFUSED, DONE_DESPITE})
    assert len(statuses) > 5


def test_a_kill_between_two_renames_is_undone_by_the_next_call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where two folders cannot be exchanged in one step, every operation may be the last one, too."""
    monkeypatch.setattr(atomic, "_exchange", lambda *_: False)
    write_words(tmp_path, 1)
    old = content(tmp_path)

    def prepare(at: int) -> None:
        shutil.copytree(tmp_path / "lex", tmp_path / str(at) / "lex")

    n_missing = 0
    for at, status in every_operation(prepare, lambda at: write_words(tmp_path / str(at), 2)):
        assert status == KILLED
        folder = tmp_path / str(at)
        n_missing += not (folder / "lex").exists()
        with pytest.raises(InputError, match="no word was added"), lexicon.building(folder / "lex"):
            pass
        assert sorted(os.listdir(folder)) == ["lex"]
        with lexicon.open(folder / "lex") as lex:
            assert lex.glosses in (("WORD1",), ("WORD2",))
        if lex.glosses == ("WORD1",):
            assert content(folder) == old
        shutil.rmtree(folder)
    assert n_missing == 1, "the test met the moment between the two renames"


def test_what_a_living_process_writes_is_not_swept(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from signsplice.formats.atomic import replacing, replacing_folder\n"
        "with replacing(Path(sys.argv[1], 'a.bvh')) as a, replacing_folder(Path(sys.argv[1], 'b')) as b:\n"
        "    a.write_text('slow'); (b / 'x').write_text('slow'); print('ready', flush=True); sys.stdin.readline()\n"
    )
    call = [sys.executable, "-c", code, str(tmp_path)]
    for is_killed in (False, True):
        with subprocess.Popen(call, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdin
            assert process.stdout
            assert process.stdout.readline() == "ready\n"
            save(random_clip(0), tmp_path / "other.bvh")
            assert len(list(tmp_path.glob(".signsplice-*"))) == 2
            if is_killed:
                process.kill()
            else:
                process.stdin.write("\n")
        if is_killed:
            assert len(list(tmp_path.glob(".signsplice-*"))) == 2
            save(random_clip(0), tmp_path / "other.bvh")
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.bvh", "b", "other.bvh"]
        assert (tmp_path / "a.bvh").read_text() == (tmp_path / "b" / "x").read_text() == "slow"


def test_files_that_only_look_like_temporary_ones_are_left_alone(tmp_path: Path) -> None:
    names = [".signsplice", ".signsplice-notes", ".signsplice-0123456789abcdef-x", "x.signsplice-0123456789abcdef"]
    for name in names:
        (tmp_path / name).write_text("mine")
    os.symlink("x", tmp_path / ".signsplice-0123456789abcdef")
    save(random_clip(0), tmp_path / "out.bvh")
    assert len(list(tmp_path.iterdir())) == len(names) + 2


def test_a_file_keeps_its_permissions_and_a_new_one_has_the_usual_ones(tmp_path: Path) -> None:
    (tmp_path / "old.bvh").write_text("x")
    (tmp_path / "old.bvh").chmod(0o640)
    (tmp_path / "usual").write_text("x")
    (tmp_path / "folder").mkdir()
    for name in ("old.bvh", "new.bvh"):
        save(random_clip(0), tmp_path / name)
    write_words(tmp_path, 1)
    modes = {path.name: path.stat().st_mode for path in tmp_path.iterdir()}
    assert modes["old.bvh"] & 0o777 == 0o640
    assert modes["new.bvh"] == modes["usual"]
    assert modes["lex"] == modes["folder"]


@pytest.mark.parametrize("kind", ["link", "link to nothing", "link to a folder", "pipe", "socket", "device"])
def test_links_and_special_files_are_not_written(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "out.npz"
    (tmp_path / "there").write_text("precious")
    if kind.startswith("link"):
        path.symlink_to({"link": "there", "link to nothing": "no"}.get(kind, "."))
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        listener = socket.socket(socket.AF_UNIX)
        with listener, contextlib.chdir(tmp_path):  # the whole path is too long for a socket
            listener.bind(path.name)
    else:
        try:
            os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, 3))
        except PermissionError:
            pytest.skip("only root may make a device")
    before = path.lstat()
    expected = f"is a {kind.split()[0]}, which would be replaced; name"
    with pytest.raises(InputError, match=expected):
        save(random_clip(0), path)
    with pytest.raises(InputError, match=expected):
        report.write({}, path)
    after = path.lstat()
    assert (after.st_mode, after.st_ino) == (before.st_mode, before.st_ino)
    assert (tmp_path / "there").read_text() == "precious"
