"""The viewer in a headless Chromium, used as a person would, and watched for errors and requests to other hosts."""

from __future__ import annotations

import itertools
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import avatars
from browsing import CHROMIUM, VIEWER, drive
from serving import serving
from signsplice.formats import load, save
from signsplice.motion import Clip, kinematics
from signsplice.service import page

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None or not (VIEWER / "node_modules").is_dir() or not page.BUILT.is_dir(),
        reason="no Chromium, or the viewer is not built (make viewer)",
    ),
]


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory, words: dict[str, Clip]) -> dict[str, Any]:
    """What ``page.mjs`` saw in the page."""
    out = tmp_path_factory.mktemp("viewer")
    for gloss in ("DEAF", "SIGN"):
        save(words[gloss], out / f"{gloss}.bvh")
    narrow = avatars.body("narrow")
    avatars.write(out / "toy.vrm", narrow, avatars.tubes(narrow), axes=False, hair=False)
    save(words["DEAF"][30:33], out / "short.bvh")
    with serving("serve") as address:
        return drive(
            "page.mjs", address, out, *(out / name for name in ("DEAF.bvh", "SIGN.bvh", "toy.vrm", "short.bvh"))
        )


def test_the_page_opens_and_signs(seen: dict[str, Any]) -> None:
    assert seen["firstSigns"] == ["HELLO", "MY", "NAME"]
    assert seen["playButton"] == "❚❚"
    assert seen["running"][1] > seen["running"][0]
    assert min(seen["drawn"]) > 0.1


def test_there_are_no_errors_and_no_requests_to_other_hosts(seen: dict[str, Any]) -> None:
    assert seen["faults"] == []
    assert len(seen["hosts"]) == 1
    assert seen["hosts"][0].startswith("127.0.0.1:")


def test_a_typed_sentence_is_completed_and_plays(seen: dict[str, Any]) -> None:
    assert seen["suggestions"][0].startswith("THANK-YOU")
    assert seen["activeSuggestion"] == "suggestion-0"
    assert seen["typed"] == "fs-AB THANK-YOU "
    assert seen["typedSigns"] == ["A", "B", "THANK-YOU"]
    assert seen["typedPlayButton"] == "❚❚"
    assert seen["caption"] == "AB"
    assert seen["letter"] == ["A"]


def test_a_line_without_a_sign_is_reported_and_the_scene_stays(seen: dict[str, Any]) -> None:
    assert "你好" in seen["unknown"]
    assert seen["keptSigns"] == seen["typedSigns"]
    assert all("422" in line for line in seen["expectedFaults"])


def test_dropped_files_are_spliced_and_shown(seen: dict[str, Any]) -> None:
    assert seen["droppedSigns"] == ["DEAF", "SIGN"]
    assert seen["alertIsHidden"] is True


def test_a_seam_is_looped(seen: dict[str, Any]) -> None:
    start, end = seen["loop"]["ends"]
    frames = seen["loop"]["seen"]
    assert seen["loop"]["chosen"] == "0"
    assert seen["everything"] == "all"
    assert seen["unlooped"] == ""
    assert min(frames) >= start - 16
    assert max(frames) <= end + 16
    assert any(a > b for a, b in itertools.pairwise(frames)), "did not start again"
    assert any(start <= frame < end for frame in frames)


def test_keys_dials_and_a_compared_method(seen: dict[str, Any]) -> None:
    assert (seen["forward"], seen["back"]) == (11, 9)
    assert seen["isMirrored"] == seen["handsView"] == "true"
    assert seen["lastFrames"][1] < 0.75 * seen["lastFrames"][0]
    assert seen["compared"]["methods"] == ["learned", "slerp"]
    assert min(seen["compared"]["drawn"]) > 0.1


def test_a_sentence_signed_while_the_page_opens_stays(seen: dict[str, Any]) -> None:
    hurried = seen["hurried"]
    assert hurried["line"] == "HELLO DEAF SIGN"
    assert hurried["signs"] == ["HELLO", "DEAF", "SIGN"]
    assert hurried["search"] == "?s=HELLO+DEAF+SIGN"
    assert hurried["asked"] == [["HELLO", "DEAF", "SIGN"]]
    assert hurried["faults"] == []


def test_the_address_does_not_name_what_could_not_be_shown(seen: dict[str, Any]) -> None:
    assert seen["notShown"]["signs"] == ["HELLO", "DEAF", "SIGN"]
    assert seen["notShown"]["search"] == "?s=HELLO+DEAF+SIGN"


def test_dials_for_the_tempo_and_what_moves_between_signs(seen: dict[str, Any]) -> None:
    tempo = seen["tempo"]
    natural = ["natural", "natural", 1], ["natural", "transition", 1], ["natural", "transition", 0.5]
    assert tempo["asked"] == [["citation", "natural", 1], *natural]
    assert tempo["lastFrames"][1] < 0.9 * tempo["lastFrames"][0]
    assert tempo["personValue"] == "0.5"
    assert tempo["search"] == "?s=HELLO+DEAF+SIGN&tempo=natural&free_hand=transition&person=0.5"


def test_downloads_hold_the_animation(seen: dict[str, Any]) -> None:
    report = json.loads(Path(seen["saved"]["report"]).read_text())
    as_bvh, as_glb, as_vrma = (load(seen["saved"][form]) for form in ("bvh", "glb", "vrma"))
    assert report["frames"] == len(as_bvh) == len(as_glb) == len(as_vrma)
    assert [span["name"] for span in report["spans"] if span["kind"] == "sign"] == ["HELLO", "DEAF"]
    heights = [
        np.ptp(kinematics.forward(clip)[1][:, :, 1], axis=1).mean() * unit
        for clip, unit in ((as_bvh, 0.01), (as_glb, 1.0))
    ]
    assert heights[0] == pytest.approx(heights[1], rel=1e-4)


def test_an_avatar_replaces_the_mannequin(seen: dict[str, Any]) -> None:
    assert seen["junkAlert"].startswith("junk.vrm is not a VRM avatar")
    assert seen["avatar"]["alert"] == ""
    assert seen["avatar"]["status"].endswith("hands fitted to the body of toy.vrm")
    assert min(seen["avatar"]["drawn"]) > 0.1


def test_a_film_has_every_frame(seen: dict[str, Any]) -> None:
    film = Path(seen["film"])
    assert film.suffix in (".mp4", ".webm")
    assert film.stat().st_size > 10_000
    if shutil.which("ffprobe") is None:
        pytest.skip("ffprobe is not installed")
    entries = "stream=width,height,nb_read_frames"
    call = ["ffprobe", "-v", "error", "-count_frames", "-show_entries", entries, "-of", "csv=p=0", str(film)]
    output = subprocess.run(call, capture_output=True, text=True, check=True).stdout
    assert output.strip() == "1920,1080,3"


def test_axe_finds_no_accessibility_violations(seen: dict[str, Any]) -> None:
    assert seen["axe"] == []


def test_the_page_fits_a_phone_in_chinese(seen: dict[str, Any]) -> None:
    phone = seen["phone"]
    assert phone["language"] == "zh-CN"
    assert phone["sign"] == "打手语"
    assert phone["overflow"] <= 0, "the page is wider than the phone"
    assert phone["smallButtons"] == [], "too small for a finger"
    assert phone["signs"] == ["DEAF", "FRIEND"]
    assert min(phone["drawn"]) > 0.1
    assert phone["faults"] == []


def test_a_saved_page_opens_from_disk_without_network(seen: dict[str, Any]) -> None:
    disk = seen["fromDisk"]
    assert disk["signs"] == ["HELLO", "DEAF"]
    assert disk["sides"] == ["learned", "slerp"]
    assert disk["running"][1] > disk["running"][0]
    assert min(disk["drawn"]) > 0.1
    assert disk["hasSentenceBox"] is False
    assert disk["faults"] == []
    assert disk["hosts"] == []


def test_the_docs_page_needs_no_other_host(seen: dict[str, Any]) -> None:
    assert seen["docs"]["routes"] == 9
    assert seen["docs"]["hosts"] == seen["hosts"]
    assert seen["docs"]["faults"] == []


@pytest.fixture(scope="module")
def meant(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What ``meant.mjs`` saw in the page."""
    broad = avatars.body("broad")
    path = tmp_path_factory.mktemp("meant") / "figure.glb"
    avatars.write(path, broad, avatars.tubes(broad), "", axes=False, hair=False)
    with serving("serve") as address:
        return drive("meant.mjs", address, path)


def test_what_may_have_been_meant_is_offered_beside_the_sentence(meant: dict[str, Any]) -> None:
    assert meant["spelled"] == ["HELLO", *"FREND", "I-LOVE-YOU"]
    assert meant["offered"] == ["frend: did you mean", "FRIEND", "RED"]
    assert any("read as one gloss, I-LOVE-YOU" in warning for warning in meant["warnings"])
    assert meant["overflow"] <= 0, "the page is wider than the phone"
    assert meant["line"] == "HELLO FRIEND, i love you"
    assert meant["signs"] == ["HELLO", "FRIEND", "I-LOVE-YOU"]
    assert meant["isHidden"]
    assert meant["besideError"][0].endswith("did you mean")
    assert meant["faults"] == []


def test_the_status_says_which_words_are_spelled(meant: dict[str, Any]) -> None:
    assert meant["status"].startswith("spelled: frend; ")


def test_an_error_keeps_what_was_typed(meant: dict[str, Any]) -> None:
    assert meant["keptLine"] == "HELLO MY"


def test_a_figure_without_a_vrm_part_is_an_avatar(meant: dict[str, Any]) -> None:
    assert meant["avatar"].endswith("hands fitted to the body of figure.glb")


def test_written_signs_that_are_pasted_are_signed(meant: dict[str, Any]) -> None:
    assert meant["pasted"] == [True, False], "other text is pasted into the box"
    assert meant["written"][:3] == ["RED", "FATHER", "THROW"]
    assert meant["hamnosys"] == ["SIGN-1"]
    assert "text.txt" in meant["unwritten"], meant["unwritten"]
    assert "\n" not in meant["unwritten"]


def test_chinese_words_are_answered_in_chinese_with_what_can_be_typed(meant: dict[str, Any]) -> None:
    chinese = meant["chinese"]
    assert chinese["line"] == "你好 朋友"
    assert "你好、朋友" in chinese["alert"]
    assert "词目用拉丁字母输入" in chinese["alert"]
    assert "no gloss" not in chinese["alert"]


def test_without_webgl_the_page_shows_a_contact_sheet(meant: dict[str, Any]) -> None:
    assert "WebGL" in meant["flat"]["note"]
    assert (meant["flat"]["alt"], meant["flat"]["controls"], meant["flat"]["downloads"]) == ("HELLO", False, True)


@pytest.fixture(scope="module")
def screens() -> dict[str, Any]:
    """What ``screens.mjs`` saw in the page."""
    with serving("serve") as address:
        return drive("screens.mjs", address)


def test_nothing_covers_the_signer_or_a_control_on_any_screen(screens: dict[str, Any]) -> None:
    assert len(screens["screens"]) == 26
    assert {screen: faults for screen, faults in screens["screens"].items() if faults} == {}
    assert not any(screens["faults"])


def test_letters_have_no_prefix_in_labels(screens: dict[str, Any]) -> None:
    labels = screens["labels"] + screens["letterTitles"]
    assert any("NAME ANNA" in label for label in labels)
    assert any("A → N" in label for label in labels)
    assert not any("fs-" in label for label in labels)


def picture(drawn: dict[str, Any]) -> list[int]:
    """The triangles of each part in one picture, of all that were drawn."""
    n_parts = 12
    assert len(drawn["parts"]) >= n_parts
    return [int(n) for n in drawn["parts"][:n_parts]]


def test_frames_that_come_in_time_show_the_full_figure(screens: dict[str, Any]) -> None:
    seen = screens["inTime"]
    assert seen["ratio"] == 2
    assert picture(seen["after"]) == picture(seen["before"])
    assert seen["after"]["shadows"] > 0


def test_late_frames_cost_pixels_and_shadows_but_no_triangle(screens: dict[str, Any]) -> None:
    for name, ratio in (("late", 1.5), ("veryLate", 1.0)):
        seen = screens[name]
        assert seen["before"]["shadows"] > 0
        assert seen["after"]["shadows"] == 0
        assert seen["ratio"] == pytest.approx(ratio, abs=0.01)
        assert picture(seen["after"]) == picture(seen["before"])
    assert screens["lateAgain"]["shadows"] == 0


def test_hands_in_ten_handshapes_look_the_same_where_frames_come_late(screens: dict[str, Any]) -> None:
    full, late = (np.array([list(mask) for mask in masks]) == "1" for masks in screens["handshapes"])
    assert len(full) == 10
    same = (full & late).sum(axis=1) / (full | late).sum(axis=1)
    assert full.sum(axis=1).min() > 200, "points of skin"
    assert same.min() > 0.93, same


def test_a_figure_that_is_replaced_frees_its_buffers(screens: dict[str, Any]) -> None:
    before, after = screens["buffers"]
    assert after <= before


def test_the_hands_preset_is_close(screens: dict[str, Any]) -> None:
    front, hands = screens["skin"]
    assert hands > 3 * front


def test_an_address_holds_the_sentence_and_what_is_set(screens: dict[str, Any]) -> None:
    opened = screens["opened"]
    assert opened["signs"] == ["DEAF", "FRIEND"]
    assert opened["values"] == ["DEAF FRIEND", "1.5", "0.5", "", "slerp", "0.4", "natural", "transition", "0.5"]
    assert opened["isAuto"] is False
    assert opened["pressed"] == ["side", "mirror"]
    assert opened["title"] == "DEAF FRIEND – signsplice"
    search = "transition=slerp&transition_time=0.4&sign_speed=1.5&tempo=natural&free_hand=transition&person=0.5"
    search += "&speed=0.5&view=side&mirror=1&captions=0"
    assert opened["search"] == f"?s=DEAF+FRIEND&{search}"
    assert screens["signed"]["search"] == f"?s=HELLO+fs-AB&{search}"


def test_back_and_forward_sign_what_was_signed(screens: dict[str, Any]) -> None:
    assert screens["unlinked"] == "3", "a link within the page signed again"
    assert screens["back"] == screens["opened"]
    assert screens["forward"]["signs"] == ["HELLO", "A", "B"]
    assert screens["forward"]["isAuto"] is True
    assert screens["reloaded"] == screens["forward"]


def test_an_odd_address_runs_nothing(screens: dict[str, Any]) -> None:
    odd = screens["odd"]
    assert odd["hacked"] is None
    assert odd["signs"][:3] == ["I", "M", "G"], "spelled"
    assert odd["values"][1:] == ["2", "1", "", "", "0.3", "citation", "natural", "1"]
    assert odd["isAuto"] is True
    assert odd["pressed"] == ["front", "captions"]
