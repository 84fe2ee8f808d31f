"""Lexicons from folders of clips: glosses from file names and tables, and faults by file and line."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import random_clip

from signsplice import lexicon
from signsplice.errors import InputError
from signsplice.formats import ReadAs, load, save
from signsplice.lexicon import folder as folders
from signsplice.motion import Clip, Skeleton, rotation
from signsplice.motion.cache import CACHE
from signsplice.rig import info, roles
from signsplice.rig.inspection import inspect


@pytest.fixture
def clips(tmp_path: Path, words: dict[str, Clip]) -> Path:
    folder = tmp_path / "clips"
    (folder / "more" / "deep").mkdir(parents=True)
    save(words["HELLO"], folder / "hello.bvh")
    save(words["SIGN"], folder / "more" / "Sign.npz")
    save(random_clip(1), folder / "more" / "deep" / "你好.bvh")
    save(words["I"], folder / "fs-a.bvh")
    (folder / "notes.txt").write_text("not a clip")
    (folder / ".hidden.bvh").write_text("not a clip")
    (folder / ".git").mkdir()
    (folder / ".git" / "x.bvh").write_text("not a clip")
    return folder


def table(folder: Path, *lines: str) -> None:
    (folder / "glosses.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def faults(folder: Path) -> list[str]:
    return folders.check(folder).faults


def test_file_names_become_glosses(clips: Path, tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    built = lexicon.build(clips, tmp_path / "lex", signer="Kim", progress=lambda *call: calls.append(call))
    assert (built.n_words, built.n_letters, built.form) == (4, 1, "float32")
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]
    path = clips / "more" / "deep" / "你好.bvh"
    assert built.warnings == tuple(f"{path}: {line}" for line in inspect(load(path))["warnings"])
    assert built.warnings[0].startswith(f"{path}: no leftUpperArm or leftLowerArm found among joints")
    with lexicon.open(tmp_path / "lex") as lex:
        assert lex.glosses == ("HELLO", "SIGN", "fs-A", "你好")
        assert (lex.entry("sign").source, lex.entry("sign").signer) == ("more/Sign.npz", "Kim")
        original = load(clips / "hello.bvh")
        assert np.max(rotation.angle_between(original.local_rotations, lex.clip("HELLO").local_rotations)) < 1e-6
    compact = lexicon.build(clips, tmp_path / "lex", compact=True)
    assert compact.form == "int16"
    assert compact.n_bytes < 0.6 * built.n_bytes
    assert faults(clips) == []


def test_the_table_overrides_file_names(clips: Path, tmp_path: Path) -> None:
    table(
        clips,
        "\ufefffile,gloss,synonyms,signer,source,checked,kind",
        'hello.bvh,good day,hi; "hallo" ;,Ann,"a book, p. 3",yes,',
        "./more/Sign.npz,,,,,No,sign",
        "",
        "fs-a.bvh,fs-b,,,,,letter",
    )
    lexicon.build(clips, tmp_path / "lex", signer="Kim")
    with lexicon.open(tmp_path / "lex") as lex:
        assert lex.glosses == ("GOOD-DAY", "SIGN", "fs-B", "你好")
        hello = lex.entry("hi")
        assert (hello.signer, hello.source, hello.checked) == ("Ann", "a book, p. 3", True)
        assert lex.entry("SIGN").signer == "Kim"
        assert not lex.entry("SIGN").checked


def test_the_table_says_which_channels_are_a_words_own(clips: Path, tmp_path: Path) -> None:
    table(clips, "file,owns", "hello.bvh,Right Arm; head;", "more/Sign.npz,None", "fs-a.bvh,")
    lexicon.build(clips, tmp_path / "lex")
    with lexicon.open(tmp_path / "lex") as lex:
        assert [lex.owns(gloss) for gloss in ("hello", "SIGN")] == [{"right arm", "head"}, frozenset()]
        assert lex.extensions("HELLO") == {"owns": b"right arm;head"}
        assert lex.owns("fs-A") is lex.owns("你好") is None, "a rule decides"


TABLES = {
    "no file column": (["gloss"], ":1: no column 'file', expected file, gloss"),
    "semicolons": (["file;gloss", "hello.bvh;A"], ":1: column 'file;gloss'"),
    "unknown column": (["file,glosses"], ":1: column 'glosses', expected file, gloss"),
    "column twice": (["file,gloss,gloss"], ":1: column 'gloss' stands twice"),
    "empty": ([""], ":1: no column 'file'"),
    "no such file": (["file,gloss", "hello.bvh,A", "gone.bvh,B"], ":3: no clip gone.bvh in"),
    "cells missing": (["file,gloss,signer", "hello.bvh,A"], ":2: 2 cells, expected 3"),
    "file twice": (["file,gloss", "hello.bvh,A", "hello.bvh,B"], ":3: hello.bvh stands in line 2 too"),
    "no file": (["file,gloss", ",A"], ":2: no file named"),
    "checked by whom": (["file,checked", "hello.bvh,maybe"], ":2: checked 'maybe', expected yes, no or nothing"),
    "channel": (["file,owns", "hello.bvh,left arm;leg"], ":2: owns 'left arm;leg', expected none or some of left arm"),
    "none and more": (["file,owns", "hello.bvh,none;head"], ":2: owns 'none;head', expected none or some of"),
    "kind": (["file,kind", "hello.bvh,word"], ":2: kind 'word', expected sign or letter"),
    "letter": (["file,kind", "hello.bvh,letter"], ":2: letter 'HELLO', expected a gloss of fs-"),
    "gloss of nothing": (["file,gloss", "hello.bvh,a\x07b"], ":2: gloss 'a\\x07b', expected printable"),
    "quotes": (["file,gloss", 'hello.bvh,"A'], ":2: is no table"),
    "gloss twice": (["file,gloss", "hello.bvh,sign"], "Sign.npz: gloss 'SIGN' is that of "),
    "synonym twice": (["file,synonyms", "hello.bvh,SIGN"], "glosses.csv:2) too"),
}


@pytest.mark.parametrize("what", TABLES)
def test_faults_of_the_table_name_file_and_line(what: str, clips: Path, tmp_path: Path) -> None:
    lines, message = TABLES[what]
    table(clips, *lines)
    for found in (faults(clips), faults(clips)):
        assert len(found) == 1
        assert message in found[0]
        assert "\n" not in found[0]
    with pytest.raises(InputError) as caught:
        lexicon.build(clips, tmp_path / "lex", skip_broken=True)
    assert str(caught.value) == found[0]
    assert not (tmp_path / "lex").exists()


def test_a_table_that_is_not_utf8_is_a_fault(clips: Path) -> None:
    (clips / "glosses.csv").write_bytes(b"file,gloss\nhello.bvh,gr\xfc\xdf\n")
    assert "glosses.csv:2: is not UTF-8" in faults(clips)[0]


def test_two_files_with_one_gloss_are_both_named(clips: Path, tmp_path: Path, words: dict[str, Clip]) -> None:
    save(words["DEAF"], clips / "more" / "HELLO.bvh")
    with pytest.raises(InputError) as caught:
        lexicon.build(clips, tmp_path / "lex")
    for part in ("more/HELLO.bvh: gloss 'HELLO'", "clips/hello.bvh too", "glosses.csv"):
        assert part in str(caught.value)


def test_broken_clips_stop_a_build_or_are_skipped(clips: Path, tmp_path: Path) -> None:
    text = (clips / "hello.bvh").read_text()
    (clips / "bad.bvh").write_text(text[:-200])
    (clips / "more" / "worse.npz").write_bytes(b"PK nothing")
    with pytest.raises(InputError, match=r"bad\.bvh:\d+: .*nothing was built: .*lexicon check .*skip_broken"):
        lexicon.build(clips, tmp_path / "lex")
    assert [path.name for path in tmp_path.iterdir()] == ["clips"]
    found = faults(clips)
    assert len(found) == 2
    assert "bad.bvh:" in found[0]
    assert "worse.npz" in found[1]
    built = lexicon.build(clips, tmp_path / "lex", skip_broken=True)
    assert built.n_words == 4
    assert [line for line in built.warnings if line.endswith("; left out")] == [line + "; left out" for line in found]


def test_check_and_build_name_what_a_clip_leaves_out(
    clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        folders, "load", lambda path, limits, face, read: replace(load(path, limits), left_out=("a mesh",))
    )
    path = clips / "hello.bvh"
    line = f"{path}: a mesh left out: a clip holds the motion of joints and faces"
    assert line in folders.check(clips).warnings
    assert line in lexicon.build(clips, tmp_path / "lex").warnings


def test_roles_are_stored_with_the_words(clips: Path, tmp_path: Path) -> None:
    names = random_clip(1).skeleton.names
    roles = {"hips": names[0]}
    lexicon.build(clips, tmp_path / "lex", roles=roles)
    with lexicon.open(tmp_path / "lex") as lex:
        assert lex.clip("你好").skeleton.roles == roles
        assert lex.clip("HELLO").skeleton.roles is None, "known by its names"
    with pytest.raises(InputError, match=r"你好\.bvh: .*no joint 'nowhere'"):
        lexicon.build(clips, tmp_path / "lex", roles={"hips": names[0], "spine": "nowhere"})


def test_the_table_says_how_a_file_is_read_and_the_call_how_the_others_are(clips: Path, tmp_path: Path) -> None:
    (clips / "roles.json").write_text(json.dumps({"hips": random_clip(1).skeleton.names[0]}))
    (clips / "glosses.csv").write_text("file,fps,roles\nhello.bvh,29.5,\nmore/deep/你好.bvh,,roles.json\n")
    lexicon.build(clips, tmp_path / "lex", read=ReadAs(fps=20.0))
    with lexicon.open(tmp_path / "lex") as lex:
        assert lex.clip("HELLO").fps == 29.5
        assert lex.clip("你好").fps == 20.0
        assert lex.clip("你好").skeleton.roles == {"hips": random_clip(1).skeleton.names[0]}
        n_frames = len(load(clips / "hello.bvh"))
        assert len(lex.clip("HELLO")) == n_frames, "no frame is made or left out"
    for head, cell, said in (
        ("fps", "0", "fps 0.0, expected frames a second, 0.001 to 100,000"),
        ("face_fps", "fast", "face_fps 'fast', expected frames a second"),
        ("rest_frame", "-1", "rest_frame '-1', expected a frame's number"),
        ("rest_frame", "999", "no frame 999 to be its rest pose"),
        ("roles", "none.json", "none.json: no such file"),
    ):
        (clips / "glosses.csv").write_text(f"file,{head}\nhello.bvh,{cell}\n")
        (fault,) = folders.check(clips).faults
        assert said in fault


def test_folders_without_clips_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "a.bvh").write_text("x")
    for name, message in (
        ("empty", r"no clips in it, expected files that end in \.bvh or \.npz"),
        ("file", "is a file, expected a folder of clips"),
        ("none", "no such folder"),
        ("broken", "every clip is broken, the first one: .*a.bvh"),
    ):
        with pytest.raises(InputError, match=message):
            lexicon.build(tmp_path / name, tmp_path / "lex", skip_broken=True)
    assert not (tmp_path / "lex").exists()


def test_a_folder_that_cannot_be_read_is_refused(clips: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: str, *_: object) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(os, "scandir", refuse)
    with pytest.raises(InputError, match=r"clips: cannot be read \(Permission denied\)"):
        faults(clips)


def test_a_rig_is_analysed_once_however_many_files_have_it(
    tmp_path: Path, words: dict[str, Clip], monkeypatch: pytest.MonkeyPatch
) -> None:
    analysed: list[Skeleton] = []

    def counted(skeleton: Skeleton) -> roles.Humanoid:
        analysed.append(skeleton)
        return roles.find_roles(skeleton)

    monkeypatch.setattr(info, "find_roles", counted)
    CACHE.clear()
    (tmp_path / "clips").mkdir()
    for n in range(3):
        save(words["HELLO"], tmp_path / "clips" / f"hello-{n}.bvh")
    lexicon.build(tmp_path / "clips", tmp_path / "lex")
    assert len(analysed) == 1
    assert faults(tmp_path / "clips") == []
    assert len(analysed) == 1


def test_files_of_other_kinds_are_counted_once(clips: Path, tmp_path: Path, words: dict[str, Clip]) -> None:
    for name in ("a.pdf", "b.PDF", "more/README", ".hidden.txt", "stray.csv"):
        (clips / name).write_text("not a clip")
    roles_of = {"hips": words["I"].skeleton.names[0]}
    (clips / "roles.json").write_text(json.dumps(roles_of))
    (clips / "more" / "face.csv").write_text("no face")
    save(words["HELLO"], clips / "faced.bvh")
    (clips / "faced.csv").write_text("no face either")
    table(clips, "file,face,roles", "fs-a.bvh,more/face.csv,roles.json")
    line = "5 files of other kinds left: .pdf 2, .csv 1, .txt 1, no suffix 1"
    checked = folders.check(clips)
    assert checked.n_clips == 5
    assert [*checked.unread] == [line]
    assert lexicon.build(clips, tmp_path / "lex", skip_broken=True).unread == (line,)
    for n in range(9):
        (clips / f"x.kind{n}").write_text("")
    (most,) = folders.check(clips).unread
    assert most.startswith("14 files of other kinds left: .pdf 2, ")
    assert most.endswith(" and 5 more")
