"""``<sign-player>`` as its users get it: packed, installed from the tarball, and used on pages from a file server."""

from __future__ import annotations

import gzip
import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import avatars
from browsing import CHROMIUM, VIEWER, drive
from known_rigs import RIGS, skeleton_of
from serving import serving
from signsplice.body.capsules import Avatar, build_capsules
from signsplice.formats.avatar import pack
from signsplice.motion import kinematics, rotation
from signsplice.rig.info import rig_info

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None or not (VIEWER / "node_modules").is_dir(), reason="no Chromium, or no viewer/node_modules"
    ),
]
MOST_BYTES = 300_000
PACKAGE = "@signsplice/sign-player"


def run(*command: str | Path, cwd: Path) -> str:
    """What a command prints."""
    done = subprocess.run([*map(str, command)], cwd=cwd, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, f"{command}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project that has the package from its tarball, with the examples in it."""
    project = tmp_path_factory.mktemp("project")
    run("npm", "run", "--silent", "player", cwd=VIEWER)
    tarball = run("npm", "pack", "--silent", "--pack-destination", project, cwd=VIEWER).split()[-1]
    (project / "package.json").write_text(json.dumps({"private": True, "type": "module"}))
    run("npm", "install", "--offline", "--no-audit", "--no-fund", f"./{tarball}", cwd=project)
    shutil.copytree(VIEWER / "examples", project / "site")
    shutil.copy(project / "node_modules" / PACKAGE / "dist/sign-player.js", project / "site")
    return project


@pytest.fixture(scope="module")
def site(installed: Path) -> Iterator[str]:
    """The address of a file server of the three pages and the files that they show."""
    root = installed / "site"
    (installed / "node_modules/react").symlink_to(VIEWER / "node_modules/react")
    (installed / "node_modules/react-dom").symlink_to(VIEWER / "node_modules/react-dom")
    esbuild = VIEWER / "node_modules/.bin/esbuild"
    run(esbuild, "react.tsx", "--bundle", "--jsx=automatic", "--outfile=react.js", "--log-level=warning", cwd=root)
    signsplice = (sys.executable, "-m", "signsplice")
    run(*signsplice, "sentence", "HELLO MY fs-AB", "-o", "hello.glb", cwd=root)
    run(*signsplice, "convert", "hello.glb", "hello.vrma", cwd=root)
    narrow = avatars.body("narrow")
    avatars.write(root / "avatar.vrm", narrow, avatars.tubes(narrow), axes=False, hair=False)
    (root / "favicon.ico").write_bytes(b"")

    class Quiet(SimpleHTTPRequestHandler):
        """A handler that prints nothing."""

        def log_message(self, format: str, *args: object) -> None:
            """Print nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(root))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


def looped(content: bytes, loop: list[list[Any]]) -> bytes:
    """A .glb with more nodes; "mesh" stands for the node of its mesh, numbers for the new ones."""
    size = int.from_bytes(content[12:16], "little")
    document = json.loads(content[20 : 20 + size])
    n = len(document["nodes"])
    mesh = next(node for node, fields in enumerate(document["nodes"]) if "mesh" in fields)
    document["nodes"] += [{"children": [mesh if c == "mesh" else n + c for c in children]} for children in loop]
    return pack(document, content[28 + size :])


def with_hanging_arms(avatar: Avatar) -> Avatar:
    """The avatar with arms that hang a little at rest."""
    offsets, joints = np.array(avatar.offsets), rig_info(avatar).roles.joints
    for side, turn in (("left", -0.6), ("right", 0.6)):
        arm = kinematics.subtree(avatar, joints[f"{side}UpperArm"])[1:]
        offsets[arm] = rotation.rotate(rotation.exp([0.1, 0.0, turn]), offsets[arm])
    hanging = replace(avatar, offsets=offsets)
    return replace(hanging, body=build_capsules(hanging, avatars.BODIES["broad"].shape))


@pytest.fixture(scope="module")
def seen(site: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What ``player.mjs`` saw in the pages."""
    out = tmp_path_factory.mktemp("player")
    broad = avatars.body("broad")
    avatars.write(out / "figure.glb", broad, avatars.tubes(broad), "", axes=False, hair=False)
    hanging = with_hanging_arms(broad)
    avatars.write(out / "hanging.glb", hanging, avatars.tubes(hanging), "", axes=False, hair=False)
    loops: list[list[list[Any]]] = [[[1], [0, "mesh"]], [[1], [0]], [["mesh"], ["mesh"]]]
    for k, loop in enumerate(loops):
        (out / f"loop-{k}.glb").write_bytes(looped((out / "figure.glb").read_bytes(), loop))
    avatars.write(out / "Ann.vrm", broad, avatars.tubes(broad), "0.x", axes=True, hair=False)
    options = "--workers", "1", "--allow-origin", site.rstrip("/"), "--avatar", str(out / "Ann.vrm")
    with serving("serve", *options) as address:
        return {**drive("player.mjs", site, address, out), "service": address}


def test_the_package_is_one_small_module_without_dependencies(installed: Path) -> None:
    package = installed / "node_modules" / PACKAGE
    script = (package / "dist/sign-player.js").read_bytes()
    assert len(gzip.compress(script, 9)) < MOST_BYTES
    assert not json.loads((package / "package.json").read_text()).get("dependencies")
    assert sorted(path.name for path in (package / "dist").iterdir()) == [
        "LICENCES.txt", "LICENSE", "api.d.ts", "attributes.d.ts", "sign-player.js", "sign_player.d.ts",
    ]  # fmt: skip
    for name in ("three", "@pixiv/three-vrm"):
        assert name in (package / "dist/LICENCES.txt").read_text()


def test_types_say_what_a_player_has(installed: Path) -> None:
    good = """
        import '@signsplice/sign-player';
        import type { Word } from '@signsplice/sign-player';
        const player = document.querySelector('sign-player')!;
        player.rate = 0.5;
        player.addEventListener('word', ({ detail }) => { const word: Word = detail; console.log(word.gloss.length); });
        player.addEventListener('ready', ({ detail }) => console.log(detail.duration.toFixed(1)));
    """
    tsc = (VIEWER / "node_modules/.bin/tsc", "--noEmit", "--strict", "--module", "esnext", "--target", "es2022")
    rest = ("--moduleResolution", "bundler", "--types", "", "--ignoreConfig")
    (installed / "good.ts").write_text(good)
    run(*tsc, *rest, "good.ts", cwd=installed)
    for wrong in ("player.rate = 'fast';", "player.show;", "player.addEventListener('word', (e) => e.detail.word);"):
        (installed / "wrong.ts").write_text(good + wrong)
        with pytest.raises(AssertionError, match=r"wrong\.ts"):
            run(*tsc, *rest, "wrong.ts", cwd=installed)


def test_the_pages_load_nothing_from_another_host(seen: dict[str, Any], site: str) -> None:
    assert {f"http://{host}/" for host in seen["hosts"]} == {site, seen["service"]}
    assert seen["faults"] == []
    assert all("404" in fault for fault in seen["expectedFaults"])


def test_axe_finds_no_violation_in_any_page(seen: dict[str, Any]) -> None:
    assert [seen[page]["axe"] for page in ("plain", "react", "own", "flat")] == [[], [], [], []]


def test_a_page_of_plain_html_plays_words_with_their_times(seen: dict[str, Any]) -> None:
    plain = seen["plain"]
    assert plain["atRest"]["paused"] is True, "this user wants little motion"
    assert plain["drawn"] > 0.1
    assert plain["atRest"]["words"] == ["HELLO", "MY", "AB"]
    assert [word["gloss"] for word in plain["words"]] == ["HELLO", "HELLO", "MY", "AB"][-len(plain["words"]) :]
    assert [word["gloss"] for word in plain["words"]][-2:] == ["MY", "AB"]
    assert all(word["start"] < word["end"] for word in plain["words"])
    assert plain["output"].startswith("AB (")
    assert plain["atEnd"]["currentTime"] == pytest.approx(plain["ready"]["duration"])


def test_keys_and_controls_work(seen: dict[str, Any]) -> None:
    plain = seen["plain"]
    assert plain["stepped"] == pytest.approx(2 / 30)
    assert plain["valueText"].startswith("frame 3 of ")
    assert plain["valueText"].endswith("HELLO")
    assert plain["toggled"] == [True, False]
    assert plain["atEnd"]["rate"] == 2


def test_a_player_may_be_moved_and_put_back(seen: dict[str, Any]) -> None:
    assert seen["plain"]["moved"] == 1, "nothing is loaded again"
    assert seen["plain"]["drawnAgain"] > 0.1


def test_a_file_that_is_missing_is_said(seen: dict[str, Any]) -> None:
    assert "missing.glb: 404" in seen["plain"]["error"]
    assert seen["plain"]["note"] == seen["plain"]["error"]


def test_react_sets_properties_and_hears_events(seen: dict[str, Any]) -> None:
    assert seen["react"]["drawn"] > 0.1
    assert seen["react"]["rate"] == 0.5
    assert seen["react"]["output"] == "HELLO"


def test_without_a_service_an_avatar_copies_rotations_and_that_is_said(seen: dict[str, Any]) -> None:
    assert seen["own"]["isCopied"] is True
    assert seen["own"]["warnings"] == ["avatar.vrm turns its joints as signed: hands do not keep their contacts"]
    assert seen["own"]["drawn"] > 0.05
    assert seen["own"]["isCopiedAgain"] is True, "a .glb without a VRM part"
    assert seen["own"]["drawnAgain"] > 0.05


def test_arms_that_hang_at_rest_sign_as_those_that_are_held_out(seen: dict[str, Any]) -> None:
    held_out, hanging = (
        np.array([[*box["min"].values(), *box["max"].values()] for box in boxes]) for boxes in seen["own"]["hands"]
    )
    np.testing.assert_allclose(hanging, held_out, atol=0.02)


def test_nodes_that_are_no_trees_are_refused(seen: dict[str, Any]) -> None:
    """Nodes outside the scene, in a loop, or two above one mesh."""
    assert len(seen["own"]["loops"]) == 3
    assert all("is its own ancestor" in said or "is a child of node" in said for said in seen["own"]["loops"])


def test_bones_of_avatars_without_a_vrm_part_are_known_by_name(tmp_path: Path) -> None:
    named = {"mixamo", "vrm", "unity", "vroid", "unreal", "rigify"}  # as docs/player.md says
    rigs = {
        rig: skeleton_of(*chains)
        for rig, (convention, chains) in RIGS.items()
        if convention in named and rig != "rigify in three.js"
    }
    (tmp_path / "rigs.json").write_text(json.dumps({rig: skeleton.names for rig, (skeleton, _) in rigs.items()}))
    found = json.loads(run("node", VIEWER / "checks/roles.mjs", tmp_path / "rigs.json", cwd=tmp_path))
    for rig, (_, roles) in rigs.items():
        body = {role: name for role, name in roles.items() if role not in ("jaw", "leftEye", "rightEye")}
        assert found[rig] == body, rig
    assert len(rigs) > 12


def test_a_service_fits_files_sentences_and_streams_to_avatars(seen: dict[str, Any]) -> None:
    assert seen["fitted"]["file"] == ["HELLO", "MY", "AB"], "words of the file's report"
    assert min(seen["fitted"]["drawn"], seen["fitted"]["drawnStream"]) > 0.05
    hands = np.array(
        [[[*box["min"].values(), *box["max"].values()] for box in poses] for poses in seen["fitted"]["hands"]]
    )
    assert np.ptp(hands[:, :, 4], axis=1).min() > 0.2, "hands move"
    uploaded, named = hands[:2], hands[2:]
    for whole, streamed in (uploaded, named):
        # Lengths of transitions differ, so that only the first word is the same.
        np.testing.assert_allclose(streamed[:2], whole[:2], atol=2e-2)


def test_a_mesh_packed_with_meshopt_is_read_and_one_with_draco_refused_in_a_line(seen: dict[str, Any]) -> None:
    assert seen["own"]["packed"]["isCopied"] is True
    assert seen["own"]["packed"]["drawn"] == pytest.approx(seen["own"]["drawnAgain"], abs=0.002)
    assert "packed with Draco" in seen["own"]["draco"]
    assert "\n" not in seen["own"]["draco"]


def test_an_avatar_without_words_stands_with_hanging_arms(seen: dict[str, Any]) -> None:
    rest = seen["own"]["atRest"]
    assert rest["drawn"] > 0.05
    assert max(rest["hands"]) < 1.0, "of about 1.7 m"
    assert rest["wide"] < 0.9


def test_a_player_without_styles_is_a_square_that_fits(seen: dict[str, Any]) -> None:
    wide, tall, _ = seen["own"]["bare"]
    assert wide == tall
    assert 300 < wide <= 480


def test_a_stream_waits_while_it_is_paused_and_then_comes_whole(seen: dict[str, Any]) -> None:
    stream = seen["stream"]
    assert len(stream["words"]) == 100
    assert stream["sentPaused"] < 5, "of at least thirteen"
    assert stream["paused"]["duration"] < 20, "of more than 90 s"
    (unknown,) = (word for word in stream["words"] if not word.isascii())
    known = [word for word in stream["words"] if word != unknown]
    texts = [message["text"] for message in stream["sent"] if message["type"] == "text"]
    assert [word for text in texts for word in text.split()] == stream["words"]
    assert stream["state"]["words"] == known
    assert [word["gloss"] for word in stream["heard"]][-99:] == known
    (error,) = stream["errors"]
    assert unknown in error["message"], "a word that is left out is said"
    assert stream["ahead"] < 30, "far less than the whole sentence"
    assert stream["state"]["duration"] > 90


def test_a_stream_reads_a_line_as_a_sentence_does_and_has_its_face(seen: dict[str, Any]) -> None:
    face = seen["face"]
    assert face["words"][-3:] == ["I-LOVE-YOU", "MY", "FRIEND"]
    assert face["most"]["eyeBlinkLeft"] > 0.9
    assert face["most"]["browDownLeft"] > 0.7, "brows ask"
    assert face["most"]["jawOpen"] == 0.0


def test_a_stream_shows_what_the_whole_sentence_shows(seen: dict[str, Any]) -> None:
    streamed, whole = (
        np.array([[*box["min"].values(), *box["max"].values()] for box in seen["stream"][key]])
        for key in ("points", "whole")
    )
    assert np.ptp(whole[:, 4]) > 0.2, "hands move"
    # Where a signer stands and faces is of one word here, of the sentence there: hands are turned by under 1 degree.
    np.testing.assert_allclose(streamed - streamed[0], whole - whole[0], atol=6e-3)
    np.testing.assert_allclose(streamed[0], whole[0], atol=2e-2)


def test_without_webgl_a_sheet_a_film_and_advice_are_shown(seen: dict[str, Any]) -> None:
    assert "WebGL" in seen["flat"]["note"]
    assert seen["flat"]["alt"] == "HELLO"
    assert seen["flat"]["types"] == ["image/png", ["true", "true", "image/gif"], ["false", "false", "image/png"]]
