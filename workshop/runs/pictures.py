"""Draws the pictures of docs and the films of the README with the package itself; but viewer-avatar.png, by hand.

    make pictures

Run it again after ``figure.py`` has changed the figure. It needs Pillow, and for pictures of browsers the packages that
``npm ci`` installs in viewer/, and Chromium: ``CHROMIUM=FILE`` in the environment.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image, ImageSequence

from signsplice import read_avatar, retarget, save
from signsplice.lexicon import open_shipped_lexicon
from signsplice.lexicon.sentence import parse
from signsplice.motion import Clip, copy_unchecked, resample
from signsplice.motion.face import ARKIT_CHANNELS, VISEMES, Face
from signsplice.render import film
from signsplice.render.picture import Image as Pixels
from signsplice.render.picture import Scene, draw, make_scene
from signsplice.render.sheet import PAPER, write_cells
from signsplice.rig.info import rig_info
from signsplice.signer.preview import write_names
from signsplice.splicing.engine import SpliceOptions, splice
from signsplice.splicing.faces import LIDS, RULES
from signsplice.splicing.result import SpliceResult
from signsplice.splicing.word import words_of

ROOT = Path(__file__).resolve().parents[2]
SIZE, COLUMNS, COLOURS = 120, 9, 128
SENTENCE = "HELLO I DEAF I SIGN THANK-YOU"
REACH, ABOVE = 0.072, 0.044
"""Half of the shown height of a head, and the middle's height above the head's joint, statures."""
_BOTH = ("Left", "Right")
FACES: Mapping[str, dict[str, float]] = {
    "at rest": {},
    "closed eyes": {f"eyeBlink{side}": 1.0 for side in _BOTH},
    "brows up": {"browInnerUp": 0.7, "browOuterUpLeft": 0.8, "browOuterUpRight": 0.8},
    "brows down": {f"browDown{side}": 0.8 for side in _BOTH},
    "open mouth": {"jawOpen": 0.6},
    "smile": {f"mouthSmile{side}": 0.8 for side in _BOTH},
    "pucker": {"mouthPucker": 0.9},
    "look aside": {"eyeLookOutLeft": 0.8, "eyeLookInRight": 0.8},
}


def make_head_scene(clip: Clip, view: str = "front", reach: float = REACH) -> Scene:
    """Returns a scene of a clip's head, at its place in the first frame."""
    scene = make_scene(clip, view)
    head_position = scene.positions[0, rig_info(clip.skeleton).roles.joints["head"]] - scene.origin
    x, y, _ = (head_position @ scene.axes.T / scene.height).tolist()
    return replace(scene, window=(x - reach, x + reach, y + ABOVE - reach, y + ABOVE + reach))


def make_still_signer(shapes: Sequence[Mapping[str, float]]) -> Clip:
    """Returns a clip of a still signer with a face in each frame."""
    clip = _repeat_first_frame(open_shipped_lexicon().clip("NAME"), len(shapes))
    weights = np.array([[shape.get(name, 0.0) for name in ARKIT_CHANNELS] for shape in shapes])
    return copy_unchecked(clip, face=Face(ARKIT_CHANNELS, weights))


def _repeat_first_frame(clip: Clip, n_frames: int) -> Clip:
    first = clip[:1]
    return replace(
        first,
        local_rotations=first.local_rotations.repeat(n_frames, axis=0),
        root_positions=first.root_positions.repeat(n_frames, axis=0),
    )


def write_shapes(
    shapes: Mapping[str, Mapping[str, float]], path: Path, columns: int = COLUMNS, size: int = SIZE
) -> None:
    """Writes a page of faces, each with its name."""
    scene = make_head_scene(make_still_signer(list(shapes.values())))
    cells = [(draw(scene, frame, size, size), name) for frame, name in enumerate(shapes)]
    write_cells(cells, path, columns, COLOURS)


def splice_line(line: str, system: str | None = None) -> SpliceResult:
    """Returns a sentence with its face by rule, or one of a system."""
    with open_shipped_lexicon() as lexicon:
        words = words_of(parse(line, lexicon), lexicon.clip, owns_of=lexicon.owns)
        return splice(words, SpliceOptions(face_rules=() if system else RULES, system=system))


def choose_frames(line: str) -> tuple[Clip, Sequence[tuple[int, str]]]:
    """Returns a sentence, and frames to show of it: each sign, each transition and every blink."""
    result = splice_line(line)
    lids = result.clip.face.of(LIDS)[:, 0] if result.clip.face is not None else np.zeros(len(result.clip))
    shown_frames = {sum(s.output) // 2: (s.name or "") if s.kind == "sign" else s.kind for s in result.spans}
    shown_frames |= {k: "blink" for k in range(1, len(lids) - 1) if lids[k] == 1.0 > lids[k - 1]}
    return result.clip, sorted(shown_frames.items())


def write_sentences(lines: Sequence[str], path: Path, columns: int = 8, size: int = 170) -> None:
    """Writes a row of frames for each sentence, the signer from the front, and the face below."""
    cells: list[tuple[Pixels, str]] = []
    for line in lines:
        clip, shown = choose_frames(line)
        signer_scene = make_scene(clip)
        for frame, name in shown[:columns]:
            head = make_head_scene(clip[frame : frame + 1])
            picture = np.concatenate([draw(signer_scene, frame, size, size), draw(head, 0, size, size)])
            cells.append((picture, f"{name}, {frame / clip.fps:.1f} s"))
        cells += [(np.full_like(cells[0][0], PAPER), "")] * (columns - len(shown))
    write_cells(cells, path, columns, COLOURS)


def write_film(line: str, path: Path, system: str | None = None, fps: float = 10.0, n_colours: int = 32) -> None:
    """Writes a small film of a sentence for the README."""
    result = splice_line(line, system)
    rate = fps / result.clip.fps
    marks = [film.Mark(s.kind, s.name or "", *(round(frame * rate) for frame in s.output)) for s in result.spans]
    film.write_pictures(resample(result.clip, fps), path, marks, size=(240, 320))
    pages = Image.open(path)
    frames = [page.convert("RGB") for page in ImageSequence.Iterator(pages)]
    palette = frames[len(frames) // 3].quantize(n_colours, Image.Quantize.MEDIANCUT)
    small = [page.quantize(palette=palette, dither=Image.Dither.NONE) for page in frames]
    small[0].save(path, save_all=True, append_images=small[1:], duration=round(1000 / fps), loop=0, optimize=True)


PLAYED: Sequence[Mapping[str, float]] = (
    FACES["brows up"] | FACES["open mouth"],
    FACES["brows down"] | FACES["pucker"],
    FACES["smile"] | {"eyeBlinkLeft": 1.0},
    FACES["look aside"] | {"eyeBlinkRight": 0.3, "jawOpen": 0.35, "tongueOut": 0.9},
)


def write_players(path: Path) -> None:
    """Writes the same faces on the figure and on avatars, as three.js and three-vrm play them; needs node and
    Chromium.
    """
    sys.path.insert(0, str(ROOT / "tests"))
    import face_avatars

    clip = make_still_signer(PLAYED)
    with TemporaryDirectory() as name:
        folder = Path(name)
        save(clip, folder / "figure.glb")
        pairs: dict[str, tuple[Path, Path | str]] = {"figure, .glb": (folder / "figure.glb", "-")}
        for kind in face_avatars.KINDS:
            avatar = face_avatars.write(folder, kind)
            output_file = folder / f"{avatar.stem}-out{'.glb' if kind == 'arkit.glb' else '.vrma'}"
            save(retarget(clip, read_avatar(avatar)).clip, output_file)
            pairs[f"{kind}, {output_file.suffix}"] = (
                (output_file, "-") if kind == "arkit.glb" else (avatar, output_file)
            )
        files = [str(file) for pair in pairs.values() for file in pair]
        command = ["node", str(ROOT / "viewer/checks/faces.mjs"), name, "30", str(len(PLAYED)), *files]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        rows = range(len(pairs))
        cells = [
            (np.asarray(Image.open(folder / f"{row}-{frame}.png").convert("RGB")), list(pairs)[row])
            for frame in range(len(PLAYED))
            for row in rows
        ]
        write_cells(cells, path, len(pairs), COLOURS)


def write_screens(folder: Path) -> None:
    """Writes pictures of the service's page on a desk and on a phone; needs node and Chromium."""
    service = subprocess.Popen(
        [sys.executable, "-m", "signsplice", "serve", "--port", "0"], stdout=subprocess.PIPE, text=True
    )
    try:
        assert service.stdout is not None
        address = next(iter(service.stdout)).split()[3]
        with TemporaryDirectory() as made:
            command = ["node", str(ROOT / "viewer/checks/screens.mjs"), address, made]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            for size, name in (
                ("1280x720-touch", ""),
                ("390x844-touch", "-phone"),
                ("844x390-touch", "-phone-sideways"),
            ):
                page = Image.open(Path(made) / f"{size}.png").convert("RGB")
                page.quantize(COLOURS, dither=Image.Dither.NONE).save(folder / f"viewer{name}.png", optimize=True)
    finally:
        service.terminate()


def main(folder: Path) -> None:
    """Writes every page."""
    closed_mouth = {"mouthClose": {"mouthClose": 0.6, "jawOpen": 0.6}}  # mouthClose closes the lips of an open jaw
    write_shapes({name: {name: 1.0} for name in ARKIT_CHANNELS} | closed_mouth, folder / "face-shapes.png")
    write_shapes(VISEMES, folder / "face-visemes.png", 8)
    write_shapes(FACES, folder / "figure-face.png", 4, 180)
    write_sentences(("YOU LIKE COFFEE?", "YOU WHERE LIVE?"), folder / "face-questions.png")
    write_film(SENTENCE, folder / "sentence.gif")
    write_film(SENTENCE, folder / "lptransformer.gif", "lptransformer")
    write_names(folder)
    write_players(folder / "face-players.png")
    write_screens(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
